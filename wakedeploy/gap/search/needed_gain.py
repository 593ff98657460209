"""What an effect has to gain to be evident: more than chance, in more than one block.

In: a candidate's gains on blocks that it was not fitted to, and what chance brings to the best of
all. Out: the gain that it needs, and whether blocks share it.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import ttest_1samp

from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.rules import RULES


class Chance(NamedTuple):
    """What chance brings to the luckiest of all effects [nats], with and without loud moments.

    The second comes from Gaussian noise, and from constants and form as wrong as their priors
    allow.
    """

    nats: float
    without_loud_nats: float


def needed_nats(
    effect: Candidate, chance: Chance, tried: int = 1, alarms: float = RULES.steady_alarms
) -> float:
    """What an effect has to gain [nats] if `tried` effects were tried.

    A few loud moments raise what chance brings for every effect, by the gain of the one that acts
    just then. An effect that gains in block after block owes that to no moment: by the spread of
    its own gains (Student's t, shared among all that were tried) a smaller gain makes it evident.
    `alarms` is the share of cases without any effect in which one may be.
    Mostly small gains with a rare large loss would pass for steady where no block has such a loss;
    sealed blocks are asked besides.
    """
    gains = np.asarray(effect.gains)
    if len(gains) < RULES.fewest_blocks or not gains.std():
        return chance.nats
    by_data = float(gains.sum()) - effect.looked_nats  # without what priors say of parameters
    if by_data <= chance.without_loud_nats:
        return chance.nats
    by_chance = float(ttest_1samp(gains, 0.0, alternative="greater").pvalue)
    is_steady = by_chance * max(tried, 1) < alarms
    return chance.without_loud_nats if is_steady else chance.nats


def is_shared(effect: Candidate, needed: float) -> bool:
    """Whether a gain is more than one block's, and other blocks do not take it back."""
    gains = effect.gains
    if len(gains) < 2:
        return False
    least = needed * (len(gains) - 1) / len(gains)
    lost, won = -gains[gains < 0.0].sum(), gains[gains > 0.0].sum()
    return bool(effect.gain_nats - gains.max() > least and lost < 0.5 * won)
