"""One part of a case: its recordings read, its system asked, and what the answer is worth.

In: a `Case` and a part: the effect left "out" or "in", or left out in the "first" or "second" half
of every recording. Out: a row of plain numbers.
"""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real_systems.cases import Added, Case
from benchmarks.records import ROOT
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.columns import read_columns
from wakedeploy.domains.tables.reading import read_recordings
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.search.artefacts import Ranked
from wakedeploy.gap.search.comparison import Comparison, errors
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import Named
from wakedeploy.gap.search.repeatability import repeated
from wakedeploy.gap.search.results import answer_of
from wakedeploy.gap.search.weighing import unseen, weight_of
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.files import read_system
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.own_system import System

EXAMPLES = ROOT / "examples" / "systems"
PARTS = ("out", "in", "first", "second")
LEADING = 5  # effects of the first round that are kept, named or not


def answer(case: Case, part: str) -> dict[str, Any]:
    """The workflow's answer; UnusableInput where it refuses the recordings."""
    began_s = time.process_time()
    model = LogModel(system_of(case, part), recordings_of(case, part))
    base = fitted_base(model)
    naming = named(model, base)
    document = answer_of(naming)
    plain = document.as_json()
    kept = {key: plain[key] for key in ("verdict", "class", "effects", "unsettled")}
    searched_s = time.process_time()
    again = repeated(naming) if part == "out" else None
    return kept | {
        "repeated": None if again is None else again.model_dump(),
        "seconds_repeating": time.process_time() - searched_s,
        "threshold_nats": document.threshold_nats,
        "leading": [kept_of(ranked) for ranked in document.rounds[0].ranking[:LEADING]],
        "far_ahead": naming.is_far_ahead,
        "errors": _errors(model, base, naming),
        "samples": sum(log.outputs.shape[1] for log in model.logs),
        "rate_hz": model.system.rate_hz,
        "forecast_s": model.horizon * model.dt_s,
        "seconds": searched_s - began_s,
    }


def kept_of(ranked: Ranked) -> dict[str, Any]:
    """What an effect gains alone, and why it is not named."""
    kept = {"judged": None, "forecast": None} | ranked.model_dump(exclude_none=True)
    del kept["parameters"]
    return kept


def system_of(case: Case, part: str) -> System:
    """The example's system; with what is missing built in, where that is the part."""
    system = read_system(EXAMPLES / case.system)
    cls = type(system)
    if case.rate_hz is not None:
        cls = type(cls.__name__, (cls,), {"rate_hz": case.rate_hz})
    if part == "in" and case.added is not None:
        cls = fuller(cls, case.added)
    return checked(cls())


def fuller(cls: type[System], added: Added) -> type[System]:
    """The same system with further constants, states, friction, and terms of its rates."""

    def derivative(self: System, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        rates = dict(cls.derivative(self, state, inputs, c))  # type: ignore[attr-defined]
        return _sum(rates, added.terms(state, inputs, c))

    def derivative_under(
        self: System, state: Any, inputs: Any, c: Any, forces: Mapping[str, Any]
    ) -> Any:
        forces = _sum(forces, added.terms(state, inputs, c))
        return cls.derivative_under(self, state, inputs, c, forces)  # type: ignore[attr-defined]

    stated = {
        "constants": [*cls.constants, *added.constants],
        "states": {**cls.states, **added.states},
        "ports": [
            replace(port, friction=added.friction.get(port.name, port.friction))
            for port in cls.ports
        ],
    }
    if hasattr(cls, "derivative_under"):  # which its derivative calls, too
        return type(cls.__name__, (cls,), stated | {"derivative_under": derivative_under})
    return type(cls.__name__, (cls,), stated | {"derivative": derivative})


def _sum(values: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    return {**values, **{name: values.get(name, 0.0) + more[name] for name in more}}


def recordings_of(case: Case, part: str) -> list[Recording]:
    """The recordings of a part."""
    system = read_system(EXAMPLES / case.system)
    units = {i.name: i.unit for i in system.inputs} | {o.name: o.unit for o in system.outputs}
    columns = read_columns(EXAMPLES / case.columns)
    read = read_recordings([recordings_folder() / name for name in case.files], columns, units)
    return [_cut(case, recording, part) for recording in read.recordings]


def _cut(case: Case, recording: Recording, part: str) -> Recording:
    low, high = case.samples or (0, len(recording.time_s))
    high = min(high, len(recording.time_s))
    middle = (low + high) // 2
    low, high = {"first": (low, middle), "second": (middle, high)}.get(part, (low, high))
    columns = {name: values[low:high] for name, values in recording.columns.items()}
    return Recording(recording.name, recording.time_s[: high - low], columns)


def recordings_folder() -> Path:
    """Where recordings lie."""
    return Path(os.environ.get("WAKEDEPLOY_DATA") or ROOT.parent / "shared" / "data")


def _errors(model: LogModel, base: Fit, naming: Named) -> dict[str, dict[str, Any]]:
    """Forecast errors on sealed blocks: constants as stated, fitted, and with what was found.

    Where it was found far ahead, the fit is the better of the two ways of asking.
    """
    sealed: Sequence[int] = model.sealed()
    constant = np.array([f.name.startswith("constant.") for f in base.free])
    neutral = np.array([f.neutral for f in base.free])
    stated = replace(base, theta=np.where(constant, neutral, base.theta))
    before: tuple[Comparison, Fit] = model, base
    found = naming.model, naming.found
    if weight_of(unseen(*before), unseen(naming.model, naming.base)).share > 0.0:
        before = naming.model, naming.base
    asked: list[tuple[Comparison, Fit]] = [(model, stated), before, found]
    each = [errors(*fitted, sealed) for fitted in asked]
    return {
        name: {"stated": each[0][k], "fitted": each[1][k], "found": each[2][k], "unit": unit}
        for k, (name, unit) in enumerate(model.channels)
    }
