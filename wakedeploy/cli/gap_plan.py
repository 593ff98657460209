"""`wakedeploy gap plan` and `gap power`: what to fly next, and what flying can tell at all."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.gap_system import COLUMNS, SYSTEM
from wakedeploy.cli.many_files import Many
from wakedeploy.cli.names import EFFECT
from wakedeploy.cli.numbers import Within
from wakedeploy.cli.output import Written, print_table, progress, write_json
from wakedeploy.cli.workers import workers_option
from wakedeploy.core.errors import CheckFailed, UnusableInput

if TYPE_CHECKING:
    from wakedeploy.core.rig import Rig
    from wakedeploy.gap.systems.gantry.planning.plan import Option, Plan

_FILE = click.Path(dir_okay=False, path_type=Path)
_FOLDER = click.Path(file_okay=False, path_type=Path)
_RIG = click.option("--rig", "rig_path", type=_FILE, help="Default: the default rig.")
_MEASURED = click.option("--measured", type=click.Path(path_type=Path), multiple=True,
                         help="With --system: logs, from which its noise is known.")  # fmt: skip


@click.command(cls=Many)
@_RIG
@SYSTEM
@_MEASURED
@COLUMNS
@click.option(
    "--class", "names", multiple=True, shell_complete=EFFECT.shell_complete,
    help="An effect of the class; at least two, of a system one will do.",
)  # fmt: skip
@click.option(
    "--out",
    type=_FOLDER,
    help="Read the class from what is here; a rig's plan.json goes here, too.",
)
@click.option(
    "--write-reference", "reference", type=Written(), help="CSV for run-gantry --reference."
)
@click.option("--write-input", "input_path", type=Written(), help="With --system: its input, CSV.")
@click.option("--json", "json_path", type=Written(), help="Also write the plan as JSON.")
def plan(
    rig_path: Path | None,
    system_path: Path | None,
    measured: tuple[Path, ...],
    columns: Path | None,
    names: tuple[str, ...],
    out: Path | None,
    reference: Path | None,
    input_path: Path | None,
    json_path: Path | None,
) -> None:
    """Find the manoeuvre or input that best splits a class of effects, out of a menu.

    For every manoeuvre: the nats by which the rival of each pair would lose in one flight, and how
    many new flights that takes with margin. With --out, at the sizes that were found. Of a system
    of your own: which input, within its limits, splits the class, or makes one effect seen.

    \b
    Example:
        wakedeploy gap plan --class coulomb-friction --class viscous-friction
        wakedeploy gap plan --rig rig.toml --out gap --write-reference fly.csv
        wakedeploy gap plan --system my_robot.py --measured log.csv --out gap --write-input next.csv
    """
    if _is_system(system_path, rig_path, bool(measured or columns or input_path)):
        from wakedeploy.cli.gap_plan_system import run_plan

        if reference is not None:
            raise click.UsageError("'--write-reference' goes with '--rig'; give '--write-input'.")
        assert system_path is not None
        run_plan(system_path, measured, columns, names, out, input_path, json_path)
        return
    names = tuple(EFFECT.convert(name, None, click.get_current_context()) for name in names)
    from wakedeploy.gap.folder import at_work
    from wakedeploy.gap.systems.gantry.planning.manoeuvres import menu
    from wakedeploy.gap.systems.gantry.planning.plan import make_plan, write_plan_reference
    from wakedeploy.rig.file import default_rig, read_rig

    rig = read_rig(rig_path) if rig_path else default_rig()
    members = names or _class_in(out)
    if out is not None:
        click.get_current_context().with_resource(at_work(out))
        _same_rig(out, rig, rig_path)
    sizes = _known_sizes(out, members)
    with progress("Flying manoeuvres", len(menu()) + 1) as bar:
        made = make_plan(rig, members, sizes=sizes, progress=bar.update)
    _tell_plan(made)
    write_json(json_path, made.as_artefact.as_json())
    if out is not None:
        _keep(made, out)
    if reference is not None and made.best is None:
        raise CheckFailed(f"{reference}: not written, for no manoeuvre splits this class.")
    if reference is not None and made.best is not None:
        write_plan_reference(reference, rig, made.best)
        click.echo(f"Written: {reference}. Fly it with `wakedeploy run-gantry --reference`.")


@click.command(cls=Many)
@_RIG
@SYSTEM
@_MEASURED
@COLUMNS
@click.option("--flights", type=click.IntRange(4, 500), default=7, show_default=True)
@click.option("--seconds", type=Within(8, 600), default=20.0, show_default=True)
@click.option("--out", type=_FOLDER, help="Write power.json, power.html and figures here.")
@workers_option()
@click.option(
    "--simulate-threshold",
    is_flag=True,
    help="Simulate the rig's false-alarm threshold if it is not known (minutes).",
)
def power(
    rig_path: Path | None,
    system_path: Path | None,
    measured: tuple[Path, ...],
    columns: Path | None,
    flights: int,
    seconds: float,
    out: Path | None,
    workers: int,
    simulate_threshold: bool,
) -> None:
    """Say what flights of a rig will and will not tell, before any is flown.

    Per effect of the library: the smallest size that will be detected, and named; the rivals that
    remain; minutes of flight until it is named; the cheapest sensor that names it; and what
    ignoring it costs in tracking error. With --out, a page to read before buying a sensor. Of a
    system of your own: how large each effect must be to be named on logs like those measured.

    \b
    Example:
        wakedeploy gap power --rig rig.toml --flights 7 --seconds 20 --out power
        wakedeploy gap power --system my_robot.py --measured log.csv
    """
    if _is_system(system_path, rig_path, bool(measured or columns)):
        from wakedeploy.cli.gap_plan_system import run_power

        assert system_path is not None
        run_power(system_path, measured, columns, out)
        return
    from wakedeploy.gap.report.power_page import COLUMNS, rows, sentences, write_page
    from wakedeploy.gap.systems.gantry.planning.power import power as compute
    from wakedeploy.gap.systems.gantry.planning.power import step_count
    from wakedeploy.rig.file import default_rig, read_rig

    rig = read_rig(rig_path) if rig_path else default_rig()
    threshold = _threshold(rig, simulate_threshold, workers)
    with progress("Simulating", step_count(rig, flights)) as bar:
        computed = compute(
            rig,
            flights=flights,
            seconds=seconds,
            threshold_nats=threshold,
            workers=workers,
            progress=lambda stage, done, total: bar.advance(),
        )
    print_table("What these flights will tell", COLUMNS, rows(computed))
    for sentence in sentences(computed):
        click.echo(sentence)
    if out is not None:
        write_json(out / "power.json", computed.as_json())
        click.echo(f"Page: {write_page(computed, out, rig_path)}")


def _is_system(system_path: Path | None, rig_path: Path | None, of_system: bool) -> bool:
    """Whether a user's system is meant; UsageError for options that do not go together."""
    if system_path is not None and rig_path is not None:
        raise click.UsageError("Give one of '--rig' and '--system'.")
    if system_path is None and of_system:
        raise click.UsageError("'--measured', '--columns' and '--write-input' go with '--system'.")
    return system_path is not None


def _tell_plan(made: "Plan") -> None:
    pairs = [(i, j) for i in range(len(made.names)) for j in range(i)]
    columns = ["manoeuvre", "s"]
    columns += [f"{made.names[j]} / {made.names[i]}" for i, j in pairs]
    columns += ["flights", "total s", ""]
    rows = [_option_row(option, pairs) for option in made.options]
    rows.append(_option_row(made.random, pairs))
    print_table("Nats by which the rival loses in one flight", columns, rows)
    click.echo(made.sentence)


def _option_row(option: "Option", pairs: list[tuple[int, int]]) -> list[str]:
    nats = [f"{min(option.loss[i, j], option.loss[j, i]):.1f}" for i, j in pairs]
    needed = (
        ["-", "-"] if option.flights is None else [str(option.flights), f"{option.total_s:.0f}"]
    )
    manoeuvre = option.manoeuvre
    return [manoeuvre.name, f"{option.seconds:.0f}", *nats, *needed, manoeuvre.description]


def _keep(made: "Plan", out: Path) -> None:
    """Write plan.json, and add the plan to the result and report, if they are of this class."""
    from wakedeploy.gap.report.page import write_report
    from wakedeploy.gap.systems.gantry.workflow import plan_kept

    if plan_kept(out, made.as_artefact):
        write_report(out)


def _class_in(out: Path | None) -> tuple[str, ...]:
    """The class that `gap close` or `gap name` left."""
    from wakedeploy.gap.systems.gantry.folder import read_steps
    from wakedeploy.physics.effects import LIBRARY

    if out is None:
        raise UnusableInput("Say what to split: --class NAME twice, or --out with a result.json.")
    result = read_steps(out).result
    members = [] if result is None else result.rivals
    if len(members) < 2:
        raise UnusableInput(f"{out / 'result.json'}: holds no class; give --class NAME twice.")
    unknown = [name for name in members if name not in LIBRARY]
    if unknown:
        raise UnusableInput(
            f"{out / 'result.json'}: {unknown[0]!r} of its class is no effect; name it again."
        )
    return tuple(members)


def _same_rig(out: Path, rig: "Rig", rig_path: Path | None) -> None:
    """UnusableInput where the class in the folder was found with another rig file."""
    from wakedeploy.gap.systems.gantry.folder import read_steps

    find = read_steps(out).find
    if find is None or find.rig_sha256 == rig.sha256:
        return
    raise UnusableInput(
        f"{rig_path or 'The default rig'}: the flights in {out} were compared with another rig "
        "file; give that one by --rig."
    )


def _known_sizes(out: Path | None, names: tuple[str, ...]) -> dict[str, tuple[float, ...]]:
    """Each member's parameters as `name` fitted them, where it did."""
    from wakedeploy.gap.systems.gantry.folder import read_steps
    from wakedeploy.gap.systems.gantry.planning.plan import stated_sizes

    return {} if out is None else stated_sizes(read_steps(out).name, names)


def _threshold(rig: "Rig", is_simulated: bool, workers: int) -> float | None:
    """The rig's threshold if it is known or asked for; None leaves it to Gaussian draws."""
    from wakedeploy.gap.systems.gantry.search.threshold import (
        SETS,
        known_thresholds,
        thresholds_for,
    )

    known = known_thresholds(rig)
    if known is None and is_simulated:
        with progress("Simulating the threshold", SETS) as bar:
            known = thresholds_for(rig, workers=workers, progress=bar.update)
    return None if known is None else known.effect_nats
