"""A flight of many hours in lockstep: does anything grow, drift, leak or get lost?

The loop, the wire, the board and the recorder are those of a flight at the rig; time is simulated.
Behind one another it flies random plans of a minute. A flight that a failsafe ends is counted, and
the next one goes on. One core takes about a quarter of an hour for 10⁶ ticks, 8.7 hours of flight.

    python -m benchmarks.soak --package gru.onnx --json docs/records/soak.json
"""

import argparse
import itertools
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from benchmarks import records
from runtime.bench import resident_mb
from runtime.loop.loop import PERIOD_S
from runtime.loop.tally import Tally
from runtime.reference import FlightPlan, random_plan
from runtime.request import RunRequest
from runtime.run import fly
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.package import read_package
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.rig.file import default_rig

TICKS = 1_000_000
PLAN_S = 60.0
SAMPLES = 20  # of memory and descriptors, in the record
TICKS_PER_H = 3600.0 * LOOP_RATE_HZ
SEQUENCES = 1 << 16


@dataclass
class Growth:
    """Resident memory [10⁶ bytes] and open descriptors over the ticks of a flight."""

    ticks: list[int] = field(default_factory=list)
    resident_mb: list[float] = field(default_factory=list)
    descriptors: list[int] = field(default_factory=list)

    def look(self, flown_s: float, total_s: float) -> None:
        """Note what this process holds now; called while the loop runs."""
        self.ticks.append(round(flown_s / PERIOD_S))
        self.resident_mb.append(resident_mb())
        self.descriptors.append(len(os.listdir("/proc/self/fd")))

    def mb_per_h(self) -> float:
        """The slope of memory over the second half of the flight; NaN for too short a one."""
        late = [i for i, tick in enumerate(self.ticks) if tick >= self.ticks[-1] / 2]
        if len(late) < 3:
            return float("nan")
        ticks, held = np.take(self.ticks, late), np.take(self.resident_mb, late)
        return float(np.polyfit(ticks / TICKS_PER_H, held, 1)[0])

    def thinned(self) -> dict[str, list[float]]:
        """A few of the samples, the first and the last among them."""
        chosen = np.unique(np.linspace(0, len(self.ticks) - 1, SAMPLES).round().astype(int))
        return {name: np.take(values, chosen).tolist() for name, values in asdict(self).items()}


@dataclass
class Logged:
    """What a log says of its ticks: how many, what is missing, how well the clocks kept step."""

    rows: int = 0
    lost: int = 0
    unanswered: int = 0
    faults: int = 0  # rows with one
    latest_ms: float = 0.0  # a tick's reading after its time on the grid
    drift_us: float = 0.0  # of the mean lateness, from the first tenth to the last
    oldest_pulse_ms: float = 0.0  # since the newest pulses reached the pins
    mb_per_h: float = 0.0


def soak_plan(rig: Rig, ticks: int, seed: int) -> FlightPlan:
    """Random plans of a minute, one behind the other, each from stop to stop."""
    minutes = -(-ticks // round(PLAN_S * LOOP_RATE_HZ))
    plans = [random_plan(rig, PLAN_S, 1000 * seed + number) for number in range(minutes)]
    columns = ("z_m", "x_m", "source_us")
    return FlightPlan(*(np.concatenate([getattr(p, c) for p in plans])[:ticks] for c in columns))


def soaked(ticks: int, package: Path | None, folder: Path) -> dict[str, Any]:
    """Fly `ticks` ticks; return what grew, drifted, leaked or got lost."""
    flights: list[dict[str, Any]] = []
    while (remaining := ticks - sum(flight["ticks"] for flight in flights)) > 0:
        flights.append(_flown(remaining, package, folder, seed=len(flights)))
    longest = max(flights, key=lambda flight: int(flight["ticks"]))
    return {
        "ticks": sum(flight["ticks"] for flight in flights),
        "arch": read_package(package).manifest.arch if package else None,
        "ended": [flight["ended"] for flight in flights],
        "lost": sum(flight["log"]["lost"] + flight["dropped"] for flight in flights),
        "unanswered": sum(flight["log"]["unanswered"] for flight in flights),
        "faults": sum(flight["log"]["faults"] for flight in flights),
        "longest": longest,
    }


def _flown(ticks: int, package: Path | None, folder: Path, seed: int) -> dict[str, Any]:
    rig, log = default_rig(), folder / f"soak-{seed}.mcap"
    plan = soak_plan(rig, ticks, seed)
    request = RunRequest(rig, ticks * PERIOD_S, seed=seed, plan=plan, package=package, log=log)
    growth, tallies = Growth(), list[Tally]()
    try:
        fly(request, tell=tallies.append, show=growth.look)
    except CheckFailed as error:
        print(error, file=sys.stderr)
    (tally,) = tallies
    logged = read_back(log)
    log.unlink()
    return {
        "ticks": tally.ticks,
        "ended": tally.ended,
        "dropped": tally.ticks - logged.rows,
        "skipped": tally.skipped,
        "resident_mb_per_h": growth.mb_per_h(),
        "growth": growth.thinned(),
        "log": asdict(logged),
    }


def read_back(log: Path) -> Logged:
    """What a log says, row by row: it may be larger than memory."""
    logged = Logged()
    late_s, before = [], None
    for row in _rows(log):
        logged.rows += 1
        logged.faults += bool(row["faults"])
        late_s.append(row["t_s"] - row["tick"] * PERIOD_S)
        pulse_ms = 1e3 * (row["t_s"] - row["applied_time_s"])
        logged.oldest_pulse_ms = max(logged.oldest_pulse_ms, pulse_ms)
        if before is not None:
            logged.lost += row["tick"] - before["tick"] - 1
            logged.unanswered += (row["seq_echo"] - before["seq_echo"]) % SEQUENCES != 1
        before = row
    late_us = 1e6 * (np.array(late_s) - late_s[0])
    tenth = max(len(late_us) // 10, 1)
    logged.latest_ms = float(np.ptp(late_us)) / 1e3
    logged.drift_us = float(np.mean(late_us[-tenth:]) - np.mean(late_us[:tenth]))
    logged.mb_per_h = log.stat().st_size / 1e6 / (logged.rows / TICKS_PER_H)
    return logged


def _rows(log: Path) -> Iterator[dict[str, Any]]:
    """Ticks, each of the messages that have its number."""
    with log.open("rb") as stream:
        messages = (message for _, _, message in make_reader(stream).iter_messages())
        for _, tick in itertools.groupby(messages, lambda message: message.sequence):
            yield {
                key: value for message in tick for key, value in json.loads(message.data).items()
            }


def main() -> None:
    """Fly, read the log back, print, write."""
    options = _options()
    with tempfile.TemporaryDirectory() as folder:
        result = soaked(options.ticks, options.package, Path(folder))
    print(json.dumps(result, indent=1))
    if options.json:
        records.write(options.json, result)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=TICKS)
    parser.add_argument("--package", type=Path, help="without one: PID alone")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
