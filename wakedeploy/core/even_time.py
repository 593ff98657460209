"""Times that rise in equal steps but for their jitter: whether they do, and without the jitter.

Also the rate that was meant, where a clock only just misses it.
"""

import numpy as np
from numpy.typing import NDArray

RATES_DIFFER = 0.01  # a share; what runs at rates as near as that counts as running alike
_JITTER = 0.5  # of the usual step
_CLOCK_OFF = 1e-4  # a share, by which the clock that stamps samples may miss the rate
_FEW_DIGITS = (1, 2, 3)


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


def meant_hz(rate_hz: float) -> float:
    """The rate [Hz] that a measured one stands for: of few digits, or that of a step of few digits.

    Stamps of a 50 Hz log tell 50.0002 Hz and those of the next one 49.9998 Hz. 33.3333 Hz stays:
    its step is 0.03 s. A rate that is near neither keeps six digits.
    """
    round_rates = [float(f"{rate_hz:.{digits}g}") for digits in _FEW_DIGITS]
    round_steps = [1.0 / float(f"{1.0 / rate_hz:.{digits}g}") for digits in _FEW_DIGITS]
    near = (r for r in round_rates + round_steps if abs(r / rate_hz - 1.0) <= _CLOCK_OFF)
    return float(f"{next(near, rate_hz):.6g}")
