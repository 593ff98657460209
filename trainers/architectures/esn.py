"""RC (ESN): a fixed random reservoir and a linear readout solved by ridge regression (Jaeger 2002).

h ← (1 − a) h + a tanh(W h + W_in (u + c)); force = W_out h + b. The constant c, added to every
normalised input, stands in for a bias per neuron. Without it h would be an odd function of the
input; a force that is the same left and right of the jet could not be read out of it.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from trainers.architecture import Architecture
from trainers.bounds import Bound
from trainers.dimensions import Dimension, Span
from trainers.memory import Memory, Sizes
from trainers.model import SolvedModel, State
from wakedeploy.core.errors import UnusableInput

_BESIDE = 500  # fixed functions of the present, beside a reservoir that is kept from some inputs


@dataclass(frozen=True)
class EsnHyper:
    """Hyper-parameters; 1000 neurons as in Table I, the rest estimates inside the usual ranges.

    `density` is the share of non-zero recurrent weights, `leak` is a, `input_scale` the spread of
    W_in's rows for unit inputs, `input_offset` is c.
    """

    neurons: int = 1000
    spectral_radius: float = 0.9
    leak: float = 0.5
    density: float = 0.1
    input_scale: float = 0.25
    input_offset: float = 1.0

    # The readout is solved: nothing of a descent is searched. How hard the input drives decides as
    # much as the paper's three: driven gently, a reservoir keeps the fine differences.
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Span("neurons", 100, 1500, log=True),
        Span("spectral_radius", 0.1, 1.5),
        Span("leak", 0.05, 1.0, log=True),
        Span("input_scale", 1e-4, 1.0, log=True),
    )
    # Tried beside the usual wherever a reservoir is chosen. It is solved in seconds and its scale
    # cannot be learned: driven gently it is nearly linear and remembers the fine differences
    # between samples, driven hard it mixes them.
    starts: ClassVar[tuple[Mapping[str, float], ...]] = (
        {"input_scale": 0.03},
        {"input_scale": 0.001, "leak": 0.3},
    )
    bounds: ClassVar[Mapping[str, Bound]] = {
        "neurons": Bound(1, 4000),  # N² recurrent weights: 64 MB, the largest package
        "spectral_radius": Bound(0, 10),
        "leak": Bound(0.001, 1),
        "density": Bound(0.001, 1),
        "input_scale": Bound(0, 100),
        "input_offset": Bound(0, 100),
    }


class Esn(SolvedModel):
    """Carries the reservoir's activations h (neurons,); only the readout is trained.

    `beside` is there only where the reservoir is kept from some inputs (`keep_from`).
    """

    amplifies_rounding = True  # by a thousand neurons

    def __init__(self, sizes: Sizes, hyper: EsnHyper) -> None:
        super().__init__()
        self.memory = Memory("state", states={"reservoir": (hyper.neurons,)})
        self.leak, self.offset = hyper.leak, hyper.input_offset
        self.recurrent = nn.Parameter(_recurrent_weights(hyper), requires_grad=False)
        spread = hyper.input_scale / sizes.inputs**0.5
        drawn = torch.empty(hyper.neurons, sizes.inputs).uniform_(-(3**0.5), 3**0.5)
        self.inward = nn.Parameter(spread * drawn, requires_grad=False)
        self.beside: nn.Linear | None = None
        self.readout = nn.Linear(hyper.neurons, sizes.outputs)

    @torch.no_grad()
    def keep_from(self, hidden: Sequence[int], outputs: int) -> None:
        """Let no past of the inputs `hidden` in, before anything is trained.

        The reservoir is driven by the others only. The readout, to `outputs` forces, sees the whole
        present observation beside it, as it is and through neurons that carry no state.
        """
        neurons, inputs = self.inward.shape
        self.inward[:, list(hidden)] = 0.0
        self.beside = nn.Linear(inputs, _BESIDE).requires_grad_(False)
        nn.init.normal_(self.beside.weight, std=inputs**-0.5)
        nn.init.normal_(self.beside.bias)
        self.readout = nn.Linear(neurons + _BESIDE + inputs, outputs)

    def echoes(self, sequence: Tensor, state: State) -> tuple[Tensor, State]:
        """All that the readout sees: (B, T, d) -> (B, T, N), next state.

        The reservoir's activations, and what is `beside` them.
        """
        driven = functional.linear(sequence + self.offset, self.inward)  # (B, T, N)
        h = state["reservoir"]  # (B, N)
        history = []
        for drive in driven.unbind(1):
            h = self._turn(h, drive)
            history.append(h)
        return self._joined(torch.stack(history, 1), sequence), {"reservoir": h}  # (B, T, N)

    def forward(self, sequence: Tensor, state: State | None = None) -> tuple[Tensor, State]:
        """(B, T, d), state -> (B, T, o), next state."""
        held = self.initial_state(len(sequence)) if state is None else state
        h, next_state = self.echoes(sequence, held)  # (B, T, N)
        return self.readout(h), next_state  # (B, T, o)

    def step(self, observation: Tensor, state: State) -> tuple[Tensor, State]:
        """(B, d), state -> (B, o), next state."""
        drive = functional.linear(observation + self.offset, self.inward)  # (B, N)
        h = self._turn(state["reservoir"], drive)  # (B, N)
        return self.readout(self._joined(h, observation)), {"reservoir": h}  # (B, o)

    def _joined(self, h: Tensor, observation: Tensor) -> Tensor:
        """The activations with the functions of the present: (…, N), (…, d) -> (…, N')."""
        if self.beside is None:
            return h
        return torch.cat([h, torch.tanh(self.beside(observation)), observation], -1)

    def _turn(self, h: Tensor, drive: Tensor) -> Tensor:
        """One turn of the reservoir: (B, N), (B, N) -> (B, N)."""
        excited = torch.tanh(functional.linear(h, self.recurrent) + drive)  # (B, N)
        return h + self.leak * (excited - h)  # (B, N)


_RADII: dict[bytes, float] = {}


def _radius(weights: Tensor) -> float:
    """The spectral radius, found once: whoever loads a trained reservoir draws the same again."""
    drawn = hashlib.sha256(weights.numpy().tobytes()).digest()
    if drawn not in _RADII:
        _RADII[drawn] = torch.linalg.eigvals(weights).abs().max().item()
    return _RADII[drawn]


def _recurrent_weights(hyper: EsnHyper) -> Tensor:
    """A sparse random matrix (N, N), scaled to the spectral radius that is asked for."""
    shape = (hyper.neurons, hyper.neurons)
    weights = torch.randn(shape) * (torch.rand(shape) < hyper.density)
    if weights.is_meta:  # only counted
        return weights
    radius = _radius(weights)
    if radius < 1e-3:  # weights are about 1, so nothing comes back to where it was
        raise UnusableInput(
            f"esn: {hyper.neurons} neurons at density = {hyper.density:g} were drawn without a"
            " loop and remember nothing; choose more neurons or a higher density."
        )
    return weights * (hyper.spectral_radius / radius)


ARCHITECTURE = Architecture(Esn, EsnHyper, training_s=5, colour="#8C564B", marker="X")
