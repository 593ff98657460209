"""Dry friction within a sample: it slows, holds, and lets go.

In: a speed before and after a sample without friction, what the friction's whole strength adds to
the speed in that time, and the speed over which it turns. Out: the share of its strength that acts
on average, and its slopes.

Above the turning speed all of it opposes the motion. Below, it goes over to what holds against the
pull, as far as it can (Karnopp, Journal of Dynamic Systems, Measurement, and Control 107, 1985),
so that what stands does not creep. Where pull and strength are those of the whole sample, the speed
has a closed form in each of the three parts: a motion that turns within a sample turns at its time,
and the softest and the hardest friction take the same step.
"""

import math

from wakedeploy.physics.series import FloatArray, compiled

_ASIDE = 1e-6  # of the speeds at hand, for slopes


@compiled
def borne(before: float, after: float, most: float, turning: float) -> tuple[float, float, float]:
    """Mean force over the strength, between −1 and 1, and its slopes over both speeds.

    `most` is the change of speed that the strength makes in the sample, `turning` a speed; both are
    positive.
    """
    aside = _ASIDE * (abs(before) + abs(after) + most)
    share = (_slid(before, after - before, most, turning) - after) / most
    by_before = (_slid(before + aside, after - before - aside, most, turning) - after) / most
    by_after = (_slid(before, after + aside - before, most, turning) - after - aside) / most
    return share, (by_before - share) / aside, (by_after - share) / aside


@compiled
def rubbed(
    before: FloatArray, after: FloatArray, most: FloatArray, turning: FloatArray
) -> FloatArray:
    """Speeds (L,) after a sample, of those that would be without friction; NaN stays NaN."""
    ends = after.copy()
    for lane in range(len(after)):
        if most[lane] > 0.0:
            pull = after[lane] - before[lane]
            ends[lane] = _slid(before[lane], pull, most[lane], turning[lane])
    return ends


@compiled
def _slid(speed: float, pull: float, most: float, turning: float) -> float:
    """The speed after a sample in which a pull changes it by `pull`, friction by `most` at most."""
    remaining = 1.0
    held = min(max(pull / most, -1.0), 1.0)
    low, high = -turning * (1.0 + held), turning * (1.0 - held)
    if speed > high or speed < low:
        bound, rate = (high, pull - most) if speed > high else (low, pull + most)
        lasts = (bound - speed) / rate if rate * (bound - speed) > 0.0 else math.inf
        if lasts >= remaining:
            return speed + rate * remaining
        speed, remaining = bound, remaining - lasts
    stiffness = most / turning
    if abs(pull) <= most:
        return speed * math.exp(-stiffness * remaining)
    beyond = pull - held * most
    goal = beyond / stiffness
    bound = high if beyond > 0.0 else low  # more than it can hold: it is let go there
    lasts = math.log1p((speed - bound) / (bound - goal)) / stiffness
    if lasts >= remaining:
        return speed + (speed - goal) * math.expm1(-stiffness * remaining)
    return bound + beyond * (remaining - lasts)
