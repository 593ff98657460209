"""A model asked far ahead: few readings of a forecast are looked at, and no push lasts."""

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap import workflow
from wakedeploy.gap.evidence.inference import neutral
from wakedeploy.gap.search import judging
from wakedeploy.gap.search.artefacts import Answer, read
from wakedeploy.gap.search.judging import Named, fitted_base, named
from wakedeploy.gap.systems.correction import read_correction
from wakedeploy.gap.systems.logs import LogModel
from wakedeploy.gap.systems.own_folder import CORRECTION, OwnFolder
from wakedeploy.gap.systems.words import sentences

RATE = 50.0
FRICTION = "coulomb-friction@speed_mps"


class Cart(System):
    """A cart on a spring; two sensors show where it is."""

    rate_hz = RATE
    forecast_s = 0.6
    inputs: ClassVar = [Input("force_n", "N")]
    states: ClassVar = {"position_m": "m", "speed_mps": "m/s"}
    outputs: ClassVar = [
        Output("position_m", "m", noise=1e-3),
        Output("seldom_m", "m", noise=2e-3),
    ]
    constants: ClassVar = [Constant("mass_kg", 2.0, spread=0.05)]
    ports: ClassVar = [
        Port.force("speed_mps", inertia="mass_kg", kinds=["coulomb-friction"]),
    ]

    def derivative(self, state, inputs, c):
        push = inputs.force_n - 30.0 * state.position_m - 3.0 * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": push / c.mass_kg}

    def measure(self, state, inputs, c):
        return {"position_m": state.position_m, "seldom_m": state.position_m}


def recorded(friction_n=0.0, samples=960):
    """The cart in fine steps; the second sensor reads every fourth time."""
    rng = np.random.default_rng(2)
    force = np.repeat(rng.normal(0.0, 12.0, samples // 25 + 1), 25)[:samples]
    x = v = 0.0
    shown = np.empty(samples)
    for k in range(samples):
        shown[k] = x
        for _ in range(20):
            v += (force[k] - 30.0 * x - 3.0 * v) / 2.0 / RATE / 20
            v -= np.clip(v, -(friction_n / 2.0) / RATE / 20, (friction_n / 2.0) / RATE / 20)
            x += v / RATE / 20
    seldom = np.where(np.arange(samples) % 4 == 1, shown, np.nan)
    noisy = {
        "force_n": force,
        "position_m": shown + 1e-3 * rng.standard_normal(samples),
        "seldom_m": seldom + 2e-3 * rng.standard_normal(samples),
    }
    return Recording("cart", np.arange(samples) / RATE, noisy)


@pytest.fixture(scope="module")
def rubbing():
    """With 3 N of dry friction."""
    return LogModel(Cart(), [recorded(3.0)])


def test_six_readings_of_a_forecast_are_looked_at(rubbing):
    """Of the seldom sensor the first in each sixth; each forecast begins at a reading."""
    far = rubbing.far_ahead()
    run = far.run((), neutral(far.free(()))[None], [4])
    scored = run.pieces.scored[:, 0]
    often, seldom = (run.statistics[2, :, m, 0, 0] != 0.0 for m in (0, 1))
    assert rubbing.horizon == 30
    assert list(np.flatnonzero(often & scored) % 5) == [0] * 12
    assert 10 <= (seldom & scored).sum() <= 12
    assert often[~scored].sum() > 50  # by which the filter has settled
    begins = np.arange(len(scored)) % rubbing.horizon == 0
    assert np.all(often[begins & scored])


def test_nothing_lasts(rubbing):
    free = [f.name for f in rubbing.far_ahead().free(())]
    assert "push.speed_mps" in [f.name for f in rubbing.free(())]
    assert not any(n.startswith(("push.", "lasting.")) for n in free)


def test_the_likelihood_is_a_kalman_filter_s_that_sees_every_fifth_reading():
    class Plain(Cart):
        outputs: ClassVar = Cart.outputs[:1]

        def measure(self, state, inputs, c):
            return {"position_m": state.position_m}

    far = LogModel(Plain(), [recorded(samples=960)]).far_ahead()
    theta = neutral(far.free(()))
    values = far.values((), theta)
    block = far.blocks[0]
    run = far.run((), theta[None], [0])
    a = np.array([[0.0, 1.0], [-15.0, -1.5]])
    big = np.zeros((3, 3))
    big[:2] = np.column_stack([a, [0.0, 0.5]])
    step = expm(big / RATE)
    lain = np.zeros((4, 4))
    lain[:2, :2], lain[2:, 2:] = -a, a.T
    lain[1, 3] = np.exp(2 * values["force.speed_mps"]) / RATE
    whole = expm(lain / RATE)
    f = KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    f.F, f.B, f.H = step[:2, :2], step[:2, 2:], np.array([[1.0, 0.0]])
    f.Q = whole[2:, 2:].T @ whole[:2, 2:]
    f.R = np.array([[np.exp(2 * values["noise.position_m"])]])
    f.x, f.P = far._starts[0].states[:, :1].copy(), np.diag(far._starts[0].spread ** 2)
    log, compared = far.logs[0], 0
    for k in range(block.stop):
        innovation, variance, density, _ = run.statistics[:, k, 0, 0, 0]
        if density != 0.0:
            f.update(log.outputs[0, k])
            assert innovation == pytest.approx(f.y[0, 0], abs=1e-8)
            assert variance == pytest.approx(f.S[0, 0], rel=1e-5)
            compared += run.pieces.scored[k, 0]
        f.predict(log.inputs[0, k])
    assert compared == 10  # ten are not scored, so that the filter has settled


@pytest.mark.parametrize("verdict", ["unknown", "none", "named"])
def test_what_explains_all_is_asked_no_further(rubbing, monkeypatch, verdict):
    base, asked = fitted_base(rubbing), []
    near = Named(rubbing, base, base, [])

    def one_way(model, base, progress):
        asked.append(model)
        return near

    monkeypatch.setattr(judging, "_named", one_way)
    monkeypatch.setattr(judging, "verdict_of", lambda outcome: verdict)
    monkeypatch.setattr(judging, "is_outdone", lambda *args: False)
    monkeypatch.setattr(judging, "_replaces", lambda *args: False)
    assert named(rubbing, base) is near
    assert [m.is_pushed for m in asked] == ([True, False] if verdict == "unknown" else [True])


@pytest.mark.parametrize(("before", "after", "is_taken"), [(2.0, 1.0, True), (1.0, 2.0, False)])
def test_an_answer_far_ahead_has_to_forecast_what_was_sealed(
    rubbing, monkeypatch, before, after, is_taken
):
    base = fitted_base(rubbing)
    near, far = (Named(rubbing, base, base, [], rivals=r) for r in ((), ("a", "b")))
    monkeypatch.setattr(judging, "_named", lambda model, *_: far if not model.is_pushed else near)
    monkeypatch.setattr(judging, "_is_whole", lambda outcome: False)
    monkeypatch.setattr(judging, "_replaces", lambda *args: True)
    monkeypatch.setattr(
        judging, "_unseen", lambda n: np.full((9, 1), after if n.is_far_ahead else before)
    )
    told = named(rubbing, base)
    assert told.is_far_ahead == is_taken
    assert (told is near) != is_taken


def test_steps_go_on_from_an_answer_far_ahead(rubbing, monkeypatch, tmp_path):
    """Its fits have other parameters than those of the model that was asked first."""
    far = rubbing.far_ahead()

    def asked_far(model, base, progress):
        outcome = judging._named(far, fitted_base(far), progress)
        return Named(**{**vars(outcome), "is_far_ahead": True})

    monkeypatch.setattr(workflow, "named", asked_far)
    folder = OwnFolder(rubbing, tmp_path)
    folder.add()
    (kept,) = read_correction(tmp_path / CORRECTION, "Cart").document.effect
    assert kept.name == FRICTION
    shown = folder.show()
    assert shown.gap["position_m"].after < 0.5 * shown.gap["position_m"].before
    told = read(tmp_path / "name.json", Answer, folder.key)
    assert told is not None
    assert told.is_far_ahead
    assert told.effects[0].parameters["force"].value == pytest.approx(3.0, abs=0.5)
    assert any("predict far ahead" in line for line in sentences(told))


def test_a_system_that_cannot_be_asked_so_is_not():
    plain = SimpleNamespace()
    assert judging.far_ahead(plain) is None
