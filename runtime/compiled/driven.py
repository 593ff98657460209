"""Inputs that a self-test makes by itself: the same numbers in C and in Python.

Every channel goes in straight lines from one level to the next, 16 steps apart; the levels are
drawn over the range seen in training, by a linear congruential generator (Knuth's constants).
"""

import numpy as np

from wakedeploy.core.manifest import PARITY_STEPS, FloatArray, Manifest

HELD = 16  # steps from one level to the next
FACTOR, INCREMENT = 1664525, 1013904223
LEVELS = 65535  # the highest level


def driven(manifest: Manifest, steps: int = PARITY_STEPS) -> FloatArray:
    """Observations (T, d) within the ranges that the manifest says were seen."""
    d, knots = len(manifest.observation), -(-steps // HELD) + 1
    levels = _levels(knots * d).reshape(knots, d)  # (knots, d)
    place = np.arange(HELD)[None, :, None]
    between = levels[:-1, None] * (HELD - place) + levels[1:, None] * place  # (knots - 1, 16, d)
    share = between.reshape(-1, d)[:steps].astype(np.float32) / np.float32(HELD * LEVELS)
    low, high = (
        np.array([getattr(c, end) for c in manifest.observation], np.float32)
        for end in ("min", "max")
    )
    made: FloatArray = low + (high - low) * share
    return made


def _levels(count: int) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    state, drawn = 1, np.empty(count, np.int64)
    for i in range(count):
        state = (state * FACTOR + INCREMENT) & 0xFFFFFFFF
        drawn[i] = state >> 16
    return drawn
