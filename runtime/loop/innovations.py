"""What innovations show beside the state: noise, strays, and that something has begun to push.

In: an estimate and its last innovations. Out: the same with its sums and means, as pure steps.
"""

import math

from runtime.loop.copies import replace
from runtime.loop.estimate import Estimate

# Differences of neighbouring innovations are squared over their variance and averaged: what a wrong
# model adds to both cancels, and noise remains (von Neumann 1941). The noisier a sensor is than the
# rig file says, the less it is believed, down to a 200th.
_SURPRISE_TICKS, _MOST_SURPRISE = 16.0, 9.0
_SURPRISED, _CALM = 3.0, 1.2
_NOISE_UP, _NOISE_DOWN, _MOST_NOISE = 1.5, 1.05, 200.0
# Half of the last seven innovations, and half of the readings' second differences, are off by this
# many times the noise of the rig file: this is noise already, before a mean shows it. No motion
# bends so much from one reading to the next, and a stray leaves a median as it is.
_SUDDEN_READINGS, SUDDEN_SD, _MEDIAN_SD = 7, 4.0, 1.4826
# Innovations that add up to one side are a push that began a tenth of a second ago (Page 1954;
# Willsky and Jones 1976): force, speed and height change together. A single stray is not enough.
# Wakes as in the rig file add up once in three hundred ticks, and the filter is then less sure.
_PUSH_SUM_SD, _PUSH_DRIFT_SD, _PUSH_MOST_SD = 3.5, 1.0, 3.5
_FAR_SD, _PUSH_GROWTH, _WARY_TICKS, _PUSH_SIDE = 8.0, (1.3, 3.0), 8, 3
# Noise and strays can add up, too: for some ticks a filter without the push runs beside.
# If it foresees the readings better, there was no push.
_UNPUSHED_TICKS, _NO_PUSH, _PUSH = 8, 2.0, -6.0
_MOST_SD = 6.0  # an innovation counts as this at most in a log likelihood

Reading = tuple[float, float, float]  # when it was taken [s], what it said [m], its innovation [m]


def added_up(now: Estimate, *, acts_known: bool) -> Estimate:
    """The innovations' sums downwards and upwards with this one, over what noise gives."""
    off_sd = now.innovation_m / math.sqrt(now.innovation_var_m2)
    sign = 1 if off_sd > 0.0 else -1
    now = replace(now, side=now.side + sign if now.side * sign > 0 else sign)
    # Motion grows with the square of time. What is far off at once is a stray, a jump or noise.
    growth = now.innovation_m / now.last_innovation_m if now.last_innovation_m else math.inf
    if abs(off_sd) > _FAR_SD and not _PUSH_GROWTH[0] < growth < _PUSH_GROWTH[1]:
        again = _WARY_TICKS if now.wary_ticks else 0
        return replace(now, wary_ticks=_WARY_TICKS + again)
    now = replace(now, wary_ticks=max(now.wary_ticks - 1, 0))
    if now.wary_ticks > _WARY_TICKS or now.noise_scale > 1.0 or not acts_known:
        return replace(now, pushed=(0.0, 0.0))
    off_sd = min(max(off_sd, -_PUSH_MOST_SD), _PUSH_MOST_SD)
    down, up = now.pushed
    sums = (max(down - off_sd - _PUSH_DRIFT_SD, 0.0), max(up + off_sd - _PUSH_DRIFT_SD, 0.0))
    return replace(now, pushed=sums)


def set_apart(now: Estimate, without: Estimate) -> Estimate:
    """The filter with the one `without` its news beside it from now on."""
    without = replace(without, unpushed=None)
    return replace(now, unpushed=without, unpushed_more=0.0, unpushed_ticks=0)


def judged(pushed: Estimate, without: Estimate) -> Estimate:
    """The filter that takes in a push, or the one `without`, if that foresees better."""
    more, ticks = pushed.unpushed_more, pushed.unpushed_ticks + 1
    if math.isfinite(pushed.innovation_m + without.innovation_m):
        more += log_likelihood(without) - log_likelihood(pushed)
    if more > _NO_PUSH:
        return replace(without, lateral=pushed.lateral, lateral_cov=pushed.lateral_cov)
    if more < _PUSH or ticks > _UNPUSHED_TICKS:
        return replace(pushed, unpushed=None)
    return replace(pushed, unpushed=without, unpushed_more=more, unpushed_ticks=ticks)


def log_likelihood(now: Estimate) -> float:
    """How well the filter foresaw its last reading; a large error counts as a stray does."""
    square = min(now.innovation_m**2 / now.innovation_var_m2, _MOST_SD**2)
    return -0.5 * (square + math.log(now.innovation_var_m2))


def with_another(lately: tuple[Reading, ...], reading: Reading) -> tuple[Reading, ...]:
    """The last readings with one more; only those that are looked at are kept."""
    return (*lately[-_SUDDEN_READINGS - 1 :], reading)


def sudden_m(lately: tuple[Reading, ...]) -> float:
    """The noise [m] that the last innovations and the readings' second differences share."""
    if len(lately) < _SUDDEN_READINGS + 2:
        return 0.0
    bends_m = sorted(map(_bent_m, lately, lately[1:], lately[2:]))
    sizes_m = sorted(abs(reading[2]) for reading in lately[2:])
    middle = _SUDDEN_READINGS // 2
    return _MEDIAN_SD * min(bends_m[middle] / math.sqrt(6.0), sizes_m[middle])


def _bent_m(a: Reading, b: Reading, c: Reading) -> float:
    """How far the last of three readings is off the line through the others [m]."""
    share = (c[0] - b[0]) / (b[0] - a[0]) if b[0] > a[0] else 1.0
    return abs(c[1] - b[1] - share * (b[1] - a[1]))


def surprised(now: Estimate) -> Estimate:
    """The filter after an innovation, with how noisy the sensor is."""
    difference_m = now.innovation_m - now.last_innovation_m
    if not math.isfinite(difference_m):
        return replace(now, last_innovation_m=now.innovation_m)
    square = min(0.5 * difference_m**2 / now.innovation_var_m2, _MOST_SURPRISE)
    surprise = now.surprise + (square - now.surprise) / _SURPRISE_TICKS
    scale = now.noise_scale
    if surprise > _SURPRISED:
        scale = min(scale * _NOISE_UP, _MOST_NOISE)
    elif surprise < _CALM:
        scale = max(scale / _NOISE_DOWN, 1.0)
    return replace(now, surprise=surprise, noise_scale=scale, last_innovation_m=now.innovation_m)


def tells_of_a_push(now: Estimate) -> bool:
    """Whether innovations have added up to one side."""
    return max(now.pushed) > _PUSH_SUM_SD and abs(now.side) >= _PUSH_SIDE
