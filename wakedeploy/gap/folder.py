"""What the steps have left in a folder, as far as they have run, and what comes next.

In: a folder with `find.json`, `name.json`, `add.json`, `show.json`, `result.json`. Out: their
contents as mappings, empty where a step has not run yet.
"""

import contextlib
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import json_of, remove_unfinished, sha256_of, text_of, write_text_whole
from wakedeploy.core.locks import alone
from wakedeploy.gap.artefacts import problem_of
from wakedeploy.gap.few_flights import cannot_tell, unconfirmed
from wakedeploy.gap.wording import entries, mapping, texts

Artefact = Mapping[str, Any]

STEPS = ("find", "name", "add", "show", "result")
TITLE = "The gap between simulation and measurement"  # of the report, by which it is known
PICTURES = (
    *("maps_exogenous", "maps_fed_back", "replay", "spectrum", "ranking", "confusion"),
    *("before_after", "places", "forecasts", "placebo", "retraining"),
)

# Keys of the steps' own artefacts that the account looks at, beside those of result.json.
_OF_FIND = ("places", "logs", "split")
_OF_NAME = (
    *("verdict", "effects", "class", "more_classes", "others", "split_by"),
    *("unknown", "rest", "beside", "leading"),
    *("withdrawn", "small", "worth", "explainable", "form_exact", "unsettled"),
    "closest",
    "repeated",
    *("detectable", "white", "threshold_of_s"),
)
_OF_SHOW = (
    *("sealed", "in_sample", "cross_validated", "as_if", "gap", "placebo", "retrain"),
    *("hidden_by", "log_density_gain_nats"),
)


@dataclass(frozen=True)
class Steps:
    """One artefact per step; {} where it has not run."""

    find: Artefact
    name: Artefact
    add: Artefact
    show: Artefact
    result: Artefact

    @property
    def flights(self) -> int:
        """How many were read, sealed ones included; 0 where `find` has not run."""
        return len(entries(self.find.get("logs")))

    @property
    def missing(self) -> str | None:
        """The step that comes next, `plan` for an open class; None when nothing is left to do.

        Nothing is to be added that no flight can confirm, unless a person asks for it.
        """
        if not self.find:
            return "find"
        if not self.name:
            return "name"
        if self.add and not self.show:
            return "show"
        if cannot_tell(self.flights) or unconfirmed(self.flights):
            return None
        if not self.add and self._can_add:
            return "add"
        return "plan" if self._class_is_open else None

    @property
    def option(self) -> str:
        """What the step that comes next needs beside its name, or ""."""
        by_expression = self.missing == "add" and not to_add(entries(self.name.get("effects")))
        return " --from-symbolic" if by_expression else ""

    @property
    def summary(self) -> dict[str, Any]:
        """`result.json`, and the steps' own artefacts, which say more.

        `white` is of what was found, `white_before` of the rig file as it is.
        """
        told: dict[str, Any] = {}
        for artefact, keys in (
            (self.result, tuple(self.result)),
            (self.find, _OF_FIND),
            (self.name, _OF_NAME),
            (self.show, _OF_SHOW),
        ):
            told |= {key: artefact[key] for key in keys if artefact.get(key) is not None}
        return told | {"white_before": mapping(self.find.get("white"))}

    @property
    def _class_is_open(self) -> bool:
        """Of a class nothing is in the rig file."""
        added = {str(effect.get("name")) for effect in entries(self.add.get("effects"))}
        members = texts(self.name.get("class"))
        return bool(members) and added.isdisjoint(members)

    @property
    def _can_add(self) -> bool:
        """There is an effect, or an expression, that a rig could be given. Of a class, none is."""
        if to_add(entries(self.name.get("effects"))):
            return True
        unknown = self.name.get("verdict") == "unknown"
        return unknown and bool(mapping(self.name.get("unknown")).get("expression"))


def to_add(effects: Sequence[Artefact]) -> list[Artefact]:
    """The named effects that a rig file is given without being asked: those that matter.

    Where no flight has judged them, all.
    """
    return [e for e in effects if mapping(e.get("worth")).get("matters", True)]


def read_plan(folder: Path) -> Artefact:
    """`plan.json`, {} where no plan was made; UnusableInput where it cannot be read."""
    return _read(folder / "plan.json")


def read_steps(folder: Path) -> Steps:
    """Read the artefacts of a folder; UnusableInput where a file is there and cannot be read."""
    return Steps(**{name: _read(folder / f"{name}.json") for name in STEPS})


@contextlib.contextmanager
def at_work(folder: Path) -> Iterator[None]:
    """Nobody else takes steps in this folder meanwhile; what a killed one was writing is removed.

    UnusableInput where somebody does: artefacts of two would be of different flights.
    """
    with alone(folder, "Another gap command", "gap"):
        for place in (folder, folder / "figures"):
            remove_unfinished(place)
        yield


def prepare(folder: Path, rig_path: Path) -> None:
    """Make the folder. UnusableInput where nothing can be written, or the rig file would be lost.

    A step calls it first: minutes of fitting should not end at a full or foreign disk.
    """
    if rig_path.resolve() == (folder / "rig.toml").resolve():
        raise UnusableInput(
            f"{folder}: the corrected rig.toml would overwrite the rig file given; "
            "choose another --out."
        )
    report = folder / "report.html"
    if report.is_file() and not _wrote_report(report):
        raise UnusableInput(
            f"{report}: not a report of these steps, which would replace it; choose another --out."
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise UnusableInput(
            f"{folder}: cannot be written to ({reason}); choose another --out."
        ) from error


def refuse_foreign_rig(folder: Path) -> None:
    """UnusableInput where the folder holds a `rig.toml` that is not as `add` wrote it."""
    if (folder / "rig.toml").is_file() and not _wrote_rig(folder):
        raise UnusableInput(
            f"{folder / 'rig.toml'}: not as `gap add` wrote it; move it away, or give another "
            "--out."
        )


def _wrote_report(path: Path) -> bool:
    """Whether a page is a report of these steps."""
    with path.open("rb") as file:
        return TITLE.encode() in file.read(1000)


def _wrote_rig(folder: Path) -> bool:
    """Whether the folder's `rig.toml` is as its `add.json` says."""
    rig, written = folder / "rig.toml", _read(folder / "add.json").get("new_sha256")
    return written is not None and rig.is_file() and sha256_of(rig.read_bytes()) == written


def forget(folder: Path, first: str) -> None:
    """Remove what `first` and the steps after it left in an earlier run, their rig file included.

    So are the report, its figures and the plan, which tell of what is removed. A `rig.toml` that
    another hand has written or changed stays, and so does what else lies there.
    """
    stale = STEPS[STEPS.index(first) :]
    if "add" in stale and _wrote_rig(folder):
        (folder / "rig.toml").unlink()
    for step in stale:
        (folder / f"{step}.json").unlink(missing_ok=True)
    for drawn in ((folder / "figures" / f"{name}.png") for name in PICTURES):
        drawn.unlink(missing_ok=True)
    report = folder / "report.html"
    if report.is_file() and _wrote_report(report):
        report.unlink()
    if "name" in stale:
        for beside in ("name.npz", "plan.json"):
            (folder / beside).unlink(missing_ok=True)


def require(folder: Path, before: str, rig_sha256: str, logs: Sequence[str]) -> None:
    """UnusableInput unless step `before` has run in the folder, on this rig file and these logs.

    `logs` are the SHA-256 of the recordings, in order.
    """
    steps = read_steps(folder)
    if not getattr(steps, before):
        raise UnusableInput(
            f"{folder}: there is no {before}.json yet; run `wakedeploy gap {before}` first."
        )
    found = [str(log.get("sha256")) for log in entries(steps.find.get("logs"))]
    if found != list(logs) or steps.find.get("rig_sha256") != rig_sha256:
        raise UnusableInput(
            f"{folder / 'find.json'}: of another rig file or other logs; give the same --rig and "
            "--measured, or run `wakedeploy gap find` again."
        )


def _read(path: Path) -> Artefact:
    if not path.exists():
        return {}
    try:
        content = json_of(text_of(path))
    except (OSError, ValueError) as error:
        raise UnusableInput(
            f"{path}: cannot be read ({one_line(error)}); run the step that writes it again."
        ) from error
    if not isinstance(content, dict):
        raise UnusableInput(f"{path}: holds no JSON object; run the step that writes it again.")
    if problem := problem_of(path.stem, content):
        raise UnusableInput(f"{path}: {problem}; run the step that writes it again.")
    return content


def write_step(out: Path, step: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """Write an artefact whole; numbers that are none become null."""
    out.mkdir(parents=True, exist_ok=True)
    plain = _plain(content)
    write_text_whole(out / f"{step}.json", json.dumps(plain, indent=1, allow_nan=False) + "\n")
    return dict(plain)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
