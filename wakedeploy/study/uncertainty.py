"""How sure an R² is: a bootstrap over blocks of time, longer than errors go together.

In: truth and errors of a split. Out: R² and its interval.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from wakedeploy.episodes import EpisodeSet

FloatArray = npt.NDArray[np.float64]

_BLOCK_WINDOWS = 4.0  # a block is so many windows long: longer than errors stay alike
_DRAWS = 2000
_FEWEST_BLOCKS = 8  # with fewer, the spread of the blocks says little


@dataclass(frozen=True)
class R2:
    """1 − mean square error over variance, with a 90 % interval (None with too few blocks)."""

    value: float
    low: float | None
    high: float | None

    @property
    def text(self) -> str:
        """The value, and its interval where there is one."""
        if self.low is None or self.high is None:
            return f"{self.value:.3f}"
        return f"{self.value:.3f} [{self.low:.3f}, {self.high:.3f}]"


def r2_with_interval(
    truth: FloatArray, error: FloatArray, block: npt.NDArray[np.int64], seed: int = 0
) -> R2:
    """R² of one channel (n,), its interval from drawing whole blocks (n,) with replacement.

    Blocks should be longer than errors stay alike: a block bootstrap (Künsch 1989). Each draw takes
    its own mean, as a recording of these blocks would have it.
    """
    _, index = np.unique(block, return_inverse=True)
    count = np.bincount(index).astype(float)
    sums = np.bincount(index, truth)
    squares = np.bincount(index, truth**2)
    errors = np.bincount(index, error**2)
    value = _r2(count.sum(), sums.sum(), squares.sum(), errors.sum())
    if len(count) < _FEWEST_BLOCKS:
        return R2(float(value), None, None)
    drawn = np.random.default_rng(seed).integers(0, len(count), (_DRAWS, len(count)))
    of = [a[drawn].sum(1) for a in (count, sums, squares, errors)]
    low, high = np.quantile(_r2(*of), [0.05, 0.95])
    return R2(float(value), float(low), float(high))


def blocks(episode: npt.NDArray[np.int64], samples: int) -> npt.NDArray[np.int64]:
    """Numbers (n,) of blocks of at most `samples` successive samples within each episode (n,)."""
    starts = np.r_[True, np.diff(episode) != 0]
    first = np.maximum.accumulate(np.where(starts, np.arange(len(episode)), 0))
    within = (np.arange(len(episode)) - first) // samples
    fresh = starts | np.r_[True, np.diff(within) != 0]
    return np.asarray(np.cumsum(fresh) - 1, dtype=np.int64)


def blocks_of(data: EpisodeSet, episode: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Blocks (n,) of successive samples, four of the set's windows long, by their episode (n,)."""
    length = max(1, round(_BLOCK_WINDOWS * data.window_s * data.rate_hz))
    return blocks(np.asarray(episode, np.int64), length)


def _r2(
    count: npt.ArrayLike, total: npt.ArrayLike, squares: npt.ArrayLike, errors: npt.ArrayLike
) -> FloatArray:
    count, total = np.asarray(count, float), np.asarray(total, float)
    spread = np.asarray(squares, float) - total**2 / count
    return np.asarray(1.0 - np.asarray(errors, float) / spread)
