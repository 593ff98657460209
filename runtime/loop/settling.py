"""Touch-down: motors go off only once the sufferer has shown that it stands.

In: heights as they are read. Out: a share of the weight for the motor to carry, and whether the
sufferer stands. A drifted sensor reads the stop where there is none; what hangs in the air sinks
as soon as it is carried less, and what stands does not. A sensor that says the very same all the
time shows neither: then the sufferer comes down as if nobody knew its height.
"""

import enum
import math
from dataclasses import dataclass

from runtime.loop.copies import replace
from runtime.loop.estimate import Estimate

TEST_SHARE = 0.88  # of the weight: from rest a fall of 14 cm in the time of a test, at 0.6 m/s
TEST_S = 0.5
SINK_S = 0.75  # on the way down between two tests
MOVED_M = 0.025  # in a test; noise alone does not show this much
BENT_M = 0.02  # off a straight line; a sensor's drift alone is straight, a fall is off by 5 cm
_READINGS = 4  # at each end of a test, averaged
_PINNED = 6  # this often the same at the end
NEAR_STOP_M = 0.06  # what stands is read below this
STILL_MPS = 0.3  # slower than this a test may begin
LONGEST_S = 12.0  # then it comes down as if nobody knew its height


class Stage(enum.Enum):
    """The stages of a touch-down."""

    TEST = enum.auto()  # carried less: does it sink?
    SINK = enum.auto()  # it did: down, at the speed of a blind descent
    BLIND = enum.auto()  # nothing shows where it is: the ladder of a blind descent
    STANDS = enum.auto()


@dataclass(frozen=True, slots=True)
class Settling:
    """Since when the touch-down and its stage last, and what was read in the stage."""

    began_s: float
    stage_s: float
    stage: Stage = Stage.TEST
    ranges_m: tuple[float, ...] = ()


def begun(now: Estimate, t_s: float) -> Settling:
    """A touch-down from here: if it is in the air or in motion, it sinks before it is tested."""
    return Settling(t_s, t_s, Stage.SINK if is_off(now) else Stage.TEST)


def is_off(now: Estimate) -> bool:
    """Whether it is seen off the stop, or in motion."""
    return now.z_m > NEAR_STOP_M or abs(now.vz_mps) > STILL_MPS


def settled(
    before: Settling,
    t_s: float,
    range_m: float,
    *,
    ladder_s: float,
    may_repeat: bool = False,
    off: bool = False,
) -> Settling:
    """One tick: `range_m` is a new reading, corrected by the sensor's bias, or NaN.

    `ladder_s`: how long a blind descent takes. `may_repeat`: the sensor's noise is below its step.
    `off`: it is seen off the stop or in motion, so no test is needed.
    """
    if before.stage is Stage.STANDS:
        return before
    if before.stage is Stage.BLIND:
        is_over = t_s - before.stage_s >= ladder_s
        return replace(before, stage=Stage.STANDS) if is_over else before
    if t_s - before.began_s > LONGEST_S:
        return Settling(before.began_s, t_s, Stage.BLIND)
    if before.stage is Stage.SINK:
        is_over = t_s - before.stage_s >= SINK_S and not off
        return Settling(before.began_s, t_s) if is_over else before
    if off:
        return Settling(before.began_s, t_s, Stage.SINK)
    read = (*before.ranges_m, range_m) if math.isfinite(range_m) else before.ranges_m
    if t_s - before.stage_s < TEST_S:
        return replace(before, ranges_m=read)
    if len(set(read)) == 1 and not may_repeat:
        return Settling(before.began_s, t_s, Stage.BLIND)
    stage = Stage.STANDS if _is_still(read, may_repeat=may_repeat) else Stage.SINK
    return Settling(before.began_s, t_s, stage)


def _is_still(ranges_m: tuple[float, ...], *, may_repeat: bool) -> bool:
    """Whether readings at both ends of a test agree, near the stop; too few show nothing.

    Readings that end in the very same show nothing either: a sensor that cannot read below zero and
    drifted there does not show a fall. A healthy sensor does this in one test of sixty.
    """
    if len(ranges_m) < 2 * _READINGS:
        return False
    first, last = ranges_m[:_READINGS], ranges_m[-_READINGS:]
    half = (len(ranges_m) - _READINGS) // 2
    middle_m = _median(ranges_m[half : half + _READINGS])
    bent_m = abs(_median(first) - 2.0 * middle_m + _median(last))
    leaves_m = abs(ranges_m[-1] - _median(first))
    is_pinned = len(set(ranges_m[-_PINNED:])) == 1 and not may_repeat
    is_near = _median(last) < NEAR_STOP_M
    moved_m = max(abs(_median(first) - _median(last)), leaves_m)
    return moved_m < MOVED_M and bent_m < BENT_M and is_near and not is_pinned


def _median(values: tuple[float, ...]) -> float:
    ordered = sorted(values)
    middle = len(ordered) // 2
    return 0.5 * (ordered[middle - 1] + ordered[middle])
