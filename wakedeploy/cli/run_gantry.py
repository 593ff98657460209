"""`wakedeploy run-gantry`: the 32 Hz loop on the rig, or on the virtual gantry."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.flight_options import (
    FILE,
    asked_flight,
    end_progress,
    flight_options,
    shown_progress,
    warn,
)
from wakedeploy.cli.live_options import (
    TOKEN,
    foxglove_option,
    live_option,
    tell_address,
    tell_foxglove,
)
from wakedeploy.cli.many_flights import fly_and_tell
from wakedeploy.cli.output import Written, print_table, write_json
from wakedeploy.cli.workers import workers_option
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from collections.abc import Iterator

    from runtime.io.live_feed import LiveFeed
    from runtime.loop.tally import Tally
    from runtime.request import Show
    from wakedeploy.gap.progress import Progress


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
@live_option()
@TOKEN
@foxglove_option()
@click.option(
    "--flights",
    type=click.IntRange(2, 10_000),
    help="So many, of seeds from --seed on, PID beside the package; --log is a folder then.",
)
@workers_option("Processes for --flights.")
@click.option("--json", "json_path", type=Written(), help="Also write the summary as JSON.")
def command(
    log_path: Path | None,
    flights: int | None,
    workers: int,
    json_path: Path | None,
    live: str | None,
    live_token: Path | None,
    foxglove: str | None,
    **options: Any,
) -> None:
    """Fly a random plan at 32 Hz: three seconds at rest, the flight, three seconds at rest.

    The virtual gantry flies in simulated time: loop, board and plant in lockstep, much faster than
    real time. On computers of one architecture the same flight has the same digits. --wall-clock
    flies it in real time, over a pseudo-terminal: latency is measured, and the rig is rehearsed.

    A reference file has the columns t_s, z_m, x_m, source_us; it begins and ends at rest.

    Ctrl-C brings the sufferer down; a second one switches the motors off at once.

    With --arm-file it watches board and sensor, motors off, until somebody makes that file, which
    it takes away: one file, one flight. deployment/wakedeploy-gantry@.service runs it so.

    --live serves a page that shows the flight, from a process of its own. STOP on it is Ctrl-C
    here; neither is the emergency stop. --foxglove serves the same to Foxglove, to look at and
    nothing more. With either, a virtual flight is flown in real time.

    \b
    Example:
        wakedeploy run-gantry --package gru.onnx --virtual --seconds 20 --log flight.mcap
        wakedeploy run-gantry --package gru.onnx --virtual --flights 24
        wakedeploy run-gantry --baseline --rig rig.toml --port /dev/ttyACM0
    """
    _require_one_flight(live, live_token, foxglove, flights)
    options["wall_clock"] |= (live or foxglove) is not None and options["virtual"]
    asked = asked_flight(log=log_path, **options)
    if flights is not None:
        fly_and_tell(asked, flights, workers, json_path)
        return
    from runtime.loop.loop import budget_s
    from wakedeploy.api.flights import fly
    from wakedeploy.api.inputs import rig_of

    budget_ms = 1e3 * budget_s(rig_of(asked["rig"]))
    with _viewed(live, live_token, foxglove) as feed:
        fly(
            **asked,
            record=log_path is not None,
            tell=lambda tally: _tell(tally, budget_ms, json_path),
            progress=_shown(shown_progress()),
            warn=warn,
            live=feed,
        )


def _require_one_flight(
    live: str | None, token: Path | None, foxglove: str | None, flights: int | None
) -> None:
    if token is not None and live is None:
        raise UnusableInput("--live-token belongs to --live.")
    for option, asked in (("--live", live), ("--foxglove", foxglove)):
        if flights is not None and asked is not None:
            raise UnusableInput(f"{option} shows a single flight; leave --flights out.")


@contextlib.contextmanager
def _viewed(
    live: str | None, token: Path | None, foxglove: str | None
) -> "Iterator[LiveFeed | None]":
    """What was asked to show the flight, while the block flies."""
    if live is None and foxglove is None:
        yield None
        return
    from wakedeploy.live.process import live_views

    with live_views(live, foxglove, token) as served:
        if served.url is not None:
            tell_address(served.url)
        if served.foxglove is not None:
            tell_foxglove(served.foxglove)
        yield served.feed


def _shown(show: "Show | None") -> "Progress":
    """How far the flight is, for who sees it; the loop has no thread for it where nobody does."""
    from wakedeploy.gap.progress import quiet

    return quiet if show is None else lambda stage, done=0, total=0: show(done, total)


def _tell(tally: "Tally", budget_ms: float, json_path: Path | None) -> None:
    end_progress()
    result = summary(tally, budget_ms)
    print_table("Run", ["", ""], [[name, shown] for name, shown in _lines(result)])
    click.echo(f"Recorded in {tally.log}." if tally.log else "Not recorded; --log FILE does that.")
    write_json(json_path, result)


def summary(tally: "Tally", budget_ms: float) -> dict[str, Any]:
    """The run in numbers, and how it ended; `compute_*` and `budget_*` where time was real."""
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
        **_computing(tally, budget_ms),
        "seconds_in_mode": {mode: tally.seconds_in(mode) for mode in tally.modes},
        "faults": dict(tally.faults),
    } | _gap(tally)


def _computing(tally: "Tally", budget_ms: float) -> dict[str, Any]:
    """From measurement to command against the budget, and when the computer stood still."""
    import numpy as np

    totals_ms = 1e3 * tally.totals_s
    if not totals_ms.size:
        return {"clock": "simulated"}
    pause, gantry = tally.pause, tally.gantry_pause
    return {
        "clock": "real",
        "budget_ms": budget_ms,
        "over_budget": int(np.sum(totals_ms > budget_ms)),
        "compute_p99_ms": float(np.percentile(totals_ms, 99)),
        "compute_max_ms": float(np.max(totals_ms)),
        "stood_still_ms": 1e3 * pause.length_s if pause else 0.0,
        "stood_still_at_s": pause.at_s if pause else None,
        "gantry_stood_still_ms": 1e3 * gantry.length_s if gantry else 0.0,
        "gantry_stood_still_at_s": gantry.at_s if gantry else None,
    }


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


def _lines(result: dict[str, Any]) -> list[tuple[str, str]]:
    modes = ", ".join(f"{mode} {s:.1f} s" for mode, s in result["seconds_in_mode"].items())
    faults = ", ".join(f"{name} {count}" for name, count in result["faults"].items())
    lines = [
        ("Ended", result["ended"]),
        ("Tracking RMSE (estimate)", f"{result['rmse_mm']:.1f} mm"),
        ("Tracking RMSE (truth)", f"{result['true_rmse_mm']:.1f} mm"),
        ("Round trip p50 / p99", f"{_ms(result, 'p50')} / {_ms(result, 'p99')} ms"),
        *_timing_lines(result),
        ("Time in mode", modes),
        ("Faults", faults or "none"),
    ]
    if "gap" in result:
        lines.append(("Rig file", result["gap"]))
    return [line for line in lines if "nan" not in line[1]]


def _timing_lines(result: dict[str, Any]) -> list[tuple[str, str]]:
    """What the computer took; in simulated time that is nothing."""
    if result["clock"] == "simulated":
        return [("Clock", "simulated; --wall-clock flies in real time")]
    over, ticks, budget_ms = result["over_budget"], result["ticks"], result["budget_ms"]
    verdict = f"{over} of {ticks} ticks over" if over else "every tick within"
    lines = [
        ("Overruns", f"{result['overruns']} of {ticks} ticks"),
        (
            "Computing p99 / max",
            f"{result['compute_p99_ms']:.2f} / {result['compute_max_ms']:.2f} ms",
        ),
        ("Budget", f"{verdict} {budget_ms:.2f} ms"),
    ]
    for who, key in (
        ("This computer", "stood_still"),
        ("The virtual gantry", "gantry_stood_still"),
    ):
        if (at_s := result[f"{key}_at_s"]) is not None:
            stood = f"for {result[f'{key}_ms']:.0f} ms at {at_s:.1f} s"
            lines.append((f"{who} stood still", stood))
    return lines


def _ms(result: dict[str, Any], which: str) -> str:
    trip_ms = result[f"round_trip_{which}_ms"]
    return "nan" if trip_ms is None else f"{trip_ms:.1f}"
