"""What the gantry's steps have left in a folder, as far as they have run, and what comes next.

In: a folder with `find.json`, `name.json`, `add.json`, `show.json`, `result.json`. Out: what they
hold, None where a step has not run yet.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import json_of, json_text, sha256_of, text_of, write_text_whole
from wakedeploy.gap.few_flights import cannot_tell, unconfirmed
from wakedeploy.gap.folder import made
from wakedeploy.gap.search.artefacts import stated
from wakedeploy.gap.systems.gantry.artefacts import (
    Add,
    Artefact,
    Find,
    Name,
    Plan,
    Result,
    Show,
    Summary,
)
from wakedeploy.gap.systems.gantry.findings import Answer, Judged, Told

STEPS = ("find", "name", "add", "show", "result")
TITLE = "The gap between simulation and measurement"  # the report is known by it
PICTURES = (
    *("maps_exogenous", "maps_fed_back", "replay", "spectrum", "confusion"),
    *("before_after", "places", "forecasts", "placebo", "retraining"),
)

Kind = TypeVar("Kind", bound=Artefact)


@dataclass(frozen=True)
class StepArtefacts:
    """One artefact per step; None where it has not run."""

    find: Find | None = None
    name: Name | None = None
    add: Add | None = None
    show: Show | None = None
    result: Result | None = None

    @property
    def flights(self) -> int:
        """How many flights were read, sealed ones included; 0 if `find` has not run."""
        return 0 if self.find is None else len(self.find.logs)

    @property
    def missing(self) -> str | None:
        """The step that comes next, `plan` for an open class; None when nothing is left to do.

        What no flight can confirm is not to be added, unless a person asks for it.
        """
        if self.find is None:
            return "find"
        if self.name is None:
            return "name"
        if self.add is not None and self.show is None:
            return "show"
        if cannot_tell(self.flights) or unconfirmed(self.flights):
            return None
        if self.add is None and _can_add(self.name):
            return "add"
        return "plan" if self._class_is_open else None

    @property
    def option(self) -> str:
        """What the next step needs beside its name, or ""."""
        by_expression = self.missing == "add" and self.name is not None and not self.name.to_add
        return " --from-symbolic" if by_expression else ""

    @property
    def summary(self) -> Summary:
        """What `result.json` says, and the steps themselves, which say more."""
        fields = parts(self.result, Told) | parts(self.name, Answer) | parts(self.show, Judged)
        fields["flights"] = fields.get("flights") or self.flights
        if self.result is not None:
            fields["places"] = self.result.where
        if self.find is not None:
            find = self.find
            fields |= {"places": find.places, "logs": find.logs, "split": find.split}
            fields |= {"unflown": find.unflown, "white_before": find.white}
        if self.name is not None:
            fields |= {key: getattr(self.name, key) for key in ("white", "split_by")}
            fields["threshold_of_s"] = self.name.threshold_of_s
        if self.show is not None:
            fields |= {"sealed": self.show.sealed, "retrain": self.show.retrain}
        return Summary(**fields)

    @property
    def _class_is_open(self) -> bool:
        """Whether a class is named and no member of it is in the rig file."""
        added = set() if self.add is None else {effect.name for effect in self.add.effects}
        members = [] if self.name is None else self.name.rivals
        return bool(members) and added.isdisjoint(members)


def _can_add(name: Name) -> bool:
    """Whether there is something to add: a named effect that matters, or an expression."""
    unknown = name.unknown is not None and bool(name.unknown.expression)
    return bool(name.to_add) or (name.verdict == "unknown" and unknown)


def parts(artefact: Artefact | None, kind: type[Answer | Judged]) -> dict[str, object]:
    """The fields of an artefact that belong to one of its parts, by name."""
    return {} if artefact is None else {name: getattr(artefact, name) for name in kind.model_fields}


def read_plan(folder: Path) -> Plan | None:
    """`plan.json`; None if no plan was made; UnusableInput if it cannot be read."""
    return _read(folder / "plan.json", Plan)


def read_steps(folder: Path) -> StepArtefacts:
    """Read the artefacts of a folder; UnusableInput for a file that cannot be read."""
    return StepArtefacts(
        _read(folder / "find.json", Find),
        _read(folder / "name.json", Name),
        _read(folder / "add.json", Add),
        _read(folder / "show.json", Show),
        _read(folder / "result.json", Result),
    )


def prepare(folder: Path, rig_path: Path) -> None:
    """Make the folder; every step calls this first.

    Raises UnusableInput if nothing can be written, or if the rig file would be lost.
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
    made(folder)


def refuse_foreign_rig(folder: Path) -> None:
    """UnusableInput if the folder holds a `rig.toml` that is not as `add` wrote it."""
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
    rig, written = folder / "rig.toml", _read(folder / "add.json", Add)
    if written is None or not rig.is_file():
        return False
    return sha256_of(rig.read_bytes()) == written.new_sha256


def forget(folder: Path, first: str) -> None:
    """Remove what `first` and the steps after it left in an earlier run, their rig file included.

    The report, its figures and the plan describe what is removed, and go too. A `rig.toml` that
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


def required(folder: Path, before: str, rig_sha256: str, logs: Sequence[str]) -> StepArtefacts:
    """What the steps have left; `before` has run in the folder, on this rig file and these logs.

    `logs` are the SHA-256 of the recordings, in order. UnusableInput if it has not.
    """
    steps = read_steps(folder)
    if getattr(steps, before) is None:
        raise UnusableInput(
            f"{folder}: there is no {before}.json yet; run `wakedeploy gap {before}` first."
        )
    find = steps.find or Find()
    if [log.sha256 for log in find.logs] != list(logs) or find.rig_sha256 != rig_sha256:
        raise UnusableInput(
            f"{folder / 'find.json'}: of another rig file or other logs; give the same --rig and "
            "--measured, or run `wakedeploy gap find` again."
        )
    return steps


def _read(path: Path, kind: type[Kind]) -> Kind | None:
    if not path.exists():
        return None
    again = "run the step that writes it again"
    try:
        content = json_of(text_of(path))
    except (OSError, ValueError) as error:
        raise UnusableInput(f"{path}: cannot be read ({one_line(error)}); {again}.") from error
    if not isinstance(content, dict):
        raise UnusableInput(f"{path}: holds no JSON object; {again}.")
    return stated(path, content, kind, again)


def write(folder: Path, artefact: Kind) -> Kind:
    """Write an artefact whole, under the name of its step, and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text_whole(
        folder / f"{type(artefact).__name__.lower()}.json", json_text(artefact.as_json())
    )
    return artefact
