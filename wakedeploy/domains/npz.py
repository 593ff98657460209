"""Recordings in `.npz` files: arrays of real numbers, each of the shape that it has to have.

In: a file, and which keys are wanted. Out: its arrays. What cannot be a measurement is refused with
file, key and reason.
"""

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.archive import read_archive
from wakedeploy.core.errors import UnusableInput, one_line

_UNEVEN = 0.2  # of a sample period, by which one step may be off
_OFF = 0.01  # of the rate, by which all steps together may be off
_ABSURD = 1e6  # in SI units, no vehicle and no motor has so much of anything

Arrays = Mapping[str, NDArray[np.generic]]
Vector = NDArray[np.float64]


def read_arrays(file: Path, keys: Collection[str] | None = None) -> Arrays:
    """All arrays of a file, or those of `keys` that it has; UnusableInput if it is damaged."""
    try:
        return read_archive(file, keys)
    except (OSError, ValueError) as error:
        raise UnusableInput(
            f"{file}: cannot be read ({one_line(error)}); fetch it again."
        ) from error


def column(
    file: Path, arrays: Arrays, key: str, shape: tuple[int | None, ...], most: float = _ABSURD
) -> Vector:
    """An array of real numbers of a shape, None standing for any length; none beyond `most`."""
    if key not in arrays:
        raise refused(file, key, "is missing")
    array = arrays[key]
    if array.dtype.kind not in "fiu":
        raise refused(file, key, "does not hold real numbers")
    fits = len(array.shape) == len(shape) and all(
        wanted in (None, had) for wanted, had in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("n" if length is None else str(length) for length in shape)
        wanted += "," * (len(shape) == 1)
        raise refused(file, key, f"has shape {array.shape}, not ({wanted})")
    values = array.astype(np.float64)
    for wrong, reason in (
        (~np.isfinite(values), "is not finite"),
        (np.abs(values) > most, "is too large for a measurement"),
    ):
        if wrong.any():
            first = np.argwhere(wrong)[0]
            there = f", column {first[1]}" if len(first) > 1 else ""
            raise refused(file, key, f"{reason} at sample {first[0]}{there}")
    return values


def clock(file: Path, arrays: Arrays, key: str, length: int | None = None) -> Vector:
    """Times (n,) [s], which may count from any year."""
    return column(file, arrays, key, (length,), most=np.inf)


def require_even(file: Path, key: str, time_s: Vector, rate_hz: float, first: int = 0) -> None:
    """Refuse times (n,) [s] that do not rise evenly at `rate_hz`.

    `first` is the number of their first sample in the file.
    """
    steps_s = np.diff(time_s)
    if (steps_s <= 0.0).any():
        raise refused(file, key, f"does not rise at sample {first + np.argmax(steps_s <= 0.0) + 1}")
    uneven = np.abs(steps_s * rate_hz - 1.0) > _UNEVEN
    if uneven.any():
        at = int(np.argmax(uneven))
        reason = f"steps by {steps_s[at]:.4g} s after sample {first + at}, not by {1 / rate_hz:g} s"
        raise refused(file, key, reason)
    if len(steps_s) and abs(float(steps_s.mean()) * rate_hz - 1.0) > _OFF:
        raise refused(file, key, f"runs at {1 / steps_s.mean():.4g} Hz, not at {rate_hz:g} Hz")


def refused(file: Path, key: str, reason: str) -> UnusableInput:
    """The sentence for a file that cannot be used because of what is under a key."""
    return UnusableInput(f"{file}: {key}: {reason}; fetch the file again or leave it out.")
