"""`calibrate thrust`: the sufferer's thrust curve, from hovering with known masses clipped on.

A fixed mass hovers at one thrust, so one flight gives one point. Three masses or more give the
scale and the exponent by which the rig file's curve is off: thrust = scale · hover · (tabulated
/ hover)^exponent. The source stays off. The sufferer moves slowly up and down, whole periods of a
sine: rail friction, which works against either way, and inertia average out of the mean thrust.
Standing still, stiction would hide 2 % of it. The mean is that of the tabulated thrust
after spool lag, from the pulses as applied. Thrust goes with the square of the battery's voltage.
Where the board measures it, each flight is corrected to the mean voltage of all, which the curve
then stands for, and voltages far apart are refused. Where it does not, a battery that sags from one
mass to the next bends the curve. So the first mass is flown again at the end, and a steady drift of
the thrust is fitted with scale and exponent; their spreads hold what it leaves open. The source's
curve cannot be had this way: it cannot hover, and is known as wake strength times thrust only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from runtime.calibration import Outcome, require
from runtime.calibration.session import Site, with_clip
from runtime.measured_force import FINE_S, thrust_after_spool
from runtime.reference import PLAN_RATE_HZ, TAKE_OFF_S, FlightPlan, ceiling_m, smooth_rise
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.physics.constants import moved_thrust, spreads_of
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig.update import Calibrated

FloatArray = npt.NDArray[np.float64]

PERIOD_S, PERIODS, SWING_M = 4.0, 5, 0.15
SETTLE_S = 3.0  # after take-off, for the integral to find the mass
_FEWEST = 3
_APART = 0.1  # of the weight: over less, scale and exponent cannot be told apart
_RESERVE = 1.15  # of the weight, for control
_LEAST_SCATTER = 0.002  # kitchen scales, and a voltage that is not quite constant
_MOST_SCATTER = 0.02
# Under a scale below 0.6 the flight ends as `thrust_lost`, above 1.6 height control overshoots.
_SCALES, _EXPONENTS = (0.6, 1.6), (0.6, 1.6)
_MOST_BEND_SD = 0.05  # of the exponent; more is worse than the tabulated shape
_MOST_SAG = 0.03  # of the voltage, twice that of the thrust
_SAGS = (
    "No voltage is measured, and a battery that sags bends the curve: fly the first mass again at "
    "the end, as in --mass-kg 0 --mass-kg 0.1 --mass-kg 0.2 --mass-kg 0, or wire the divider and "
    "say so by battery.has_divider."
)


def require_masses(clips_kg: Sequence[float], rig: Rig) -> None:
    """UnusableInput for masses that say too little or that the sufferer cannot carry."""
    weights_n = [(rig.sufferer.mass_kg + clip) * GRAVITY_MPS2 for clip in clips_kg]
    if len(set(clips_kg)) < _FEWEST or not max(weights_n) >= (1.0 + _APART) * min(weights_n):
        raise UnusableInput(
            f"Give {_FEWEST} different masses or more, the heaviest sufferer at least "
            f"{100 * _APART:.0f} % above the lightest: --mass-kg 0 --mass-kg 0.1 --mass-kg 0.2."
        )
    top_n = rig.thrust.sufferer.thrust_n[-1]
    if not (min(clips_kg) >= 0.0 and _RESERVE * max(weights_n) <= top_n):
        raise UnusableInput(
            f"--mass-kg is what is clipped onto the sufferer; with {max(clips_kg):g} kg it weighs "
            f"{max(weights_n):.2f} N, too close to the curve's {top_n:g} N."
        )
    if not (rig.battery.has_divider or _repeats_first(clips_kg)):
        raise UnusableInput(_SAGS)


def record(site: Site, rig: Rig, clip_kg: float, number: int) -> RunLog:
    """Fly with one mass; the loop knows of it."""
    carrying = with_clip(rig, clip_kg)
    return site.flown(f"thrust{number}", carrying, swinging(rig), clip_kg=clip_kg)


def swinging(rig: Rig) -> FlightPlan:
    """Slowly up and down about the middle of the travel, or below the limit, the source off."""
    lead_s = TAKE_OFF_S + SETTLE_S
    seconds = lead_s + PERIOD_S * PERIODS + 1.0 + TAKE_OFF_S
    t_s = np.arange(round(seconds * PLAN_RATE_HZ)) / PLAN_RATE_HZ
    envelope = smooth_rise(t_s / TAKE_OFF_S) * smooth_rise((seconds - t_s) / TAKE_OFF_S)
    begun = smooth_rise(t_s - lead_s + 1.0)
    swing_m = SWING_M * begun * np.sin(2.0 * np.pi * (t_s - lead_s) / PERIOD_S)
    middle_m = min(0.5 * rig.sufferer.travel_m, ceiling_m(rig) - SWING_M)
    z_m = (middle_m + swing_m) * envelope
    return FlightPlan(z_m, np.zeros_like(t_s), np.full_like(t_s, rig.limits.pulse_us[0]))


@dataclass(frozen=True)
class _Bend:
    """How the curve is off: the log of its scale, its exponent, and the drift over the series.

    `fitted` (2,) or, without voltages, (3,); `covariance` is that of unit scatter.
    """

    fitted: FloatArray
    covariance: FloatArray
    scatter: float

    @property
    def scale(self) -> float:
        """The factor on the thrust at hover."""
        return float(np.exp(self.fitted[0]))

    @property
    def exponent(self) -> float:
        """The exponent of the thrust over hover."""
        return float(self.fitted[1])

    @property
    def exponent_sd(self) -> float:
        """One standard deviation."""
        return self.scatter * float(np.sqrt(self.covariance[1, 1]))

    @property
    def at_hover_sd(self) -> float:
        """The spread of the thrust at hover, as a share; readers of the rig file apply it there."""
        along = np.zeros(len(self.fitted))
        along[:2] = 1.0, -self.fitted[0] / self.fitted[1]
        return self.scatter * float(np.sqrt(along @ self.covariance @ along))


def estimate(logs: Sequence[RunLog], clips_kg: Sequence[float], rig: Rig) -> Outcome:
    """The curve from one log per mass."""
    hover_n = rig.sufferer.mass_kg * GRAVITY_MPS2
    weight_n = np.array([(rig.sufferer.mass_kg + clip) * GRAVITY_MPS2 for clip in clips_kg])
    table_n = np.array([_mean_thrust(log, rig) for log in logs])
    volts = _voltages(logs) if rig.battery.has_divider else None  # an open pin reads anything
    require(volts is not None or _repeats_first(clips_kg), _SAGS)
    bend = _fitted(np.log(table_n / hover_n), np.log(weight_n / hover_n), volts)
    moved_n = moved_thrust(
        np.array(rig.thrust.sufferer.thrust_n), bend.scale, bend.exponent, hover_n
    )
    words = [""] * len(logs) if volts is None else [f" with {v:.2f} V" for v in volts]
    sentences = [
        f"{clip:g} kg clipped on: weighs {w:.3f} N, hovers at a tabulated {t:.3f} N{v}."
        for clip, w, t, v in zip(clips_kg, weight_n, table_n, words, strict=True)
    ]
    assumed = spreads_of(rig)["thrust.sufferer.exponent"]
    sentences += [
        f"Scale {bend.scale:.4f} at hover, exponent {bend.exponent:.3f} ± {bend.exponent_sd:.3f}.",
        f"From the first flight to the last the thrust changed by {100 * bend.fitted[2]:+.1f} %."
        if volts is None
        else f"The curve is that of {np.mean(volts):.2f} V.",
        f"The rig file has no place for the exponent's spread: gap goes on assuming {assumed:g}.",
    ]
    found = Calibrated(tuple(float(n) for n in moved_n), hover_n * bend.at_hover_sd, "N")
    return Outcome({"thrust.sufferer.thrust_n": found}, tuple(sentences))


def _fitted(log_table: FloatArray, log_weight: FloatArray, volts: FloatArray | None) -> _Bend:
    """Least squares over the flights (n,); CheckFailed for what cannot be right or says little."""
    columns = [np.ones_like(log_table), log_table]
    if volts is not None:
        log_weight = log_weight - 2.0 * np.log(volts / np.mean(volts))
    else:
        columns.append(np.linspace(-0.5, 0.5, len(log_table)))  # from the first flight to the last
    design = np.stack(columns, axis=1)
    covariance = np.linalg.inv(design.T @ design)
    fitted = covariance @ design.T @ log_weight
    off = log_weight - design @ fitted
    scatter = float(np.sqrt(np.sum(off**2) / (len(off) - len(fitted))))
    require(
        scatter < _MOST_SCATTER,
        f"The thrusts scatter by {100 * scatter:.1f} % about any such curve: check the masses and "
        "charge the battery.",
    )
    bend = _Bend(fitted, covariance, max(scatter, _LEAST_SCATTER))
    require(
        _SCALES[0] < bend.scale < _SCALES[1] and _EXPONENTS[0] < bend.exponent < _EXPONENTS[1],
        f"The curve would have to be scaled by {bend.scale:.2f} and bent by {bend.exponent:.2f}: "
        "check sufferer.mass_kg and the masses.",
    )
    require(
        bend.exponent_sd < _MOST_BEND_SD,
        f"The curve's exponent could be off by {bend.exponent_sd:.2f}, and at most "
        f"{_MOST_BEND_SD:g} is of use: fly masses further apart, with a charged battery.",
    )
    return bend


def _mean_thrust(log: RunLog, rig: Rig) -> float:
    """Mean tabulated thrust [N] over the whole periods of the swing."""
    flown_s = log["t_s"][log.flying]
    begin_s = (flown_s[0] if len(flown_s) else 0.0) + TAKE_OFF_S + SETTLE_S
    end_s = begin_s + PERIOD_S * PERIODS
    require(
        len(flown_s) > 0 and flown_s[-1] >= end_s,
        "A flight ended before its last swing was over: fly it again.",
    )
    swung = log.flying & (log["t_s"] >= begin_s) & (log["t_s"] < end_s)
    high_m, low_m = log["z_est_m"][swung].max(), log["z_est_m"][swung].min()
    require(
        bool(high_m - low_m > SWING_M),
        f"The sufferer moved by {1e3 * (high_m - low_m):.0f} mm instead of {2e3 * SWING_M:.0f}: "
        "free the rail, or lower the masses.",
    )
    idle_us = rig.limits.pulse_us[0]
    require(
        bool(np.all(log["source_cmd_us"][swung] <= idle_us + 1.0)),
        "The source ran during the flight, and its wake pushes the sufferer: keep it off.",
    )
    fine_s = np.arange(begin_s - 1.0, end_s, FINE_S)
    return float(np.mean(thrust_after_spool(log, rig, fine_s)[fine_s >= begin_s]))


def _voltages(logs: Sequence[RunLog]) -> FloatArray | None:
    """The battery's voltage [V] in each flight (root mean square), None unless all measured it.

    CheckFailed when they are too far apart.
    """
    if not all(_has_voltage(log) for log in logs):
        return None
    volts = np.array([np.sqrt(np.nanmean(log["battery_v"][log.flying] ** 2)) for log in logs])
    low_v, high_v = float(volts.min()), float(volts.max())
    require(
        high_v - low_v < _MOST_SAG * high_v,
        f"The battery gave {low_v:.2f} to {high_v:.2f} V, and thrust goes with its square: "
        "charge it before each flight.",
    )
    return volts


def _repeats_first(clips_kg: Sequence[float]) -> bool:
    return len(clips_kg) > _FEWEST and clips_kg[0] == clips_kg[-1]


def _has_voltage(log: RunLog) -> bool:
    return log.has("battery_v") and bool(np.any(np.isfinite(log["battery_v"][log.flying])))
