"""`wakedeploy gap init`, `check` and `simulate`, and the steps where a `--system` is given."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.groups import same_command
from wakedeploy.cli.log_lines import stages
from wakedeploy.cli.many_files import Many
from wakedeploy.cli.output import json_option, print_table, warn, write_json

if TYPE_CHECKING:
    from wakedeploy.api.systems import Taken
    from wakedeploy.gap.systems.likelihood.logs import LogModel

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
        f"table LOG --guess --system {named} --columns columns.toml"
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
    from wakedeploy.gap.systems.answers.words import late_words
    from wakedeploy.gap.systems.likelihood.clocks import late_inputs
    from wakedeploy.gap.systems.sensitivity import checked_base, column_notes, rows, step_notes
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
        [[r.name, _share(r.moved), _share(r.remaining), ", ".join(r.like)] for r in sensitivities],
    )
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
    from wakedeploy.api.systems import recordings_of
    from wakedeploy.gap.systems.files import read_system
    from wakedeploy.gap.systems.simulation import replay_error

    if system_path is None:
        raise click.UsageError("Missing option '--system'.")
    system = read_system(system_path)
    better = None if correction is None else type(system).corrected(correction)
    rows, errors = [], {}
    for recording in recordings_of(measured, columns, system, warn):
        plain = replay_error(system, recording)
        after = {} if better is None else replay_error(better, recording)
        errors[recording.name] = {"without": plain, "with": after}
        for output in system.outputs:
            values = [f"{error[output.name]:.4g}" for error in (plain, after) if error]
            rows.append([recording.name, output.name, *values, output.unit])
    columns_of_errors = ["without", "with"] if better else ["error"]
    head = ["log", "output", *columns_of_errors, "unit"]
    print_table("rms error of the replay", head, rows)
    write_json(json_path, errors)


def open_model(system_path: Path, measured: tuple[Path, ...], columns: Path | None) -> "LogModel":
    """A system and its logs."""
    from wakedeploy.api.systems import log_model

    return log_model(system_path, measured, columns, warn)


def run_steps(
    step: str,
    system_path: Path,
    measured: tuple[Path, ...],
    columns: Path | None,
    out: Path,
    json_path: Path | None,
    only: tuple[str, ...] = (),
) -> None:
    """`find`, `name`, `add`, `show` or `close` of a user's system, into a folder."""
    from wakedeploy.api.gaps import close_gap
    from wakedeploy.api.systems import Taken, take
    from wakedeploy.gap.search.artefacts import Result

    try:
        with stages() as progress:
            if step == "close":
                gap = close_gap(
                    system_path, measured, out, columns=columns, progress=progress, warn=warn
                )
                assert isinstance(gap.result, Result)
                taken = Taken(gap.result, gap.files, gap.next)
            else:
                taken = take(step, system_path, measured, columns, out, progress, warn, only=only)
    except KeyboardInterrupt:
        click.echo(
            f"{out}: finished steps are kept, and the one that ran begins anew; give the same "
            "command again.",
            err=True,
        )
        raise
    _tell(taken, out, only, is_added=step not in ("find", "name"))
    if (command := _following(step, taken, same_command())) is not None:
        click.echo(f"Next: {command}")
    write_json(json_path, taken.artefact.as_json())


def _following(step: str, taken: "Taken", command: str) -> str | None:
    """The same command for the step that comes next; None where another than that is to be done."""
    from wakedeploy.gap.search.artefacts import Answer

    is_named = isinstance(taken.artefact, Answer) and taken.artefact.verdict == "named"
    later = "name" if step == "find" else "add" if step == "name" and is_named else ""
    if not later or f" gap {step} " not in command:
        return None
    words = shlex.split(command)
    if "--json" in words:  # it has what this step said
        at = words.index("--json")
        del words[at : at + 2]
    kept = shlex.join(word for word in words if not word.startswith("--json="))
    return kept.replace(f" gap {step} ", f" gap {later} ", 1)


def _tell(taken: "Taken", out: Path, only: tuple[str, ...], *, is_added: bool) -> None:
    """Print what a step said, the files that it left, and what may follow."""
    from wakedeploy.gap.search.artefacts import Answer, Result
    from wakedeploy.gap.systems.answers.folder import correction_told, planned_in
    from wakedeploy.gap.systems.answers.words import added_sentences, sentences

    artefact = taken.artefact
    planned = planned_in(out, artefact) if isinstance(artefact, Result) else None
    said = added_sentences(artefact, only) if only else sentences(artefact, planned)
    for sentence in said:
        click.echo(sentence)
    if is_added:
        assert isinstance(artefact, Answer)
        click.echo(correction_told(out))
        for line in taken.exported:
            click.echo(line)
    if isinstance(artefact, Result):
        click.echo(f"Report: {out / 'report.html'}")
    for command in taken.next:
        click.echo(f"Next: {command}")
