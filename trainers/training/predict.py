"""A predictor over whole tapes, every episode from a cold start."""

from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from trainers.memory import Memory
from trainers.model import Predictor, State
from trainers.training.tape import Tape

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
        seen = Seen(tape.observation, tape.first, predictor.memory)
        everywhere = torch.arange(len(forces), device=forces.device)
        for index in everywhere.split(_SAMPLES_AT_ONCE):  # type: ignore[no-untyped-call]
            forces[index] = predictor.step(seen.at(index))
    predictor.train(was_training)
    return forces


class Seen:
    """What a predictor without carried state sees at each sample of a tape.

    Of observations (N, d), and where each one's episode begins (N,). Windows are parts of those
    observations, in which each episode is led by its first one, repeated, so that the windows at
    its beginning are whole: they cost no index per snapshot.
    """

    def __init__(self, observation: Tensor, first: Tensor, memory: Memory) -> None:
        self._memory = memory
        reach = (memory.k - 1) * memory.stride  # samples behind the newest
        begins = first == torch.arange(len(first), device=first.device)  # (N,)
        self._oldest = torch.arange(len(first), device=first.device)
        self._oldest += reach * (begins.cumsum(0) - 1)  # (N,)
        led = observation.repeat_interleave(1 + reach * begins, 0)  # (N + episodes · reach, d)
        width = observation.shape[1]
        self._every = led.as_strided(
            (len(led) - reach, memory.k, width), (width, memory.stride * width, 1)
        )  # (N', K, d)

    def at(self, newest: Tensor) -> Tensor:
        """At samples (B,): (B, d), or windows (B, K, d), oldest first."""
        return self.lying_at(self.places(newest))

    def places(self, newest: Tensor) -> Tensor:
        """Where that lies: (B,) -> (B,)."""
        return self._oldest[newest]

    def lying_at(self, places: Tensor) -> Tensor:
        """What lies there: (B,) -> (B, d), or windows (B, K, d), oldest first."""
        seen = self._every.index_select(0, places)  # (B, K, d)
        return seen.squeeze(1) if self._memory.kind == "none" else seen


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
