"""A sweep's results: one row per job, the last one that was written for it.

In: rows. Out: results.jsonl, a line as each job finishes, and results.csv.
"""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, JsonValue, ValidationError

from wakedeploy.core.errors import UnusableInput, shown
from wakedeploy.core.files import append_json_line, read_json_lines, write_text_whole
from wakedeploy.core.validation import first_problem
from wakedeploy.sweep.jobs import Row

LINES, TABLE = "results.jsonl", "results.csv"


class _Record(BaseModel):
    """What is read of a row later; it may say more."""

    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)


class _Job(_Record):
    kind: Literal["train", "generate"]
    data: str
    reason: str | None = None
    seconds: float | None = None
    commit: str | None = None


class _Made(_Job):
    kind: Literal["generate"]
    data_sha256: str


class _Scores(_Record):
    rmse: dict[str, float]
    r2: dict[str, float | None]


class _Trained(_Job):
    kind: Literal["train"]
    seconds: float
    arch: str
    preset: str
    lead_s: float
    settings: dict[str, JsonValue]
    hyper: dict[str, JsonValue]
    trainable: int
    test: _Scores
    device: str


class Results:
    """The rows of a sweep's folder by identity, in the order in which their jobs first finished."""

    def __init__(self, folder: Path) -> None:
        self._lines, self._table = folder / LINES, folder / TABLE
        self.rows: dict[str, Row] = {}
        for row in read_json_lines(self._lines):
            if isinstance(row.get("identity"), str) and row.get("state") in ("done", "failed"):
                self._take(row)

    def add(self, row: Row) -> bool:
        """Write a finished job's row; False, and nothing is written, where the job is done already.

        The row is on the disk when this returns. The row of a failed job is followed by that of the
        next attempt, which counts.
        """
        if self.done(row["identity"]) and not self._is_of_another_set(row):
            return False
        append_json_line(self._lines, row)
        self._take(row)
        return True

    def require_sound(self) -> None:
        """UnusableInput for a row that no job has left."""
        for identity, row in self.rows.items():
            kind: type[_Job] = _Job
            if row["state"] == "done":
                kind = _Made if row.get("kind") == "generate" else _Trained
            try:
                kind.model_validate(row)
            except ValidationError as error:
                raise UnusableInput(
                    f"{self._lines}: in the row of job {identity[:16]} {first_problem(error)}; take"
                    " its line out to have the job done again."
                ) from error

    def done(self, identity: str) -> bool:
        """Whether this job has succeeded."""
        return self.rows.get(identity, {}).get("state") == "done"

    def failed(self, identity: str) -> bool:
        """Whether this job's last attempt failed."""
        return self.rows.get(identity, {}).get("state") == "failed"

    def write_table(self) -> None:
        """Write results.csv: a row per job, a column per value that any has; none without rows."""
        if not self.rows:
            return
        flat = [_flat(row) for row in self.rows.values()]
        columns = list(dict.fromkeys(name for row in flat for name in row))
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(flat)
        write_text_whole(self._table, text.getvalue())

    def _take(self, row: Row) -> None:
        if not self.done(row["identity"]) or row["state"] == "done":
            self.rows[row["identity"]] = row

    def _is_of_another_set(self, row: Row) -> bool:
        """A set that was deleted and made again may differ where another processor rounds."""
        before = self.rows[row["identity"]]
        return row["kind"] == "generate" and row.get("data_sha256") != before.get("data_sha256")


def _flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested values as columns, text on one line: {"test": {"r2": 1}} -> {"test.r2": 1}."""
    cells: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, Mapping):
            cells |= _flat(value, f"{prefix}{name}.")
        else:
            cell = "" if value is None else value
            cells[shown(prefix + name)] = shown(cell) if isinstance(cell, str) else cell
    return cells
