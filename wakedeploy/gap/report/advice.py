"""What to do next: the step that is missing, or the flights, as commands to copy.

In: the artefacts of a folder. Out: a reason and commands; none where nothing is left to do. Too few
flights lead to flying and to nothing else; a class leads to the manoeuvre that splits it.
"""

import shlex
from pathlib import Path

from wakedeploy.gap.few_flights import cannot_tell, unconfirmed
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.systems.gantry.artefacts import Find
from wakedeploy.gap.systems.gantry.findings import Advice
from wakedeploy.gap.systems.gantry.folder import StepArtefacts

_SECONDS = 20  # as the flights that thresholds are simulated for
_PORT = "/dev/ttyACM0"
_REFERENCE = "manoeuvre.csv"
_STEPS = {
    "find": "find where simulation and measurement disagree",
    "name": "name the effect that explains it",
    "add": "put what was found into a new rig file",
    "show": "show the gap before and after, on flights that took no part in finding it",
}


def advice(steps: StepArtefacts, out: Path) -> Advice | None:
    """What comes after the steps that have run in the folder `out`; None where nothing is left."""
    if cannot_tell(steps.flights) or _wants_confirmation(steps):
        return _fly_more(steps.find or Find())
    if steps.missing == "plan":
        return _split(steps, out)
    if steps.missing is None:
        return _use(steps, out)
    command = f"wakedeploy gap {steps.missing}{steps.option}"
    return Advice(why=_STEPS[steps.missing], commands=[command])


def _wants_confirmation(steps: StepArtefacts) -> bool:
    """Something was found, no flight was kept apart, and no step is under way."""
    found = steps.name is not None and steps.name.verdict != "none"
    return found and unconfirmed(steps.flights) and steps.missing != "show"


def _use(steps: StepArtefacts, out: Path) -> Advice | None:
    """Episodes of the corrected rig, and predictors trained on them; None where it lacks nothing.

    The workflow trains one of each by itself where it was asked to.
    """
    rig = out / "rig.toml"
    if steps.add is None or not steps.add.effects or not rig.is_file():
        return None
    episodes = shlex.quote(str(out / "corrected-set"))
    return Advice(
        why="simulate and train with the corrected rig file",
        commands=[
            f"wakedeploy data make gantry --rig {shlex.quote(str(rig))} --out {episodes}",
            f"wakedeploy train --data {episodes} --arch gru --out {shlex.quote(str(out / 'runs'))}",
        ],
    )


def _fly_more(find: Find) -> Advice:
    """The flights that are missing, each with a seed that no log has."""
    flights = len(find.logs)
    more = FEWEST_IN_ALL - flights
    first = find.next_seed
    why = f"fly {more} more, {'with another seed' if more == 1 else 'each with another seed'}"
    again = f"then `wakedeploy gap close` again with all {FEWEST_IN_ALL} behind --measured"
    if unconfirmed(flights):
        again += ", the new one last, to be kept apart"
    if _virtual(find):
        again += " (--plant-rig and --hooks as before, where there were any)"
    commands = [_flight(find, f"--seed {first + i}") for i in range(more)]
    return Advice(why=f"{why}, {again}", commands=commands)


def _split(steps: StepArtefacts, out: Path) -> Advice | None:
    """The manoeuvre that splits a class, once it is known; None where the search found none."""
    find = steps.find or Find()
    plan = None if steps.result is None else steps.result.plan
    command = f"wakedeploy gap plan --rig {_rig(find)} --out {shlex.quote(str(out))}"
    if plan is not None and plan.manoeuvre:
        return Advice(
            why="fly the manoeuvre that would tell them apart",
            commands=[
                f"{command} --write-reference {_REFERENCE}",
                _flight(find, f"--reference {_REFERENCE}"),
            ],
        )
    if plan is not None and plan.is_searched:
        return None
    return Advice(why="look for the manoeuvre that would tell them apart", commands=[command])


def _flight(find: Find, what: str) -> str:
    """A command that flies as the logs were flown, and records beside them."""
    board = "--virtual" if _virtual(find) else f"--port {_PORT}"
    folder = str(Path(find.logs[0].path).parent) if find.logs else "."
    seconds = "" if what.startswith("--reference") else f"--seconds {_SECONDS} "
    return (
        f"wakedeploy run-gantry --baseline --rig {_rig(find)} {board} {seconds}{what} "
        f"--log {shlex.quote(folder)}"
    )


def _virtual(find: Find) -> bool:
    return bool(find.logs) and all(log.simulated for log in find.logs)


def _rig(find: Find) -> str:
    return shlex.quote(find.rig or "rig.toml")
