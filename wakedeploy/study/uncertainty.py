"""How sure a number is that was measured on some recordings: their unit is drawn, not the sample.

In: truth and errors of a split. Out: R² and errors with intervals. The unit is what the split keeps
together: a group of episodes where the set states groups, else an episode, and blocks of time where
there is but one of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from wakedeploy.core.episodes import EpisodeSet

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

GROUPS = "groups"  # of a set's provenance: which episodes its split keeps together
FEWEST = 8  # units: with fewer, drawing them says too little of how they differ
_FEWEST_OF_ALL = 3
_BLOCK_WINDOWS = 4.0  # a block's length in windows: longer than errors stay alike
_DRAWS = 2000
_TAIL = 0.05


@dataclass(frozen=True)
class R2:
    """1 − mean square error over variance, with a 90 % interval (None with too few units)."""

    value: float
    low: float | None
    high: float | None

    @property
    def text(self) -> str:
        """The value, and its interval where there is one."""
        if self.low is None or self.high is None:
            return f"{self.value:.3f}"
        return f"{self.value:.3f} [{self.low:.3f}, {self.high:.3f}]"


def spread(values: Sequence[float], form: str) -> str:
    """Mean ± standard deviation over seeds."""
    mean = format(float(np.mean(values)), form)
    if len(values) < 2:
        return mean
    return f"{mean} ± {format(float(np.std(values, ddof=1)), '.1g')}"


def interval(of: Callable[[FloatArray], FloatArray], units: int) -> tuple[float, float] | None:
    """90 % interval of a statistic of `units` units; None with fewer than three.

    `of` tells the statistic (D,) from how often each unit counts (D, units). From `FEWEST` units on
    they are drawn with replacement (for blocks of time: Künsch 1989). A draw of fewer hardly varies
    as they do, and its interval would be too narrow: there it is Student's t with the standard
    error of leaving one unit out at a time (the jackknife), which is wide.
    """
    if units < _FEWEST_OF_ALL:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        if units >= FEWEST:
            even = np.full(units, 1.0 / units)
            times = np.random.default_rng(0).multinomial(units, even, _DRAWS)
            low, high = np.quantile(of(times.astype(float)), [_TAIL, 1.0 - _TAIL])
        else:
            without = of(1.0 - np.eye(units))
            error = np.sqrt((units - 1) / units * np.sum((without - without.mean()) ** 2))
            reach = float(student.ppf(1.0 - _TAIL, units - 1)) * error
            value = float(of(np.ones((1, units)))[0])
            low, high = value - reach, value + reach
    return (float(low), float(high)) if np.isfinite([low, high]).all() else None


def sums(truth: FloatArray, error: FloatArray, unit: IntArray) -> FloatArray:
    """What R² and RMSE are made of, by unit: (4, U), for truth, error and unit (n,) of a channel.

    Rows: how many samples, the sum of the truth, of its squares, of the errors' squares.
    """
    _, index = np.unique(unit, return_inverse=True)
    rows = (None, truth, truth**2, error**2)
    return np.array([np.bincount(index, row) for row in rows], float)


def r2_of(by_unit: FloatArray) -> R2:
    """R² of sums by unit (S, 4, U), the mean over seeds, and the interval of that mean.

    Each draw takes its own mean of the truth, as a recording of these units would have it.
    """
    units = by_unit.shape[-1]
    value = 1.0 - float(_unexplained(by_unit, np.ones((1, units)))[0])
    # By its logarithm, so that no interval ends beyond 1.
    found = interval(lambda times: np.asarray(np.log(_unexplained(by_unit, times))), units)
    if found is None:
        return R2(value, None, None)
    return R2(value, 1.0 - float(np.exp(found[1])), 1.0 - float(np.exp(found[0])))


def rmse_interval(by_unit: FloatArray) -> tuple[float, float] | None:
    """90 % interval of the RMSE of sums by unit (S, 4, U), the mean over seeds."""

    def of(times: FloatArray) -> FloatArray:
        squares, count = by_unit[:, 3] @ times.T, by_unit[:, 0] @ times.T  # (S, D)
        return np.asarray(np.log(np.sqrt(squares / count).mean(0)))

    found = interval(of, by_unit.shape[-1])
    return None if found is None else (float(np.exp(found[0])), float(np.exp(found[1])))


def r2_with_interval(truth: FloatArray, error: FloatArray, unit: IntArray) -> R2:
    """R² of one channel (n,) with its interval, from the unit (n,) of each sample."""
    return r2_of(sums(truth, error, unit)[None])


def units_of(
    data: EpisodeSet, episode: npt.ArrayLike, *, warm_up: int | None = None, lead_s: float = 0.0
) -> IntArray:
    """The unit (n,) of each scored test sample, from a number of its episode (n,) that rises.

    Samples are scored after `warm_up` samples (None: the set's) and have a target `lead_s` later.
    With one unit only, blocks of successive samples, four of the set's windows long, take its
    place: their interval says nothing of other recordings.
    """
    from trainers.training.targets import shift_ahead

    warm = data.warm_up_steps if warm_up is None else warm_up
    kept = [
        e.name for e in data.part("test") if len(shift_ahead(e.force, lead_s, data.rate_hz)) > warm
    ]
    groups = data.provenance.get(GROUPS)
    named = groups if isinstance(groups, dict) else {}
    names = [str(named.get(name, f"episode {name}")) for name in kept]
    found, number = np.unique(np.asarray(episode, np.int64), return_inverse=True)
    if len(found) != len(names):
        raise ValueError(f"samples of {len(found)} episodes, where {len(names)} are scored")
    if len(set(names)) > 1:
        return np.asarray(np.unique(names, return_inverse=True)[1][number], dtype=np.int64)
    length = max(1, round(_BLOCK_WINDOWS * data.window_s * data.rate_hz))
    return blocks(number.astype(np.int64), length)


def blocks(episode: IntArray, samples: int) -> IntArray:
    """Numbers (n,) of blocks of at most `samples` successive samples within each episode (n,)."""
    starts = np.r_[True, np.diff(episode) != 0]
    first = np.maximum.accumulate(np.where(starts, np.arange(len(episode)), 0))
    within = (np.arange(len(episode)) - first) // samples
    fresh = starts | np.r_[True, np.diff(within) != 0]
    return np.asarray(np.cumsum(fresh) - 1, dtype=np.int64)


def _unexplained(by_unit: FloatArray, times: FloatArray) -> FloatArray:
    """1 − R², the mean over seeds: (S, 4, U), (D, U) -> (D,)."""
    count, total, squares, errors = np.moveaxis(by_unit @ times.T, 1, 0)  # (S, D) each
    return np.asarray((errors / (squares - total**2 / count)).mean(0))
