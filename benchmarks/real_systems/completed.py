"""A record that lacks parts, completed from an earlier one, whose commit these parts then state.

`python -m benchmarks.real_systems.completed NEW EARLIER --json RECORD`: to ask about all recordings
takes hours of a core. The answers that matter most can be made again first.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from wakedeploy.core.files import write_text_whole

_GROUPS = {"left_out": ("out",), "left_in": ("in",), "halves": ("first", "second")}


def completed(new: Mapping[str, Any], earlier: Mapping[str, Any]) -> dict[str, Any]:
    """The new record; parts that it has not asked are the earlier one's, marked by their commit."""
    known = {row["case"]: row for row in earlier["rows"]}
    rows = []
    for row in new["rows"]:
        old = known.get(row["case"], {"answers": {}})
        full = {**row, "answers": dict(row["answers"])}
        for judged, parts in _GROUPS.items():
            if set(parts) <= set(row["answers"]) or not set(parts) <= set(old["answers"]):
                continue
            answers = {p: {"commit": earlier["commit"], **old["answers"][p]} for p in parts}
            full["answers"] |= answers
            full[judged] = old[judged]
        rows.append(full)
    return {**new, "rows": rows}


@click.command()
@click.argument("new", type=click.Path(path_type=Path, exists=True))
@click.argument("earlier", type=click.Path(path_type=Path, exists=True))
@click.option("--json", "record", type=click.Path(path_type=Path), required=True)
def main(new: Path, earlier: Path, record: Path) -> None:
    """Write the record."""
    records = (json.loads(path.read_text("utf-8")) for path in (new, earlier))
    write_text_whole(record, json.dumps(completed(*records), indent=1) + "\n")


if __name__ == "__main__":
    main()
