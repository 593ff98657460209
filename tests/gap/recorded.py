"""Flights of the virtual gantry for the gap's tests, flown once each, and what truly happened."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from wakedeploy.core.rig import Effect, EffectParameter, Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.systems.gantry.flight import Flight, flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.naming import fitted_base, with_terms
from wakedeploy.rig.file import default_rig, read_rig

RIG = default_rig()
QUIET = RIG.changed(
    disturbance={"turbulence_fraction": 0.0, "outlier_probability": 0.0, "clock_jitter_s": 0.0},
    range_sensor={"noise_m": 0.0},
)
SECONDS = 9.0  # where a test needs no more; fits take as much longer as flights are


class Probe:
    """A force hook that pushes with nothing and writes down every inner step."""

    def __init__(self) -> None:
        self._rows: list[dict[str, float]] = []

    def __call__(self, t_s, state) -> float:
        self._rows.append({"t_s": t_s, **state})
        return 0.0

    def __getitem__(self, name: str) -> np.ndarray:
        return np.array([row[name] for row in self._rows])


@functools.cache
def probed(rig: Rig = QUIET, seed: int = 31) -> tuple[RunLog, Probe]:
    """The log of a flight, and the true motion and thrusts at every inner step."""
    probe = Probe()
    return record(rig, seconds=SECONDS, seed=seed, force_hook=probe), probe


_FLOWN: dict[tuple, Flight] = {}


def flown(
    seed: int, truth: Rig = RIG, hook: Callable | None = None, seconds: float = SECONDS
) -> Flight:
    """A flight of some truth as the workflow sees it, with the default rig file."""
    key = seed, truth.sha256, hook, seconds
    if key not in _FLOWN:
        log = record(truth, seconds=seconds, seed=seed, force_hook=hook, model_rig=RIG)
        _FLOWN[key] = flight_from_log(log.without_truth(), RIG, f"flight {seed}")
    return _FLOWN[key]


@functools.cache
def based(*seeds: int) -> tuple[GantryModel, Fit]:
    """Flights of the rig as its file describes it, and the base hypothesis fitted to them."""
    return fitted_base(with_terms(GantryModel(RIG, [flown(seed) for seed in seeds])))


def with_effects(**effects: dict[str, tuple[float, str]]) -> Rig:
    """The default rig with effects, as `ground_effect={"gain": (0.3, "1"), …}`."""
    entries = tuple(
        Effect(
            name=name.replace("_", "-"),
            parameters={p: EffectParameter(value=v, unit=u) for p, (v, u) in values.items()},
        )
        for name, values in effects.items()
    )
    return RIG.model_copy(update={"effect": entries})


def changed(log: RunLog, **columns: np.ndarray) -> RunLog:
    """A copy of a log with other columns."""
    return RunLog({**log.columns, **columns}, dict(log.metadata))


def as_it_stands(path: Path) -> Rig:
    """A rig file whose effects have exactly the sizes that it states."""
    rig = read_rig(path)
    exact = [
        one.model_copy(
            update={
                "parameters": {
                    name: p.model_copy(update={"low": p.value, "high": p.value})
                    for name, p in one.parameters.items()
                }
            }
        )
        for one in rig.effect
    ]
    return rig.model_copy(update={"effect": tuple(exact)})


def judged(
    rig: Rig, flights: Sequence[Flight], sealed: Sequence[Flight], horizon_s: float = 0.25
) -> tuple[Fit, float]:
    """A rig file as it is, fitted to flights, and its error ahead on the first sealed one [m]."""
    _, fitted = fitted_base(GantryModel(rig, flights))
    ahead = GantryModel(rig, sealed).around_own_motion(fitted).forecasts(fitted, 0, (horizon_s,))
    error_m = np.abs(ahead.measured_m[0] - ahead.forecast_m[0])
    kept = error_m < 9.0 * np.nanmedian(error_m)  # strays left out
    return fitted, float(np.sqrt(np.mean(error_m[kept] ** 2)))
