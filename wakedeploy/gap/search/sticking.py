"""Constant effects beside a dry friction, begun away from 0.

In: a `Comparison` and a fit that has a friction. Out: fits of such effects. A friction holds a
small push as if there were none, and a lasting push takes up what is left of it. So a weight may
promise nothing at 0 beside the friction that bears it, and a climb from there ends where it began.
"""

from collections.abc import Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import (
    Fit,
    densities,
    extended,
    own_places,
    scores_of,
)
from wakedeploy.gap.search.climbing import begun, raced
from wakedeploy.gap.search.comparison import Comparison
from wakedeploy.gap.search.first_look import starts_of


def begun_moving(model: Comparison, base: Fit, names: Sequence[str]) -> dict[str, Fit]:
    """Those of the effects that a friction of the base may hold, raced from away from 0."""
    held = [name for name in model.held_by_friction(base.hypothesis) if name in names]
    return dict(zip(held, raced(model, base, [_start(model, base, n) for n in held]), strict=True))


def _start(model: Comparison, base: Fit, name: str) -> Fit:
    """An effect at its usual size, on the side on which it is better there."""
    hypothesis = (*base.hypothesis, name)
    free = model.free(hypothesis)
    starts = np.array(starts_of(extended(base, free), free, own_places(free, name)))
    scored = scores_of(model, hypothesis, starts, base.episodes)
    heights = np.nan_to_num([densities(scores).sum() for scores in scored], nan=-np.inf)
    return begun(model, hypothesis, base, starts[int(np.argmax(heights))])
