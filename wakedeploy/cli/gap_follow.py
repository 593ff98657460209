"""`wakedeploy gap follow`: after a class or an "unknown", plan, fly and answer again."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.many_files import Many
from wakedeploy.cli.output import Written
from wakedeploy.cli.workers import workers_option

if TYPE_CHECKING:
    from wakedeploy.gap.systems.gantry.follow_up import Fly, Manoeuvre, Open

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("follow", cls=Many)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="The folder that `gap close` left.",
)
@click.option(
    "--measured",
    type=_FILE,
    multiple=True,
    help="Logs of the manoeuvre, once it is flown at the rig.",
)
@click.option("--plant-rig", type=_FILE, help="What the virtual gantry is in truth.")
@click.option("--hooks", help="MODULE:FUNCTION giving the virtual plant's hooks.")
@workers_option("Processes for the rig's thresholds, simulated once.")
@click.option("--json", "json_path", type=Written(), help="Also write both answers as JSON here.")
def follow(
    out: Path,
    measured: tuple[Path, ...],
    plant_rig: Path | None,
    hooks: str | None,
    workers: int,
    json_path: Path | None,
) -> None:
    """Tell apart what the last answer left open: plan the manoeuvre, fly it, answer again.

    Where the flights so far were virtual, the manoeuvre is flown at once, in simulated time, with
    --plant-rig and --hooks as they were flown. At a rig it says what to fly; give the logs with
    --measured then.

    \b
    Example:
        wakedeploy gap follow --out gap --plant-rig truth.toml
        wakedeploy gap follow --out gap --measured gap/flown/*.mcap
    """  # fmt: skip
    from wakedeploy.cli.log_lines import stages
    from wakedeploy.cli.output import warn, write_json
    from wakedeploy.gap.folder import at_work
    from wakedeploy.gap.systems.gantry import follow_up as after

    with at_work(out), stages() as progress:
        question = after.what_is_open(out)
        rig, logs = after.rig_of(question), list(measured)
        if not logs:
            planned = after.planned_manoeuvre(out, question, rig, progress)
            click.echo(planned.sentence)
            if not question.is_virtual:
                click.echo(_to_fly(out, question, planned))
                return
            progress(f"flying {planned.name}, {planned.flights} times")
            logs = after.flown(out, question, planned, _virtual(question, plant_rig, hooks))
        followed = after.answered_again(
            out, question, logs, workers=workers, progress=progress, warn=warn
        )
    click.echo(f"Before: {followed.before.headline}")
    click.echo(f"Now: {followed.after.headline}")
    if not followed.is_settled:
        click.echo("It is still open; run this again to fly on, or see the report's next step.")
    click.echo(f"Report: {out / 'report.html'}")
    write_json(json_path, followed.model_dump(mode="json", by_alias=True))


def _virtual(question: "Open", plant_rig: Path | None, hooks: str | None) -> "Fly":
    """Who flies the virtual gantry, in lockstep, with PID alone."""
    from wakedeploy.api.flights import fly

    def flying(reference: Path, seed: int, log: Path) -> None:
        fly(
            rig=question.rig_path,
            seed=seed,
            log=log,
            reference=reference,
            plant_rig=plant_rig,
            hooks=hooks,
        )

    return flying


def _to_fly(out: Path, question: "Open", planned: "Manoeuvre") -> str:
    """The commands for a real rig, to copy: each flight, then this command with its logs."""
    from wakedeploy.gap.systems.gantry.follow_up import FLOWN

    folder = out / FLOWN
    lines = ["", f"Fly it {planned.flights} times, at rest on the stop before and after:"]
    for i in range(planned.flights):
        log = shlex.quote(str(folder / f"{planned.name}-{i + 1}.mcap"))
        lines.append(
            f"  wakedeploy run-gantry --baseline --rig {shlex.quote(str(question.rig_path))}"
            f" --port /dev/ttyACM0 --reference {shlex.quote(str(planned.path))} --log {log}"
        )
    lines += ["Then:", f"  wakedeploy gap follow --out {shlex.quote(str(out))} --measured"
              f" {shlex.quote(str(folder))}/*.mcap"]  # fmt: skip
    return "\n".join(lines)
