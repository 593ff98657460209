"""What is said of the columns of a log: once for each, however many pieces the log has.

In: a column in a piece. Out: sentences with the numbers of all pieces together.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.angles import Unwrapped
from wakedeploy.core.spikes import spikes_in
from wakedeploy.domains.tables.pieces import gap_between
from wakedeploy.domains.tables.resampling import is_long, refreshed, stale, usual_step_s
from wakedeploy.domains.tables.series import Series

Vector = NDArray[np.float64]

_FEW = 0.005  # the share of ticks or samples from which on it is said
_MOSTLY = 0.5  # the share of repeated samples from which on holes are their reason
_STEPS_APART = 1.5  # usual steps of the slowest column, from which on holes are told from them
_FASTER = 1.5  # samples a tick, from which on a column is one that is faster than the rate
_FILLED_BY = {  # what stands at the ticks in a silence
    "hold": "the last sample is held",
    "low-pass": "the last sample is held, before the filter",
    "interpolate": "a straight line is drawn over it",
    "average": "a straight line is drawn over it",
}


_FEWEST_MARKS, _MARKED = 2, 0.2  # of one number, and the share of a log up to which it is a mark
_FAR_FROM_OTHERS = 5.0  # times the range of all others
_LISTED = 3  # spikes whose numbers are all said


@dataclass
class _Tally:
    """What was seen of a column in the pieces so far."""

    column: Series
    rows: int = 0
    blank: int = 0
    lasts_s: float = 0.0
    outer_s: float = 0.0  # of that, before the first number and after the last
    ticks: int = 0
    fresh: int = 0
    silent_s: float = 0.0
    late_s: float = 0.0  # of all ticks that repeat a sample together
    in_holes: int = 0  # of those ticks, the ones within holes
    shortest_hole_s: float = np.inf
    usual_s: float = 0.0  # between samples
    passed: int = 0  # samples from the first tick to the last
    taken: int = 0  # of those, the newest at some tick
    turns: int = 0
    odd_jumps: int = 0


@dataclass
class Remarks:
    """Tallies by the column's name."""

    _tallies: dict[str, _Tally] = field(default_factory=dict)

    def read(self, column: Series, turned: Unwrapped) -> None:
        """Count the rows of a column, those without a number, and jumps by a turn."""
        tally = self._of(column)
        tally.rows += len(column.values)
        tally.blank += int(np.isnan(column.values).sum())
        stamps_s, (of_numbers_s, _) = column.times.stamps_s, column.with_numbers()
        tally.lasts_s += float(stamps_s[-1] - stamps_s[0])
        tally.outer_s += float(of_numbers_s[0] - stamps_s[0] + stamps_s[-1] - of_numbers_s[-1])
        tally.turns += turned.places
        tally.odd_jumps += turned.doubtful

    def brought(self, column: Series, ticks_s: Vector) -> None:
        """Count the ticks of a column, those with a new sample, and the longest silence."""
        if column.is_event:
            return
        tally = self._of(column)
        stamps_s, _ = column.with_numbers()
        tally.ticks += len(ticks_s)
        is_fresh = refreshed(stamps_s, ticks_s)
        tally.fresh += int(is_fresh.sum())
        self._count_samples(tally, stamps_s, ticks_s)
        self._count_repeats(tally, stamps_s, ticks_s[~is_fresh])
        newest, last = np.searchsorted(stamps_s, (ticks_s[0], ticks_s[-1]), side="right")
        inside_s = stamps_s[max(int(newest) - 1, 0) : int(last)]  # gaps between pieces tell nothing
        if stale(inside_s, ticks_s).any():
            steps_s = np.diff(np.append(inside_s, ticks_s[-1]))
            tally.silent_s = max(tally.silent_s, float(steps_s.max(initial=0.0)))

    @staticmethod
    def _count_samples(tally: _Tally, stamps_s: Vector, ticks_s: Vector) -> None:
        """Count the samples that ticks take and those between."""
        newest = np.searchsorted(stamps_s, ticks_s, side="right") - 1
        is_there = newest >= 0
        if not is_there.any():
            return
        newest = newest[is_there]
        tally.passed += int(newest[-1] - newest[0]) + 1
        tally.taken += len(np.unique(newest))

    @staticmethod
    def _count_repeats(tally: _Tally, stamps_s: Vector, again_s: Vector) -> None:
        """Count how old the samples are that ticks repeat, and which of those lie in holes."""
        newest = np.searchsorted(stamps_s, again_s, side="right") - 1
        again_s, newest = again_s[newest >= 0], newest[newest >= 0]
        tally.late_s += float((again_s - stamps_s[newest]).sum())
        steps_s = np.diff(stamps_s)
        if len(steps_s):
            tally.usual_s = max(tally.usual_s, usual_step_s(steps_s))
        is_hole = is_long(steps_s)
        within = newest[newest < len(steps_s)]
        holes_s = steps_s[within[is_hole[within]]]
        tally.in_holes += len(holes_s)
        if len(holes_s):
            tally.shortest_hole_s = min(tally.shortest_hole_s, float(holes_s.min()))

    def sentences(self) -> Iterator[str]:
        """A sentence for each thing that was noticed, with the columns of a log that share it."""
        columns: dict[tuple[Path, str], list[str]] = {}
        slowest_s = max((tally.usual_s for tally in self._tallies.values()), default=0.0)
        for tally in self._tallies.values():
            place = tally.column.place
            of_ticks = (_on_ticks(tally), _on_repeats(tally, slowest_s), _on_lost(tally))
            on_ticks = "; ".join(filter(None, of_ticks))
            for said in (_on_blanks(tally), _on_turns(tally), on_ticks):
                if said:
                    columns.setdefault((place.log.path, said), []).append(repr(place.address))
        for (path, said), named in columns.items():
            which = f"column {named[0]}" if len(named) == 1 else f"columns {', '.join(named)}"
            yield f"{path}, {which}: {said}"

    def _of(self, column: Series) -> _Tally:
        return self._tallies.setdefault(column.name, _Tally(column))


def mark_in(values: Vector) -> str | None:
    """What to say where one number stands again and again, far from all others: a mark, as -999."""
    there = values[np.isfinite(values)]
    for mark in (there.min(initial=np.inf), there.max(initial=-np.inf)):
        others = there[there != mark]
        count = len(there) - len(others)
        if not len(others) or not _FEWEST_MARKS <= count <= _MARKED * len(there):
            continue
        apart = min(abs(mark - others.min()), abs(mark - others.max()))
        with np.errstate(over="ignore"):  # what is absurdly large is refused later
            far = _FAR_FROM_OTHERS * np.ptp(others)
        if apart > far > 0.0:
            span = f"{others.min():.4g} to {others.max():.4g}"
            return (
                f"{count} of {len(there)} numbers are {mark:.10g}, and all others {span}; if that "
                f"stands for no reading, say absent = [{mark:.10g}]"
            )
    return None


def on_spikes(values: Vector, row: Callable[[int], str]) -> str | None:
    """What to say where a few numbers lie far from all others, as a glitch of a bus leaves them."""
    spikes = spikes_in(values)
    if not len(spikes):
        return None
    others = np.delete(values, spikes)
    far = [f"{value:.10g}" for value in values[spikes]]
    named = far[0] if len(far) == 1 else f"{len(far)} numbers, such as {far[0]}"
    mend = f"say absent = [{', '.join(far)}]" if len(far) <= _LISTED else "mend them in the log"
    return (
        f"{named} in {row(int(spikes[0]))}, far from all others, {np.nanmin(others):.4g} to"
        f" {np.nanmax(others):.4g}; if that is no measurement, {mend}"
    )


def _on_blanks(tally: _Tally) -> str:
    column = tally.column
    if column.wanted.column.missing == "split" and tally.blank:
        return f"{tally.blank} of {tally.rows} samples have no number, and a recording ends there"
    if column.wanted.column.missing != "hold" or not tally.blank:
        return ""
    if column.is_reading:
        if tally.ticks:
            return ""  # the ticks say it
        there = tally.rows - tally.blank
        return f"{there} of {tally.rows} samples have a number; the others are not measured"
    without = f"{tally.blank} sample{' has' if tally.blank == 1 else 's have'} no number"
    if column.wanted.column.resample is not None:
        left_out = (
            f", and {tally.outer_s:.3g} s before the first and after the last are left out"
            if tally.outer_s > _FEW * tally.lasts_s
            else ""
        )
        return f"{without}; the others alone are taken{left_out}"
    counts = ", and counts as measured" if _is_output(column) else ""
    if "force" in column.wanted.column.roles:
        counts = ", as a label that nobody measured"
    return f"{without}; the last one is held{counts}"


def _on_turns(tally: _Tally) -> str:
    """What is said of an angle that jumps by a turn, whether it goes on now or not."""
    entry = f"in [columns.{tally.column.name}]"
    odd = f"it jumps by more than half a turn at {_places(tally.odd_jumps)}, by no whole one"
    goes_on = tally.column.wanted.column.goes_on
    if not tally.turns:
        asks = f"if it turns so fast give wraps = true {entry}, else wraps = false"
        return f"{odd}; {asks}" if tally.odd_jumps and goes_on else ""
    more = f"; {odd}, and is left so" if tally.odd_jumps else ""
    if goes_on:
        return f"unwrapped at {_places(tally.turns)}{more}"
    return (
        f"jumps by a turn at {_places(tally.turns)}, as an angle that begins again{more}; wraps ="
        f" true {entry} lets it go on, wraps = false says that it is right so"
    )


def _places(count: int) -> str:
    return f"{count} place{'s' if count > 1 else ''}"


def _on_ticks(tally: _Tally) -> str:
    silent = f"silent for {tally.silent_s:.3g} s and less" if tally.silent_s else ""
    remark = f"{tally.fresh} of {tally.ticks} ticks have a new sample"
    if tally.fresh < tally.ticks and tally.column.is_reading:
        return "; ".join(filter(None, (silent, f"{remark}; the others are not measured")))
    if tally.fresh < tally.ticks and _is_output(tally.column):
        held = "the last sample is held, and counts as measured at the others"
        return "; ".join(filter(None, (silent, remark, held)))
    return f"{silent}; {_FILLED_BY[tally.column.wanted.method or 'hold']}" if silent else ""


def _on_repeats(tally: _Tally, slowest_s: float) -> str:
    """What is said of a column that is learnt from where it is slower than the ticks."""
    share = 1.0 - tally.fresh / max(tally.ticks, 1)
    if not _is_learnt_from(tally.column) or not tally.ticks or share < _FEW:
        return ""
    remark = f"{_percent(share)} of the ticks repeat a sample, which is"
    remark += f" {tally.late_s / (tally.ticks - tally.fresh):.2g} s old on average"
    if tally.column.wanted.method == "low-pass":
        remark += ", before the filter"
    if tally.in_holes > _MOSTLY * (tally.ticks - tally.fresh):
        return remark + _on_holes(tally.shortest_hole_s, slowest_s)
    if tally.column.wanted.column.roles != ("force",):
        return remark
    return f'{remark}; resample = "interpolate" in [columns.{tally.column.name}] mends that'


def _on_holes(shortest_s: float, slowest_s: float) -> str:
    """The `gap_s` that ends a recording at holes, where the slowest column has no such steps."""
    if shortest_s < _STEPS_APART * slowest_s:
        return ", in holes of the log"
    gap_s = gap_between(slowest_s, shortest_s)
    return f"; [split] gap_s = {gap_s} ends a recording at such holes"


def _on_lost(tally: _Tally) -> str:
    """What is said of a column that is learnt from where it has samples between ticks."""
    share = 1.0 - tally.taken / max(tally.passed, 1)
    if not _is_learnt_from(tally.column) or tally.column.wanted.method != "hold" or share < _FEW:
        return ""
    remark = f"{_percent(share)} of the samples are the newest at no tick, and are lost"
    if tally.passed < _FASTER * tally.ticks:
        return f"{remark}; a higher [resample] rate_hz takes more of them"
    if tally.column.wanted.column.roles == ("force",):
        return f'{remark}; resample = "average" in [columns.{tally.column.name}] takes all'
    return f'{remark}; [resample] method = "low-pass" takes all'


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.995 else "nearly all"


def _is_learnt_from(column: Series) -> bool:
    """Whether it is learnt from as it is: a force that looks ahead repeats and loses nothing."""
    is_held = column.wanted.method in ("hold", "low-pass")
    return is_held and bool({"observation", "force"} & set(column.wanted.column.roles))


def _is_output(column: Series) -> bool:
    return "output" in column.wanted.column.roles
