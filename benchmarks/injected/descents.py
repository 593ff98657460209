"""Blind descents from anywhere: the link or the range sensor is gone at a random moment.

Every plant differs from its rig file as far as calibration leaves it (thrust ±6 %, which a battery
takes, too; friction halved or doubled), and every wake is a multiple of what the file says.
"""

import itertools
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.injected.flight import REST_S, SECONDS, Case, Flown, Moment
from benchmarks.injected.table import is_unsafe

FIRST_SEED = 980_000_000
FAULTS = ("link cut", "range silent")
WAKE_FACTORS = (0.5, 1.0, 1.5, 2.0)
ON_THE_STOP_S = 1.5  # after the rest and before the end, when nothing can fall far


def cases(count: int, package: Path) -> list[Case]:
    """So many descents for each fault and wake, by PID alone and with the package in turn."""
    return [
        _case(fault, factor, n, package if n % 2 else None)
        for fault, factor, n in itertools.product(FAULTS, WAKE_FACTORS, range(count))
    ]


def _case(fault: str, wake_factor: float, number: int, package: Path | None) -> Case:
    seed = FIRST_SEED + zlib.crc32(f"{fault} {wake_factor}".encode()) % 1_000_000 + number
    begins_s = np.random.default_rng(seed).uniform(ON_THE_STOP_S, SECONDS - ON_THE_STOP_S) + REST_S
    moment = Moment("anywhere", seed, float(begins_s))
    return Case(fault, moment, package, is_mismatched=True, wake_factor=wake_factor)


def summed_up(flights: Sequence[Flown]) -> list[dict[str, Any]]:
    """A row for each fault and wake: how hard the sufferer meets the stops."""
    return [
        {"fault": fault, "wake_factor": factor} | _row(ones)
        for fault, factor in itertools.product(FAULTS, WAKE_FACTORS)
        if (ones := [flight for flight in flights if _is(flight.case, fault, factor)])
    ]


def _is(case: Case, fault: str, wake_factor: float) -> bool:
    return case.fault == fault and case.wake_factor == wake_factor


def _row(flights: Sequence[Flown]) -> dict[str, Any]:
    lower_mps = [flight.lower_mps for flight in flights]
    return {
        "flights": len(flights),
        "unsafe": sum(is_unsafe(flight) for flight in flights),
        "median_lower_mps": round(float(np.median(lower_mps)), 3),
        "p95_lower_mps": round(float(np.quantile(lower_mps, 0.95)), 3),
        "worst_lower_mps": round(max(lower_mps), 3),
        "worst_upper_mps": round(max(flight.upper_mps for flight in flights), 3),
        "highest_m": round(max(flight.height_m for flight in flights), 3),
    }


def printed(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as lines of text."""
    return "\n".join(
        f"{row['fault']}, wake x {row['wake_factor']:g}: "
        f"{row['unsafe']} of {row['flights']} unsafe; "
        f"lower stop {row['median_lower_mps']:.2f} m/s (median), {row['worst_lower_mps']:.2f} "
        f"(worst); upper {row['worst_upper_mps']:.2f}"
        for row in rows
    )
