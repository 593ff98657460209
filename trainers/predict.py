"""A predictor over whole tapes, every episode from a cold start."""

from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from trainers.model import Predictor, State, window_indices
from trainers.tape import Tape

# Sizes that bound memory; they do not change what is computed.
_EPISODES_AT_ONCE = 32
_STEPS_AT_ONCE = 256
_SAMPLES_AT_ONCE = 8_192

Run = Callable[[Tensor, State], tuple[Tensor, State]]


@torch.no_grad()
def predict(predictor: Predictor, tape: Tape) -> Tensor:
    """Forces in SI for every sample of the tape: (N, o)."""
    was_training = predictor.training
    predictor.eval()
    forces = torch.empty_like(tape.force)
    if predictor.memory.kind == "state":
        for index, force in play(tape, predictor.initial_state, predictor.advance):
            forces[index] = force
    else:
        everywhere = torch.arange(len(forces), device=forces.device)
        for index in everywhere.split(_SAMPLES_AT_ONCE):  # type: ignore[no-untyped-call]
            forces[index] = predictor.step(gather(predictor, tape.observation, index, tape.first))
    predictor.train(was_training)
    return forces


def gather(predictor: Predictor, observation: Tensor, newest: Tensor, first: Tensor) -> Tensor:
    """What a predictor without carried state sees at samples (B,): (B, d) or (B, K, d)."""
    if predictor.memory.kind == "none":
        return observation[newest]
    return observation[window_indices(newest, predictor.memory, first[newest])]


def play(
    tape: Tape, initial_state: Callable[[int], State], run: Run
) -> Iterator[tuple[Tensor, Tensor]]:
    """Every episode through `run`, many side by side: sample indices (M,) and outputs (M, …)."""
    by_length = sorted(range(len(tape.lengths)), key=lambda i: tape.lengths[i])
    for at in range(0, len(by_length), _EPISODES_AT_ONCE):
        which = by_length[at : at + _EPISODES_AT_ONCE]
        yield from _lockstep(tape, which, initial_state(len(which)), run)


def _lockstep(
    tape: Tape, which: list[int], state: State, run: Run
) -> Iterator[tuple[Tensor, Tensor]]:
    """Some episodes in lockstep; the shorter ones repeat their last sample at the end, unseen."""
    at_home = tape.first.new_tensor  # on the tape's device
    start = at_home([tape.starts[i] for i in which]).unsqueeze(1)  # (B, 1)
    last = start + at_home([tape.lengths[i] for i in which]).unsqueeze(1) - 1  # (B, 1)
    for at in range(0, max(tape.lengths[i] for i in which), _STEPS_AT_ONCE):
        index = start + torch.arange(at, at + _STEPS_AT_ONCE, device=start.device)  # (B, L)
        inside = index <= last  # (B, L)
        outputs, state = run(tape.observation[torch.minimum(index, last)], state)  # (B, L, …)
        yield index[inside], outputs[inside]
