"""`wakedeploy evaluate`: errors of finished runs and packages per output and split."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.output import json_option, print_table, stage_bars, warn, write_json
from wakedeploy.cli.train import baseline_rows, print_scores

if TYPE_CHECKING:
    from wakedeploy.api.scores import ScoreRow
    from wakedeploy.core.manifest import Quantity

_WORST = 5  # episodes that the terminal shows


@click.command()
@click.argument("runs", type=click.Path(path_type=Path))
@click.option("--data", type=click.Path(path_type=Path), required=True, help="An episode set.")
@click.option(
    "--split",
    type=click.Choice(["test", "validation", "train", "all"], case_sensitive=False),
    default="test",
    show_default=True,
    help="all: a set of unseen recordings.",
)
@json_option
def command(runs: Path, data: Path, split: str, json_path: Path | None) -> None:
    """Score the finished runs at or below RUNS, or a package, on the episodes of a set.

    RUNS may also be a package or a folder of C, scored as it would fly, or a folder of packages.
    What in a folder does not fit the set, or cannot be read, is named and left out.
    Every run is asked for the force at its own lead; all are scored on the same samples, after
    one common warm-up. Above them: predicting zero, and a set's observer of the sufferer's motion.
    Of runs that were trained on this set also what its training episodes tell without a network:
    their mean force, and linear regressions on one tick and on the set's window. Below is where the
    best run errs most, episode by episode; --json has every episode of every run. Seconds are those
    of the evaluation.

    \b
    Example:
        wakedeploy evaluate runs --data sets/gantry --split test --json table.json
        wakedeploy evaluate runs/gantry/gru/s0 --data sets/measured --split all
        wakedeploy evaluate gru.onnx --data sets/measured --split all
    """
    from wakedeploy.api.evaluation import evaluate

    with stage_bars() as bars:
        scores = evaluate(runs, data, split, progress=bars, warn=warn)
    rows_of_baselines = []
    # One table for each lead, since forces at different times do not compare.
    for lead_s, baselines in scores.baselines.items():
        rows_of_baselines += baseline_rows(baselines, lead_s)
        at = [row for row in scores.rows if row.lead_s == lead_s]
        samples = baselines["zero"].samples
        title = f"{data}: {split} episodes ({samples:,} samples), force {lead_s:g} s ahead"
        print_scores(title, at, scores.force, baselines)
        _print_worst(at, scores.force)
    if json_path:
        rows = [row.as_json() for row in scores.rows]
        write_json(json_path, {"rows": rows, "baselines": rows_of_baselines})


def _print_worst(rows: "Sequence[ScoreRow]", force: "Sequence[Quantity]") -> None:
    """The episodes in which the best run errs most; nothing where there is but one."""
    from trainers.training.episode_scores import worst_first

    best = min(rows, key=lambda row: row.rmse[force[0].name])
    if len(best.episodes) < 2:
        return
    shown = worst_first(best.episodes)[:_WORST]
    columns = ["episode", "samples"]
    for channel in force:
        columns += [f"RMSE {channel.name} [{channel.unit}]", "by that of zero"]
    table = []
    for episode in shown:
        line = [episode.episode, str(episode.samples)]
        for channel in force:
            relative = episode.relative[channel.name]
            line.append(f"{episode.rmse[channel.name]:.4g}")
            line.append("—" if relative is None else f"{relative:.3f}")
        table.append(line)
    title = (
        f"where {best.arch} s{best.seed} errs most: {len(shown)} of {len(best.episodes)} episodes"
    )
    print_table(title, columns, table)
