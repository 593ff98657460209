"""Run logs as CSV: one row per tick, the metadata beside it as `<stem>.meta.json`."""

import csv
import json
from collections import Counter
from pathlib import Path

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import json_of, text_of, write_text_whole, write_whole
from wakedeploy.core.runlog_columns import COLUMN, Table, Value


def metadata_path(path: Path) -> Path:
    """Where the metadata of a CSV log lies."""
    return path.with_name(f"{path.stem}.meta.json")


def write_csv(table: Table, path: Path) -> None:
    """Both files, each whole or not at all."""

    def fill(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as handle:
            writer = csv.writer(handle, lineterminator="\n")
            writer.writerow(table.names)
            writer.writerows(["" if v is None else v for v in row.values()] for row in table.rows)

    write_whole(path, fill)
    write_text_whole(
        metadata_path(path), json.dumps(table.metadata, indent=1, sort_keys=True) + "\n"
    )


def read_csv(path: Path) -> Table:
    """A log's table, and its metadata if they are there; UnusableInput names file and line."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as handle:
            lines = list(csv.reader(handle))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UnusableInput(f"{path}: cannot be read as CSV ({one_line(error)}).") from error
    if not lines:
        raise UnusableInput(f"{path}: is empty; a run log starts with a row of column names.")
    names = [name.strip() for name in lines[0]]
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise UnusableInput(f"{path}: the column {min(repeated)!r} is there twice; keep one.")
    if not COLUMN.keys() & set(names):  # another program's: whoever checks the columns says so
        return Table(names, [], {})
    rows = [_row(names, line, f"{path}, line {n}") for n, line in enumerate(lines[1:], 2) if line]
    return Table(names, rows, _read_metadata(metadata_path(path)))


def _row(names: list[str], line: list[str], where: str) -> dict[str, Value]:
    if len(line) != len(names):
        raise UnusableInput(f"{where}: {len(line)} fields, but {len(names)} column names.")
    cells = zip(names, line, strict=True)
    return {name: _value(name, text.strip(), where) for name, text in cells if name in COLUMN}


def _value(name: str, text: str, where: str) -> Value:
    if COLUMN[name].kind == "text":
        return text
    if text == "" or text.lower() == "nan":
        return None
    try:
        return float(text)
    except ValueError:
        raise UnusableInput(f"{where}: {name} = {text!r} is not a number.") from None


def _read_metadata(path: Path) -> dict[str, str]:
    if not path.exists():
        return {}
    try:
        raw = json_of(text_of(path))
    except (OSError, ValueError) as error:
        raise UnusableInput(f"{path}: not readable as JSON ({one_line(error)}).") from error
    if not isinstance(raw, dict):
        raise UnusableInput(f"{path}: holds no JSON object; delete it or write name: text pairs.")
    return {
        str(key): value if isinstance(value, str) else json.dumps(value)
        for key, value in raw.items()
    }
