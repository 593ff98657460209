"""Descent with early stopping: the state of one fit, an epoch at a time, saved and restored.

The learning rate follows a cosine over the epochs asked for, after a short linear rise. A cosine
depends on how far the fit has come and on nothing else. So it needs no memory when a fit resumes; a
plateau schedule would. Annealing to near zero is worth more to small models than stopping at the
first plateau. Everything random in an epoch is drawn from (seed, epoch).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from trainers.model import Predictor, State
from trainers.training.adamw import AdamW
from trainers.training.loss import WeightedMse
from trainers.training.predict import Seen, predict
from trainers.training.tape import Chunk, Tape, lanes, shuffled

_RISE = 0.05  # share of all epochs over which the learning rate rises
_FLOOR = 0.01  # where the cosine ends, as a share of the peak


@dataclass(frozen=True)
class FitSettings:
    """How a fit descends; all of it is part of a run's identity.

    `batch` is windows per update of the predictors without carried state; `lanes` and
    `chunk_steps` are the sequences side by side and the samples between two cuts of the gradient
    for those with it.
    """

    epochs: int = 60
    patience: int = 20
    learning_rate: float = 3e-3
    weight_decay: float = 1e-4
    gradient_clip: float = 1.0
    batch: int = 256
    lanes: int = 16
    chunk_steps: int = 64


@dataclass(frozen=True)
class Standing:
    """Where a fit stands: the loss on validation after each epoch, 1 = predicting the mean.

    `training_history` is the loss that each epoch descended, averaged over its updates: with
    dropout, and of weights that still moved. NaN for an epoch without an update; the first epochs
    may be missing, in runs that were begun before it was kept.
    """

    history: tuple[float, ...] = ()
    training_history: tuple[float, ...] = ()

    @property
    def epoch(self) -> int:
        """How many epochs are done."""
        return len(self.history)

    @property
    def best(self) -> float:
        """The lowest loss so far; infinite before the first epoch."""
        return min(self.history, default=math.inf)

    @property
    def best_epoch(self) -> int:
        """The epoch, counted from 1, that reached it first; 0 before the first."""
        return self.history.index(self.best) + 1 if self.history else 0

    @property
    def improved(self) -> bool:
        """Whether the last epoch was the best so far."""
        return 0 < self.epoch == self.best_epoch


def standing_in(facts: Mapping[str, Any]) -> Standing:
    """Where the fit of a checkpoint stands; KeyError, ValueError or TypeError if it says none."""
    histories = (facts["history"], facts.get("training_history", ()))
    return Standing(*(tuple(map(float, losses)) for losses in histories))


class Fit:
    """One predictor being fitted; deterministic by seed on a fixed number of threads."""

    def __init__(
        self,
        predictor: Predictor,
        train: Tape,
        validation: Tape,
        *,
        loss_weights: Sequence[float],
        warm_up: int,
        settings: FitSettings,
        seed: int,
        device: str = "cpu",
    ) -> None:
        self.predictor, self.settings, self.seed, self.warm_up = predictor, settings, seed, warm_up
        self.train, self.validation = train.to(device), validation.to(device)
        predictor.to(device)
        predictor.set_normalisation(self.train.observation, self.train.force)
        self.observation = predictor.normalise(self.train.observation)  # (N, d)
        self.seen = Seen(self.observation, self.train.first, predictor.memory)
        self.target = _normalised_force(predictor, self.train)  # (N, o)
        self.loss = WeightedMse(loss_weights, predictor.force_sd)
        self.optimiser = AdamW(predictor, decay=settings.weight_decay, clip=settings.gradient_clip)
        self.standing = Standing()
        self._played: list[tuple[Tensor, Tensor | int]] = []  # each update's loss, and its samples

    @property
    def finished(self) -> bool:
        """All epochs are done, or validation has not improved for `patience` of them."""
        idle = self.standing.epoch - self.standing.best_epoch
        return self.standing.epoch >= self.settings.epochs or idle >= self.settings.patience

    def run_epoch(self) -> Standing:
        """One pass over the training episodes, then the validation episodes."""
        self.train_epoch()
        return self.end_epoch()

    def end_epoch(self) -> Standing:
        """Validate, and count the epoch."""
        past = self.standing
        self.standing = Standing(
            (*past.history, self.validate()), (*past.training_history, self._descended())
        )
        return self.standing

    def train_epoch(self) -> None:
        """The next pass over the training episodes, which `end_epoch` has to count."""
        self.predictor.train()
        self._played = []
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(_epoch_seed(self.seed, self.standing.epoch))  # dropout draws from it
            generator = torch.Generator().manual_seed(_epoch_seed(self.seed, self.standing.epoch))
            if self.predictor.memory.kind == "state":
                self._play_lanes(generator)
            else:
                self._play_minibatches(generator)

    def validate(self) -> float:
        """The loss over the scored validation samples."""
        scored = self.validation.scored
        predicted = (predict(self.predictor, self.validation) - self.predictor.force_mean)[scored]
        predicted = predicted / self.predictor.force_sd
        return self.loss(
            predicted, _normalised_force(self.predictor, self.validation)[scored]
        ).item()

    def tensors(self) -> dict[str, Tensor]:
        """Weights and optimiser state, to be restored by `restore`."""
        tensors = self.optimiser.tensors()
        saved = {f"model.{name}": value for name, value in self.predictor.state_dict().items()}
        return saved | {f"optimiser.{name}": value for name, value in tensors.items()}

    def restore(self, tensors: dict[str, Tensor], standing: Standing) -> None:
        """Continue where `tensors` and `standing` were saved. KeyError, ValueError: not ours."""
        saved: dict[str, dict[str, Tensor]] = {"model": {}, "optimiser": {}}
        for key, value in tensors.items():
            kind, _, name = key.partition(".")
            saved[kind][name] = value
        self.optimiser.restore(saved["optimiser"])
        self.predictor.load_state_dict(saved["model"])
        self.standing = standing

    def _play_minibatches(self, generator: torch.Generator) -> None:
        order, batch = shuffled(self.train, generator), self.settings.batch
        # Looked up once for the whole epoch.
        places = torch.split(self.seen.places(order), batch)
        targets = torch.split(self.target[order], batch)
        for at, (where, target) in enumerate(zip(places, targets, strict=True)):
            loss = self.loss(self.predictor.core(self.seen.lying_at(where)), target)
            self._descend(loss, len(where), at / len(places))

    def _play_lanes(self, generator: torch.Generator) -> None:
        """Truncated backpropagation: the state runs on over the cuts, the gradient stops there."""
        s = self.settings
        chunks = list(
            lanes(
                self.train,
                count=s.lanes,
                steps=s.chunk_steps,
                warm_up=self.warm_up,
                generator=generator,
            )
        )
        state = self.predictor.initial_state(len(chunks[0].fresh))
        for at, chunk in enumerate(chunks):
            state = self._play_chunk(chunk, state, at / len(chunks))

    def _play_chunk(self, chunk: Chunk, state: State, progress: float) -> State:
        state = {name: _renew(value, chunk.fresh) for name, value in state.items()}
        force, state = self.predictor.core(self.observation[chunk.index], state)  # (B, L, o)
        if chunk.scored.any():
            loss = self.loss(force, self.target[chunk.index], chunk.scored)
            self._descend(loss, chunk.scored.sum(), progress)
        return {name: value.detach() for name, value in state.items()}

    def _descend(self, loss: Tensor, samples: Tensor | int, progress: float) -> None:
        """One update, `progress` of the way through the present epoch."""
        self._played.append((loss.detach(), samples))
        rate = learning_rate(self.settings, self.standing.epoch + progress)
        self.optimiser.descend(loss, rate)

    def _descended(self) -> float:
        """The mean loss of the epoch's updates, each counted by its samples."""
        if not self._played:
            return math.nan
        losses = torch.stack([loss for loss, _ in self._played])
        samples = torch.tensor([float(count) for _, count in self._played]).to(losses)
        return float(losses @ samples / samples.sum())


def learning_rate(settings: FitSettings, epoch: float) -> float:
    """The rate after `epoch` epochs, a fraction included: linear rise, then cosine."""
    done = epoch / settings.epochs
    if done < _RISE:
        return settings.learning_rate * (_FLOOR + (1 - _FLOOR) * done / _RISE)
    cosine = 0.5 * (1 + math.cos(math.pi * (done - _RISE) / (1 - _RISE)))
    return settings.learning_rate * (_FLOOR + (1 - _FLOOR) * cosine)


def _epoch_seed(seed: int, epoch: int) -> int:
    return seed * 1_000_003 + epoch


def _renew(state: Tensor, fresh: Tensor) -> Tensor:
    """Zero where a lane begins anew: (B, …), (B,) -> (B, …)."""
    return torch.where(fresh.view(-1, *[1] * (state.dim() - 1)), 0.0, state)


def _normalised_force(predictor: Predictor, tape: Tape) -> Tensor:
    return (tape.force - predictor.force_mean) / predictor.force_sd
