"""A folder of flights as a list: each log in numbers, read once and kept until its file changes.

In: a folder. Out: one row for each run log in it and below it. What a log gave is kept in the
user's cache by path, size and time of change, so that a thousand flights are listed at once.
"""

import hashlib
import json
import math
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.errors import WakedeployError, one_line
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.processes import default_workers, pool
from wakedeploy.core.run_summary import summarise
from wakedeploy.core.runlog import RunLog, read_run_log

VERSION = 3  # of a row; another one makes the cache worthless
FEW = 8  # logs that are read here; for more, other processes help
_KEPT_EACH = 100  # logs, after which what was read survives the program's end
_AT_ONCE = 16  # logs for a process at a time
_REPORTS = (".html",)
_PICTURES = ("curves.png", "prediction.png")  # of a training run
_MOST_REPORTS = 500

Row = dict[str, Any]
Key = tuple[int, int]  # size [bytes], time of change [ns]


def cache_file(folder: Path) -> Path:
    """Where what a folder's logs gave is kept."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    name = hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:24]
    return base / "wakedeploy" / f"flights-{name}.json"


def logs_in(folder: Path) -> dict[str, Key]:
    """Every run log in a folder and below, by its path from there; hidden folders are left out."""
    found: dict[str, Key] = {}
    for path in _files(folder, (".mcap", ".meta.json")):
        if path.endswith(".meta.json"):
            path = f"{path.removesuffix('.meta.json')}.csv"
        try:
            status = os.stat(folder / path)
        except OSError:
            continue
        found[path] = (status.st_size, status.st_mtime_ns)
    return dict(sorted(found.items()))


def reports_in(folder: Path) -> list[str]:
    """Pages of gaps, studies, trainings and benchmarks, by their path from there.

    A training without a page is there by its pictures.
    """
    found = sorted(_files(folder, (*_REPORTS, *_PICTURES)))
    reported = {os.path.dirname(name) for name in found if name.endswith(_REPORTS)}
    shown = [n for n in found if n.endswith(_REPORTS) or os.path.dirname(n) not in reported]
    return shown[:_MOST_REPORTS]


def _files(folder: Path, endings: tuple[str, ...]) -> Iterator[str]:
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in names:
            if name.endswith(endings) and not name.startswith("."):
                yield os.path.relpath(os.path.join(place, name), folder)


def row_of(path: Path) -> Row:
    """A log in numbers; one that cannot be read says why in `problem`."""
    try:
        return _row(read_run_log(path))
    except WakedeployError as error:
        return {"problem": str(error).removeprefix(f"{path}: ")}
    except Exception as error:  # one file of a thousand must not hide the others
        return {"problem": one_line(error)}


def _row(log: RunLog) -> Row:
    summary, known = summarise(log), log.metadata
    scores = log.columns.get("gap_score", np.empty(0))
    finite = scores[np.isfinite(scores)]
    return {
        "started": started(known),
        "rig": _named(known, "rig"),
        "package": _named(known, "package"),
        "simulated": known.get("simulated") == "true",
        "seconds": number(summary.duration_s),
        "tracking_mm": number(1e3 * summary.tracking_rmse_m),
        "worst_mm": number(1e3 * summary.tracking_max_m),
        "faults": _onsets(log),
        "failsafe": summary.failsafe_cause,
        "overruns": summary.overruns,
        "gap": number(float(finite.max())) if len(finite) else None,
        "unfinished": "unfinished" in known,
    }


def started(known: Mapping[str, str]) -> str:
    """When a log was flown; "" where it was at no time of day.

    A simulated flight whose seed alone makes its log has the first second of 1970.
    """
    date = known.get("started_utc", "")
    return "" if date.startswith("1970-01-01") else date


def _named(known: Mapping[str, str], what: str) -> str:
    """The file of a rig or a package as far as the log has its name, and the start of its hash."""
    digest = known.get(f"{what}_sha256")
    if digest is None:
        return ""
    if not digest:
        return "PID alone"
    return f"{known.get(f'{what}_file', '')} {digest[:8]}".strip()


def _onsets(log: RunLog) -> dict[str, int]:
    """How often each fault began."""
    counts, before = Counter[str](), set[str]()
    for faults in log["faults"]:
        now = {name for name in str(faults).split("+") if name}
        counts.update(now - before)
        before = now
    return dict(counts.most_common())


def number(value: float) -> float | None:
    """A number in full, since the page alone rounds what it shows; None for NaN and infinity."""
    return float(value) if math.isfinite(value) else None


class Index:
    """The rows of a folder's logs. `refresh` reads what is new, `rows` returns what is known."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._cache = cache_file(folder)
        self._kept = _read_cache(self._cache)
        self._present: dict[str, Key] = {}
        self._lock = threading.Lock()
        self._reading = threading.Lock()
        self.look()

    def look(self) -> list[str]:
        """See which logs there are; those of which nothing is known yet."""
        self._present = logs_in(self.folder)
        return [name for name, key in self._present.items() if self._known(name, key) is None]

    def _known(self, name: str, key: Key) -> Row | None:
        size, changed_ns, row = self._kept.get(name, (0, 0, None))
        return row if (size, changed_ns) == key else None

    def rows(self) -> list[Row]:
        """One row for each log; one that is not read yet has its name alone."""
        with self._lock:
            present = dict(self._present)
        return [{"name": name} | (self._known(name, key) or {"waits": True})
                for name, key in present.items()]  # fmt: skip

    def __contains__(self, name: object) -> bool:
        return name in self._present

    def refresh(self, tell: Callable[[int, int], None] = lambda done, total: None) -> None:
        """Read what is new or has changed; one call at a time does, others return at once."""
        if not self._reading.acquire(blocking=False):
            return
        try:
            todo = self.look()
            for done, (name, row) in enumerate(self._read(todo), 1):
                size, changed_ns = self._present.get(name, (0, 0))
                self._kept[name] = (size, changed_ns, row)
                tell(done, len(todo))
                if done % _KEPT_EACH == 0 or done == len(todo):
                    self._keep()
        finally:
            self._reading.release()

    def _read(self, names: list[str]) -> Iterator[tuple[str, Row]]:
        if len(names) <= FEW:
            yield from ((name, row_of(self.folder / name)) for name in names)
            return
        parts = [names[i : i + _AT_ONCE] for i in range(0, len(names), _AT_ONCE)]
        with pool(default_workers(), fresh=True) as several:
            for part, rows in zip(
                parts, several.map(_rows, [str(self.folder)] * len(parts), parts), strict=True
            ):
                yield from zip(part, rows, strict=True)

    def _keep(self) -> None:
        """Write the cache; where there is no room for one, the next list takes longer."""
        entries = {name: list(self._kept[name]) for name in self._present if name in self._kept}
        try:
            write_text_whole(self._cache, json.dumps({"version": VERSION, "logs": entries}))
        except OSError:
            return


def _rows(folder: str, names: list[str]) -> list[Row]:
    return [row_of(Path(folder) / name) for name in names]


def _read_cache(path: Path) -> dict[str, tuple[int, int, Row]]:
    """What is kept; nothing where there is none, of another version, or no cache at all."""
    try:
        kept = json.loads(path.read_text("utf-8"))
        if kept["version"] != VERSION:
            return {}
        return {
            str(name): (int(size), int(changed_ns), dict(row))
            for name, (size, changed_ns, row) in kept["logs"].items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
