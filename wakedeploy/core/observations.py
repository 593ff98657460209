"""Observations as a caller gives them: a predictor's channels in order, and in their ranges."""

import warnings
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import OutOfRange, UnusableInput
from wakedeploy.core.manifest import FloatArray, ObservationChannel, Quantity

_BEYOND = 0.25  # of a range's width on either side: also ±3 m/s, read as ±5.8 kn, is outside
_SHARE = 0.05  # of the values that may lie further out


def series_of(observations: npt.ArrayLike, channels: Sequence[Quantity]) -> FloatArray:
    """One series (T, d) or several (B, T, d), float32, whose last axis are the channels.

    The columns of a DataFrame are taken by their names, those of an array in the channels' order.
    Raises UnusableInput for another shape, a missing column and what is no number.
    """
    names = [channel.name for channel in channels]
    if hasattr(observations, "columns"):
        missing = [name for name in names if name not in observations.columns]
        if missing:
            raise UnusableInput(
                f"The observations have no column {', '.join(missing)}; give {', '.join(names)}."
            )
        observations = observations[names]  # type: ignore[index]
    try:
        values = np.asarray(observations, dtype=np.float32)
    except (ValueError, TypeError) as error:
        raise UnusableInput(
            f"The observations are not an array of numbers ({error}); give (T, {len(names)}):"
            f" {', '.join(names)}."
        ) from error
    if values.ndim not in (2, 3) or values.shape[-1] != len(names):
        raise UnusableInput(
            f"The observations have shape {values.shape}; give (T, {len(names)}) or"
            f" (B, T, {len(names)}): {', '.join(names)}."
        )
    return values


def warn_out_of_range(values: FloatArray, channels: Sequence[ObservationChannel]) -> None:
    """Warn who called the caller, by `OutOfRange`, where `out_of_range` has something to say."""
    if sentence := out_of_range(values, channels):
        warnings.warn(sentence, OutOfRange, stacklevel=3)


def out_of_range(values: FloatArray, channels: Sequence[ObservationChannel]) -> str | None:
    """Which channels of observations (…, d) have other values than in training, in a sentence.

    Those are meant of whose values more than a twentieth lie outside the range of the training
    episodes by more than a quarter of its width. None where there is no such channel.
    """
    found = []
    for each, channel in zip(values.reshape(-1, len(channels)).T, channels, strict=True):
        margin = _BEYOND * (channel.max - channel.min)
        far = (each < channel.min - margin) | (each > channel.max + margin)
        if far.any() and far.mean() > _SHARE:
            found.append(
                f"{channel.name} is {np.nanmin(each):.3g} to {np.nanmax(each):.3g}, in training it"
                f" was {channel.min:.3g} to {channel.max:.3g} {channel.unit}"
            )
    if not found:
        return None
    return f"{'; '.join(found)}: check the unit. Forces for what was never learned may be far off."
