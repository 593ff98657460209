"""What it is worth to say what an input does between samples.

`python -m benchmarks.real_systems.between --json docs/records/between-samples.json` fits two fast
systems with what the literature names built in, their inputs held in several ways and in steps of
several lengths. What is left of the forecasts is then the integration's. The Bouc–Wen oscillator is
simulated, and its constants are known (Noël and Schoukens, 2016).
"""

import time
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.real_systems.answering import recordings_of, system_of
from benchmarks.real_systems.cases import CASES
from benchmarks.records import write
from wakedeploy import Input
from wakedeploy.gap.search.comparison import errors
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel

_RECORDINGS = ("Silverbox, means removed", "Bouc–Wen oscillator (simulated)")
_WAYS = (("step", 1), ("linear", 1), ("bandlimited", 1), ("bandlimited", 2), ("bandlimited", 4))
TRUTH = {
    "mass_kg": 2.0, "damping": 10.0, "stiffness": 5e4, "alpha": 5e4, "gamma": 0.8, "delta": -1.1,
}  # fmt: skip


def fitted(name: str, hold: str, steps: int) -> dict[str, Any]:
    """Forecast errors and constants of one recording, with this hold and number of steps."""
    began_s = time.process_time()
    (case,) = (case for case in CASES if case.name == name)
    cls = type(system_of(case, "in"))
    inputs = [Input(i.name, i.unit, hold=hold) for i in cls.inputs]
    system = checked(type(cls.__name__, (cls,), {"inputs": inputs, "steps": steps})())
    model = LogModel(system, recordings_of(case, "in"))
    base = fitted_base(model)
    constants = {
        f.quantity: float(v) for f, v in zip(base.free, base.theta, strict=True) if f.quantity
    }
    (output,), (off,) = model.channels, errors(model, base, model.sealed())
    noise = float(np.exp(base.value(f"noise.{output[0]}")))
    return {
        "recording": name, "hold": hold, "steps": steps, "rms": float(off), "noise": noise,
        "unit": output[1], "forecast_s": model.horizon * model.dt_s, "constants": constants,
        "seconds": time.process_time() - began_s,
    }  # fmt: skip


@click.command()
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="write the record here")
def main(json_path: Path | None) -> None:
    """Print what is left of forecasts, way by way."""
    rows = []
    for name in _RECORDINGS:
        for hold, steps in _WAYS:
            rows.append(fitted(name, hold, steps))
            row = rows[-1]
            print(f"{name:32s} {hold:12s} {steps} steps: {row['rms']:.3g} {row['unit']}"
                  f" ({row['seconds']:.0f} s)", flush=True)  # fmt: skip
    if json_path:
        write(json_path, {"rows": rows, "truth": TRUTH})


if __name__ == "__main__":
    main()
