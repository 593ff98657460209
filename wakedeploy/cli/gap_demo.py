"""`wakedeploy gap demo`: find, name and add the effect that the paper left out, and fly again."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.log_lines import stages
from wakedeploy.cli.output import print_table, write_json
from wakedeploy.cli.workers import workers_option
from wakedeploy.core.errors import CheckFailed

if TYPE_CHECKING:
    from wakedeploy.gap.demo import Story
    from wakedeploy.gap.systems.gantry.retraining import FlownAgain, TrackingError

_FOLDER = click.Path(file_okay=False, path_type=Path)


@click.command()
@click.option(
    "--out",
    type=_FOLDER,
    default=Path("gap-demo"),
    show_default=True,
    help="Everything the demo makes lies here.",
)
@click.option("--quick", is_flag=True, help="Fewer and shorter flights, less training.")
@click.option("--figures", type=_FOLDER, help="Copy the picture of the story here, too.")
@workers_option()
def demo(out: Path, quick: bool, figures: Path | None, workers: int) -> None:
    """Find the missing effect of the paper: motors that take time to spool up and down.

    The rig file says that motors follow at once; the virtual gantry has motors that lag. From
    flights alone the workflow finds where they disagree, names the effect, writes the corrected rig
    file and shows the gap shrink. A predictor is trained on either rig, and both are flown on the
    gantry that still lags.

    \b
    Example:
        wakedeploy gap demo --out gap-demo
    """
    import shutil

    from wakedeploy.gap.demo import FULL, PICTURE, QUICK, run
    from wakedeploy.gap.folder import at_work

    click.secho("A rig file whose motors follow at once; a gantry whose motors lag.", bold=True)
    with at_work(out), stages() as progress:
        shown = run(out, QUICK if quick else FULL, workers=workers, progress=progress)
    write_json(out / "demo.json", shown.as_json())
    _tell(out, shown)
    if figures is not None and shown.picture:
        figures.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(shown.picture, figures / PICTURE)
    if not shown.ok:
        raise CheckFailed("The demo did not show what it should; its report says what it found.")


def _tell(out: Path, shown: "Story") -> None:
    """The account, the rig file's new lines, the tracking, and where to look."""
    from wakedeploy.gap.demo import effect_lines
    from wakedeploy.gap.report.phrases import place_words
    from wakedeploy.gap.report.summary import account
    from wakedeploy.gap.systems.gantry.folder import read_steps

    steps = read_steps(out / "gap")
    click.secho("\nWhere they disagree", bold=True)
    for place in steps.find.places[:4] if steps.find else ():
        click.echo(f"  {place_words(place)}")
    click.secho("\nWhat is missing", bold=True)
    click.echo(account(steps.summary))
    if steps.add is not None:
        click.secho(f"\nNew in {out / 'gap' / 'rig.toml'}", bold=True)
        click.echo(effect_lines(out / "gap" / "rig.toml"))
    click.echo()
    if shown.tracking:
        _tell_tracking(shown.tracking)
        click.echo(f"Picture: {shown.picture}.")
    click.echo(f"Report: {out / 'gap' / 'report.html'}. The whole demo took {shown.seconds:.0f} s.")


def _tell_tracking(tracking: "FlownAgain") -> None:
    flown = (
        ("PID alone", tracking.pid),
        ("PID and predicted wake force", tracking.feedforward),
    )
    rows = [[label, _millimetres(e.before), _millimetres(e.after)] for label, e in flown]
    print_table(
        f"Altitude error on the gantry that lags, {len(tracking.seeds)} flights that nothing was"
        " fitted to",
        ["", "rig file as it was", "corrected rig file"],
        rows,
    )


def _millimetres(error: "TrackingError") -> str:
    if error.rmse is None:
        return "ended by a failsafe"
    spread = "" if error.low is None else f" ({error.low:.1f} to {error.high:.1f})"
    return f"{error.rmse:.1f} mm{spread}"
