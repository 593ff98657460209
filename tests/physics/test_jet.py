"""The closed form of the vertical jet against quadrature and against its own future."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from wakedeploy.physics.jet import VerticalJet, drag_force
from wakedeploy.rig.file import default_rig

RIG = default_rig()
DT_S = 1.0 / 256.0


def jet_after(thrusts: list[float]) -> VerticalJet:
    jet = VerticalJet(RIG.wake, RIG.source.height_m, DT_S)
    for thrust_n in thrusts:
        jet.inject(thrust_n)
    return jet


@pytest.mark.parametrize(("x_m", "z_m"), [(0.0, 0.7), (0.1, 0.4), (-0.25, 1.0)])
def test_a_steady_jet_is_the_integral_over_all_ages(x_m: float, z_m: float) -> None:
    wake, below_m = RIG.wake, RIG.source.height_m - z_m

    def puff(age_s: float) -> float:
        s2 = wake.width_m**2 + 2 * wake.diffusivity_m2ps * age_s
        distance2 = x_m**2 + (wake.speed_mps * age_s - below_m) ** 2
        fading = math.exp(-wake.decay_per_s * age_s) * wake.width_m**2 / s2
        return wake.strength * fading * math.exp(-distance2 / (2 * s2))

    expected = -quad(puff, 0.0, 1.0, epsabs=1e-10, limit=200)[0]
    steady = jet_after([wake.reference_thrust_n] * 300)
    assert steady.velocity(x_m, z_m) == pytest.approx(expected, rel=1e-4)


def test_the_force_grows_linearly_with_thrust() -> None:
    weak, strong = jet_after([2.0] * 300), jet_after([6.0] * 300)
    forces = [drag_force(RIG.wake, 0.0, jet.velocity(0.0, 0.6)) for jet in (weak, strong)]
    assert forces[1] / forces[0] == pytest.approx(3.0, rel=1e-9)
    assert forces[0] < 0.0  # downwards


def test_a_step_of_thrust_arrives_after_separation_over_speed() -> None:
    jet = jet_after([0.0])
    velocity = []
    for _ in range(200):
        jet.inject(4.0)
        velocity.append(jet.velocity(0.0, 0.6))
    halfway = int(np.argmax(np.array(velocity) <= velocity[-1] / 2)) * DT_S
    assert halfway == pytest.approx((2.0 - 0.6) / RIG.wake.speed_mps, abs=0.02)


def test_the_future_is_what_comes_when_the_thrust_is_held() -> None:
    rng = np.random.default_rng(1)
    jet = jet_after(list(rng.uniform(1.0, 8.0, 300)))
    jet.inject(3.0)
    foreseen = jet.velocity_ahead(0.05, 0.7, 24 * DT_S)
    for _ in range(24):
        jet.inject(3.0)
    assert foreseen == pytest.approx(jet.velocity(0.05, 0.7), rel=1e-12)


@pytest.mark.parametrize("speed_exponent", [0.0, 0.3])
def test_many_leads_at_one_place_are_the_leads_one_by_one(speed_exponent: float) -> None:
    wake = RIG.changed(wake={"speed_exponent": speed_exponent}).wake
    jet = VerticalJet(wake, RIG.source.height_m, DT_S)
    for thrust_n in np.random.default_rng(2).uniform(1.0, 8.0, 300):
        jet.inject(float(thrust_n))
    leads_s = [0.0, 0.02, 0.1, 0.31, 30.0]
    together = jet.velocities_ahead(0.05, 0.7, leads_s, 0.05)
    alone = [jet.velocity_ahead(0.05, 0.7, lead_s, 0.05) for lead_s in leads_s]
    assert together == pytest.approx(alone, rel=1e-12)
    assert len({round(v, 6) for v in alone}) == len(alone)
