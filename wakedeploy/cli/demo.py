"""`wakedeploy demo`: the main job on the virtual gantry, by the commands themselves."""

import json
import shlex
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import json_option, print_table, write_json
from wakedeploy.errors import CheckFailed, UnusableInput

if TYPE_CHECKING:
    from wakedeploy.runlog import RunLog

_SEED = 7  # of the flights; training episodes count from a million


@click.command()
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("demo"),
    show_default=True,
    help="Everything the demo makes lies here.",
)
@click.option("--minutes", type=click.FloatRange(2, 600), default=15.0, show_default=True)
@click.option("--seconds", type=click.FloatRange(8, 600), default=25.0, show_default=True)
@json_option
def command(out: Path, minutes: float, seconds: float, json_path: Path | None) -> None:
    """Do the main job: simulate, train, export, check, fly without and with feedforward.

    Each step is a command of its own, printed before it runs. MINUTES of flight are simulated to
    train on; the two flights at the end take SECONDS of real time each.

    \b
    Example:
        wakedeploy demo --json demo/result.json
    """
    began = time.monotonic()
    data, package = out / "sets" / "gantry", out / "gru.onnx"
    run = out / "runs" / "gantry" / "gru" / "s0"
    fly = ["--virtual", "--seconds", seconds, "--seed", _SEED]
    _step("data", "make", "gantry", "--out", data, "--minutes", minutes, "--seed", 0)
    _step(
        "train",
        "--data",
        data,
        "--arch",
        "gru",
        "--out",
        out / "runs",
        "--epochs",
        _EPOCHS,
        "--fresh",
    )
    _step("export", "--arch", "gru", "--run", run, "--data", data, "--out", package)
    _step("check", package)
    pid, fed = out / "pid.mcap", out / "feedforward.mcap"
    summaries = [out / "pid.json", out / "feedforward.json"]
    for log in (pid, fed):
        log.unlink(missing_ok=True)  # of an earlier demo; a recording is never overwritten
    _step("run-gantry", "--baseline", *fly, "--log", pid, "--json", summaries[0])
    _step("run-gantry", "--package", package, *fly, "--log", fed, "--json", summaries[1])
    result = _compare(*(json.loads(path.read_text(encoding="utf-8")) for path in summaries))
    result |= {"seconds": round(time.monotonic() - began, 1), "picture": str(out / "demo.png")}
    _draw(pid, fed, result, out / "demo.png")
    _tell(result)
    if json_path:
        write_json(json_path, result)
    if not result["ok"]:
        raise CheckFailed("The demo did not show what it should: see the table above.")


_EPOCHS = 40


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


def _compare(pid: dict[str, Any], fed: dict[str, Any]) -> dict[str, Any]:
    """The demo's result: both tracking errors, and the time from measurement to command."""
    from runtime.loop import budget_s
    from wakedeploy.rig import default_rig

    budget_ms = 1e3 * budget_s(default_rig())
    within = fed["compute_max_ms"] < budget_ms
    return {
        "pid_rmse_mm": pid["true_rmse_mm"],
        "feedforward_rmse_mm": fed["true_rmse_mm"],
        "latency": {
            "ticks": fed["ticks"],
            "p99_ms": fed["compute_p99_ms"],
            "max_ms": fed["compute_max_ms"],
            "budget_ms": budget_ms,
            "within_budget": within,
        },
        "overruns": fed["overruns"],
        "ok": within and fed["true_rmse_mm"] < pid["true_rmse_mm"],
    }


def _tell(result: dict[str, Any]) -> None:
    pid_mm, fed_mm, latency = (
        result["pid_rmse_mm"],
        result["feedforward_rmse_mm"],
        result["latency"],
    )
    click.echo()
    print_table(
        "The same flight, without and with the predicted wake force fed forward",
        ["", "altitude RMSE"],
        [
            ["PID alone", f"{pid_mm:.1f} mm"],
            ["PID and GRU feedforward", f"{fed_mm:.1f} mm ({pid_mm / fed_mm:.1f} times better)"],
        ],
    )
    verdict = "within" if latency["within_budget"] else "OVER"
    click.echo(
        f"Latency: from measurement to command p99 {latency['p99_ms']:.2f} ms, at most "
        f"{latency['max_ms']:.2f} ms in {latency['ticks']} ticks: {verdict} the budget of "
        f"{latency['budget_ms']:.2f} ms (preliminary; `wakedeploy bench latency` flies longer)."
    )
    click.echo(f"Picture: {result['picture']}. The whole demo took {result['seconds']:.0f} s.")


def _draw(pid_path: Path, fed_path: Path, result: dict[str, Any], picture: Path) -> None:
    from wakedeploy import figures
    from wakedeploy.runlog import read_run_log

    pid, fed = read_run_log(pid_path), read_run_log(fed_path)
    with figures.style():
        drawn, (height, error, force, latency) = figures.figure(4, size=(9.0, 9.5), sharex=True)
        _draw_heights(height, pid, fed)
        _draw_errors(error, pid, fed, result)
        _draw_force(force, fed)
        _draw_latency(latency, fed, result)
        figures.save(drawn, picture)


def _draw_heights(axes: Any, pid: "RunLog", fed: "RunLog") -> None:
    from wakedeploy import figures

    axes.plot(fed["t_s"], fed["z_ref_m"], color=figures.REFERENCE, ls="--", label="reference")
    axes.plot(pid["t_s"], pid["true_z_m"], color=figures.LIMIT, label="PID alone")
    axes.plot(fed["t_s"], fed["true_z_m"], color=figures.MEASURED, label="with feedforward")
    axes.set(title="Altitude", ylabel="m")
    figures.legend(axes)


def _draw_errors(axes: Any, pid: "RunLog", fed: "RunLog", result: dict[str, Any]) -> None:
    from wakedeploy import figures

    for log, color, name, rmse in (
        (pid, figures.LIMIT, "PID alone", result["pid_rmse_mm"]),
        (fed, figures.MEASURED, "with feedforward", result["feedforward_rmse_mm"]),
    ):
        error_mm = 1e3 * (log["true_z_m"] - log["z_ref_m"])
        axes.plot(log["t_s"], error_mm, color=color, label=f"{name}: {rmse:.1f} mm rms")
    axes.set(title="Altitude error", ylabel="mm")
    figures.legend(axes)


def _draw_force(axes: Any, fed: "RunLog") -> None:
    from wakedeploy import figures

    lead_s = float(fed.metadata.get("lead_s") or 0.0)
    axes.plot(fed["t_s"], fed["true_wake_force_n"], color=figures.TRUE, label="true")
    axes.plot(
        fed["t_s"] + lead_s,
        fed["force_pred_n"],
        color=figures.PREDICTED,
        label=f"predicted {1e3 * lead_s:.0f} ms before",
    )
    axes.set(title="Force of the wake on the sufferer", ylabel="N")
    figures.legend(axes)


def _draw_latency(axes: Any, fed: "RunLog", result: dict[str, Any]) -> None:
    import numpy as np

    from wakedeploy import figures
    from wakedeploy.runlog import STAGES

    total_ms = 1e3 * np.nansum([fed[stage] for stage in STAGES], axis=0)
    budget_ms = result["latency"]["budget_ms"]
    axes.semilogy(fed["t_s"], total_ms, ".", ms=2.5, color=figures.MEASURED, label="each tick")
    axes.axhline(budget_ms, color=figures.PREDICTED, label=f"budget {budget_ms:.2f} ms")
    axes.set(title="From measurement to command", ylabel="ms", xlabel="s")
    figures.legend(axes)
