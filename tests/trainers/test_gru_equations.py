"""The GRU's written-out step against torch's own unit."""

import torch
from torch import nn

from trainers.gru import Gru, GruHyper
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
