"""A recording of any system: named columns over one time base, in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput


@dataclass(frozen=True)
class Origin:
    """How a column was read: its unit in the log, and whether the log itself says that unit."""

    unit: str
    is_stated: bool


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """One uninterrupted piece of a log.

    `time_s` (T,) rises in equal steps [s]; each of `columns` is (T,), by the name that the user's
    system gives it and in its unit. A sample that was not measured is NaN. `origins` says of the
    columns of a log what they were read from; nothing of those that had a factor of their own.
    `clocks` says which columns were stamped together: those of one clock's name are, as are all
    columns that it does not name.

    Raises UnusableInput for columns of another length, or fewer than two samples.
    """

    name: str
    time_s: NDArray[np.float64]
    columns: Mapping[str, NDArray[np.float64]]
    origins: Mapping[str, Origin] = field(default_factory=dict)
    clocks: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.time_s) < 2:
            raise UnusableInput(
                f"{self.name}: {len(self.time_s)} samples; at least two are needed."
            )
        for column, values in self.columns.items():
            if np.shape(values) != np.shape(self.time_s):
                raise UnusableInput(
                    f"{self.name}: column {column!r} has shape {np.shape(values)}, the time "
                    f"has {np.shape(self.time_s)}."
                )

    def __repr__(self) -> str:
        """Its columns, and how long it is."""
        columns = ", ".join(self.columns) or "no column"
        return f"<Recording {self.name}: {columns}; {len(self.time_s)} at {self.rate_hz:g} Hz>"

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return float((len(self.time_s) - 1) / (self.time_s[-1] - self.time_s[0]))
