"""Inputs that could be given to a system, as shapes between −1 and 1 over samples.

Each is drawn from one seed, so that what was judged is what is written. Each pushes a free mass
back to where it was, since many an axis has ends.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.fits import FloatArray

_PERIODS = (400, 4)  # samples of the slowest and the fastest wave
_SEED = 4711
_RETURNING = np.array(
    [1.0, -1.0, -1.0, 1.0]
)  # a force so pushed leaves a mass at rest where it was


@dataclass(frozen=True)
class Excitation:
    """A shape: `made(n, seed)` is (n,)."""

    name: str
    description: str
    made: Callable[[int, int], FloatArray]


def _levels(hold: int, binary: bool) -> Callable[[int, int], FloatArray]:
    """Levels that are held for `hold` to three times `hold` samples, as chance has it."""

    def made(n: int, seed: int) -> FloatArray:
        random = np.random.default_rng(_SEED + seed)
        count = n // (4 * hold) + 1
        levels = random.choice((-1.0, 1.0), count) if binary else random.uniform(-1.0, 1.0, count)
        holds = np.repeat(random.integers(hold, 3 * hold + 1, count), 4)
        return np.repeat((levels[:, None] * _RETURNING).ravel(), holds)[:n]

    return made


def _sweep(n: int, seed: int) -> FloatArray:
    """A cosine from slow to fast, its frequency rising exponentially; turned over by the seed."""
    low, high = 1.0 / min(_PERIODS[0], n / 2), 1.0 / _PERIODS[1]
    ratio = np.log(high / low) / n
    phase = 2.0 * np.pi * low * (np.exp(ratio * np.arange(n)) - 1.0) / ratio
    return np.asarray((-1.0) ** seed * np.cos(phase))


def _waves(n: int, seed: int) -> FloatArray:
    """Cosines of many frequencies at once, their signs by chance; scaled into the limits."""
    random = np.random.default_rng(_SEED + seed)
    periods = np.geomspace(min(_PERIODS[0], n / 2), _PERIODS[1], 16)
    waves = random.choice((-1.0, 1.0), 16) * np.cos(2.0 * np.pi * np.arange(n)[:, None] / periods)
    total = waves.sum(1)
    return np.asarray(total / np.abs(total).max())


def _triangle(n: int, seed: int) -> FloatArray:
    """To and fro at constant speeds, slowly; another seed is slower."""
    turns = (1.0 - 0.2 * min(seed, 4)) * np.arange(n) / min(_PERIODS[0], n / 2)
    return np.asarray(4.0 * np.abs(turns - np.floor(turns + 0.5)) - 1.0)


MENU = (
    Excitation("fast-binary", "jumps between two levels, 3 to 9 samples apart", _levels(3, True)),
    Excitation(
        "slow-binary", "jumps between two levels, 20 to 60 samples apart", _levels(20, True)
    ),
    Excitation("levels", "jumps to any level, 20 to 60 samples apart", _levels(20, False)),
    Excitation("sweep", "a cosine from slow to fast", _sweep),
    Excitation("waves", "cosines of many frequencies at once", _waves),
    Excitation("triangle", "to and fro at constant speeds, slowly", _triangle),
)
