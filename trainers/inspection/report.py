"""A run's page, beside its weights: how well it predicts in plain words, and what to do next.

In: a finished run, and its pictures where they were drawn. Out: `report.html` in the run's folder.
"""

import math
import shlex
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from trainers.memory import Memory
from trainers.trained_run import TrainedRun
from trainers.training.baselines import MEAN, ZERO
from trainers.training.episode_scores import worst_first
from trainers.training.runs import CURVES, METRICS, PREDICTION, REPORT, RunConfig
from trainers.training.score import Score
from wakedeploy.core import pages
from wakedeploy.core.few_samples import few_samples
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.line_chart import Curve, LineChart
from wakedeploy.core.manifest import Quantity, Scores

_LATE = 0.2  # of the epochs, by which it is judged whether the error still falls
_COUNTS = 0.01  # of the error: what a tenth of the epochs has to gain, for more to be worth trying
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
            *chain(
                *((*_answer(run, c, baselines), *_beaten(run, c, baselines)) for c in config.force)
            ),
            *_remarks(run),
            *_few(run),
        ],
        "tile_pairs": _tiles(run),
        "errors": _errors(run, baselines),
        "episodes": _episodes(run),
        "episodes_of": len(metrics.test_episodes),
        "chart_of_errors": chart,
        "pictures": [pages.Picture(p, _CAPTIONS[name]) for name, p in drawn if p.exists()],
        "settings": _settings(config, run.predictor.memory),
        "next": _next(run) if _learned(run, baselines) else _attempts(run),
    }


def _answer(run: TrainedRun, channel: Quantity, baselines: Mapping[str, Score]) -> list[str]:
    """How well one force is predicted, for who knows nothing of R²."""
    rmse, r2 = run.metrics.test.rmse[channel.name], run.metrics.test.r2[channel.name]
    lead_s = run.config.lead_s
    ahead = f" {1e3 * lead_s:.0f} ms ahead" if lead_s else ""
    sentence = f"It predicts {channel.name}{ahead} to within {rmse:.3g} {channel.unit} (RMS)"
    bar = _constant(channel, baselines)
    if bar is not None and rmse >= bar.rmse:
        return [
            f"{sentence}: it learned nothing.",
            f"Always naming {bar.named} errs no more: by {bar.rmse:.3g} {channel.unit}.",
        ]
    judged = "Judged on episodes that took no part in training."
    if bar is not None:
        judged = f"Always naming {bar.named} errs by {bar.rmse:.3g} {channel.unit}. {judged}"
    if r2 is None:
        return [f"{sentence}.", f"{judged} In them this force never changes."]
    word = "well" if r2 >= _GOOD else "in part" if r2 >= _POOR else "poorly"
    if r2 <= 0.0:
        # R² compares with the mean of the test samples themselves, which nobody knows beforehand.
        share = (
            "Its ups and downs there it does not follow: naming their own mean would err by"
            f" {_spread(rmse, r2):.3g} {channel.unit}."
        )
    else:
        share = f"It explains {100 * r2:.0f} % of the force's variance there."
    return [f"{sentence}: {word}.", f"{judged} {share}"]


@dataclass(frozen=True)
class _Constant:
    """A force that never changes as a forecast: how it is called, and its error [unit of it]."""

    named: str
    rmse: float


def _constant(channel: Quantity, baselines: Mapping[str, Score]) -> _Constant | None:
    """The better of the two forecasts that take no knowledge of the present; None without them."""
    named = {MEAN: "the mean force of the training episodes", ZERO: "a force of zero"}
    known = [
        _Constant(words, baselines[name].rmse[channel.name])
        for name, words in named.items()
        if name in baselines
    ]
    return min(known, key=lambda each: each.rmse, default=None)


def _spread(rmse: float, r2: float) -> float:
    """The standard deviation of the force about its own mean, from an error and its R² below 1."""
    return rmse / math.sqrt(1.0 - r2)


def _learned(run: TrainedRun, baselines: Mapping[str, Score]) -> bool:
    """Whether every force is predicted better than by naming a constant."""
    bars = {c.name: _constant(c, baselines) for c in run.config.force}
    return all(bar is None or run.metrics.test.rmse[c] < bar.rmse for c, bar in bars.items())


def _few(run: TrainedRun) -> list[str]:
    """That the errors rest on few samples, where they do."""
    counts = {"validation": run.metrics.validation_samples or 0, "test": _tested(run)}
    sentence = few_samples(counts)
    return [] if sentence is None else [sentence]


def _tested(run: TrainedRun) -> int:
    """How many test samples were scored."""
    return sum(episode.samples for episode in run.metrics.test_episodes)


def _beaten(run: TrainedRun, channel: Quantity, baselines: Mapping[str, Score]) -> list[str]:
    """That a formula without a network errs less, where one does; the best of them."""
    errors = {name: score.rmse[channel.name] for name, score in baselines.items()}
    best = min(errors, key=errors.__getitem__, default="")
    if best in ("", MEAN, ZERO) or errors[best] >= run.metrics.test.rmse[channel.name]:
        return []  # that it is beaten by a constant is said already
    return [
        f"Something simpler does better: {best} errs by {errors[best]:.3g} {channel.unit}. Train "
        "longer, on more episodes, or another architecture."
    ]


def _remarks(run: TrainedRun) -> list[str]:
    """What the errors over the epochs say about the next attempt."""
    metrics = run.metrics
    if metrics.epochs == run.config.settings.get("epochs") and still_falling(metrics.history):
        return [
            f"The error on validation still fell in the last of its {metrics.epochs} epochs: more "
            "of them may help."
        ]
    ceiling = metrics.test_r2_ceiling or {}
    limits = [f"{name}: {100 * share:.0f} %" for name, share in ceiling.items()]
    return [f"More than this nobody can explain of it: {', '.join(limits)}."] if limits else []


def still_falling(losses: Sequence[float]) -> bool:
    """Whether the loss on validation falls at the end of a fit that had all of its epochs.

    Of the last fifth the first half is compared with the second. There the learning rate is below a
    tenth of its peak. Before, errors also fall since the rate does: the weights jitter less, and
    more epochs would repeat that and no more. Noise from epoch to epoch is no fall: every loss of
    the second half has to lie below every one of the first, and the error by a share that counts.
    """
    half = max(2, round(_LATE * len(losses) / 2))
    if len(losses) < 2 * half:
        return False
    before, after = losses[-2 * half : -half], losses[-half:]
    falls = 1.0 - math.sqrt(statistics.median(after) / max(statistics.median(before), 1e-300))
    return max(after) < min(before) and falls > _COUNTS


def _tiles(run: TrainedRun) -> list[tuple[str, str]]:
    test = run.metrics.test
    tiles = []
    for channel in run.config.force:
        error = f"{test.rmse[channel.name]:.3g} {channel.unit}"
        tiles.append((f"{channel.name}, RMS error", error))
        if (r2 := test.r2[channel.name]) is not None:
            tiles.append((f"{channel.name}, R²", f"{r2:.3f}"))
    tiles.append(("test samples scored", f"{_tested(run):,}"))
    return [*tiles, ("trainable parameters", f"{run.metrics.trainable:,}")]


def _errors(run: TrainedRun, baselines: Mapping[str, Score]) -> pages.Table:
    """A row per predictor, split and force: what it has to beat, then the run."""
    scored: list[tuple[str, str, int | None, Score | Scores]] = [
        (name, "test", score.samples, score) for name, score in baselines.items()
    ]
    metrics = run.metrics
    scored.append((run.config.arch, "validation", metrics.validation_samples, metrics.validation))
    scored.append((run.config.arch, "test", _tested(run), metrics.test))
    rows = [
        [
            name,
            split,
            "–" if samples is None else f"{samples:,}",
            c.name,
            f"{score.rmse[c.name]:.4g}",
            c.unit,
            _r2(score, c),
        ]
        for name, split, samples, score in scored
        for c in run.config.force
    ]
    return pages.Table(
        ["predictor", "episodes", "samples", "force", "RMS error", "unit", "R²"], rows
    )


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


def _settings(config: RunConfig, memory: Memory) -> pages.Table:
    """How it was made, for who makes it again."""
    rows = [[f"{config.arch}: {name}", str(value)] for name, value in config.hyper.items()]
    rows += [[f"training: {name}", f"{value:g}"] for name, value in config.settings.items()]
    rows += [["lead", f"{config.lead_s:g} s"], ["rate", f"{config.rate_hz:g} Hz"]]
    rows += [["past that it sees", f"{config.window_s:g} s"], ["set", config.data_sha256[:12]]]
    if memory.kind == "window":  # `snapshots` is how many there may be at most
        rows.append(
            ["snapshots that it sees", f"{memory.k}, {memory.stride / config.rate_hz:g} s apart"]
        )
    return pages.Table(["setting", "value"], rows)


def _next(run: TrainedRun) -> tuple[str, list[str]]:
    """From here to a flight, or to a package elsewhere."""
    package = f"{run.config.arch}.onnx"
    lines = [
        f"wakedeploy export --run {shlex.quote(str(run.folder))}",
        f"wakedeploy check {package}",
    ]
    if run.config.domain == "gantry":
        lines.append(f"wakedeploy run-gantry --package {package} --virtual --seconds 20 --live")
        return "What to do next: make a package of it, prove it, and fly it.", lines
    folder = f"{run.config.arch.replace('-', '_')}_c"
    lines.append(f"wakedeploy export --package {package} --c {folder}")
    return "What to do next: make a package of it, prove it, and make C of it for a chip.", lines


def _attempts(run: TrainedRun) -> tuple[str, list[str]]:
    """What to try where nothing was learned: is it the data, the lead, or the fit?"""
    data = shlex.quote(run.metrics.data_folder or "SET")
    return (
        "What to try: look whether units and ranges are right. Score the training episodes: if the "
        "error is small there, more and longer episodes help. If it is large there too, train "
        "longer or at another `--learning-rate`. Where neither helps, the observations may not "
        "tell the force: predict it at the present moment, and with a longer `window_s`.",
        [
            f"wakedeploy data show {data}",
            f"wakedeploy evaluate {shlex.quote(str(run.folder))} --data {data} --split train",
            f"wakedeploy train --data {data} --lead 0 --out runs-lead-0",
        ],
    )
