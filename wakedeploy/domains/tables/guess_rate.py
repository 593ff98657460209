"""The rate at which samples were meant to come, of stamps that jitter and of which some are lost.

In: stamps. Out: samples a second, as round as the stamps leave open: 20 Hz where they say 19.98 Hz
to half a hertz, and 31.25 Hz where they are even.
"""

import numpy as np
from numpy.typing import NDArray

from wakedeploy.domains.tables.resampling import usual_step_s
from wakedeploy.domains.tables.stamps import between_falls, is_set_back

Vector = NDArray[np.float64]

_IN_BURSTS = 1.5  # the step in which half of the time lies, over the median one
_CLEAR = 0.4  # of a step, by which one may be off so that nobody doubts how many places it spans
_FIRST, _NEAR = 500, 0.1  # stamps that give a step first; the share by which the median may be off
_IN_PHASE = 0.3  # of all stamps; those that come at any time reach less
_FEW_STAMPS = 5  # fewer say nothing but their median step
_CLOCKS_DIFFER = 5e-4  # a share; two clocks that are meant to run alike differ by so much
_DIGITS = (1, 2, 3, 4)


def usual_hz(stamps_s: Vector) -> float | None:
    """The rate [Hz] in which samples, or bursts of them, usually come; None where no stamp rises.

    Holes between samples are left aside.
    """
    steps_s = np.diff(stamps_s)
    rising_s = steps_s[steps_s > 0]
    if not len(rising_s):
        return None
    median_s = float(np.median(rising_s))
    hole_s = max(1.0, 10.0 * median_s)
    burst_s = usual_step_s(rising_s[rising_s <= hole_s])
    if burst_s > _IN_BURSTS * median_s:
        return _round(1.0 / burst_s, _CLOCKS_DIFFER)
    run_s = _longest_run(stamps_s, hole_s)
    if len(run_s) < _FEW_STAMPS:
        return _round(1.0 / median_s, _CLOCKS_DIFFER)
    step_s, share = _step_of_grid(run_s)
    return _round(1.0 / step_s, share)


def _longest_run(stamps_s: Vector, hole_s: float) -> Vector:
    """The most stamps in order without a hole, each once."""
    cuts = between_falls(stamps_s) if is_set_back(stamps_s) else [slice(None)]
    runs_s = []
    for cut in cuts:
        in_order_s = np.unique(stamps_s[cut])
        runs_s += np.split(in_order_s, np.flatnonzero(np.diff(in_order_s) > hole_s) + 1)
    return max(runs_s, key=len)


def _step_of_grid(stamps_s: Vector) -> tuple[float, float]:
    """The step [s] between places of which each stamp is near one, and its share of doubt.

    Places that are empty are samples that were lost. Where stamps have no places, as those of a
    loop that sleeps for now more and now less, it is the median step.
    """
    steps_s = np.diff(stamps_s)
    median_s = float(np.median(steps_s))
    places = np.rint(steps_s / median_s)
    if (np.abs(steps_s / median_s - places) < _CLEAR).all() and places.all():
        return _line(np.concatenate([[0.0], np.cumsum(places)]), stamps_s)
    step_s, start_s = _tone(stamps_s[:_FIRST], median_s)
    if not step_s:
        spread_s = 1.5 * float(np.median(np.abs(steps_s - median_s)))
        return median_s, max(2.0 * spread_s / median_s / len(steps_s) ** 0.5, _CLOCKS_DIFFER)
    count, share = _FIRST, 0.0
    while not share or count < 2 * len(stamps_s):  # the step of some gives the places of more
        part_s = stamps_s[:count]
        step_s, share = _line(np.rint((part_s - start_s) / step_s), part_s)
        count *= 2
    return step_s, share


def _tone(stamps_s: Vector, median_s: float) -> tuple[float, float]:
    """The step [s] at which most stamps are in phase, and where the first place is; zeros for none.

    One stamp that is off by much makes no other place of those that follow.
    """
    from_first_s = stamps_s - stamps_s[0]
    widest = _NEAR * float(from_first_s[-1]) / median_s
    offsets = np.arange(-widest, widest + 0.25, 0.25) / from_first_s[-1]
    rates_hz = 1.0 / median_s + offsets
    phases = np.exp(2j * np.pi * rates_hz[:, None] * from_first_s).mean(axis=1)
    best = int(np.argmax(np.abs(phases)))
    if np.abs(phases[best]) < _IN_PHASE:
        return 0.0, 0.0
    turns = float(np.angle(phases[best])) / (2.0 * np.pi)
    return 1.0 / float(rates_hz[best]), float(stamps_s[0]) + turns / float(rates_hz[best])


def _line(places: Vector, stamps_s: Vector) -> tuple[float, float]:
    """The step [s] of the line through stamps over their places, and its share of doubt.

    Jitter that does not add up hardly moves a long line; jitter that does leaves stamps off it.
    """
    at, from_middle_s = places - places.mean(), stamps_s - stamps_s.mean()
    step_s = float(at @ from_middle_s / (at @ at))
    off_s = float(np.std(from_middle_s - step_s * at))
    return step_s, max(2.0 * 12.0**0.5 * off_s / float(np.ptp(stamps_s)), _CLOCKS_DIFFER)


def _round(rate_hz: float, share: float) -> float:
    """A rate by the fewest digits that say it, up to a share of it."""
    tries = (float(f"{rate_hz:.{digits}g}") for digits in _DIGITS)
    return next((r for r in tries if abs(r / rate_hz - 1.0) <= share), float(f"{rate_hz:.4g}"))
