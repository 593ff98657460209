"""The force that a predictor is asked for: the recorded one, `lead_s` ahead of the observation."""

import math

import numpy as np

from wakedeploy.core.errors import UnusableInput

# Below this share of a sample a lead is taken to fall on the grid: 0.3 s · 10 Hz is 3 samples.
_ON_GRID = 1e-6


def shift_ahead(series: np.ndarray, lead_s: float, rate_hz: float) -> np.ndarray:
    """The series `lead_s` later, linearly interpolated between samples.

    Shapes: (T, …) -> (T − ceil(lead_s · rate_hz), …); samples whose target lies past the end are
    dropped. Raises UnusableInput for a lead that is negative or not finite.
    """
    if not 0 <= lead_s < math.inf:
        raise UnusableInput(f"A lead of {lead_s} s has to be a number of seconds, 0 or more.")
    whole, fraction = _split(lead_s * rate_hz)
    if whole >= len(series):
        return series[:0]
    if fraction == 0:
        return series[whole:]
    blend = np.float32(fraction)
    return (1 - blend) * series[whole:-1] + blend * series[whole + 1 :]


def _split(samples: float) -> tuple[int, float]:
    """A shift in samples as whole samples and the rest, the rest 0 where it is rounding."""
    whole = math.floor(samples + _ON_GRID)
    fraction = samples - whole
    return whole, fraction if fraction > _ON_GRID else 0.0
