"""Times that rise in equal steps but for their jitter: whether they do, and without the jitter."""

import numpy as np
from numpy.typing import NDArray

_JITTER = 0.5  # of the usual step


def unevenness(times_s: NDArray[np.float64]) -> int | None:
    """The sample after the first step that is not even; None where all are.

    `times_s` (n,) [s], of two samples or more. A step has to rise, and may be off by half of the
    usual one at most. A time that is no number is uneven.
    """
    steps_s = np.diff(times_s)
    usual_s = float(np.median(steps_s))
    is_even = (steps_s > 0.0) & (np.abs(steps_s - usual_s) <= _JITTER * usual_s)
    return None if is_even.all() else int(np.argmin(is_even)) + 1


def evened(times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """The even times that are nearest to some that are even but for their jitter.

    The step is that of a straight line through all of them: the usual one is wrong where a log
    rounds its times, as 7.8125 ms to whole ones.
    """
    numbers = np.arange(len(times_s)) - 0.5 * (len(times_s) - 1)
    middle_s = float(times_s.mean())
    step_s = float(numbers @ (times_s - middle_s) / (numbers @ numbers))
    return np.asarray(middle_s + step_s * numbers, dtype=np.float64)
