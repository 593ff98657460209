"""Records: measured data in `docs/records/`, each with the day and the commit of its measurement.

In: results of benchmarks, and folders that `wakedeploy` commands wrote. Out: JSON, CSV and JSONL
files, from which `python -m benchmarks.results` makes every table of the documentation. A CSV file
has its day and commit in the JSON file whose name begins its own; a JSONL file has them in each
line.
"""

import datetime
import json
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
    """Write a record whole; its day and commit are those that it states, else the present ones."""
    stamped = {"measured": today(), "commit": COMMIT} | dict(result)
    write_text_whole(path, json.dumps(stamped, indent=1) + "\n")


def today() -> str:
    """The present day, as records state it."""
    return f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}"
