"""The likelihood behind the watch: a Kalman filter over height, turbulence and calibration.

In: one row of the run log per tick. Out: the whitened innovation of its range sample, or None if
none can be judged. The calibrated constants are states with the spreads of the rig file as their
prior, so that a calibration error of that size is learnt instead of being taken for physics.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from runtime.loop.watch_forecast import STEP_S, ForceForecast, Forces, Model, Place
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.core.rig_sections import Rail
from wakedeploy.core.runlog_columns import FLYING, STAGES, Value
from wakedeploy.physics.constants import spreads_of
from wakedeploy.physics.rail import GRAVITY_MPS2, smooth_friction, smooth_friction_slope

FloatArray = npt.NDArray[np.float64]

_UNTIL_SENT = STAGES[1:]  # after the reading, whose time the tick has
_Z, _V, _GUST, _BIAS = 0, 1, 2, 3
_FIRST = 4  # where the states of the forces' constants begin
_ACCELERATION_DENSITY = 0.05  # m/s² per √Hz: what friction near rest and held inputs leave open
_GATE_SD = 5.0
_PERSISTENT = 4  # this many samples in a row are no outliers
_CLEAR_M = 0.05  # above the stop, whose contact is not modelled
_SETTLE_S = 0.5  # in the air before a sample counts
_LONGEST_GAP_S = 0.25
_CATCH_UP_S = 1.0


@dataclass(frozen=True, slots=True)
class Seen:
    """One judged sample: its innovation over its standard deviation, and when it was taken."""

    sample_s: float
    whitened: float


class WatchFilter:
    """Advances in steps of 1/64 s up to each new range sample, and takes it in."""

    def __init__(self, rig: Rig) -> None:
        self._rig, model = Model.of(rig)
        self._model = model
        spreads = spreads_of(self._rig)
        self._forecast = ForceForecast(self._rig, model, spreads)
        self._hold_s = model.constants["range.hold_s"]
        self._last_range_m, self._last_stamp_s = math.nan, -math.inf
        self._range_delay_s = spreads.get("range.delay_s", 0.0)
        self._bias_m = spreads.get("range.bias_m", 0.0)
        rail = [n for n in ("rail.coulomb_n", "rail.viscous_n_per_mps") if n in spreads]
        self._rail = [Rail(**{name.removeprefix("rail."): spreads[name]}) for name in rail]
        self.names = ("range.bias_m", "range.delay_s", *rail, *self._forecast.names)
        sensor, gust = rig.range_sensor, rig.disturbance
        self._range_var = max(sensor.noise_m**2 + sensor.resolution_m**2 / 12.0, 1e-8)
        self._keep = math.exp(-STEP_S / gust.turbulence_time_s)
        self._gust_share = gust.turbulence_fraction
        self._weight_n = rig.sufferer.mass_kg * GRAVITY_MPS2
        size = 3 + len(self.names)
        self._state = np.zeros(size)
        self._cov = np.eye(size)
        self._step_matrix = np.eye(size)
        self._now_s: float | None = None
        self._acceleration = 0.0
        self._rejected = 0
        self._airborne_s = 0.0
        self._last_sample_s = -math.inf
        self._x = (0.0, 0.0, 0.0)  # when, where, how fast
        self._pin()

    def step(self, row: Mapping[str, Value]) -> Seen | None:
        """Take in one tick; return its sample if it can be judged."""
        t_s = _number(row, "t_s")
        self._take_commands(row, t_s)
        self._x = (t_s, _number(row, "x_m", 0.0), _number(row, "vx_mps", 0.0))
        range_m, age_s = _number(row, "range_m"), _number(row, "range_age_s")
        is_new = _number(row, "range_repeats", 0.0) == 0.0 and math.isfinite(range_m + age_s)
        is_new = is_new and not (self._hold_s > 0.0 and range_m == self._last_range_m)
        sample_s = t_s - age_s if math.isfinite(age_s) else t_s
        # A sensor that repeats itself may have made a new reading any time since its last sample.
        within_s = min(self._hold_s, max(sample_s - self._last_stamp_s, 0.0))
        self._last_stamp_s = max(sample_s, self._last_stamp_s)
        if self._now_s is None:
            self._now_s = sample_s
        if not is_new or sample_s <= self._last_sample_s:
            return None
        if sample_s - self._last_sample_s > _LONGEST_GAP_S + self._hold_s:
            self._was_blind(sample_s)
        self._last_sample_s, self._last_range_m = sample_s, range_m
        self._advance_to(sample_s)
        seen = self._update(range_m, sample_s, within_s)
        flying = row.get("mode") in FLYING and self._airborne_s > _SETTLE_S
        return seen if flying and self._state[_Z] > _CLEAR_M else None

    @property
    def readings_hz(self) -> float:
        """How often there is a reading that is not the last one again."""
        return min(LOOP_RATE_HZ, 1.0 / self._hold_s) if self._hold_s > 0.0 else LOOP_RATE_HZ

    def departures(self) -> FloatArray:
        """How far the data have moved each constant, over how far its prior lets them, (P,).

        In standard deviations; a constant that the data say nothing about is at zero.
        """
        moved, remaining_var = self._state[_BIAS:], np.diag(self._cov)[_BIAS:]
        learned_var = np.maximum(1.0 - remaining_var, 0.05)
        return np.asarray(moved / np.sqrt(learned_var))

    def _was_blind(self, sample_s: float) -> None:
        """Find height and speed again; of a long gap only the end is caught up."""
        assert self._now_s is not None
        self._now_s = max(self._now_s, sample_s - _CATCH_UP_S)
        self._airborne_s = 0.0
        self._cov[_Z, _Z] += 1.0
        self._cov[_V, _V] += 1.0

    def _take_commands(self, row: Mapping[str, Value], t_s: float) -> None:
        computing_s = sum(_number(row, name, 0.0) for name in _UNTIL_SENT)
        source_us, sufferer_us = _number(row, "source_cmd_us"), _number(row, "sufferer_cmd_us")
        if math.isfinite(source_us + sufferer_us):
            self._forecast.sent(t_s + computing_s, source_us, sufferer_us)
        applied_s = _number(row, "applied_time_s")
        if math.isfinite(applied_s):
            self._forecast.frame_seen(applied_s)

    def _advance_to(self, sample_s: float) -> None:
        assert self._now_s is not None
        while self._now_s + STEP_S <= sample_s:
            when_s, x_m, vx_mps = self._x
            here_m = x_m + vx_mps * (self._now_s + STEP_S - when_s)
            z_m, vz_mps = self._state[:2].tolist()
            place = Place(here_m, vx_mps, z_m, vz_mps)
            forces = self._forecast.advance(self._now_s, place)
            self._predict(forces)
            self._now_s += STEP_S

    def _predict(self, forces: Forces) -> None:
        driving_n = forces.thrust_n + forces.wake_n + forces.other_n - self._weight_n
        if self._state[_Z] < 0.02 and self._state[_V] < 0.05 and driving_n < 0.0:
            self._pin()
            return
        self._airborne_s += STEP_S
        mass_kg, h = self._rig.sufferer.mass_kg + forces.added_kg, STEP_S
        v = float(self._state[_V])
        matrix = self._step_matrix
        of_rail = [-smooth_friction(spread, v) for spread in self._rail]
        slopes = np.concatenate(([0.0], of_rail, forces.change_n)) / mass_kg  # a delay: none
        matrix[_V, _V] = 1.0 - smooth_friction_slope(self._rig.rail, v) / mass_kg * h
        matrix[_V, _GUST] = h / mass_kg
        matrix[_V, _FIRST:] = h * slopes
        matrix[_Z, _V:] = 0.5 * h * matrix[_V, _V:]
        matrix[_Z, _V] += 0.5 * h
        matrix[_GUST, _GUST] = self._keep
        known = (driving_n - smooth_friction(self._rig.rail, v)) / mass_kg
        learnt = (matrix[_V, _GUST:] @ self._state[_GUST:]) / h
        self._acceleration = float(known + learnt)
        self._state[_Z] += v * h + 0.5 * h * h * self._acceleration
        self._state[_V] += h * self._acceleration
        self._state[_GUST] *= self._keep
        self._cov = matrix @ self._cov @ matrix.T
        self._add_noise(forces)
        self._stay_above_the_stop()

    def _add_noise(self, forces: Forces) -> None:
        h, density = STEP_S, _ACCELERATION_DENSITY**2
        self._cov[_Z, _Z] += density * h**3 / 3.0
        self._cov[_Z, _V] += density * h**2 / 2.0
        self._cov[_V, _Z] += density * h**2 / 2.0
        self._cov[_V, _V] += density * h
        self._cov[_GUST, _GUST] += (self._gust_share * forces.wake_n) ** 2 * (1.0 - self._keep**2)

    def _stay_above_the_stop(self) -> None:
        if self._state[_Z] < 0.0:
            self._state[_Z] = 0.0
            self._state[_V] = max(self._state[_V], 0.0)

    def _pin(self) -> None:
        """Put it at rest on the stop, whatever was believed of height, speed and gust."""
        self._state[:3] = 0.0
        self._cov[:3, :] = 0.0
        self._cov[:, :3] = 0.0
        self._cov[_Z, _Z], self._cov[_V, _V] = 0.002**2, 0.01**2
        self._airborne_s = self._acceleration = 0.0

    def _update(self, range_m: float, sample_s: float, within_s: float) -> Seen:
        assert self._now_s is not None
        known = self._model.constants
        ahead_s = sample_s - 0.5 * within_s - self._now_s - known["range.delay_s"]
        row = np.zeros(len(self._state))
        row[_Z], row[_V] = known["range.scale"], known["range.scale"] * ahead_s
        row[_BIAS], row[_BIAS + 1] = self._bias_m, -self._state[_V] * self._range_delay_s
        expected = float(row @ self._state) + 0.5 * ahead_s**2 * self._acceleration
        expected_m = self._forecast.range_m(expected + known["range.bias_m"])
        spread = self._cov @ row
        unknown_m = float(self._state[_V]) * within_s / math.sqrt(12.0)
        variance = float(row @ spread) + self._range_var + unknown_m**2
        whitened = (range_m - expected_m) / math.sqrt(variance)
        if abs(whitened) > _GATE_SD and self._rejected < _PERSISTENT:
            self._rejected += 1
            return Seen(sample_s, whitened)
        self._rejected = 0
        gain = spread / variance
        self._state = self._state + gain * (whitened * math.sqrt(variance))
        self._cov = self._cov - np.outer(gain, spread)
        return Seen(sample_s, whitened)


def _number(row: Mapping[str, Value], name: str, missing: float = math.nan) -> float:
    value = row.get(name)
    if value is None or value == "" or isinstance(value, str):
        return missing
    return float(value) if value == value else missing
