"""What the steps have left in a folder, as far as they have run, and what comes next.

In: a folder with `find.json`, `name.json`, `add.json`, `show.json`, `result.json`. Out: their
contents as mappings, empty where a step has not run yet.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wakedeploy.errors import UnusableInput, one_line
from wakedeploy.gap.telling import mapping, texts

Artefact = Mapping[str, Any]

# Keys of the steps' own artefacts that the account looks at, beside those of result.json.
_OF_FIND = ("places", "logs", "split", "noise_floor")
_OF_NAME = ("verdict", "effects", "class", "split_by", "unknown", "detectable", "white")
_OF_SHOW = ("sealed", "cross_validated", "gap", "placebo", "retrain")


@dataclass(frozen=True)
class Steps:
    """One artefact per step; {} where it has not run."""

    find: Artefact
    name: Artefact
    add: Artefact
    show: Artefact
    result: Artefact

    @property
    def missing(self) -> str | None:
        """The step that comes next; None when nothing is left to do."""
        if not self.find:
            return "find"
        if not self.name:
            return "name"
        if not self.add and self._can_add:
            return "add"
        return None if self.show or not self.add else "show"

    @property
    def summary(self) -> dict[str, Any]:
        """`result.json`, with what it leaves out taken from the steps' own artefacts."""
        told: dict[str, Any] = {}
        for artefact, keys in (
            (self.find, _OF_FIND),
            (self.name, _OF_NAME),
            (self.show, _OF_SHOW),
            (self.result, tuple(self.result)),
        ):
            told |= {key: artefact[key] for key in keys if artefact.get(key) is not None}
        return told

    @property
    def _can_add(self) -> bool:
        """There is an effect, a best one of a class, or an expression that a rig could be given."""
        return self.name.get("verdict") != "none" and bool(
            self.name.get("effects")
            or texts(self.name.get("class"))
            or mapping(self.name.get("unknown")).get("expression")
        )


def read_steps(folder: Path) -> Steps:
    """Read the artefacts of a folder; UnusableInput where a file is there and cannot be read."""
    names = ("find", "name", "add", "show", "result")
    return Steps(**{name: _read(folder / f"{name}.json") for name in names})


def _read(path: Path) -> Artefact:
    if not path.exists():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UnusableInput(
            f"{path}: cannot be read ({one_line(error)}); run the step that writes it again."
        ) from error
    if not isinstance(content, dict):
        raise UnusableInput(f"{path}: holds no JSON object; run the step that writes it again.")
    return content
