"""A flight that the supervisor ended soon after take-off is flown again, as at a rig.

In: how to fly with a seed, and the seeds to try. Out: the first log that is long enough, else the
last.
"""

from collections.abc import Callable, Iterable

from wakedeploy.core.rig import LOOP_RATE_HZ
from wakedeploy.core.runlog import RunLog

TRIES = 4
ENOUGH_S = 5.0  # in the air


def flown_again(
    fly: Callable[[int], RunLog], seeds: Iterable[int], enough_s: float = ENOUGH_S
) -> RunLog:
    """The first flight of more than `enough_s` in the air."""
    log = None
    for seed in seeds:
        log = fly(seed)
        if log.flying.sum() > enough_s * LOOP_RATE_HZ:
            return log
    if log is None:
        raise ValueError("no seed was given to fly with")
    return log
