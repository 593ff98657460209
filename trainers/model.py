"""The bases of the cores, and the Predictor: a core with its normalisation around it."""

from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from trainers.memory import Memory

State = dict[str, Tensor]

# How many gathered windows a rollout holds at once: bounds memory, does not change the result.
_WINDOWS_AT_ONCE = 16_384


class WakeModel(nn.Module):
    """A core in normalised units; `memory` says which `forward` it has.

    Shapes: none: (B, d) -> (B, o); window: (B, K, d), oldest first -> (B, o);
    state: see StateModel.
    """

    memory: Memory
    # Where rounding errors grow in the core, its own float32 error is the yardstick of its export.
    amplifies_rounding: ClassVar[bool] = False

    @property
    def trainable(self) -> int:
        """How many weights training may change."""
        return sum(p.numel() for p in self.parameters() if p.requires_grad)

    @property
    def frozen(self) -> int:
        """How many weights are drawn once and kept (the reservoir's)."""
        return sum(p.numel() for p in self.parameters() if not p.requires_grad)


class StateModel(WakeModel):
    """A core that carries tensors from step to step.

    Shapes: forward (B, T, d), state -> (B, T, o), next state; step (B, d), state -> (B, o), next
    state. `forward` over T samples and T calls of `step` compute the same thing.
    """

    def initial_state(self, batch: int) -> State:
        """Zeros for every state, batch first, on the weights' device."""
        like = next(self.parameters())
        return {n: like.new_zeros((batch, *shape)) for n, shape in self.memory.states.items()}

    def forward(self, sequence: Tensor, state: State | None = None) -> tuple[Tensor, State]:
        """Whole sequences, as fast as the architecture allows."""
        raise NotImplementedError

    def step(self, observation: Tensor, state: State) -> tuple[Tensor, State]:
        """One sample; by default a sequence of length one."""
        force, next_state = self(observation.unsqueeze(1), state)  # (B, 1, o)
        return force.squeeze(1), next_state


class SolvedModel(StateModel):
    """A core that is drawn once; only its linear `readout` is trained, by ridge regression."""

    readout: nn.Linear

    def echoes(self, sequence: Tensor, state: State) -> tuple[Tensor, State]:
        """All that the readout sees: (B, T, d) -> (B, T, N), next state."""
        raise NotImplementedError

    def keep_from(self, hidden: Sequence[int], outputs: int) -> None:
        """Let no past of the inputs `hidden` in, before anything is trained; `outputs` forces."""
        raise NotImplementedError


class Predictor(nn.Module):
    """A core with normalisation: SI in, SI out; this is what is trained, saved and exported.

    Buffers: observation_mean, observation_sd (d,), force_mean, force_sd (o,), all in the
    channels' own units.
    """

    observation_mean: Tensor
    observation_sd: Tensor
    force_mean: Tensor
    force_sd: Tensor

    def __init__(self, arch: str, core: WakeModel, inputs: int, outputs: int) -> None:
        super().__init__()
        self.arch = arch
        self.core = core
        self.register_buffer("observation_mean", torch.zeros(inputs))
        self.register_buffer("observation_sd", torch.ones(inputs))
        self.register_buffer("force_mean", torch.zeros(outputs))
        self.register_buffer("force_sd", torch.ones(outputs))

    @property
    def memory(self) -> Memory:
        """The core's memory."""
        return self.core.memory

    @property
    def trainable(self) -> int:
        """How many weights training may change."""
        return self.core.trainable

    @property
    def frozen(self) -> int:
        """How many weights are drawn once and kept."""
        return self.core.frozen

    @property
    def state_core(self) -> StateModel:
        """The core, known to carry state; TypeError when it does not."""
        if not isinstance(self.core, StateModel):
            raise TypeError(f"{self.arch} has memory '{self.memory.kind}' and carries no state")
        return self.core

    def set_normalisation(self, observation: Tensor, force: Tensor) -> None:
        """Take mean and standard deviation per channel from training samples (N, d), (N, o)."""
        for name, samples in (("observation", observation), ("force", force)):
            wide = samples.double()  # a float32 sum over hours of samples loses digits
            getattr(self, f"{name}_mean").copy_(wide.mean(0))
            getattr(self, f"{name}_sd").copy_(_usable_spread(wide))

    def normalise(self, observation: Tensor) -> Tensor:
        """SI observations (..., d) -> zero mean, unit spread."""
        return (observation - self.observation_mean) / self.observation_sd

    def denormalise(self, force: Tensor) -> Tensor:
        """The core's output (..., o) -> SI."""
        return force * self.force_sd + self.force_mean

    def initial_state(self, batch: int) -> State:
        """The state before the first sample; empty for a predictor that carries none."""
        return self.core.initial_state(batch) if isinstance(self.core, StateModel) else {}

    def step(self, observation: Tensor, state: State | None = None) -> Any:
        """One prediction in SI, by memory.

        Shapes: none (B, d) -> (B, o); window (B, K, d) -> (B, o); state (B, d), state -> (B, o),
        next state.
        """
        if self.memory.kind != "state":
            return self.denormalise(self.core(self.normalise(observation)))
        core = self.state_core
        held = core.initial_state(len(observation)) if state is None else state
        force, next_state = core.step(self.normalise(observation), held)
        return self.denormalise(force), next_state

    forward = step

    def advance(self, observations: Tensor, state: State) -> tuple[Tensor, State]:
        """The training-time forward of a state predictor over (B, T, d), state carried on."""
        force, next_state = self.state_core(self.normalise(observations), state)
        return self.denormalise(force), next_state

    def rollout(self, observations: Tensor) -> Tensor:
        """Forces over whole sequences from a cold start: (B, T, d) -> (B, T, o), SI.

        Window predictors see the first observation repeated until the window has filled.
        """
        if self.memory.kind == "state":
            return self.advance(observations, self.initial_state(len(observations)))[0]
        batch, length, _ = observations.shape
        if self.memory.kind == "none":
            forces: Tensor = self.step(observations.flatten(0, 1))  # (B·T, o)
            return forces.view(batch, length, -1)
        return torch.stack([self._rollout_windows(episode) for episode in observations])

    def _rollout_windows(self, observations: Tensor) -> Tensor:
        """One sequence (T, d) -> (T, o), windows gathered a block at a time."""
        indices = window_indices(torch.arange(len(observations)), self.memory)  # (T, K)
        return torch.cat(
            [self.step(observations[block]) for block in torch.split(indices, _WINDOWS_AT_ONCE)]
        )


def window_indices(newest: Tensor, memory: Memory) -> Tensor:
    """Where each window's snapshots lie: (B,) newest samples -> (B, K), oldest first.

    Samples before the first one are replaced by it.
    """
    ages = torch.arange(memory.k - 1, -1, -1, device=newest.device) * memory.stride  # (K,)
    return (newest.unsqueeze(1) - ages).clamp(min=0)


def _usable_spread(samples: Tensor) -> Tensor:
    """Standard deviation per channel; 1 where a channel never moves."""
    spread = samples.std(0, unbiased=False)
    floor = 1e-7 * samples.abs().amax(0)
    return torch.where(spread > floor, spread, torch.ones_like(spread))
