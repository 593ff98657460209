"""Two effects tried together before a long expression is believed.

A search that adds one effect after another misses two that explain only together: neither gains
enough alone, and an expression of three terms imitates both.

In: a base, a first ranking. Out: the pair that gains most, if two effects do better than chance.
"""

from collections.abc import Sequence

from wakedeploy.gap.evidence.expected_gains import promises
from wakedeploy.gap.evidence.fits import Fit, extended
from wakedeploy.gap.evidence.inference import fit, gain_over
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.refitting import refitted
from wakedeploy.physics.effects import LIBRARY

_FIRST, _SECOND = 3, 2  # how many of the ranking start a pair, and how many join each


def best_pair(
    model: GantryModel, base: Fit, ranking: Sequence[Candidate]
) -> tuple[GantryModel, Fit, float] | None:
    """The pair, refitted around its own motion, and its gain [nats] on flights held out.

    None if the ranking has fewer than two effects.
    """
    names = [c.name for c in ranking]
    found: dict[frozenset[str], tuple[float, Fit]] = {}
    for first in ranking[:_FIRST]:
        others = [n for n in names if n != first.name]
        promised = dict(zip(others, promises(model, first.fit, others), strict=True))
        for second in sorted(others, key=lambda n: -promised[n])[:_SECOND]:
            if frozenset((first.name, second)) not in found:
                pair = _fitted(model, first.fit, second)
                found[frozenset((first.name, second))] = (pair.objective, pair)
    if not found:
        return None
    _, best = max(found.values(), key=lambda pair: pair[0])
    near, fitted = refitted(model, best)
    return near, fitted, gain_over(base, fitted)


def _fitted(model: GantryModel, first: Fit, second: str) -> Fit:
    """A fit of both effects; the second starts at the first of its starts."""
    hypothesis = (*first.hypothesis, second)
    free = model.free(hypothesis)
    start = extended(first, free)
    for i, f in enumerate(free):
        if f.name.startswith(f"{second}.") and second in LIBRARY and f.starts:
            start[i] = f.starts[0]
    return fit(model, hypothesis, first.episodes, start)
