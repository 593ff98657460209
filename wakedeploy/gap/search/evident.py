"""What an effect has to gain to be evident: more than chance, in more than one block.

In: a candidate's gains on blocks that it was not fitted to, and what chance brings to the best of
all. Out: the gain that is asked of it, and whether blocks share it.
"""

import numpy as np
from scipy.stats import ttest_1samp

from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.rules import RULES

_FEWEST = 6  # blocks whose spread says something
_STEADY = 0.01  # of searches where nothing is missing: those in which chance gains so steadily


def needed_nats(effect: Candidate, chance: float, tried: int) -> float:
    """What an effect has to gain [nats], of as many as were `tried`.

    `chance` is what noise brings to the luckiest of all. A few loud moments raise it for every
    effect, by what the one brings that acts just there. An effect that gains in block after block
    owes that to no moment: by the spread of its own gains (Student's t, shared among all that were
    tried) it is evident, and has to gain no more than the least that is ever named.
    """
    gains = np.asarray(effect.gains)
    if len(gains) < _FEWEST or not gains.std():
        return chance
    by_chance = float(ttest_1samp(gains, 0.0, alternative="greater").pvalue)
    return min(chance, RULES.least_nats) if by_chance * max(tried, 1) < _STEADY else chance


def is_shared(effect: Candidate, needed: float) -> bool:
    """Whether a gain is more than one block's, and not taken back by others."""
    gains = effect.gains
    if len(gains) < 2:
        return False
    least = needed * (len(gains) - 1) / len(gains)
    lost, won = -gains[gains < 0.0].sum(), gains[gains > 0.0].sum()
    return bool(effect.gain_nats - gains.max() > least and lost < 0.5 * won)
