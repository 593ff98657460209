"""What the flights would have shown: how large each effect must be for the search to find it.

In: an `Answer`. Out: a size per effect of the library that was not found; NaN where no size within
its bounds would have been found, or where that cannot be known.
"""

import math

from wakedeploy.gap.evidence.separation import Explained, explained, information
from wakedeploy.gap.rules import surely_nats
from wakedeploy.gap.systems.gantry.findings import Detectable
from wakedeploy.gap.systems.gantry.search.outcome import Answer
from wakedeploy.physics.effects import LIBRARY

_AGREE = 2.0  # nats by slope over nats by size: farther apart, the effect is not linear


def detectable(answer: Answer) -> dict[str, Detectable]:
    """For each effect the size of its first parameter that four data sets of five would show.

    What an effect would gain follows from the slope of the innovations without it. Where their
    change at the size found is another, as for a dead band, the size is not `known`.
    """
    least = answer.thresholds.effect_nats + 1.0  # leaving an episode out costs a parameter one nat
    nats = surely_nats(least)
    sizes, beside = {}, explained(answer.fit)
    for name in LIBRARY:
        if name in answer.fit.hypothesis or name in {e.name for e in answer.model.rig.effect}:
            continue
        first = LIBRARY[name].parameters[0]
        size, known = _size(answer, beside, name, nats)
        sizes[name] = Detectable(parameter=first.name, size=size, unit=first.unit, known=known)
    return sizes


def _size(answer: Answer, beside: Explained, name: str, nats: float) -> tuple[float, bool]:
    """The size, or NaN for one out of bounds, and whether it can be known at all."""
    first = LIBRARY[name].parameters[0]
    model, base = answer.model, answer.fit
    per_square = 0.5 * float(information(model, base, beside, name)[0, 0])
    widest = first.high - first.low
    size = min(math.sqrt(nats / max(per_square, 1e-12)), widest)
    there = 0.5 * size**2 * float(information(model, base, beside, name, size)[0, 0])
    by_slope = per_square * size**2
    if max(there, by_slope) < nats / _AGREE:
        return math.nan, True
    if not by_slope / _AGREE < there < by_slope * _AGREE:
        return math.nan, False
    return (size, True) if size < widest else (math.nan, True)
