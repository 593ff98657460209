"""`wakedeploy gap init`, `check` and `simulate`, and the steps where a `--system` is given."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.log_lines import stages
from wakedeploy.cli.many_files import Many
from wakedeploy.cli.output import json_option, print_table, warn, write_json

if TYPE_CHECKING:
    from wakedeploy.core.recording import Recording
    from wakedeploy.gap.search.artefacts import Result
    from wakedeploy.gap.systems.logs import LogModel
    from wakedeploy.gap.systems.system import System

_FILE = click.Path(path_type=Path, dir_okay=False)
_NOTHING = 1e-3  # standard deviations that no log shows
SYSTEM = click.option("--system", "system_path", type=click.Path(path_type=Path),
                      help="A Python file with your own system.")  # fmt: skip
COLUMNS = click.option("--columns", type=_FILE,
                       help="What the logs' columns mean; a plain CSV needs none.")  # fmt: skip
MEASURED = click.option("--measured", type=click.Path(path_type=Path), multiple=True,
                        required=True, help="Logs, one or more.")  # fmt: skip


@click.command("init")
@click.argument("path", type=_FILE)
@click.option("--mjcf", type=_FILE, help="A MuJoCo model, whose joints and actuators it takes.")
def init(path: Path, mjcf: Path | None) -> None:
    """Write a first system, which runs as it is, to PATH.

    \b
    Example:
        wakedeploy gap init my_robot.py
        wakedeploy gap init my_arm.py --mjcf arm.xml
    """
    from wakedeploy.core.errors import UnusableInput
    from wakedeploy.core.files import write_text_whole
    from wakedeploy.gap.systems.template import template

    if path.suffix != ".py":
        raise UnusableInput(
            f"{path}: a system is a Python file; give a name that ends in .py, as {path.stem}.py."
        )
    if path.exists():
        raise UnusableInput(f"{path} is there already; give another name.")
    notes: list[str] = []
    if mjcf is None:
        text = template(path.stem)
    else:
        from wakedeploy.gap.systems.mjcf.template import coupling_notes, mjcf_template

        text, notes = mjcf_template(mjcf, path), coupling_notes(mjcf)
    write_text_whole(path, text)
    for note in notes:
        warn(f"{mjcf}: {note}.")
    named = shlex.quote(str(path))
    click.echo(
        f"Wrote {path}. Make it yours, then: wakedeploy gap check {named} --measured LOG\n"
        "A log with other names or units also needs --columns; a first one: wakedeploy data import "
        "table LOG --guess --columns columns.toml"
    )


@click.command("check", cls=Many)
@click.argument("system_file", required=False, type=click.Path(path_type=Path))
@SYSTEM
@MEASURED
@COLUMNS
@json_option
def check(
    system_file: Path | None,
    system_path: Path | None,
    measured: tuple[Path, ...],
    columns: Path | None,
    json_path: Path | None,
) -> None:
    """Look at a system and its logs before any fit: what moves the outputs, and what looks alike.

    \b
    Example:
        wakedeploy gap check my_robot.py --measured log.csv
    """
    from wakedeploy.gap.systems.clocks import late_inputs
    from wakedeploy.gap.systems.sensitivity import checked_base, column_notes, rows, step_notes
    from wakedeploy.gap.systems.words import late_words
    from wakedeploy.gap.wording import counted

    chosen = [path for path in (system_file, system_path) if path is not None]
    if len(chosen) != 1:
        raise click.UsageError("Give one system: wakedeploy gap check my_robot.py --measured LOG")
    model = open_model(chosen[0], measured, columns)
    samples = sum(log.outputs.shape[1] for log in model.logs)
    click.echo(
        f"{model.name}: {counted(len(model.logs), 'log')}, {samples} samples at "
        f"{model.system.rate_hz:g} Hz, {model.episodes} blocks, {len(model.library)} effects"
    )
    notes = column_notes(model)
    for note in notes:
        click.echo(f"  {note}")
    with stages() as progress:
        progress("fitting the noise")
        base = checked_base(model)
        progress("moving constants and effects")
        sensitivities = rows(
            model, base, lambda done, of: progress("moving constants and effects", done, of)
        )
    for note in [*step_notes(model, base), *late_words(late_inputs(model, base))]:
        click.echo(f"  {note}")
        notes.append(note)
    print_table(
        "Could these logs show it? No ranking, no answer: what each would move, in standard "
        "deviations of the prediction errors",
        ["constant or effect", "moves", "others free", "looks like"],
        [[r.name, _share(r.moved), _share(r.left), ", ".join(r.like)] for r in sensitivities],
    )
    if json_path:
        write_json(json_path, {"rows": [vars(r) for r in sensitivities], "notes": notes})


def _share(value: float) -> str:
    """Three digits, and 0 for what rounding leaves of nothing."""
    return f"{value:.3g}" if value >= _NOTHING else "0"


@click.command("simulate", cls=Many)
@SYSTEM
@MEASURED
@COLUMNS
@click.option("--correction", type=_FILE, help="What `gap add` wrote; replayed with and without.")
@json_option
def simulate(
    system_path: Path | None,
    measured: tuple[Path, ...],
    columns: Path | None,
    correction: Path | None,
    json_path: Path | None,
) -> None:
    """Replay logs from their first sample and their inputs alone; print how far off each output is.

    \b
    Example:
        wakedeploy gap simulate --system my_robot.py --measured log.csv
        wakedeploy gap simulate --system my_robot.py --measured log.csv --correction correction.toml
    """
    from wakedeploy.gap.systems.files import read_system
    from wakedeploy.gap.systems.simulation import replay_error

    if system_path is None:
        raise click.UsageError("Missing option '--system'.")
    system = read_system(system_path)
    better = None if correction is None else type(system).corrected(correction)
    rows, errors = [], {}
    for recording in recordings(measured, columns, system):
        plain = replay_error(system, recording)
        after = {} if better is None else replay_error(better, recording)
        errors[recording.name] = {"without": plain, "with": after}
        for output in system.outputs:
            value = f"{after[output.name]:.4g}" if after else ""
            row = [recording.name, output.name, f"{plain[output.name]:.4g}", value, output.unit]
            rows.append(row)
    print_table("rms error of the replay", ["log", "output", "without", "with", "unit"], rows)
    if json_path:
        write_json(json_path, errors)


def open_model(system_path: Path, measured: tuple[Path, ...], columns: Path | None) -> "LogModel":
    """A system and its logs."""
    from wakedeploy.gap.systems.files import read_system
    from wakedeploy.gap.systems.logs import LogModel

    system = read_system(system_path)
    return LogModel(system, recordings(measured, columns, system))


def recordings(
    measured: tuple[Path, ...], columns: Path | None, system: "System"
) -> "list[Recording]":
    """The logs, by `columns.toml`, or as CSV whose columns have the system's names."""
    if columns is None:
        from wakedeploy.gap.systems.files import read_plain

        return [read_plain(path, system) for path in measured]
    from wakedeploy.domains.tables.columns import read_columns
    from wakedeploy.domains.tables.reading import read_recordings

    units = {i.name: i.unit for i in system.inputs} | {o.name: o.unit for o in system.outputs}
    reading = read_recordings(list(measured), read_columns(columns), units)
    for note in reading.notes:
        warn(note)
    return list(reading.recordings)


def run_steps(
    step: str,
    system_path: Path,
    measured: tuple[Path, ...],
    columns: Path | None,
    out: Path,
    json_path: Path | None,
) -> None:
    """`find`, `name`, `add`, `show` or `close` of a user's system, into a folder."""
    from wakedeploy.gap.folder import at_work
    from wakedeploy.gap.report.system_page import write_page
    from wakedeploy.gap.search.artefacts import Artefact, Result
    from wakedeploy.gap.systems.own_folder import CORRECTION, OwnFolder
    from wakedeploy.gap.systems.words import first_screen, next_step, remarks, sentences
    from wakedeploy.gap.workflow import run

    page: Path | None = None
    after: list[str] = []
    out.mkdir(parents=True, exist_ok=True)
    with at_work(out), stages() as progress:
        progress("reading the logs")
        folder = OwnFolder(open_model(system_path, measured, columns), out, progress)
        try:
            artefact: Artefact = run(folder, step)
            if isinstance(artefact, Result):
                progress("drawing the report")
                after = next_commands(artefact, system_path, measured, columns, out)
                page = write_page(
                    artefact,
                    out,
                    answers=first_screen(artefact),
                    remarks=remarks(artefact),
                    next_step=(next_step(artefact), after),
                )
        except KeyboardInterrupt:
            click.echo(f"{out}: finished steps are kept; give the same command again.", err=True)
            raise
    for sentence in sentences(artefact):
        click.echo(sentence)
    if step not in ("find", "name"):
        click.echo(f"Correction: {out / CORRECTION}, for `gap simulate` and System.corrected()")
        for line in folder.exported:
            click.echo(line)
    if page is not None:
        click.echo(f"Report: {page}")
    for command in after:
        click.echo(f"Next: {command}")
    if json_path:
        artefact.write(json_path)


def next_commands(
    result: "Result", system_path: Path, measured: tuple[Path, ...], columns: Path | None, out: Path
) -> list[str]:
    """Replay a further log; plan what tells a class apart; else see what these logs show.

    The further log is not there yet: its name stands for it.
    """
    from wakedeploy.gap.systems.own_folder import CORRECTION
    from wakedeploy.gap.systems.words import FURTHER_LOG

    system, folder = shlex.quote(str(system_path)), shlex.quote(str(out))
    searched = [f"--measured {shlex.quote(str(path))}" for path in measured]
    further = f"--measured {shlex.quote(FURTHER_LOG + measured[0].suffix)}"
    by = [] if columns is None else [f"--columns {shlex.quote(str(columns))}"]
    logs = " ".join(searched + by)
    if result.verdict == "none" and not result.moved:
        return [f"wakedeploy gap power --system {system} {logs}"]
    if result.verdict == "unknown" or result.moved or not result.effects:
        return [f"wakedeploy gap check {system} {logs}"]
    if result.verdict != "class":
        correction = shlex.quote(str(out / CORRECTION))
        replayed = " ".join([further, *by])
        return [f"wakedeploy gap simulate --system {system} {replayed} --correction {correction}"]
    all_logs = " ".join([*searched, further, *by])
    return [
        f"wakedeploy gap plan --system {system} {logs} --out {folder} --write-input next.csv",
        f"wakedeploy gap close --system {system} {all_logs} --out {folder}",
    ]
