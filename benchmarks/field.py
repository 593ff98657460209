"""The compiled wake field beside its plain twin: microseconds a step, ratio, arithmetic, traffic.

All are timed in turns in one process, so that what else runs on the machine slows all alike. What
the core can do is measured with the fastest arithmetic found, multiply-adds in the first cache or
matrix products, and with copies between arrays as large as the field's.

    OMP_NUM_THREADS=1 python -m benchmarks.field --json docs/records/field.json
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np

from benchmarks import records
from wakedeploy.physics.field import WakeField
from wakedeploy.physics.field_grid import FieldGrid, FieldPhysics, blur_weights
from wakedeploy.physics.field_reference import ReferenceField

PAPER = FieldPhysics(
    speed_mps=6.0,
    diffusivity_m2ps=0.3,
    decay_per_s=0.3,
    strength=60.0,
    width_m=0.2,
    reference_thrust_n=4.41,
)
DT_S = 0.01
FMA_NUMBERS, FMA_ROUNDS = 1024, 1000
STEPS = {
    "numba": 100,
    "numpy": 10,
    "dense blur": 100,
    "multiply-adds": 20,
    "copies": 200,
}  # a turn's, some ten milliseconds each


def main() -> None:
    """Measure, print, write."""
    options = _options()
    result = measured(FieldGrid(columns=options.columns, rows=options.rows), options.turns)
    for name, value in result.items():
        print(f"{name:28} {value:.4g}" if isinstance(value, float) else f"{name:28} {value}")
    if options.json:
        records.write(options.json, result)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--columns", type=int, default=100)
    parser.add_argument("--rows", type=int, default=80)
    parser.add_argument("--turns", type=int, default=30)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def measured(grid: FieldGrid, turns: int) -> dict[str, int | float]:
    """Medians over turns; a source that tilts, so that all four operations have work to do."""
    fast, plain = (cls(grid, PAPER, dt_s=DT_S) for cls in (WakeField, ReferenceField))
    for n in range(40):  # compile, and fill the grid with a wake
        for field in (fast, plain):
            field.step(0.1 * np.sin(0.2 * n), 0.0, 0.3 * np.cos(0.2 * n), 4.41)
    steps = {
        "numba": lambda: fast.step(0.0, 0.0, 0.2, 4.41),
        "numpy": lambda: plain.step(0.0, 0.0, 0.2, 4.41),
        "dense blur": _dense_blur(grid),
        "multiply-adds": _multiply_adds(),
        "copies": _copies(grid),
    }
    us = {name: [] for name in steps}
    for _ in range(turns):
        for name, step in steps.items():
            us[name].append(_microseconds(step, STEPS[name]))
    ratios = np.array(us["numpy"]) / np.array(us["numba"])
    return {
        "columns": grid.columns,
        "rows": grid.rows,
        "numba_us": float(np.median(us["numba"])),
        "numpy_us": float(np.median(us["numpy"])),
        "ratio": float(np.median(ratios)),
        "ratio_worst_turn": float(ratios.min()),
        "dense_blur_alone_us": float(np.median(us["dense blur"])),
    } | _work(grid, {name: float(np.median(values)) for name, values in us.items()})


def _microseconds(step: Callable[[], object], count: int) -> float:
    start = time.perf_counter()
    for _ in range(count):
        step()
    return (time.perf_counter() - start) / count * 1e6


def _dense_blur(grid: FieldGrid) -> Callable[[], object]:
    """The blur of both components as two matrix products, for comparison."""
    cells = grid.columns, grid.rows
    across, along = (_band_matrix(n, 2 * 0.3 * DT_S / 0.06**2) for n in cells)
    field = np.random.default_rng(0).normal(size=(2, *cells))
    return lambda: across @ field @ along


def _band_matrix(cells: int, variance_cells2: float) -> np.ndarray:
    weights = blur_weights(np.array([variance_cells2]))[0]
    apart = np.abs(np.subtract.outer(np.arange(cells), np.arange(cells)))
    return np.where(apart < len(weights), weights[np.minimum(apart, len(weights) - 1)], 0.0)


@numba.njit(fastmath={"contract"})
def _fma(values: np.ndarray, rounds: int) -> None:
    for _ in range(rounds):
        for i in range(len(values)):
            values[i] = values[i] * 0.999 + 0.001


def _multiply_adds() -> Callable[[], object]:
    """Rounds of one multiply-add for each of some numbers that fit into the first cache."""
    values = np.zeros(FMA_NUMBERS)
    return lambda: _fma(values, FMA_ROUNDS)


def _copies(grid: FieldGrid) -> Callable[[], object]:
    """One copy of both components, read and written."""
    here, there = np.ones((2, grid.columns, grid.rows)), np.empty((2, grid.columns, grid.rows))
    return lambda: np.copyto(there, here)


def _work(grid: FieldGrid, us: dict[str, float]) -> dict[str, int | float]:
    """Floating-point operations and bytes of one compiled step, counted from its source.

    Per cell: injecting 4; how far its air has gone 3, the cubic's weights 17 (though the code
    computes them for either component), its sums 2 × 13; each of the two blurs of two components
    1 + 3 R. Bytes: at least both components are read and written once; this code's three operations
    each do so. `times_least` is how much longer a step takes than its arithmetic at the fastest
    measured rate or its least traffic at that of copies, whichever is more.
    """
    cells = grid.columns * grid.rows
    reach = blur_weights(np.array([2 * 0.3 * DT_S / grid.cell_x_m**2])).shape[1] - 1
    flops = cells * (4 + 3 + 17 + 2 * 13 + 2 * 2 * (1 + 3 * reach))
    least_bytes = cells * 2 * 8 * 2
    fma_per_us = 2 * FMA_NUMBERS * FMA_ROUNDS / us["multiply-adds"]
    product_per_us = 2 * 2 * cells * (grid.columns + grid.rows) / us["dense blur"]
    flops_per_us = max(fma_per_us, product_per_us)
    bytes_per_us = least_bytes / us["copies"]
    least_us = max(flops / flops_per_us, least_bytes / bytes_per_us)
    return {
        "blur_reach_cells": reach,
        "flops": flops,
        "least_bytes": least_bytes,
        "bytes_between_operations": 3 * least_bytes,
        "gflops_per_s": flops / us["numba"] * 1e-3,
        "multiply_adds_gflops_per_s": fma_per_us * 1e-3,
        "matrix_product_gflops_per_s": product_per_us * 1e-3,
        "copies_gbytes_per_s": bytes_per_us * 1e-3,
        "arithmetic_alone_us": flops / flops_per_us,
        "least_traffic_alone_us": least_bytes / bytes_per_us,
        "present_traffic_alone_us": 3 * least_bytes / bytes_per_us,
        "times_least": us["numba"] / least_us,
    }


if __name__ == "__main__":
    main()
