"""`wakedeploy run-gantry`: the 32 Hz loop on the rig, or on the virtual gantry."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.flight_options import (
    FILE,
    end_progress,
    flight_options,
    flight_request,
    shown_progress,
    warn,
)
from wakedeploy.cli.output import print_table, write_json

if TYPE_CHECKING:
    from runtime.tally import Tally


@click.command()
@flight_options
@click.option(
    "--log",
    "log_path",
    type=click.Path(path_type=Path),
    help="Record the run here (FILE.mcap); a folder gets a file named by its start.",
)
@click.option("--arm-file", type=FILE, help="Stand by, motors off, until this file is made.")
@click.option("--watch-gap", is_flag=True,
              help="Warn when the rig file explains it no more (limits: the default rig's).",
)  # fmt: skip
@click.option("--json", "json_path", type=FILE, help="Also write the summary as JSON.")
def command(log_path: Path | None, json_path: Path | None, **options: Any) -> None:
    """Fly a random plan at 32 Hz: three seconds at rest, the flight, three seconds at rest.

    A reference file has the columns t_s, z_m, x_m, source_us; it begins and ends at rest.

    Ctrl-C brings the sufferer down; a second one switches the motors off at once.

    With --arm-file it watches board and sensor, motors off, until somebody makes that file, which
    it takes away: one file, one flight. deployment/wakedeploy-gantry@.service runs it so.

    \b
    Example:
        wakedeploy run-gantry --package gru.onnx --virtual --seconds 20 --log flight.mcap
        wakedeploy run-gantry --baseline --rig rig.toml --port /dev/ttyACM0
    """
    request = flight_request(log=log_path, **options)
    from runtime.run import fly

    fly(
        request,
        tell=lambda tally: _tell(tally, json_path),
        show=shown_progress(request.realtime),
        warn=warn,
    )


def _tell(tally: "Tally", json_path: Path | None) -> None:
    end_progress()
    print_table("Run", ["", ""], [[name, shown] for name, shown in _lines(tally)])
    click.echo(f"Recorded in {tally.log}." if tally.log else "Not recorded; --log FILE does that.")
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
