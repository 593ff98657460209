"""The commands that follow an answer about a user's system, to copy.

In: a `Result`, what a plan came to, and the files of the command that gave it. Out: shell lines.
"""

import shlex
from collections.abc import Sequence
from pathlib import Path

from wakedeploy.domains.tables.reading import without_ending
from wakedeploy.gap.search.artefacts import Result
from wakedeploy.gap.systems.answers.advice import outweighs
from wakedeploy.gap.systems.answers.folder import CORRECTION
from wakedeploy.gap.systems.answers.words import FURTHER_LOG, members
from wakedeploy.gap.systems.planning.planned import Planned


def next_commands(
    result: Result,
    system_path: Path,
    measured: Sequence[Path],
    columns: Path | None,
    out: Path,
    planned: Planned | None = None,
) -> list[str]:
    """Check columns, where they are in doubt; then what the answer asks for."""
    after = _by_verdict(result, system_path, measured, columns, out, planned)
    if outweighs(result) is None:
        return after
    check = _check(system_path, measured, columns)
    return [check, *(command for command in after if command != check)]


def _check(system_path: Path, measured: Sequence[Path], columns: Path | None) -> str:
    return f"wakedeploy gap check {shlex.quote(str(system_path))} {_logs(measured, columns)}"


def _logs(measured: Sequence[Path], columns: Path | None) -> str:
    """The options by which a command reads the logs that were searched."""
    given = [f"--measured {shlex.quote(str(path))}" for path in measured]
    return " ".join(given + _by(columns))


def _by(columns: Path | None) -> list[str]:
    return [] if columns is None else [f"--columns {shlex.quote(str(columns))}"]


def _by_verdict(
    result: Result,
    system_path: Path,
    measured: Sequence[Path],
    columns: Path | None,
    out: Path,
    planned: Planned | None,
) -> list[str]:
    """Replay a further log; tell a class apart, or add a member; else see what these logs show.

    The further log is not there yet: its name stands for it.
    """
    system, folder = shlex.quote(str(system_path)), shlex.quote(str(out))
    further = f"--measured {shlex.quote(FURTHER_LOG + _ending(measured[0]))}"
    logs = _logs(measured, columns)
    if result.curved:  # the same again, of a system that states the law
        return [f"wakedeploy gap close --system {system} {logs} --out {folder}"]
    if result.verdict == "none" and not result.moved:
        return [f"wakedeploy gap power --system {system} {logs}"]
    if result.verdict == "unknown" and result.rivals and not result.moved:
        apart = f"wakedeploy gap plan --system {system} {logs} --out {folder}"
        return [f"{apart} --write-input next.csv"]
    if result.verdict == "unknown" or result.moved or not result.effects:
        return [_check(system_path, measured, columns)]
    if result.verdict != "class":
        correction = shlex.quote(str(out / CORRECTION))
        replayed = " ".join([further, *_by(columns)])
        return [f"wakedeploy gap simulate --system {system} {replayed} --correction {correction}"]
    if planned is not None and not planned.splits:
        member = shlex.quote(members(result)[1])
        return [f"wakedeploy gap add --system {system} {logs} --out {folder} --effect {member}"]
    all_logs = " ".join([_logs(measured, None), further, *_by(columns)])
    return [
        f"wakedeploy gap plan --system {system} {logs} --out {folder} --write-input next.csv",
        f"wakedeploy gap close --system {system} {all_logs} --out {folder}",
    ]


def _ending(path: Path) -> str:
    """The ending of a log's format, such as `.csv` or `.csv.gz`."""
    return path.name.removeprefix(without_ending(path.name)) or path.suffix
