"""The steps of a user's system in a folder: what each leaves, and what the next one reads.

In: a `LogModel` and a folder. Out: find.json, name.json, correction.toml and domain.json, which
`gap.report.system_page` draws. What has run for the same system and logs is not repeated.
"""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import json_of, json_text, text_of, write_text_whole
from wakedeploy.gap.evidence.inference import Fit, slopes_at
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.search.rounds import (
    Named,
    fitted_base,
    found_document,
    named,
    named_document,
    shown_document,
)
from wakedeploy.gap.search.weighing import Weight
from wakedeploy.gap.systems.correction import correction_of, write_correction
from wakedeploy.gap.systems.logs import LogModel

CORRECTION = "correction.toml"
_UP_TO = {"find": 1, "name": 2, "add": 3, "show": 4, "close": 4}


class Folder:
    """Runs steps, each with those before it that have not run yet."""

    def __init__(self, model: LogModel, out: Path, progress: Progress = quiet) -> None:
        self.model, self.out, self.progress = model, out, progress
        self.key = _key(model)
        self.exported: list[str] = []  # sentences about further files that `add` wrote

    def run(self, step: str) -> dict[str, Any]:
        """The step and those that it needs; returns what all of them told."""
        last = _UP_TO[step]
        told = self._find()
        if last >= 2:
            told |= self._name()
        if last >= 3:
            self._add()
        if last >= 4:
            told |= self._show(told)
        return told

    def _find(self) -> dict[str, Any]:
        known = self._known("find.json")
        if known is not None:
            return known
        self.progress("fitting the system as it is")
        base = fitted_base(self.model)
        document = found_document(self.model, base) | {"theta": _theta(base), "key": self.key}
        self._write("find.json", document)
        return document

    def _name(self) -> dict[str, Any]:
        known = self._known("name.json")
        if known is not None:
            return known
        told = named(self.model, self._base(), self.progress)
        document = named_document(self.model, told)
        document |= {"found_theta": _theta(told.found), "key": self.key}
        self._write("name.json", document)
        return document

    def _add(self) -> None:
        write_correction(correction_of(self.model, self._found().found), self.out / CORRECTION)
        self.exported = self.model.system.export(self._name(), self.out)

    def _show(self, told: dict[str, Any]) -> dict[str, Any]:
        self.progress("forecasting the sealed blocks")
        document = told | shown_document(self.model, self._found())
        document["forecast_s"] = self.model.horizon * self.model.dt_s
        self._write("domain.json", document)
        return document

    def _base(self) -> Fit:
        """The base as `find` has left it."""
        document = self._find()
        return self._fit((), document["theta"])

    def _found(self) -> Named:
        document = self._name()
        names = tuple(str(e["name"]) for e in document["effects"])
        found = self._fit(names, document["found_theta"])
        weights = {str(e["name"]): Weight(**e["forecast"]) for e in document["effects"]}
        rounds, rivals = list(document["rounds"]), tuple(document["class"])
        return Named(self._base(), found, rounds, rivals, weights)

    def _fit(self, hypothesis: tuple[str, ...], values: dict[str, float]) -> Fit:
        sealed = self.model.sealed()
        used = [e for e in range(self.model.episodes) if e not in sealed]
        free = self.model.free(hypothesis)
        theta = np.array([values[f.name] for f in free])
        slopes = slopes_at(self.model, hypothesis, used, theta)
        density = np.array([s.log_density.sum() for s in slopes.scores])
        return Fit(hypothesis, free, tuple(used), theta, slopes, density)

    def _known(self, name: str) -> dict[str, Any] | None:
        """What a step has left, if it is of the same system and logs."""
        path = self.out / name
        if not path.exists():
            return None
        try:
            document = json_of(text_of(path))
        except (OSError, ValueError) as error:
            raise UnusableInput(
                f"{path} cannot be read; delete it to run the step anew."
            ) from error
        same = isinstance(document, dict) and document.get("key") == self.key
        return document if same else None

    def _write(self, name: str, document: dict[str, Any]) -> None:
        write_text_whole(self.out / name, json_text(document))


def _theta(fitted: Fit) -> dict[str, float]:
    return dict(zip(fitted.names, map(float, fitted.theta), strict=True))


def _key(model: LogModel) -> str:
    """A hash of the logs, and of what the system states and its functions compute."""
    digest = hashlib.sha256()
    system = model.system
    stated = (system.rate_hz, system.inputs, system.states, system.outputs, system.constants)
    digest.update(repr((system.name, stated, sorted(model.library))).encode())
    for log in model.logs:
        digest.update(log.name.encode())
        digest.update(log.inputs.tobytes() + log.outputs.tobytes())
    for values in system.probed().values():
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
