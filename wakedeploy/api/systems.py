"""A system of the user's own and its logs, as functions and commands take them, and its steps.

In: a file, a class or an object, and logs or recordings. Out: a model of them, and a folder in
which the steps up to one have run.
"""

import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wakedeploy.api.inputs import PathLike
from wakedeploy.core.caller import Warn
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import path_from
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.columns import Columns, read_columns
from wakedeploy.domains.tables.guess_asked import Asked
from wakedeploy.domains.tables.reading import read_recordings
from wakedeploy.gap.folder import LOG, at_work, made, require_logs
from wakedeploy.gap.progress import Progress
from wakedeploy.gap.report.system_page import write_page
from wakedeploy.gap.search.artefacts import Artefact, Result
from wakedeploy.gap.systems.answers.folder import OwnFolder
from wakedeploy.gap.systems.answers.next_commands import next_commands
from wakedeploy.gap.systems.answers.words import first_screen, next_step, remarks
from wakedeploy.gap.systems.calls import attempted
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.coupled_forces import bent_inputs, coupled_forces
from wakedeploy.gap.systems.duration import long_search
from wakedeploy.gap.systems.files import read_plain, read_system
from wakedeploy.gap.systems.late_readings import in_time, late_readings
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.misread import misread
from wakedeploy.gap.systems.own_system import System
from wakedeploy.gap.systems.runaway import runaways
from wakedeploy.gap.systems.sensitivity import cut_outputs, hung_outputs, own_notes
from wakedeploy.gap.systems.wrapped_angles import going_on, jumps
from wakedeploy.gap.workflow import run

SystemLike = System | type[System] | PathLike
_PYTHON = re.compile(r"\.py(:\w+)?$")  # a file, or one of its classes
Measured = Sequence[Recording | PathLike]


@dataclass(frozen=True)
class Taken:
    """A step that was taken: what it said, files beside it, and the commands that may follow."""

    artefact: Artefact
    exported: tuple[str, ...] = ()
    next: tuple[str, ...] = ()


def is_system(given: object) -> bool:
    """Whether it is a system of the user's own, and not a rig file."""
    if isinstance(given, System) or (isinstance(given, type) and issubclass(given, System)):
        return True
    return isinstance(given, (str, os.PathLike)) and bool(_PYTHON.search(os.fspath(given)))


def system_of(given: SystemLike) -> System:
    """The system, checked; UnusableInput by name for what does not fit in it."""
    if isinstance(given, System):
        return checked(given)
    if isinstance(given, type):
        return checked(attempted(f"{given.__name__}()", given))
    if not isinstance(given, str | os.PathLike):
        raise UnusableInput(
            f"system is {given!r:.60}: give a class of a wd.System, an object of it, or its file."
        )
    return read_system(path_from(given, "system"))


def recordings_of(
    measured: Measured, columns: Columns | PathLike | None, system: System, warn: Warn
) -> list[Recording]:
    """The recordings, and logs by `columns`, or as CSV whose columns have the system's names.

    Of logs, outputs that are angles go on where they jump by a turn; of recordings that is said.
    """
    paths = [_log_path(log) for log in measured if not isinstance(log, Recording)]
    require_logs(paths, LOG)
    given = [log for log in measured if isinstance(log, Recording)]
    for note in (note for recording in given for note in jumps(system, recording)):
        warn(note)
    if columns is None:
        plain = [_plain(path, system, warn) for path in paths]
        return _used([*given, *plain], system, warn)
    if not paths:
        raise UnusableInput("columns go with logs that are read from files; leave them out.")
    known = columns if isinstance(columns, Columns) else read_columns(path_from(columns, "columns"))
    _require_roles(known, system)
    units = {each.name: each.unit for each in asked_of_logs(system)}
    reading = read_recordings(paths, known, units)
    for note in reading.notes:
        warn(note)
    return _used([*given, *reading.recordings], system, warn)


def _log_path(given: object) -> Path:
    """The file of a log; UnusableInput for what is neither that nor a recording, as a DataFrame."""
    if isinstance(given, str | os.PathLike):
        return path_from(given, "measured")
    raise UnusableInput(
        f"measured has a {type(given).__name__}, {given!r:.60}: give recordings, as of wd.read_log "
        "or wd.Recording, or files of logs."
    )


def _used(recordings: Sequence[Recording], system: System, warn: Warn) -> list[Recording]:
    """Each once, from where its readings count in time."""
    return [in_time(system, recording) for recording in _without_copies(recordings, system, warn)]


def _without_copies(recordings: Sequence[Recording], system: System, warn: Warn) -> list[Recording]:
    """Each once: a copy would count as evidence that nobody has. What never moves is no copy."""
    names = {each.name for each in asked_of_logs(system)}
    known: dict[str, Recording] = {}
    kept = []
    for recording in recordings:
        steps = np.round(np.diff(recording.time_s), 9)
        digest = hashlib.sha256(steps.tobytes())
        asked = (n for n in sorted(recording.columns) if n in names)
        moving = [n for n in asked if len(np.unique(recording.columns[n])) > 1]
        for name in moving:
            digest.update(name.encode() + np.ascontiguousarray(recording.columns[name]).tobytes())
        first = known.get(digest.hexdigest()) if moving else None
        if first is None:
            known[digest.hexdigest()] = recording
            kept.append(recording)
        elif first is recording:
            warn(f"{recording.name} is given twice; it counts once")
        else:
            warn(f"{recording.name} has the samples of {first.name}: a copy, which is left out")
    return kept


def _require_roles(columns: Columns, system: System) -> None:
    """UnusableInput for an input that is read as a reading, an output as a command, or neither.

    What drives the system has a value at all times; what it shows counts where it was measured. A
    table that has the system's name and is still unused is one that nobody has given its role.
    """
    opposite = {"input": {"output"}, "output": {"input"}}
    for each in asked_of_logs(system):
        column = columns.columns.get(each.name)
        if column is not None and set(column.roles) in (opposite[each.role], {"unused"}):
            raise UnusableInput(
                f"{columns.file}: columns.{each.name}.role is {column.roles[0]!r}, and it is an "
                f'{each.role} of {system.name}; give role = "{each.role}".'
            )


def asked_of_logs(system: System) -> list[Asked]:
    """The columns that a system needs: its inputs, but for those that a law makes, and outputs."""
    inputs = [Asked(each.name, "input", each.unit) for each in system.logged]
    return inputs + [Asked(each.name, "output", each.unit) for each in system.outputs]


def _plain(path: Path, system: System, warn: Warn) -> Recording:
    recording, notes = going_on(system, read_plain(path, system))
    for note in notes:
        warn(note)
    return recording


def log_model(
    system: SystemLike, measured: Measured, columns: Columns | PathLike | None, warn: Warn
) -> LogModel:
    """A system and its logs."""
    known = system_of(system)
    return LogModel(known, recordings_of(measured, columns, known, warn))


def take(
    step: str,
    system: SystemLike,
    measured: Measured,
    columns: Columns | PathLike | None,
    out: Path,
    progress: Progress,
    warn: Warn,
    *,
    report: bool = True,
    plan: bool = True,
    only: Sequence[str] = (),
) -> Taken:
    """The steps up to one, in a folder; what has run there for the same is not repeated."""
    progress("reading the logs")
    model = log_model(system, measured, columns, warn)
    model.require_effects()
    with at_work(made(out)):
        folder = OwnFolder(model, out, progress, only)
        if not folder.is_found:
            progress("looking at the columns")
            for note in (
                *runaways(model),
                *long_search(model),
                *misread(model),
                *late_readings(model),
                *cut_outputs(model),
                *hung_outputs(model),
                *coupled_forces(model),
                *bent_inputs(model),
                *own_notes(model),
            ):
                warn(note)
        artefact = run(folder, step)
        if not isinstance(artefact, Result):
            return Taken(artefact, tuple(folder.exported))
        planned = folder.plan() if plan else None
        after: list[str] = []
        logs = [Path(log) for log in measured if not isinstance(log, Recording)]
        lies_in_files = len(logs) == len(measured) and not isinstance(columns, Columns)
        if lies_in_files and not isinstance(system, (System, type)):  # else no command has it
            by = None if columns is None or isinstance(columns, Columns) else Path(columns)
            after = next_commands(artefact, Path(system), logs, by, out, planned)
        if report:
            progress("drawing the report")
            write_page(
                artefact,
                out,
                answers=first_screen(artefact, planned),
                remarks=remarks(artefact),
                next_step=(next_step(artefact, planned), after),
            )
        return Taken(artefact, tuple(folder.exported), tuple(after))
