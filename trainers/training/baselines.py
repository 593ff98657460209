"""What a predictor has to beat: forecasts that anyone can make, on the same samples.

They are zero, the mean force of the training episodes, and least squares with an intercept: on the
observations of one tick, and on the window that window models see. A set may also carry an observer
that tells the force from the sufferer's motion.
"""

from collections.abc import Iterator

import torch
from torch import Tensor

from trainers.memory import Memory
from trainers.training.predict import Seen
from trainers.training.ridge import moments
from trainers.training.score import Score, compared, unlearned_forces
from trainers.training.tape import Tape, lay_tape
from wakedeploy.core.episodes import EpisodeSet, window_shape

MEAN, TICK, WINDOW = "training mean", "linear, one tick", "linear, window"

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
        k, stride = window_shape(data.window_s, data.rate_hz)
        mean = learned.force[learned.scored].double().mean(0)  # (o,)
        forces = {
            "zero": forces.pop("zero"),
            MEAN: mean.float().expand_as(tape.force),
            TICK: linear_forces(learned, tape, Memory("none")),
            WINDOW: linear_forces(learned, tape, Memory("window", k=k, stride=stride)),
            **forces,
        }
    return {name: compared(each, tape, data, split, lead_s, steps) for name, each in forces.items()}


@torch.no_grad()
def linear_forces(learned: Tape, tape: Tape, memory: Memory) -> Tensor:
    """Forces (N, o) for every sample of `tape`, by least squares over the samples of `learned`.

    Of all weights that fit equally well, as where a channel never changes, it takes the least.
    """
    centre = learned.observation.double().mean(0)  # (d,)
    spread = learned.observation.double().std(0, unbiased=False)  # (d,)
    spread[spread == 0] = 1.0

    def inputs(of: Tape, which: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
        """Samples (M,) and what is seen at them, in units of its spread: (M, d) or (M, K · d)."""
        seen = Seen(of.observation, of.first, memory)
        for at in which.split(_SAMPLES_AT_ONCE):  # type: ignore[no-untyped-call]
            yield at, ((seen.at(at).double() - centre) / spread).flatten(1)

    scored = torch.nonzero(learned.scored).squeeze(1)
    found = moments((x, learned.force[at]) for at, x in inputs(learned, scored))
    weights = torch.linalg.pinv(found.gram, hermitian=True) @ found.cross  # (N, o)
    bias = found.mean_out - found.mean_in @ weights  # (o,)
    forces = torch.empty_like(tape.force)
    for at, x in inputs(tape, torch.arange(len(forces))):
        forces[at] = (x @ weights + bias).float()
    return forces
