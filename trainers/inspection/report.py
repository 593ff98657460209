"""A run's page, beside its weights: how well it predicts in plain words, and what to do next.

In: a finished run, and its pictures where they were drawn. Out: `report.html` in the run's folder.
"""

import math
import shlex
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from trainers.trained_run import TrainedRun
from trainers.training.episode_scores import worst_first
from trainers.training.runs import CURVES, METRICS, PREDICTION, REPORT, RunConfig
from trainers.training.score import Score
from wakedeploy.core import pages
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.line_chart import Curve, LineChart
from wakedeploy.core.manifest import Quantity, Scores

_LATE = 0.9  # of the epochs: a best one after that says that the fit was still getting better
_GOOD, _POOR = 0.9, 0.5  # R²
_EPISODES = 200  # that the page shows; the worst ones, where there are more
_CAPTIONS = {
    CURVES: "The error over the strengths of the readout's ridge; the circle is the one taken.",
    PREDICTION: (
        "The test episode in which the force changes most: as it was, as predicted, and the "
        "difference below. The predictor never saw it."
    ),
}


def write_run_report(run: TrainedRun, baselines: Mapping[str, Score]) -> Path:
    """Write the page of a finished run, unless it is there already; its path.

    `baselines` are the errors on its test episodes of what it has to beat, by name.
    Raises UnusableInput where it cannot be written.
    """
    path = run.folder / REPORT
    if path.exists() and path.stat().st_mtime_ns >= (run.folder / METRICS).stat().st_mtime_ns:
        return path
    write_text_whole(
        path, pages.page("trainers.inspection", "run.html", **_page_fields(run, baselines))
    )
    return path


def _page_fields(run: TrainedRun, baselines: Mapping[str, Score]) -> dict[str, Any]:
    config, metrics = run.config, run.metrics
    chart = _chart(run)
    names = [PREDICTION] if chart else [CURVES, PREDICTION]
    drawn = [(name, run.folder / name) for name in names]
    return {
        "title": f"{config.arch}, seed {config.seed}, on {config.domain}",
        "subtitle": f"Finished {metrics.finished_utc[:16].replace('T', ' ')} UTC after "
        f"{metrics.seconds:.0f} s of training.",
        "answers": [
            *chain(*((*_answer(run, c), *_beaten(run, c, baselines)) for c in config.force)),
            *_remarks(run),
        ],
        "tile_pairs": _tiles(run),
        "errors": _errors(run, baselines),
        "episodes": _episodes(run),
        "episodes_of": len(metrics.test_episodes),
        "chart_of_errors": chart,
        "pictures": [pages.Picture(p, _CAPTIONS[name]) for name, p in drawn if p.exists()],
        "settings": _settings(config),
        "next": _commands(run),
    }


def _answer(run: TrainedRun, channel: Quantity) -> list[str]:
    """How well one force is predicted, for who knows nothing of R²."""
    rmse, r2 = run.metrics.test.rmse[channel.name], run.metrics.test.r2[channel.name]
    lead_s = run.config.lead_s
    ahead = f" {1e3 * lead_s:.0f} ms ahead" if lead_s else ""
    sentence = f"It predicts {channel.name}{ahead} to within {rmse:.3g} {channel.unit} (RMS)"
    if r2 is None:
        return [f"{sentence}.", "In the test episodes this force never changes."]
    if r2 <= 0.0:
        return [f"{sentence}: it learned nothing.", "Always naming the mean force does as well."]
    spread = rmse / math.sqrt(1.0 - r2) if r2 < 1.0 else math.inf
    word = "well" if r2 >= _GOOD else "in part" if r2 >= _POOR else "poorly"
    return [
        f"{sentence}: {word}.",
        f"Always naming the mean would be off by {spread:.3g} {channel.unit}, so that it explains "
        f"{100 * r2:.0f} % of the force's variance. Judged on episodes that took no part in "
        "training.",
    ]


def _beaten(run: TrainedRun, channel: Quantity, baselines: Mapping[str, Score]) -> list[str]:
    """That a formula without a network errs less, where one does; the best of them."""
    errors = {name: score.rmse[channel.name] for name, score in baselines.items()}
    best = min(errors, key=errors.__getitem__, default="")
    if not best or errors[best] >= run.metrics.test.rmse[channel.name]:
        return []
    return [
        f"Something simpler does better: {best} errs by {errors[best]:.3g} {channel.unit}. Train "
        "longer, on more episodes, or another architecture."
    ]


def _remarks(run: TrainedRun) -> list[str]:
    """What the errors over the epochs say about the next attempt."""
    metrics = run.metrics
    if len(metrics.history) > 1 and metrics.best_epoch > _LATE * metrics.epochs:
        return [
            f"Its best epoch was {metrics.best_epoch} of {metrics.epochs}: the error was still "
            "falling, and more epochs may help."
        ]
    ceiling = metrics.test_r2_ceiling or {}
    limits = [f"{name}: {100 * share:.0f} %" for name, share in ceiling.items()]
    return [f"More than this nobody can explain of it: {', '.join(limits)}."] if limits else []


def _tiles(run: TrainedRun) -> list[tuple[str, str]]:
    test = run.metrics.test
    tiles = []
    for channel in run.config.force:
        error = f"{test.rmse[channel.name]:.3g} {channel.unit}"
        tiles.append((f"{channel.name}, RMS error", error))
        if (r2 := test.r2[channel.name]) is not None:
            tiles.append((f"{channel.name}, R²", f"{r2:.3f}"))
    return [*tiles, ("trainable parameters", f"{run.metrics.trainable:,}")]


def _errors(run: TrainedRun, baselines: Mapping[str, Score]) -> pages.Table:
    """A row per predictor, split and force: what it has to beat, then the run."""
    scored: list[tuple[str, str, Score | Scores]] = [
        (name, "test", score) for name, score in baselines.items()
    ]
    scored.append((run.config.arch, "validation", run.metrics.validation))
    scored.append((run.config.arch, "test", run.metrics.test))
    rows = [
        [name, split, c.name, f"{score.rmse[c.name]:.4g}", c.unit, _r2(score, c)]
        for name, split, score in scored
        for c in run.config.force
    ]
    return pages.Table(["predictor", "episodes", "force", "RMS error", "unit", "R²"], rows)


def _episodes(run: TrainedRun) -> pages.Table:
    """A row per test episode, the worst first."""
    columns = ["episode", "samples"]
    for channel in run.config.force:
        columns += [f"RMS error of {channel.name} [{channel.unit}]", "by that of zero"]
    rows = []
    for episode in worst_first(run.metrics.test_episodes)[:_EPISODES]:
        row = [episode.episode, str(episode.samples)]
        for channel in run.config.force:
            relative = episode.relative[channel.name]
            row.append(f"{episode.rmse[channel.name]:.4g}")
            row.append("–" if relative is None else f"{relative:.3f}")
        rows.append(row)
    return pages.Table(columns, rows)


def _r2(scores: Score | Scores, channel: Quantity) -> str:
    value = scores.r2[channel.name]
    return "–" if value is None else f"{value:.4f}"


def _chart(run: TrainedRun) -> LineChart:
    """Errors over epochs: roots of the losses, so that 1 is what naming the mean would cost."""
    held_out, learned = run.metrics.history, run.metrics.training_history
    count = len(held_out)
    epochs = [float(epoch) for epoch in range(1, count + 1)]
    curves = [Curve("validation", epochs, [_root(loss) for loss in held_out])]
    if learned:
        last = epochs[count - len(learned) :]
        curves.append(Curve("training", last, [_root(loss) for loss in learned]))
    return LineChart(curves, "epoch", "error (1: always naming the mean)")


def _root(loss: float | None) -> float | None:
    return None if loss is None else math.sqrt(max(loss, 0.0))


def _settings(config: RunConfig) -> pages.Table:
    """How it was made, for who makes it again."""
    rows = [[f"{config.arch}: {name}", str(value)] for name, value in config.hyper.items()]
    rows += [[f"training: {name}", f"{value:g}"] for name, value in config.settings.items()]
    rows += [["lead", f"{config.lead_s:g} s"], ["rate", f"{config.rate_hz:g} Hz"]]
    rows += [["past that it sees", f"{config.window_s:g} s"], ["set", config.data_sha256[:12]]]
    return pages.Table(["setting", "value"], rows)


def _commands(run: TrainedRun) -> list[str]:
    """From here to a flight, or to a package elsewhere."""
    package = f"{run.config.arch}.onnx"
    lines = [
        f"wakedeploy export --run {shlex.quote(str(run.folder))}",
        f"wakedeploy check {package}",
    ]
    if run.config.domain == "gantry":
        lines.append(f"wakedeploy run-gantry --package {package} --virtual --seconds 20 --live")
    return lines
