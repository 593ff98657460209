"""The steps of a user's system in a folder: what each leaves, and what the next one reads.

In: a `LogModel` and a folder. Out: find.json, name.json, correction.toml and domain.json, which
`gap.report.system_page` draws. What has run for the same system and logs, by the same rules, is not
repeated.
"""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from wakedeploy.core.version import VERSION
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Answer
from wakedeploy.gap.systems.calls import attempted
from wakedeploy.gap.systems.correction import correction_of, write_correction
from wakedeploy.gap.systems.logs import LogModel
from wakedeploy.gap.workflow import Folder

CORRECTION = "correction.toml"


class OwnFolder(Folder):
    """The steps of a system and its logs; `exported` tells of further files that `add` wrote."""

    def __init__(self, model: LogModel, out: Path, progress: Progress = quiet) -> None:
        super().__init__(model, out, _key(model), model.horizon * model.dt_s, progress)
        self.log_model = model
        self.exported: list[str] = []

    def add(self) -> Answer:
        """What was found as a file that the system loads."""
        answer = self.name()
        write_correction(correction_of(self.log_model, self.found()[1]), self.out / CORRECTION)
        system = self.log_model.system
        where = f"{system.name}.export"
        self.exported = attempted(where, system.export, answer.as_json(), self.out)
        return answer


def _key(model: LogModel) -> str:
    """A hash of program, rules, logs, effects with their parameters, and the system.

    Of the system it is what it states and what its functions compute.
    """
    digest = hashlib.sha256()
    system = model.system
    stated = (
        system.rate_hz, system.steps, system.inputs, system.states, system.outputs,
        system.constants, [replace(port, function=None) for port in system.ports],
        system.process_noise, system.start_spread, system.outlier_share, system.forecast_s,
    )  # fmt: skip
    digest.update(
        repr((VERSION, RULES, system.name, stated, sorted(model.effects.items()))).encode()
    )
    for log in model.logs:
        digest.update(log.name.encode())
        digest.update(log.driving.tobytes() + log.outputs.tobytes())
    for episode in range(model.episodes):
        for _, values in model.coordinates(episode).values():  # with what `start` tells
            digest.update(np.ascontiguousarray(values).tobytes())
    for values in system.probed().values():
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
