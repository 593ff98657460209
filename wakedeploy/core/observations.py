"""Observations as a caller gives them: numbers in the order of a predictor's channels."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import FloatArray, Quantity


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
