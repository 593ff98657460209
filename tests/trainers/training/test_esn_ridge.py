"""The reservoir's properties, and its readout against numpy's least squares."""

import numpy as np
import pytest
import torch

from trainers.architectures.esn import Esn
from trainers.build import build
from trainers.model import Predictor
from trainers.training import ridge as ridge_module
from trainers.training.ridge import moments, ridge, solve_readout
from trainers.training.tape import lay_tape
from wakedeploy.core.episodes import EpisodeSet


def blocks(x: np.ndarray, y: np.ndarray, size: int = 70):
    for at in range(0, len(x), size):
        yield torch.tensor(x[at : at + size]), torch.tensor(y[at : at + size])


def regression(seed: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(seed)
    x = draw.normal(size=(samples, 12)) + 3
    return x, x @ np.linspace(-1, 1, 24).reshape(12, 2) + 7 + 0.5 * draw.normal(size=(samples, 2))


@pytest.mark.parametrize("strength", [1e-9, 1e-3, 1.0])
def test_ridge_solves_the_augmented_least_squares_problem(
    strength: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ridge_module, "STRENGTHS", (strength,))
    x, y = regression(0, 300)
    found = ridge(moments(blocks(x, y)), moments(blocks(x, y)))
    readout, bias = found.readout, found.bias
    centred = x - x.mean(0)
    damping = np.sqrt(strength * np.mean(np.var(x, axis=0)) * len(x)) * np.eye(12)
    expected = np.linalg.lstsq(
        np.vstack([centred, damping]), np.vstack([y - y.mean(0), np.zeros((12, 2))]), rcond=None
    )[0]
    np.testing.assert_allclose(readout, expected, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(bias, y.mean(0) - x.mean(0) @ expected, rtol=1e-8)


def test_the_error_from_moments_is_the_error_over_samples() -> None:
    x, y = regression(1, 150)
    readout, bias = torch.randn(12, 2).double(), torch.randn(2).double()
    direct = ((torch.tensor(x) @ readout + bias - torch.tensor(y)) ** 2).mean(0)
    torch.testing.assert_close(moments(blocks(x, y)).error(readout, bias), direct)


def test_the_strength_is_chosen_on_validation() -> None:
    x, y = regression(2, 14)  # barely more samples than weights: unregularised overfits
    held_x, held_y = regression(3, 500)
    found = ridge(moments(blocks(x, y)), moments(blocks(held_x, held_y)))
    readout, bias = found.readout, found.bias
    plain = np.linalg.lstsq(np.c_[x, np.ones(len(x))], y, rcond=None)[0]
    chosen = np.square(held_x @ readout.numpy() + bias.numpy() - held_y).mean()
    assert chosen < np.square(np.c_[held_x, np.ones(500)] @ plain - held_y).mean()


def test_the_reservoir_has_the_spectral_radius_and_density_asked_for() -> None:
    core = build(
        "esn",
        inputs=2,
        outputs=1,
        window_s=0.5,
        rate_hz=20.0,
        hyper={"neurons": 200, "spectral_radius": 0.7, "density": 0.2},
    )
    assert isinstance(core, Esn)
    weights = core.recurrent.numpy()
    assert np.abs(np.linalg.eigvals(weights)).max() == pytest.approx(0.7, rel=1e-4)
    assert np.mean(weights != 0) == pytest.approx(0.2, abs=0.02)


def test_the_solved_readout_is_that_of_stored_activations(echo: EpisodeSet) -> None:
    core = build("esn", inputs=2, outputs=1, window_s=0.5, rate_hz=20.0, hyper={"neurons": 80})
    made = Predictor("esn", core, 2, 1)
    tape, held_out = (lay_tape(echo, s, 0.0, echo.warm_up_steps) for s in ("train", "validation"))
    frozen = core.recurrent.clone()
    loss, _ = solve_readout(made, tape, held_out, (1.0,))
    assert torch.equal(frozen, core.recurrent)
    stored, wanted = [], []
    for start, length in zip(tape.starts, tape.lengths, strict=True):
        part = slice(start, start + length)
        echoes, _ = core.echoes(made.normalise(tape.observation[part])[None], core.initial_state(1))
        stored.append(echoes[0, echo.warm_up_steps :])
        wanted.append(((tape.force[part] - made.force_mean) / made.force_sd)[echo.warm_up_steps :])
    x = torch.cat(stored).double().numpy()
    residual = torch.cat(wanted).double().numpy() - (
        x @ core.readout.weight.double().numpy(force=True).T
        + core.readout.bias.double().numpy(force=True)
    )
    # At the ridge optimum the residual's correlation with each activation is strength · readout.
    pull = (x - x.mean(0)).T @ residual / len(x)
    assert np.corrcoef(pull[:, 0], core.readout.weight.numpy(force=True)[0])[0, 1] > 0.999
    assert 0 < loss < 0.2
