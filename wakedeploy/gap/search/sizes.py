"""Values, 90 % intervals and units of effects' parameters, as artefacts have them."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.fits import Fit, Model, extended
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.evidence.whiteness import whiteness
from wakedeploy.gap.search.artefacts import Round, Size, Sizes
from wakedeploy.gap.search.comparison import Comparison


def parameters(
    model: Comparison, fitted: Fit, effects: Sequence[str], unweighted: Fit | None = None
) -> Sizes:
    """Value, 90 % interval and unit of the effects' parameters, by `<effect>.<parameter>`.

    A delay includes what its input's clock took of it: within half a sample a fit may give a part
    of either to the other.

    Where the innovations are not white, the likelihood is not quite that of these data, and an
    `unweighted` fit by least squares differs from it (Hausman, Econometrica 46, 1978). The
    interval then reaches over what single episodes say under both; `mean_low` and `mean_high`
    stay the interval of the likelihood.
    """
    result = {}
    for i, free in enumerate(fitted.free):
        if free.name.split(".")[0] in effects:
            low, high = fitted.interval(free.name)
            size = Size(value=fitted.value(free.name), low=low, high=high, unit=free.unit)
            if unweighted is not None:
                ranges = [_between_episodes(f, i) for f in (fitted, unweighted)]
                size = Size(
                    value=size.value,
                    unit=free.unit,
                    low=max(min(r[0] for r in ranges), free.low),
                    high=min(max(r[1] for r in ranges), free.high),
                    mean_low=low,
                    mean_high=high,
                    least_squares=unweighted.value(free.name),
                )
            result[free.name] = _later(size, model.clock_s(fitted, free.name), free.high)
    return result


def joined_sizes(model: Comparison, found: Fit, rounds: Sequence[Round]) -> Sizes:
    """The sizes of what was found; their intervals are wider where innovations are not white."""
    plain = least_squares(model, found)
    sizes = parameters(model, found, found.hypothesis, plain)
    if plain is None:
        return sizes
    return {name: over_rounds(name, size, rounds) for name, size in sizes.items()}


def least_squares(model: Model, found: Fit) -> Fit | None:
    """The least-squares fit of what was found, if the model offers and needs one; else None.

    It needs one if it guesses its own noise and the innovations are not white.
    """
    unweighted: Callable[[], Model] | None = getattr(model, "unweighted", None)
    if unweighted is None or not found.hypothesis or whiteness(found).passes():
        return None
    plain = unweighted()
    start = fit(plain, found.hypothesis, found.episodes, extended(found, found.free))
    return settled(plain, start)[0]


def over_rounds(name: str, size: Size, rounds: Sequence[Round]) -> Size:
    """An interval that also holds what was said when the effect was accepted.

    If no hypothesis makes the innovations white, the effects beside an effect move its parameters
    by more than their intervals.
    """
    sizes = [size, *(r.accepted[name] for r in rounds if name in r.accepted)]
    ends = {"low": min(s.low for s in sizes), "high": max(s.high for s in sizes)}
    return size.model_copy(update=ends)


def _later(size: Size, by_s: float, most_s: float) -> Size:
    """A delay and both its ends later by `by_s` [s], none below 0 and none above `most_s`."""
    if by_s == 0.0:
        return size
    names = ("value", "low", "high", "mean_low", "mean_high", "least_squares")
    known = {name: getattr(size, name) for name in names}
    most_s = max(most_s, size.value)
    moved = {n: min(max(v + by_s, 0.0), most_s) for n, v in known.items() if v is not None}
    return size.model_copy(update=moved)


def _between_episodes(fitted: Fit, i: int) -> tuple[float, float]:
    """Where nine in ten episodes would put parameter `i`, with the others held.

    This is one Newton step in each episode, weighted by the episode's information on the parameter.
    """
    slope = fitted.slopes.gradient()[:, i]
    information = fitted.slopes.fisher()[:, i, i]
    known = information > 1e-3 * information.max()
    variance = np.average((slope[known] / information[known]) ** 2, weights=information[known])
    reach = float(student_t.ppf(0.95, max(int(known.sum()) - 1, 1)) * np.sqrt(variance))
    return float(fitted.theta[i]) - reach, float(fitted.theta[i]) + reach
