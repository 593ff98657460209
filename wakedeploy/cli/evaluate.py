"""`wakedeploy evaluate`: errors of finished runs per output and split."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import json_option, progress, write_json
from wakedeploy.cli.train import print_scores, score_row, unlearned_rows
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from trainers.training.runs import RunConfig, TrainedRun
    from wakedeploy.core.episodes import EpisodeSet


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
    """Score the finished runs at or below RUNS on the episodes of a set.

    Every run is asked for the force at its own lead; all are scored on the same samples, after
    one common warm-up. Beside them: predicting nothing, and a set's observer of the sufferer's
    motion, which learn nothing. Seconds are those of the evaluation.

    \b
    Example:
        wakedeploy evaluate runs --data sets/gantry --split test --json table.json
        wakedeploy evaluate runs/gantry/gru/s0 --data sets/measured --split all
    """
    from trainers.training.runs import finished_runs, load_run
    from trainers.training.score import unlearned
    from wakedeploy.core.episodes import read_episode_set

    episodes = read_episode_set(data)
    folders, trained = _that_fit(finished_runs(runs), episodes, data), []
    with progress("Reading the runs", len(folders)) as bar:
        for folder in folders:
            trained.append(load_run(folder))
            bar.advance()
    trained.sort(key=_place_in_table)
    warm_up = max(episodes.warm_up_steps, *(run.config.warm_up_steps for run in trained))
    rows = []
    with progress("Evaluating", len(trained)) as bar:
        for run in trained:
            rows.append(_evaluate(run, episodes, split, warm_up))
            bar.advance()
    nothing_learned = []
    # One table for each lead, since forces at different times do not compare.
    for lead_s in sorted({run.config.lead_s for run in trained}):
        scored = unlearned(episodes, split, lead_s, warm_up)
        nothing_learned += unlearned_rows(scored, lead_s)
        at = [row for row in rows if row["lead_s"] == lead_s]
        title = f"{data}: {split} episodes, force {lead_s:g} s ahead"
        print_scores(title, at, trained[0].config, scored)
    if json_path:
        write_json(json_path, {"rows": rows, "unlearned": nothing_learned})


def _that_fit(folders: list[Path], episodes: "EpisodeSet", data: Path) -> list[Path]:
    """The runs whose channels and rate are the set's; how many others there are is told."""
    from trainers.training.runs import read_config

    misfits = {folder: _misfit(read_config(folder), episodes) for folder in folders}
    fitting = [folder for folder in folders if misfits[folder] is None]
    first, why = next(((f, w) for f, w in misfits.items() if w is not None), (None, None))
    if not fitting:
        raise UnusableInput(f"{first} cannot be evaluated on {data}: {why}.")
    if first is not None:
        others = len(folders) - len(fitting)
        click.echo(f"Left out {others} runs that do not fit the set; {first}: {why}.", err=True)
    return fitting


def _misfit(config: "RunConfig", episodes: "EpisodeSet") -> str | None:
    """What keeps a run from reading this set, in words; None when nothing does."""
    for kind, own, there in (
        ("observation", config.observation, episodes.observation),
        ("force", config.force, episodes.force),
    ):
        names, given = [(c.name, c.unit) for c in own], [(c.name, c.unit) for c in there]
        if names != given:
            return f"its {kind} channels are {_listed(names)}, the set has {_listed(given)}"
    if abs(config.rate_hz - episodes.rate_hz) > 1e-6 * config.rate_hz:
        return f"it was trained at {config.rate_hz:g} Hz, the set is at {episodes.rate_hz:g} Hz"
    return None


def _place_in_table(run: "TrainedRun") -> tuple[int, int]:
    """Architectures in the order of Table I, then seeds."""
    from trainers.build import ARCHITECTURES

    return list(ARCHITECTURES).index(run.config.arch), run.config.seed


def _listed(channels: list[tuple[str, str]]) -> str:
    return ", ".join(f"{name} [{unit}]" for name, unit in channels)


def _evaluate(
    run: "TrainedRun", episodes: "EpisodeSet", split: str, warm_up: int
) -> dict[str, Any]:
    from trainers.training.score import score

    began = time.monotonic()
    result = score(run.predictor, episodes, split, run.config.lead_s, warm_up)
    return score_row(run, split, result.rmse, result.r2, time.monotonic() - began)
