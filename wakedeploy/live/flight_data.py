"""One recorded flight as pages draw it: columns of numbers, and what happened when."""

from pathlib import Path
from typing import Any

import numpy as np

from runtime.live_view import rig_view
from wakedeploy.core.failsafes import hints
from wakedeploy.core.run_summary import summarise
from wakedeploy.core.runlog import read_run_log
from wakedeploy.live.events import events_of
from wakedeploy.live.flights import number, started
from wakedeploy.live.replay import log_rows, rig_of_log
from wakedeploy.live.rows import COLUMNS

MOST_ROWS = 12_000  # six minutes at 32 Hz; of longer flights every second tick, or third …


def flight_data(path: Path, name: str) -> dict[str, Any]:
    """A flight's columns, each a list, its events, its rig and its numbers.

    Raises UnusableInput for what is no run log.
    """
    log = read_run_log(path)
    rig = rig_of_log(log)
    rows = log_rows(log, rig)
    step = max(1, -(-len(rows) // MOST_ROWS))
    kept = rows[::step]
    columns = {column: [row[i] for row in kept] for i, column in enumerate(COLUMNS)}
    summary = summarise(log)
    return {
        "name": name,
        "columns": columns,
        "events": events_of(log),
        "hints": hints(is_virtual=log.metadata.get("simulated") == "true"),
        "rig": rig_view(rig),
        "started": started(log.metadata),
        "simulated": log.metadata.get("simulated") == "true",
        "tracking_mm": number(1e3 * summary.tracking_rmse_m),
        "notes": list(summary.notes),
        "every": step,
        "seconds": float(np.ptp(log["t_s"])) if len(log) else 0.0,
    }
