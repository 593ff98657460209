"""`wakedeploy log`: look at runs, hand them on to other programs, measure the force in them."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.groups import Group
from wakedeploy.cli.live_options import TOKEN, address_option, tell_address
from wakedeploy.cli.output import Written, json_option, print_table, progress, write_json
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.core.run_summary import RunSummary, Spread
    from wakedeploy.core.runlog import RunLog
    from wakedeploy.domains.gantry_measured import MeasuredSet

_FILES = click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))


@click.group(cls=Group)
def command() -> None:
    """Look at recorded runs.

    \b
    Example:
        wakedeploy log show flight.mcap
    """


@command.command()
@_FILES
@click.option("--png", type=click.Path(path_type=Path), help="The picture; FILE.png by default.")
@click.option("--no-picture", is_flag=True, help="Numbers only.")
@json_option
def show(
    files: tuple[Path, ...], png: Path | None, no_picture: bool, json_path: Path | None
) -> None:
    """Sum up runs, and draw each as a picture beside its file.

    Tracking is scored over the ticks flown under control (RUNNING, DEGRADED). Overruns are ticks
    that took longer than their period or could not begin.

    \b
    Example:
        wakedeploy log show flight.mcap
        wakedeploy log show before.mcap after.mcap --no-picture --json runs.json
    """
    from wakedeploy.core.run_summary import summarise
    from wakedeploy.core.runlog import read_run_log

    if png is not None and len(files) > 1:
        raise UnusableInput("--png names one picture; leave it out for several files.")
    logs = []
    with progress("Reading the logs", len(files)) as bar:
        for path in files:
            logs.append(read_run_log(path))
            bar.advance()
    summaries = [summarise(log) for log in logs]
    _print_summaries(files, summaries)
    for path, summary in zip(files, summaries, strict=True):
        for note in summary.notes:
            click.echo(f"{path}: {note}.")
    if not no_picture:
        for path, log, summary in zip(files, logs, summaries, strict=True):
            click.echo(f"Picture: {_draw(path, log, summary, png)}")
    if json_path:
        rows = [{"file": str(p)} | s.as_json() for p, s in zip(files, summaries, strict=True)]
        write_json(json_path, {"runs": rows})


@command.command("export")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=Written(), help="FILE.csv, .parquet or .mat.")
def export(file: Path, out: Path) -> None:
    """Write a run for other programs: CSV, Parquet or MATLAB's .mat, as the name of OUT ends.

    CSV has the run's metadata beside it: flight.meta.json beside flight.csv.

    \b
    Example:
        wakedeploy log export flight.mcap --out flight.csv
        wakedeploy log export flight.mcap --out flight.parquet
    """
    from wakedeploy.cli.gap_export import export_log

    export_log(file, out)


@command.command("smooth")
@_FILES
@click.option(
    "--rig", "rig_path", type=click.Path(path_type=Path), help="The rig; the default rig if absent."
)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="The episode set.")
@json_option
def smooth_logs(
    files: tuple[Path, ...], rig_path: Path | None, out: Path, json_path: Path | None
) -> None:
    """Measure the wake's force in recorded flights, as an episode set to train on.

    A Kalman filter forward and a Rauch–Tung–Striebel pass backward over the range samples give the
    acceleration; less thrust after spool lag as applied, weight and rail friction, it is the force
    of the wake, with its standard deviation. Acceleration and thrust stay beside it in the
    episodes. Three files or more are split by file, fewer by time.

    \b
    Example:
        wakedeploy log smooth flight*.mcap --rig rig.toml --out sets/measured
        wakedeploy train --data sets/measured --arch gru --out runs
    """
    from wakedeploy.core.files import sha256_of
    from wakedeploy.core.runlog import read_run_log
    from wakedeploy.domains.gantry_measured import measured_set
    from wakedeploy.rig.file import default_rig, read_rig

    rig = read_rig(rig_path) if rig_path else default_rig()
    names = _distinct_names(files)
    logs = {name: read_run_log(path) for name, path in names.items()}
    hashes = {name: sha256_of(path.read_bytes()) for name, path in names.items()}
    with progress("Smoothing", len(logs)) as bar:
        made = measured_set(logs, rig, hashes, bar.update)
    made.episodes.write(out)
    _tell_measured(made, out)
    if json_path:
        write_json(json_path, _measured_json(made))


@command.command("browse")
@click.argument("folder", type=click.Path(path_type=Path))
@address_option("--listen")
@TOKEN
def browse_logs(folder: Path, listen: str, live_token: Path | None) -> None:
    """List the flights of a folder in the browser: filter, sort, draw two over one another.

    It steps through faults, opens the reports that lie beside, and exports a flight as one HTML
    file to send to a colleague. Nothing in the folder is changed. Ctrl-C ends it.

    \b
    Example:
        wakedeploy log browse flights
    """
    from wakedeploy.live.process import require_tornado

    require_tornado()
    from wakedeploy.live.browse import browse

    browse(folder, listen, live_token, tell_address)


def _print_summaries(files: Iterable[Path], summaries: list["RunSummary"]) -> None:
    lines = [_lines(summary) for summary in summaries]
    rows = [[name, *(line[name] for line in lines)] for name in lines[0]]
    kept = [row for row in rows if any(cell != "" for cell in row[1:])]
    print_table("Run", ["", *(path.name for path in files)], kept)


def _lines(summary: "RunSummary") -> dict[str, str]:
    """Every line of the table; what was not recorded is empty."""
    modes = ", ".join(f"{mode} {s:.1f} s" for mode, s in summary.seconds_in_mode.items())
    faults = ", ".join(f"{name} {count}" for name, count in summary.faults.items())
    stages = {_stage(n): _milliseconds(s, 3) for n, s in summary.stages_s.items()}
    return {
        "Ended": summary.ended,
        "Duration": f"{summary.duration_s:.1f} s, {summary.ticks} ticks",
        "Rate": _known(summary.rate_hz, "{:.2f} Hz"),
        "Flown under control": f"{summary.flying_s:.1f} s",
        "Tracking RMSE": _known(1e3 * summary.tracking_rmse_m, "{:.1f} mm"),
        "Tracking worst": _known(1e3 * summary.tracking_max_m, "{:.1f} mm"),
        "Tracking RMSE (truth)": _known(1e3 * summary.true_tracking_rmse_m, "{:.1f} mm"),
        "Overruns": str(summary.overruns),
        "Not recorded": f"{summary.dropped} ticks",
        "Round trip p50/p99/max": _milliseconds(summary.round_trip_s, 2),
        "Computing p50/p99/max": _milliseconds(summary.computing_s, 3),
        **stages,
        "Time in mode": modes,
        "Faults": faults or "none",
        "Failsafe": _failsafe(summary),
        "Range samples missing": str(summary.range_missing),
        "Range samples repeated": str(summary.range_repeated),
    }


def _failsafe(summary: "RunSummary") -> str:
    """When, and what explains it and helps."""
    from wakedeploy.core.failsafes import hints

    if summary.failsafe_s != summary.failsafe_s:
        return ""
    cause = summary.failsafe_cause
    why = hints(is_virtual=summary.is_virtual).get(cause, cause or "no cause recorded")
    return f"at {summary.failsafe_s:.2f} s: {why}"


def _stage(column: str) -> str:
    return f"  {column.removeprefix('t_').removesuffix('_s')}"


def _milliseconds(spread: "Spread", digits: int) -> str:
    if spread.p50 != spread.p50:
        return ""
    p50, p99, most = (f"{1e3 * v:.{digits}f}" for v in (spread.p50, spread.p99, spread.max))
    return f"{p50} / {p99} / {most} ms"


def _known(value: float, form: str) -> str:
    return form.format(value) if value == value else ""


def _draw(path: Path, log: "RunLog", summary: "RunSummary", png: Path | None) -> Path:
    from wakedeploy.core import figures
    from wakedeploy.core.run_figure import draw_run

    target = png or path.with_suffix(".png")
    figures.save(draw_run(log, summary, path.name), target)
    return target


def _distinct_names(files: Iterable[Path]) -> dict[str, Path]:
    """Files by a name for their episodes, in order; the same file twice is refused."""
    from wakedeploy.domains.gantry_measured import episode_name

    names: dict[str, Path] = {}
    for path in files:
        if path.resolve() in [other.resolve() for other in names.values()]:
            raise UnusableInput(f"{path}: is given twice; each flight counts once.")
        name, count = episode_name(path.stem), 2
        while name in names:
            name, count = f"{episode_name(path.stem)}-{count}", count + 1
        names[name] = path
    return names


def _tell_measured(made: "MeasuredSet", out: Path) -> None:
    rows = [
        [
            report.name,
            f"{report.seconds:.1f}",
            f"{1e3 * report.range_offset_m:+.1f}",
            str(report.outliers),
            _known(report.force_rms_n, "{:.3f}"),
            _known(report.force_sd_n, "{:.3f}"),
            report.note,
        ]
        for report in made.reports
    ]
    columns = ["log", "airborne [s]", "range offset [mm]", "outliers", "force rms [N]"]
    print_table("Measured force", [*columns, "its sd [N]", "note"], rows)
    parts = {split: len(made.episodes.part(split)) for split in ("train", "validation", "test")}
    counts = ", ".join(f"{count} {split}" for split, count in parts.items())
    click.echo(f"{out}: {counts} episodes at {made.episodes.rate_hz:g} Hz.")
    click.echo(
        f"Label noise leaves an R² of {made.r2_ceiling:.3f} at most; "
        "a model that reaches it predicts the force as well as it was measured."
    )


def _measured_json(made: "MeasuredSet") -> dict[str, Any]:
    return {
        "rows": [vars(report) for report in made.reports],
        "force_model": vars(made.model),
        "r2_ceiling": made.r2_ceiling,
        "sha256": made.episodes.sha256,
    }
