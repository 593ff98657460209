"""`wakedeploy gap`: find where simulation and measurement disagree, name the effect, add it, show.

In: a rig file and run logs. Out: a folder with one artefact per step, figures and a report.
"""

import functools
import importlib
import math
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.groups import Group, same_command
from wakedeploy.cli.log_lines import stages
from wakedeploy.cli.many_files import Many
from wakedeploy.cli.names import EFFECT
from wakedeploy.cli.numbers import Within
from wakedeploy.cli.output import Written
from wakedeploy.cli.workers import workers_option

if TYPE_CHECKING:
    from wakedeploy.gap.systems.gantry.artefacts import Name
    from wakedeploy.gap.systems.gantry.find_name_add_show import Case
    from wakedeploy.gap.systems.gantry.findings import Round

_OTHERS = {
    "follow": "gap_follow",
    "reference": "gap_reference",
    "init": "gap_system",
    "check": "gap_system",
    "simulate": "gap_system",
    "plan": "gap_plan",
    "power": "gap_plan",
    "demo": "gap_demo",
    "export": "gap_export",
    "domain": "gap_domain",
}
_STAGES = f"{__name__}.stages"
_STEPS = ("close", "find", "name", "add", "show")
_FILE = click.Path(path_type=Path, dir_okay=False)


class _Steps(Group):
    """The four steps here, the other commands in files of their own, loaded when asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """In the order of a person's work."""
        return [*_STEPS, *_OTHERS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A step, or the command object of `wakedeploy/cli/gap_<file>.py`."""
        if cmd_name in _OTHERS:
            module = importlib.import_module(f"wakedeploy.cli.{_OTHERS[cmd_name]}")
            command: click.Command = getattr(module, cmd_name)
            return command
        return super().get_command(ctx, cmd_name)


@click.group("gap", cls=_Steps)
def command() -> None:
    """Find where simulation and measurement disagree, name the missing effect, add it, show.

    Everything at once, on flights that one rig flew with one rig file, or on logs of a system of
    your own:

    \b
    Example:
        wakedeploy gap close --rig rig.toml --measured flight*.mcap --out gap
        wakedeploy gap close --system my_robot.py --measured log.csv --out gap
    The same in steps, to stop and look in between:
        wakedeploy gap find … ; wakedeploy gap name … ; wakedeploy gap add … ; wakedeploy gap show …
    The whole story on the virtual gantry:
        wakedeploy gap demo
    """


def _inputs(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options that every step takes."""
    for option in (
        click.option("--json", "json_path", type=Written(),
                     help="Also write the result as JSON here."),
        workers_option("Processes for the rig's thresholds, simulated once."),
        click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True,
                     help="Folder for artefacts, figures and report."),
        click.option("--measured", type=click.Path(path_type=Path), multiple=True, required=True,
                     help="Run logs of a rig, four or more, the last of which is sealed (from six "
                          "on, two); of a system one or more, files or folders, of which the last "
                          "quarter that moves is sealed."),
        click.option("--columns", type=_FILE,
                     help="With --system: what the logs' columns mean."),
        click.option("--system", "system_path", type=click.Path(path_type=Path),
                     help="Instead of --rig: a Python file with your own system."),
        click.option("--rig", "rig_path", type=_FILE,
                     help="The rig file that the flights were flown with."),
    ):  # fmt: skip
        function = option(function)
    return _of_rig_or_system(function)


def _require_flights(rig_path: Path, measured: tuple[Path, ...]) -> None:
    """UnusableInput for a rig that is a model of MuJoCo, and for a folder in the place of a log."""
    from wakedeploy.core.errors import UnusableInput
    from wakedeploy.gap.systems.files import OF_MJCF, is_mjcf

    if is_mjcf(rig_path):
        raise UnusableInput(f"{rig_path} {OF_MJCF}")
    folder = next((path for path in measured if path.is_dir()), None)
    if folder is not None:
        raise UnusableInput(f"{folder} is a folder; of a rig give the run logs, {folder}/*.mcap.")


def _step_of_rig(of_rig: Callable[..., Any], rig_path: Path, given: dict[str, Any]) -> None:
    try:
        of_rig(rig_path=rig_path, **given)
    except KeyboardInterrupt:
        step = str(click.get_current_context().info_name)
        _say_what_is_left(step, rig_path, given["measured"], given["out"])
        raise


def _retraining(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options of a step that may train predictors."""
    for option in (
        click.option("--minutes", type=Within(2, 600), default=10.0, show_default=True,
                     help="Simulated flight per predictor, with --retrain."),
        click.option("--retrain", is_flag=True,
                     help="Train a predictor on each rig; compare on the flights shown."),
    ):  # fmt: skip
        function = option(function)
    return function


def _of_rig_or_system(of_rig: Callable[..., Any]) -> Callable[..., Any]:
    """A step of a rig, or with --system the same step of a user's system."""

    @functools.wraps(of_rig)
    def step(
        *, system_path: Path | None, columns: Path | None, rig_path: Path | None, **given: Any
    ) -> None:
        if (system_path is None) == (rig_path is None):
            raise click.UsageError("Give one of '--rig' and '--system'.")
        if system_path is None:
            if columns is not None:
                raise click.UsageError("'--columns' goes with '--system'.")
            assert rig_path is not None
            if rig_path.suffix == ".py":
                raise click.UsageError(f"{rig_path} is a system: give it by '--system'.")
            _require_flights(rig_path, given["measured"])
            _step_of_rig(of_rig, rig_path, given)
            return
        from wakedeploy.cli.gap_system import run_steps
        from wakedeploy.gap.folder import LOG, require_logs

        common = {"rig_path", "measured", "out", "workers", "json_path", "only"}
        for name in given.keys() - common:
            source = click.get_current_context().get_parameter_source(name)
            if source is not click.core.ParameterSource.DEFAULT:
                raise click.UsageError(f"'--{name.replace('_', '-')}' goes with '--rig'.")
        require_logs(given["measured"], LOG)
        name = str(click.get_current_context().info_name)
        try:
            run_steps(
                name,
                system_path,
                given["measured"],
                columns,
                given["out"],
                given["json_path"],
                given.get("only", ()),
            )
        except KeyboardInterrupt:
            click.echo(f"The same command: {same_command()}", err=True)
            raise

    return step


@command.command("close", cls=Many)
@_inputs
@_retraining
def close_gap(
    rig_path: Path,
    measured: tuple[Path, ...],
    out: Path,
    workers: int,
    json_path: Path | None,
    retrain: bool,
    minutes: float,
) -> None:
    """Find, name, add and show, and write the report.

    \b
    Example:
        wakedeploy gap close --rig rig.toml --measured flights/*.mcap --out gap
        wakedeploy gap close --system my_robot.py --measured log.csv --out gap
    """
    _progress("loading")
    from wakedeploy.api.gaps import close_gap as close
    from wakedeploy.cli.output import warn, write_json
    from wakedeploy.gap.report.advice import advice

    asked = minutes if retrain else None
    closed = close(
        *(rig_path, measured, out),
        workers=workers,
        retrain_minutes=asked,
        progress=_progress,
        warn=warn,
    )
    click.echo(closed.account)
    if after := advice(closed.steps, out):
        click.echo(f"\n{after.text}")
    click.echo(f"\nReport: {closed.report}")
    write_json(json_path, closed.result.as_json())


@command.command("find", cls=Many)
@_inputs
def find_gap(
    rig_path: Path, measured: tuple[Path, ...], out: Path, workers: int, json_path: Path | None
) -> None:
    """Where do they disagree? Writes find.json and the maps.

    \b
    Example:
        wakedeploy gap find --rig rig.toml --measured flights/*.mcap --out gap
    """
    from wakedeploy.gap.systems.gantry.find_name_add_show import find

    case = _case(rig_path, measured, out, workers)
    found = find(case, out, _progress)
    _say_if_few(out)
    click.echo(found.sentence)
    for place in found.places:
        click.echo(f"  {place.words}")
    _finish(case, out, json_path)


@command.command("name", cls=Many)
@_inputs
def name_gap(
    rig_path: Path, measured: tuple[Path, ...], out: Path, workers: int, json_path: Path | None
) -> None:
    """Which effect explains it? Writes name.json.

    \b
    Example:
        wakedeploy gap name --rig rig.toml --measured flights/*.mcap --out gap
    """
    from wakedeploy.gap.report.evidence import leading_sentences
    from wakedeploy.gap.report.summary import verdict_sentence
    from wakedeploy.gap.systems.gantry.find_name_add_show import name
    from wakedeploy.gap.systems.gantry.folder import read_steps

    case = _case(rig_path, measured, out, workers)
    named = name(case, out, _progress)
    summary = read_steps(out).summary
    for sentence in (verdict_sentence(summary), *leading_sentences(summary)):
        click.echo(sentence)
    for searched in named.rounds:
        click.echo(f"{_gain_of(named, searched)}:")
        for entry in searched.ranking[:5]:
            click.echo(f"  {entry.name:<26} {entry.gain_nats:8.1f} nats")
    _finish(case, out, json_path)


def _gain_of(named: "Name", searched: "Round") -> str:
    """What the gains of a round are, on top of what, and what they have to pass where known."""
    given = f" on top of {', '.join(searched.given)}" if searched.given else ""
    least = searched.threshold_nats
    passing = "" if math.isnan(least) else f" (threshold {least:.1f})"
    if named.fitted_flights == 1:
        return f"Gain in this one flight, a nat per parameter taken off{passing}"
    return f"Gain on held-out flights{given}{passing}"


@command.command("add", cls=Many)
@_inputs
@click.option(
    "--effect",
    "only",
    multiple=True,
    shell_complete=EFFECT.shell_complete,
    help="Add this effect of the ranking, as one member of a class; of a system several, too.",
)
@click.option("--from-symbolic", is_flag=True, help="Add the expression of an unknown effect.")
def add_effect(
    rig_path: Path,
    measured: tuple[Path, ...],
    out: Path,
    workers: int,
    json_path: Path | None,
    only: tuple[str, ...],
    from_symbolic: bool,
) -> None:
    """Write the corrected rig file, OUT/rig.toml; the old one stays. Of a system, correction.toml.

    \b
    Example:
        wakedeploy gap add --system my_robot.py --measured log.csv --out gap
        wakedeploy gap add --system my_robot.py --measured log.csv --out gap --effect lag@motor_v
        wakedeploy gap add --rig rig.toml --measured flights/*.mcap --out gap
        wakedeploy gap add --rig rig.toml --measured flights/*.mcap --out gap --effect stiction
        wakedeploy gap add --rig rig.toml --measured flights/*.mcap --out gap --from-symbolic
    """
    from wakedeploy.gap.few_flights import caution
    from wakedeploy.gap.systems.gantry.find_name_add_show import add
    from wakedeploy.gap.systems.gantry.folder import read_steps

    if from_symbolic and only:
        raise click.UsageError("--effect and --from-symbolic exclude each other; give one.")
    if len(only) > 1:
        raise click.UsageError("Into a rig file one --effect goes at a time; give one.")
    effect = EFFECT.convert(only[0], None, click.get_current_context()) if only else None
    case = _case(rig_path, measured, out, workers)
    added = add(case, out, from_symbolic=from_symbolic, only=effect)
    names = ", ".join(effect.name for effect in added.effects)
    click.echo(f"Wrote {out / 'rig.toml'} with {names}.")
    if doubt := caution(read_steps(out).flights):
        click.echo(doubt)
    _finish(case, out, json_path)


@command.command("show", cls=Many)
@_inputs
@_retraining
def show_gap(
    rig_path: Path,
    measured: tuple[Path, ...],
    out: Path,
    workers: int,
    json_path: Path | None,
    retrain: bool,
    minutes: float,
) -> None:
    """The gap before and after, on sealed flights if any. Writes show.json and the report.

    \b
    Example:
        wakedeploy gap show --rig rig.toml --measured flights/*.mcap --out gap
    """
    from wakedeploy.api.gaps import trainer
    from wakedeploy.gap.report.shrinkage import channel_lines
    from wakedeploy.gap.systems.gantry.find_name_add_show import show_gap as show
    from wakedeploy.gap.systems.gantry.folder import read_steps

    case = _case(rig_path, measured, out, workers)
    train = trainer(minutes if retrain else None, workers, _progress)
    show(case, out, progress=_progress, retrain=train)
    _say_if_few(out)
    for line in channel_lines(read_steps(out).summary):
        click.echo(line)
    _finish(case, out, json_path)


def _enter(out: Path, rig_path: Path, measured: tuple[Path, ...]) -> None:
    """Make the folder, and keep others out of it until the command ends."""
    from wakedeploy.gap.folder import RUN_LOG, at_work, require_logs
    from wakedeploy.gap.systems.gantry.folder import prepare

    require_logs(measured, RUN_LOG)
    prepare(out, rig_path)
    click.get_current_context().with_resource(at_work(out))


def _case(rig_path: Path, measured: tuple[Path, ...], out: Path, workers: int) -> "Case":
    from wakedeploy.cli.output import warn
    from wakedeploy.gap.systems.gantry.find_name_add_show import open_case

    _enter(out, rig_path, measured)
    _progress("reading the flights")
    return open_case(rig_path, measured, workers=workers, progress=_progress, warn=warn)


def _finish(case: "Case", out: Path, json_path: Path | None) -> None:
    """Bring result and report up to date with the step."""
    from wakedeploy.cli.output import write_json
    from wakedeploy.gap.report.advice import advice
    from wakedeploy.gap.report.page import write_report
    from wakedeploy.gap.systems.gantry.folder import read_steps
    from wakedeploy.gap.systems.gantry.workflow import result

    _progress("drawing the report")
    outcome = result(case, out)
    write_report(out)
    if after := advice(read_steps(out), out):
        click.echo(after.text)
    click.echo(f"Report: {out / 'report.html'}")
    write_json(json_path, outcome.as_json())


def _say_if_few(out: Path) -> None:
    """The sentence that stands above whatever so few flights show."""
    from wakedeploy.gap.few_flights import cannot_tell, headline
    from wakedeploy.gap.systems.gantry.folder import read_steps

    flights = read_steps(out).flights
    if cannot_tell(flights):
        click.echo(headline(flights))


def _say_what_is_left(step: str, rig_path: Path, measured: tuple[Path, ...], out: Path) -> None:
    """After Ctrl-C: the whole command to go on with, or to begin the step anew with."""
    from wakedeploy.gap.systems.gantry.folder import read_steps

    def command(next_step: str, option: str = "") -> str:
        logs = [] if next_step == "plan" else ["--measured", *map(str, measured)]
        words = ["--rig", str(rig_path), *logs, "--out", str(out)]
        return f"wakedeploy gap {next_step} {shlex.join(words)}{option}"

    steps = read_steps(out)
    if step != "close":
        said = f"finished steps are kept; this one begins anew with:\n{same_command()}"
    elif steps.result is not None and steps.missing is None:
        trains = f"; to train:\n{command('show', ' --retrain')}" if steps.add is not None else "."
        said = f"the result stands{trains}"
    elif steps.find is not None and steps.missing is not None:
        said = f"finished steps are kept; go on with:\n{command(steps.missing, steps.option)}"
    else:
        kept = "no step is finished; thresholds that were simulated are kept"
        said = f"{kept}. Go on with:\n{same_command()}"
    click.echo(f"{out}: {said}", err=True)


def _progress(stage: str, done: int = 0, total: int = 0, /) -> None:
    """Lines on stderr: a stage begins, and how far it is."""
    context = click.get_current_context()
    if _STAGES not in context.meta:
        context.meta[_STAGES] = context.with_resource(stages())
    context.meta[_STAGES](stage, done, total)
