"""A study's folder: figures as PNG and PDF, tables as CSV and JSON, and one page with them all.

In: parts in the order in which they are to be read, and the sets that they are of. Out: files that
replace those of an earlier run, each whole; what others put into the folder stays.
"""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core import figures, pages
from wakedeploy.core.commit import present_commit
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.files import json_text, remove_unfinished, write_text_whole
from wakedeploy.core.locks import one_at_a_time

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RESULT, _PAGE = "study.json", "study.html"


@dataclass(frozen=True, eq=False)
class Part:
    """A figure with the sentence that says what it shows, and the table that it was drawn from.

    `rows` are those of the CSV file, under `columns`; `shown` are the page's, if not the same.
    """

    name: str
    sentence: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    figure: "Figure | None" = None
    shown: tuple[Sequence[str], Sequence[Sequence[str]]] | None = None


def write_study(
    folder: Path,
    title: str,
    parts: Sequence[Part],
    result: Mapping[str, Any],
    sets: Sequence[EpisodeSet],
    next_commands: Sequence[str] = (),
) -> Path:
    """Write everything and return the page's path. `result` goes into `study.json`.

    `next_commands` stand on the page, to copy.

    `study.json` also says what each part says, which code and which revision of training it is of
    and which sets, in no order that matters, and lists the study's files; those that an earlier one
    lists and this one does not write are removed, and nothing else is. Of two processes that write
    into one folder, the second waits for the first.
    """
    with one_at_a_time(folder, "study", traceless=True):
        remove_unfinished(folder)
        return _write(folder, title, parts, result, sets, next_commands)


def _write(
    folder: Path,
    title: str,
    parts: Sequence[Part],
    result: Mapping[str, Any],
    sets: Sequence[EpisodeSet],
    next_commands: Sequence[str],
) -> Path:
    from trainers.training.runs import TRAINING

    names = {_RESULT, _PAGE}
    for part in parts:
        names |= {f"{part.name}.{kind}" for kind in ("png", "pdf") if part.figure is not None}
        names.add(f"{part.name}.csv")
    for path in _written(folder):
        if path.name not in names:
            path.unlink()
    shown = [_written_part(part, folder) for part in parts]
    content = {
        "commit": present_commit(),
        "training": TRAINING,
        "sets": [{"domain": data.domain, "sha256": data.sha256} for data in sets],
        **result,
        "says": {part.name: part.sentence for part in parts},
        "files": sorted(names),
    }
    write_text_whole(folder / _RESULT, json_text(content))
    path = folder / _PAGE
    told_sets = [(data.domain, data.sha256[:12]) for data in sets]
    text = pages.page(
        "wakedeploy.study", "study.html", title=title, parts=shown, sets=told_sets,
        commit=content["commit"], next=next_commands,
    )  # fmt: skip
    write_text_whole(path, text)
    return path


def _written_part(part: Part, folder: Path) -> dict[str, Any]:
    """Write a part's figure and table; what the page says of it."""
    picture = None
    if part.figure is not None:
        for kind in ("png", "pdf"):
            figures.save(part.figure, folder / f"{part.name}.{kind}")
        picture = pages.Picture(folder / f"{part.name}.png", part.sentence)
    write_text_whole(folder / f"{part.name}.csv", _csv(part.columns, part.rows))
    columns, rows = part.shown or (part.columns, [[str(c) for c in r] for r in part.rows])
    return {
        "name": part.name,
        "title": part.name.replace("-", " "),
        "sentence": part.sentence,
        "picture": picture,
        "table": pages.Table(list(columns), [list(row) for row in rows]),
    }


def _written(folder: Path) -> list[Path]:
    """What the study whose result lies in the folder wrote there, as far as the result says."""
    try:
        result = json.loads((folder / _RESULT).read_bytes())
    except (OSError, ValueError):
        return []
    files = result.get("files") if isinstance(result, dict) else None
    names = [name for name in files if isinstance(name, str)] if isinstance(files, list) else []
    paths = [folder / name for name in names if Path(name).name == name]
    return [path for path in paths if path.is_file()]


def _csv(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(["" if cell is None else cell for cell in row] for row in rows)
    return text.getvalue()
