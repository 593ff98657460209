"""Observations as a caller gives them: a predictor's channels in order, and in their ranges."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.caller import warn_caller
from wakedeploy.core.errors import OutOfRange, UnusableInput, one_line
from wakedeploy.core.manifest import FloatArray, ObservationChannel, Quantity

_REAL = "fiub"  # kinds of arrays that hold real numbers
_NUMBERS = (bool, int, float, np.bool_, np.integer, np.floating)  # as objects of Python
_COUNTED = re.compile(r"(_[0-9]+|Index)")
_BEYOND = 0.25  # of a range's width on either side: also ±3 m/s, read as ±5.8 kn, is outside
_ALIKE = 1e-3  # of a range's larger end: what is rounded otherwise is no other value
_OFF_RATE = 0.05  # a share of the rate; beyond, what a memory spans is another length of time
_SHARE = 0.05  # of the values that may lie further out


def series_of(observations: npt.ArrayLike, channels: Sequence[Quantity]) -> FloatArray:
    """One series (T, d) or several (B, T, d), float32, whose last axis are the channels.

    The columns of a DataFrame or a dict are taken by their names, those of an array in the
    channels' order. Raises UnusableInput for another shape, a missing column and what is no number.
    """
    names = [channel.name for channel in channels]
    table: Any = observations
    titles = _titles(table)
    if titles is not None:
        missing = [name for name in names if name not in titles]
        if missing:
            raise UnusableInput(
                f"The observations have no column {', '.join(missing)}; give {', '.join(names)}."
            )
        _require_once(names, titles, "The observations have column")
    try:
        if titles is not None:  # each has a type of its own
            columns = [real_numbers(table[name]) for name in names]
            values = np.column_stack(columns).astype(np.float32, copy=False)
        else:
            values = real_numbers(observations).astype(np.float32, copy=False)
    except ValueError as error:
        raise UnusableInput(
            f"The observations are not an array of numbers ({one_line(error)});"
            f" give (T, {len(names)}): {', '.join(names)}."
        ) from error
    if values.ndim not in (2, 3) or values.shape[-1] != len(names):
        raise UnusableInput(
            f"The observations have shape {values.shape}; give (T, {len(names)}) or"
            f" (B, T, {len(names)}): {', '.join(names)}."
        )
    return values


def _titles(table: Any) -> list[object] | None:
    """What the columns of a DataFrame or a dict are called; None where they have no names."""
    if isinstance(table, Mapping):
        return list(table)
    return list(table.columns) if hasattr(table, "columns") else None


def in_order(observation: npt.ArrayLike, channels: Sequence[Quantity]) -> npt.ArrayLike:
    """One observation in the channels' order: a row of a DataFrame and a dict go by their names.

    Whatever has no names is left as it is, also what cannot be used. Raises UnusableInput for a row
    that lacks a channel or has two of one name.
    """
    row: Any = observation
    labels = _labels(row)
    if not any(isinstance(label, str) for label in labels):
        return observation
    names = [channel.name for channel in channels]
    missing = [name for name in names if name not in labels]
    if missing:
        raise UnusableInput(
            f"The observation has no {', '.join(missing)}; give {', '.join(names)}."
        )
    _require_once(names, labels, "The observation has")
    return [row[labels.index(name)] if isinstance(row, tuple) else row[name] for name in names]


def _labels(row: Any) -> list[object]:
    """What the values of a row are called, as `iterrows` and `itertuples` give it; or nothing."""
    if isinstance(row, Mapping):
        return list(row)
    if isinstance(row, tuple):
        fields = list(getattr(row, "_fields", ()))
        # Where columns have no names, pandas counts them: _0, _1.
        return [] if all(_COUNTED.fullmatch(field) for field in fields) else fields
    labels = getattr(row, "index", None)  # which a list has, too, to call
    return [] if labels is None or callable(labels) or hasattr(row, "columns") else list(labels)


def _require_once(names: Sequence[str], labels: Sequence[object], has: str) -> None:
    """UnusableInput where two values or columns have the name of one channel."""
    for name in names:
        if (count := labels.count(name)) > 1:
            raise UnusableInput(f"{has} {name} {count} times; leave all but one out.")


def real_numbers(given: npt.ArrayLike) -> npt.NDArray[np.generic]:
    """What was given as an array of integers, floats or truth values, of any shape.

    An array of objects is one, too, where each is such a number. What a mask hides is NaN.

    ValueError says what else it holds: text, None, complex numbers, dates, lists of several
    lengths, and integers that no float can hold.
    """
    try:
        if isinstance(given, np.ma.MaskedArray) and given.dtype.kind in _REAL:
            given = np.asarray(np.ma.filled(given.astype(np.float64), np.nan))
        values = np.asarray(given)
        if values.dtype.kind == "O" and all(isinstance(v, _NUMBERS) for v in values.flat):
            values = values.astype(np.float64)  # as of a table whose columns are of several kinds
    except OverflowError as error:  # 10**400 beside a float
        raise ValueError("it holds a number that is too large") from error
    except TypeError as error:  # what cannot be an array here, as a tensor on a GPU
        raise ValueError(one_line(error)) from error
    if values.dtype.kind not in _REAL and values.size:  # an empty list or frame may be of any kind
        raise ValueError("it holds what is no number")
    return values


def warn_of_other_rate(table: Any, rate_hz: float) -> None:
    """Warn whoever called where the rows of a DataFrame come at another rate [Hz] than they should.

    Its index tells where it holds dates or durations, or seconds as `t_s`.
    """
    steps_s = _steps_s(getattr(table, "index", None))
    if not len(steps_s) or (usual_s := float(np.median(steps_s))) <= 0.0:
        return
    if abs(usual_s * rate_hz - 1.0) > _OFF_RATE:
        warn_caller(
            f"The rows are {usual_s:.4g} s apart, {1.0 / usual_s:.4g} Hz, and the predictor was"
            f" trained at {rate_hz:g} Hz: bring them to that rate. Its memory counts rows.",
            OutOfRange,
        )


_SECONDS = ("t_s", "time_s", "timestamp_s", "stamp_s", "seconds")


def _steps_s(index: Any) -> npt.NDArray[np.float64]:
    """The steps [s] of an index that tells times; none of any other."""
    kind = getattr(getattr(index, "dtype", None), "kind", "none")
    times_s = np.empty(0)
    if kind in ("m", "M"):
        stamps = index.to_numpy(dtype=f"{kind}8[ns]")
        times_s = 1e-9 * stamps[~np.isnat(stamps)].astype(np.int64)
    elif kind == "f" and str(index.name) in _SECONDS:
        times_s = index.to_numpy(dtype=np.float64)
    return np.asarray(np.diff(times_s), dtype=np.float64)


def warn_out_of_range(values: FloatArray, channels: Sequence[ObservationChannel]) -> None:
    """Warn whoever called, by `OutOfRange`, where `out_of_range` has something to say."""
    if sentence := out_of_range(values, channels):
        warn_caller(sentence, OutOfRange)


def out_of_range(values: FloatArray, channels: Sequence[ObservationChannel]) -> str | None:
    """Which channels of observations (…, d) have other values than in training, in sentences.

    Those are meant of whose values more than a twentieth lie outside the range of the training
    episodes by more than a quarter of its width, and by more than a thousandth of its larger end.
    A channel that never changed in training is told apart. None where there is no such channel.

    The control loop (`runtime.loop.safety.far_outside`) begins at half the width: a single value
    costs it the feedforward. Here many values only bring a warning, so that it may come sooner, as
    it has to: ±3 m/s read in knots reach ±5.8, which is not beyond half the width.
    """
    ranged, constant = [], []
    for each, channel in zip(values.reshape(-1, len(channels)).T, channels, strict=True):
        least, most = channel.min, channel.max
        margin = max(_BEYOND * (most - least), _ALIKE * max(abs(least), abs(most)))
        far = (each < least - margin) | (each > most + margin)
        if not far.any() or far.mean() <= _SHARE:
            continue
        unit = "" if channel.unit == "1" else f" {channel.unit}"
        here = f"{np.nanmin(each):.4g} to {np.nanmax(each):.4g}"
        if most > least:
            known = f"{least:.4g} to {most:.4g}{unit}"
            ranged.append(f"{channel.name} is {here}, in training it was {known}")
        else:
            known = f"{channel.name} never changed in training ({least:.4g}{unit})"
            constant.append(f"{known}, and is {here} here")
    sentences = [f"{'; '.join(ranged)}: check the unit."] if ranged else []
    if constant:
        sentences.append(f"{'; '.join(constant)}: its effect was not learned; check the unit too.")
    return (
        f"{' '.join(sentences)} Forces for what was never learned may be far off."
        if sentences
        else None
    )
