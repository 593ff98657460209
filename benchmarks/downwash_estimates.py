"""What hangs on the constants of the 2D downwash simulator that the paper leaves open.

Each estimate is made a quarter smaller and a third larger, one at a time; a small set is flown, a
model without memory and one with are trained, and both are flown. Prints a table that says for each
estimate what was chosen and why, and how the two findings move with it.

    OMP_NUM_THREADS=1 python -m benchmarks.downwash_estimates \
        --json docs/records/downwash-estimates.json
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch

from benchmarks import records
from wakedeploy.core.parallel import parallel_map
from wakedeploy.domains.downwash import World, make_set
from wakedeploy.physics.field import FieldGrid
from wakedeploy.study.closed_loop import LIMITS, Model, mean_force, track
from wakedeploy.study.domains import predicted
from wakedeploy.study.runs import Wanted, obtained

MINUTES, EPOCHS, FLIGHTS, FLIGHT_S = 5.0, 15, 6, 12.0
MODELS = ("agile-mlp", "history-mlp")
FACTORS = (0.75, 4.0 / 3.0)
ESTIMATES = {  # field of World: symbol and unit, and why this value
    "strength": (
        "S [m/s²]",
        "a hovering source pushes a tenth of the sufferer's weight at 2.3 m",
    ),
    "width_m": ("σ [m]", "the jet's Gaussian as wide as the rotors of a 1 kg multicopter"),
    "decay_per_s": ("λ [1/s]", "11 % lost on the way down: most of the wake arrives"),
    "drag_area_m2": ("C_d·A [m²]", "a body of 0.25 m squared with C_d about 1"),
    "mass_kg": ("m [kg]", "a small multicopter; both alike"),
    "inertia_kgm2": ("I [kg·m²]", "1 kg whose mass sits at 0.14 m, half an arm"),
    "sway_m": ("way sideways [m]", "as wide as the wake below: now in it, now beside it"),
    "heave_m": ("the source's way up and down [m]", "moves its thrust by a tenth"),
    "turning_rad_ps": (
        "fastest sine of the ways [rad/s]",
        "in one transport delay the source goes as far as the wake is wide",
    ),
}
GRIDS = {  # of 100 × 80 cells of 6 cm, 3 m to either side, from 1.2 m above to 3.6 m below
    "cells × 0.5": FieldGrid(0.03, 0.03, -2.985, -3.585, 200, 160),
    "grid × 0.75 sideways": FieldGrid(left_m=-2.19, columns=74),
    "grid × 1.33 sideways": FieldGrid(left_m=-3.99, columns=134),
    "grid × 1.33 below": FieldGrid(bottom_m=-4.77, rows=100),
}


def main() -> None:
    """Measure, write."""
    options = _options()
    jobs = [("as chosen", World())]
    for name in ESTIMATES:
        value = getattr(World(), name)
        jobs += [(f"{name} × {f:.2f}", World(**{name: f * value})) for f in FACTORS]
    jobs += [(name, World(grid=grid)) for name, grid in GRIDS.items()]
    measurements = parallel_map(measured, jobs, fresh=True)
    by_name = dict(zip([job[0] for job in jobs], measurements, strict=True))
    print(page(by_name))
    if options.json:
        records.write(options.json, by_name)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def measured(job: tuple[str, World]) -> dict[str, float]:
    """One world: force errors over standard deviation, and millimetres in closed loop."""
    torch.set_num_threads(1)
    _, world = job
    data = make_set(minutes=MINUTES, seed=0, world=world)
    result, models = {}, []
    with tempfile.TemporaryDirectory() as runs:
        for arch in MODELS:
            predictor = obtained(data, Wanted(arch, 0, EPOCHS), Path(runs))
            truth, forces, _ = predicted(predictor, data)
            shares = np.sqrt(np.mean((forces - truth) ** 2, axis=0)) / truth.std(axis=0)
            result[f"{arch} share"] = float(np.sqrt(np.mean(shares**2)))
            models.append(Model(arch, [predictor], [""]))
    lines = track(models, FLIGHTS, FLIGHT_S, constant=mean_force(data), world=world, workers=1)
    result |= {f"{line.name} mm": 1e3 * line.mean_m for line in lines}
    for line in lines[len(LIMITS) :]:
        gained_m = lines[0].mean_m - line.mean_m
        result[f"{line.name} gain"] = gained_m / (lines[0].mean_m - lines[1].mean_m)
    return result


def page(by_name: dict[str, dict[str, float]]) -> str:
    """The estimates, why they are so, and how the findings move with each."""
    plain, memory = MODELS
    first = by_name["as chosen"]
    lines = [
        "# The constants of the 2D downwash simulator that the paper leaves open",
        "",
        "The paper gives the speed, 6 m/s, its diffusivity, 0.3 m²/s, the separation, 2.3 m, and "
        "the rate, 100 Hz. The other constants are estimates. Each is made a quarter smaller and a "
        "third larger, one at a time. The grid is made finer, narrower, wider and deeper.",
        "",
        f"A model without memory and one with are trained for {EPOCHS} epochs on {MINUTES:g} "
        "minutes. The tables have their force errors over the standard deviation, and tracking "
        f"errors over {FLIGHTS} flights.",
        "",
        "| estimate | value | why |",
        "| --- | --- | --- |",
    ]
    for name, (symbol, why) in ESTIMATES.items():
        lines.append(f"| {symbol}, `{name}` | {getattr(World(), name):g} | {why} |")
    lines.append(
        "| u_hover [N] | m·g | follows from m: a hovering source has the strength S |\n"
        "| the grid | 100 × 80 cells of 6 cm | a step sinks the wake by one cell; above and beside "
        "the air is at rest at the edges, below it flows out |"
    )
    lines += [
        "",
        f"| | {plain}: error | {memory}: error | no compensation [mm] | oracle [mm] | {plain} [mm] "
        f"| {memory} [mm] |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, variant in by_name.items():
        lines.append(
            f"| {name} | {variant[f'{plain} share']:.2f} | {variant[f'{memory} share']:.2f} "
            f"| {variant['no compensation mm']:.1f} | {variant['oracle mm']:.1f} "
            f"| {variant[f'{plain} mm']:.1f} | {variant[f'{memory} mm']:.1f} |"
        )
    ratios = [row[f"{plain} share"] / row[f"{memory} share"] for row in by_name.values()]
    gains, others = ([100 * row[f"{m} gain"] for row in by_name.values()] for m in (memory, plain))
    lines += [
        "",
        f"The error without memory is {min(ratios):.1f} to {max(ratios):.1f} times the error with "
        f"memory; it is {first[f'{plain} share'] / first[f'{memory} share']:.1f} times as chosen.",
        "",
        f"In flight the model with memory reaches {min(gains):.0f} to {max(gains):.0f} % of the "
        f"oracle's gain, and the one without {min(others):.0f} to {max(others):.0f} %.",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
