"""Flights of the virtual gantry for the gap's tests, flown once each, and what truly happened."""

import functools
from collections.abc import Callable

import numpy as np

from wakedeploy.domains.gantry import record
from wakedeploy.gap.flight import Flight, flight_from_log
from wakedeploy.rig import Effect, EffectParameter, Rig, default_rig
from wakedeploy.runlog import RunLog

RIG = default_rig()
QUIET = RIG.changed(
    disturbance={"turbulence_fraction": 0.0, "outlier_probability": 0.0, "clock_jitter_s": 0.0},
    range_sensor={"noise_m": 0.0},
)
SECONDS = 12.0


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
