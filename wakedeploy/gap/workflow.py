"""Find, name, add, show: the order of the steps, for every system.

In: the `Steps` of a system, or a `Comparison` to search. Out: what the last step found. The gantry,
users' systems and recorded domains differ in what a step does, not in what follows what.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.ascent import slopes_at
from wakedeploy.gap.evidence.fits import Fit, densities
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.search.artefacts import (
    Answer,
    Disagreements,
    Result,
    joined,
    object_of,
    read,
)
from wakedeploy.gap.search.comparison import Comparison, asked_far_ahead
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.repeatability import repeated
from wakedeploy.gap.search.results import answer_of, before_after, found_in

STEPS = ("find", "name", "add", "show")

Told = TypeVar("Told", covariant=True)


class Steps(Protocol[Told]):
    """The four steps of a system; each takes what the one before it has left."""

    def find(self) -> Told:
        """Where simulation and measurement disagree."""
        ...

    def name(self) -> Told:
        """Which effect explains it."""
        ...

    def add(self) -> Told:
        """The effect is given to the simulation."""
        ...

    def show(self) -> Told:
        """The gap before and after, on what nothing was fitted to."""
        ...


def run(steps: Steps[Told], last: str) -> Told:
    """Run the steps up to `last` and return what that one found. "close" is all of them."""
    artefact = steps.find()
    for step in (steps.name, steps.add, steps.show)[: STEPS.index(_LAST.get(last, last))]:
        artefact = step()
    return artefact


_LAST = {"close": "show"}


def concluded(model: Comparison, progress: Progress = quiet) -> Result:
    """All that a search finds in a system that nothing can be added to, without files."""
    progress("fitting the baseline")
    base = fitted_base(model)
    found = found_in(model, base)
    outcome = named(model, base, progress)
    near = (model, base) if outcome.is_far_ahead else None
    shown = before_after(outcome.model, outcome.base, outcome.found, near=near)
    return joined(found, answer_of(outcome, again=repeated(outcome, progress)), shown)


_ANEW = "delete it to run the step anew"


def require_own(out: Path, name: str) -> None:
    """UnusableInput where a folder holds steps of another system than the one of this name."""
    for path in (out / each for each in ("find.json", "name.json", "domain.json")):
        of = object_of(path, _ANEW).get("domain") if path.exists() else None
        if isinstance(of, str) and of != name:
            raise UnusableInput(
                f"{out}: holds what was found about {of}, and this is {name}; give another --out."
            )


class Folder:
    """What the steps of a `Comparison` leave in a folder.

    What has run under the same `key` is not repeated. `forecast_s` is how far ahead errors are of.
    `later` are the files of the steps after `find`.
    """

    later: tuple[str, ...] = ("name.json", "domain.json", "report.html")

    def __init__(
        self, model: Comparison, out: Path, key: str, forecast_s: float, progress: Progress = quiet
    ) -> None:
        self.model, self.out, self.key, self.progress = model, out, key, progress
        self.forecast_s = forecast_s

    def find(self) -> Disagreements:
        """Where system and recordings disagree: find.json."""
        path = self.out / "find.json"
        known = read(path, Disagreements, self.key)
        if known is not None:
            return known
        self.require_own()
        self.progress("fitting the system as it is")
        found = found_in(self.model, fitted_base(self.model), self.key)
        found.write(path)
        self._remove_stale()
        return found

    @property
    def is_found(self) -> bool:
        """Whether `find` has run for the same."""
        return read(self.out / "find.json", Disagreements, self.key) is not None

    def require_own(self) -> None:
        """UnusableInput where the folder holds steps of another system."""
        require_own(self.out, self.model.name)

    def _remove_stale(self) -> None:
        """Remove what later steps left of an earlier form of the system, or of other logs of it."""
        named = self.out / "name.json"
        if named.exists() and object_of(named, _ANEW).get("key") == self.key:
            return
        stale = [name for name in self.later if (self.out / name).exists()]
        for name in stale:
            (self.out / name).unlink()
        if stale:
            self.progress(f"removed, as it was of other logs or another form: {', '.join(stale)}")

    def name(self) -> Answer:
        """Which effects the system lacks, and whether each half of the logs says so: name.json."""
        path = self.out / "name.json"
        known = read(path, Answer, self.key)
        if known is not None:
            return known
        outcome = named(self.model, self.base(), self.progress)
        answer = answer_of(outcome, self.key, repeated(outcome, self.progress))
        answer.write(path)
        return answer

    def show(self) -> Result:
        """The gap before and after, with all that was found before it: domain.json."""
        self.progress("forecasting what was sealed")
        model, found = self.found()
        base = self._fit(model, "name.json", (), self.name().base_theta)
        near = None if model is self.model else (self.model, self.base())
        shown = before_after(model, base, found, self.key, self.forecast_s, near)
        result = joined(self.find(), self.name(), shown)
        result.write(self.out / "domain.json")
        return result

    def base(self) -> Fit:
        """The system as it is, fitted by `find`."""
        return self._fit(self.model, "find.json", (), self.find().theta)

    def found(self) -> tuple[Comparison, Fit]:
        """The system as `name` asked it, and its fit with what was found."""
        answer = self.name()
        view = asked_far_ahead(self.model) if answer.is_far_ahead else None
        model = self.model if view is None else view
        effects = [e.name for e in answer.effects]
        return model, self._fit(model, "name.json", effects, answer.found_theta)

    def _fit(
        self, model: Comparison, file: str, effects: Sequence[str], values: Mapping[str, float]
    ) -> Fit:
        """The fit whose parameters a file has; UnusableInput where it has not all of them."""
        sealed = model.sealed()
        used = [e for e in range(model.episodes) if e not in sealed]
        known = set(effects) <= set(model.effects)
        hypothesis = tuple(effects) if known else ()
        free = model.free(hypothesis)
        if not known or any(not math.isfinite(values.get(f.name, math.nan)) for f in free):
            raise UnusableInput(
                f"{self.out / file}: not the parameters of its fit; delete it to run the step anew."
            )
        theta = np.array([values[f.name] for f in free])
        slopes = slopes_at(model, hypothesis, used, theta)
        return Fit(hypothesis, free, tuple(used), theta, slopes, densities(slopes.scores))
