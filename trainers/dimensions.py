"""What a search may change: each architecture lists its own dimensions in its own file.

A dimension carries the name of a hyper-parameter of the architecture or of a fit setting
(`trainers.training.fit.FitSettings`), and what values it may take.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Span:
    """A number between two bounds, both allowed; whole where both bounds are.

    `log` searches orders of magnitude rather than differences, `step` leaves only every step-th
    number above `low`. With `of_window` the bounds are shares of the set's window, in seconds.
    """

    name: str
    low: float
    high: float
    log: bool = False
    step: int = 1
    of_window: bool = False

    @property
    def whole(self) -> bool:
        """Whether it takes whole numbers only."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    def __str__(self) -> str:
        return f"{self.name}={self.low:g}:{self.high:g}"


@dataclass(frozen=True)
class Choice:
    """One of some values; a single one is a dimension that is held fixed."""

    name: str
    values: tuple[float, ...]

    @property
    def whole(self) -> bool:
        """Whether it takes whole numbers only."""
        return all(isinstance(value, int) for value in self.values)

    def __str__(self) -> str:
        return f"{self.name}={','.join(f'{value:g}' for value in self.values)}"


Dimension = Span | Choice

# How far back a window looks, in seconds. Trials of a search are compared where the set's own
# window is full, on the same samples; a run is scored where its own memory is full.
HISTORY = Span("history_s", 0.25, 2.0, log=True, of_window=True)

_DESCENT = (
    Span("learning_rate", 3e-4, 3e-2, log=True),
    Span("weight_decay", 1e-6, 1e-1, log=True),
)
# How predictors without carried state are fitted: windows per update.
WINDOW_FIT = (*_DESCENT, Span("batch", 32, 1024, log=True))
# And those with it: sequences side by side, and the samples that a gradient reaches back.
SEQUENCE_FIT = (
    *_DESCENT,
    Span("lanes", 4, 64, log=True),
    Span("chunk_steps", 16, 256, log=True),
)
