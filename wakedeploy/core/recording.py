"""A recording of any system: named columns over one time base, in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.even_time import unevenness


@dataclass(frozen=True)
class Origin:
    """How a column was read: its unit in the log, and whether the log itself says that unit."""

    unit: str
    is_stated: bool


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """One uninterrupted piece of a log.

    `time_s` (T,) rises in equal steps [s]; each of `columns` is (T,), by the name that the user's
    system gives it and in its unit. A sample that was not measured is NaN; an infinite one is
    refused where its column is needed. `origins` says of the columns of a log what they were read
    from; nothing of those that had a factor of their own. `clocks` says which columns were stamped
    together: those of one clock's name are, as are all columns that it does not name.

    Lists and columns of a DataFrame become arrays. Raises UnusableInput for what holds no numbers,
    columns of another length, a time that does not rise in equal steps but for a jitter, or fewer
    than two samples.
    """

    name: str
    time_s: NDArray[np.float64]
    columns: Mapping[str, NDArray[np.float64]]
    origins: Mapping[str, Origin] = field(default_factory=dict)
    clocks: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what in ("columns", "origins", "clocks"):
            self._require_named(what, getattr(self, what))
        time_s = self._numbers("time_s", self.time_s)
        columns = {name: self._numbers(f"column {name!r}", v) for name, v in self.columns.items()}
        object.__setattr__(self, "time_s", time_s)
        object.__setattr__(self, "columns", columns)
        if len(time_s) < 2:
            raise UnusableInput(f"{self.name}: {len(time_s)} samples; at least two are needed.")
        for column, values in columns.items():
            if values.shape != time_s.shape:
                raise UnusableInput(
                    f"{self.name}: column {column!r} has shape {values.shape}, the time "
                    f"has {time_s.shape}."
                )
        self._require_even()

    def _require_named(self, what: str, given: object) -> None:
        """UnusableInput for what has no names, as a list; a table of pandas has them, too."""
        items = getattr(given, "items", None)
        if not callable(items):
            example = ", as {'speed_mps': array}" if what == "columns" else ""
            raise UnusableInput(
                f"{self.name}: {what} is a {type(given).__name__}; give a dict by the names of the "
                f"columns{example}."
            )
        unnamed = next((name for name, _ in items() if not isinstance(name, str)), None)
        if unnamed is not None:
            raise UnusableInput(
                f"{self.name}: {what} has the name {unnamed!r:.60}, which is no text; give each "
                "column the name that your system has for it."
            )

    def _numbers(self, what: str, values: ArrayLike) -> NDArray[np.float64]:
        try:
            plain = np.asanyarray(values)  # as it is, if it has a mask
            # Of complex numbers and dates a part would be lost; text is not read.
            is_text = plain.dtype == object and any(isinstance(v, str | bytes) for v in plain.flat)
            if plain.ndim == 1 and plain.dtype.kind not in "cmMUS" and not is_text:
                read = plain.astype(np.float64, copy=False)
                return np.asarray(np.ma.filled(read, np.nan))
        except (TypeError, ValueError):
            pass
        raise UnusableInput(
            f"{self.name}: {what} is not an array (T,) of numbers; give real numbers, and seconds "
            "for time."
        )

    def _require_even(self) -> None:
        if not np.isfinite(self.time_s).all():
            raise UnusableInput(
                f"{self.name}: time_s holds what is no number; leave those samples out."
            )
        at = unevenness(self.time_s)
        if at is not None:
            steps = np.diff(self.time_s)
            usual = float(np.median(steps))
            beside = f", and {usual:.4g} s is usual" if usual > 0.0 else ""
            raise UnusableInput(
                f"{self.name}: time_s does not rise in equal steps: from sample {at - 1} to {at} "
                f"it goes by {steps[at - 1]:.4g} s{beside}; cut the recording there, or read its "
                "log by a columns.toml with [resample]."
            )

    def __repr__(self) -> str:
        """Its columns, and how long it is."""
        columns = ", ".join(self.columns) or "no column"
        return f"<Recording {self.name}: {columns}; {len(self.time_s)} at {self.rate_hz:g} Hz>"

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return float((len(self.time_s) - 1) / (self.time_s[-1] - self.time_s[0]))
