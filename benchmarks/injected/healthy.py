"""Flights in which nothing breaks: how often the loop ends one, or flies it without its package.

Every plant differs from its rig file as far as calibration leaves it, and every wake is stronger or
weaker than the file says.
"""

import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.injected.fault import NONE
from benchmarks.injected.flight import Case, Flown, Moment
from benchmarks.injected.table import is_unsafe

FIRST_SEED = 960_000_000
WAKES = {"0.5 to 2": (0.5, 2.0), "2 to 3": (2.0, 3.0)}  # the true force over the model's


def healthy_cases(wake: str, count: int, package: Path) -> list[Case]:
    """So many flights with wakes of one range, by PID alone and with the package in turn."""
    first_seed = FIRST_SEED + zlib.crc32(wake.encode()) % 1_000_000
    return [_case(WAKES[wake], first_seed + n, package if n % 2 else None) for n in range(count)]


def _case(wake: tuple[float, float], seed: int, package: Path | None) -> Case:
    factor = float(np.exp(np.random.default_rng(seed).uniform(*np.log(wake))))
    return Case(NONE.name, Moment("", seed, 0.0), package, is_mismatched=True, wake_factor=factor)


def summed_up(wake: str, flights: Sequence[Flown]) -> list[dict[str, Any]]:
    """A row for each pilot: endings, and how long flights were without their package."""
    by_pilot: dict[str, list[Flown]] = {}
    for flight in flights:
        by_pilot.setdefault(flight.case.pilot, []).append(flight)
    return [{"wake": wake, "pilot": pilot} | _row(ones) for pilot, ones in by_pilot.items()]


def _row(flights: Sequence[Flown]) -> dict[str, Any]:
    flying_s = sum(flight.case.moment.seconds for flight in flights)
    degraded_s = [flight.degraded_for_s for flight in flights]
    return {
        "flights": len(flights),
        "ended_early": sum(flight.ended != "whole" for flight in flights),
        "endings": dict(Counter(flight.ended for flight in flights).most_common()),
        "degraded_flights": sum(seconds > 0.0 for seconds in degraded_s),
        "degraded_share": round(sum(degraded_s) / flying_s, 6),
        "unsafe": sum(is_unsafe(flight) for flight in flights),
        "worst_lower_mps": round(max(flight.lower_mps for flight in flights), 3),
        "worst_upper_mps": round(max(flight.upper_mps for flight in flights), 3),
        "early": [
            _early(flight) for flight in flights if flight.ended != "whole" or is_unsafe(flight)
        ],
    }


def _early(flown: Flown) -> dict[str, Any]:
    return {
        "seed": flown.case.moment.seed,
        "wake_factor": round(flown.case.wake_factor, 3),
        "ended": flown.ended,
        "failsafe_s": None if flown.failsafe_s is None else round(flown.failsafe_s, 3),
        "lower_mps": round(flown.lower_mps, 3),
        "upper_mps": round(flown.upper_mps, 3),
    }


def printed(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as lines of text."""
    return "\n".join(_line(row) for row in rows)


def _line(row: dict[str, Any]) -> str:
    return (
        f"wake x {row['wake']}, {row['pilot']}: {row['ended_early']} of {row['flights']} ended "
        f"early, {row['unsafe']} unsafe, DEGRADED for {100.0 * row['degraded_share']:.2f} % of the "
        f"time in {row['degraded_flights']}; {row['endings']}"
    )
