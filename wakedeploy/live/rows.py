"""A tick as a page gets it: a list of rounded values in a fixed order."""

import math
from collections.abc import Mapping

from wakedeploy.core.runlog_columns import STAGES, Value

# Name of a page's column, the column of the run log, and digits behind the point.
_COLUMNS = (
    ("t_s", "t_s", 4),
    ("z_ref_m", "z_ref_m", 4),
    ("z_m", "z_est_m", 4),
    ("x_m", "x_m", 4),
    ("force_pred_n", "force_pred_n", 3),
    ("force_n", "force_now_n", 3),
    ("round_trip_s", "round_trip_s", 5),
    ("source_us", "source_applied_us", 0),
    ("sufferer_us", "sufferer_applied_us", 0),
    ("battery_v", "battery_v", 2),
    ("gap_score", "gap_score", 3),
)
COLUMNS = (*(name for name, _, _ in _COLUMNS), "compute_s", "mode", "faults")


def page_row(row: Mapping[str, Value]) -> list[Value]:
    """The values of `COLUMNS` in one tick of a run log; None for what is missing.

    `force_now_n` is no column of a log: the loop's own estimate of the force that neither thrust,
    weight nor friction explains [N].
    """
    return [
        *(rounded(row.get(column), digits) for _, column, digits in _COLUMNS),
        rounded(_sum(row), 6),
        row.get("mode") or "",
        row.get("faults") or "",
    ]


def rounded(value: Value, digits: int) -> float | None:
    """A finite number, rounded; None for anything else."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return round(float(value), digits)


def _sum(row: Mapping[str, Value]) -> float | None:
    """What the computer took from the measurement to the command [s]; None where untimed."""
    stages = [row.get(stage) for stage in STAGES]
    known = [float(value) for value in stages if isinstance(value, int | float)]
    return sum(known) if len(known) == len(stages) else None
