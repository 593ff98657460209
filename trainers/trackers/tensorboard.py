"""Runs in TensorBoard: event files in each run's folder, so that they go where it goes."""

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard.summary import hparams

from trainers.trackers.values import epochs, finals, parameters, standing_of
from trainers.trained_run import TrainedRun
from trainers.training.fit import Standing
from trainers.training.runs import RunConfig
from wakedeploy.core.errors import one_line

EVENTS = "events.out.tfevents.*"
_SEEN_AFTER_S = 5  # what was reported is on the disk then


class TensorBoard:
    """Event files below `out`."""

    failures: tuple[type[Exception], ...] = (OSError,)

    def __init__(self, out: Path) -> None:
        self.whereabouts = f"TensorBoard: look with `tensorboard --logdir {shlex.quote(str(out))}`."

    def why(self, failure: Exception) -> str:
        """A failure in one line."""
        return one_line(failure)

    def track(self, config: RunConfig, folder: Path, fresh: bool) -> "_Run":
        """A run, whose events are written anew from its first epoch."""
        return _Run(config, folder)


class _Run:
    def __init__(self, config: RunConfig, folder: Path) -> None:
        self._config, self._folder = config, folder
        self._writer: Any = None
        self._epochs = 0

    def stands(self, standing: Standing) -> None:
        """Report the epochs not reported yet."""
        writer = self._open()
        for epoch, values in epochs(self._config, standing, self._epochs):
            for name, value in values.items():
                writer.add_scalar(name, value, epoch)
        self._epochs = standing.epoch

    def finished(self, run: TrainedRun, pictures: Sequence[Path]) -> None:
        """The scores at the epoch that they are of, and the pictures."""
        self.stands(standing_of(run.metrics))
        for name, value in finals(run.metrics).items():
            self._writer.add_scalar(name, value, run.metrics.best_epoch)
        for path in pictures:
            self._writer.add_image(path.stem, _pixels(path), self._epochs, dataformats="HWC")
        self._writer.file_writer.add_summary(_ended(self._config))

    def close(self, how: str) -> None:
        """Whole files, whatever came."""
        if self._writer is not None:
            self._writer.close()

    def _open(self) -> Any:
        """The writer; the first call takes away an earlier training's events."""
        if self._writer is None:
            for old in self._folder.glob(EVENTS):
                old.unlink()
            self._writer = SummaryWriter(str(self._folder), flush_secs=_SEEN_AFTER_S)
            config = json.dumps(self._config.model_dump(mode="json"), indent=1)
            self._writer.add_text("config", f"```json\n{config}\n```")
            self._writer.file_writer.add_summary(_began(self._config))
        return self._writer


# TensorBoard finds the columns of its tab HPARAMS by itself: a list of them in one run's files
# would hide the hyper-parameters of another architecture's runs.
def _began(config: RunConfig) -> Any:
    """The run's values in the tab HPARAMS."""
    return hparams(parameters(config), {})[1]  # type: ignore[no-untyped-call]


def _ended(config: RunConfig) -> Any:
    """The mark that this run is complete."""
    return hparams(parameters(config), {})[2]  # type: ignore[no-untyped-call]


def _pixels(path: Path) -> Any:
    """A picture as (height, width, 3)."""
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))
