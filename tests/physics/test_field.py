"""The 2D wake field against the closed form of the vertical jet, exact solutions, and its twin."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("numba", reason="the 2D field is part of the [train] install")
pytest.importorskip("scipy", reason="the field's twin is part of the [train] install")

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig_sections import Wake
from wakedeploy.physics.field import WakeField
from wakedeploy.physics.field_grid import FieldGrid, FieldPhysics, blur_weights, drag_force_n
from wakedeploy.physics.field_reference import ReferenceField
from wakedeploy.physics.jet import PuffTable, drag_force
from wakedeploy.rig.file import default_rig

DT_S = 0.01
SMALL = FieldGrid(0.06, 0.06, left_m=-0.9, bottom_m=-1.5, columns=31, rows=36)
PAPER = {"speed_mps": 6.0, "diffusivity_m2ps": 0.3, "decay_per_s": 0.4, "strength": 60.0}


def wake(**changes: float) -> Wake:
    return Wake(**({**PAPER, "width_m": 0.2, "drag_area_m2": 0.1} | changes))


def field(grid: FieldGrid = SMALL, *, dt_s: float = DT_S, **changes: float) -> WakeField:
    return WakeField(grid, FieldPhysics.of(wake(**changes)), dt_s=dt_s)


def blob(flow: WakeField, x_m: float, z_m: float, width_m: float) -> np.ndarray:
    """A Gaussian (columns, rows) on the present cells."""
    x, z = flow.grid.x_m[:, np.newaxis], flow.z_m[0]
    return np.exp(-((x - x_m) ** 2 + (z - z_m) ** 2) / (2.0 * width_m**2))


def drift(flow: WakeField, steps: int) -> None:
    for _ in range(steps):
        flow.step(0.0, 0.0, 0.0, 0.0)  # without thrust nothing is injected


def moments(flow: WakeField, component: int = 1) -> tuple[float, np.ndarray, np.ndarray]:
    """Sum, centre (x, z) and variance (x, z) of one component of the velocity."""
    v = flow.velocity_mps[0, component]
    total = v.sum()
    places = (flow.grid.x_m[:, np.newaxis], flow.z_m[0])
    centre = np.array([(v * p).sum() / total for p in places])
    variance = [(v * (p - c) ** 2).sum() / total for p, c in zip(places, centre, strict=True)]
    return total, centre, np.array(variance)


# --- against the closed form -----------------------------------------------------------------


def closed_form(table: PuffTable, roots: np.ndarray, flow: WakeField) -> np.ndarray:
    """The jet of a source at the origin on the present cells (columns, rows)."""
    return np.array([[table.velocity(roots, x, z) for z in flow.z_m[0]] for x in flow.grid.x_m])


@pytest.mark.parametrize("speed_mps", [1.5, 4.3, 6.0, 10.5])  # the paper's −75 % … +75 %
def test_the_jet_of_a_fixed_source_is_the_closed_form(speed_mps: float) -> None:
    constants = wake(speed_mps=speed_mps)
    grid = FieldGrid(left_m=-5.97, columns=200, rows=110)  # the slowest wake spreads the furthest
    flow = WakeField(grid, FieldPhysics.of(constants), dt_s=DT_S)
    table = PuffTable(constants, DT_S, 5.0, DT_S)
    thrusts_n = 4.41 + 3.0 * np.sin(0.13 * np.arange(400)) + np.linspace(0.0, 1.0, 400)
    for thrust_n in thrusts_n:
        flow.step(0.0, 0.0, 0.0, thrust_n)

    roots = np.zeros(len(table.ages_s))
    known = np.sqrt(thrusts_n[::-1] / constants.reference_thrust_n)[: len(roots)]
    roots[: len(known)] = known
    expected = closed_form(table, roots, flow)
    error = np.abs(flow.velocity_mps[0, 1] - expected)
    edge_m = max(0.25, 4.0 * constants.diffusivity_m2ps / speed_mps)  # see FieldGrid
    inside = flow.z_m[0] > grid.bottom_m + edge_m
    peak_mps = np.abs(expected).max()
    assert error[:, inside].max() < 1e-3 * peak_mps
    assert np.all(flow.velocity_mps[0, 0] == 0.0)
    at_sufferer = flow.velocity(0.1, -2.3)[0, 1]
    assert at_sufferer == pytest.approx(table.velocity(roots, 0.1, -2.3), abs=1e-3 * peak_mps)


def test_the_gantrys_wake_on_a_grid_is_the_closed_form() -> None:
    constants, dt_s = default_rig().wake, 1.0 / 256.0
    grid = FieldGrid(0.02, 0.02, left_m=-0.8, bottom_m=-2.0, columns=81, rows=120)
    flow = WakeField(grid, FieldPhysics.of(constants), dt_s=dt_s)
    table = PuffTable(constants, dt_s, 2.0, dt_s)
    for _ in range(150):
        flow.step(0.0, 0.0, 0.0, 3.0)
    roots = np.full(len(table.ages_s), np.sqrt(3.0 / constants.reference_thrust_n))
    expected = closed_form(table, roots, flow)
    peak_mps = np.abs(expected).max()
    inside = flow.z_m[0] > -1.75
    assert np.abs(flow.velocity_mps[0, 1] - expected)[:, inside].max() < 1e-3 * peak_mps
    for x_m, z_m in [(0.0, -1.4), (0.15, -1.0), (-0.3, -1.3), (0.07, -0.8)]:
        between_cells = flow.velocity(x_m, z_m)[0, 1]  # bilinear: up to Δ²/8 of the curvature
        exact = table.velocity(roots, x_m, z_m)
        assert between_cells == pytest.approx(exact, abs=2e-3 * peak_mps)


# --- each operation against its exact solution -------------------------------------------------


@given(speed_mps=st.floats(0.0, 30.0), steps=st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_sinking_moves_a_wake_and_does_not_spread_it(speed_mps: float, steps: int) -> None:
    grid = FieldGrid(0.06, 0.06, left_m=-0.9, bottom_m=-3.0, columns=31, rows=70)
    flow = WakeField(grid, FieldPhysics(speed_mps, 0.0, 0.0, 1.0, 0.1, 1.0), dt_s=DT_S)
    flow.velocity_mps[0, 1] = blob(flow, 0.0, 0.3, 0.12)
    before = moments(flow)
    drift(flow, steps)
    total, centre, variance = moments(flow)
    assert total == pytest.approx(before[0], rel=1e-12)
    assert centre == pytest.approx(before[1] - [0.0, speed_mps * steps * DT_S], abs=1e-9)
    assert variance == pytest.approx(before[2], rel=1e-9)


@pytest.mark.parametrize("diffusivity", [0.003, 0.05, 0.3])  # a blur of 0.13, 0.5 and 1.3 cells
def test_variance_grows_at_twice_the_diffusivity(diffusivity: float) -> None:
    grid = FieldGrid(0.06, 0.06, left_m=-3.0, bottom_m=-5.0, columns=101, rows=130)
    flow = WakeField(grid, FieldPhysics(4.1, diffusivity, 0.0, 1.0, 0.1, 1.0), dt_s=DT_S)
    flow.velocity_mps[0, 1] = blob(flow, 0.1, 0.2, 0.15)
    before = moments(flow)
    drift(flow, 30)
    growth = moments(flow)[2] - before[2]
    assert growth == pytest.approx(2.0 * diffusivity * 0.3, rel=1e-6)


def test_a_wake_arrives_after_separation_over_speed() -> None:
    """2.3 m at 6 m/s in hardly any diffusion, seen where a step of thrust is halfway there."""
    flow = field(FieldGrid(), diffusivity_m2ps=0.02, decay_per_s=0.0, width_m=0.1)
    velocity = []
    for _ in range(80):
        flow.step(0.0, 0.0, 0.0, 4.41)
        velocity.append(flow.velocity(0.0, -2.3)[0, 1])
    halfway = np.interp(0.5, np.array(velocity) / velocity[-1], DT_S * np.arange(1, 81))
    assert halfway == pytest.approx(2.3 / 6.0, abs=0.01)


def test_momentum_decays_exponentially() -> None:
    flow = field(FieldGrid(bottom_m=-5.0, rows=120), decay_per_s=1.7)
    flow.velocity_mps[0, 1] = blob(flow, 0.2, 0.0, 0.2)
    before = moments(flow)[0]
    drift(flow, 25)
    assert moments(flow)[0] == pytest.approx(before * np.exp(-1.7 * 0.25), rel=1e-6)


@pytest.mark.parametrize("wind_mps", [2.4, -7.3, 21.0])
def test_a_uniform_side_wind_carries_the_wake_along(wind_mps: float) -> None:
    grid = FieldGrid(0.06, 0.06, left_m=-6.0, bottom_m=-1.0, columns=201, rows=30)
    flow = WakeField(grid, FieldPhysics(0.0, 0.0, 0.0, 1.0, 0.1, 1.0), dt_s=DT_S)
    flow.velocity_mps[0, 0] = wind_mps
    flow.velocity_mps[0, 1] = blob(flow, -np.sign(wind_mps), 0.0, 0.24)
    drift(flow, 8)
    exact = blob(flow, -np.sign(wind_mps) + wind_mps * 0.08, 0.0, 0.24)
    assert np.abs(flow.velocity_mps[0, 1] - exact).max() < 5e-3


def test_a_side_wind_steepens_along_its_characteristics() -> None:
    """Horizontal self-advection alone: v_x keeps its value along x = x₀ + v_x t (Burgers)."""
    grid = FieldGrid(0.02, 0.06, left_m=-2.0, bottom_m=-0.1, columns=201, rows=4)
    flow = WakeField(grid, FieldPhysics(0.0, 0.0, 0.0, 1.0, 0.1, 1.0), dt_s=0.002)

    def initial(x: np.ndarray) -> np.ndarray:
        return 2.0 * np.exp(-(x**2) / (2.0 * 0.3**2))

    flow.velocity_mps[0, 0] = initial(grid.x_m)[:, np.newaxis]
    drift(flow, 40)
    origins = np.linspace(-2.0, 2.0, 4001)
    arrived = origins + initial(origins) * 0.08  # before they cross: t < 0.25 s
    exact = np.interp(grid.x_m, arrived, initial(origins))
    assert np.abs(flow.velocity_mps[0, 0, :, 1] - exact).max() < 0.02 * 2.0


@given(variance=st.floats(0.0, 30.0))
def test_the_blurs_weights_have_the_variance_that_was_asked_for(variance: float) -> None:
    weights = blur_weights(np.array([variance]))[0]
    m = np.arange(len(weights))
    assert np.all(weights >= 0.0)
    assert weights[0] + 2.0 * weights[1:].sum() == pytest.approx(1.0, rel=1e-12)
    assert 2.0 * (weights * m**2).sum() == pytest.approx(variance, rel=1e-9, abs=1e-12)


# --- against its twin, and against itself ------------------------------------------------------


@given(
    seed=st.integers(0, 2**32 - 1),
    speed_mps=st.floats(0.0, 40.0),
    diffusivity_m2ps=st.floats(0.0, 1.0),
    strength=st.floats(0.0, 3000.0),
)
@settings(max_examples=25, deadline=None)
def test_it_equals_its_plain_twin(
    seed: int, speed_mps: float, diffusivity_m2ps: float, strength: float
) -> None:
    rng = np.random.default_rng(seed)
    physics = FieldPhysics(
        speed_mps=np.array([speed_mps, rng.uniform(1.5, 10.5)]),
        diffusivity_m2ps=np.array([diffusivity_m2ps, rng.uniform(0.0, 0.5)]),
        decay_per_s=rng.uniform(0.0, 3.0, 2),
        strength=strength,
        width_m=rng.uniform(0.08, 0.4, 2),
        reference_thrust_n=4.41,
    )
    grid = FieldGrid(0.06, 0.05, left_m=-0.9, bottom_m=-1.1, columns=29, rows=34)
    fast = WakeField(grid, physics, dt_s=DT_S, episodes=2)
    plain = ReferenceField(grid, physics, dt_s=DT_S, episodes=2)
    for _ in range(15):
        x, z, pitch = rng.normal(0.0, 0.3, (3, 2))
        thrust = rng.normal(4.0, 3.0, 2)  # some below zero
        fast.step(x, z, pitch, thrust)
        plain.step(x, z, pitch, thrust)
        places = rng.uniform([[-1.2], [-1.4]], [[1.2], [0.9]], (2, 2))
        scale = max(1.0, np.abs(plain.velocity_mps).max())
        assert np.abs(fast.velocity_mps - plain.velocity_mps).max() <= 1e-10 * scale
        assert np.abs(fast.velocity(*places) - plain.velocity(*places)).max() <= 1e-10 * scale
    assert fast.z_m == pytest.approx(plain.z_m, abs=1e-12)


def test_a_mirrored_flight_leaves_a_mirrored_wake() -> None:
    rng = np.random.default_rng(5)
    left, right = field(), field()
    for _ in range(30):
        x, z, pitch, thrust = rng.normal(0.0, 0.2), 0.0, rng.normal(0.0, 0.3), rng.uniform(1.0, 8.0)
        right.step(x, z, pitch, thrust)
        left.step(-x, z, -pitch, thrust)
    mirrored = left.velocity_mps[:, :, ::-1] * np.array([-1.0, 1.0])[:, np.newaxis, np.newaxis]
    assert np.abs(right.velocity_mps[0, 0]).max() > 0.1
    assert mirrored == pytest.approx(right.velocity_mps, abs=1e-12)


def test_episodes_in_lockstep_are_each_alone() -> None:
    speeds, diffusivities = np.array([3.0, 6.0, 9.0]), np.array([0.1, 0.3, 0.5])
    physics = FieldPhysics(speeds, diffusivities, 0.4, 60.0, 0.2, 4.41)
    together = WakeField(SMALL, physics, dt_s=DT_S, episodes=3)
    alone = [
        field(speed_mps=speed, diffusivity_m2ps=diffusivity)
        for speed, diffusivity in zip(speeds, diffusivities, strict=True)
    ]
    for n in range(20):
        together.step(np.array([0.0, 0.1, 0.2]), 0.1, 0.01 * n, 5.0)
        for e, flow in enumerate(alone):
            flow.step(0.1 * e, 0.1, 0.01 * n, 5.0)
    for e, flow in enumerate(alone):
        assert together.velocity_mps[e] == pytest.approx(flow.velocity_mps[0], abs=1e-13)


def test_a_tilted_source_blows_where_its_jet_points() -> None:
    flow = field()
    flow.step(0.0, 0.0, 0.4, 4.41)
    vx, vz = flow.velocity(0.0, -0.06)[0]
    assert (vx, vz) == pytest.approx((-vz * np.tan(0.4), vz), rel=1e-2)
    assert vx > 0.0 > vz


# --- edges ---------------------------------------------------------------------------------------


def test_the_air_beyond_the_grid_is_at_rest() -> None:
    flow = field()
    for _ in range(20):
        flow.step(0.0, 0.0, 0.2, 4.0)
    for place in [(-5.0, 0.0), (5.0, 0.0), (0.0, -9.0), (0.0, 9.0)]:
        assert np.all(flow.velocity(*place) == 0.0)


def test_the_drag_force_is_quadratic_and_follows_the_air() -> None:
    velocity = np.array([[3.0, -4.0], [0.0, -2.0]])
    force = drag_force_n(velocity, 0.1)
    assert force[0] == pytest.approx(0.5 * 1.2 * 0.1 * 5.0 * velocity[0])
    constants = wake()
    assert force[1, 1] == pytest.approx(drag_force(constants, 0.0, -2.0))


@pytest.mark.parametrize(
    ("constant", "value"),
    [("speed_mps", -1.0), ("diffusivity_m2ps", float("nan")), ("width_m", 0.0)],
)
def test_a_constant_out_of_bounds_is_refused(constant: str, value: float) -> None:
    constants = {**PAPER, "width_m": 0.2, "reference_thrust_n": 4.41, constant: value}
    with pytest.raises(UnusableInput, match=constant):
        WakeField(SMALL, FieldPhysics(**constants), dt_s=DT_S)


def test_cells_too_coarse_for_the_wake_are_refused() -> None:
    with pytest.raises(UnusableInput, match="too coarse"):
        field(width_m=0.04)


@pytest.mark.whole
def test_it_runs_where_compiled_code_cannot_be_kept() -> None:
    """As in a package folder and a home that are read-only: it compiles anew, it does not fail."""
    script = (
        "from wakedeploy.physics.field import FieldGrid, FieldPhysics, WakeField\n"
        "flow = WakeField(FieldGrid(), FieldPhysics(6.0, 0.3, 0.4, 60.0, 0.2, 4.4), dt_s=0.01)\n"
        "flow.step(0.0, 0.0, 0.0, 4.4)\n"
        "print(flow.velocity(0.0, 0.0)[0, 1] < 0.0)\n"
    )
    nowhere = {**os.environ, "NUMBA_CACHE_LOCATOR_CLASSES": "ZipCacheLocator"}
    done = subprocess.run(
        [sys.executable, "-c", script], env=nowhere, capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "True", done.stderr
