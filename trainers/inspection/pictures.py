"""A run's pictures, beside its weights: how its fit went, and what it predicts.

In: a run and its set. Out: `curves.png` and `prediction.png` in the run's folder. Drawn after a fit
and never within one; they take nothing from torch's random numbers.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from trainers.inspection.curves import draw_curves
from trainers.inspection.prediction import draw_prediction, title_of
from trainers.trained_run import TrainedRun
from trainers.training.fit import standing_in
from trainers.training.runs import (
    BEST,
    CONFIG,
    CURVES,
    LAST,
    METRICS,
    PREDICTION,
    new_predictor,
    read_config,
    read_tensors,
    restore_best,
)
from wakedeploy.core import figures
from wakedeploy.core.episodes import EpisodeSet

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_pictures(run: TrainedRun, data: EpisodeSet) -> list[Path]:
    """Draw a finished run on the set that it was trained on; what is drawn already stays.

    A reservoir of an earlier version has no `curves.png`: its `metrics.json` keeps none. Raises
    UnusableInput where a picture cannot be written.
    """
    done = (run.folder / METRICS).stat().st_mtime_ns
    paths = [run.folder / name for name in (CURVES, PREDICTION)]
    if all(path.exists() and path.stat().st_mtime_ns >= done for path in paths):
        return paths
    title, metrics = title_of(run.config), run.metrics
    drawn = {
        CURVES: draw_curves(title, metrics.history, metrics.training_history, metrics.ridge),
        PREDICTION: draw_prediction(title, run.config, run.predictor, data, metrics.test),
    }
    return _written(run.folder, drawn)


def write_pictures_so_far(folder: Path, data: EpisodeSet) -> list[Path]:
    """The same of a run that was interrupted, with the best weights so far; none before epoch 1."""
    if not all((folder / name).exists() for name in (CONFIG, LAST, BEST)):
        return []
    config = read_config(folder)
    standing = standing_in(read_tensors(folder / LAST)[1])
    predictor = new_predictor(config).eval()
    restore_best(predictor, folder)
    title = (
        f"{title_of(config)}, stopped after epoch {standing.epoch} of {config.settings['epochs']}"
    )
    drawn = {
        CURVES: draw_curves(title, standing.history, standing.training_history),
        PREDICTION: draw_prediction(title, config, predictor, data),
    }
    return _written(folder, drawn)


def _written(folder: Path, drawn: "Mapping[str, Figure | None]") -> list[Path]:
    for name, figure in drawn.items():
        if figure is not None:
            figures.save(figure, folder / name)
    return [folder / name for name, figure in drawn.items() if figure is not None]
