"""The planar body against parabolas, Fresnel integrals and a general-purpose integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import fresnel

from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.body import STATE, PlanarBody, thrust_vector_n

G = 9.81
BODY = PlanarBody(mass_kg=1.5, inertia_kgm2=0.02)


def at_rest(episodes: int = 1) -> np.ndarray:
    return np.zeros((episodes, len(STATE)))


def fly(body, state, thrust_n, torque_nm, force_n, dt_s, steps):
    for _ in range(steps):
        state = body.step(state, thrust_n, torque_nm, force_n, dt_s)
    return state


def test_without_forces_it_falls_on_a_parabola() -> None:
    state = at_rest()
    state[0, 3:5] = 2.0, 3.0
    after = fly(BODY, state, 0.0, 0.0, (0.0, 0.0), 0.01, 100)[0]
    assert after[:2] == pytest.approx([2.0, 3.0 - 0.5 * G], abs=1e-12)
    assert after[3:5] == pytest.approx([2.0, 3.0 - G], abs=1e-12)


def test_at_hover_thrust_it_stays() -> None:
    assert fly(BODY, at_rest(), 1.5 * G, 0.0, (0.0, 0.0), 0.01, 100) == pytest.approx(
        at_rest(), abs=1e-12
    )


def test_tilted_it_accelerates_against_its_jet() -> None:
    pitch = 0.3
    state = at_rest()
    state[0, 2] = pitch
    after = fly(BODY, state, 1.5 * G / np.cos(pitch), 0.0, (0.0, 0.0), 0.01, 50)[0]
    assert after[0] == pytest.approx(-0.5 * G * np.tan(pitch) * 0.5**2, abs=1e-12)
    assert after[1] == pytest.approx(0.0, abs=1e-12)
    jet = np.array([np.sin(pitch), -np.cos(pitch)])  # the paper's injection direction
    thrust = thrust_vector_n(np.array([2.0]), np.array([pitch]))[0]
    assert thrust == pytest.approx(-2.0 * jet)


def test_under_a_constant_torque_the_velocity_is_a_fresnel_integral() -> None:
    thrust_n, torque_nm, time_s = 20.0, 0.05, 1.0
    after = fly(BODY, at_rest(), thrust_n, torque_nm, (0.0, 0.0), 0.01, 100)[0]
    alpha = torque_nm / BODY.inertia_kgm2
    scale = np.sqrt(np.pi / alpha)  # θ = αt²/2 = (π/2)(t/scale)²
    sine, cosine = fresnel(time_s / scale)
    push = thrust_n / BODY.mass_kg * scale
    assert after[3:5] == pytest.approx([-push * sine, push * cosine - G * time_s], abs=1e-8)
    assert after[2] == pytest.approx(0.5 * alpha * time_s**2, abs=1e-12)


def test_it_converges_with_the_fourth_order() -> None:
    exact = fly(BODY, at_rest(), 20.0, 0.5, (1.0, -2.0), 1e-3, 400)
    errors = [
        np.abs(fly(BODY, at_rest(), 20.0, 0.5, (1.0, -2.0), 0.4 / n, n) - exact).max()
        for n in (4, 8)
    ]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.2)


def test_many_bodies_at_once_are_each_body_alone() -> None:
    rng = np.random.default_rng(3)
    masses, inertias = rng.uniform(0.5, 3.0, 4), rng.uniform(0.01, 0.05, 4)
    state = rng.normal(size=(4, 6))
    thrust, torque, force = (
        rng.uniform(5, 20, 4),
        rng.normal(size=4) * 0.02,
        rng.normal(size=(4, 2)),
    )
    together = fly(PlanarBody(masses, inertias), state, thrust, torque, force, 0.01, 30)

    for e in range(4):

        def rate(_t: float, s: np.ndarray, e: int = e) -> list[float]:
            ax = (-thrust[e] * np.sin(s[2]) + force[e, 0]) / masses[e]
            az = (thrust[e] * np.cos(s[2]) + force[e, 1]) / masses[e] - G
            return [s[3], s[4], s[5], ax, az, torque[e] / inertias[e]]

        alone = solve_ivp(rate, (0.0, 0.3), state[e], rtol=1e-11, atol=1e-12).y[:, -1]
        assert together[e] == pytest.approx(alone, abs=1e-7)


@pytest.mark.parametrize("mass_kg", [0.0, -1.0, float("nan")])
def test_a_body_without_a_mass_is_refused(mass_kg: float) -> None:
    with pytest.raises(UnusableInput, match="mass_kg"):
        PlanarBody(mass_kg, 0.02)
