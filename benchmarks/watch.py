"""What `run-gantry --watch-gap` notices, how soon, and how often it is wrong.

Flies the default rig in simulation, every flight with a calibration drawn from the rig file's
spreads, without any effect and with six effects that the rig file lacks; watches every flight; and
times the watch. Two cores take about five minutes.

    python -m benchmarks.watch --json docs/records/watch.json
"""

import argparse
import functools
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks import records
from runtime.loop.watch import GapWatch
from wakedeploy.core.parallel import parallel_map
from wakedeploy.core.rig import Effect, EffectParameter, Rig
from wakedeploy.domains.gantry import record
from wakedeploy.physics.constants import constants_of, spreads_of, with_constants
from wakedeploy.rig.file import default_rig

FIRST_SEED = 800_000_000  # none of these flights has set a limit
SECONDS = 30.0
NO_EFFECT = "none"


def cases(rig: Rig) -> dict[str, tuple[dict[str, object], tuple[Effect, ...], Rig]]:
    """By name: what is different in truth, effects in truth, and the rig file that is watched."""
    ground = {"gain": (0.2, "1"), "height_m": (0.15, "m")}
    weaker = [0.9 * thrust for thrust in rig.thrust.sufferer.thrust_n]
    at_once = {"source": {"up_s": 0.0, "down_s": 0.0}}
    return {
        NO_EFFECT: ({}, (), rig),
        "spool lag missing": ({}, (), rig.without("spool")),
        "source's spool lag missing": ({}, (), rig.changed(spool=at_once)),
        "wake strength +40 %": ({"wake": {"strength": 1.4 * rig.wake.strength}}, (), rig),
        "transport speed -30 %": ({"wake": {"speed_mps": 0.7 * rig.wake.speed_mps}}, (), rig),
        "thrust -10 %": ({"thrust": {"sufferer": {"thrust_n": weaker}}}, (), rig),
        "ground effect 20 % below 0.15 m": ({}, (effect("ground-effect", ground),), rig),
    }


def effect(name: str, values: dict[str, tuple[float, str]]) -> Effect:
    """An effect as a rig file has it."""
    parameters = {key: EffectParameter(value=v, unit=unit) for key, (v, unit) in values.items()}
    return Effect(name=name, parameters=parameters)


def miscalibrated(rig: Rig, rng: np.random.Generator) -> tuple[Rig, float]:
    """A truth that differs from its rig file by the file's spreads, and its range bias [m]."""
    values, spreads = constants_of(rig), spreads_of(rig)
    drawn = {name: values[name] + spreads[name] * rng.standard_normal() for name in spreads}
    for name in drawn:
        if name.startswith(("rail.", "spool.")):
            drawn[name] = max(drawn[name], 0.001)
    delays_s = drawn["command.delay_s"] + drawn["range.delay_s"]
    round_trip_s = max(rig.latency.round_trip_s + delays_s, 0.002)
    moved = with_constants(rig, drawn).changed(latency={"round_trip_s": round_trip_s})
    return moved, drawn["range.bias_m"]


def watched(name: str, index: int) -> dict[str, float | None]:
    """One flight under the watch: when it was left, its largest score, milliseconds per tick."""
    rig = default_rig()
    changes, effects, model = cases(rig)[name]
    seed = FIRST_SEED + index
    truth, bias_m = miscalibrated(rig.changed(**changes), np.random.default_rng(seed))
    log = record(
        truth.model_copy(update={"effect": effects}),
        seconds=SECONDS,
        seed=seed,
        sensor_hook=lambda t_s, range_m, steps: (range_m + bias_m, steps),
        model_rig=model,
    )
    watch, rows = GapWatch(model), list(log.rows())
    began_s = time.process_time()
    for row in rows:
        watch.step(row)
    spent_ms = 1e3 * (time.process_time() - began_s) / len(rows)
    left_s = watch.report.first_left_s
    airborne_s = None if left_s is None else left_s - rig.disturbance.rest_s
    return {"noticed_s": airborne_s, "worst": watch.report.worst, "ms_per_tick": spent_ms}


def summed_up(name: str, flights: Sequence[dict[str, float | None]]) -> dict[str, object]:
    """One line of the table; seconds count from the start of the flight."""
    noticed = [flight["noticed_s"] for flight in flights if flight["noticed_s"] is not None]
    return {
        "effect": name,
        "flights": len(flights),
        "noticed": len(noticed) / len(flights),
        "median_s": float(np.median(noticed)) if noticed else None,
        "median_worst_score": float(np.median([flight["worst"] for flight in flights])),
    }


def main() -> None:
    """Fly, watch, print the table, write it."""
    options = _options()
    rows, times = [], []
    for name in cases(default_rig()):
        count = options.flights if name == NO_EFFECT else options.each
        one_flight = functools.partial(watched, name)
        flights = parallel_map(one_flight, range(count), workers=options.workers)
        times += [flight["ms_per_tick"] for flight in flights]
        rows.append(summed_up(name, flights))
        print(json.dumps(rows[-1]), file=sys.stderr)
    result = {"seconds": SECONDS, "ms_per_tick": float(np.median(times)), "rows": rows}
    for row in rows:
        after = "" if row["median_s"] is None else f", median after {row['median_s']:.1f} s"
        print(f"{row['effect']:34s} {100 * row['noticed']:5.1f} % of {row['flights']}{after}")
    print(f"{result['ms_per_tick']:.2f} ms of computing per tick (median over flights)")
    if options.json:
        records.write(options.json, result)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=120, help="Without an effect.")
    parser.add_argument("--each", type=int, default=20, help="With each effect.")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
