"""How fast the 2D downwash simulator flies, per core, against real time.

Recording the force on the sufferer, and flying episodes in lockstep with each model in the loop, at
the default grid, in episodes as long as those of a set. Turns of all are mixed in one process, so
that what else runs slows all alike; the compiled step's own share is the first line. Untrained
models cost what trained ones do.

    OMP_NUM_THREADS=1 python -m benchmarks.downwash --json docs/records/downwash-speed.json
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from benchmarks import records
from trainers.build import ARCHITECTURES, build
from trainers.inspection.lockstep import Lockstep
from trainers.model import Predictor
from wakedeploy.domains.downwash import FORCE, OBSERVATION, RATE_HZ, WINDOW_S, World, fly

EPISODES = 16  # in lockstep
SETTLING_S = 1.0 + 3.0 * World().slowest_s  # flown, though not recorded


def main() -> None:
    """Measure, print, write."""
    options = _options()
    torch.set_num_threads(1)
    result = measured(options.seconds, options.turns)
    for name, value in result["times_real_time"].items():
        print(f"{name:28} {value['median']:7.1f} times real time (worst turn {value['worst']:.1f})")
    if options.json:
        records.write(options.json, result)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="recorded of each flight")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def measured(seconds: float, turns: int) -> dict[str, object]:
    """Seconds recorded of all episodes over seconds it took, settling included: median, worst."""
    jobs: dict[str, Callable[[], object]] = {
        "field alone": _field_alone(seconds),
        "recording": lambda: fly(range(EPISODES), seconds=seconds),
    }
    for arch in ARCHITECTURES:
        jobs[f"closed loop, {arch}"] = _closed_loop(arch, seconds)
    recorded_s = EPISODES * seconds
    speeds: dict[str, list[float]] = {name: [] for name in jobs}
    for job in jobs.values():
        job()  # compile, and warm the caches
    for _ in range(turns):
        for name, job in jobs.items():
            began = time.perf_counter()
            job()
            speeds[name].append(recorded_s / (time.perf_counter() - began))
    times_real_time = {
        name: {"median": float(np.median(turn_speeds)), "worst": min(turn_speeds)}
        for name, turn_speeds in speeds.items()
    }
    return {
        "episodes": EPISODES,
        "seconds": seconds,
        "turns": turns,
        "times_real_time": times_real_time,
    }


def _closed_loop(arch: str, seconds: float) -> Callable[[], object]:
    inputs, outputs = len(OBSERVATION), len(FORCE)
    core = build(
        arch, inputs=inputs, outputs=outputs, window_s=WINDOW_S, rate_hz=RATE_HZ, hyper={}, seed=0
    )
    predictor = Predictor(arch, core, inputs, outputs)
    predictor.force_sd.fill_(0.01)  # hardly pushes: an untrained model must not crash the flight
    return lambda: fly(range(EPISODES), seconds=seconds, expect=Lockstep(predictor))


def _field_alone(seconds: float) -> Callable[[], object]:
    """The air's own steps and samples, without bodies, controllers or observations."""
    world, steps = World(), round((seconds + SETTLING_S) * RATE_HZ)
    air = world.field(EPISODES)
    zero, up = np.zeros(EPISODES), np.full(EPISODES, 9.81)

    def run() -> None:
        for _ in range(steps):
            air.velocity(zero, zero - 2.3)
            air.step(zero, zero, zero, up)

    return run


if __name__ == "__main__":
    main()
