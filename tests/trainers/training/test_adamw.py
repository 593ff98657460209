"""One tensor's AdamW against torch's own, parameter by parameter."""

import copy

import pytest
import torch
from torch import Tensor, nn

from trainers.build import build
from trainers.model import Predictor
from trainers.training.adamw import AdamW

DECAY, CLIP = 0.1, 0.5


def fresh() -> Predictor:
    core = build(
        "delay-embedding", inputs=3, outputs=2, window_s=0.5, rate_hz=20.0, hyper={}, seed=0
    )
    return Predictor("delay-embedding", core, 3, 2)


def loss_of(predictor: Predictor, step: int) -> Tensor:
    """Large for some steps and small for others, so that the gradient is clipped now and then."""
    draws = torch.Generator().manual_seed(step)
    window = torch.randn(16, predictor.memory.k, 3, generator=draws)
    wanted = torch.randn(16, 2, generator=draws)
    return (predictor.core(window) - wanted).square().mean() * (10.0 if step % 3 else 0.01)


def rate_of(step: int) -> float:
    return 1e-2 / (1 + step)


def plain(predictor: Predictor, steps: int) -> None:
    trained = [p for p in predictor.parameters() if p.requires_grad]
    groups = [
        {"params": [p for p in trained if p.dim() > 1], "weight_decay": DECAY},
        {"params": [p for p in trained if p.dim() <= 1], "weight_decay": 0.0},
    ]
    optimiser = torch.optim.AdamW(groups)
    clipped = 0
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = rate_of(step)
        optimiser.zero_grad()
        loss_of(predictor, step).backward()
        clipped += int(nn.utils.clip_grad_norm_(trained, CLIP) > CLIP)
        optimiser.step()
    assert 0 < clipped < steps


def test_it_goes_where_torchs_own_goes() -> None:
    ours, theirs = fresh(), fresh()
    began = copy.deepcopy(ours.state_dict())
    optimiser = AdamW(ours, decay=DECAY, clip=CLIP)
    for step in range(30):
        optimiser.descend(loss_of(ours, step), rate_of(step))
    plain(theirs, 30)
    for name, value in theirs.state_dict().items():
        torch.testing.assert_close(ours.state_dict()[name], value, rtol=1e-4, atol=1e-5)
    moved = [n for n, v in began.items() if not torch.allclose(v, ours.state_dict()[n], atol=1e-3)]
    assert {"core.delay_s", "core.log_spread"} <= set(moved)


def test_it_goes_on_exactly_where_its_state_was_saved() -> None:
    whole, parted = fresh(), fresh()
    optimiser = AdamW(whole, decay=DECAY, clip=CLIP)
    for step in range(10):
        optimiser.descend(loss_of(whole, step), rate_of(step))
        if step == 4:
            weights = copy.deepcopy(whole.state_dict())
            state = {name: value.clone() for name, value in optimiser.tensors().items()}
    later = AdamW(parted, decay=DECAY, clip=CLIP)
    parted.load_state_dict(weights)
    later.restore(state)
    for step in range(5, 10):
        later.descend(loss_of(parted, step), rate_of(step))
    for name, value in whole.state_dict().items():
        assert torch.equal(parted.state_dict()[name], value), name


def test_the_state_of_other_weights_is_refused() -> None:
    optimiser = AdamW(fresh(), decay=DECAY, clip=CLIP)
    cut = {
        name: value[:-1] if value.dim() else value for name, value in optimiser.tensors().items()
    }
    with pytest.raises(ValueError, match="not those of these weights"):
        optimiser.restore(cut)
