"""A first `columns.toml` for a log: what can be seen in it, each guess marked as one.

In: a log, or a folder of logs. Out: the text of a file that is read as it is once a person has
given some of its columns a role. What cannot be seen (a rate that no file tells) is left so that
reading refuses it by name.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.units import si_unit
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.log import Field, Log, Values, is_log, open_log
from wakedeploy.domains.tables.resampling import unevenness
from wakedeploy.domains.tables.stamps import (
    as_floats,
    as_numbers,
    in_seconds,
    origin_s,
    seconds_in,
    whole_start_s,
)

Vector = NDArray[np.float64]

_MOST_COLUMNS = 400
_SHORT_RUN = 2.0  # rows with a number; longer runs are of one clock, with samples that are lost
_LATEST_S = 1e12
_LIKELY_HZ = (0.05, 50_000.0)
_TIME_NAMES = (
    r"t|time|times?tamp|stamps?|t_s|time_s|sec|secs|seconds|zeit|clock",
    r"(control|state|log|sensor)?_?(time|timestamp|stamp|t)(_?(s|ms|us|ns|sec|usec))?",
    r".*time.*|.*stamp.*",
)
_LARGEST = 1e30  # of a stamp; no damaged file overflows
_FEW_STAMPS, _EVEN = 10, 0.5  # fewer say nothing; spread of most steps over the usual one
_FORMS = ("iso", "%Y-%m-%d %H:%M:%S:%f", "%d.%m.%Y %H:%M:%S", "%H:%M:%S.%f", "%H:%M:%S")
_UNITS_BY_NAME = (  # the end of a name, or a word in it
    (r"gyro.*rad(\[\d\])?$|_rad_?p?e?r?_?s$|rad/s", "rad/s"),
    (r"_m_s2?(\[\d\])?$", "m/s^2"), (r"_mps2$", "m/s^2"), (r"_mps$", "m/s"),
    (r"_dps$|_deg_?p?e?r?_?s$|deg/s", "deg/s"), (r"_mnm$", "mN m"), (r"_pct$|_percent$", "%"),
    (r"_nm$", "N m"), (r"_rad$", "rad"), (r"_deg$", "deg"), (r"_rpm$|^rpm$", "rpm"),
    (r"(^|_)(volt|voltage|volts|vbat)", "V"), (r"(^|_)(amps|ampere|current)(_a)?$", "A"),
    (r"_mv$", "mV"), (r"_ma$", "mA"), (r"_cm$", "cm"), (r"_m$", "m"), (r"_mm$", "mm"),
    (r"_us$", "us"), (r"_ms$", "ms"), (r"_s$", "s"),
    (r"_kpa$", "kPa"), (r"_pa$", "Pa"), (r"_mbar$", "mbar"),
    (r"_n$", "N"), (r"_v$", "V"), (r"_a$", "A"), (r"_hz$", "Hz"), (r"_kg$", "kg"), (r"_w$", "W"),
)  # fmt: skip
_RATE_NAMES, _STEP_NAMES = ("fs", "rate", "rate_hz", "sample_rate", "f_s"), ("ts", "dt", "t_s")


@dataclass(frozen=True)
class _Timing:
    """What was seen of the clock: lines for the file, and the rate that it shows."""

    lines: tuple[str, ...]
    column: str | None = None
    resampling: tuple[str, ...] = ()
    gap_s: float | None = None


def guess_columns(path: Path | str, csv: Delimited | None = None) -> str:
    """The text of a first `columns.toml` for a log or a folder of logs.

    Raises UnusableInput for a file that cannot be read, or that holds no numbers.
    """
    path, form = Path(path), csv or Delimited()
    if is_log(path):
        return _text(path, [("", open_log(path, form))], form)
    logs = []
    for file in sorted(p for p in path.iterdir() if p.is_file() and not p.name.startswith(".")):
        try:
            logs.append((file.name, open_log(file, form)))
        except UnusableInput:
            continue
    if not logs:
        raise UnusableInput(f"{path}: holds no log of a kind that is known; give a file.")
    return _text(path, logs, form)


def _text(path: Path, logs: Sequence[tuple[str, Log]], form: Delimited) -> str:
    fields = {name: _numeric(log) for name, log in logs}
    own_clock = next(
        (log for name, log in logs for f in fields[name] if log.clock_of(f.name)), None
    )
    first = next((log for name, log in logs if fields[name]), logs[0][1])
    timing = _own_timing(first) if own_clock else _timing(first, first.fields())
    head = [
        f"# What the columns of {path.name} mean, as far as it can be seen. Lines with a question",
        "# mark are guesses. Give the columns that you need a role: input, output, observation or",
        '# force, or several as in ["input", "observation"]. All others are left out.',
        "version = 1",
        "",
        "[time]",
        *timing.lines,
        *timing.resampling,
    ]
    if timing.gap_s is not None:
        head += ["", "[split]", f"gap_s = {timing.gap_s:g}  # ? longer silences are in this log"]
    if form != Delimited():
        stated = form.model_dump(exclude_defaults=True)
        head += ["", "[csv]", *(f"{key} = {_toml(value)}" for key, value in stated.items())]
    taken: set[str] = set()
    entries = [
        line
        for name, log in logs
        for line in _entries(name, log, fields[name], timing.column, taken)
    ]
    if not entries:
        raise UnusableInput(f"{path}: holds no column of numbers; give another file.")
    return "\n".join([*head, *entries]) + "\n"


def _numeric(log: Log) -> list[Field]:
    return [field for field in log.fields() if field.example is not None]


# --- the clock


def _own_timing(log: Log) -> _Timing:
    """For logs whose topics have clocks of their own: a rate to which all are brought."""
    topics: dict[str, str] = {}
    for field in _numeric(log):
        topics.setdefault(field.topic, field.name)
    lines = ["# Each topic has its own clock, as the log keeps it:"]
    rates = []
    for topic, address in topics.items():
        clock = log.clock_of(address)
        if clock is None:
            continue
        stamps = log.read([clock.address], [clock.address])[clock.address]
        stamps_s = in_seconds(stamps, seconds_in(clock.unit), 0)
        if not (np.abs(stamps_s) < _LATEST_S).all():
            continue
        steps_s = np.diff(stamps_s)
        if not len(steps_s) or float(np.median(steps_s)) <= 0:
            continue
        rate_hz = 1.0 / float(np.median(steps_s))
        rates.append(rate_hz)
        lines.append(f"#   {_plain_line(topic)}: {rate_hz:.3g} Hz, {np.ptp(stamps_s):.4g} s")
    fast = [rate for rate in rates if rate >= 10.0] or rates or [100.0]
    rate = float(f"{float(np.median(fast)):.2g}")
    return _Timing(tuple(lines), None, _resampled(rate))


def _timing(log: Log, fields: Sequence[Field]) -> _Timing:
    for pattern in _TIME_NAMES:
        for field in fields:
            bare = re.sub(r"\s*[(\[][^()\[\]]*[)\]]\s*$", "", field.name).strip().lower()
            if re.fullmatch(pattern, bare) and (found := _clock(log, field)) is not None:
                return found
    return _stated_rate(log, fields)


def _clock(log: Log, field: Field) -> _Timing | None:
    """A field as the clock; None where it does not rise."""
    try:
        values = log.read([field.name], [field.name])[field.name]
    except UnusableInput:
        return None
    lines = [f"column = {_toml(field.name)}"]
    form = None
    if values.dtype == object:
        form = _form(values)
        if form is None:
            return None
        lines.append(f"format = {_toml(form)}  # ?")
    numbers = as_numbers(values, form, str, _never)
    if numbers.dtype.kind == "M":
        numbers, form = numbers.astype("datetime64[ns]").astype(np.int64), "datetime64"
    unit, is_guess = ("ns", False) if form else _time_unit(numbers, field)
    if unit is None:
        return None
    if form is None:
        lines.append(f"unit = {_toml(unit)}" + ("  # ?" if is_guess else ""))
    start_s = whole_start_s(numbers, seconds_in(unit))
    stamps_s = in_seconds(numbers, seconds_in(unit), origin_s([start_s or 0]))
    if not (np.abs(stamps_s) < _LATEST_S).all():
        return None
    return _seen(stamps_s, field.name, lines)


def _seen(stamps_s: Vector, column: str, lines: list[str]) -> _Timing | None:
    """What a clock shows: its rate, falls, doubles and gaps."""
    steps_s = np.diff(stamps_s)
    rising = steps_s[steps_s > 0]
    if len(rising) < 0.5 * len(steps_s) or not len(rising):
        return None
    usual_s = float(np.median(rising))
    lines.append(f"# about {1 / usual_s:.4g} Hz, {np.ptp(stamps_s):.4g} s")
    if (steps_s < 0).any():
        lines.append('falling = "sort"  # ? some stamps fall; "split" where a log begins again')
    ordered = np.unique(stamps_s)
    is_even = unevenness(ordered) is None and len(ordered) == len(stamps_s)
    gaps = np.diff(ordered) > max(1.0, 10.0 * usual_s)
    gap_s = float(f"{max(1.0, 10.0 * usual_s):.2g}") if gaps.any() else None
    resampling = () if is_even else _resampled(float(f"{1 / usual_s:.2g}"))
    return _Timing(tuple(lines), column, resampling, gap_s)


def _resampled(rate_hz: float) -> tuple[str, ...]:
    return (
        "",
        "[resample]",
        f"rate_hz = {rate_hz:g}  # ? all columns are brought to it",
        'method = "hold"  # or "low-pass", which no sample of the future passes',
    )


def _stated_rate(log: Log, fields: Sequence[Field]) -> _Timing:
    """A rate that stands in the log as a number, or a place for one."""
    for field in fields:
        name = field.name.lower()
        if field.example is None or name not in (*_RATE_NAMES, *_STEP_NAMES):
            continue
        first = _first_number(log, field)
        if first is not None and first > 0:
            rate = first if name in _RATE_NAMES else 1.0 / first
            return _Timing((f"rate_hz = {rate:g}  # ? from {_toml(field.name)}",))
    by_unit = sorted(fields[:_MOST_COLUMNS], key=lambda field: not _unit_in(field.name))
    for field in by_unit:
        if _rises_evenly(log, field) and (found := _clock(log, field)) is not None:
            column, *more = found.lines
            return replace(found, lines=(f"{column}  # ? it rises evenly", *more))
    return _Timing(("rate_hz = 0  # not found in the log: give the samples a second",))


def _rises_evenly(log: Log, field: Field) -> bool:
    """Whether a column is a clock by what it does: hardly anything else rises by even steps."""
    try:
        values = log.read([field.name], [field.name])[field.name]
    except UnusableInput:
        return False
    if values.dtype.kind not in "fiu" or len(values) < _FEW_STAMPS:
        return False
    numbers = as_floats(values)
    if not (np.abs(numbers) < _LARGEST).all():
        return False
    steps = np.diff(numbers)
    low, usual, high = np.quantile(steps, (0.1, 0.5, 0.9))
    is_count = bool((steps == 1.0).all())  # of samples, as a table's index
    return not is_count and bool((steps > 0).all() and usual > 0 and high - low < _EVEN * usual)


def _first_number(log: Log, field: Field) -> float | None:
    try:
        values = log.read([field.name], [])[field.name]
    except UnusableInput:
        return None
    return float(values[0]) if len(values) and np.isfinite(values[0]) else None


def _unit_in(name: str) -> str | None:
    """The unit of time that a name ends with."""
    ends = re.search(r"_(s|ms|us|ns|min)$", name)
    if ends:
        return ends[1]
    return "min" if re.search(r"(^|_)minutes?$", name.lower()) else None


def _time_unit(values: Values, field: Field) -> tuple[str | None, bool]:
    """The unit that the log states, or the one in which the steps are likely."""
    stated = field.unit or _unit_in(field.name)
    if stated is not None:
        try:
            seconds_in(stated)
            return stated, False
        except ValueError:
            pass
    if values.dtype.kind == "M":
        return "ns", False
    numbers = as_floats(values)
    if len(numbers) < 2 or not (np.abs(numbers) < _LARGEST).all():
        return None, False
    steps = np.diff(numbers)
    rising = steps[steps > 0]
    if len(rising) < 0.5 * len(steps) or not len(rising):
        return None, False
    step = float(np.median(rising))
    low, high = _LIKELY_HZ
    for unit in ("s", "ms", "us", "ns"):
        if low <= 1.0 / (step * float(seconds_in(unit))) <= high:
            return unit, True
    return None, False


def _form(values: Values) -> str | None:
    from datetime import datetime

    for form in _FORMS:
        try:
            for text in (str(values[0]), str(values[-1])):
                if form == "iso":
                    datetime.fromisoformat(text)
                else:
                    datetime.strptime(text, form)
        except ValueError:
            continue
        return form
    return None


def _never(reason: str, advice: str) -> UnusableInput:
    return UnusableInput(f"The clock {reason}; {advice}.")


# --- the columns


def _entries(
    file: str, log: Log, fields: Sequence[Field], clock: str | None, taken: set[str]
) -> Iterator[str]:
    if len(fields) > _MOST_COLUMNS:
        yield f"\n# {len(fields) - _MOST_COLUMNS} more columns are not listed."
    chosen = [field for field in fields[:_MOST_COLUMNS] if field.name != clock]
    values = _all_values(log, chosen)
    for field in chosen:
        seen = values.get(field.name)
        if seen is None or not len(seen) or len(seen) < 2:
            continue
        yield from _entry(file, field, seen, taken)


def _all_values(log: Log, fields: Sequence[Field]) -> dict[str, Values]:
    """The numbers of all columns that have some, in one pass where that works."""
    try:
        return log.read([field.name for field in fields], [])
    except UnusableInput:
        pass
    found: dict[str, Values] = {}
    for field in fields:
        try:
            found |= log.read([field.name], [])
        except UnusableInput:
            continue
    return found


def _entry(file: str, field: Field, values: Values, taken: set[str]) -> Iterator[str]:
    numbers = as_floats(values) if values.dtype.kind in "fiub" else np.empty(0)
    there = numbers[np.isfinite(numbers)]
    if not len(there):
        return
    unit, remark = _unit(field)
    yield ""
    yield f"[columns.{_name(field.name, taken)}]  # {_range(there)}"
    yield f"column = {_toml(field.name)}"
    if file:
        yield f"file = {_toml(file)}"
    yield 'role = "unused"'
    yield f"unit = {_toml(unit)}{remark}"
    if unit != si_unit(unit) and field.name.lower().endswith(f"_{unit.lower()}"):
        yield f"to = {_toml(unit)}  # as its name says"
    if len(there) < len(numbers):
        if _usual_run(np.isfinite(numbers)) <= _SHORT_RUN:
            yield 'missing = "hold"  # ? a number in some rows only; "nan" for a sensor'
        else:
            yield 'missing = "split"  # ? some samples have no number; "nan" for a sensor'


def _usual_run(is_there: NDArray[np.bool_]) -> float:
    """How many rows in a row usually have a number: one or two where clocks were merged."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_there, [False]]).astype(int)))
    return float(np.median(edges[1::2] - edges[::2]))


def _range(there: Vector) -> str:
    low, high = float(there.min()), float(there.max())
    return f"always {low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _unit(field: Field) -> tuple[str, str]:
    """A unit, and a remark on where it is from."""
    if field.unit is not None:
        is_gravity = field.unit == "g" and re.match(r"a(cc|x|y|z)", field.name, re.I)
        if is_gravity:
            return "m/s^2", "\nscale = 9.80665  # ? the log counts in gravities"
        try:
            si_unit(field.unit)
            return field.unit, ""
        except ValueError:
            return "1", f"  # ? the log says {_plain_line(field.unit)}, which is not known"
    for pattern, unit in _UNITS_BY_NAME:
        if re.search(pattern, field.name.lower()):
            return unit, "  # ? by its name"
    return "1", "  # ? the log does not say"


def _name(address: str, taken: set[str]) -> str:
    """A name of letters, digits and _ that no other column has."""
    bare = re.sub(r"\s*\([^()]*\)\s*$", "", address)
    plain = re.sub(r"[^A-Za-z0-9]+", "_", bare).strip("_").lower() or "column"
    plain = plain if plain[0].isalpha() else f"column_{plain}"
    name, count = plain[:60].rstrip("_"), 2
    while name in taken:
        name, count = f"{plain[:56]}_{count}", count + 1
    taken.add(name)
    return name


def _toml(value: object) -> str:
    """A value as TOML has it."""
    import tomli_w

    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()


def _plain_line(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)[:80]
