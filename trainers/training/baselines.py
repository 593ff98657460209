"""What a predictor has to beat: forecasts that anyone can make, on the same samples.

They are zero, the mean force of the training episodes, and ridge regression with an intercept: on
the observations of one tick, and on the window that window models see. A set may also carry an
observer that tells the force from the sufferer's motion.
"""

from collections.abc import Iterator

import torch
from torch import Tensor

from trainers.memory import Memory
from trainers.training.predict import Seen
from trainers.training.ridge import Moments, moments, ridge
from trainers.training.score import Score, compared, unlearned_forces
from trainers.training.tape import Tape, lay_tape
from wakedeploy.core.episodes import EpisodeSet, window_shape
from wakedeploy.core.errors import UnusableInput

ZERO, MEAN, TICK, WINDOW = "zero", "training mean", "linear, one tick", "linear, window"

_SAMPLES_AT_ONCE = 4_096  # bounds memory


def baselines(
    data: EpisodeSet, split: str, lead_s: float, warm_up: int | None = None, *, fitted: bool = True
) -> dict[str, Score]:
    """The error of each by name, in SI, over the samples on which predictors are scored.

    What is `fitted` learns from the set's own training episodes, after the same warm-up in samples.
    Raises UnusableInput where a split has no episode that is long enough.
    """
    steps = data.warm_up_steps if warm_up is None else warm_up
    tape = lay_tape(data, split, lead_s, steps)
    forces = unlearned_forces(tape, data, split, lead_s, steps)
    if fitted:
        learned = tape if split == "train" else lay_tape(data, "train", lead_s, steps)
        validation = _validation(data, split, tape, lead_s, steps)
        k, stride = window_shape(data.window_s, data.rate_hz)
        mean = learned.force[learned.scored].double().mean(0)  # (o,)
        forces = {
            ZERO: forces.pop(ZERO),
            MEAN: mean.float().expand_as(tape.force),
            TICK: linear_forces(learned, validation, tape, Memory("none")),
            WINDOW: linear_forces(learned, validation, tape, Memory("window", k=k, stride=stride)),
            **forces,
        }
    return {name: compared(each, tape, data, split, lead_s, steps) for name, each in forces.items()}


def _validation(
    data: EpisodeSet, split: str, tape: Tape, lead_s: float, warm_up: int
) -> Tape | None:
    """The validation episodes, if any is long enough."""
    if split == "validation":
        return tape
    try:
        return lay_tape(data, "validation", lead_s, warm_up)
    except UnusableInput:
        return None


@torch.no_grad()
def linear_forces(learned: Tape, validation: Tape | None, tape: Tape, memory: Memory) -> Tensor:
    """Forces (N, o) for every sample of `tape`, linear in what `memory` sees.

    Weights are those of ridge regression over the samples of `learned`, as strong as does best on
    `validation`: of a few short logs, plain least squares would be no bar at all. Without
    validation they are those of least squares; of all that fit equally well, the smallest.
    """
    centre = learned.observation.double().mean(0)  # (d,)
    spread = learned.observation.double().std(0, unbiased=False)  # (d,)
    moves = spread > 0  # (d,)

    def inputs(of: Tape, which: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
        """Samples (M,) and what is seen at them, in units of its spread: (M, d) or (M, K · d)."""
        seen = Seen(of.observation, of.first, memory)
        for at in which.split(_SAMPLES_AT_ONCE):  # type: ignore[no-untyped-call]
            far = seen.at(at).double() - centre
            yield at, (far[..., moves] / spread[moves]).flatten(1)

    def scored(of: Tape) -> Moments:
        which = torch.nonzero(of.scored).squeeze(1)
        return moments((x, of.force[at]) for at, x in inputs(of, which))

    found = scored(learned)
    if validation is None:
        weights = torch.linalg.pinv(found.gram, hermitian=True) @ found.cross  # (N, o)
        bias = found.mean_out - found.mean_in @ weights  # (o,)
    else:
        solved = ridge(found, scored(validation))
        weights, bias = solved.readout, solved.bias
    forces = torch.empty_like(tape.force)
    for at, x in inputs(tape, torch.arange(len(forces))):
        forces[at] = (x @ weights + bias).float()
    return forces
