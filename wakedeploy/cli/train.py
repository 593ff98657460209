"""`wakedeploy train`: fit one, several or all architectures on an episode set."""

import contextlib
import datetime
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.names import PRESET
from wakedeploy.cli.numbers import Within
from wakedeploy.cli.output import (
    json_option,
    mean_and_spread,
    print_table,
    stage_bars,
    warn,
    what_differs,
    write_json,
)
from wakedeploy.cli.training_options import architectures_option, device_option, lead_option
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.names import architectures, meant

if TYPE_CHECKING:
    from trainers.trained_run import TrainedRun
    from trainers.training.score import Score
    from wakedeploy.api.scores import ScoreRow
    from wakedeploy.core.manifest import Quantity

# Of a run's folder, as trainers.training.runs has them, whose import takes seconds after Ctrl-C.
_KEPT = ("last.safetensors", "metrics.json")


@click.command()
@click.option("--data", type=click.Path(path_type=Path), required=True, help="An episode set.")
@architectures_option(None, otherwise="all, or the one of the --preset")
@click.option("--seeds", type=click.IntRange(1, 1000), default=1, show_default=True)
@lead_option
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default="runs", show_default=True
)
@click.option(
    "--epochs", type=click.IntRange(1, 100_000), help="Default: 60, or those of the --preset."
)
@click.option("--learning-rate", type=Within(1e-7, 1), help="Peak. Default: 0.003, Mamba 0.01.")
@click.option(
    "--hyper",
    "hyper",
    multiple=True,
    metavar="ARCH.NAME=VALUE",
    help="Change a hyper-parameter from its reference value; may be repeated.",
)
@click.option(
    "--preset",
    type=PRESET,
    default="reference",
    show_default=True,
    metavar="reference|tuned|FILE",
    help="The paper's shapes, those tuned for the set's domain, or what `tune` found: shape,"
    " learning rate, batch and its --epochs.",
)
@click.option(
    "--threads",
    type=click.IntRange(1, 256),
    default=1,
    show_default=True,
    help="CPU threads; models this small rarely gain from a second, and lose on a busy machine.",
)
@device_option
@click.option("--fresh", is_flag=True, help="Replace runs that lie in --out already.")
@click.option(
    "--tracker",
    type=click.Choice(["tensorboard", "mlflow"], case_sensitive=False),
    help="Also tell it losses, learning rate, settings, scores and pictures. TensorBoard's events"
    " lie with the runs; MLflow's store is MLFLOW_TRACKING_URI, else mlflow.db in --out.",
)
@click.option("--no-pictures", is_flag=True, help="Numbers only: no report either.")
@json_option
def command(
    data: Path,
    arch: tuple[str, ...] | None,
    seeds: int,
    lead_s: float | None,
    out: Path,
    epochs: int | None,
    learning_rate: float | None,
    hyper: tuple[str, ...],
    preset: str,
    threads: int,
    device: str,
    fresh: bool,
    tracker: str | None,
    no_pictures: bool,
    json_path: Path | None,
) -> None:
    """Train predictors and print their errors on the test episodes.

    Goes on where it was stopped; a run that is finished with the same data and settings is not
    trained again. The table begins with what a predictor has to beat: zero, the mean force of the
    training episodes, and linear regressions on one tick and on the set's window. R² is pooled over
    the split; the spread over seeds follows ±. Each run's folder holds report.html, which says how
    well it predicts and what to do next, and two pictures: curves.png, its errors over the epochs
    (of a solved readout, over the strengths of its ridge), and prediction.png, the liveliest test
    episode as it was and predicted.

    \b
    Example:
        wakedeploy train --data sets/gantry --arch all --seeds 3 --lead 0.09 --json table.json
        wakedeploy train --data sets/fish --arch gru,delay-embedding \\
            --hyper delay-embedding.initial_delay_s=0.333
        wakedeploy train --data sets/gantry --preset tuned/gru/best.toml
    """
    from wakedeploy.api.training import train

    began = datetime.datetime.now(datetime.UTC)
    names = arch or _archs_of(preset)
    with stage_bars() as bars, _saying_what_is_kept(out, names, fresh=fresh):
        runs = train(
            data,
            names,
            seeds=seeds,
            lead_s=lead_s,
            out=out,
            epochs=epochs,
            learning_rate=learning_rate,
            hyper=_hyper(hyper, names),
            preset=preset,
            threads=threads,
            device=device,
            fresh=fresh,
            tracker=tracker,
            pictures=not no_pictures,
            progress=bars,
            warn=warn,
        )
    _say_what_was_finished(runs, began)
    rows, lead_s = runs.scores.rows, runs[0].config.lead_s
    baselines = runs.scores.baselines[lead_s]
    samples = baselines["zero"].samples
    title = f"{data}: test episodes ({samples:,} samples), force {lead_s:g} s ahead; runs in {out}"
    print_scores(title, rows, runs[0].config.force, baselines)
    if not no_pictures:
        where = runs[0].folder if len(runs) == 1 else "the folder of each run"
        click.echo(f"Report: report.html in {where}, with curves.png and prediction.png beside it.")
    if json_path:
        how = {"preset": preset, "lead_s": lead_s, "data_sha256": runs[0].config.data_sha256}
        lines = {"rows": [row.as_json() for row in rows]}
        write_json(json_path, how | lines | {"baselines": baseline_rows(baselines, lead_s)})


@contextlib.contextmanager
def _saying_what_is_kept(out: Path, names: Sequence[str], *, fresh: bool) -> Iterator[None]:
    """After Ctrl-C: whether the same command goes on or begins anew."""
    try:
        yield
    except KeyboardInterrupt:
        click.echo(f"\n{_what_is_kept(out, names, fresh=fresh)}", err=True)
        raise


def _what_is_kept(out: Path, names: Sequence[str], *, fresh: bool) -> str:
    kept = [path for name in _KEPT for path in out.rglob(name) if path.parent.parent.name in names]
    if not kept:
        return "No epoch is finished: the same command begins anew."
    if fresh:
        return f"Finished epochs are kept in {out}: the same command goes on without --fresh."
    return f"Finished epochs are kept in {out}: the same command goes on from there."


def _say_what_was_finished(runs: "Sequence[TrainedRun]", began: datetime.datetime) -> None:
    """Say how many of the runs were finished before this command began."""
    ends = [datetime.datetime.fromisoformat(run.metrics.finished_utc) for run in runs]
    before = sum(end < began for end in ends)
    if not before:
        return
    if before == len(runs):
        which = (
            "Nothing was trained: the run was" if before == 1 else "Nothing was trained: all were"
        )
    else:
        which = f"{before} of {len(runs)} runs were"
    warn(f"{which} finished already, with these data and settings; --fresh trains again.")


def _archs_of(preset: str) -> tuple[str, ...]:
    """The architecture of a preset's file; all of them where none is given."""
    from trainers.preset import REFERENCE, TUNED, read_preset

    return architectures() if preset in (REFERENCE, TUNED) else (read_preset(Path(preset)).arch,)


def _hyper(asked: Iterable[str], names: Sequence[str]) -> dict[str, Any]:
    """The values that are asked for, by ARCH.NAME."""
    changed: dict[str, Any] = {}
    for entry in asked:
        place, equals, text = entry.partition("=")
        given, dot, _ = place.partition(".")
        if not equals or not dot or meant(given, names) is None:
            raise UnusableInput(
                f"--hyper {entry}: write ARCH.NAME=VALUE for one of {', '.join(names)}."
            )
        try:
            changed[place] = json.loads(text)
        except json.JSONDecodeError as error:
            raise UnusableInput(f"--hyper {entry}: '{text}' is not a number.") from error
    return changed


def print_scores(
    title: str,
    rows: "Sequence[ScoreRow]",
    force: "Sequence[Quantity]",
    baselines: "Mapping[str, Score]",
) -> None:
    """The baselines, then each configuration, mean ± spread over its seeds."""
    columns = ["architecture", "trainable", "frozen"]
    ceiling = baselines["zero"].ceiling
    for channel in force:
        limit = f" (ceiling {ceiling[channel.name]:.3f})" if ceiling else ""
        columns += [f"RMSE {channel.name} [{channel.unit}]", f"R² {channel.name}{limit}"]
    groups: dict[str, list[ScoreRow]] = {}
    for row in rows:
        groups.setdefault(json.dumps([row.arch, row.configuration]), []).append(row)
    table = [_baseline_line(name, scored, force) for name, scored in baselines.items()]
    for runs in groups.values():
        alike = [row.configuration for row in rows if row.arch == runs[0].arch]
        differs = what_differs(runs[0].configuration, alike)
        name = runs[0].arch + (f" ({differs})" if differs else "")
        line = [name, f"{runs[0].trainable:,}", f"{runs[0].frozen:,}"]
        for channel in force:
            line.append(mean_and_spread([row.rmse[channel.name] for row in runs], ".4g"))
            line.append(mean_and_spread([row.r2[channel.name] for row in runs], ".4f"))
        table.append([*line, mean_and_spread([row.seconds for row in runs], ".1f")])
    print_table(title, [*columns, "seconds"], table)


def _baseline_line(name: str, scored: "Score", force: "Sequence[Quantity]") -> list[str]:
    line = [name, "", ""]
    for channel in force:
        line.append(mean_and_spread([scored.rmse[channel.name]], ".4g"))
        line.append(mean_and_spread([scored.r2[channel.name]], ".4f"))
    return [*line, ""]


def baseline_rows(baselines: "Mapping[str, Score]", lead_s: float) -> list[dict[str, Any]]:
    """The same for `--json`."""
    return [
        {"predictor": name, "lead_s": lead_s, "rmse": scored.rmse, "r2": scored.r2}
        for name, scored in baselines.items()
    ]
