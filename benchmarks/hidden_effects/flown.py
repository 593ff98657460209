"""What an answer is worth in flight: both predictors on the plant that still hides the effect.

In: a case that has been judged, and its folder with the workflow's corrected rig file. Out: the
tracking error of the old rig file with a predictor trained on it, and of the new one with its own.
Here alone the hidden plant is flown again; training sees the two rig files and the logs.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hidden_effects.cases import FLIGHT_S, Case
from benchmarks.hidden_effects.judge import sealed
from benchmarks.hidden_effects.worlds import fly
from wakedeploy.gap.systems.gantry.retraining import Pilot, retrain, rms_over_flights, rms_ratio
from wakedeploy.rig.file import read_rig

# Effects whose neglect costs tracking, on both plants.
TRACKED = (
    "spool-lag-sufferer/50/1",
    "spool-lag-source/50/1",
    "transport-speed/50/0",
    "wake-strength/50/0",
    "command-latency/150/1",
    "wake-deflection/50/0",
    "spool-lag-sufferer+wake-strength/50/0",
)
_OF_TRAINING = ("unit", "old_rmse", "new_rmse", "ratio", "ratio_interval", "label_sd", "lead_s")
MINUTES = 6.0
EPOCHS = 20
SEEDS = tuple(920_000_000 + i for i in range(4))  # beyond those of all cases and of training


def tracked(case: Case, world: Path) -> dict[str, Any] | None:
    """Train on both rig files and fly both; None where the workflow corrected nothing.

    What `compared` tells, and under `retrain` the errors of both predictors [N] on the flights that
    the workflow sealed. Training and flights go into `world`, out of the workflow's sight by then.
    """
    corrected = world / "answer" / "rig.toml"
    if not corrected.exists():
        return None
    old, new = case.model_rig, read_rig(corrected)
    flights = {path.name: path for path in sorted(world.glob("flight*.mcap"))}
    logs = [flights[Path(name).name] for name in sealed(world, list(flights))]
    trained = retrain(
        old, new, logs, world / "retrain", minutes=MINUTES, epochs=EPOCHS, workers=1
    )  # fmt: skip
    before, after = (
        Pilot(rig, Path(trained.packages[name])) for name, rig in (("old", old), ("new", new))
    )
    kept = trained.model_dump(mode="json", include=set(_OF_TRAINING))
    return compared(case, before, after) | {"retrain": kept}


def compared(
    case: Case,
    before: Pilot,
    after: Pilot,
    seeds: Sequence[int] = SEEDS,
    seconds: float = FLIGHT_S,
) -> dict[str, Any]:
    """Height errors of either pilot on the case's plant, flown with the same references and noise.

    `before` and `after` have `rmse` [mm] over all flights, its 90 % interval `low`, `high` (None
    for one flight) and `per_flight`; `ratio` is after over before, flights paired, with its
    interval. An error is None where a failsafe ended a flight.
    """
    errors = [
        [_error_mm(case, pilot, seed, seconds) for seed in seeds] for pilot in (before, after)
    ]
    comparison: dict[str, Any] = {"unit": "mm", "seconds": seconds, "seeds": list(seeds)}
    comparison |= {"before": _row(errors[0]), "after": _row(errors[1])}
    comparison |= {"ratio": None, "ratio_interval": None}
    if all(error is not None for row in errors for error in row):
        comparison["ratio"], comparison["ratio_interval"] = rms_ratio(
            *(_sums(row) for row in errors)
        )
    return comparison


def _error_mm(case: Case, pilot: Pilot, seed: int, seconds: float) -> float | None:
    log = fly(case, seed, seconds, believed=pilot.rig, package=pilot.package)
    if (log["mode"] == "FAILSAFE").any():
        return None
    return 1e3 * log.tracking_rmse_m("true_z_m")


def _row(errors: Sequence[float | None]) -> dict[str, Any]:
    row: dict[str, Any] = {"rmse": None, "low": None, "high": None, "per_flight": list(errors)}
    if None not in errors:
        row["rmse"], interval = rms_over_flights(_sums(errors))
        row["low"], row["high"] = interval if interval is not None else (None, None)
    return row


def _sums(errors: Sequence[float | None]) -> np.typing.NDArray[np.float64]:
    """Squares and counts of equally long flights (k, 2)."""
    known = np.array(errors, float)
    return np.stack([known**2, np.ones_like(known)], axis=1)
