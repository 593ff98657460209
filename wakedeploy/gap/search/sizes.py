"""Values, 90 % intervals and units of effects' parameters, as artefacts have them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.inference import Fit, Model, extended, fit, settled
from wakedeploy.gap.evidence.whiteness import whiteness

Sizes = dict[str, dict[str, Any]]


def parameters(fitted: Fit, effects: Sequence[str], unweighted: Fit | None = None) -> Sizes:
    """Value, 90 % interval and unit of the effects' parameters, by `<effect>.<parameter>`.

    Where the innovations are not white, the likelihood is not quite that of these data, and an
    `unweighted` fit by least squares differs from it (Hausman, Econometrica 46, 1978). The
    interval then reaches over what single episodes say under both; `mean_low` and `mean_high`
    stay the interval of the likelihood.
    """
    result = {}
    for i, free in enumerate(fitted.free):
        if free.name.split(".")[0] in effects:
            low, high = fitted.interval(free.name)
            own = {"value": fitted.value(free.name), "low": low, "high": high, "unit": free.unit}
            if unweighted is not None:
                ranges = [_between_episodes(f, i) for f in (fitted, unweighted)]
                own |= {"low": max(min(r[0] for r in ranges), free.low), "mean_low": low}
                own |= {"high": min(max(r[1] for r in ranges), free.high), "mean_high": high}
                own |= {"least_squares": unweighted.value(free.name)}
            result[free.name] = own
    return result


def least_squares(model: Model, found: Fit) -> Fit | None:
    """The least-squares fit of what was found, for a model that offers one and needs it.

    It needs one where its noise is its own guess and the innovations are not white.
    """
    unweighted: Callable[[], Model] | None = getattr(model, "unweighted", None)
    if unweighted is None or not found.hypothesis or whiteness(found).passes():
        return None
    plain = unweighted()
    start = fit(plain, found.hypothesis, found.episodes, extended(found, found.free))
    return settled(plain, start)[0]


def over_rounds(name: str, entry: Mapping[str, Any], rounds: Sequence[Mapping[str, Any]]) -> Any:
    """An interval that also holds what was said when the effect was accepted.

    What stands beside an effect moves its parameters by more than their intervals where none of
    the hypotheses makes the innovations white.
    """
    earlier = [r["accepted"][name] for r in rounds if name in r.get("accepted", {})]
    low = min([entry["low"], *(e["low"] for e in earlier)])
    high = max([entry["high"], *(e["high"] for e in earlier)])
    return {**entry, "low": low, "high": high}


def _between_episodes(fitted: Fit, i: int) -> tuple[float, float]:
    """Where nine in ten episodes would put parameter `i`, the others held.

    One Newton step in each episode, weighted by what the episode tells about the parameter.
    """
    slope = fitted.slopes.gradient()[:, i]
    information = fitted.slopes.fisher()[:, i, i]
    known = information > 1e-3 * information.max()
    variance = np.average((slope[known] / information[known]) ** 2, weights=information[known])
    reach = float(student_t.ppf(0.95, max(int(known.sum()) - 1, 1)) * np.sqrt(variance))
    return float(fitted.theta[i]) - reach, float(fitted.theta[i]) + reach
