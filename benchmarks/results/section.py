"""What a section of the results is, the records that it reads, and Markdown tables."""

import csv
import json
import math
import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

ARCHITECTURES: tuple[str, ...] = ("agile-mlp", "history-mlp", "delay-embedding", "gru", "tcn")
ARCHITECTURES += ("mamba", "esn", "cross-attention")
MEMORYLESS = ARCHITECTURES[0]


@dataclass(frozen=True)
class Section:
    """A title, one sentence that says what was measured, the tables, and how to make them again."""

    title: str
    measured: str
    body: str
    commands: tuple[str, ...]


class Stamp(NamedTuple):
    """When, at which commit and on what a record was measured."""

    day: str
    commit: str
    machine: str = ""  # older records do not state it


class Records:
    """The records of one folder; remembers which were read."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.read: list[str] = []

    def json(self, name: str) -> dict[str, Any]:
        """A JSON record."""
        result: dict[str, Any] = json.loads(self._text(name))
        return result

    def rows(self, name: str) -> list[dict[str, str]]:
        """A CSV record, one dictionary for each row."""
        return list(csv.DictReader(self._text(name).splitlines()))

    def lines(self, name: str) -> list[dict[str, Any]]:
        """A JSONL record."""
        return [json.loads(line) for line in self._text(name).splitlines()]

    def stamps(self) -> dict[Stamp, list[str]]:
        """By day, commit and machine of measurement: the records that were read."""
        found: dict[Stamp, list[str]] = {}
        for name in sorted(set(self.read)):
            found.setdefault(self._stamp(name), []).append(name)
        return found

    def _text(self, name: str) -> str:
        self.read.append(name)
        return (self.folder / name).read_text("utf-8")

    def _stamp(self, name: str) -> Stamp:
        """The stamp of a record; that of a CSV file stands in its study's JSON file."""
        path = self.folder / name
        if path.suffix == ".jsonl":
            lines = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
            days, commits = ({line[key] for line in lines} for key in ("measured", "commit"))
            return Stamp(", ".join(sorted(days)), ", ".join(sorted(commits)))
        if path.suffix == ".csv":
            studies = [p for p in self.folder.glob("*.json") if path.stem.startswith(p.stem)]
            path = max(studies, key=lambda study: len(study.stem))
        stated = json.loads(path.read_text("utf-8"))
        return Stamp(stated["measured"], stated["commit"], stated.get("machine", ""))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def paragraphs(*parts: str) -> str:
    """Parts with an empty line between them; empty parts are left out."""
    return "\n\n".join(part for part in parts if part)


def anchor(title: str) -> str:
    """What a link names a heading by, on GitHub and on the site."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def mean_and_sd(values: Sequence[float], digits: int) -> str:
    """Mean ± standard deviation over seeds, or the one value."""
    mean = f"{statistics.fmean(values):.{digits}f}"
    return f"{mean} ± {statistics.stdev(values):.{digits}f}" if len(values) > 1 else mean


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent."""
    return f"{100.0 * share:.{digits}f} %"


def within(value: float, low: float, high: float, digits: int, scale: float = 1.0) -> str:
    """A value with its interval."""
    value, low, high = (scale * number for number in (value, low, high))
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def grouped(rows: Iterable[Mapping[str, Any]], *keys: str) -> dict[Any, list[Mapping[str, Any]]]:
    """Rows by the value of a key, by a tuple of values for several, in order of appearance."""
    found: dict[Any, list[Mapping[str, Any]]] = {}
    for row in rows:
        key = row[keys[0]] if len(keys) == 1 else tuple(row[k] for k in keys)
        found.setdefault(key, []).append(row)
    return found


def in_order(names: Iterable[str]) -> list[str]:
    """Names: what has learned nothing, architectures in the paper's order, then their variants."""
    present = list(dict.fromkeys(names))
    others = [name for name in present if name.partition(",")[0] not in ARCHITECTURES]
    variants = [name for name in present if name not in (*others, *ARCHITECTURES)]
    return [*others, *(name for name in ARCHITECTURES if name in present), *variants]


def rms(values: Sequence[float]) -> float:
    """Root of the mean square."""
    return math.sqrt(statistics.fmean(value * value for value in values))


def span(values: Sequence[float], digits: int) -> str:
    """The least and the largest value, as "a to b"."""
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"
