"""The reservoir's readout, solved: ridge regression, its strength chosen on validation episodes.

The reservoir's activations are never stored. Both splits are reduced to their normal equations in
float64; the eigenvectors of the training one give the readout for every strength, and the
validation one gives its error (Hastie, Tibshirani & Friedman 2009, § 3.4.1).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from trainers.model import Predictor, SolvedModel, State
from trainers.training.loss import WeightedMse
from trainers.training.predict import play
from trainers.training.tape import Tape

# Strengths tried, as shares of the mean variance of an activation.
STRENGTHS = tuple(10.0**exponent for exponent in range(-9, 2))


@dataclass(frozen=True)
class Moments:
    """Averages over samples in float64: second moments about the mean, and the means.

    Shapes: gram (N, N), cross (N, o), power (o,), mean_in (N,), mean_out (o,).
    """

    gram: Tensor
    cross: Tensor
    power: Tensor
    mean_in: Tensor
    mean_out: Tensor

    def error(self, readout: Tensor, bias: Tensor) -> Tensor:
        """Mean squared error of a readout (N, o) with bias (o,), per output: (o,)."""
        misfit = self.mean_in @ readout + bias - self.mean_out  # (o,)
        explained = (readout * (self.gram @ readout - 2 * self.cross)).sum(0)  # (o,)
        return self.power + explained + misfit.square()


def moments(blocks: Iterable[tuple[Tensor, Tensor]]) -> Moments:
    """Normal equations of blocks of inputs (M, N) and targets (M, o), added up in float64."""
    gram = cross = power = total_in = total_out = torch.zeros((), dtype=torch.float64)
    count = 0
    for inputs, targets in blocks:
        x, y = inputs.double(), targets.double()
        gram, cross, power = gram + x.T @ x, cross + x.T @ y, power + y.square().sum(0)
        total_in, total_out, count = total_in + x.sum(0), total_out + y.sum(0), count + len(x)
    mean_in, mean_out = total_in / count, total_out / count
    return Moments(
        gram / count - torch.outer(mean_in, mean_in),
        cross / count - torch.outer(mean_in, mean_out),
        power / count - mean_out.square(),
        mean_in,
        mean_out,
    )


@dataclass(frozen=True)
class Solution:
    """What ridge regression found: readout (N, o) and bias (o,).

    Beside them the mean squared errors (S, o) at each of STRENGTHS, over the samples learned from
    and over those of validation, in the targets' units.
    """

    readout: Tensor
    bias: Tensor
    training: Tensor
    validation: Tensor


def ridge(train: Moments, validation: Moments) -> Solution:
    """The readout and bias that do best on validation, each output on its own."""
    values, vectors = torch.linalg.eigh(train.gram)
    turned = vectors.T @ train.cross  # (N, o)
    best_error = torch.full_like(train.mean_out, torch.inf)
    best, best_bias = torch.zeros_like(train.cross), train.mean_out.clone()
    learned, held_out = [], []
    for strength in STRENGTHS:
        damped = values.clamp(min=0) + strength * values.mean()
        readout = vectors @ (turned / damped.unsqueeze(1))  # (N, o)
        bias = train.mean_out - train.mean_in @ readout  # (o,)
        error = validation.error(readout, bias)
        learned.append(train.error(readout, bias))
        held_out.append(error)
        better = error < best_error
        best[:, better], best_bias[better] = readout[:, better], bias[better]
        best_error = torch.minimum(error, best_error)
    return Solution(best, best_bias, torch.stack(learned), torch.stack(held_out))


@torch.no_grad()
def solve_readout(
    predictor: Predictor, train: Tape, validation: Tape, loss_weights: Sequence[float]
) -> tuple[float, Solution]:
    """Set normalisation and readout of a solved core; its loss on validation, and the solution.

    The errors of the solution are those of normalised forces: 1 is predicting the mean.
    """
    core = predictor.core
    assert isinstance(core, SolvedModel)
    predictor.set_normalisation(train.observation, train.force)
    held_out = moments(_echoes(predictor, core, validation))
    found = ridge(moments(_echoes(predictor, core, train)), held_out)
    core.readout.weight.copy_(found.readout.T)
    core.readout.bias.copy_(found.bias)
    shares = WeightedMse(loss_weights, predictor.force_sd).shares
    return float((shares * held_out.error(found.readout, found.bias)).sum()), found


def _echoes(predictor: Predictor, core: SolvedModel, tape: Tape) -> Iterator[tuple[Tensor, Tensor]]:
    """Activations (M, N) and normalised forces (M, o) of the scored samples, block by block."""

    def run(observation: Tensor, state: State) -> tuple[Tensor, State]:
        return core.echoes(predictor.normalise(observation), state)

    for index, echoes in play(tape, core.initial_state, run):
        scored = tape.scored[index]
        force = (tape.force[index] - predictor.force_mean) / predictor.force_sd
        yield echoes[scored], force[scored]
