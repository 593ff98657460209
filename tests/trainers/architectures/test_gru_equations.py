"""The GRU's written-out step against torch's own unit."""

import pytest
import torch
from torch import nn

from trainers.architectures.gru import Gru, GruHyper
from trainers.memory import Sizes


@torch.no_grad()
def test_the_step_computes_what_torchs_gru_computes() -> None:
    torch.manual_seed(0)
    made = Gru(Sizes(4, 2, 31, 1, 30.0), GruHyper()).double()
    observations, hidden = torch.randn(3, 40, 4).double(), torch.randn(3, 128).double()
    reference = nn.GRU(32, 128, batch_first=True).double()
    reference.load_state_dict(made.gru.state_dict())
    expected, last = reference(made.projection(observations), hidden[None])
    state = {"hidden": hidden}
    for t in range(40):
        force, state = made.step(observations[:, t], state)
        torch.testing.assert_close(state["hidden"], expected[:, t], rtol=0, atol=1e-12)
        torch.testing.assert_close(force, made.head(expected[:, t]), rtol=0, atol=1e-12)
    torch.testing.assert_close(state["hidden"], last[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("steps", [1, 2, 33])
def test_the_gradient_over_a_sequence_is_torchs_own(steps: int) -> None:
    torch.manual_seed(0)
    made = Gru(Sizes(4, 2, 31, 1, 30.0), GruHyper(hidden=16)).double()
    observations, hidden, pull = (
        torch.randn(s).double() for s in ((3, steps, 4), (3, 16), (3, 16))
    )
    given = (observations.requires_grad_(), hidden.requires_grad_())
    found = []
    for torchs in (True, False):
        if torchs:
            history, last = made.gru(made.projection(observations), hidden[None])
            forces, last = made.head(history), last[0]
        else:
            forces, state = made(observations, {"hidden": hidden})
            last = state["hidden"]
        cost = forces.square().sum() + (last * pull).sum()
        gradients = torch.autograd.grad(cost, [*made.parameters(), *given])
        found.append([forces, last, *gradients])
    for theirs, ours in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-10, atol=1e-12)
