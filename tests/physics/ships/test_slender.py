"""Slender ships in passing: published check values, the sectional force, and limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wakedeploy.physics.ships.hull import WATER_KGPM3, Hull, mirrors
from wakedeploy.physics.ships.slender import Passing

HULL = Hull()
AHEAD_M = np.linspace(-200.0, 200.0, 401)
UNIT_N = 0.5 * WATER_KGPM3 * HULL.beam_m * HULL.draught_m  # times the square of the other's speed


@pytest.mark.parametrize(
    ("depth_over_draught", "lowest", "highest"),
    [(np.inf, -0.093, 0.044), (2.0, -0.230, 0.102), (1.5, -0.306, 0.135), (1.2, -0.382, 0.169)],
)
def test_sway_force_of_a_moored_ship_has_the_known_extremes(
    depth_over_draught: float, lowest: float, highest: float
) -> None:
    passing = Passing(depth_m=depth_over_draught * HULL.draught_m)
    sway, yaw = passing.forces(AHEAD_M, 25.0, 0.0, 0.0, 3.0)
    coefficient = sway / (UNIT_N * 3.0**2)
    assert coefficient.min() == pytest.approx(lowest, rel=0.02)
    assert coefficient.max() == pytest.approx(highest, rel=0.02)
    assert abs(AHEAD_M[coefficient.argmin()]) < 1.5  # attracted abreast
    assert abs(abs(AHEAD_M[np.abs(yaw).argmax()]) / HULL.length_m - 0.3) < 0.05


@pytest.mark.parametrize(("own_mps", "other_mps"), [(0.0, 4.0), (3.0, 5.0), (4.0, -3.0)])
def test_the_moment_is_that_of_the_sectional_force(own_mps: float, other_mps: float) -> None:
    """f = ρ {(∂t − U ∂x)[(1 + k) S v] + U S′ v}, by differences in time and place."""
    passing = Passing(depth_m=10.0)
    x, _ = passing.stations(HULL)
    fine = np.linspace(-50.0, 50.0, 2001)
    dt_s, ahead_m = 0.01, 20.0

    def flow(t_s: float) -> np.ndarray:
        there = np.array([ahead_m + (other_mps - own_mps) * t_s])
        at_nodes = passing._crossflow(HULL, there, 25.0, other_mps)[0]
        return np.polynomial.Legendre.fit(x, at_nodes, 30)(fine)

    now = flow(0.0)
    inertia = 2.0 * HULL.area_m2(fine)
    changing = inertia * (flow(dt_s) - flow(-dt_s)) / (2 * dt_s)
    carried = own_mps * np.gradient(inertia * now, fine)
    section = WATER_KGPM3 * (changing - carried + own_mps * HULL.area_slope_m(fine) * now)
    sway, yaw = passing.forces(np.array([ahead_m]), 25.0, 0.0, own_mps, other_mps)
    assert sway[0] == pytest.approx(np.trapezoid(section, fine), rel=2e-3)
    assert yaw[0] == pytest.approx(np.trapezoid(fine * section, fine), rel=2e-3)


def test_a_steady_uniform_crossflow_turns_with_munks_moment() -> None:
    passing = Passing(added_mass=0.8)
    x, _ = passing.stations(HULL)
    nothing = np.zeros(1)
    sway, yaw = passing._added(nothing, nothing, np.full((1, len(x)), 0.3), 5.0, 5.0)
    displaced_kg = WATER_KGPM3 * HULL.volume_m3
    assert sway[0] == pytest.approx(0.0, abs=1e-6 * displaced_kg)
    assert yaw[0] == pytest.approx(0.8 * displaced_kg * 5.0 * 0.3)


def test_forces_vanish_far_away_and_grow_in_shallow_water() -> None:
    near, far = (Passing(depth_m=8.0).forces(AHEAD_M, apart, 0.0, 3.0, 5.0)
                 for apart in (30.0, 2000.0))  # fmt: skip
    assert np.abs(far[0]).max() < 1e-3 * np.abs(near[0]).max()
    beyond = Passing(depth_m=8.0).forces(np.array([5000.0]), 30.0, 0.0, 3.0, 5.0)
    assert abs(beyond[0][0]) < 1e-3 * np.abs(near[0]).max()


@settings(max_examples=20, deadline=None)
@given(
    ahead_m=st.floats(-150.0, 150.0),
    apart_m=st.floats(20.0, 100.0),
    own_mps=st.floats(-6.0, 6.0),
    other_mps=st.floats(-6.0, 6.0),
)
def test_a_mirrored_world_has_mirrored_forces(ahead_m, apart_m, own_mps, other_mps) -> None:
    passing = Passing(depth_m=9.0, wall_m=120.0)
    at = np.array([ahead_m])
    port = passing.forces(at, apart_m, 0.0, own_mps, other_mps)
    starboard = passing.forces(at, -apart_m, 0.0, own_mps, other_mps)
    scale = 1.0 + np.abs(port[0]) + np.abs(port[1]) / HULL.length_m
    assert starboard[0] == pytest.approx(-port[0], abs=1e-9 * scale.max())
    assert starboard[1] == pytest.approx(-port[1], abs=1e-7 * scale.max())


def test_a_ship_alone_is_drawn_to_the_nearer_wall_and_not_in_the_middle() -> None:
    passing = Passing(depth_m=9.0, wall_m=80.0)
    far = np.array([1e6])
    middle = passing.forces(far, 0.0, 0.0, 4.0, 4.0)[0][0]
    near_port = passing.forces(far, 40.0, 0.0, 4.0, 4.0)[0][0]
    assert near_port > 0.0
    assert abs(middle) < 1e-6 * near_port


def test_images_lie_where_two_mirrors_put_them() -> None:
    assert mirrors(None, 5) == [(1, 0.0)]
    places = {sign * 10.0 + shift: sign for sign, shift in mirrors(50.0, 2)}
    assert places == {10.0: 1, -110.0: -1, 90.0: -1, -190.0: 1, 210.0: 1}
