"""`wakedeploy bench`: what the loop costs on this machine."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.groups import Group
from wakedeploy.cli.numbers import Within
from wakedeploy.cli.output import Written, json_option, print_table, progress, write_json
from wakedeploy.core.errors import CheckFailed

if TYPE_CHECKING:
    from runtime.bench import BenchRow

_FILE = click.Path(dir_okay=False, path_type=Path)


@click.group(cls=Group)
def command() -> None:
    """Measure this machine against the loop's budget.

    \b
    Example:
        wakedeploy bench latency gru.onnx
    """


@command.command()
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option("--ticks", type=click.IntRange(64), default=3200, show_default=True, help="A row.")
@click.option("--realtime/--no-realtime", default=None,
              help="SCHED_FIFO, locked memory, one core. Default: where permitted.")  # fmt: skip
@click.option("--busy", is_flag=True, help="Keep the other cores at work meanwhile.")
@click.option("--rig", "rig_path", type=_FILE, help="Default: the default rig.")
@click.option(
    "--report", type=Written(".html"), help="Also write the result as a page (FILE.html)."
)
@json_option
def latency(
    files: Sequence[Path],
    ticks: int,
    realtime: bool | None,
    busy: bool,
    rig_path: Path | None,
    report: Path | None,
    json_path: Path | None,
) -> None:
    """Time the loop with each of FILES, paced at 32 Hz, from measurement to command written.

    The virtual gantry sits at the other end of the port. Without FILES: all eight architectures at
    their reference shapes, untrained, which needs wakedeploy[train]. Exit status 1 when p99.9
    misses the budget; below 3,000 ticks the maximum is judged and the verdict is preliminary.

    \b
    Example:
        wakedeploy bench latency gru.onnx --busy --report latency.html
    """
    from runtime.bench import bench_latency, budget_ms
    from wakedeploy.rig.file import default_rig, read_rig

    rig = read_rig(rig_path) if rig_path else default_rig()
    with tempfile.TemporaryDirectory() as folder:
        packages = files or _reference_packages(Path(folder))
        with progress("Flying at 32 Hz", len(packages) * ticks) as bar:
            rows = bench_latency(
                packages, ticks=ticks, realtime=realtime, busy=busy, rig=rig, progress=bar.update
            )
    budget = budget_ms(rig)
    _tell(rows, budget)
    priority = "with" if all(row.realtime for row in rows) else "without"
    click.echo(f"Measured {priority} real-time priority.")
    if report:
        from wakedeploy.cli.bench_page import write_bench_page

        write_bench_page(report, rows, budget, files)
        click.echo(f"Report: {report}.")
    write_json(json_path, as_json(rows, budget))
    _judge(rows, budget)


def as_json(rows: "Sequence[BenchRow]", budget_ms: float) -> dict[str, Any]:
    """The result for other programs."""
    names = ("arch", "p50_ms", "p99_ms", "p999_ms", "max_ms", "cpu_percent", "rss_mb")
    listed = [
        {name: getattr(row, name) for name in (*names, "first_call_ms", "realtime")}
        | {"within_budget": row.within(budget_ms)}
        for row in rows
    ]
    return {"budget_ms": budget_ms, "rows": listed}


def _reference_packages(folder: Path) -> list[Path]:
    from export.reference import write_reference_packages
    from trainers.build import ARCHITECTURES

    with progress("Exporting the architectures", len(ARCHITECTURES)) as bar:
        return write_reference_packages(folder, bar.update)


def _tell(rows: "Sequence[BenchRow]", budget_ms: float) -> None:
    columns = [
        "",
        "ticks",
        "p50",
        "p99",
        "p99.9",
        "max",
        "CPU %",
        "RSS MB",
        "first call",
        "overruns",
    ]
    totals = [
        [
            row.arch,
            str(row.ticks),
            f"{row.p50_ms:.2f}",
            f"{row.p99_ms:.2f}",
            "-" if row.is_preliminary else f"{row.p999_ms:.2f}",
            f"{row.max_ms:.2f}",
            f"{row.cpu_percent:.1f}",
            f"{row.rss_mb:.0f}",
            f"{row.first_call_ms:.1f}",
            str(row.overruns),
        ]
        for row in rows
    ]
    print_table(
        f"Measurement received → command written, ms (budget {budget_ms:.2f})", columns, totals
    )
    stages = [_stage_row(row, stage) for row in rows for stage in row.stages_ms]
    print_table("Stage by stage, ms", ["", "stage", "p50", "p99", "p99.9", "max"], stages)


def _stage_row(row: "BenchRow", stage: str) -> list[str]:
    spread = row.stages_ms[stage]
    name = stage.removeprefix("t_").removesuffix("_s")
    p999 = "-" if row.is_preliminary else f"{spread['p999']:.3f}"
    return [
        row.arch,
        name,
        f"{spread['p50']:.3f}",
        f"{spread['p99']:.3f}",
        p999,
        f"{spread['max']:.3f}",
    ]


def _judge(rows: "Sequence[BenchRow]", budget_ms: float) -> None:
    """Say the verdict; CheckFailed names what missed the budget."""
    word = "Preliminary verdict" if any(row.is_preliminary for row in rows) else "Verdict"
    measure = "maximum" if any(row.is_preliminary for row in rows) else "p99.9"
    missed = [row.arch for row in rows if not row.within(budget_ms)]
    if missed:
        raise CheckFailed(
            f"{word}: {', '.join(missed)} missed the budget of {budget_ms:.2f} ms ({measure}); end "
            "what else runs on this computer, and see `wakedeploy doctor`."
        )
    click.echo(f"{word}: within the budget of {budget_ms:.2f} ms ({measure}).")


@command.command()
@click.option("--rig", "rig_path", type=_FILE, help="Default: the default rig.")
@click.option("--most", "most_s", type=Within(0.01, 1), default=0.15, show_default=True)
@click.option("--step", "step_s", type=Within(0.001, 0.5), default=0.015, help="Seconds.")
@click.option("--flights", type=click.IntRange(1, 1000), default=6, show_default=True)
@click.option("--seconds", type=Within(8, 600), default=20.0, show_default=True)
@json_option
def lead(
    rig_path: Path | None,
    most_s: float,
    step_s: float,
    flights: int,
    seconds: float,
    json_path: Path | None,
) -> None:
    """Find the lead that suits a rig: simulated flights with the true force fed forward.

    The best lead is what `train --lead` should be given when it is not near the rig's default,
    round trip plus mean spool lag.

    \b
    Example:
        wakedeploy bench lead --rig rig.toml
    """
    import numpy as np

    from wakedeploy.domains.gantry_lead import best, sweep
    from wakedeploy.physics.effects.chain import default_lead_s
    from wakedeploy.rig.file import default_rig, read_rig

    rig = read_rig(rig_path) if rig_path else default_rig()
    leads_s = sorted({*np.arange(0.0, most_s + 1e-9, step_s).round(4), default_lead_s(rig)})
    with progress("Flying", len(leads_s) * flights) as bar:
        scores = sweep(rig, leads_s, flights=flights, seconds=seconds, progress=bar.update)
    found = best(scores)
    marks = {default_lead_s(rig): "default", found.lead_s: "best"}
    if found.lead_s == default_lead_s(rig):
        marks[found.lead_s] = "default, best"
    rows = [
        [f"{1e3 * s.lead_s:.0f} ms", f"{1e3 * s.rmse_m:.2f} mm", marks.get(s.lead_s, "")]
        for s in scores
    ]
    print_table("True force fed forward, by lead", ["lead", "altitude RMSE", ""], rows)
    if json_path:
        listed = [{"lead_s": s.lead_s, "rmse_mm": 1e3 * s.rmse_m} for s in scores]
        write_json(
            json_path, {"default_s": default_lead_s(rig), "best_s": found.lead_s, "rows": listed}
        )
