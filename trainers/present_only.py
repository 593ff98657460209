"""A predictor that is kept from the past of some channels.

A memory of the sufferer's own motion lets a model differentiate its way to a force without knowing
anything of wakes. Here the core sees only the other channels and sums up their past in a few
numbers; a small network joins these with the whole present observation. A reservoir
stays one, with its readout solved: the other channels drive it, and the present stands beside it.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from trainers.architectures.agile_mlp import mlp
from trainers.model import SolvedModel, State, StateModel, WakeModel
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import PARAMETER_BUDGET

CODE = 16  # numbers in which the core sums up the past
_HIDDEN, _LAYERS = 64, 2


class _Joint(nn.Module):
    """Hides channels from a core's input, and joins its output with the whole observation."""

    shown: Tensor

    def __init__(self, hidden: Sequence[int], inputs: int, outputs: int) -> None:
        super().__init__()
        shown = torch.ones(inputs)
        shown[list(hidden)] = 0.0
        self.register_buffer("shown", shown, persistent=False)
        self.head = mlp(inputs + CODE, _HIDDEN, _LAYERS, outputs)

    def join(self, present: Tensor, code: Tensor) -> Tensor:
        """(…, d), (…, CODE) -> (…, o)."""
        force: Tensor = self.head(torch.cat([present, code], -1))
        return force


class PresentOnlyWindow(WakeModel):
    """Around a window core: (B, K, d) -> (B, o)."""

    def __init__(self, core: WakeModel, joint: _Joint) -> None:
        super().__init__()
        self.memory, self.core, self.joint = core.memory, core, joint

    def forward(self, window: Tensor) -> Tensor:
        """(B, K, d), oldest first -> (B, o)."""
        return self.joint.join(window[:, -1], self.core(window * self.joint.shown))


class PresentOnlyState(StateModel):
    """Around a core that carries state; the state is the core's."""

    def __init__(self, core: StateModel, joint: _Joint) -> None:
        super().__init__()
        self.memory, self.core, self.joint = core.memory, core, joint

    def forward(self, sequence: Tensor, state: State | None = None) -> tuple[Tensor, State]:
        """(B, T, d), state -> (B, T, o), next state."""
        code, next_state = self.core(sequence * self.joint.shown, state)
        return self.joint.join(sequence, code), next_state

    def step(self, observation: Tensor, state: State) -> tuple[Tensor, State]:
        """(B, d), state -> (B, o), next state."""
        code, next_state = self.core.step(observation * self.joint.shown, state)
        return self.joint.join(observation, code), next_state


def present_only(
    core: WakeModel, hidden: Sequence[int], inputs: int, outputs: int, seed: int
) -> WakeModel:
    """The core, built for CODE outputs, kept from the past of channels `hidden`: d in, o out.

    Raises UnusableInput for a core without memory, and beyond the parameter budget.
    """
    if core.memory.kind == "none":
        raise UnusableInput("A model without memory sees no channel's past: nothing can be hidden.")
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        joint = _Joint(hidden, inputs, outputs)
        if isinstance(core, SolvedModel):
            core.keep_from(hidden, outputs)
    made: WakeModel
    if isinstance(core, SolvedModel):
        made = core
    elif isinstance(core, StateModel):
        made = PresentOnlyState(core, joint)
    else:
        made = PresentOnlyWindow(core, joint)
    if made.trainable >= PARAMETER_BUDGET:
        raise UnusableInput(
            f"{made.trainable:,} trainable parameters with the network for the present, and the"
            f" budget is fewer than {PARAMETER_BUDGET:,}; choose smaller hyper-parameters."
        )
    return made
