"""How small and how large an effect may be where the likelihood is no parabola around it.

In: a fit whose curvature says that an effect's size may be 0, although the effect gains on every
block. Out: the same fit, with the ends of the interval found by fitting everything else at smaller
and larger sizes (a profile likelihood: Murphy and van der Vaart, J. Am. Stat. Assoc. 95, 2000).
"""

from dataclasses import replace

import numpy as np
from scipy.stats import t as student_t
from scipy.stats import wilcoxon

from wakedeploy.gap.evidence.fits import NO_SLOPES, Fit, FloatArray
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.climbing import climbed
from wakedeploy.gap.search.comparison import Comparison

# Of the estimate: sizes at which all else is fitted again, below it and above.
_SHARES, _TIMES = (0.5, 0.25, 0.1, 0.03), (2.0, 4.0, 10.0, 30.0)


def profiled(model: Comparison, found: Fit, name: str) -> Fit:
    """A fit whose intervals of an effect's sizes hold 0 only if the blocks allow it.

    Their other ends are as far as the blocks allow: what makes a spread so wide that it holds 0
    makes it as wide on the other side.
    """
    ends = dict(found.profiled)
    for i, free in enumerate(found.free):
        is_size = free.name.startswith(f"{name}.") and free.neutral == 0.0
        low, high = found.interval(free.name)
        if is_size and found.theta[i] != 0.0 and low <= 0.0 <= high:
            share = next((s for s in _SHARES if _is_excluded(model, found, i, s)), 0.0)
            nearest = share * float(found.theta[i])
            if nearest:
                times = (t for t in _TIMES if low <= t * float(found.theta[i]) <= high)
                most = next((t for t in times if _is_excluded(model, found, i, t)), np.inf)
                farthest = most * float(found.theta[i])
                ends[free.name] = (min(nearest, farthest), max(nearest, farthest))
    return replace(found, profiled=ends)


def _is_excluded(model: Comparison, found: Fit, i: int, share: float) -> bool:
    """Whether the blocks, by their sum and their spread, speak against a share of a size."""
    value = share * float(found.theta[i])
    free, theta = list(found.free), found.theta.copy()
    free[i], theta[i] = replace(free[i], low=value, high=value), value
    held = climbed(model, replace(found, free=tuple(free), theta=theta, slopes=NO_SLOPES))
    lost, count = found.per_episode - held.per_episode, len(found.episodes)
    quantile = float(student_t.ppf(RULES.interval_quantile, max(count - 1, 1)))
    reach = quantile * float(np.std(lost, ddof=1)) * count**0.5 if count > 1 else np.inf
    total = float(lost.sum()) + found.log_prior - held.log_prior
    return total > 0.5 * quantile**2 and (total > reach or is_steady(lost))


def is_steady(gains: FloatArray) -> bool:
    """Whether the blocks (E,) agree that something is gained, even if some gain much more.

    If an effect acts mostly in a few blocks, as drag does at speed, the blocks' mean is uncertain
    but their sign is not (signed ranks: Wilcoxon, Biometrics Bulletin 1, 1945).
    """
    if not np.any(gains):
        return False
    return float(wilcoxon(gains, alternative="greater").pvalue) < 1.0 - RULES.interval_quantile
