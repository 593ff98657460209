"""What an input does between two samples: it is held, goes straight to the next, or is smooth.

In: samples of an input, and how it holds. Out: what it is in every step of the model. If a sampled
signal is held, it lags by half a sample, which hides whatever else a fast system lacks.
"""

import numpy as np
import numpy.typing as npt
from scipy.signal import firwin, resample_poly

FloatArray = npt.NDArray[np.float64]

_REACH = 16  # samples on either side that a band-limited value is made of
_BETA = 8.0  # of Kaiser's window: 80 dB


def between(samples: FloatArray, hold: str, steps: int) -> FloatArray:
    """The input in the middle of `steps` equal steps after every sample, (n,) to (n · steps,).

    "step" holds a sample, "linear" goes straight to the next. "bandlimited" is the signal without
    anything above half the samples' rate (Shannon, Proc. IRE 37, 1949); within a tenth of that rate
    it is damped, and beside a jump it overshoots.
    """
    n = len(samples)
    if hold == "step" or n < 2:
        return np.repeat(samples, steps)
    if hold == "linear":
        middles = (np.arange(n * steps) + 0.5) / steps
        return np.asarray(np.interp(middles, np.arange(n), samples))
    half = 1 / (2 * steps)  # of the finer signal's rate; every second value is a middle
    low_pass = firwin(4 * _REACH * steps + 1, half, window=("kaiser", _BETA))
    return np.asarray(resample_poly(samples, 2 * steps, 1, window=low_pass, padtype="line"))[1::2]
