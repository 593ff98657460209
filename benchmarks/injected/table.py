"""Many flights summed up: a row for each fault, and one for each unsafe flight."""

import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from benchmarks.injected.catalogue import FAULTS
from benchmarks.injected.flight import Flown

LOWER_MPS, UPPER_MPS = 1.0, 0.5  # a harder contact with a stop is unsafe
FORMER_LOWER_MPS = 1.5  # what the first campaign called unsafe

COLUMNS = "phase, pilot, lower_mps, upper_mps, detected_s, degraded_s, failsafe_s, ended"

Row = dict[str, Any]


def is_unsafe(flown: Flown, lower_mps: float = LOWER_MPS) -> bool:
    """Whether a stop was met faster than this, or a motor turns at the end."""
    return flown.lower_mps > lower_mps or flown.upper_mps > UPPER_MPS or not flown.is_idle


def by_fault(flights: Iterable[Flown]) -> list[Row]:
    """A row for each fault that was flown, in the catalogue's order."""
    flown: dict[str, list[Flown]] = {}
    for flight in flights:
        flown.setdefault(flight.case.fault, []).append(flight)
    return [_summed_up(name, flown[name]) for name in FAULTS if name in flown]


def _summed_up(name: str, flights: Sequence[Flown]) -> Row:
    fault = FAULTS[name]
    unsafe = [flight for flight in flights if is_unsafe(flight)]
    detected = [flight.detected_s for flight in flights if flight.detected_s is not None]
    return {
        "fault": name,
        "group": fault.group,
        "obeys": fault.obeys,
        "survivable": fault.survivable,
        "flights": len(flights),
        "unsafe": len(unsafe),
        "unsafe_by_pilot": dict(Counter(flight.case.pilot for flight in unsafe)),
        "unsafe_above_1_5_mps": sum(is_unsafe(flight, FORMER_LOWER_MPS) for flight in flights),
        "worst_lower_mps": _rounded(max(flight.lower_mps for flight in flights)),
        "worst_upper_mps": _rounded(max(flight.upper_mps for flight in flights)),
        "not_idle": sum(not flight.is_idle for flight in flights),
        "not_whole": sum(not flight.is_whole for flight in flights),
        "worst_reach_m": _rounded(max(flight.reach_m for flight in flights)),
        "detected": len(detected),
        "median_detection_s": _rounded(statistics.median(detected)) if detected else None,
        "endings": dict(Counter(flight.ended for flight in flights).most_common()),
    }


def unsafe_rows(flights: Iterable[Flown]) -> dict[str, list[str]]:
    """By fault, a line of `COLUMNS` for each unsafe flight that some command could have saved."""
    found: dict[str, list[str]] = {}
    for flight in flights:
        if is_unsafe(flight) and FAULTS[flight.case.fault].survivable:
            found.setdefault(flight.case.fault, []).append(_unsafe_line(flight))
    return found


def _unsafe_line(flown: Flown) -> str:
    speeds = (f"{speed:.2f}" for speed in (flown.lower_mps, flown.upper_mps))
    times_s = (flown.detected_s, flown.degraded_s, flown.failsafe_s)
    times = ("-" if time_s is None else f"{time_s:.2f}" for time_s in times_s)
    idle = "" if flown.is_idle else ", motors turn"
    case = flown.case
    return ", ".join((case.moment.phase, case.pilot, *speeds, *times, flown.ended)) + idle


def printed(rows: Iterable[Row]) -> str:
    """The rows as lines of text."""
    head = f"{'fault':34s} unsafe  >1.5  lower  upper  noticed  most common ending"
    return "\n".join([head, *(_line(row) for row in rows)])


def _line(row: Row) -> str:
    noticed = "-" if row["median_detection_s"] is None else f"{row['median_detection_s']:.2f} s"
    ending, count = next(iter(row["endings"].items()))
    mark = "" if row["survivable"] else " (not survivable)"
    return (
        f"{row['fault']:34s} {row['unsafe']:3d}/{row['flights']:2d}"
        f" {row['unsafe_above_1_5_mps']:5d}  {row['worst_lower_mps']:5.2f}"
        f"  {row['worst_upper_mps']:5.2f}  {noticed:>7s}  {count} x {ending}{mark}"
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
