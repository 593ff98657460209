"""What to do next: the step that is missing, or the flights, as commands to copy.

In: the artefacts of a folder. Out: a reason and commands; none where nothing is left to do. Too few
flights lead to flying and to nothing else; a class leads to the manoeuvre that splits it.
"""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wakedeploy.gap.few_flights import cannot_tell, unconfirmed
from wakedeploy.gap.folder import Steps
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.wording import entries, mapping, number

_SECONDS = 20  # as the flights that thresholds are simulated for
_PORT = "/dev/ttyACM0"
_REFERENCE = "manoeuvre.csv"
_STEPS = {
    "find": "find where simulation and measurement disagree",
    "name": "name the effect that explains it",
    "add": "put what was found into a new rig file",
    "show": "show the gap before and after, on flights that took no part in finding it",
}


@dataclass(frozen=True)
class Advice:
    """A reason, and the commands in their order."""

    why: str
    commands: tuple[str, ...]

    @property
    def text(self) -> str:
        """As a terminal shows it: `Next: …`, then a command per line."""
        return "\n".join([f"Next: {self.why}:", *(f"  {command}" for command in self.commands)])

    def as_json(self) -> dict[str, Any]:
        """As `result.json` holds it."""
        return {"why": self.why, "commands": list(self.commands)}


def advice(steps: Steps, out: Path) -> Advice | None:
    """What comes after the steps that have run in the folder `out`; None where nothing is left."""
    if cannot_tell(steps.flights) or _wants_confirmation(steps):
        return _fly_more(steps.find, steps.flights)
    if steps.missing == "plan":
        return _split(steps, out)
    if steps.missing is None:
        return None
    return Advice(_STEPS[steps.missing], (f"wakedeploy gap {steps.missing}{steps.option}",))


def _wants_confirmation(steps: Steps) -> bool:
    """Something was found, no flight was kept apart, and no step is under way."""
    found = steps.name.get("verdict") not in (None, "none")
    return found and unconfirmed(steps.flights) and steps.missing != "show"


def _fly_more(find: Mapping[str, Any], flights: int) -> Advice:
    """The flights that are missing, each with a seed that no log has."""
    more = FEWEST_IN_ALL - flights
    flown = [number(log.get("seed")) for log in entries(find.get("logs"))]
    first = round(max((seed for seed in flown if seed == seed), default=0.0)) + 1
    why = f"fly {more} more, {'with another seed' if more == 1 else 'each with another seed'}"
    again = f"then `wakedeploy gap close` again with all {FEWEST_IN_ALL} behind --measured"
    if unconfirmed(flights):
        again += ", the new one last, to be kept apart"
    if _virtual(find):
        again += " (--plant-rig and --hooks as before, where there were any)"
    flags = (f"--seed {first + i}" for i in range(more))
    return Advice(f"{why}, {again}", tuple(_flight(find, each) for each in flags))


def _split(steps: Steps, out: Path) -> Advice | None:
    """The manoeuvre that splits a class, once it is known; None where the search found none."""
    plan = mapping(steps.result.get("plan"))
    told = f"wakedeploy gap plan --rig {_rig(steps.find)} --out {shlex.quote(str(out))}"
    if plan.get("manoeuvre"):
        why = "fly the manoeuvre that would tell them apart"
        reference = f"--reference {_REFERENCE}"
        return Advice(why, (f"{told} --write-reference {_REFERENCE}",
                            _flight(steps.find, reference)))  # fmt: skip
    if "manoeuvre" in plan:
        return None
    return Advice("look for the manoeuvre that would tell them apart", (told,))


def _flight(find: Mapping[str, Any], what: str) -> str:
    """A command that flies as the logs were flown, and records beside them."""
    logs = entries(find.get("logs"))
    board = "--virtual" if _virtual(find) else f"--port {_PORT}"
    folder = str(Path(str(logs[0].get("path"))).parent) if logs else "."
    seconds = "" if what.startswith("--reference") else f"--seconds {_SECONDS} "
    return (
        f"wakedeploy run-gantry --baseline --rig {_rig(find)} {board} {seconds}{what} "
        f"--log {shlex.quote(folder)}"
    )


def _virtual(find: Mapping[str, Any]) -> bool:
    logs = entries(find.get("logs"))
    return bool(logs) and all(log.get("simulated") for log in logs)


def _rig(find: Mapping[str, Any]) -> str:
    return shlex.quote(str(find.get("rig") or "rig.toml"))
