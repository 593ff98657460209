"""The steps of a user's system in a folder: what each leaves, and what the next one reads.

In: a `LogModel` and a folder. Out: find.json, name.json, correction.toml, of a class
plan.json, and domain.json, which `gap.report.system_page` draws. What has run for the same system
and logs, by the same rules, is not repeated.
"""

import functools
import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from wakedeploy.core.version import VERSION
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Answer, Effect, Forecast, Result, read
from wakedeploy.gap.search.comparison import theta_from
from wakedeploy.gap.search.results import constants_of
from wakedeploy.gap.search.sizes import parameters
from wakedeploy.gap.systems.calls import attempted
from wakedeploy.gap.systems.correction import correction_of, write_correction
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.known import stated_sizes
from wakedeploy.gap.systems.planning.plan import commanded, plan
from wakedeploy.gap.systems.planning.planned import Planned, planned, unplannable
from wakedeploy.gap.workflow import Folder

CORRECTION, PLAN = "correction.toml", "plan.json"


class OwnFolder(Folder):
    """The steps of a system and its logs; `exported` describes further files that `add` wrote.

    With `only`, `add` adds these effects beside what is sure, in the place of a class.
    """

    def __init__(
        self, model: LogModel, out: Path, progress: Progress = quiet, only: Sequence[str] = ()
    ) -> None:
        model.require_effects()
        model.acting(tuple(only))  # says which there are
        super().__init__(model, out, _key(model), model.horizon * model.dt_s, progress)
        self.log_model, self.only = model, tuple(dict.fromkeys(only))
        self.later = (*self.later, CORRECTION, PLAN, "power.json", *model.system.exported)
        self.exported: list[str] = []

    def add(self) -> Answer:
        """What was found, or the effects that were asked for, as a file that the system loads.

        The answer is that of `name`, or one with these effects and the constants fitted beside.
        """
        answer = self.name()
        fitted = self._with(answer, self.only) if self.only else self._sure(answer)
        is_answer = fitted.hypothesis == tuple(e.name for e in answer.effects)
        exported = answer if is_answer else _with_effects_of(self.log_model, answer, fitted)
        if self.only:
            exported = exported.model_copy(update={"verdict": "named", "rivals": []})
        correction = correction_of(self.log_model, fitted)
        if correction.is_empty:
            (self.out / CORRECTION).unlink(missing_ok=True)  # of an earlier answer
        else:
            write_correction(correction, self.out / CORRECTION)
        system = self.log_model.system
        where = f"{system.name}.export"
        self.exported = attempted(where, system.export, exported, self.out)
        return exported if self.only else answer

    def plan(self) -> Planned | None:
        """Whether an input splits the class that was found: plan.json; None where none is open."""
        answer, path = self.name(), self.out / PLAN
        if answer.verdict != "class":
            path.unlink(missing_ok=True)  # of an earlier answer
            return None
        known = read(path, Planned, self.key)
        if known is not None:
            return known
        made = self._planned(answer)
        made.write(path)
        return made

    def _planned(self, answer: Answer) -> Planned:
        model = self.log_model
        if not commanded(model):
            return unplannable(answer.rivals, model.name, self.key)
        sizes = stated_sizes(self.out, answer, model, answer.rivals)
        stage = functools.partial(self.progress, "trying inputs that could split the class")
        made = plan(model, self.base(), answer.rivals, sizes, stage)
        return planned(made, model.name, self.key)

    def _sure(self, answer: Answer) -> Fit:
        """The fit of what was found, without what an "unknown" leaves open."""
        model, found = self.found()
        sure = tuple(n for n in found.hypothesis if n not in answer.rivals)
        if answer.verdict != "unknown" or sure == found.hypothesis:
            return found
        self.progress("fitting what is sure")
        near = theta_from(model, sure, found)
        return settled(model, fit(model, sure, found.episodes, near))[0]

    def _with(self, answer: Answer, names: Sequence[str]) -> Fit:
        """The fit of what is sure beside a class, and of these effects."""
        model, found = self.found()
        sure = [e.name for e in answer.effects if e.name not in answer.rivals or e.name in names]
        hypothesis = (*sure, *(name for name in names if name not in sure))
        if hypothesis == found.hypothesis:
            return found
        self.progress(f"fitting {', '.join(names)}")
        sizes = stated_sizes(self.out, answer, self.log_model, names)
        places: dict[str, float] = {}
        for name in names:
            free = model.effects[name]
            first = sizes.get(name) or [f.starts[0] if f.starts else f.neutral for f in free]
            places |= dict(zip((f.name for f in free), first, strict=True))
        near = theta_from(model, hypothesis, found)
        theta = np.array(
            [places.get(f.name, x) for f, x in zip(model.free(hypothesis), near, strict=True)]
        )
        return settled(model, fit(model, hypothesis, found.episodes, theta))[0]


def _with_effects_of(model: LogModel, answer: Answer, fitted: Fit) -> Answer:
    """The answer with another fit's effects and constants; nobody has asked its forecasts."""
    sizes = parameters(model, fitted, fitted.hypothesis)
    unknown = Forecast(share=math.nan, low=math.nan, high=math.nan)
    effects = [
        Effect(
            name=name,
            parameters={
                key.removeprefix(f"{name}."): size
                for key, size in sizes.items()
                if key.startswith(f"{name}.")
            },
            forecast=unknown,
        )
        for name in fitted.hypothesis
    ]
    return answer.model_copy(
        update={
            "effects": effects,
            "parameters": sizes,
            "constants": constants_of(fitted),
            "shifted": model.shifted_inputs(fitted),
        }
    )


def beside_answer(model: LogModel, base: Fit, out: Path) -> tuple[LogModel, Fit]:
    """A folder's answer about the same system and logs, as a fit; without one the base."""
    folder = OwnFolder(model, out)
    folder.require_own()
    known = read(out / "name.json", Answer, folder.key)
    if known is None or not known.effects:
        return model, base
    asked, found = folder.found()
    assert isinstance(asked, LogModel)
    return asked, found


def correction_told(out: Path) -> str:
    """Where the correction is, or why there is none."""
    path = out / CORRECTION
    if not path.is_file():
        return "Correction: none, as nothing was named. Constants stay as the system states them."
    what = (
        ""
        if "[[effect]]" in path.read_text()
        else " with the constants that nobody has measured, as fitted,"
    )
    return f"Correction: {path},{what} for `gap simulate` and System.corrected()"


def planned_in(out: Path, result: Result) -> Planned | None:
    """What a plan came to for the class of a result; None where none was made."""
    return read(out / PLAN, Planned, result.key) if result.verdict == "class" else None


def _key(model: LogModel) -> str:
    """A hash of program, rules, logs, all parameters, and the system.

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
    digest.update(repr([free.name for free in model.free(())]).encode())
    digest.update(repr(model.sealed()).encode())
    for log in model.logs:
        digest.update(log.name.encode())
        digest.update(log.driving.tobytes() + log.outputs.tobytes())
    for episode in range(model.episodes):
        for _, values in model.coordinates(episode).values():  # with what `start` sets
            digest.update(np.ascontiguousarray(values).tobytes())
    for values in system.probed().values():
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
