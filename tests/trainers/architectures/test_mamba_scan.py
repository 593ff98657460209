"""The parallel scan against the plain recurrence."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from trainers.architectures.mamba import Mamba, MambaHyper
from trainers.memory import Sizes
from trainers.recurrences.linear import linear_recurrence


def naive(decay: torch.Tensor, drive: torch.Tensor) -> torch.Tensor:
    h, history = torch.zeros_like(drive[0]), []
    for a, b in zip(decay, drive, strict=True):
        h = a * h + b
        history.append(h)
    return torch.stack(history)


@settings(max_examples=40, deadline=None)
@given(length=st.integers(1, 70), seed=st.integers(0, 1000), smallest=st.sampled_from([0.0, 0.9]))
def test_the_scan_and_its_gradient_are_those_of_the_recurrence(
    length: int, seed: int, smallest: float
) -> None:
    draw = torch.Generator().manual_seed(seed)
    shape = (length, 2, 3)
    decay = (smallest + (1 - smallest) * torch.rand(shape, generator=draw)).double()
    drive, pull = (torch.randn(shape, generator=draw).double() for _ in range(2))
    results = []
    for scan in (linear_recurrence, naive):
        a, b = decay.clone().requires_grad_(), drive.clone().requires_grad_()
        h = scan(a, b)
        (h * pull).sum().backward()
        results.append((h.detach(), a.grad, b.grad))
    for fast, slow in zip(*results, strict=True):
        torch.testing.assert_close(fast, slow, rtol=1e-10, atol=1e-10)


def test_vanishing_decays_do_no_harm() -> None:
    decay = torch.full((300, 1), 1e-30).requires_grad_()  # its inverse powers would overflow
    drive = torch.ones(300, 1)
    h = linear_recurrence(decay, drive)
    h.sum().backward()
    torch.testing.assert_close(h, torch.ones(300, 1))
    assert decay.grad.isfinite().all()


def test_gradients_through_the_block_are_those_of_the_steps() -> None:
    torch.manual_seed(0)
    made = Mamba(Sizes(3, 1, 31, 1, 30.0), MambaHyper()).double()
    observations = torch.randn(2, 25, 3).double()
    gradients = []
    for whole in (True, False):
        made.zero_grad()
        state = made.initial_state(2)
        if whole:
            forces = made(observations, state)[0]
        else:
            steps = []
            for observation in observations.unbind(1):
                force, state = made.step(observation, state)
                steps.append(force)
            forces = torch.stack(steps, 1)
        forces.square().sum().backward()
        gradients.append([p.grad.clone() for p in made.parameters()])
    for parallel, stepped in zip(*gradients, strict=True):
        torch.testing.assert_close(parallel, stepped, rtol=1e-8, atol=1e-10)
