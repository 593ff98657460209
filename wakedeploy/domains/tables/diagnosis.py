"""Why a log has no stretch that all of its columns cover: clocks apart, or a wrong unit of time.

In: a clock, or columns with their stamps, and what `columns.toml` asks for. Out: a sentence with
what to do.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import Columns
from wakedeploy.domains.tables.log import Values
from wakedeploy.domains.tables.series import Place, Series

_MOST_TICKS = 50.0  # to a sample of the column that has most: more say that the unit is wrong
_FEW_STAMPS = 10  # may be of one moment
_LITTLE = 0.5  # of the shorter of two columns, that both cover


def require_running(place: Place, stamps: Values) -> None:
    """Refuse a clock that stands still: a header that nobody fills, a date in single precision."""
    if place.clock is None or len(stamps) < _FEW_STAMPS or (stamps != stamps[0]).any():
        return
    advice = clock_instead(place) or "give another column of stamps, or [time] rate_hz"
    raise place.clock_refused(f"stands still at {stamps[0]}", advice)


def clock_instead(place: Place) -> str:
    """The advice to leave out a clock where the log has one by itself; empty where it has none."""
    beside = place.log.clock_of(place.addresses[0])
    if beside is None or place.clock is None or beside.address == place.clock.address:
        return ""
    return f"leave it out: {beside.address} counts then"


def require_likely_rate(series: Sequence[Series], columns: Columns) -> None:
    """Refuse a rate at which nearly every tick would be without a sample of any column."""
    fastest = min((c for c in series if not c.is_event), key=_usual_step_s, default=None)
    if fastest is None or columns.resample is None:
        return
    rate_hz = columns.resample.rate_hz
    if np.isfinite(_usual_step_s(fastest)) and _usual_step_s(fastest) * rate_hz > _MOST_TICKS:
        raise fastest.place.clock_refused(
            f"{_pace(fastest)}, and [resample] rate_hz = {rate_hz:g} asks for"
            f" {_usual_step_s(fastest) * rate_hz:.3g} ticks to each",
            f"{_unit_advice(fastest)}; else give a lower rate_hz",
        )


def require_common_time(series: Sequence[Series]) -> None:
    """Refuse columns so far apart that one would be held for longer than the other lasts."""
    late, early = _extremes(series)
    if late is None or early is None:
        return
    apart_s = _span_s(late)[0] - _span_s(early)[1]
    if apart_s > max(float(np.ptp(_span_s(column))) for column in (late, early)):
        raise _apart(late, early)


def no_stretch(path: Path, series: Sequence[Series], columns: Columns) -> UnusableInput:
    """The sentence for a log whose columns have nothing in common that could be used."""
    late, early = _extremes(series)
    if late and early and _span_s(late)[0] > _span_s(early)[1]:
        return _apart(late, early)
    for found in (_torn(series, columns), _short(series, columns)):
        if found is not None:
            return found
    return UnusableInput(
        f"{path}: has no stretch in which all columns have samples; look at its gaps"
        " and missing values, or use fewer columns."
    )


def far_apart(series: Sequence[Series]) -> Iterator[str]:
    """A remark on the two columns that have least in common, where that is little."""
    late, early = _extremes(series)
    if late is None or early is None or late is early:
        return
    (late_s, late_end_s), (early_s, early_end_s) = _span_s(late), _span_s(early)
    common_s = min(late_end_s, early_end_s) - late_s
    if 0.0 <= common_s < _LITTLE * min(late_end_s - late_s, early_end_s - early_s):
        yield (
            f"{late.place.log.path}, column {late.place.address!r}: begins"
            f" {late_s - early_s:.4g} s after {early.place.address!r}, and both cover only"
            f" {common_s:.4g} s; if their clocks differ, give shift_s in [columns.{late.name}]"
        )


def _apart(late: Series, early: Series) -> UnusableInput:
    shift_s = _span_s(early)[0] - _span_s(late)[0]
    return late.place.refused(
        f"begins at {_span_s(late)[0]:.6g} s, when {early.place.address!r} has ended at"
        f" {_span_s(early)[1]:.6g} s",
        f"if their clocks differ, give the seconds between them as shift_s in"
        f" [columns.{late.name}]: shift_s = {shift_s + late.wanted.column.shift_s:.6g} lets both"
        " begin together",
    )


def _torn(series: Sequence[Series], columns: Columns) -> UnusableInput | None:
    """For a gap that lies between any two samples of a column."""
    gap_s = columns.split.gap_s
    slow = [c for c in series if not c.is_event and gap_s and _usual_step_s(c) > gap_s]
    if not slow:
        return None
    return slow[0].place.clock_refused(
        f"{_pace(slow[0])}, and [split] gap_s = {gap_s:g} ends a recording after each",
        f"{_unit_advice(slow[0])}; else give a longer gap_s",
    )


def _short(series: Sequence[Series], columns: Columns) -> UnusableInput | None:
    """For a log that is over before the second tick, or shorter than what is left out."""
    rate_hz = columns.resample.rate_hz if columns.resample else np.inf
    for column in series:
        lasts_s = float(np.ptp(_span_s(column)))
        if column.is_event or lasts_s > max(columns.split.shortest_s, 1.0 / rate_hz):
            continue
        asked = f"[resample] rate_hz = {rate_hz:g} has no two ticks in it"
        if lasts_s < columns.split.shortest_s:
            asked = f"[split] shortest_s = {columns.split.shortest_s:g} leaves that out"
        return column.place.clock_refused(
            f"{_pace(column)}, and {asked}", f"{_unit_advice(column)}; else give a longer log"
        )
    return None


def _extremes(series: Sequence[Series]) -> tuple[Series | None, Series | None]:
    """The column that begins last, and the one that ends first."""
    lasting = [column for column in series if not column.is_event]
    return (
        max(lasting, key=lambda column: _span_s(column)[0], default=None),
        min(lasting, key=lambda column: _span_s(column)[1], default=None),
    )


def _span_s(column: Series) -> tuple[float, float]:
    """Where a column's first and last numbers are."""
    stamps_s, _ = column.with_numbers()
    return float(stamps_s[0]), float(stamps_s[-1])


def _usual_step_s(column: Series) -> float:
    stamps_s, _ = column.with_numbers()
    return float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else np.inf


def _pace(column: Series) -> str:
    lasts_s = float(np.ptp(_span_s(column)))
    return f"has a sample every {_usual_step_s(column):.4g} s and lasts {lasts_s:.4g} s"


def _unit_advice(column: Series) -> str:
    lasts_s = float(np.ptp(_span_s(column)))
    return f"if it did not last {lasts_s:.4g} s, the time's unit is wrong: {_where(column)}"


def _where(column: Series) -> str:
    """The entry that says how a column's time counts."""
    clock = column.place.clock
    if clock is None:
        return "correct [time] rate_hz"
    if column.wanted.column.time is not None:
        return f"it is {clock.unit!r}; correct time_unit in [columns.{column.name}]"
    return f"it is {clock.unit!r}; correct unit in [time]"
