"""The log of a gantry run, read and written here alone; its columns are in `runlog_columns`.

In and out: MCAP (JSON messages, one a topic and tick, their schemas inside the file) and CSV with
the same column names. A missing value is NaN in memory, left out in MCAP, an empty field in CSV.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput, own_errors, shown
from wakedeploy.core.files import absent, path_from
from wakedeploy.core.runlog_columns import (
    COLUMN,
    COLUMNS,
    FLYING,
    MODES,
    Column,
    Table,
    Value,
    is_missing,
    plain_value,
    refuse_unknown,
)

Array = npt.NDArray[Any]


_METADATA_FORMS = {
    "rate_hz": (r"(?=.*[1-9])\d{1,6}(\.\d{1,12})?", "number above zero"),
    "dropped": (r"\d{1,9}", "whole number"),
}


@dataclass
class RunLog:
    """A whole run: one array per column, all of one length, and the metadata as text.

    Numbers are float64 with NaN for missing, `mode` and `faults` object arrays of str.
    """

    columns: dict[str, Array]
    metadata: dict[str, str] = field(default_factory=dict)

    @classmethod
    def from_rows(
        cls, rows: Sequence[Mapping[str, Value]], metadata: Mapping[str, str] | None = None
    ) -> "RunLog":
        """Columns from one mapping per tick; None, NaN or an absent key is a missing value.

        Raises ValueError for a key that is no column.
        """
        given = set().union(*(row.keys() for row in rows)) if rows else set()
        refuse_unknown(given)
        kept = [c for c in COLUMNS if c.presence != "extra" or c.name in given]
        columns = {c.name: _array(c, (row.get(c.name) for row in rows)) for c in kept}
        return cls(columns, dict(metadata or {}))

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(self.columns["tick"])

    @property
    def rate_hz(self) -> float:
        """Ticks per second: from the metadata, else from the median step; NaN if neither says."""
        stated = self.metadata.get("rate_hz", "")
        if stated:
            return float(stated)
        steps = np.diff(self["t_s"])
        return float(1.0 / np.median(steps)) if len(steps) else float("nan")

    @property
    def flying(self) -> npt.NDArray[np.bool_]:
        """Which ticks were flown under control, (T,): mode RUNNING or DEGRADED."""
        return np.isin(self["mode"].astype(str), FLYING)

    def tracking_rmse_m(self, height: str = "z_est_m") -> float:
        """Root mean square of reference minus `height` over the flying ticks [m]; NaN without any.

        `height` is "z_est_m", or "true_z_m" where a simulation knows it.
        """
        error_m = (self["z_ref_m"] - self[height])[self.flying]
        known_m = error_m[np.isfinite(error_m)]
        return float(np.sqrt(np.mean(known_m**2))) if len(known_m) else float("nan")

    def has(self, name: str) -> bool:
        """Whether the column is there with at least one value."""
        return name in self.columns and any(not is_missing(v) for v in self.columns[name])

    def without_truth(self) -> "RunLog":
        """The log without what only a simulation knows: every `true_*` column dropped."""
        kept = {name: v for name, v in self.columns.items() if not name.startswith("true_")}
        return RunLog(kept, dict(self.metadata))

    def select(self, ticks: Array) -> "RunLog":
        """Only some ticks: `ticks` is a mask (T,), indices or a slice."""
        return RunLog({n: v[ticks] for n, v in self.columns.items()}, dict(self.metadata))

    def rows(self) -> Iterator[dict[str, Value]]:
        """One mapping per tick with None for missing; integers as int."""
        names = [column.name for column in COLUMNS if column.name in self.columns]
        arrays = [self.columns[name] for name in names]
        for values in zip(*arrays, strict=True):
            yield {n: plain_value(COLUMN[n], v) for n, v in zip(names, values, strict=True)}

    @property
    def table(self) -> Table:
        """What a file of this log holds."""
        names = [name for name in COLUMN if name in self]
        return Table(names, list(self.rows()), self.metadata)

    def write_csv(self, path: Path | str) -> None:
        """Write `path`, and the metadata beside it as `<stem>.meta.json`.

        Raises UnusableInput where no file can be written, WakedeployError where a disk is full.
        """
        from wakedeploy.core.runlog_csv import write_csv

        with own_errors():
            write_csv(self.table, path_from(path, "path"))

    def write_mcap(self, path: Path | str) -> None:
        """Write `path` as MCAP; a killed process leaves the old file or none.

        Raises what `write_csv` does.
        """
        from wakedeploy.core.runlog_mcap import write_mcap

        with own_errors():
            write_mcap(self.table, path_from(path, "path"))


def read_run_log(path: Path | str) -> RunLog:
    """Read a run log, `.mcap` or `.csv`.

    An unfinished MCAP is read as far as it goes (`metadata["unfinished"]` then says so). Columns
    that are not of this project are left out and named in `metadata["ignored_columns"]`. Raises
    UnusableInput for anything that is no run log.
    """
    path = Path(path)
    require_run_log(path)
    if path.suffix.lower() == ".csv":
        from wakedeploy.core.runlog_csv import read_csv

        return log_from_table(read_csv(path), path)
    from wakedeploy.core.runlog_mcap import read_mcap

    return log_from_table(read_mcap(path), path)


def require_run_log(path: Path) -> None:
    """UnusableInput where no file lies that could be a run log; it is not opened."""
    if path.is_dir() or not path.exists():
        raise UnusableInput(absent(path, "a run log, a .mcap or .csv file"))


def log_from_table(table: Table, path: Path) -> RunLog:
    """A RunLog from what a file held, checked: columns there, values possible, time rising."""
    names, rows, metadata = table
    missing = [c.name for c in COLUMNS if c.presence == "required" and c.name not in names]
    if missing:
        raise UnusableInput(
            f"{path}: not a run log, it lacks the column(s) {', '.join(missing)}; logs of other"
            " programs are read by `wakedeploy data import table`."
        )
    unknown = [name for name in names if name not in COLUMN]
    if unknown:
        metadata = metadata | {"ignored_columns": shown(", ".join(unknown))}
    try:
        log = RunLog.from_rows([_checked_row(row) for row in rows], metadata)
    except ValueError as error:
        raise UnusableInput(f"{path}: {error}.") from error
    for column in COLUMNS:  # a file without ticks still says which extra columns it has
        if column.name in names and column.name not in log:
            log.columns[column.name] = _array(column, [None] * len(rows))
    _check(log, path)
    return log


def _array(column: Column, values: Iterable[Value]) -> Array:
    if column.kind == "text":
        return np.array([str(v) if v is not None else "" for v in values], dtype=object)
    return np.array([np.nan if v is None else v for v in values], dtype=np.float64)


def _checked_row(row: Mapping[str, Value]) -> dict[str, Value]:
    """The known columns of one row; ValueError names tick, column and value."""
    checked: dict[str, Value] = {}
    for name, value in row.items():
        column = COLUMN.get(name)
        if column is None:
            continue
        fits = isinstance(value, str) if column.kind == "text" else _is_number(value)
        if not (fits or value is None):
            raise ValueError(f"tick {row.get('tick')}: {name} = {value!r} is not a {column.kind}")
        checked[name] = value
    return checked


def _is_number(value: Value) -> bool:
    return isinstance(value, int | float) and abs(value) != float("inf") and abs(value) < 1e300


def _check(log: RunLog, path: Path) -> None:
    """What no run can have written: unknown modes, time that does not rise."""
    for key, (form, wanted) in _METADATA_FORMS.items():
        text = log.metadata.get(key, "1")
        if not re.fullmatch(form, text):
            raise UnusableInput(f"{path}: its metadata say {key} = {text!r}; that is no {wanted}.")
    strange = set(log["mode"]) - set(MODES)
    if strange:
        raise UnusableInput(
            f"{path}: mode = {min(map(str, strange))!r} is none of {', '.join(MODES)}."
        )
    t_s = log["t_s"]
    if np.isnan(t_s).any() or np.isnan(log["tick"]).any():
        raise UnusableInput(f"{path}: tick or t_s is missing in a row; every tick needs both.")
    falls = np.flatnonzero(np.diff(t_s) <= 0)
    if len(falls):
        at = falls[0]
        raise UnusableInput(
            f"{path}: t_s does not rise after tick {log['tick'][at]:.0f} "
            f"({t_s[at]:g} s, then {t_s[at + 1]:g} s); one file holds one run."
        )
