"""`wakedeploy run-gantry`: the 32 Hz loop on the rig, or on the virtual gantry."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import print_table, write_json
from wakedeploy.errors import UnusableInput

if TYPE_CHECKING:
    from runtime.tally import Tally

_FILE = click.Path(dir_okay=False, path_type=Path)
_BAR_WIDTH = 30


@click.command()
@click.option("--package", "package_path", type=_FILE, help="Predictor whose force is fed forward.")
@click.option("--baseline", is_flag=True, help="PID alone, no package.")
@click.option("--rig", "rig_path", type=_FILE, help="Default: the default rig.")
@click.option("--virtual", is_flag=True, help="Fly the virtual gantry.")
@click.option("--firmware", is_flag=True, help="With --virtual: the sketch on a simulated UNO.")
@click.option("--port", help="Serial port of the UNO, such as /dev/ttyACM0.")
@click.option("--range-socket", type=_FILE, help="With --port: range samples from here, not I²C.")
@click.option(
    "--seconds",
    type=click.FloatRange(6, 3600),
    show_default="20",
    help="Of the random plan.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the plan."
)
@click.option("--reference", type=_FILE, help="Fly this CSV instead of a random plan.")
@click.option("--log", "log_path", type=_FILE, help="Record the run here (.mcap).")
@click.option("--plant-rig", type=_FILE, help="What the virtual gantry is in truth.")
@click.option("--hooks", help="MODULE:FUNCTION giving the virtual plant's hooks.")
@click.option("--realtime", is_flag=True, help="SCHED_FIFO, locked memory, one core.")
@click.option("--allow-lead-mismatch", is_flag=True, help="Fly a package made for another lead.")
@click.option("--watch-gap", is_flag=True, help="Warn when the rig file explains it no more.")
@click.option("--json", "json_path", type=_FILE, help="Also write the summary as JSON.")
def command(
    package_path: Path | None,
    baseline: bool,
    rig_path: Path | None,
    virtual: bool,
    port: str | None,
    plant_rig: Path | None,
    log_path: Path | None,
    json_path: Path | None,
    seconds: float | None,
    **options: Any,
) -> None:
    """Fly a random plan at 32 Hz: three seconds at rest, the flight, three seconds at rest.

    A reference file has the columns t_s, z_m, x_m, source_us; it begins and ends at rest.

    Ctrl-C brings the sufferer down; a second one switches the motors off at once.

    \b
    Example:
        wakedeploy run-gantry --package gru.onnx --virtual --seconds 20 --log flight.mcap
        wakedeploy run-gantry --baseline --rig rig.toml --port /dev/ttyACM0
    """
    if (package_path is None) != baseline:
        raise UnusableInput("Say what to fly: either --package FILE or --baseline.")
    if (port is None) != virtual:
        raise UnusableInput("Say where to fly: either --virtual or --port PORT.")
    if port is None and options["range_socket"]:
        raise UnusableInput("--range-socket belongs to --port; --virtual has one of its own.")
    if port is not None and options["firmware"]:
        raise UnusableInput("--firmware belongs to --virtual; the UNO at a port has its own.")
    if port is not None and (plant_rig or options["hooks"]):
        raise UnusableInput("--plant-rig and --hooks belong to --virtual; a real rig is as it is.")
    if seconds is not None and options["reference"]:
        raise UnusableInput("--seconds belongs to the random plan; a --reference has its own time.")
    from runtime.run import RunRequest, fly
    from wakedeploy.rig import default_rig, read_rig

    request = RunRequest(
        rig=read_rig(rig_path) if rig_path else default_rig(),
        package=package_path,
        port=port,
        plant_rig=read_rig(plant_rig) if plant_rig else None,
        log=log_path,
        seconds=20.0 if seconds is None else seconds,
        **options,
    )
    # Another thread at the loop's priority on the loop's core is what --realtime is to prevent.
    is_shown = sys.stderr.isatty() and not request.realtime
    fly(
        request,
        tell=lambda tally: _tell(tally, log_path, json_path),
        show=_show if is_shown else None,
        warn=_warn,
    )


def _show(done_s: float, total_s: float) -> None:
    """One line of a terminal, redrawn in place; a table's library would cost the loop more."""
    filled = round(_BAR_WIDTH * min(1.0, done_s / total_s))
    bar = "=" * filled + " " * (_BAR_WIDTH - filled)
    sys.stderr.write(f"\rFlying [{bar}] {done_s:.0f} of {total_s:.0f} s")
    sys.stderr.flush()


def _warn(sentence: str) -> None:
    clear = "\r\x1b[K" if sys.stderr.isatty() else ""  # the bar is drawn again after it
    sys.stderr.write(f"{clear}{sentence}\n")
    sys.stderr.flush()


def _tell(tally: "Tally", log_path: Path | None, json_path: Path | None) -> None:
    if sys.stderr.isatty():
        click.echo("\r\x1b[K", nl=False, err=True)  # the bar has had its time
    print_table("Run", ["", ""], [[name, shown] for name, shown in _lines(tally)])
    click.echo(f"Recorded in {log_path}." if log_path else "Not recorded; --log FILE does that.")
    if json_path:
        write_json(json_path, summary(tally))


def summary(tally: "Tally") -> dict[str, Any]:
    """The run in numbers, and how it ended."""
    import numpy as np

    trips_ms = 1e3 * np.asarray(tally.round_trips_s)
    p50, p99 = np.percentile(trips_ms, [50, 99]) if trips_ms.size else (None, None)
    return {
        "ended": tally.ended,
        "ticks": tally.ticks,
        "rmse_mm": 1e3 * tally.rmse_m,
        "true_rmse_mm": 1e3 * tally.true_rmse_m,
        "overruns": tally.overruns,
        "round_trip_p50_ms": p50,
        "round_trip_p99_ms": p99,
        "compute_p99_ms": 1e3 * float(np.percentile(tally.totals_s, 99)),
        "compute_max_ms": 1e3 * float(np.max(tally.totals_s)),
        "seconds_in_mode": {mode: tally.seconds_in(mode) for mode in tally.modes},
        "faults": dict(tally.faults),
    } | _gap(tally)


def _gap(tally: "Tally") -> dict[str, Any]:
    """What the watch found; nothing for a run without one."""
    if tally.gap is None:
        return {}
    worst = tally.gap.worst
    return {
        "gap_worst_score": worst if worst == worst else None,
        "gap_left_s": tally.gap.first_left_s,
        "gap": tally.gap.sentence(),
    }


def _lines(tally: "Tally") -> list[tuple[str, str]]:
    told = summary(tally)
    modes = ", ".join(f"{mode} {s:.1f} s" for mode, s in told["seconds_in_mode"].items())
    faults = ", ".join(f"{name} {count}" for name, count in told["faults"].items())
    lines = [
        ("Ended", told["ended"]),
        ("Tracking RMSE (estimate)", f"{told['rmse_mm']:.1f} mm"),
        ("Tracking RMSE (truth)", f"{told['true_rmse_mm']:.1f} mm"),
        ("Overruns", f"{told['overruns']} of {told['ticks']} ticks"),
        ("Round trip p50 / p99", f"{_ms(told, 'p50')} / {_ms(told, 'p99')} ms"),
        ("Computing p99 / max", f"{told['compute_p99_ms']:.2f} / {told['compute_max_ms']:.2f} ms"),
        ("Time in mode", modes),
        ("Faults", faults or "none"),
    ]
    if "gap" in told:
        lines.append(("Rig file", told["gap"]))
    return [line for line in lines if "nan" not in line[1]]


def _ms(told: dict[str, Any], which: str) -> str:
    trip_ms = told[f"round_trip_{which}_ms"]
    return "nan" if trip_ms is None else f"{trip_ms:.1f}"
