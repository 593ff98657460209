"""`calibrate spool`: how the sufferer's rotor lags behind its command, up and down.

Under altitude control the reference's acceleration changes sign twice a second, which steps the
thrust up and down about hover. The pulses as the board applied them, through the tabulated curve
and a lag, give the acceleration; integrated twice it has to meet the range samples. In windows of
two seconds height, speed and a constant acceleration are free, over all windows the thrust's scale
and the rail's Coulomb friction; what is left is the two lags. Assumed: latency, noise and the
curve's shape are calibrated. A delay that is wrong by 1 ms moves both lags by about 1 ms, and
friction that is not the rig file's moves them by some ms more: the spread contains 5 ms for both,
besides chance.
"""

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from runtime.calibration import Outcome, require
from runtime.calibration.session import Site
from runtime.measured_force import FINE_S, range_offset, thrust_after_spool
from runtime.reference import PLAN_RATE_HZ, TAKE_OFF_S, FlightPlan, ceiling_m, smooth_rise
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.physics.effects.chain import believed, unplaced_constants
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig.update import Calibrated

FloatArray = npt.NDArray[np.float64]

STEP_MPS2, HALF_PERIOD_TICKS, CYCLES = 2.5, 16, 24
SETTLE_S = 2.0
WINDOW_S = 2.0
_FEWEST_WINDOWS = 5
_LONGEST_S = 0.5
_MODEL_SD_S = 0.005  # what simulated rigs with other friction were off beyond chance
_STRAY_SD = 4.0
_MOST_UNSURE_S = 0.02
_MOST_OFF_M = 0.02
_SLOW_MPS = 0.02
_LEAST_STEPS = 0.12  # of the weight; the flight made for this has 0.3, a quiet hover 0.06


def record(site: Site, rig: Rig) -> RunLog:
    """Fly the steps."""
    return site.flown("spool", rig, stepping(rig))


def stepping(rig: Rig) -> FlightPlan:
    """Steps of acceleration about the middle of the travel, or below the limit, the source off."""
    half = HALF_PERIOD_TICKS
    signs = [1.0] * (half // 2) + ([-1.0] * half + [1.0] * half) * CYCLES + [-1.0] * (half // 2)
    speed_mps = np.cumsum(signs) * STEP_MPS2 / PLAN_RATE_HZ
    swing_m = np.cumsum(speed_mps) / PLAN_RATE_HZ
    before = round((TAKE_OFF_S + SETTLE_S) * PLAN_RATE_HZ)
    after = round((TAKE_OFF_S + 1.0) * PLAN_RATE_HZ)
    swing_m = np.concatenate([np.zeros(before), swing_m, np.full(after, swing_m[-1])])
    t_s = np.arange(len(swing_m)) / PLAN_RATE_HZ
    envelope = smooth_rise(t_s / TAKE_OFF_S) * smooth_rise((t_s[-1] - t_s) / TAKE_OFF_S)
    half_m = 0.5 * np.ptp(swing_m)
    middle_m = min(0.5 * rig.sufferer.travel_m, ceiling_m(rig) - half_m)
    z_m = (middle_m + swing_m - half_m) * envelope
    return FlightPlan(z_m, np.zeros_like(t_s), np.full_like(t_s, rig.limits.pulse_us[0]))


def estimate(log: RunLog, rig: Rig) -> Outcome:
    """Both lags from one log."""
    fit = _Fit(log, rig)
    start = believed(rig).spool.sufferer
    guess = np.clip([start.up_s, start.down_s], 0.02, 0.4)
    found = least_squares(
        fit.residuals, guess, bounds=(0.0, _LONGEST_S), diff_step=0.02, x_scale=0.05
    )
    noise_m = float(np.sqrt(np.mean(found.fun**2)))
    require(
        noise_m < _MOST_OFF_M,
        f"The best lags still miss the motion by {1e3 * noise_m:.0f} mm: calibrate noise, latency "
        "and thrust first, and check the rail.",
    )
    up_s, down_s = (float(v) for v in found.x)
    least_s, most_s = 0.002, 0.98 * _LONGEST_S
    require(
        least_s < up_s < most_s and least_s < down_s < most_s,
        f"Lags of {up_s:.3f} s up and {down_s:.3f} s down are not plausible for a motor: check the "
        "latency and that the sufferer flew.",
    )
    spread_s = np.hypot(fit.spreads(found.jac, found.fun), _MODEL_SD_S)
    require(
        float(np.max(spread_s)) < _MOST_UNSURE_S,
        f"The lags are only known to {1e3 * float(np.max(spread_s)):.0f} ms: calibrate noise and "
        "thrust first, and check the rail.",
    )
    constants = {
        "spool.sufferer.up_s": Calibrated(up_s, float(spread_s[0]), "s"),
        "spool.sufferer.down_s": Calibrated(down_s, float(spread_s[1]), "s"),
    }
    sentence = f"The motion is met within {1e3 * noise_m:.1f} mm over {fit.windows} windows."
    return Outcome(constants, (sentence,))


class _Fit:
    """The range samples of a log against the motion that lags give."""

    def __init__(self, log: RunLog, rig: Rig) -> None:
        self._log, self._rig = log, believed(rig)
        flown_s = log["t_s"][log.flying]
        begin_s = (flown_s[0] if len(flown_s) else 0.0) + TAKE_OFF_S + 1.0
        end_s = (flown_s[-1] if len(flown_s) else 0.0) - TAKE_OFF_S - 0.5
        self.windows = int((end_s - begin_s) // WINDOW_S)
        require(
            self.windows >= _FEWEST_WINDOWS,
            f"The flight has {max(self.windows, 0)} windows of {WINDOW_S:g} s in the air, "
            f"{_FEWEST_WINDOWS} are needed: fly it again.",
        )
        self._require_steps(begin_s, end_s)
        known = unplaced_constants(rig)
        sample_s = log["t_s"] - log["range_age_s"] - known["range.delay_s"]
        stray = log["innovation_m"] ** 2 > _STRAY_SD**2 * log["innovation_var_m2"]
        good = ~(log["range_repeats"] > 0) & np.isfinite(log["range_m"]) & ~stray
        good &= (sample_s > begin_s) & (sample_s < begin_s + self.windows * WINDOW_S)
        self._sample_s = sample_s[good]
        self._z_m = (log["range_m"][good] - range_offset(log, rig)) / known["range.scale"]
        self._window = ((self._sample_s - begin_s) // WINDOW_S).astype(int)
        per_window = np.bincount(self._window, minlength=self.windows)
        require(
            int(per_window.min()) >= PLAN_RATE_HZ,
            "The range sensor missed too much of the flight: check that it sees the reflector.",
        )
        self._fine_s = np.arange(begin_s - 1.0, end_s + FINE_S, FINE_S)
        speed_mps = np.interp(self._fine_s, log["t_s"], log["vz_est_mps"])
        mass_kg = self._rig.sufferer.mass_kg
        self._friction_m = self._travelled(-np.tanh(speed_mps / _SLOW_MPS) / mass_kg)
        viscous_n = -self._rig.rail.viscous_n_per_mps * speed_mps
        self._viscous_m = self._travelled(viscous_n / mass_kg)

    def _require_steps(self, begin_s: float, end_s: float) -> None:
        t_s, curve = self._log["t_s"], self._rig.thrust.sufferer
        commanded_us = self._log["sufferer_cmd_us"][(t_s > begin_s) & (t_s < end_s)]
        stepped_n = float(np.std(curve.thrusts(commanded_us)))
        require(
            stepped_n > _LEAST_STEPS * self._rig.sufferer.mass_kg * GRAVITY_MPS2,
            f"The thrust varied by {stepped_n:.2f} N only: it has to step for its lag to show.",
        )

    def residuals(self, lags_s: FloatArray) -> FloatArray:
        """What no free motion explains of the samples [m], (n,)."""
        spool = {"sufferer": {"up_s": float(lags_s[0]), "down_s": float(lags_s[1])}}
        thrust_n = thrust_after_spool(self._log, self._rig.changed(spool=spool), self._fine_s)
        weight_n = self._rig.sufferer.mass_kg * GRAVITY_MPS2
        pushed_m = self._travelled((thrust_n - weight_n) / self._rig.sufferer.mass_kg)
        off_m = self._free(self._z_m - pushed_m - self._viscous_m)
        known = np.stack([self._free(pushed_m), self._free(self._friction_m)], axis=1)
        amounts, *_ = np.linalg.lstsq(known, off_m, rcond=None)
        return np.asarray(off_m - known @ amounts)

    def spreads(self, jacobian: FloatArray, residuals: FloatArray) -> FloatArray:
        """Standard errors, (2,): from the curvature or the windows' scatter, what is larger."""
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        scores = np.stack(
            [
                jacobian[self._window == w].T @ residuals[self._window == w]
                for w in range(self.windows)
            ]
        )
        freedom = len(residuals) - 3 * self.windows - 4
        plain = np.diag(inverse) * np.sum(residuals**2) / freedom
        return np.sqrt(np.maximum(plain, np.diag(inverse @ scores.T @ scores @ inverse)))

    def _travelled(self, mps2: FloatArray) -> FloatArray:
        """The way [m] that an acceleration on the fine grid gives, at the samples."""
        speed = np.cumsum(mps2) * FINE_S
        return np.interp(self._sample_s, self._fine_s + FINE_S, np.cumsum(speed) * FINE_S)

    def _free(self, values: FloatArray) -> FloatArray:
        """The values without what height, speed and acceleration explain in each window."""
        residuals = np.array(values)
        for window in range(self.windows):
            here = self._window == window
            t_s = self._sample_s[here] - self._sample_s[here].mean()
            motion = np.stack([np.ones_like(t_s), t_s, t_s**2], axis=1)
            amounts, *_ = np.linalg.lstsq(motion, values[here], rcond=None)
            residuals[here] = values[here] - motion @ amounts
        return residuals
