"""Motor recordings: a baseline whose speed follows the command at once, and what it may lack.

In: logs of duty steps (`wakedeploy.domains.motor`). Each step is an episode; its two levels are
unknown, with a prior around a straight curve from duty to speed.
"""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import curve_fit

from wakedeploy.domains.motor import Step, read_steps
from wakedeploy.gap.evidence.fits import FloatArray, Free
from wakedeploy.gap.progress import Progress
from wakedeploy.gap.search.comparison import Record
from wakedeploy.gap.systems.domains.domain import GapDomain
from wakedeploy.gap.systems.likelihood.response import ResponseModel, Values, required

_SHOWN_S = 0.25  # how long after a step the models differ
# Records arrive in bursts, with the time of arrival: a step lies up to one burst before its record.
_BURST_S = 1.0 / 60.0
_JITTER_S = _BURST_S / 12.0**0.5  # standard deviation of a uniform distribution
_BLUR_S = 0.002  # of the command itself, which keeps the likelihood smooth in delays

EFFECTS = {
    "spool-lag": (
        Free("spool-lag.tau_up_s", "s", 0.0, 0.1, 0.0, 1.0, 5e-4, (0.03, 0.1)),
        Free("spool-lag.tau_down_s", "s", 0.0, 0.1, 0.0, 1.0, 5e-4, (0.03, 0.1)),
    ),
    "command-latency": (
        Free("command-latency.delay_s", "s", 0.0, 0.05, 0.0, 0.3, 1e-3, (0.002, 0.02, 0.05)),
    ),
    "double-lag": (Free("double-lag.tau_s", "s", 0.0, 0.1, 0.0, 1.0, 5e-4, (0.004, 0.015, 0.05)),),
    "slew-limit": (
        Free("slew-limit.s_per_krpm", "s/krpm", 0.0, 0.1, 0.0, 1.0, 5e-4, (0.004, 0.03, 0.1)),
    ),
    "overshoot": (Free("overshoot.share", "1", 0.0, 0.3, -1.0, 1.0, 1e-3, (0.1,)),),
    "battery-sag": (Free("battery-sag.exponent", "1", 0.0, 1.0, -3.0, 3.0, 1e-2, (0.5,)),),
    "warming": (Free("warming.per_s", "1/s", 0.0, 0.02, -0.2, 0.2, 1e-4, (0.01,)),),
}
_OVERSHOOT_S = 0.1  # after which an overshoot has died out by a factor e


class MotorModel(ResponseModel):
    """Speed [rpm] after steps of the duty."""

    name = "motor"
    channels = (("motor speed", "rpm"),)
    noise_start = ((60.0, 0.05, 30.0),)
    effects = EFFECTS

    def __init__(self, steps: tuple[Step, ...]) -> None:
        self.steps = steps
        self.records = [Record(s.name, s.time_s, s.rpm[None, :]) for s in steps]

    @property
    def horizon(self) -> int:
        """A few samples: errors are those of a quarter of a second."""
        return 2

    def nuisances(self) -> tuple[Free, ...]:
        """A straight curve from duty to speed, how far levels lie from it, and the log's clock."""
        return (
            Free("clock.offset_s", "s", -_BURST_S / 2, _JITTER_S, -_BURST_S, 0.0, 5e-4),
            Free("curve.offset", "rpm", 2500.0, 2000.0, -2e4, 2e4, 10.0),
            Free("curve.slope", "rpm/%", 150.0, 100.0, 0.0, 1e3, 0.5),
            Free("curve.spread", "ln(rpm)", 7.0, 1.0, 3.0, 10.0, 0.01),
        )

    def response(self, values: Values, episode: int) -> FloatArray:
        """Speed (1, n) if the straight curve were exact."""
        step = self.steps[episode]
        low, high = (
            values["curve.offset"] + values["curve.slope"] * duty
            for duty in (step.before, step.after)
        )
        speed = low + (high - low) * self.course(values, episode)
        return np.asarray(speed * self._drift(values, episode))[None]

    def levels(self, values: Values, episode: int) -> FloatArray:
        """The level before, the level after, and when exactly the step came, (n, 3)."""
        step = self.steps[episode]
        course = self.course(values, episode)
        spread = np.exp(values["curve.spread"])
        rise = values["curve.slope"] * (step.after - step.before)
        later, sooner = (self.course(values, episode, by) for by in (_JITTER_S, -_JITTER_S))
        return np.stack(
            [spread * (1.0 - course), spread * course, 0.5 * rise * (later - sooner)], axis=1
        )

    def residual(self, values: Values, episode: int) -> FloatArray:
        """Against a course between the levels that were measured, for a quarter of a second."""
        since_s = self.steps[episode].time_s - self.steps[episode].step_s
        shown = (since_s >= 0) & (since_s < _SHOWN_S)
        return np.asarray(self.disagreement(values, episode)[:, shown])

    def disagreement(self, values: Values, episode: int) -> FloatArray:
        """Measured less a course between the levels that were measured (1, n)."""
        step = self.steps[episode]
        since_s = step.time_s - step.step_s
        low = np.median(step.rpm[since_s < 0])
        high = np.median(step.rpm[since_s > 0.5 * since_s[-1]])
        drift = self._drift(values, episode)
        predicted = (low + (high - low) * self.course(values, episode)) * drift / drift.mean()
        return np.asarray(step.rpm - predicted)[None]

    def coordinates(self, episode: int) -> dict[str, tuple[str, FloatArray]]:
        """Time since a step up or down, the step's size, and the duty after it."""
        step = self.steps[episode]
        same = np.ones(len(step.time_s))
        since_s = step.time_s - step.step_s
        rising = step.after > step.before
        return {
            "time since step up": ("s", np.where(rising, since_s, np.nan)),
            "time since step down": ("s", np.where(rising, np.nan, since_s)),
            "size of step": ("%", same * (step.after - step.before)),
            "duty": ("%", same * step.after),
        }

    def course(self, values: Values, episode: int, late_s: float = 0.0) -> FloatArray:
        """How much of the step has happened, (n,), 0 before it and 1 long after."""
        step = self.steps[episode]
        late_s += values["clock.offset_s"] + values.get("command-latency.delay_s", 0.0)
        since_s = step.time_s - step.step_s - late_s
        reached = 0.5 + 0.5 * np.tanh(since_s / _BLUR_S)
        since_s = np.maximum(since_s, 0.0)
        rising = step.after > step.before
        tau_s = values.get(f"spool-lag.tau_{'up' if rising else 'down'}_s", 0.0)
        lag = _decay(since_s, tau_s)
        double_s = values.get("double-lag.tau_s", 0.0)
        lag = _joined(lag, (1.0 + since_s / max(double_s, 1e-6)) * _decay(since_s, double_s))
        lag = _joined(lag, self._ramp(values, episode, since_s))
        excess = values.get("overshoot.share", 0.0) * np.exp(-since_s / _OVERSHOOT_S)
        return np.asarray(reached * (1.0 - lag + excess))

    def _ramp(self, values: Values, episode: int, since_s: FloatArray) -> FloatArray:
        step = self.steps[episode]
        krpm = abs(step.after - step.before) * values["curve.slope"] * 1e-3
        whole_s = values.get("slew-limit.s_per_krpm", 0.0) * krpm
        return np.clip(1.0 - since_s / max(whole_s, 1e-6), 0.0, 1.0)

    def _drift(self, values: Values, episode: int) -> FloatArray:
        step = self.steps[episode]
        sag = (step.battery_v / step.battery_v[0]) ** values.get("battery-sag.exponent", 0.0)
        warm = 1.0 + values.get("warming.per_s", 0.0) * (step.time_s - step.time_s[0])
        return np.asarray(sag * warm)


def further(model: MotorModel, progress: Progress) -> dict[str, Any]:
    """An exponential fitted to each step alone, by least squares: an independent estimate."""
    progress("fitting single steps")
    steps = [step_response(s) for s in model.steps]
    rising = [s.after > s.before for s in model.steps]
    result: dict[str, Any] = {}
    for name, wanted in (("up", True), ("down", False)):
        taus = [t for t, up in zip(steps, rising, strict=True) if up == wanted]
        result[name] = {"steps": len(taus), "median_s": float(np.median(taus)) if taus else None}
    return {"single_steps": result | {"tau_s": dict(zip(_names(model), steps, strict=True))}}


def step_response(step: Step) -> float:
    """Time constant [s] of one step, its beginning free within a burst."""
    since_s = step.time_s - step.step_s
    low = float(np.median(step.rpm[since_s < 0]))
    high = float(np.median(step.rpm[since_s > 0.5 * since_s[-1]]))
    after = since_s >= 0

    def course(at_s: FloatArray, tau_s: float, start_s: float) -> FloatArray:
        return np.asarray(high + (low - high) * _decay(np.maximum(at_s - start_s, 0.0), tau_s))

    bounds = ([1e-3, -_BURST_S], [1.0, _BURST_S])
    found, _ = curve_fit(course, since_s[after], step.rpm[after], [0.03, 0.0], bounds=bounds)
    return float(found[0])


def _names(model: MotorModel) -> list[str]:
    return [s.name for s in model.steps]


def open_model(path: Path | None) -> MotorModel:
    """The model over the logs below `path`."""
    return MotorModel(read_steps(required(path, "motor")))


def _decay(since_s: FloatArray, tau_s: float) -> FloatArray:
    return np.asarray(np.exp(-since_s / max(tau_s, 1e-6)))


def _joined(lag: FloatArray, other: FloatArray) -> FloatArray:
    """What is still to go of two lags that act together."""
    return np.asarray(1.0 - (1.0 - lag) * (1.0 - other))


GAP_DOMAIN = GapDomain(open_model, further)
