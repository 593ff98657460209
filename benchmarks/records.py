"""Records: measured data in `docs/records/`, each with day, commit and machine of its measurement.

In: results of benchmarks, and folders that `wakedeploy` commands wrote. Out: JSON, CSV and JSONL
files, from which `python -m benchmarks.results` makes every table of the documentation. A CSV file
has its day and commit in the JSON file whose name begins its own; a JSONL file has them in each
line.
"""

import contextlib
import datetime
import json
import os
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wakedeploy.core.commit import frozen_at
from wakedeploy.core.files import write_text_whole

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "records"
FIGURES = ROOT / "docs" / "figures"
WRITTEN = ("docs", "trainers/presets")  # what benchmarks may change while they run
COMMIT = frozen_at(WRITTEN)  # of the process's beginning: a later edit is not in the result


def write(path: Path, result: Mapping[str, Any]) -> None:
    """Write a record whole; its day and commit are those that it states, else the present ones.

    A record that states its day may be of another machine, and gets no name of this one.
    """
    stamp = {"measured": today(), "commit": COMMIT}
    if "measured" not in result:
        stamp["machine"] = machine()
    stamped = stamp | dict(result)
    write_text_whole(path, json.dumps(stamped, indent=1) + "\n")


def machine() -> str:
    """What this machine is: its cores and the model of its processor."""
    return f"{os.cpu_count()} cores, {_processor()}"


def _processor() -> str:
    """The model as Linux names it, else the architecture."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return " ".join(value.split())
    return platform.machine()


def today() -> str:
    """The present day, as records state it."""
    return f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}"
