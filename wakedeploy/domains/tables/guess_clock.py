"""When a log's samples were taken, as far as it can be seen: the clock, and a rate for all columns.

In: a log. Out: a `Timing`: lines for [time] of a first `columns.toml`, and the stamps they mean.
"""

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.even_time import unevenness
from wakedeploy.domains.tables.counters import going_on, wrap_in
from wakedeploy.domains.tables.guess_rate import usual_hz
from wakedeploy.domains.tables.guess_time_unit import LARGEST, UNITS, is_dated, time_unit, unit_in
from wakedeploy.domains.tables.log import Field, Log, Values
from wakedeploy.domains.tables.stamps import (
    as_floats,
    as_numbers,
    between_falls,
    in_seconds,
    is_set_back,
    origin_s,
    seconds_in,
    whole_ns,
    whole_start_s,
)

Vector = NDArray[np.float64]

MOST_COLUMNS = 400
_LATEST_S = 1e12
_BEYOND = re.compile(r"(nano_?sec(?:ond)?s?|nsecs?)$", re.I)  # a whole second, as ROS has stamps
_TIME_NAMES = (
    r"sim(ulation)?_?(time|t|clock|stamp)(_?(s|ms|us|ns|sec|usec))?",  # not the wall's, if both are
    r"t|time|times?tamp|stamps?|t_s|time_s|sec|secs|seconds|zeit|clock",
    r"(control|state|log|sensor)?_?(time|timestamp|stamp|t)(_?(s|ms|us|ns|sec|usec))?",
    r".*time.*|.*stamp.*",
)
_LIKE_TIME = r"t_\w+|\w+_t"  # a column's clock if it rises all along, which no torque does
_WORD = r"[a-z]+"
_WORDS_OF_TIME = frozenset(
    re.findall(_WORD, "t time timestamp stamp stamps clock zeit s ms us ns sec secs seconds usec")
)
_FEW_STAMPS, _EVEN = 10, 0.5  # fewer say nothing; spread of most steps over the usual one
_FEW_FALLS, _LONG_RUN = 5, 100  # of a clock that begins again; more falls have rows between them
_TIMES = (
    "%H:%M:%S.%f", "%H:%M:%S", "%H:%M:%S,%f", "%H:%M:%S:%f", "%I:%M:%S.%f %p", "%I:%M:%S %p",
)  # fmt: skip
_MOST_STAMPS, _FEWEST_DIGITS = 200, 3
_AT_RATE = (0.9, 30.0)  # times a system's rate that its logs have
_DAYS = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y")
_FORMS = ("iso", *(f"{day} {time}" for day in _DAYS for time in _TIMES), *_TIMES)
_RATE_NAMES, _STEP_NAMES = ("fs", "rate", "rate_hz", "sample_rate", "f_s"), ("ts", "dt", "t_s")
_COMMANDED = re.compile(  # by its name: what drives a system, and is held between its samples
    r"(?:^|[^a-z])(?:cmd|command|ctrl|control|set_?point|ref|reference|desired|target|goal|action"
    r"|input|actuator|u)s?(?:$|[^a-z])"
)


@dataclass(frozen=True)
class Timing:
    """What was seen of a clock: lines for the file, its column and unit, and its stamps.

    `nanoseconds` is the column of those beyond the whole seconds of its column. `is_unit_open` says
    that its unit is a guess by its rate and its length alone.
    """

    lines: tuple[str, ...]
    column: str | None = None
    unit: str | None = None
    stamps_s: Vector | None = None
    nanoseconds: str | None = None
    is_unit_open: bool = False


def own_timing(log: Log, fields: Sequence[Field]) -> tuple[Timing, tuple[str, ...]]:
    """For logs whose topics have clocks of their own, and the rate to which all are brought."""
    topics: dict[str, str] = {}
    for field in fields:
        topics.setdefault(field.topic, field.name)
    lines = ["# Each topic has its own clock, as the log keeps it:"]
    sampled: list[tuple[str, Vector]] = []
    for topic, address in topics.items():
        clock = log.clock_of(address)
        if clock is None:
            continue
        stamps = log.read([clock.address], [clock.address])[clock.address]
        stamps_s = in_seconds(stamps, seconds_in(clock.unit), 0)
        if not (np.abs(stamps_s) < _LATEST_S).all():
            continue
        rate_hz = usual_hz(stamps_s)
        if rate_hz is None:
            continue
        sampled.append((topic, stamps_s))
        lines.append(f"#   {plain_line(topic)}: {rate_hz:.4g} Hz, {np.ptp(stamps_s):.4g} s")
    return Timing(tuple(lines)), resampled(sampled)


def timing_of(log: Log, fields: Sequence[Field]) -> Timing:
    """The clock that a log's fields hold, or the rate that stands in it."""
    if (named := next(called_times(log, fields), None)) is not None:
        return named
    for field in fields:  # texts that are dates are a clock, whatever they are called
        if field.example is None and (found := _clock(log, field)) is not None:
            return found
    if (found := _without_names(log, fields)) is not None:
        return found
    like = [field for field in fields if _is_like_time(field)]
    for field in like:
        if (found := even_clock(log, field)) is not None:
            return found
    if (found := _stated_rate(log, fields)) is not None:
        return found
    for field in like:  # of no column: a position may rise all along, too
        if _rises(log, field) and (found := _clock(log, field)) is not None:
            return _doubted(found, "it rises; a position may, too")
    return Timing(("rate_hz = 0  # not found in the log: give the samples a second",))


def called_times(log: Log, fields: Sequence[Field]) -> Iterator[Timing]:
    """The clocks that a log's fields are by their names, the likeliest first."""
    for pattern in _TIME_NAMES:
        for field in fields:
            if re.fullmatch(pattern, _bare(field)) and (found := _clock(log, field)) is not None:
                yield found
    likely = [f for f in fields if _is_of_a_column(f, fields) and _rises(log, f)]
    yield from (found for field in likely if (found := _clock(log, field)) is not None)


def even_clock(log: Log, field: Field) -> Timing | None:
    """A field as a clock by what it does; None for any other."""
    if not _is_even(_steps(log, field)) or (found := _clock(log, field)) is None:
        return None
    return _doubted(found, "it rises evenly")


def at_rate(clock: Timing, rate_hz: float) -> Timing:
    """A clock whose unit is open, in the only unit in which a system of this rate can use it.

    A minute of a controller and a day of a furnace have the same stamps, but for the unit.
    """
    if not clock.is_unit_open or clock.unit is None or clock.stamps_s is None:
        return clock
    found_hz, found_s = usual_hz(clock.stamps_s) or 0.0, float(seconds_in(clock.unit))
    low, high = (rate_hz * share for share in _AT_RATE)
    fit = [unit for unit in UNITS if low <= found_hz * found_s / float(seconds_in(unit)) <= high]
    if len(fit) != 1 or fit[0] == clock.unit:
        return clock
    (unit,) = fit
    stamps_s = clock.stamps_s * (float(seconds_in(unit)) / found_s)
    said = {
        "unit = ": f"unit = {toml(unit)}  # ? by the system's rate",
        "# about": _about(stamps_s),
    }
    lines = (next((new or old for begin, new in said.items() if old.startswith(begin)), old)
             for old in clock.lines)  # fmt: skip
    return replace(clock, lines=tuple(lines), unit=unit, stamps_s=stamps_s)


def _doubted(clock: Timing, reason: str) -> Timing:
    """A clock that is a guess, and says why."""
    column, *more = clock.lines
    return replace(clock, lines=(f"{column}  # ? {reason}", *more))


def sampled_of(name: str, timing: Timing, values: Mapping[str, Values]) -> list[tuple[str, Vector]]:
    """The stamps at which each column of a file has a number."""
    if timing.stamps_s is None:
        return []
    found = []
    for column, numbers in values.items():
        if numbers.dtype.kind in "fiub" and len(numbers) == len(timing.stamps_s):
            is_there = np.isfinite(as_floats(numbers))
            found.append((f"{name} {column}".strip(), timing.stamps_s[is_there]))
    return found


def resampled(sampled: Iterable[tuple[str, Vector]]) -> tuple[str, ...]:
    """[resample] at the usual rate of the fastest column that is measured.

    An input is held between its samples, whatever the rate. A reading counts once, at the first
    tick after it: at a lower rate some would be lost, and at a higher one no more are gained.
    """
    several = list(sampled)
    lasting = [each for each in several if len(each[1]) >= _FEW_STAMPS]
    rates = {n: hz for n, stamps_s in lasting or several if (hz := usual_hz(stamps_s)) is not None}
    measured = {name: hz for name, hz in rates.items() if not _COMMANDED.search(name.lower())}
    chosen = measured or rates
    if not chosen:
        return _resample_lines(100.0, "all columns are brought to it")
    fastest = max(chosen, key=lambda name: chosen[name])
    return _resample_lines(
        chosen[fastest], f"that of {plain_line(fastest)}; inputs are held between samples"
    )


def on_falls(stamps_s: Vector, values: Mapping[str, Values]) -> tuple[str, str] | None:
    """What to do about stamps that fall, "sort" or "split", and why; None where none do."""
    if not (np.diff(stamps_s) < 0).any():
        return None
    back_s = float((np.maximum.accumulate(stamps_s) - stamps_s).max())
    if not _begins_again(stamps_s):
        return "sort", f"messages swapped places, by up to {back_s:.3g} s"
    if _is_one_after_the_other(stamps_s, values):
        return "sort", "one stream stands after the other"
    return "split", f"set back by {back_s:.3g} s, it goes on: sorted, two times would be mixed"


def pace_of(stamps_s: Vector, begins_again: bool) -> tuple[bool, float | None]:
    """Whether a clock, or each of its runs, is even, and the `gap_s` where it has gaps."""
    steps_s = np.diff(stamps_s)
    bound_s = max(1.0, 10.0 * float(np.median(steps_s[steps_s > 0])))
    cuts = between_falls(stamps_s) if begins_again else [slice(None)]
    runs = [np.unique(stamps_s[cut]) for cut in cuts]
    is_even = sum(map(len, runs)) == len(stamps_s) and all(
        len(run) < 2 or unevenness(run) is None for run in runs
    )
    has_gap = any((np.diff(run) > bound_s).any() for run in runs)
    return is_even, float(f"{bound_s:.2g}") if has_gap else None


def _begins_again(stamps_s: Vector) -> bool:
    """Whether a clock that falls was set back, and its stamps rise for long afterwards."""
    runs = [cut.stop - cut.start for cut in between_falls(stamps_s)]
    is_long = len(runs) <= _FEW_FALLS + 1 or float(np.median(runs)) >= _LONG_RUN
    return is_set_back(stamps_s) and is_long


def _is_one_after_the_other(stamps_s: Vector, values: Mapping[str, Values]) -> bool:
    """Whether each column has numbers in one run of stamps only, as tables that were joined."""
    cuts = between_falls(stamps_s)
    has_numbers = [
        sum(bool(np.isfinite(as_floats(numbers[cut])).any()) for cut in cuts)
        for numbers in values.values()
        if numbers.dtype.kind in "fiub" and len(numbers) == len(stamps_s)
    ]
    return len(has_numbers) > 1 and max(has_numbers) == 1


def _clock(log: Log, field: Field) -> Timing | None:
    """A field as the clock; None where it does not rise."""
    if (both := _of_two(log, field)) is not None:
        return both
    try:
        values = log.read([field.name], [field.name])[field.name]
    except UnusableInput:
        return None
    lines = [f"column = {toml(field.name)}"]
    form = None
    if values.dtype == object:
        form = _form(values)
        if form is None:
            return None
        lines.append(f"format = {toml(form)}  # ?")
    numbers = as_numbers(values, form, str, _never)
    if numbers.dtype.kind == "M":
        if np.isnat(numbers).any():
            return None
        numbers, form = numbers.astype("datetime64[ns]").astype(np.int64), "datetime64"
    wraps_at = None if form else wrap_in(numbers)
    numbers = numbers if wraps_at is None else going_on(numbers, wraps_at)
    unit, is_guess = ("ns", False) if form else time_unit(numbers, field)
    if unit is None:
        return None
    if form is None:
        lines.append(f"unit = {toml(unit)}" + ("  # ?" if is_guess else ""))
    if wraps_at is not None:
        lines.append(f"wraps_at = {wraps_at:.16g}  # ? there its counter begins again")
    start_s = whole_start_s(numbers, seconds_in(unit))
    stamps_s = in_seconds(numbers, seconds_in(unit), origin_s([start_s or 0]))
    if not (np.abs(stamps_s) < _LATEST_S).all():
        return None
    if (about := _about(stamps_s)) is None:
        return None
    lines.append(about)
    if form == "datetime64":
        lines.append("# dates and times, which say what they count in: no unit is needed")
    is_open = is_guess and not is_dated(as_floats(numbers), unit)
    return Timing(tuple(lines), field.name, None if form else unit, stamps_s, is_unit_open=is_open)


def _of_two(log: Log, field: Field) -> Timing | None:
    """A clock of whole seconds and the nanoseconds beyond, of either column; else None."""
    pairs = _pairs([other.name for other in log.fields()])
    both = next((pair for pair in pairs if field.name in pair), None)
    counted = None if both is None else _counted(log, *both)
    if both is None or counted is None:
        return None
    start_s = whole_start_s(counted, seconds_in("ns"))
    stamps_s = in_seconds(counted, seconds_in("ns"), origin_s([start_s or 0]))
    if (about := _about(stamps_s)) is None:
        return None
    whole, beyond = both
    lines = (f"column = {toml(whole)}", 'unit = "s"', f"nanoseconds = {toml(beyond)}", about)
    return Timing(lines, whole, "s", stamps_s, beyond)


def _pairs(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """The columns that are whole seconds and nanoseconds by their names."""
    for beyond in filter(_BEYOND.search, names):
        stem = _BEYOND.sub("", beyond).lower()
        ends = [f"{stem}{end}" for end in ("sec", "secs", "second", "seconds")]
        yield from ((name, beyond) for name in names if name.lower() in ends)


def _counted(log: Log, whole: str, beyond: str) -> Values | None:
    """Stamps [ns] of whole seconds and nanoseconds; None for columns that are no such."""
    return _both(_as_stamps(log, [whole, beyond]), whole, beyond)


def _both(read: Mapping[str, Values], whole: str, beyond: str) -> Values | None:
    """Stamps [ns] of two columns that were read; None for columns that are no such."""
    try:
        return whole_ns(read[whole], read[beyond], str, _never)
    except (KeyError, UnusableInput, TypeError, ValueError):  # one could not be read, or has texts
        return None


def _as_stamps(log: Log, names: Sequence[str]) -> dict[str, Values]:
    """The columns that can be read, as stamps.

    All are read at once, as each reading goes through the whole log; where one of them cannot be
    read, or all are too many, each half is read by itself. What is said of two columns alike is
    wrong with the log, of which no column can be read.
    """
    found: dict[str, Values] = {}
    said: set[str] = set()
    pending = [list(names)]
    while pending:
        some = pending.pop()
        try:
            found |= log.read(some, some)
        except UnusableInput as error:
            if len(some) > 1:
                pending += [some[: len(some) // 2], some[len(some) // 2 :]]
            elif str(error) in said:
                break
            said.add(str(error) if len(some) == 1 else "")
    return found


def _without_names(log: Log, fields: Sequence[Field]) -> Timing | None:
    """The clock of two columns side by side in a table without names, as `ros2 topic echo` writes.

    Seconds stand still for some rows, nanoseconds begin again where one ends, and both together
    rise with each row.
    """
    several = [field for field in fields[:MOST_COLUMNS] if field.name.startswith("#")]
    pairs = [
        (whole.name, beyond.name)
        for whole, beyond in itertools.pairwise(several)
        if whole.example is not None and beyond.example is not None
    ]
    read = _as_stamps(log, sorted({name for pair in pairs for name in pair})) if pairs else {}
    for whole, beyond in pairs:
        counted = _both(read, whole, beyond)
        if counted is None or len(counted) < _FEW_STAMPS or not (np.diff(counted) > 0).all():
            continue
        seconds, beyond_ns = np.divmod(counted, 10**9)
        begins_again = bool((np.diff(beyond_ns) < 0).any() and (np.diff(seconds) == 0).any())
        if begins_again and (about := _about(counted / 1e9)) is not None:
            lines = (f"column = {toml(whole)}  # ? with nanoseconds it rises", 'unit = "s"',
                     f"nanoseconds = {toml(beyond)}", about)  # fmt: skip
            return Timing(lines, whole, "s", (counted - counted[0]) / 1e9, beyond)
    return None


def _about(stamps_s: Vector) -> str | None:
    """What is said of a clock; None for what does not rise."""
    steps_s = np.diff(stamps_s)
    rising = steps_s[steps_s > 0]
    if len(rising) < 0.5 * len(steps_s) or not len(rising):
        return None
    return f"# about {usual_hz(stamps_s):.4g} Hz, {np.ptp(stamps_s):.4g} s"


def _resample_lines(rate_hz: float, reason: str) -> tuple[str, ...]:
    return (
        "",
        "[resample]",
        f"rate_hz = {rate_hz:g}  # ? {reason}",
        'method = "hold"  # or "low-pass", which no sample of the future passes',
    )


def _stated_rate(log: Log, fields: Sequence[Field]) -> Timing | None:
    """A rate that stands in the log as a number, or a column that rises as stamps do."""
    for field in fields:
        name = field.name.lower()
        if field.example is None or name not in (*_RATE_NAMES, *_STEP_NAMES):
            continue
        first = _first_number(log, field)
        if first is not None and first > 0:
            rate = first if name in _RATE_NAMES else 1.0 / first
            return Timing((f"rate_hz = {rate:g}  # ? from {toml(field.name)}",))
    by_unit = sorted(fields[:MOST_COLUMNS], key=lambda field: not unit_in(field.name))
    read = _as_stamps(log, [field.name for field in by_unit])
    for field in by_unit:
        is_even = field.name in read and _is_even(_steps_of(read[field.name]))
        if is_even and (found := even_clock(log, field)) is not None:
            return found
    return None


def _is_like_time(field: Field) -> bool:
    """Whether a name may be that of a clock, or of a column at a time: `t_cmd`, `x_t`."""
    return re.fullmatch(_LIKE_TIME, _bare(field)) is not None


def _is_of_a_column(field: Field, fields: Sequence[Field]) -> bool:
    """Whether a name is that of another column's clock: `t_cmd` beside `cmd`."""
    if not _is_like_time(field):
        return False
    said, others = words_of(_bare(field)), (f for f in fields if not _is_like_time(f))
    return any(said & words_of(_bare(other)) for other in others)


def words_of(address: str) -> set[str]:
    """The words of an address, without those that any clock may have."""
    return set(re.findall(_WORD, address.lower())) - _WORDS_OF_TIME


def _bare(field: Field) -> str:
    """What a field is called within its group, without a unit in brackets."""
    whole = re.sub(r"\s*[(\[][^()\[\]]*[)\]]\s*$", "", field.name)
    return whole.rpartition("/")[2].strip().lower()


def _rises(log: Log, field: Field) -> bool:
    """Whether each number is larger than the one before."""
    steps = _steps(log, field)
    return steps is not None and bool((steps > 0).all())


def _steps(log: Log, field: Field) -> Vector | None:
    """The steps of a column from number to number; None for few, or for something else."""
    read = _as_stamps(log, [field.name])
    return _steps_of(read[field.name]) if read else None


def _steps_of(values: Values) -> Vector | None:
    """The steps of a column that was read; None for few, or for something else."""
    if values.dtype.kind not in "fiu" or len(values) < _FEW_STAMPS:
        return None
    numbers = as_floats(values)
    return np.diff(numbers) if (np.abs(numbers) < LARGEST).all() else None


def _is_even(steps: Vector | None) -> bool:
    """Whether a column is a clock by what it does: hardly anything else rises by even steps."""
    if steps is None:
        return False
    low, usual, high = np.quantile(steps, (0.1, 0.5, 0.9))
    is_count = bool((steps == 1.0).all())  # of samples, as a table's index
    return not is_count and bool((steps > 0).all() and usual > 0 and high - low < _EVEN * usual)


def _first_number(log: Log, field: Field) -> float | None:
    try:
        values = log.read([field.name], [])[field.name]
    except UnusableInput:
        return None
    return float(values[0]) if len(values) and np.isfinite(values[0]) else None


def _form(values: Values) -> str | None:
    """How stamps are written: of two orders of day and month, the one in which they last less."""
    texts = [str(v) for v in values[:: max(len(values) // _MOST_STAMPS, 1)]] + [str(values[-1])]
    spans = {form: _span_s(texts, form) for form in _FORMS}
    found = {form: span for form, span in spans.items() if span is not None}
    return min(found, key=lambda form: found[form], default=None)


def _span_s(texts: Sequence[str], form: str) -> float | None:
    """From the first of these stamps to the last [s]; None where one is not written so.

    Digits behind a colon or a comma are a share of a second only where they are three or more of
    one width: 10:00:00:24 is a frame, and :20 may be 20 ms.
    """
    if form.endswith((":%f", ",%f")):
        ends = {len(re.split("[:,]", text)[-1]) for text in texts}
        if len(ends) > 1 or min(ends) < _FEWEST_DIGITS:
            return None
    try:
        at = [
            datetime.fromisoformat(text) if form == "iso" else datetime.strptime(text, form)
            for text in texts
        ]
        return abs((max(at) - min(at)).total_seconds())
    except (ValueError, TypeError):  # a zone here and none there
        return None


def _never(reason: str, advice: str) -> UnusableInput:
    return UnusableInput(f"The clock {reason}; {advice}.")


def toml(value: object) -> str:
    """A value as TOML has it."""
    import tomli_w

    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()


def plain_line(text: str) -> str:
    """A text of a log as it may stand in a comment."""
    return "".join(c if c.isprintable() else "?" for c in text)[:80]
