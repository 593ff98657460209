"""One log, or one folder of logs, as recordings at an even rate.

In: a path, what its columns mean, the units wanted. Out: recordings, a piece for each stretch
without a hole.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.even_time import evened, unevenness
from wakedeploy.core.recording import Origin, Recording
from wakedeploy.core.units import contradicted, same_dimension
from wakedeploy.domains.tables.columns import Column, Columns
from wakedeploy.domains.tables.counters import begun_after, going_on, later, wrap_in
from wakedeploy.domains.tables.diagnosis import (
    clock_instead,
    far_apart,
    no_stretch,
    require_common_time,
    require_likely_rate,
    require_running,
)
from wakedeploy.domains.tables.formats.delimited import DelimitedLog
from wakedeploy.domains.tables.formats.messages import MessageLog
from wakedeploy.domains.tables.log import Clock, Log, Values, require_size
from wakedeploy.domains.tables.log_kinds import is_log, of_bags, of_folders, open_log
from wakedeploy.domains.tables.orientation import angle_of
from wakedeploy.domains.tables.pieces import (
    Stretch,
    common,
    covered,
    from_first,
    gap_between,
    longest_silence,
)
from wakedeploy.domains.tables.remarks import Remarks, mark_in, on_spikes
from wakedeploy.domains.tables.resampling import even_ticks
from wakedeploy.domains.tables.series import Place, Series
from wakedeploy.domains.tables.stamps import (
    Timeline,
    as_floats,
    as_numbers,
    begun_after_midnight,
    between_falls,
    in_seconds,
    is_time_of_day,
    on_mixed,
    on_repeats,
    origin_s,
    seconds_in,
    timeline,
    whole_ns,
    whole_start_s,
)
from wakedeploy.domains.tables.wanted import Wanted

Vector = NDArray[np.float64]
_Key = tuple[int, Clock | None]  # of a clock: its log, and all that says how it is read
_DAY_S = 86_400
_LOST_STEPS = 1.6  # usual ones, from which on a sample was lost between two
_ABSURD = 1e30  # in any unit, nothing has so much of anything


@dataclass
class FileReader:
    """One log, or one folder of logs, on its way to recordings."""

    path: Path
    name: str
    columns: Columns
    wanted: Mapping[str, Wanted]
    notes: list[str]
    _logs: dict[str, Log] = field(default_factory=dict)
    _remarks: Remarks = field(default_factory=Remarks)
    _origins: dict[str, Origin] = field(default_factory=dict)
    _clocks: dict[str, str] = field(default_factory=dict)

    def recordings(self) -> Iterator[Recording]:
        """Its pieces in their order; UnusableInput where there is none."""
        places = {name: self._place(column) for name, column in self.wanted.items()}
        self._clocks |= {name: place.stamped_by for name, place in places.items()}
        raw = self._raw(places.values())
        self.notes += [note for log in self._logs.values() for note in log.notes]
        self.notes += self._doubted_units(places)
        count = 0
        longest: list[Series] = []
        for series in self._sessions(places, raw):
            longest = max(longest, series, key=_samples)
            require_likely_rate(series, self.columns)
            require_common_time(series)
            for start_s, end_s in self._stretches(series):
                made = self._recording(series, start_s, end_s, count)
                if made is not None:
                    count += 1
                    yield made
        self.notes += self._remarks.sentences()
        if not count:
            raise no_stretch(self.path, longest, self.columns)
        self.notes += far_apart(longest)

    # --- what stands where

    def _doubted_units(self, places: Mapping[str, Place]) -> Iterator[str]:
        """Columns that their log states in another unit, or a name does."""
        stated: dict[int, Mapping[str, str | None]] = {}
        for name, place in places.items():
            units = stated.get(id(place.log))
            if units is None:
                units = stated[id(place.log)] = _stated_units(place.log)
            address = place.address
            unit = units.get(address, units.get(address.lstrip("/")))  # HDF5 has both spellings
            if (origin := self.wanted[name].origin(unit)) is not None:
                self._origins[name] = origin
            if said := self.wanted[name].doubt(unit):
                yield f"{place.log.path}, column {address!r}: {said}"

    def _log(self, file: str | None) -> Log:
        key = file or ""
        if key not in self._logs:
            self._logs[key] = open_log(self._member(file), self.columns.csv)
        return self._logs[key]

    def _member(self, file: str | None) -> Path:
        if file is None and is_log(self.path):
            return self.path
        if file is None and not any(self.path.iterdir()):
            raise UnusableInput(f"{self.path}: is an empty folder; give files, or another folder.")
        if file is None and (elsewhere := of_bags(self.path) or of_folders(self.path)) is not None:
            raise elsewhere
        if file is None:
            raise UnusableInput(
                f"{self.path}: is a folder; say in which of its files each column stands"
                ' (file = "state.csv" in its table), or give files.'
            )
        if not self.path.is_dir():
            raise UnusableInput(f"{self.path}: is one file; give the folder that holds {file}.")
        if (self.path / "metadata.yaml").is_file():
            raise UnusableInput(
                f'{self.path}: is one bag, of which all files are read; leave file = "{file}" out.'
            )
        if Path(file).name != file:
            raise UnusableInput(f"{self.path}: {file!r} is no name of a file in that folder.")
        require_size(self.path / file)
        return self.path / file

    def _place(self, wanted: Wanted) -> Place:
        column = wanted.column
        log = self._log(column.file)
        clock = self._clock_for(column, log)
        if isinstance(log, DelimitedLog):
            is_scaled = (column.scale, column.offset) != (1.0, 0.0)  # millivolts may be newtons
            if column.column is not None and not is_scaled:
                log.require_unit(column.address, column.unit)
            has_unit = clock is not None and clock.nanoseconds is None
            if clock is not None and has_unit and self.columns.time.format is None:
                log.require_unit(clock.address, clock.unit)
        return Place(log, column.address, clock, column.addresses)

    def _clock_for(self, column: Column, log: Log) -> Clock | None:
        """The clock of a column; None for a stated rate."""
        base, clock = self.columns.time, log.clock_of(column.addresses[0])
        unit = base.unit or (clock.unit if clock else "s")
        if column.time is not None:
            return Clock(column.time, column.time_unit or unit)
        if base.rate_hz is not None:
            return None
        if base.column is not None:
            topic = clock.address.rpartition(".")[0] + "." if clock else ""
            if base.nanoseconds is not None:
                return Clock(topic + base.column, "ns", topic + base.nanoseconds)
            return Clock(topic + base.column, unit)
        if clock is None:
            raise UnusableInput(
                f"{log.path}: has no clock of its own; give [time] column, or [time] rate_hz."
            )
        return clock

    def _raw(self, places: Iterable[Place]) -> dict[tuple[int, str], Values]:
        """Everything that is needed, each log read once, by log and address."""
        addresses: dict[int, set[str]] = {}
        stamps: dict[int, set[str]] = {}
        logs: dict[int, Log] = {}
        for place in places:
            key = id(place.log)
            logs[key] = place.log
            addresses.setdefault(key, set()).update(place.addresses)
            if place.clock is not None:
                both = (place.clock.address, place.clock.nanoseconds)
                of_clock = {address for address in both if address is not None}
                addresses[key] |= of_clock
                stamps.setdefault(key, set()).update(of_clock)
        return {
            (key, address): values
            for key, log in logs.items()
            for address, values in log.read(
                sorted(addresses[key]), stamps.get(key, frozenset())
            ).items()
        }

    # --- stamps

    def _sessions(
        self, places: Mapping[str, Place], raw: Mapping[tuple[int, str], Values]
    ) -> Iterator[list[Series]]:
        """The columns with their stamps; one list, or one for each piece between falls."""
        seconds = self._stamps(places, raw)
        numbers = {n: self._numbers(self.wanted[n], p, raw) for n, p in places.items()}
        for name, place in places.items():
            self._require_length(place, numbers[name], seconds[_clock_key(place)])
        for cuts in self._cuts(seconds, places):
            lines = {
                key: self._timeline(key, places, numbers, seconds[key][cut], cut.start or 0)
                for key, cut in cuts.items()
            }
            yield [
                self._series(self.wanted[n], p, lines[_clock_key(p)], numbers[n])
                for n, p in places.items()
            ]

    def _stamps(
        self, places: Mapping[str, Place], raw: Mapping[tuple[int, str], Values]
    ) -> dict[_Key, Vector]:
        """Each clock's stamps [s] from one origin."""
        found: dict[_Key, tuple[Values, Fraction]] = {}
        lengths: dict[_Key, int] = {}
        for place in places.values():
            key = _clock_key(place)
            if place.clock is None:
                longest = max(lengths.get(key, 0), len(raw[id(place.log), place.addresses[0]]))
                lengths[key] = longest
            elif key not in found:
                found[key] = self._clock(place, _counted(place, raw))
        if found and is_time_of_day(self.columns.time.format):
            found = self._past_midnight(places, found)
        if (wraps_at := self.columns.time.wraps_at) is not None:
            found = _past_wraps(found, wraps_at)
        starts = [whole_start_s(values, seconds) for values, seconds in found.values()]
        origin = origin_s([start for start in starts if start is not None])
        stamps_s = {key: in_seconds(*clock, origin) for key, clock in found.items()}
        rate_hz = self.columns.time.rate_hz or 1.0
        return stamps_s | {key: np.arange(n) / rate_hz for key, n in lengths.items()}

    def _past_midnight(
        self,
        places: Mapping[str, Place],
        found: Mapping[_Key, tuple[Values, Fraction]],
    ) -> dict[_Key, tuple[Values, Fraction]]:
        """The clocks with a day added to those that begin after midnight, where others do before.

        The parts of a recording may begin on either side of it.
        """
        days = dict(found)
        is_later = begun_after_midnight([values for values, _ in found.values()])
        for (key, (values, seconds)), is_next in zip(found.items(), is_later, strict=True):
            if is_next:
                days[key] = values + round(_DAY_S / seconds), seconds
                place = next(p for p in places.values() if _clock_key(p) == key)
                self.notes.append(
                    f"{place.log.path}: its times of day begin after midnight, and others before; "
                    "they are taken for those of the next day"
                )
        return days

    def _clock(self, place: Place, values: Values) -> tuple[Values, Fraction]:
        """A clock's numbers, and the seconds in its unit."""
        assert place.clock is not None
        form = self.columns.time.format
        numbers = as_numbers(values, form, place.row, place.clock_refused)
        require_running(place, numbers)
        if numbers.dtype.kind == "M":
            if np.isnat(numbers).any():
                row = place.row(int(np.argmax(np.isnat(numbers))))
                advice = clock_instead(place) or "mend or delete that row"
                raise place.clock_refused(f"has no stamp in {row}", advice)
            return numbers.astype("datetime64[ns]").astype(np.int64), Fraction(1, 10**9)
        try:
            unit = "ns" if form is not None else place.clock.unit
            seconds = seconds_in(unit)
        except ValueError as error:
            advice = "correct its unit in [time], or time_unit"
            raise place.clock_refused(f"has no unit of time: {error}", advice) from error
        self._require_no_wrap(place, numbers)
        named = contradicted(place.clock.address.partition("[")[0].lower(), unit)
        is_one = form is None and place.clock.nanoseconds is None
        if is_one and named is not None and same_dimension(named, "s"):
            self.notes.append(
                f"{place.log.path}, column {place.clock.address!r}: read as stamps in {unit}, and"
                f" its name says {named}; check the unit in [time], or time_unit"
            )
        return numbers, seconds

    def _require_no_wrap(self, place: Place, numbers: Values) -> None:
        """Refuse a counter that begins again where nobody said what to do about that."""
        base = self.columns.time
        is_open = base.wraps_at is None and base.falling == "refuse"
        if is_open and (end := wrap_in(numbers)) is not None:
            row = place.row(int(np.argmax(np.diff(numbers.astype(np.float64)) < 0)) + 1)
            advice = f"give [time] wraps_at = {end:.16g}, from where on it then goes on"
            raise place.clock_refused(f"is a counter that begins again at {row}", advice)

    def _timeline(
        self,
        key: _Key,
        places: Mapping[str, Place],
        numbers: Mapping[str, Vector],
        stamps_s: Vector,
        first: int,
    ) -> Timeline:
        """A clock's stamps from a row on, and what its columns have at each."""
        names = [name for name, place in places.items() if _clock_key(place) == key]
        place, base = places[names[0]], self.columns.time
        notes: list[str] = []
        instead = clock_instead(place)
        line = timeline(stamps_s, first, base, place.row, place.clock_refused, notes, instead)
        columns = [numbers[name] for name in names]
        notes += on_mixed(stamps_s, columns, base)
        notes += on_repeats(line, columns, base, place.row, place.clock_refused)
        called = f", column {place.clock.address!r}" if place.clock else ""
        self.notes += [f"{place.log.path}{called}: {note}" for note in notes]
        return line

    def _cuts(
        self, seconds: Mapping[_Key, Vector], places: Mapping[str, Place]
    ) -> list[dict[_Key, slice]]:
        """The rows of each clock in each piece between falls; all clocks fall equally often."""
        if self.columns.time.falling != "split":
            return [dict.fromkeys(seconds, slice(None))]
        pieces = {key: between_falls(stamps_s) for key, stamps_s in seconds.items()}
        counts = {key: len(cuts) for key, cuts in pieces.items()}
        if len(set(counts.values())) > 1:
            most, fewest = (f(counts, key=counts.__getitem__) for f in (max, min))
            called = {_clock_key(place): place.stamped_by for place in places.values()}
            raise UnusableInput(
                f'{self.path}: [time] falling = "split" needs clocks that begin again equally '
                f"often, and {called[most]} has {counts[most]} runs, {called[fewest]} "
                f"{counts[fewest]}; cut the files where a recording ends."
            )
        return [dict(zip(pieces, cuts, strict=True)) for cuts in zip(*pieces.values(), strict=True)]

    def _require_length(self, place: Place, values: Vector, stamps_s: Vector) -> None:
        if len(values) != len(stamps_s):
            reason = f"has {len(values)} samples for {len(stamps_s)} stamps"
            raise place.refused(reason, "give the clock of this column (time = …)")
        if len(values) < 2:
            raise place.refused("has fewer than two samples", "choose another column")

    # --- numbers

    def _numbers(
        self, wanted: Wanted, place: Place, raw: Mapping[tuple[int, str], Values]
    ) -> Vector:
        """A column's numbers as the log has them, or the angle that they give."""
        parts = [self._floats(place, raw[id(place.log), each]) for each in place.addresses]
        angle, marks = wanted.column.angle, list(wanted.column.absent)
        for part in parts:
            # Of a number that the log holds in single precision the decimals are others.
            standing = [np.isclose(part, mark, rtol=1e-6, atol=0.0) for mark in marks]
            for mark, there in zip(marks, standing, strict=True):
                part[there] = np.nan
                if not there.any():
                    self.notes.append(
                        f"{place.log.path}, column {place.address!r}: absent = {mark:.10g} stands "
                        "nowhere in it"
                    )
            said = (None if marks else mark_in(part)) or on_spikes(part, place.row)
            if said is not None:
                self.notes.append(f"{place.log.path}, column {place.address!r}: {said}")
        return parts[0] if angle is None else angle_of(place, angle, parts, self.notes)

    def _floats(self, place: Place, values: Values) -> Vector:
        if values.dtype == object:
            raise place.refused("holds texts", "leave it out, or choose another")
        if values.dtype.kind == "M":
            raise place.refused("holds dates", "leave it out, or choose another")
        with np.errstate(over="ignore"):
            return np.array(as_floats(values))

    def _series(self, wanted: Wanted, place: Place, times: Timeline, values: Vector) -> Series:
        values = wanted.converted(values)
        absurd = np.abs(values[times.order]) > _ABSURD
        if absurd.any():
            row = place.row(int(times.order[int(np.argmax(absurd))]))
            raise place.refused(f"is too large for a measurement in {row}", "mend or delete it")
        values = times.merged(values)
        absent = np.isnan(values)
        if absent.all():
            raise self._empty(place, times)
        if absent.any() and wanted.column.missing == "refuse":
            at = int(times.rows[int(np.argmax(absent))])
            reason = f"has no number in {place.row(at)}"
            raise place.refused(reason, wanted.advice_on_missing)
        shifted_s = times.stamps_s + wanted.column.shift_s
        turned = wanted.looked_through(values, times.stamps_s)
        values = turned.values if wanted.column.goes_on else values
        column = Series(wanted, place, replace(times, stamps_s=shifted_s), values)
        self._remarks.read(column, turned)
        return column

    def _empty(self, place: Place, times: Timeline) -> UnusableInput:
        """The sentence for a column without numbers, in the log or in one of its recordings."""
        if self.columns.time.falling != "split":
            return place.refused("has no number in any row", "choose another column")
        first, last = (place.row(int(times.order[at])) for at in (0, -1))
        reason = f"has no number from {first} to {last}, which is a recording"
        return place.refused(reason, "choose another column, or cut that recording off")

    # --- pieces

    def _stretches(self, series: Sequence[Series]) -> list[Stretch]:
        """The stretches of time that all columns cover."""
        found: list[Stretch] | None = None
        for column in series:
            here = self._covered(column)
            found = here if found is None else common(found, here)
        return [stretch for stretch in found or [] if np.isfinite(stretch).all()]

    def _covered(self, column: Series) -> list[Stretch]:
        stamps_s, gap_s = column.times.stamps_s, self.columns.split.gap_s
        values = column.values
        is_good = is_number = ~np.isnan(values)
        if column.is_event:
            return from_first(stamps_s, is_good)
        missing = column.wanted.column.missing
        if missing == "nan":
            is_good = np.ones(len(stamps_s), dtype=bool)
        if missing == "hold":
            stamps_s, values = stamps_s[is_number], values[is_number]
            is_good = is_number = is_number[is_number]
        silent = None
        if self.columns.resample and gap_s is None:
            is_drive = set(column.wanted.column.roles) == {"input"}
            silent = longest_silence(stamps_s, is_number, values if is_drive else None)
        if silent is not None:
            length_s = stamps_s[silent] - stamps_s[silent - 1]
            reason = f"is silent for {length_s:.3g} s from {stamps_s[silent - 1]:.6g} s on"
            usual_s = float(np.median(np.diff(stamps_s)))
            advice = f"give [split] gap_s = {gap_between(usual_s, length_s)}"
            if set(column.wanted.column.roles) != {"output"}:
                advice += f", or event = true in [columns.{column.wanted.name}]"
            raise column.place.refused(reason, advice)
        stretches = covered(stamps_s, is_good, gap_s)
        ends_with_numbers = gap_s is not None or column.wanted.column.resample is not None
        if missing == "hold" and stretches and not ends_with_numbers:  # up to the last row
            stretches[-1] = (stretches[-1][0], float(column.times.stamps_s[-1]))
        return stretches

    def _recording(
        self, series: Sequence[Series], start_s: float, end_s: float, number: int
    ) -> Recording | None:
        """A piece at its rate; None for one that is too short."""
        name = f"{self.name}-{number + 1}" if number else self.name
        if end_s - start_s < self.columns.split.shortest_s:
            return None
        sampled = (
            self._as_recorded(series, start_s, end_s)
            if self.columns.resample is None
            else self._resampled(series, start_s, end_s)
        )
        return (
            Recording(name, *sampled, self._origins, self._clocks) if len(sampled[0]) > 1 else None
        )

    def _as_recorded(
        self, series: Sequence[Series], start_s: float, end_s: float
    ) -> tuple[Vector, dict[str, Vector]]:
        first = series[0]
        for column in series:
            if not column.times.same_as(first.times):
                raise column.place.refused(
                    f"has another clock than {first.place.address!r}",
                    "give [resample] rate_hz, to which all columns are brought",
                )
        stamps_s = first.times.stamps_s
        inside = (stamps_s >= start_s) & (stamps_s <= end_s)
        kept_s = stamps_s[inside]
        if len(kept_s) < 2:
            return kept_s, {}
        self._require_even(first, kept_s, int(np.argmax(inside)))
        values = {column.name: column.filled()[inside] for column in series}
        return evened(kept_s), values

    def _require_even(self, column: Series, stamps_s: Vector, first: int) -> None:
        at = unevenness(stamps_s)
        if at is not None:
            row = column.place.row(int(column.times.rows[first + at]))
            step_s, usual_s = stamps_s[at] - stamps_s[at - 1], float(np.median(np.diff(stamps_s)))
            reason = f"steps by {step_s:.4g} s at {row}, where {usual_s:.4g} s is usual"
            raise column.place.clock_refused(reason, self._advice_on_steps(column, step_s))

    def _advice_on_steps(self, column: Series, step_s: float) -> str:
        """Samples that are lost end a recording; a clock that is never even needs a rate."""
        resample = "[resample] rate_hz where the clock is never even"
        steps_s = np.diff(column.times.stamps_s)
        usual_s = float(np.median(steps_s))
        if step_s < _LOST_STEPS * usual_s:
            return f"give {resample}"
        shortest_s = float(steps_s[steps_s >= _LOST_STEPS * usual_s].min())
        gap_s = gap_between(usual_s, shortest_s)  # which ends a recording at all such places
        now_s = self.columns.split.gap_s
        now = "" if now_s is None else f" (the one given, {now_s:g}, is longer)"
        return f"where samples are lost give [split] gap_s = {gap_s}{now}; {resample}"

    def _resampled(
        self, series: Sequence[Series], start_s: float, end_s: float
    ) -> tuple[Vector, dict[str, Vector]]:
        how = self.columns.resample
        assert how is not None
        start_s = _at_a_reading(series, start_s, 1.0 / how.rate_hz)
        half_s = 0.5 / how.rate_hz  # stamps that jitter may lie before the first tick
        clocks_s = [s.with_numbers()[0] for s in series if not s.is_event]
        inside_s = [c[(c >= start_s - half_s) & (c <= end_s + half_s)] for c in clocks_s]
        if max(map(len, inside_s), default=0) < 2 or (end_s - start_s) * how.rate_hz > 1e8:
            return np.empty(0), {}
        ticks_s = even_ticks(inside_s, start_s, end_s, how.rate_hz)
        if len(ticks_s) < 2:
            return ticks_s, {}
        for column in series:
            self._remarks.brought(column, ticks_s)
        return ticks_s, {column.name: column.at_ticks(ticks_s, how) for column in series}


def _at_a_reading(series: Sequence[Series], start_s: float, tick_s: float) -> float:
    """A start that is up to a tick later, at a sample of the column that is measured most often.

    From an input's first sample on, all readings would be late by the same part of a tick.
    """
    stamps_s = max((s.with_numbers()[0] for s in series if s.is_reading), key=len, default=None)
    after_s = np.empty(0) if stamps_s is None else stamps_s[stamps_s >= start_s]
    is_soon = len(after_s) > 0 and after_s[0] < start_s + tick_s
    return float(after_s[0]) if is_soon else start_s


def _stated_units(log: Log) -> Mapping[str, str | None]:
    """By address what a log says of its columns: beside their numbers, or by a message's type."""
    if isinstance(log, MessageLog):
        return log.fixed_units
    return {field.name: field.unit for field in log.fields()}


def _samples(series: Sequence[Series]) -> int:
    return sum(len(column.values) for column in series)


def _counted(place: Place, raw: Mapping[tuple[int, str], Values]) -> Values:
    """What a clock counts, from one column of stamps or two."""
    assert place.clock is not None
    key, beyond = id(place.log), place.clock.nanoseconds
    whole = raw[key, place.clock.address]
    return (
        whole
        if beyond is None
        else whole_ns(whole, raw[key, beyond], place.row, place.clock_refused)
    )


def _past_wraps(
    found: Mapping[_Key, tuple[Values, Fraction]], wraps_at: float
) -> dict[_Key, tuple[Values, Fraction]]:
    """The clocks as counters that go on, also where one part of a recording begins after a wrap."""
    gone_on = [going_on(values, wraps_at) for values, _ in found.values()]
    after = begun_after([float(values[0]) for values in gone_on], wraps_at)
    return {
        key: (later(values, int(is_after), wraps_at), seconds)
        for (key, (_, seconds)), values, is_after in zip(found.items(), gone_on, after, strict=True)
    }


def _clock_key(place: Place) -> _Key:
    return id(place.log), place.clock
