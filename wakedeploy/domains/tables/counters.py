"""Stamps of a counter that begins again at 0 where its bits end, as microseconds in 32 bits do.

In: stamps (n,) as a log has them, in whatever they count. Out: stamps that go on.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wakedeploy.domains.tables.log import Values

# What counters of 16 and 32 bits count; the latter also where a logger wrote microseconds as
# seconds or as milliseconds.
_ENDS = (2.0**16, 2.0**32, 2.0**32 / 1e6, 2.0**32 / 1e3)
_NEAR = 0.01  # of what a counter counts, within which the next stamp is the next sample's


def wrap_in(numbers: Values) -> float | None:
    """What a counter counts that begins again in these stamps; None where none does."""
    if numbers.dtype.kind not in "fiu":
        return None
    counts = _signed(numbers)
    counts = counts[np.isfinite(counts)]
    steps, first, last = np.diff(counts), counts.min(initial=0), counts.max(initial=0)
    for end in _ENDS:
        low = 0.0 if first >= 0 else -0.5 * end
        if low <= first and last < low + end and _passes(steps, end).any():
            return end
    return None


def going_on(numbers: Values, wraps_at: float) -> Values:
    """Stamps that go on where the counter began again; those of a clock that was set back stay."""
    counts = _signed(numbers)
    with np.errstate(invalid="ignore"):  # a stamp that is no number is refused later
        steps = np.diff(counts)
    return later(counts, np.insert(np.cumsum(_passes(steps, wraps_at)), 0, 0), wraps_at)


def later(counts: Values, rounds: NDArray[np.int64] | int, wraps_at: float) -> Values:
    """Stamps so many rounds of their counter later; whole numbers stay whole."""
    is_whole = counts.dtype.kind == "i" and wraps_at.is_integer()
    return np.asarray(counts + rounds * (int(wraps_at) if is_whole else wraps_at))


def begun_after(firsts: Sequence[float], wraps_at: float) -> list[bool]:
    """Of the parts of one recording, by their first stamps, those that begin after the others.

    The counter begins again between the first stamp of one part and that of another.
    """
    lag = np.array(firsts) - max(firsts, default=0.0)
    return [bool(after) for after in _passes(lag, wraps_at)]


def _signed(numbers: Values) -> Values:
    """Numbers whose differences may be negative."""
    return numbers.astype(np.int64 if numbers.dtype.kind in "iu" else np.float64)


def _passes(steps: Values, wraps_at: float) -> NDArray[np.bool_]:
    """Steps back from near the counter's end to near its begin."""
    return np.asarray((steps < 0) & (np.abs(steps + wraps_at) <= _NEAR * wraps_at))
