"""`wakedeploy demo`: the main job on the virtual gantry, by the commands themselves."""

import json
import shlex
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.many_flights import with_error
from wakedeploy.cli.numbers import Within
from wakedeploy.cli.output import json_option, print_table, progress, write_json
from wakedeploy.core.errors import CheckFailed, UnusableInput

if TYPE_CHECKING:
    from wakedeploy.core.runlog import RunLog

MINUTES = 12.0  # of simulated flight to train on, unless asked for others
_SEED = 7  # of the first flight; training episodes count from a million
_EPOCHS = 40
_LATENCY_TICKS = 128  # 4 s: enough to see a busy computer, too few for a verdict


@click.command()
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("demo"),
    show_default=True,
    help="Everything the demo makes lies here.",
)
@click.option("--minutes", type=Within(2, 600), default=MINUTES, show_default=True,
              help="Of simulated flight to train on.")  # fmt: skip
@click.option("--flights", type=click.IntRange(2, 1000), default=6, show_default=True,
              help="To compare on, in simulated time.")  # fmt: skip
@click.option("--seconds", type=Within(8, 600), default=25.0, show_default=True,
              help="Of each flight.")  # fmt: skip
@json_option
def command(
    out: Path, minutes: float, flights: int, seconds: float, json_path: Path | None
) -> None:
    """Do the main job: simulate, train, export, check, fly without and with feedforward.

    Each step is a command of its own, printed before it runs. The flights are in simulated time, so
    that their numbers are the same on a busy computer. The last step measures what this computer
    takes from measurement to command, in real time; that is for your information.

    \b
    Example:
        wakedeploy demo --json demo/result.json
    """
    began = time.monotonic()
    data, package, logs = out / "sets" / "gantry", out / "gru.onnx", out / "flights"
    run = out / "runs" / "gantry" / "gru" / "s0"
    _step("data", "make", "gantry", "--out", data, "--minutes", minutes, "--seed", 0)
    fitted = ["--arch", "gru", "--out", out / "runs", "--epochs", _EPOCHS, "--fresh"]
    _step("train", "--data", data, *fitted)
    _step("export", "--arch", "gru", "--run", run, "--data", data, "--out", package)
    _step("check", package)
    for log in logs.glob("*.mcap"):
        log.unlink()  # of an earlier demo; a recording is never overwritten
    plans = ["--virtual", "--flights", flights, "--seconds", seconds, "--seed", _SEED]
    flown = out / "flights.json"
    _step("run-gantry", "--package", package, *plans, "--log", logs, "--json", flown)
    result = {"minutes": minutes} | _compared(json.loads(flown.read_text(encoding="utf-8")))
    result["latency"] = _latency(package)
    _draw(logs / f"pid-{_SEED:04d}.mcap", logs / f"feedforward-{_SEED:04d}.mcap", out / "demo.png")
    result |= {"picture": str(out / "demo.png"), "seconds": round(time.monotonic() - began, 1)}
    tell(result)
    write_json(json_path, result)
    if not result["ok"]:
        raise CheckFailed(
            "The predictor did not help: see the table above. Simulate more flight to train on, "
            "with --minutes."
        )


def _step(*arguments: object) -> None:
    """Print a command as a person would type it, then run it in a process of its own."""
    words = [str(argument) for argument in arguments]
    click.secho(f"\n$ wakedeploy {shlex.join(words)}", bold=True)
    sys.stdout.flush()
    command = [sys.executable, "-m", "wakedeploy", *words]
    status = subprocess.run(command, check=False).returncode  # noqa: S603
    if status == 130:
        raise KeyboardInterrupt
    if status:
        kind = UnusableInput if status == 2 else CheckFailed
        raise kind(f"The demo stops here: `wakedeploy {words[0]}` failed, as it said above.")


def _compared(flown: dict[str, Any]) -> dict[str, Any]:
    """Both tracking errors, and whether the gain is beyond its own uncertainty."""
    gain = flown["gain_mm"]
    return {
        "rmse_mm": flown["rmse_mm"],
        "gain_mm": gain,
        "ok": gain["mean"] > 2.0 * gain["standard_error"],
    }


def _latency(package: Path) -> dict[str, Any]:
    """What this computer takes from measurement to command; it may be too busy to say."""
    from runtime.bench import bench_latency, budget_ms
    from wakedeploy.rig.file import default_rig

    budget = budget_ms(default_rig())
    click.secho(f"\n$ wakedeploy bench latency {package} --ticks {_LATENCY_TICKS}", bold=True)
    with progress("Flying in real time", _LATENCY_TICKS) as bar:
        try:
            (row,) = bench_latency([package], ticks=_LATENCY_TICKS, progress=bar.update)
        except CheckFailed as error:
            return {"budget_ms": budget, "within_budget": False, "failed": str(error)}
    return {
        "budget_ms": budget,
        "ticks": row.ticks,
        "p99_ms": row.p99_ms,
        "max_ms": row.max_ms,
        "realtime": row.realtime,
        "within_budget": row.within(budget),
    }


def tell(result: dict[str, Any]) -> None:
    """Print what the demo ends with: both errors, the latency, and where the picture is."""
    pid, fed = result["rmse_mm"]["pid"], result["rmse_mm"]["feedforward"]
    click.echo()
    print_table(
        f"{pid['flights']} flights without and with the predicted wake force fed forward",
        ["", "altitude RMSE [mm]", ""],
        [
            ["PID alone", with_error(pid), ""],
            ["PID and GRU feedforward", with_error(fed),
             f"{pid['mean'] / fed['mean']:.1f} times better"],
        ],
    )  # fmt: skip
    click.echo(_latency_sentence(result["latency"]))
    click.echo(f"Picture: {result['picture']}. The whole demo took {result['seconds']:.0f} s.")


def _latency_sentence(latency: dict[str, Any]) -> str:
    """In the budget, or that the computer was busy, which says nothing against the predictor."""
    later = "run `wakedeploy bench latency` when it is quiet"
    if "failed" in latency:
        return f"Latency: not measured: {latency['failed'].rstrip('.')}; {later}."
    figures = (
        f"p99 {latency['p99_ms']:.2f} ms, at most {latency['max_ms']:.2f} ms in "
        f"{latency['ticks']} ticks"
    )
    budget = f"the budget of {latency['budget_ms']:.2f} ms"
    if latency["within_budget"]:
        return f"Latency, from measurement to command: {figures}, within {budget}."
    return f"Latency: this computer was busy: {figures}, over {budget}; {later}."


def _draw(pid_path: Path, fed_path: Path, picture: Path) -> None:
    from wakedeploy.core import figures
    from wakedeploy.core.runlog import read_run_log

    pid, fed = read_run_log(pid_path), read_run_log(fed_path)
    with figures.style():
        drawn, (height, error, force) = figures.figure(3, size=(9.0, 7.5), sharex=True)
        _draw_heights(height, pid, fed)
        _draw_errors(error, pid, fed)
        _draw_force(force, fed)
        figures.save(drawn, picture)


def _draw_heights(axes: Any, pid: "RunLog", fed: "RunLog") -> None:
    from wakedeploy.core import figures

    axes.plot(fed["t_s"], fed["z_ref_m"], color=figures.REFERENCE, ls="--", label="reference")
    axes.plot(pid["t_s"], pid["true_z_m"], color=figures.LIMIT, label="PID alone")
    axes.plot(fed["t_s"], fed["true_z_m"], color=figures.MEASURED, label="with feedforward")
    axes.set(title="Altitude", ylabel="m")
    figures.legend(axes)


def _draw_errors(axes: Any, pid: "RunLog", fed: "RunLog") -> None:
    from wakedeploy.core import figures

    for log, color, name in (
        (pid, figures.LIMIT, "PID alone"),
        (fed, figures.MEASURED, "with feedforward"),
    ):
        rmse = 1e3 * log.tracking_rmse_m("true_z_m")
        error_mm = 1e3 * (log["true_z_m"] - log["z_ref_m"])
        axes.plot(log["t_s"], error_mm, color=color, label=f"{name}: {rmse:.1f} mm rms")
    axes.set(title="Altitude error", ylabel="mm")
    figures.legend(axes)


def _draw_force(axes: Any, fed: "RunLog") -> None:
    from wakedeploy.core import figures

    lead_s = float(fed.metadata.get("lead_s") or 0.0)
    axes.plot(fed["t_s"], fed["true_wake_force_n"], color=figures.TRUE, label="true")
    axes.plot(
        fed["t_s"] + lead_s,
        fed["force_pred_n"],
        color=figures.PREDICTED,
        label=f"predicted {1e3 * lead_s:.0f} ms before",
    )
    axes.set(title="Force of the wake on the sufferer", ylabel="N", xlabel="s")
    figures.legend(axes)
