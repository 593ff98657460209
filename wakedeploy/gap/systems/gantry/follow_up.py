"""After a class or an "unknown": the manoeuvre that splits it is flown, and asked about again.

In: a folder that `gap close` left, and a way to fly. Out: the manoeuvre as a file, its flights, the
folder with the new answer, and `follow.json` with both answers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from wakedeploy.core.caller import Warn
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import json_text, write_text_whole
from wakedeploy.core.rig import Rig
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.search.artefacts import Part
from wakedeploy.gap.systems.gantry.artefacts import Find, Result
from wakedeploy.gap.systems.gantry.flight import usable_flights
from wakedeploy.gap.systems.gantry.folder import StepArtefacts, read_steps
from wakedeploy.gap.systems.gantry.planning.plan import (
    Option,
    make_plan,
    stated_sizes,
    write_plan_reference,
)
from wakedeploy.gap.systems.gantry.workflow import close
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.rig.file import read_rig

MOST_FLIGHTS = 4  # of one manoeuvre at a time; a manoeuvre that takes more is asked for again
_LEADING = 2  # of a ranking, if nothing was named
FLOWN = "flown"
REFERENCE = "manoeuvre.csv"

# Flies a reference file with this seed, and records it there.
Fly = Callable[[Path, int, Path], None]


class Short(Part):
    """An answer in short: verdict, class, effects, and the sentence that heads the report."""

    verdict: str | None
    rivals: list[str] = Field(alias="class")
    headline: str
    effects: list[str]


class Followed(Part):
    """follow.json: what was to be told apart, the flights for it, and both answers."""

    split: list[str]
    new_logs: list[str]
    before: Short
    after: Short

    @property
    def is_settled(self) -> bool:
        """Whether the new answer leaves no class and no "unknown"."""
        return not self.after.rivals and self.after.verdict in ("named", "none")


@dataclass(frozen=True)
class Open:
    """What is still open: effects to tell apart, the flights so far, and the rig file."""

    names: tuple[str, ...]
    logs: tuple[Path, ...]
    rig_path: Path
    is_virtual: bool
    next_seed: int
    before: Short


@dataclass(frozen=True)
class Manoeuvre:
    """What to fly, and how often; `path` is for `run-gantry --reference`."""

    path: Path
    name: str
    description: str
    flights: int
    sentence: str


def what_is_open(folder: Path) -> Open:
    """What the folder's artefacts leave open; UnusableInput if nothing, or if it is not known."""
    if (folder / "domain.json").is_file():
        raise UnusableInput(
            f"{folder} is of a system and not of a rig: ask `wakedeploy gap plan --system` which "
            "input tells more, record it, and search with that log, too."
        )
    steps = read_steps(folder)
    if steps.result is None:
        raise UnusableInput(f"{folder}: there is no result.json; run `wakedeploy gap close` first.")
    names = _names(steps, steps.result)
    if len(names) < 2:
        verdict = steps.result.verdict
        raise UnusableInput(f"{folder}: the answer is {verdict!r}: nothing is left to tell apart.")
    find = steps.find or Find()
    paths = tuple(Path(log.path) for log in find.logs)
    missing = [path for path in paths if not path.is_file()]
    if missing:
        raise UnusableInput(f"{missing[0]}: this log of the first answer is gone; put it back.")
    return Open(
        names,
        paths,
        Path(str(find.rig)),
        all(log.simulated for log in find.logs),
        find.next_seed,
        _short(steps.result),
    )


def _names(steps: StepArtefacts, result: Result) -> tuple[str, ...]:
    """The members of the class, or the effects that lead if nothing was named."""
    if len(result.rivals) > 1:
        return tuple(result.rivals)
    if result.verdict != "unknown" or steps.name is None:
        return ()
    ranking = [entry for searched in steps.name.rounds[:1] for entry in searched.ranking]
    return tuple(entry.name for entry in ranking if entry.name in LIBRARY)[:_LEADING]


def _short(result: Result) -> Short:
    return Short(
        verdict=result.verdict,
        rivals=result.rivals,
        headline=result.headline,
        effects=[effect.name for effect in result.effects],
    )


def planned_manoeuvre(
    folder: Path, question: Open, rig: Rig, progress: Progress = quiet
) -> Manoeuvre:
    """The manoeuvre that splits the effects best, written beside the answer.

    Raises UnusableInput if none does within the rig's limits; the sentence says what would.
    """
    stage = "looking for the manoeuvre that tells them apart"
    progress(stage)
    sizes = stated_sizes(read_steps(folder).name, question.names)
    plan = make_plan(
        rig, question.names, sizes=sizes, progress=lambda done, of: progress(stage, done, of)
    )
    best: Option | None = plan.best
    if best is None or best.flights is None:
        raise UnusableInput(plan.sentence)
    path = folder / REFERENCE
    write_plan_reference(path, rig, best)
    kept = min(best.flights, MOST_FLIGHTS)
    named = best.manoeuvre
    return Manoeuvre(path, named.name, named.description, kept, plan.sentence)


def flown(folder: Path, question: Open, planned: Manoeuvre, fly: Fly) -> list[Path]:
    """Fly the manoeuvre as often as needed, each flight with its own seed; return the logs."""
    place = folder / FLOWN
    place.mkdir(parents=True, exist_ok=True)
    logs = []
    for i in range(planned.flights):
        seed = question.next_seed + i
        path = place / f"{planned.name}-{seed}.mcap"
        fly(planned.path, seed, path)
        logs.append(path)
    return logs


def answered_again(
    folder: Path,
    question: Open,
    new: Sequence[Path],
    *,
    workers: int,
    progress: Progress,
    warn: Warn,
) -> Followed:
    """The answer from all flights, the new ones first; writes `follow.json`.

    The last of the earlier flights stay sealed: they have confirmed nothing of the new answer.
    `warn` is called for each new log that holds no flight; UnusableInput if none holds one.
    """
    flights, unflown = usable_flights(new, rig_of(question))
    for log in unflown:
        warn(log.sentence)
    new = [Path(flight.name) for flight in flights]
    logs = [*new, *question.logs]
    result = close(question.rig_path, logs, folder, workers=workers, progress=progress)
    followed = Followed(
        split=list(question.names),
        new_logs=[str(path) for path in new],
        before=question.before,
        after=_short(result),
    )
    write_text_whole(
        folder / "follow.json", json_text(followed.model_dump(mode="json", by_alias=True))
    )
    return followed


def rig_of(question: Open) -> Rig:
    """The rig file of the first answer; UnusableInput if it is gone."""
    if not question.rig_path.is_file():
        raise UnusableInput(f"{question.rig_path}: the rig file of the first answer is gone.")
    return read_rig(question.rig_path)
