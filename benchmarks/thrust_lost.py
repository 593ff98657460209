"""How often a healthy flight is ended for thrust or sensor, and how soon a real failure is noticed.

Flies the gantry in simulation, every flight with a calibration drawn from the rig file's spreads:
as it is, with stronger wakes, with a battery that is pulled at a random moment, so that neither
motor turns on, and with something that comes into the range sensor's beam then, at any distance
that it measures. A processor core takes about a third of a second for each flight.

    python -m benchmarks.thrust_lost --json docs/records/thrust-lost.json
"""

import argparse
import functools
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks import records
from benchmarks.watch import miscalibrated
from wakedeploy.core.parallel import parallel_map
from wakedeploy.domains.gantry import record
from wakedeploy.rig.file import default_rig

FIRST_SEED = 920_000_000
SECONDS = 20.0
PULLED, BLOCKED = "pulled battery", "something in the beam"
NEAR_M, FAR_M = 0.05, 1.2  # where it is
WAKES = {"default wake": 1.0, "wake speed × 1.22 (force × 1.5)": 1.22}
WAKES |= {"wake speed × 1.5 (force × 2.25)": 1.5}
NAMED = {"thrust_lost", "sensor_frozen", "sensor_jump", "battery_lost"}


def flown(case: str, index: int) -> dict[str, object]:
    """One flight: what ended it, and how long after the battery was pulled [s]."""
    seed, rig = FIRST_SEED + index, default_rig()
    rng = np.random.default_rng(seed)
    strength = WAKES.get(case, 1.0) * rig.wake.strength
    truth, bias_m = miscalibrated(rig.changed(wake={"strength": strength}), rng)
    rest_s, idle_us = rig.disturbance.rest_s, rig.limits.pulse_us[0]
    # From the rest before take-off to half a second before the touch-down.
    pulled_s = float(rng.uniform(0.0, rest_s + SECONDS - 3.0))

    def battery(t_s: float, source_us: float, sufferer_us: float, _: float) -> tuple[float, float]:
        return (source_us, sufferer_us) if t_s < pulled_s else (idle_us, idle_us)

    hook: Callable[..., tuple[float, float]] | None = battery if case == PULLED else None
    there_m = float(rng.uniform(NEAR_M, FAR_M))
    noise_m = rig.range_sensor.noise_m

    def seen(t_s: float, range_m: float, steps: int) -> tuple[float, int]:
        if case == BLOCKED and t_s > pulled_s:
            return there_m + noise_m * float(rng.standard_normal()), steps
        return range_m + bias_m, steps

    log = record(
        truth,
        seconds=SECONDS,
        seed=seed,
        model_rig=rig,
        command_hook=hook,
        sensor_hook=seen,
    )
    failed = np.flatnonzero(log["mode"] == "FAILSAFE")
    began = failed[0] if len(failed) else len(log) - 1
    pulled_tick = min(int(np.searchsorted(log["t_s"], pulled_s)), len(log) - 1)
    return {
        "cause": str(log["faults"][began]) if len(failed) else "",
        "delay_s": float(log["t_s"][began] - pulled_s) if len(failed) else None,
        "height_m": float(log["true_z_m"][pulled_tick]),
        "off_m": there_m - float(log["true_z_m"][pulled_tick]),
        "risen_m": float(log["true_z_m"][pulled_tick:].max() - log["true_z_m"][pulled_tick]),
        "strongest_wake_n": float(log["true_wake_force_n"].min()),
    }


def summed_up(case: str, flights: list[dict[str, object]]) -> dict[str, object]:
    """One line: how many flights, what ended them, and the delays of a pulled battery."""
    causes = [str(flight["cause"]) for flight in flights]
    row: dict[str, object] = {
        "case": case,
        "flights": len(flights),
        "named": sum(bool(NAMED & set(cause.split("+"))) for cause in causes),
        "causes": {cause: causes.count(cause) for cause in sorted(set(causes))},
        "median_strongest_wake_n": float(
            np.median([flight["strongest_wake_n"] for flight in flights])
        ),
    }
    airborne = [
        flight for flight in flights if flight["delay_s"] is not None and flight["height_m"] > 0.05
    ]
    if case in (PULLED, BLOCKED) and airborne:
        delays = np.percentile([flight["delay_s"] for flight in airborne], [50, 90, 100])
        row["delay_in_the_air_p50_p90_max_s"] = delays.tolist()
    if case == BLOCKED:
        below = [
            flight for flight in flights if flight["off_m"] < -0.1 and flight["height_m"] > 0.05
        ]
        row["unnoticed_off_m"] = sorted(round(o["off_m"], 3) for o in flights if not o["cause"])
        row["seen_too_low"] = len(below)
        row["risen_p50_max_m"] = np.percentile([o["risen_m"] for o in below], [50, 100]).tolist()
    return row


def main() -> None:
    """Fly, count, print, write."""
    options = _options()
    rows = []
    for case in (PULLED, BLOCKED, *WAKES):
        count = options.flights if case == "default wake" else options.each
        flown_case = functools.partial(flown, case)
        rows.append(
            summed_up(case, parallel_map(flown_case, range(count), workers=options.workers))
        )
        print(json.dumps(rows[-1], ensure_ascii=False), file=sys.stderr)
    if options.json:
        records.write(options.json, {"seconds": SECONDS, "rows": rows})


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=200, help="With the default wake.")
    parser.add_argument("--each", type=int, default=40, help="Of every other case.")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
