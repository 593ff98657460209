"""How often the 90 % intervals of single effects hold the truth, twenty cases each and more.

`python -m benchmarks.hidden_effects.coverage --out FOLDER [--workers N]` hides the library's
commonest effects, and those whose intervals are the hardest to get right, in the benchmark's two
plants at random strengths. Each is fitted as the workflow fits it: from the rig file, without a
word of the truth. Finished cases stay in the folder, so that a run goes on where it was stopped;
`--record` writes `docs/records/coverage.json`.
"""

import tempfile
import time
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.hidden_effects.cases import PLANTS, Case, size_of, values_at
from benchmarks.hidden_effects.measure import Measured
from benchmarks.hidden_effects.worlds import write_world
from benchmarks.records import FOLDER, write
from wakedeploy.core.files import append_json_line, read_json_lines
from wakedeploy.core.parallel import parallel_map
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.systems.gantry.findings import Size
from wakedeploy.gap.systems.gantry.flight import read_flights
from wakedeploy.gap.systems.gantry.search.answer import sizes_of
from wakedeploy.gap.systems.gantry.search.refitting import refitted
from wakedeploy.rig.file import default_rig

RECORD = "coverage.json"
CASES = 20  # of each effect
STRENGTHS_NATS = (20.0, 200.0)  # between them at random, evenly in their logarithm
# What most rigs have: motors that lag and sag, a late command, a thrust table that is a little
# off, friction, a sensor's scale, a draught.
COMMON = (
    "spool-lag-sufferer",
    "spool-lag-source",
    "command-latency",
    "battery-sag",
    "thrust-coefficient",
    "coulomb-friction",
    "viscous-friction",
    "range-scale",
    "crosswind-offset",
    "wake-strength",
)
HARD = ("stiction", "wake-deflection", "pwm-quantisation")  # bounded, or hidden by their own noise


def cases(effects: Sequence[str], each: int) -> list[Case]:
    """So many cases of each effect, in both plants, in turns."""
    return [_case(effect, number) for number in range(each) for effect in effects]


def _case(effect: str, number: int) -> Case:
    label = f"coverage/{effect}/{number}"
    seed = zlib.crc32(label.encode()) % 1_000_000
    rng = np.random.default_rng(seed)
    nats = round(float(np.exp(rng.uniform(*np.log(STRENGTHS_NATS)))))
    sign = 1 if rng.random() < 0.5 else -1
    values = values_at(effect, size_of(effect, nats, instant=False), default_rig(), sign)
    return Case(label, "effect", PLANTS[number % 2], seed, nats, {effect: values})


def fitted(case: Case) -> dict[str, Any]:
    """A case's line: for each parameter its value, its 90 % interval and the truth."""
    began_s = time.process_time()
    (effect, truth), rig = *case.effects.items(), case.model_rig
    with tempfile.TemporaryDirectory() as folder:
        world = Path(folder) / "world"
        flights = read_flights(write_world(case, world, Path(folder) / "truth.json"), rig)
    measured = Measured(rig, flights)
    found = rank(measured.model, measured.base, [effect])[0]
    _, fit = refitted(measured.model, found.fit)
    sizes = sizes_of(fit, effect)
    return {
        "case": case.name,
        "effect": effect,
        "plant": case.plant,
        "target_nats": case.nats,
        "gain_nats": found.gain_nats,
        "parameters": {name: _row(truth[name], size) for name, size in sizes.items()},
        "seconds": time.process_time() - began_s,
    }


def _row(truth: float, size: Size) -> dict[str, Any]:
    row = {"value": size.value, "low": size.low, "high": size.high, "unit": size.unit}
    return {"truth": truth, **row, "held": size.low <= truth <= size.high}


def run(wanted: Sequence[Case], out: Path, workers: int) -> list[dict[str, Any]]:
    """The lines of all cases; those that the folder has already are not made again."""
    kept = out / "coverage.jsonl"
    out.mkdir(parents=True, exist_ok=True)
    known = {line["case"]: line for line in read_json_lines(kept)}

    def keep(case: Case, line: dict[str, Any]) -> None:
        append_json_line(kept, line)
        known[case.name] = line
        click.echo(f"{case.name}: {_told(line)}")

    missing = [case for case in wanted if case.name not in known]
    parallel_map(fitted, missing, workers=workers, on_done=keep)
    return [known[case.name] for case in wanted]


def _told(line: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{name} {p['value']:.3g} [{p['low']:.3g}, {p['high']:.3g}] {p['unit']}, truth "
        f"{p['truth']:.3g}{'' if p['held'] else ': missed'}"
        for name, p in line["parameters"].items()
    )


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True)
@click.option("--each", type=click.IntRange(min=2), default=CASES, help="cases of each effect")
@click.option("--workers", default=2)
@click.option("--record", is_flag=True, help="write docs/records/coverage.json")
def main(out: Path, each: int, workers: int, record: bool) -> None:
    """Fit what is hidden, and count how often the interval held it."""
    lines = run(cases((*COMMON, *HARD), each), out, workers)
    for effect in (*COMMON, *HARD):
        held = [p["held"] for x in lines if x["effect"] == effect for p in x["parameters"].values()]
        click.echo(f"{effect:<20} {sum(held)} of {len(held)}")
    if record:
        write(FOLDER / RECORD, {"common": COMMON, "hard": HARD, "rows": lines})


if __name__ == "__main__":
    main()
