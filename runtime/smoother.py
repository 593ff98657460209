"""Offline estimation of a flight: Kalman filter forward, Rauch–Tung–Striebel backward.

In: the heights that the range sensor saw, each at its own time, and the acceleration that is known
(thrust, gravity, friction). Out: height, speed and the force that the known acceleration leaves
over, each with its standard deviation. The force is a random process; its size and time are fitted,
with the sensor's noise, by maximum likelihood over a grid, so that the standard deviations are
honest. A wake reaches the sufferer through a rotor's inertia and a diffusing jet, so the process is
one that can be differentiated once; an Ornstein–Uhlenbeck process states errors twice too large.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from filterpy.kalman import rts_smoother

FloatArray = npt.NDArray[np.float64]

MAX_STEP_S = 0.1  # longest time between two events that the series below are good for
OUTLIER_PROBABILITY = 0.01
_OUTLIER_SPAN_M = 1.0  # an outlier lies anywhere within it
_START_SD = (0.1, 1.0)  # of height [m] about the first samples, and of speed [m/s]
_SERIES = 18
_EYE, _IS_HEIGHT = np.eye(4), np.arange(4) == 0  # by states

# The fit looks at a coarse grid first, then at the best point's neighbours (as factors).
COARSE_TIME_S = (0.1, 0.2, 0.4, 0.8, 1.6)
COARSE_SD_N = (0.03, 0.1, 0.3, 1.0)
COARSE_NOISE = (0.7, 1.0, 1.4, 2.0)  # in units of the sensor's stated noise
COARSE_ACTIVITY = (0.0, 0.9)
FINE_FACTOR = (0.7, 1.0, 1.4)
FINE_SD_FACTOR = (0.6, 0.8, 1.0, 1.25, 1.7)
FINE_NOISE_FACTOR = (0.85, 1.0, 1.18)
FINE_ACTIVITY = (0.0, 0.9, 0.97)


@dataclass(frozen=True)
class ForceModel:
    """What is assumed: a force of `sd_n` that changes within `time_s`, and the range noise.

    Its autocovariance is σ²(1 + |τ|/T)·exp(−|τ|/T) (Matérn 3/2). Its driving noise is scaled by
    1 − `activity` + `activity` · `Flight.activity`: a force that is livelier at some times.
    """

    time_s: float
    sd_n: float
    range_sd_m: float
    activity: float = 0.0


@dataclass(frozen=True, eq=False)
class Flight:
    """One airborne stretch: `t_s` (T,) where results are wanted, samples (S,) and what is known.

    `sample_s` and `height_m` (S,): when the sensor measured, and what. `known_s` (N,) with
    `known_speed_mps` and `known_height_m`: the motion that the known acceleration alone would have
    made from rest at the start.
    """

    t_s: FloatArray
    sample_s: FloatArray
    height_m: FloatArray
    known_s: FloatArray
    known_speed_mps: FloatArray
    known_height_m: FloatArray
    activity: FloatArray  # (T,) at `t_s`, about 1 on average


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Results at `Flight.t_s`, (T,) each; `causal_*` used nothing later than their own time."""

    height_m: FloatArray
    speed_mps: FloatArray
    speed_sd_mps: FloatArray
    force_n: FloatArray
    force_sd_n: FloatArray
    causal_height_m: FloatArray
    causal_speed_mps: FloatArray
    rejected: int  # samples taken for outliers


@dataclass(frozen=True, eq=False)
class _Events:
    """Ticks and samples merged in order of time: (E,) arrays."""

    dt_s: FloatArray  # since the event before; 0 for the first
    activity: FloatArray  # during that time
    deviation_m: FloatArray  # measured minus known height; NaN at a tick
    ticks: npt.NDArray[np.intp]  # (T,) which events are ticks


@dataclass(frozen=True, eq=False)
class _Forward:
    means: FloatArray  # (E, G, 4)
    covariances: FloatArray  # (E, G, 4, 4)
    log_likelihood: FloatArray  # (G,)
    rejected: FloatArray  # (G,)
    steps: list[tuple[FloatArray, FloatArray]]  # (G, 4, 4) each: transition and noise before each


def smooth(flight: Flight, model: ForceModel, mass_kg: float) -> Smoothed:
    """Smooth one flight under one model."""
    events = _merge(flight)
    forward = _filter(events, [model], mass_kg, keep=True)
    means, covariances = forward.means[:, 0], forward.covariances[:, 0]
    transitions = [f[0] for f, _ in forward.steps[1:]]
    noises = [q[0] for _, q in forward.steps[1:]]
    after, cov, _, _ = rts_smoother(means, covariances, transitions, noises)
    return _results(flight, events, means, after, cov, forward)


def fit(
    flights: Sequence[Flight],
    range_sd_m: float,
    mass_kg: float,
    progress: Callable[[int, int], None] | None = None,
) -> ForceModel:
    """The most likely model, all flights together, by two grids: a coarse one, then a fine one.

    `range_sd_m` is what the sensor's noise should be. `progress(done, total)` is called after each
    flight and grid.
    """
    events = [_merge(flight) for flight in flights]

    def grid_progress(grid_number: int) -> Callable[[int], None]:
        done = grid_number * len(events)
        return lambda count: progress(done + count, 2 * len(events)) if progress else None

    coarse = itertools.product(COARSE_TIME_S, COARSE_SD_N, COARSE_NOISE, COARSE_ACTIVITY)
    grid = [ForceModel(t, sd, k * range_sd_m, share) for t, sd, k, share in coarse]
    near = _most_likely(events, grid, mass_kg, grid_progress(0))
    fine = itertools.product(FINE_FACTOR, FINE_SD_FACTOR, FINE_NOISE_FACTOR, FINE_ACTIVITY)
    grid = [
        ForceModel(near.time_s * t, near.sd_n * sd, near.range_sd_m * k, share)
        for t, sd, k, share in fine
    ]
    return _most_likely(events, grid, mass_kg, grid_progress(1))


def _most_likely(
    flights: Sequence["_Events"],
    grid: Sequence[ForceModel],
    mass_kg: float,
    progress: Callable[[int], None],
) -> ForceModel:
    score = np.zeros(len(grid))
    for count, events in enumerate(flights, 1):
        score += _filter(events, grid, mass_kg).log_likelihood
        progress(count)
    return grid[int(np.argmax(score))]


def known_motion(t_s: FloatArray, acceleration_mps2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speed and height (N,) from rest, for accelerations (N,) linear between the times (N,)."""
    dt = np.diff(t_s)
    a, b = acceleration_mps2[:-1], acceleration_mps2[1:]
    speed = np.concatenate([[0.0], np.cumsum(0.5 * (a + b) * dt)])
    rise = speed[:-1] * dt + (2.0 * a + b) * dt * dt / 6.0
    return speed, np.concatenate([[0.0], np.cumsum(rise)])


class _Steps:
    """Transition and noise matrices of a batch of models over any time up to `MAX_STEP_S`.

    Both are power series in the time step: F = Σ A^k dt^k/k!, and Q = Σ C_k dt^(k+1)/(k+1)! with
    C_0 = L, C_{k+1} = A C_k + C_k Aᵀ (the Lyapunov equation's derivatives at zero).
    """

    def __init__(self, models: Sequence[ForceModel], mass_kg: float) -> None:
        self._share = np.array([model.activity for model in models])
        drift, drive = _continuous(models, mass_kg)
        powers, noises = [np.broadcast_to(np.eye(drift.shape[-1]), drift.shape)], [drive]
        for _ in range(_SERIES):
            powers.append(drift @ powers[-1])
            noises.append(drift @ noises[-1] + noises[-1] @ drift.swapaxes(-1, -2))
        # Flat, (K, G · 16): a product of plain matrices takes no time to find its axes.
        self._powers = np.stack(powers).reshape(len(powers), -1)
        self._noises = np.stack(noises).reshape(len(noises), -1)
        self._shape = drift.shape
        self._exponents = np.arange(_SERIES + 2)
        self._factorials = np.array([math.factorial(k) for k in range(_SERIES + 2)], dtype=float)

    def at(self, dt_s: float, activity: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """(F, Q), each (G, 4, 4), where the flight's activity is `activity`."""
        terms = (dt_s**self._exponents / self._factorials)[None]
        transition = np.dot(terms[:, :-1], self._powers).reshape(self._shape)
        noise = np.dot(terms[:, 1:], self._noises).reshape(self._shape)
        scale = 1.0 - self._share + self._share * activity
        return transition, noise * scale[:, None, None]


def _continuous(models: Sequence[ForceModel], mass_kg: float) -> tuple[FloatArray, FloatArray]:
    """Drift A and driving noise L, (G, 4, 4); state: height, speed, force, the force's rate."""
    rate = np.array([1.0 / model.time_s for model in models])
    variance = np.array([model.sd_n**2 for model in models])
    drift, drive = np.zeros((len(models), 4, 4)), np.zeros((len(models), 4, 4))
    drift[:, 0, 1], drift[:, 1, 2], drift[:, 2, 3] = 1.0, 1.0 / mass_kg, 1.0
    drift[:, 3, 2], drift[:, 3, 3] = -(rate**2), -2.0 * rate
    drive[:, 3, 3] = 4.0 * variance * rate**3
    return drift, drive


def _starting_variance(models: Sequence[ForceModel]) -> FloatArray:
    """Variances at the start, (G, 4): broad in height and speed, the force's own in force."""
    scales = [(model.sd_n, model.sd_n / model.time_s) for model in models]
    return np.square([(*_START_SD, sd_n, rate_sd) for sd_n, rate_sd in scales])


def _merge(flight: Flight) -> _Events:
    times = np.concatenate([flight.t_s, flight.sample_s])
    expected = np.interp(flight.sample_s, flight.known_s, flight.known_height_m)
    deviation = np.concatenate([np.full(len(flight.t_s), np.nan), flight.height_m - expected])
    order = np.argsort(times, kind="stable")
    place = np.empty(len(order), dtype=np.intp)
    place[order] = np.arange(len(order))
    dt = np.diff(times[order], prepend=times[order[0]])
    assert dt.max(initial=0.0) <= MAX_STEP_S + 1e-9, "flights are cut at longer gaps"
    activity = np.interp(times[order] - 0.5 * dt, flight.t_s, flight.activity)
    return _Events(dt, activity, deviation[order], place[: len(flight.t_s)])


def _filter(
    events: _Events, models: Sequence[ForceModel], mass_kg: float, keep: bool = False
) -> _Forward:
    """The forward pass for a batch of models; states and steps are kept only when asked for."""
    steps = _Steps(models, mass_kg)
    noise = np.array([model.range_sd_m**2 for model in models])
    spread = _starting_variance(models)
    mean = np.zeros_like(spread)
    # The first samples' median, because any one of them may be an outlier.
    mean[:, 0] = np.median(events.deviation_m[np.isfinite(events.deviation_m)][:3])
    cov = spread[:, :, None] * np.eye(spread.shape[1])
    score, rejected = np.zeros(len(models)), np.zeros(len(models))
    means, covs, taken = [], [], []
    for dt, activity, deviation in zip(
        events.dt_s, events.activity, events.deviation_m, strict=True
    ):
        transition, process = steps.at(dt, activity)
        mean = np.einsum("gij,gj->gi", transition, mean)
        cov = transition @ cov @ transition.swapaxes(-1, -2) + process
        if deviation == deviation:
            mean, cov, gained, out = _update(mean, cov, deviation, noise)
            score += gained
            rejected += out
        if keep:
            means.append(mean)
            covs.append(cov)
            taken.append((transition, process))
    return _Forward(np.array(means), np.array(covs), score, rejected, taken)


def _update(
    mean: FloatArray, cov: FloatArray, deviation: float, noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Take in one height: (mean, covariance, log likelihood (G,), 1 where it was an outlier (G,)).

    A sample is good, or with a small probability anywhere; the likelier of the two decides whether
    it is used, and both enter the likelihood, so that models are compared on the same samples.
    """
    innovation = deviation - mean[:, 0]
    variance = cov[:, 0, 0] + noise
    good = np.log1p(-OUTLIER_PROBABILITY) - 0.5 * (
        innovation**2 / variance + np.log(2.0 * np.pi * variance)
    )
    stray = math.log(OUTLIER_PROBABILITY / _OUTLIER_SPAN_M)
    used = good > stray
    gain = cov[:, :, 0] / variance[:, None] * used[:, None]
    mean = mean + gain * innovation[:, None]
    # Joseph's form keeps the covariance symmetric and positive.
    keep = _EYE - gain[:, :, None] * _IS_HEIGHT
    cov = keep @ cov @ keep.swapaxes(-1, -2)
    cov = cov + gain[:, :, None] * gain[:, None, :] * noise[:, None, None]
    return mean, cov, np.logaddexp(good, stray), 1.0 - used


def _results(
    flight: Flight,
    events: _Events,
    causal: FloatArray,
    mean: FloatArray,
    cov: FloatArray,
    forward: _Forward,
) -> Smoothed:
    at = events.ticks
    speed = np.interp(flight.t_s, flight.known_s, flight.known_speed_mps)
    height = np.interp(flight.t_s, flight.known_s, flight.known_height_m)
    return Smoothed(
        height_m=height + mean[at, 0],
        speed_mps=speed + mean[at, 1],
        speed_sd_mps=np.sqrt(cov[at, 1, 1]),
        force_n=mean[at, 2],
        force_sd_n=np.sqrt(cov[at, 2, 2]),
        causal_height_m=height + causal[at, 0],
        causal_speed_mps=speed + causal[at, 1],
        rejected=int(forward.rejected[0]),
    )
