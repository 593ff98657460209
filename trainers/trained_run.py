"""A finished run, its predictor ready to use, and the set that it was trained on.

In: the folder of a finished run. Out: a `TrainedRun`, which predicts, and draws what it predicts.
Its set is found again by its hash.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import safetensors.torch
import torch
from safetensors import SafetensorError
from torch import Tensor

from trainers.inspection.prediction import draw_prediction, title_of
from trainers.model import Predictor
from trainers.training.predict import predict
from trainers.training.runs import (
    BEST,
    CONFIG,
    METRICS,
    PREDICTION,
    RunConfig,
    RunMetrics,
    UnusableRun,
    damaged,
    new_predictor,
    read_config,
    read_metrics,
)
from trainers.training.tape import tape_of
from wakedeploy.core.episodes import DESCRIPTION, EpisodeSet, read_episode_set, stated_sha256
from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.figures import showing_itself
from wakedeploy.core.files import path_from, sha256_of
from wakedeploy.core.manifest import FloatArray
from wakedeploy.core.misfit import misfit
from wakedeploy.core.observations import series_of, warn_of_other_rate, warn_out_of_range

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DEPTH = 4  # how many folders down the set of a run is looked for


@dataclass(frozen=True, eq=False, repr=False)
class TrainedRun:
    """A finished run, its predictor ready to use (evaluation mode, best weights).

    `run.predict(observations)` gives forces, `run.plot()` shows a test episode and them. `folder`
    is where it lies, `config` what was trained on what, `metrics` how it ended, with the RMSE of
    each force channel in its unit.
    """

    folder: Path
    config: RunConfig
    metrics: RunMetrics
    predictor: Predictor

    def predict(self, observations: npt.ArrayLike) -> FloatArray:
        """Forces (T, o) for observations (T, d), or (B, T, o) for B series (B, T, d).

        Every series begins with an empty memory. Forces are float32, in the units of
        `config.force`, `config.lead_s` seconds ahead; errors leave out the first
        `config.warm_up_steps`. The columns of a DataFrame or a dict are taken by their names,
        those of an array in the order of `config.observation`. Raises UnusableInput for another
        shape, a missing channel or what is no number. Warns by `wd.OutOfRange` where a channel has
        other values than in training, as in another unit, or where the index of a DataFrame tells
        another rate.
        """
        given = series_of(observations, self.config.observation)  # (T, d) or (B, T, d)
        warn_out_of_range(given, self.config.observation)
        if self.predictor.memory.kind != "none":
            warn_of_other_rate(observations, self.config.rate_hz)
        shape = (*given.shape[:-1], len(self.config.force))
        if given.size == 0:
            return np.empty(shape, np.float32)
        series = given[None] if given.ndim == 2 else given  # (B, T, d)
        return predict(self.predictor, tape_of(series, shape[-1])).numpy().reshape(shape)

    def plot(self, data: "EpisodeSet | Path | str | None" = None) -> "Figure":
        """The test episode in which the forces change most: as they were, and as predicted.

        Of `data`, a set or the folder of one; by default the set that the run was trained on.
        Raises UnusableInput where there is none, and for a set of other channels or another rate.
        """
        shown = episodes_of(self) if data is None else _set_of(data)
        if why := misfit(self.config.observation, self.config.force, self.config.rate_hz, shown):
            raise UnusableInput(f"{self.folder} cannot be drawn on this {shown.domain} set: {why}.")
        is_trained_on = shown.sha256 == self.config.data_sha256
        errors = self.metrics.test if is_trained_on else None
        drawn = draw_prediction(title_of(self.config), self.config, self.predictor, shown, errors)
        return showing_itself(drawn)

    def __repr__(self) -> str:
        errors = [
            f"{c.name} {self.metrics.test.rmse[c.name]:.4g} {c.unit}" for c in self.config.force
        ]
        return f"<TrainedRun {self.folder}: test RMSE {', '.join(errors)}>"

    def _repr_png_(self) -> bytes | None:
        """The liveliest test episode as it was and as predicted, where that was drawn."""
        drawn = self.folder / PREDICTION
        return drawn.read_bytes() if drawn.exists() else None


def load_run(folder: Path) -> TrainedRun:
    """Read a finished run; UnusableInput names the file and what to do about it."""
    config, metrics = read_config(folder), read_metrics(folder)
    weights = _read_weights(folder / BEST, metrics.weights_sha256)
    predictor = _predictor_of(config, weights, folder)
    return TrainedRun(folder, config, metrics, predictor.eval())


def episodes_of(run: TrainedRun) -> EpisodeSet:
    """The set that the run was trained on: the one that it knows, or one below with its hash."""
    known, wanted = run.metrics.data_folder, run.config.data_sha256
    places = [] if known is None else [Path(known)]
    for depth in range(1, _DEPTH + 1):
        places += sorted(path.parent for path in Path().glob(f"{'*/' * depth}{DESCRIPTION}"))
    found = next((place for place in places if _hash_of(place) == wanted), None)
    if found is not None:
        return read_episode_set(found)
    where = f"The set that {run.folder} was trained on is not near this folder"
    if known is not None:
        happened = "is no longer there" if _hash_of(Path(known)) is None else "has changed since"
        where = f"The set that {run.folder} was trained on lay in {known} and {happened}"
    raise UnusableInput(f"{where}; say where it is now: --data FOLDER (in Python, data=…).")


def _set_of(data: "EpisodeSet | Path | str") -> EpisodeSet:
    return data if isinstance(data, EpisodeSet) else read_episode_set(path_from(data, "data"))


def _predictor_of(config: RunConfig, weights: Mapping[str, Tensor], folder: Path) -> Predictor:
    """The predictor of a configuration with these weights; UnusableRun where they do not fit.

    Shapes are compared before any memory is taken: drawing weights anew may take seconds.
    """
    try:
        with torch.device("meta"):
            shapes = {
                name: tensor.shape for name, tensor in new_predictor(config).state_dict().items()
            }
        if shapes != {name: tensor.shape for name, tensor in weights.items()}:
            raise damaged(folder / BEST, "its tensors are not those of its config.json")
        predictor = new_predictor(config)
        predictor.load_state_dict(weights)
    except UnusableRun:
        raise
    except UnusableInput as error:
        raise damaged(folder / CONFIG, str(error).removesuffix(".")) from error
    except RuntimeError as error:  # torch's word for tensors of another type
        raise damaged(folder / BEST, "its tensors are not those of its config.json") from error
    return predictor


def _read_weights(path: Path, sha256: str) -> dict[str, Tensor]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise damaged(path, one_line(error)) from error
    if sha256_of(data) != sha256:
        raise damaged(path, f"its hash is not the one in {METRICS}")
    try:
        return safetensors.torch.load(data)
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise damaged(path, one_line(error)) from error


def _hash_of(folder: Path) -> str | None:
    """The content hash that a set states; None for what is no set, as many a dataset.json."""
    try:
        return stated_sha256(folder)
    except UnusableInput:
        return None
