"""A first `columns.toml` for a log: what can be seen in it, each guess marked as one.

In: a log, or a folder of logs. Out: the text of a file that is read as it is once a person has
given some of its columns a role. What cannot be seen (a rate that no file states) is left so that
reading refuses it by name.
"""

import itertools
import re
import textwrap
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.units import SHOWN_ALONE, contradicted, conversion, same_unit, si_unit
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats.delimited import DelimitedLog
from wakedeploy.domains.tables.guess_asked import (
    NOTHING_ASKED,
    ONLY_ORIENTATION,
    SAME,
    Asked,
    Match,
    Matches,
    Place,
    matched,
    may_be,
)
from wakedeploy.domains.tables.guess_clock import (
    MOST_COLUMNS,
    Timing,
    at_rate,
    on_falls,
    own_timing,
    pace_of,
    plain_line,
    resampled,
    sampled_of,
    timing_of,
    toml,
)
from wakedeploy.domains.tables.guess_clocks import clocks_of
from wakedeploy.domains.tables.guess_left_out import comments_on, left_out
from wakedeploy.domains.tables.guess_orientation import Quaternion, quaternions_in
from wakedeploy.domains.tables.log import Field, Log, Values
from wakedeploy.domains.tables.log_kinds import (
    is_log,
    is_named_as_log,
    of_bags,
    of_folders,
    open_log,
    seen_form,
)
from wakedeploy.domains.tables.stamps import as_floats

Vector = NDArray[np.float64]
_ANGLES = ("yaw", "pitch", "roll")  # of a quaternion; the first is what nobody asked for
_Named = tuple[str, Log]  # a file's name in its folder, "" for one that is alone, and the file

_QUOTED = 60  # letters of a line
_NAMED = 4  # columns that something asked for could be
_OF_ORIENTATION = re.compile(
    r"(?:[\W_](?:pose|orientation|quaternion|quat|q|rotation|rot|attitude|att))+$", re.I
)
_SHORT_RUN = 2.0  # rows with a number; longer runs are of one clock, with samples that are lost
_TO_DO = (
    "# mark are guesses. Give the columns that you need a role: input, output, observation or",
    '# force, or several as in ["input", "observation"]. All others are left out.',
)
_PARTS = (
    "# Its files have other columns each: they are taken for parts of one recording, at the same",
    "# time. If each is a recording of its own, it needs a columns file of its own, too.",
)
_TO_DO_ASKED = (
    "# mark are guesses: look at each. A column that was taken for an input or an output of the",
    "# system has its name and a role. Others are left out, until you give them a role as well.",
)
_MANY_ROWS, _MOST = 5000, 0.9  # that are looked at; a share that is nearly all
_UNITS_BY_NAME = (  # the end of a name, or a word in it
    (r"gyro.*rad(\[\d\])?$|_rad_?p?e?r?_?s$|rad/s", "rad/s"),
    (r"_m_s2(\[\d\])?$|_mps2$", "m/s^2"), (r"_m_s(\[\d\])?$|_mps$", "m/s"), (r"_n_m$", "N m"),
    (r"_dps$|_deg_?p?e?r?_?s$|deg/s", "deg/s"), (r"_mnm$", "mN m"), (r"_pct$|_percent$", "%"),
    (r"_nm$", "N m"), (r"_rad$", "rad"), (r"_deg$", "deg"), (r"_rpm$|^rpm$", "rpm"),
    (r"(^|_)(volt|voltage|volts|vbat)", "V"), (r"(^|_)(amps|ampere|current)(_a)?$", "A"),
    (r"_mv$", "mV"), (r"_ma$", "mA"), (r"_cm$", "cm"), (r"_m$", "m"), (r"_mm$", "mm"),
    (r"_kmh$|_km_h$", "kmh"), (r"_(kts|knots)$", "knots"),
    (r"_nmm$", "Nmm"), (r"_mm_?p?_?s$", "mm/s"), (r"_cm_?p?_?s$", "cm/s"),
    (r"_us$", "us"), (r"_ms$", "ms"), (r"_s$", "s"),
    (r"_kpa$", "kPa"), (r"_pa$", "Pa"), (r"_mbar$", "mbar"),
    (r"_bar$", "bar"), (r"_psi$", "psi"),
    (r"_n$", "N"), (r"_v$", "V"), (r"_a$", "A"), (r"_hz$", "Hz"), (r"_kg$", "kg"), (r"_w$", "W"),
)  # fmt: skip


# Letters that Unicode takes for no letter with a mark, small ones.
_WHOLE = str.maketrans({"ø": "o", "ł": "l", "đ": "d", "æ": "ae", "œ": "oe", "ı": "i"})
_CELSIUS = re.compile(r"(?<![a-z])(°|deg_?)c(?![a-z])|celsius", re.I)


@dataclass(frozen=True)
class _File:
    """A log, alone or in a folder, with what was seen of it."""

    name: str
    log: Log
    fields: Sequence[Field]
    has_own_clock: bool
    timing: Timing
    values: Mapping[str, Values]
    clocks: Mapping[str, Timing]  # of columns that have another than the file's first
    left_out: Mapping[str, str]  # why columns are not listed, by name

    def timing_of(self, column: str) -> Timing:
        """The clock of a column."""
        return self.clocks.get(column, self.timing)

    @property
    def timings(self) -> list[Timing]:
        """Its clocks, each once, the first one first."""
        return list({t.column: t for t in (self.timing, *self.clocks.values())}.values())

    def sampled(self) -> Iterator[tuple[str, Vector]]:
        """The stamps at which each column has a number."""
        for timing in self.timings:
            stamped = {n: v for n, v in self.values.items() if self.timing_of(n) is timing}
            yield from sampled_of(self.name, timing, stamped)


def guess_columns(
    path: Path | str, asked: Sequence[Asked] = (), rate_hz: float | None = None
) -> str:
    """The text of a first `columns.toml` for a log or a folder of logs.

    Columns that are what is `asked` for get its name and role. The `rate_hz` of the system that
    asks tells a clock in seconds from one in milliseconds. Files of a folder that have the same
    columns are recordings of one kind: each column is listed once. Raises UnusableInput for a file
    that cannot be read, or that holds no numbers.
    """
    path = Path(path)
    if is_log(path):
        form = seen_form(path)
        return _text(path, [("", open_log(path, form))], form, asked, rate_hz)
    try:
        return _of_folder(path, asked, rate_hz)
    except UnusableInput as error:  # a text about the logs may be all that lies beside their folder
        raise (error if of_bags(path) else of_folders(path) or error) from None


def _of_folder(path: Path, asked: Sequence[Asked], rate_hz: float | None) -> str:
    """The text for a folder whose files are parts of one recording, or recordings of one kind."""
    files = sorted(p for p in path.iterdir() if p.is_file() and not p.name.startswith("."))
    form = _form_of(files)
    logs, refusals = [], []
    for file in files:
        try:
            logs.append((file.name, open_log(file, form)))
        except UnusableInput as refusal:
            refusals += [refusal] if is_named_as_log(file) else []
    bags = of_bags(path)
    if bags is not None and not any(_has_numbers(log) for _, log in logs):
        raise bags
    if not logs:
        unknown = UnusableInput(f"{path}: contains no log in a known format; give one log file.")
        raise refusals[0] if refusals else unknown
    kinds = _by_layout(logs)
    if len(kinds) == 1 and len(logs) > 1:
        return _text(path, [("", logs[0][1])], form, asked, rate_hz, _of_one_kind(path, logs))
    said = [line for kind in kinds if len(kind) > 1 for line in _on_likes(kind)]
    if len(kinds) == len(logs) > 1:
        said = list(_PARTS)
    return _text(path, [kind[0] for kind in kinds], form, asked, rate_hz, said)


def _by_layout(logs: Sequence[_Named]) -> list[list[_Named]]:
    """The logs of a folder in groups that have the same columns."""
    groups: dict[frozenset[str], list[_Named]] = {}
    for name, log in logs:
        groups.setdefault(frozenset(field.name for field in log.fields()), []).append((name, log))
    return list(groups.values())


def _of_one_kind(path: Path, logs: Sequence[_Named]) -> Sequence[str]:
    named = f"{plain_line(path.absolute().name)}/*{plain_line(''.join(Path(logs[0][0]).suffixes))}"
    return [
        f"# All {len(logs)} files have these columns. They are taken as recordings of one kind:",
        f"# give the files, as in {named}, and not the folder. If they are parts of one",
        '# recording, say in each column in which of them it stands, as in file = "left.csv".',
        f"# Ranges below are those of {plain_line(logs[0][0])}; other files may go further.",
    ]


def _on_likes(kind: Sequence[_Named]) -> Iterator[str]:
    (first, _), *others = kind
    yield f"# {plain_line(first)} has the columns of {len(others)} more, which are not listed:"
    names = ", ".join(plain_line(name) for name, _ in others)
    yield textwrap.indent(textwrap.fill(names, 94, break_on_hyphens=False), "#   ")
    yield "# Each recording is a folder of its own, in which files have the same names."


def _form_of(files: Sequence[Path]) -> Delimited:
    """How the tables of text in a folder are written: as the first that is not plain."""
    plain = Delimited()
    for file in files:
        try:
            seen = seen_form(file)
        except UnusableInput:
            continue
        if seen != plain:
            return seen
    return plain


def _text(
    path: Path,
    logs: Sequence[_Named],
    form: Delimited,
    asked: Sequence[Asked],
    rate_hz: float | None,
    said: Sequence[str] = (),
) -> str:
    files = [_seen(name, log, asked, rate_hz) for name, log in logs]
    first = next((file for file in files if file.fields), files[0])
    timing, resampling = first.timing, tuple[str, ...]()
    if first.has_own_clock:
        timing, resampling = own_timing(first.log, first.fields)
    lines, gap_s = [*timing.lines], None
    if timing.stamps_s is not None:
        falls = on_falls(timing.stamps_s, first.values)
        lines += [f'falling = "{falls[0]}"  # ? {falls[1]}'] if falls else []
        is_even, gap_s = pace_of(timing.stamps_s, falls is not None and falls[0] == "split")
        if not is_even or any(_differs(t, timing) for file in files for t in file.timings):
            resampling = resampled(sampled for file in files for sampled in file.sampled())
    head = [
        f"# What the columns of {path.absolute().name} mean, as far as it can be seen. Lines with "
        "a question",
        *(_TO_DO_ASKED if asked else _TO_DO),
        *said,
        "version = 1",
        "",
        "[time]",
        *lines,
        *resampling,
    ]
    if gap_s is not None:
        head += ["", "[split]", f"gap_s = {gap_s:g}  # ? longer silences are in this log"]
    if form != Delimited():
        stated = form.model_dump(exclude_defaults=True)
        doubts = _doubts(form, logs[0][1])
        written = (
            f"{k} = {toml(v)}".replace("\t", r"\t") + doubts.get(k, "") for k, v in stated.items()
        )
        head += ["", "[csv]", *written]
    matches = _matches(asked, files) if asked else NOTHING_ASKED
    taken = {each.name for each in asked}
    entries = [line for file in files for line in _entries(file, timing, taken, matches.found)]
    if not any(line.startswith("[columns.") for line in entries):
        raise _without_numbers(path, files)
    entries += _not_found(asked, matches, _kept_in_a_unit(entries))
    return "\n".join([*head, *entries]) + "\n"


def _doubts(form: Delimited, log: Log) -> dict[str, str]:
    """What a person should look at of how a table is written, by key."""
    doubts = {}
    if form.decimal == ",":
        doubts["decimal"] = "  # ? 1,5 is read as one and a half"
    if mark := form.thousands:
        doubts["thousands"] = f"  # ? 1{mark}000 is read as a thousand"
    if form.units_in_cells:
        doubts["units_in_cells"] = "  # ? cells say their unit, which is taken from the first row"
    if form.more_rows and isinstance(log, DelimitedLog):
        rows = "; ".join(log.delimiter.join(row) for _, row in log.left_out)[:_QUOTED]
        doubts["more_rows"] = f"  # ? left out: {plain_line(rows)!r}"
    if not form.header:
        doubts["header"] = "  # ? its first row holds numbers, no names"
    if form.skip_rows and isinstance(log, DelimitedLog):
        lines = (log.line(number) for number in range(form.skip_rows, 0, -1))
        above = next(filter(None, lines), "")[:_QUOTED]
        doubts["skip_rows"] = f"  # ? the last line before the table: {above!r}"
    return doubts


def _matches(asked: Sequence[Asked], files: Sequence[_File]) -> Matches:
    """Which of the columns that are listed are asked for."""
    units: dict[Place, str | None] = {}
    angles: dict[Place, Place] = {}  # as a person finds them
    called: dict[Place, Place] = {}  # where the numbers stand that a message names
    for file in files:
        for field in _listed(file):
            unit, _ = _unit(field)
            is_unknown = unit is None and field.unit is not None
            if not is_unknown:
                place = file.name, _called(field)
                called[place] = file.name, field.name
                units[place] = "°C" if _is_in_celsius(field) else unit
        for found in quaternions_in(file.values):
            for angle in _ANGLES:
                place = file.name, _asked_as(found, angle)
                units[place], angles[place] = "rad", (file.name, f"the {angle} of {found.stem}")
    left_out = [name for file in files for name in file.left_out]
    wanted = [each for each in asked if _is_key(each.name)]
    matches = _with_only_orientation(matched(wanted, units, left_out), wanted, files)
    by_place = {called.get(place, place): match for place, match in matches.found.items()}
    shown = called | angles

    def as_shown(those: Mapping[Asked, Sequence[Place]]) -> dict[Asked, list[Place]]:
        return {e: [shown.get(place, place) for place in places] for e, places in those.items()}

    return Matches(by_place, as_shown(matches.undecided), as_shown(matches.in_unit))


def _called(field: Field) -> str:
    """What a field is called: a joint's number by the joint's name, in whatever place it stands."""
    if not field.of or not field.name.endswith("]"):
        return field.name
    quantity = re.split("[./]", field.name.removeprefix(field.topic).rpartition("[")[0])[-1]
    return f"{field.topic}/{field.of}.{quantity}"


def _with_only_orientation(
    matches: Matches, asked: Sequence[Asked], files: Sequence[_File]
) -> Matches:
    """The matches, and angles that are asked for once each, of the only quaternion there is."""
    orientations = [(file.name, q) for file in files for q in quaternions_in(file.values)]
    if len(orientations) != 1:
        return matches
    ((name, quaternion),) = orientations
    gone, found = {match.asked for match in matches.found.values()}, dict(matches.found)
    for angle in _ANGLES:
        place = name, _asked_as(quaternion, angle)
        likely = [a for a in asked if a.role == "output" and angle in re.split(r"[\W_]+", a.name)]
        if len(likely) == 1 and likely[0] not in gone and same_unit(likely[0].unit, "rad"):
            found.setdefault(place, Match(likely[0], ONLY_ORIENTATION))
    return replace(matches, found=found)


def _kept_in_a_unit(entries: Sequence[str]) -> set[str]:
    """The columns, as their lines say them, whose entries have a `to`, which goes with the name."""
    found, column = set(), ""
    for line in entries:
        if line.startswith("column = "):
            column = line
        elif line.startswith("to = "):
            found.add(column)
    return found


def _not_found(asked: Sequence[Asked], matches: Matches, kept: set[str]) -> Iterator[str]:
    """What a system asks for and no column is for certain, as comments."""
    found = {match.asked for match in matches.found.values()}
    for each in asked:
        if each not in found:
            said = f"Not found: {plain_line(each.name)} [{plain_line(each.unit)}]; "
            said += _on_lacking(each, matches, kept)
            yield ""
            yield textwrap.fill(said, 96, initial_indent="# ", subsequent_indent="# ",
                                break_on_hyphens=False, break_long_words=False)  # fmt: skip


def _on_lacking(each: Asked, matches: Matches, kept: set[str]) -> str:
    if not _is_key(each.name):
        return "a column's name has letters from A to Z alone: rename it in the system."
    why, places = "none is like it", matches.undecided.get(each, ())
    if places:
        why = f"it could be {_any_of(places)}"
    elif places := matches.in_unit.get(each, ()):
        why = f"none is called like it; by its unit it could be {_any_of(places)}"
    has_to = any(f"column = {toml(name)}" in kept for _, name in places)
    without = " and without `to`" if has_to else ""
    return f'{why}. Name its column [columns.{each.name}], with role = "{each.role}"{without}.'


def _any_of(places: Sequence[Place]) -> str:
    """The first of some columns, and how many more there are."""
    named = [plain_line(f"{name} of {file}" if file else name) for file, name in places]
    more = len(named) - _NAMED
    return " or ".join([*named[:_NAMED], *([f"one of {more} more"] if more > 0 else [])])


def _is_key(name: str) -> bool:
    """Whether `columns.toml` takes a name."""
    return re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,63}", name) is not None


def _without_numbers(path: Path, files: Sequence[_File]) -> UnusableInput:
    tables = [file.log for file in files if isinstance(file.log, DelimitedLog)]
    if uneven := next(filter(None, (table.uneven() for table in tables)), None):
        return uneven
    for table in tables:
        count = len(list(itertools.islice(table.rows(), 2)))
        if count < 2 and len(table.first) > 1:
            few = "only one row" if count else "no row"
            return UnusableInput(f"{path}: has {few} below its header; give a longer log.")
    unread = next((field for file in files for field in file.log.fields() if field.unread), None)
    texts = [f"{name}: {said}" for file in files for name, said in file.left_out.items()]
    nearly = next((said for said in texts if "mend" in said), None)
    if nearly is not None:
        return UnusableInput(f"{path}: holds no column of numbers; {' '.join(nearly.split())}.")
    if said := [note for file in files for note in file.log.notes]:
        return UnusableInput(f"{said[-1]}; so it holds no column of numbers.")
    if unread is None:
        return UnusableInput(
            f"{path}: holds no column of numbers; give another file, or a table of text a "
            "columns.toml of your own: [csv] says where it begins (skip_rows, header, units_row)."
        )
    return UnusableInput(f"{path}: holds no column of numbers: {unread.name} {unread.unread}.")


def _differs(timing: Timing, other: Timing) -> bool:
    """Whether two files of a folder have clocks that do not say the same."""
    if timing.stamps_s is None or other.stamps_s is None:
        return False
    return not np.array_equal(timing.stamps_s, other.stamps_s)


def _seen(name: str, log: Log, asked: Sequence[Asked], rate_hz: float | None) -> _File:
    """A log with its clock, and the numbers of the columns that are listed."""
    fields = _numeric(log)
    if len(fields) > MOST_COLUMNS:  # what is asked for is among those that are listed
        fields.sort(key=lambda field: not any(may_be(each, field.name) for each in asked))
    has_own_clock = any(log.clock_of(field.name) for field in fields)
    timing = Timing(()) if has_own_clock else timing_of(log, log.fields())
    timing = timing if rate_hz is None else at_rate(timing, rate_hz)
    of_clock = (timing.column, timing.nanoseconds)
    listed = [field for field in fields[:MOST_COLUMNS] if field.name not in of_clock]
    values = _all_values(log, listed)
    clocks = clocks_of(log, listed, timing, values)
    used = {clock.column for clock in clocks.values()}
    unlisted = left_out(log, values, {*of_clock, *used})
    values = {column: numbers for column, numbers in values.items() if column not in used}
    clocks = {column: clock for column, clock in clocks.items() if column not in used}
    return _File(name, log, fields, has_own_clock, timing, values, clocks, unlisted)


def _numeric(log: Log) -> list[Field]:
    return [f for f in log.fields() if f.example is not None and not f.is_aside]


def _has_numbers(log: Log) -> bool:
    try:
        return bool(_numeric(log))
    except UnusableInput:
        return False


# --- the columns


def _entries(
    file: _File, base: Timing, taken: set[str], found: Mapping[Place, Match]
) -> Iterator[str]:
    if len(file.fields) > MOST_COLUMNS:
        yield f"\n# {len(file.fields) - MOST_COLUMNS} more columns are not listed."
    yield from _not_listed(file, _never_changing(file))
    quaternions = list(quaternions_in(file.values))
    parts = {address for quaternion in quaternions for address in quaternion.addresses}
    for field in _listed(file):
        seen = replace(field, unit=field.unit or "1") if field.name in parts else field
        yield from _entry(file, base, seen, taken, found.get((file.name, field.name)))
    for quaternion in quaternions:
        matches = {angle: found.get((file.name, _asked_as(quaternion, angle))) for angle in _ANGLES}
        asked_for = [angle for angle in _ANGLES if matches[angle]] or _ANGLES[:1]
        for angle in asked_for:
            yield from _entry_of_angle(file, base, quaternion, angle, taken, matches[angle])


def _listed(file: _File) -> list[Field]:
    """The columns that get an entry."""
    same = _never_changing(file)
    return [f for f in file.fields if f.name not in same and len(_there(file, f))]


def _never_changing(file: _File) -> dict[str, float]:
    """Fields of messages of a known type that have one number all along: such types have many."""
    found = {}
    for field in file.fields:
        values = file.values.get(field.name)
        if field.is_typed and values is not None and len(values) > 1 and np.ptp(values) == 0.0:
            found[field.name] = float(values[0])
    return found


def _not_listed(file: _File, same: Mapping[str, float]) -> Iterator[str]:
    """What is left out of a log of messages, said once."""
    aside = [field for field in file.log.fields() if field.is_aside]
    stamped = next((f.name for f in aside if f.name.endswith("header.stamp.sec")), None)
    if any("covariance" in field.name for field in aside):
        yield "\n# Not listed: covariances, which are no measurements."
    if stamped is not None:
        address = toml(stamped.removesuffix(".sec"))
        yield f"\n# Not listed: stamps of headers; time = {address} takes that in its topic."
    for field in file.log.fields():
        if field.unread:
            yield f"\n# Not listed: {plain_line(field.name)} {field.unread}."
    yield from comments_on(file.left_out)
    if same:
        constant = ", ".join(f"{plain_line(name)} {value:.4g}" for name, value in same.items())
        yield "\n# Not listed, as they never change:"
        yield textwrap.indent(textwrap.fill(constant, 94, break_on_hyphens=False), "#   ")


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


def _entry(
    file: _File, base: Timing, field: Field, taken: set[str], match: Match | None
) -> Iterator[str]:
    there = _there(file, field)
    unit, remark = _unit(field)
    yield ""
    in_kelvin = _CELSIUS.sub("K", field.name) if unit == "K" else field.name
    name = match.asked.name if match else _name(in_kelvin, taken)
    in_address = [n for n in re.findall(r"\[([^\[\]]+)\]", field.name) if not n.isdigit()]
    is_named = field.of in ("", " ".join(in_address))
    of = "" if is_named else f", of {plain_line(field.of)}"
    yield f"[columns.{name}]  # {_range(there)}{of}"
    yield f"column = {toml(field.name)}{_seen_by(match)}"
    yield from _place(file, base, field.name)
    yield f'role = "{match.asked.role if match else "unused"}"'
    if match and match.asked.unit in SHOWN_ALONE and _is_in_celsius(field):
        unit, remark = match.asked.unit, ""
    if unit is None and match:
        unit, remark = match.asked.unit, f"{remark}; taken as the system has it"
    unit = unit or "1"
    yield f"unit = {toml(unit)}{remark}"
    yield from _to(name, unit, match)
    if len(there) < len(file.values[field.name]):
        yield from _missing(file, field.name, match)


def _to(name: str, unit: str, match: Match | None) -> Iterator[str]:
    """The unit that Python's numbers shall have, where it is not the SI unit."""
    if match is None:
        named = contradicted(name, si_unit(unit))
        if named is not None and same_unit(named, unit):
            yield f"to = {toml(unit)}  # as its name says; not under another one"
    elif _is_converted(unit, match.asked.unit):
        yield f"to = {toml(match.asked.unit)}  # as the system has it"


def _is_converted(unit: str, asked: str) -> bool:
    """Whether numbers in a unit can be had in the one asked for, which is not the SI unit."""
    try:
        conversion(unit, asked)
        return asked not in SHOWN_ALONE and conversion(asked, si_unit(asked)) != 1
    except ValueError:
        return False


def _there(file: _File, field: Field) -> Vector:
    """The numbers of a column; none where it cannot be listed."""
    values = file.values.get(field.name)
    if values is None or len(values) < 2 or values.dtype.kind not in "fiub":
        return np.empty(0)
    numbers = as_floats(values)
    return numbers[np.isfinite(numbers)]


def _angle_of(found: Quaternion, angle: str) -> str:
    """What an angle of a quaternion is called."""
    return f"{found.stem}_{angle}_rad"


def _asked_as(found: Quaternion, angle: str) -> str:
    """The same without words that say of any quaternion that it is one."""
    return _OF_ORIENTATION.sub("", f"/{found.stem}").strip("._/[ ") + f"_{angle}_rad"


def _seen_by(match: Match | None) -> str:
    """A mark where a column was taken for what is asked for by a guess."""
    return f"  # ? {match.seen}" if match and match.seen != SAME else ""


def _entry_of_angle(
    file: _File,
    base: Timing,
    found: Quaternion,
    angle: str,
    taken: set[str],
    match: Match | None,
) -> Iterator[str]:
    """An angle of a quaternion, as it may be wanted."""
    yield ""
    name = match.asked.name if match else _name(_angle_of(found, angle), taken)
    yield f"[columns.{name}]{_seen_by(match)}"
    yield f"quaternion = [{', '.join(map(toml, found.addresses))}]{found.remark}"
    others = ", ".join(f'"{other}"' for other in _ANGLES if other != angle)
    yield f'angle = "{angle}"  # or {others}'
    yield from _place(file, base, found.addresses[0])
    yield f'role = "{match.asked.role if match else "unused"}"'
    yield from _to(name, "rad", match) if match else ()
    numbers = as_floats(file.values[found.addresses[0]])
    if not np.isfinite(numbers).all():
        yield from _missing(file, found.addresses[0], match)


def _place(file: _File, base: Timing, name: str) -> Iterator[str]:
    """The file of a column, and its clock where it has another than the first file's."""
    if file.name:
        yield f"file = {toml(file.name)}"
    timing = file.timing_of(name)
    clock = (timing.column, timing.unit)
    if clock[0] is not None and clock != (base.column, base.unit):
        yield f"time = {toml(clock[0])}{_doubt(file, name)}"
        if clock[1] is not None:
            yield f"time_unit = {toml(clock[1])}"


def _doubt(file: _File, name: str) -> str:
    """A mark where the file's first clock is as long as a column's own."""
    stamps, first = file.timing_of(name).stamps_s, file.timing.stamps_s
    if name not in file.clocks or stamps is None or first is None or len(stamps) != len(first):
        return ""
    return "  # ? by its name"


def _missing(file: _File, name: str, match: Match | None) -> Iterator[str]:
    """What to do where a column has no number: a system's log goes on where a sensor failed."""
    if _is_of_a_stream(file, name):
        yield 'missing = "hold"  # ? a number in some rows only, as rows of others lie between'
    elif match is not None and match.asked.role == "output":
        yield 'missing = "nan"  # ? some have no number, and are not measured'
    else:
        yield 'missing = "split"  # ? some have no number; "nan" for a sensor, not for training'


def _is_of_a_stream(file: _File, name: str) -> bool:
    """Whether rows without a number are those of other streams, and not samples that are lost.

    Another column has its numbers in just those rows, or there are never more than a few in a row.
    """
    is_there = np.isfinite(as_floats(file.values[name]))
    if _usual_run(is_there[_in_order(file.timing_of(name), len(is_there))]) <= _SHORT_RUN:
        return True
    some = slice(None, None, max(len(is_there) // _MANY_ROWS, 1))
    here = is_there[some]
    for other, values in file.values.items():
        if other != name and values.dtype.kind in "fiub" and len(values) == len(is_there):
            there = np.isfinite(as_floats(values[some]))
            if there[~here].mean() > _MOST and there[here].mean() < 1.0 - _MOST:
                return True
    return False


def _in_order(timing: Timing, count: int) -> NDArray[np.intp]:
    """Rows as they come once they are sorted, where a file's streams stand one after the other."""
    if timing.stamps_s is None or len(timing.stamps_s) != count:
        return np.arange(count)
    return np.argsort(timing.stamps_s, kind="stable")


def _usual_run(is_there: NDArray[np.bool_]) -> float:
    """How many rows in a row usually have a number: one or two where clocks were merged."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_there, [False]]).astype(int)))
    return float(np.median(edges[1::2] - edges[::2]))


def _range(there: Vector) -> str:
    low, high = float(there.min()), float(there.max())
    return f"always {low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _unit(field: Field) -> tuple[str | None, str]:
    """A unit, None where the log does not say a known one, and a remark on where it is from."""
    if field.remark:
        return None, f"  # {field.remark}"
    if field.unit is not None:
        is_gravity = field.unit == "g" and re.match(r"a(cc|x|y|z)", field.name, re.I)
        if is_gravity:
            return "m/s^2", "\nscale = 9.80665  # ? the log counts in gravities"
        if _is_in_celsius(field):
            return "K", f"\noffset = 273.15  # the log counts in {field.unit}"
        try:
            si_unit(field.unit)
            return field.unit, ""
        except ValueError:
            return None, f"  # ? the log says {plain_line(field.unit)}, which is not known"
    if (cased := re.search(r"_([mkuM]N|MW)$", field.name)) is not None:
        return cased[1], "  # ? by its name"
    if _is_in_celsius(field):
        return "K", "  # ? by its name\noffset = 273.15  # it counts in °C"
    for pattern, unit in _UNITS_BY_NAME:
        if re.search(pattern, field.name.lower()):
            return unit, "  # ? by its name"
    return None, "  # ? the log does not say"


def _is_in_celsius(field: Field) -> bool:
    """Whether it counts in °C by what the log says, or by its name where the log says nothing."""
    if field.unit is None:
        return _CELSIUS.search(field.name) is not None
    return field.unit in SHOWN_ALONE


def _name(address: str, taken: set[str]) -> str:
    """A name of letters, digits and _ that no other column has; of `ö` and `ø` the o, of `ß` ss."""
    bare = re.sub(r"\s*\([^()]*\)\s*$", "", address).casefold()
    parted = unicodedata.normalize("NFKD", bare)
    letters = "".join(c for c in parted if not unicodedata.combining(c)).translate(_WHOLE)
    plain = re.sub(r"[^a-z0-9]+", "_", letters).strip("_") or "column"
    plain = plain if plain[0].isalpha() else f"column_{plain}"
    name, count = plain[:60].rstrip("_"), 2
    while name in taken:
        name, count = f"{plain[:56]}_{count}", count + 1
    taken.add(name)
    return name
