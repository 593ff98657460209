"""`wakedeploy fly-pair`: one reference flown twice, without the wake and with it."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.flight_options import (
    end_progress,
    flight_options,
    flight_request,
    shown_progress,
    warn,
)
from wakedeploy.cli.output import Written, answered_by_hand, print_table, write_json
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from runtime.loop.tally import Tally
    from runtime.pair import Leg, Pair
    from runtime.pair_wake import PairWake
    from runtime.request import Tell

_FOLDER = click.Path(file_okay=False, path_type=Path)


@click.command()
@flight_options
@click.option("--out", type=_FOLDER, required=True, help="Folder for the recordings.")
@click.option(
    "--pairs",
    type=click.IntRange(1, 50),
    default=1,
    show_default=True,
    help="Of the same reference, numbered.",
)
@click.option("--yes", is_flag=True, help="With --port: do not ask between the flights.")
@click.option("--json", "json_path", type=Written(), help="Also write the comparison as JSON.")
def command(
    out: Path, pairs: int, yes: bool, json_path: Path | None, baseline: bool, **options: Any
) -> None:
    """Fly one reference twice, with the wake source idle and with it running, and compare.

    The recordings are OUT/wake-off.mcap and OUT/wake-on.mcap. What the source does to the sufferer
    is the measured force of the one less that of the other: what both flights have, an imperfect
    thrust curve or the cables' pull, is not in it. Without --package PID flies alone. With --pairs
    the order changes from pair to pair, so that a battery that drains does not look like a wake,
    and the error of the mean comes from the spread between pairs, too.

    At a real rig you are asked before each flight but the first. Ctrl-C brings the sufferer down
    and ends the series.

    \b
    Example:
        wakedeploy fly-pair --virtual --seconds 20 --out pair
        wakedeploy fly-pair --rig rig.toml --port /dev/ttyACM0 --pairs 3 --out pairs
    """
    if baseline and options["package"]:
        raise UnusableInput("Say what to fly: either --package FILE or --baseline.")
    if yes and options["port"] is None:
        raise UnusableInput("--yes belongs to --port; the virtual gantry asks nothing.")
    request = flight_request(baseline=options["package"] is None, **options)
    from runtime.pair import fly_pairs
    from runtime.pair_wake import compare
    from wakedeploy.core.runlog import read_run_log

    flown = fly_pairs(
        request,
        out,
        pairs,
        ask=None if yes or request.port is None else _ask,
        tell=_tell_of,
        show=shown_progress(),
        warn=warn,
    )
    logs = [(read_run_log(pair.off), read_run_log(pair.on)) for pair in flown]
    wakes = compare(logs, request.rig)
    _tell_wakes(flown, wakes)
    write_json(json_path, _as_json(flown, wakes))


def _ask(question: str) -> bool:
    try:
        with answered_by_hand("give the command at a terminal, or --yes where the rig stays clear"):
            return click.confirm(question, default=False, err=True)
    except click.Abort:
        click.echo(err=True)
        raise KeyboardInterrupt from None


def _tell_of(leg: "Leg") -> "Tell":
    def tell(tally: "Tally") -> None:
        end_progress()
        ended = tally.ended if tally.ended == "whole" else f"ended early ({tally.ended})"
        click.echo(
            f"{leg.log}: {ended}, tracking RMSE {1e3 * tally.rmse_m:.1f} mm{_overruns(tally)}."
        )

    return tell


def _overruns(tally: "Tally") -> str:
    """How many ticks were late; in simulated time none can be."""
    return f", {tally.overruns} overruns in {tally.ticks} ticks" if tally.totals_s.size else ""


def _tell_wakes(flown: Sequence["Pair"], wakes: Sequence["PairWake"]) -> None:
    rows = [
        [
            str(number),
            f"{pair.first} first",
            f"{1e3 * wake.rmse_off_m:.1f}",
            f"{1e3 * wake.rmse_on_m:.1f}",
            _with_error(wake.mean_n, wake.mean_sd_n),
            f"{wake.mean_abs_n:.3f} ({wake.noise_abs_n:.3f})" if wake.is_measured else "",
            f"{wake.max_abs_n:.3f} ± {wake.max_abs_sd_n:.3f}" if wake.is_measured else "",
            f"{wake.thrust_n:+.3f}" if wake.is_measured else "",
        ]
        for number, (pair, wake) in enumerate(zip(flown, wakes, strict=True), 1)
    ]
    columns = ["pair", "order", "RMSE off [mm]", "RMSE on [mm]", "mean [N]"]
    more = ["mean size (of errors alone) [N]", "largest [N]", "thrust [N]"]
    print_table("Wake: the flight with it less the flight without", [*columns, *more], rows)
    click.echo(_sentence(wakes))


def _sentence(wakes: Sequence["PairWake"]) -> str:
    from runtime.pair_wake import combined

    mean_n, sd_n = combined(wakes)
    if mean_n != mean_n:
        return "Too little was in the air in both flights to measure a force; fly longer or higher."
    found = "a wake" if abs(mean_n) > 2.0 * sd_n else "no wake that can be told from errors"
    how = "the wider of each pair's own error and the spread between pairs"
    if len(wakes) == 1:
        how = "range noise, friction and turbulence; --pairs 3 also shows what changes meanwhile"
    return f"Mean force: {_with_error(mean_n, sd_n)} N, {found} (error: {how})."


def _with_error(value: float, sd: float) -> str:
    return "" if value != value else f"{value:+.3f} ± {sd:.3f}"


def _as_json(flown: Sequence["Pair"], wakes: Sequence["PairWake"]) -> dict[str, Any]:
    from runtime.pair_wake import combined

    mean_n, sd_n = combined(wakes)
    rows = [
        {"pair_id": pair.pair_id, "off": str(pair.off), "on": str(pair.on), "first": pair.first}
        | wake.as_json()
        for pair, wake in zip(flown, wakes, strict=True)
    ]
    return {"mean_n": mean_n, "mean_sd_n": sd_n, "pairs": rows}
