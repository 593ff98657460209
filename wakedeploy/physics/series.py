"""Whole flights at once, compiled: rotor lag, the jet along a path, and a Kalman filter.

The gap workflow evaluates a flight thousands of times; these are its inner loops. The laws of one
step are the plant's own functions, compiled. numba lives here, in `field` and in
`gap.systems.gantry.repeated_readings`, away from the runtime.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from wakedeploy.physics import motor

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_LOST_M, _LOST_MPS = 0.05, 0.5
_AT_REST = 1e-7  # a motion that rests less is not held at all
_LOOSE = 2.0  # at 1.5 times what holds it, nothing of stiction is left


def compiled(function: Callable[..., Any], *, inline: bool = False) -> Any:
    """Compile on first use and keep the machine code on disk, where there is a place to keep it.

    What is called in every step of a loop is written `inline` into it.
    """
    compiler = functools.partial(
        numba.njit,
        error_model="numpy",
        fastmath={"contract"},
        inline="always" if inline else "never",
    )
    try:
        return compiler(cache=True)(function)
    except RuntimeError:  # neither the package's folder nor the user's cache can be written to
        return compiler()(function)


_kept, _approached, _exact_mean_thrust = (
    compiled(law, inline=True) for law in (motor.kept, motor.approached, motor.exact_mean_thrust)
)


@compiled
def spooled_thrust(target: FloatArray, up_s: float, down_s: float, dt_s: float) -> FloatArray:
    """Mean thrust [N] in each step of a rotor that lags, from rest, (N,).

    `target` (N,) is the square root of the commanded thrust [√N], held over a step; the lag is
    first order in rotor speed, `up_s` when rising and `down_s` when falling.
    """
    keep_up, keep_down = _kept(up_s, dt_s), _kept(down_s, dt_s)
    up, down = up_s / dt_s, down_s / dt_s
    thrust = np.empty_like(target)
    speed = 0.0
    for k in range(len(target)):
        goal = target[k]
        keep = keep_up if goal > speed else keep_down
        lag = up if goal > speed else down
        thrust[k] = _exact_mean_thrust(speed, goal, lag, keep)
        speed = _approached(speed, goal, keep)
    return thrust


def sliding_and_resting(
    vz_mps: FloatArray, sliding_mps: float, resting_mps: float
) -> tuple[FloatArray, FloatArray]:
    """How far a motion (…) slides, from −1 to 1, and how far it rests, from 0 to 1, (…) each."""
    return np.tanh(vz_mps / sliding_mps), np.exp(-((vz_mps / resting_mps) ** 2))


@compiled
def rail_friction(
    vz_mps: FloatArray,  # (N,)
    sliding: FloatArray,  # (N,) of `sliding_and_resting`
    resting: FloatArray,  # (N,) likewise
    driving_n: FloatArray,  # (N,) everything else that pushes, weight included
    coulomb_n: float,
    viscous_n_per_mps: float,
    stiction_n: float,
) -> FloatArray:
    """Friction [N] against the motion (N,), without jumps in speed.

    As far as a motion slides, Coulomb's force resists it; as far as it rests, the rail holds
    against the driving force, up to stiction. Up to there it holds all of it: a smooth limit, which
    begins to give way before, makes a stronger stiction out of every Coulomb friction. A stronger
    force breaks loose: Coulomb's remains, and where the force is so strong that the speed only
    passes through zero, nothing is held. Steps of either kind would make the likelihood jagged.
    """
    result = np.empty_like(vz_mps)
    most_n = max(stiction_n, coulomb_n, 1e-6)
    for k in range(len(vz_mps)):
        result[k] = coulomb_n * sliding[k] + viscous_n_per_mps * vz_mps[k]
        rest = resting[k]
        if rest > _AT_REST:
            holding_n, beyond = driving_n[k], abs(driving_n[k]) / most_n - 1.0
            if beyond > 0.0:
                left_n = coulomb_n + (most_n - coulomb_n) * max(0.0, 1.0 - _LOOSE * beyond)
                holding_n = math.copysign(left_n, driving_n[k])
                rest *= max(0.0, 1.0 - beyond)
            result[k] += rest * (holding_n - result[k])
    return result


@compiled
def puff_weights(
    x_m: FloatArray,  # (N,) at the steps' ends
    above_m: FloatArray,  # (N,) height minus the source's
    speed_mps: FloatArray,  # (N,) at which each step's puff sinks
    ages_s: FloatArray,  # (M,) of the puffs at a step's end, newest first
    amplitude_mps: FloatArray,  # (M,) at the reference thrust, as `jet.puff_shapes` has it
    width2_m2: FloatArray,  # (M,)
) -> FloatArray:
    """What each puff adds to the jet's velocity along a path and to its slope, (N, 2, M).

    Per `root` of `jet_along`; puffs that are six widths away add nothing.
    """
    weights = np.zeros((len(x_m), 2, len(ages_s)))
    reach2_m2, inverse_width2 = 36.0 * width2_m2, 1.0 / width2_m2
    for k in range(len(x_m)):
        x2 = x_m[k] * x_m[k]
        for j in range(min(k + 1, len(ages_s))):
            below = above_m[k] + speed_mps[k - j] * ages_s[j]
            distance2 = x2 + below * below
            if distance2 < reach2_m2[j]:
                part = amplitude_mps[j] * math.exp(-0.5 * distance2 * inverse_width2[j])
                weights[k, 0, j] = -part
                weights[k, 1, j] = part * below * inverse_width2[j]
    return weights


@compiled
def jet_along(
    root: FloatArray,  # (N,) √(u/u_reference), mean over each step
    weights: FloatArray,  # (N, 2, M) of `puff_weights`
) -> FloatArray:
    """The jet's vertical velocity [m/s] along a path, and its slope over height [1/s], (2, N).

    `jet.air_mps` for every step, with the slope.
    """
    result = np.zeros((2, len(root)))
    for k in range(len(root)):
        velocity, slope = 0.0, 0.0
        for j in range(min(k + 1, weights.shape[2])):
            velocity += weights[k, 0, j] * root[k - j]
            slope += weights[k, 1, j] * root[k - j]
        result[0, k], result[1, k] = velocity, slope
    return result


@compiled
def mean_in_steps(
    edges_s: FloatArray,  # (N + 1,) between the steps
    from_s: FloatArray,  # (n,) when each value begins, rising; the last one ends there
    values: FloatArray,  # (n,)
    outside: float,
) -> FloatArray:
    """The mean in each step (N,) of what holds a value until the next; `outside` where unknown."""
    means = np.full(len(edges_s) - 1, outside)
    first = 0
    for k in range(len(means)):
        begin, end = edges_s[k], edges_s[k + 1]
        if begin < from_s[0] or end > from_s[-1]:
            continue
        while from_s[first + 1] <= begin:
            first += 1
        total, at, i = 0.0, begin, first
        while from_s[i + 1] < end:
            total += values[i] * (from_s[i + 1] - at)
            at = from_s[i + 1]
            i += 1
        means[k] = (total + values[i] * (end - at)) / (end - begin)
    return means


@compiled
def filtered(
    dt_s: float,
    start: IntArray,  # (S,) first step of each airborne stretch
    stop: IntArray,  # (S,) one past its last
    nominal: FloatArray,  # (2, N) height [m] and speed [m/s] around which the rest is linear
    acceleration: FloatArray,  # (3, N) at nominal [m/s²], its slopes by height and by speed
    gain: FloatArray,  # (N,) [m/s²] per unit of the coloured disturbance
    keep: float,  # of the coloured disturbance from step to step
    white: float,  # [(m/s²)²·s] intensity of white acceleration
    step_of: IntArray,  # (n,) the step in which each sample was taken
    into_s: FloatArray,  # (n,) how far into it
    reading: FloatArray,  # (n,) [m]
    expected: FloatArray,  # (2, n) reading at the nominal height, and its slope by height
    noise: FloatArray,  # (n,) variance of a reading [m²]
    outlier: FloatArray,  # probability of an outlier, and its variance [m²]
    horizons: IntArray,  # (h,) in steps: how far ahead to forecast after each sample
    remember: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Kalman filter over (height, speed, disturbance) along the airborne stretches.

    Returns (4, n): innovation, its variance, log density, probability of being no outlier;
    (2h, n): for each horizon the forecast's height [m] and its variance; and, if asked to
    `remember`, the states (3, N) and covariances (N, 3, 3) after each step's samples. Samples
    outside the stretches get a variance of 0.
    """
    samples, ahead = np.zeros((4, len(reading))), np.full((2 * len(horizons), len(reading)), np.nan)
    kept = nominal.shape[1] if remember else 1
    states, covariances = np.zeros((3, kept)), np.zeros((kept, 3, 3))
    n = 0
    for s in range(len(start)):
        z, v, d = nominal[0, start[s]], nominal[1, start[s]], 0.0
        stray1 = stray2 = stray3 = 0.0  # how likely the last three samples were strays
        p = np.zeros((3, 3))
        p[0, 0], p[1, 1], p[2, 2] = 0.03**2, 0.3**2, 1.0
        while n < len(reading) and step_of[n] < start[s]:
            n += 1
        for k in range(start[s], stop[s]):
            while n < len(reading) and step_of[n] == k:
                _look_again(p, stray1 * stray2 * stray3)
                z, v, d = _update(
                    samples[:, n], p, z, v, d, into_s[n], reading[n], expected[0, n],
                    expected[1, n], nominal[0, k], nominal[1, k], noise[n], outlier,
                )  # fmt: skip
                stray1, stray2, stray3 = stray2, stray3, 1.0 - samples[3, n]
                for h in range(len(horizons)):
                    if k + horizons[h] < stop[s]:
                        _forecast(
                            ahead[2 * h : 2 * h + 2, n], p, z, v, d, k, horizons[h], dt_s,
                            nominal, acceleration, gain, keep, white,
                        )  # fmt: skip
                n += 1
            if remember:
                states[0, k], states[1, k], states[2, k] = z, v, d
                covariances[k] = p
            z, v, d = _advance(
                p, z, v, d, dt_s, nominal[0, k], nominal[1, k], acceleration[0, k],
                acceleration[1, k], acceleration[2, k], gain[k], keep, white,
            )  # fmt: skip
    return samples, ahead, states, covariances


@compiled
def _look_again(p: FloatArray, stray: float) -> None:
    """Widen the covariance (changed in place) as far as three samples in a row were strays.

    So many are none: the filter has lost the motion. Not by a decision, which would make the
    likelihood jump, and its slopes nonsense.
    """
    p[0, 0] += stray * stray * _LOST_M * _LOST_M
    p[1, 1] += stray * stray * _LOST_MPS * _LOST_MPS


@compiled
def _advance(
    p: FloatArray,
    z: float,
    v: float,
    d: float,
    dt: float,
    z0: float,
    v0: float,
    a0: float,
    az: float,
    av: float,
    gain: float,
    keep: float,
    white: float,
) -> tuple[float, float, float]:
    """One step of mean and covariance (changed in place)."""
    a = a0 + az * (z - z0) + av * (v - v0) + gain * d
    half = 0.5 * dt * dt
    f00, f01, f02 = 1.0 + half * az, dt + half * av, half * gain
    f10, f11, f12 = dt * az, 1.0 + dt * av, dt * gain
    q00 = f00 * p[0, 0] + f01 * p[0, 1] + f02 * p[0, 2]
    q01 = f00 * p[0, 1] + f01 * p[1, 1] + f02 * p[1, 2]
    q02 = f00 * p[0, 2] + f01 * p[1, 2] + f02 * p[2, 2]
    q10 = f10 * p[0, 0] + f11 * p[0, 1] + f12 * p[0, 2]
    q11 = f10 * p[0, 1] + f11 * p[1, 1] + f12 * p[1, 2]
    q12 = f10 * p[0, 2] + f11 * p[1, 2] + f12 * p[2, 2]
    p22 = keep * keep * p[2, 2] + 1.0 - keep * keep
    p[0, 0] = q00 * f00 + q01 * f01 + q02 * f02 + white * dt * dt * dt / 3.0
    p[0, 1] = q00 * f10 + q01 * f11 + q02 * f12 + white * dt * dt / 2.0
    p[1, 1] = q10 * f10 + q11 * f11 + q12 * f12 + white * dt
    p[0, 2] = q02 * keep
    p[1, 2] = q12 * keep
    p[2, 2] = p22
    p[1, 0], p[2, 0], p[2, 1] = p[0, 1], p[0, 2], p[1, 2]
    return z + dt * v + half * a, v + dt * a, keep * d


@compiled
def _update(
    sample: FloatArray,
    p: FloatArray,
    z: float,
    v: float,
    d: float,
    into_s: float,
    reading: float,
    expected: float,
    slope: float,
    z0: float,
    v0: float,
    noise: float,
    outlier: FloatArray,
) -> tuple[float, float, float]:
    """Take one sample in; a likely outlier counts for as much as it is likely to be none."""
    # `expected` holds at the nominal height at the sample's time: z0 + into_s · v0.
    e = reading - expected - slope * (z - z0 + into_s * (v - v0))
    h0, h1 = slope, slope * into_s
    c0 = p[0, 0] * h0 + p[0, 1] * h1
    c1 = p[0, 1] * h0 + p[1, 1] * h1
    c2 = p[0, 2] * h0 + p[1, 2] * h1
    variance = h0 * c0 + h1 * c1 + noise
    wide = variance + outlier[1]
    inlying = (1.0 - outlier[0]) * math.exp(-0.5 * min(e * e / variance, 700.0))
    inlying /= math.sqrt(variance)
    outlying = outlier[0] * math.exp(-0.5 * min(e * e / wide, 700.0)) / math.sqrt(wide)
    weight = inlying / (inlying + outlying)
    sample[0], sample[1] = e, variance
    sample[2] = math.log(inlying + outlying) - 0.9189385332046727
    sample[3] = weight
    g0, g1, g2 = weight * c0 / variance, weight * c1 / variance, weight * c2 / variance
    p[0, 0] -= g0 * c0
    p[0, 1] -= g0 * c1
    p[0, 2] -= g0 * c2
    p[1, 1] -= g1 * c1
    p[1, 2] -= g1 * c2
    p[2, 2] -= g2 * c2
    p[1, 0], p[2, 0], p[2, 1] = p[0, 1], p[0, 2], p[1, 2]
    return z + g0 * e, v + g1 * e, d + g2 * e


@compiled
def _forecast(
    result: FloatArray,
    p: FloatArray,
    z: float,
    v: float,
    d: float,
    k: int,
    steps: int,
    dt: float,
    nominal: FloatArray,
    acceleration: FloatArray,
    gain: FloatArray,
    keep: float,
    white: float,
) -> None:
    """Height and its variance `steps` later, without any further sample."""
    q = p.copy()
    for j in range(k, k + steps):
        z, v, d = _advance(
            q,
            z,
            v,
            d,
            dt,
            nominal[0, j],
            nominal[1, j],
            acceleration[0, j],
            acceleration[1, j],
            acceleration[2, j],
            gain[j],
            keep,
            white,
        )
    result[0], result[1] = z, q[0, 0]


@compiled
def smoothed(
    dt_s: float,
    start: IntArray,
    stop: IntArray,
    states: FloatArray,  # (3, N) as `filtered` remembers them
    covariance: FloatArray,  # (N, 3, 3) likewise
    nominal: FloatArray,
    acceleration: FloatArray,
    gain: FloatArray,
    keep: float,
    white: float,
) -> FloatArray:
    """Height, speed and disturbance (3, N) given all samples (Rauch, Tung and Striebel 1965)."""
    result = states.copy()
    for s in range(len(start)):
        for k in range(stop[s] - 2, start[s] - 1, -1):
            p = covariance[k].copy()
            z, v, d = states[0, k], states[1, k], states[2, k]
            f = _transition(dt_s, acceleration[1, k], acceleration[2, k], gain[k], keep)
            with_next = covariance[k] @ f.T
            z1, v1, d1 = _advance(
                p,
                z,
                v,
                d,
                dt_s,
                nominal[0, k],
                nominal[1, k],
                acceleration[0, k],
                acceleration[1, k],
                acceleration[2, k],
                gain[k],
                keep,
                white,
            )
            rest = _solved(p, result[0, k + 1] - z1, result[1, k + 1] - v1, result[2, k + 1] - d1)
            result[0, k] = z + with_next[0] @ rest
            result[1, k] = v + with_next[1] @ rest
            result[2, k] = d + with_next[2] @ rest
    return result


@compiled
def _solved(p: FloatArray, r0: float, r1: float, r2: float) -> FloatArray:
    """p⁻¹·r of a covariance (3, 3), by Cholesky's factors: numpy's way takes ten times as long."""
    tiny = 1e-14
    l00 = math.sqrt(max(p[0, 0] + tiny, tiny))
    l10, l20 = p[1, 0] / l00, p[2, 0] / l00
    l11 = math.sqrt(max(p[1, 1] + tiny - l10 * l10, tiny))
    l21 = (p[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(max(p[2, 2] + tiny - l20 * l20 - l21 * l21, tiny))
    y0 = r0 / l00
    y1 = (r1 - l10 * y0) / l11
    y2 = (r2 - l20 * y0 - l21 * y1) / l22
    x2 = y2 / l22
    x1 = (y1 - l21 * x2) / l11
    x0 = (y0 - l10 * x1 - l20 * x2) / l00
    return np.array([x0, x1, x2])


@compiled
def _transition(dt: float, az: float, av: float, gain: float, keep: float) -> FloatArray:
    half = 0.5 * dt * dt
    return np.array(
        [
            [1.0 + half * az, dt + half * av, half * gain],
            [dt * az, 1.0 + dt * av, dt * gain],
            [0.0, 0.0, keep],
        ]
    )
