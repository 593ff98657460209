"""Ships that shed wakes in shallow water: convergence, circulation, memory, limits."""

import numpy as np
import pytest

from wakedeploy.physics.ships.hull import WATER_KGPM3, Hull
from wakedeploy.physics.ships.shallow import VortexShips, Waterway
from wakedeploy.physics.ships.slender import Passing

HULL = Hull()
UNIT_N = 0.5 * WATER_KGPM3 * HULL.beam_m * HULL.draught_m


def passing(
    own_mps: float,
    other_mps: float,
    *,
    apart_m: float = 25.0,
    panels: int = 40,
    dt_s: float = 0.5,
    start_m: float = 200.0,
    **waterway: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far the other is ahead, and the own ship's force and moment, while one passes."""
    ships = VortexShips(Waterway(panels=panels, **waterway))
    speeds = np.array([own_mps, other_mps])
    x_m = np.array([0.0, start_m if other_mps < own_mps else -start_m])
    rows = []
    for _ in range(int(2 * start_m / abs(other_mps - own_mps) / dt_s)):
        loads = ships.step(x_m, np.array([apart_m, 0.0]), speeds, dt_s)
        rows.append((x_m[1] - x_m[0], loads.sway_n[0], loads.yaw_nm[0]))
        x_m = x_m + speeds * dt_s
    ahead, sway, yaw = np.array(rows[4:]).T
    return ahead, sway, yaw


def test_a_moored_ship_feels_about_what_slender_body_theory_says() -> None:
    ahead, sway, _ = passing(0.0, 3.0, depth_m=10.0)
    known, _ = Passing(depth_m=10.0).forces(ahead, 25.0, 0.0, 0.0, 3.0)
    assert np.abs(sway - known).max() < 0.15 * np.abs(known).max()
    assert abs(ahead[sway.argmin()]) < 4.0


@pytest.mark.parametrize(("own_mps", "other_mps"), [(3.0, 5.0), (3.0, -4.0)])
def test_more_panels_change_less_and_less(own_mps: float, other_mps: float) -> None:
    coarse, middle, fine = (
        passing(own_mps, other_mps, panels=panels)[1] for panels in (20, 40, 80)
    )
    scale = np.abs(fine).max()
    assert np.abs(middle - fine).max() < 0.02 * scale
    assert np.abs(middle - fine).max() < 0.7 * np.abs(coarse - middle).max()


def test_shorter_steps_change_little() -> None:
    long, short = (passing(3.0, 5.0, dt_s=dt_s) for dt_s in (0.5, 0.25))
    there = np.interp(long[0], short[0], short[1])
    assert np.abs(there - long[1]).max() < 0.02 * np.abs(long[1]).max()


def test_what_a_hull_loses_in_circulation_lies_in_its_wake() -> None:
    ships = VortexShips(Waterway(wake_lengths=100.0, wall_m=70.0))
    x_m, speeds, largest = np.array([0.0, -150.0]), np.array([3.0, 5.0]), 0.0
    for k in range(300):
        aside_m = np.array([20.0 + 3.0 * np.sin(0.03 * k), -8.0])
        ships.step(x_m, aside_m, speeds, 0.5)
        bound, shed = ships.circulation()
        if k > 0:  # the impulsive start leaves nothing behind until the ship has moved on
            largest = max(largest, float(np.abs(bound).max()))
            assert bound + shed == pytest.approx(np.zeros(2), abs=1e-9)
        x_m = x_m + speeds * 0.5
    assert largest > 0.5


def test_the_present_alone_does_not_tell_the_force() -> None:
    """Two ships that are where two others are now, but came there along another way."""
    forces = []
    for swerve_m in (0.0, 12.0):
        ships = VortexShips(Waterway())
        for k in range(121):
            left_s = 60.0 - 0.5 * k
            x_m = np.array([-3.0 * left_s, -20.0 - 5.0 * left_s])
            aside_m = np.array([25.0 + swerve_m * np.sin(0.1 * left_s) ** 2, 0.0])
            loads = ships.step(x_m, aside_m, np.array([3.0, 5.0]), 0.5)
        forces.append(loads.sway_n[0])
    assert abs(forces[1] - forces[0]) > 0.01 * abs(forces[0])


def test_forces_vanish_far_apart_and_for_a_ship_alone_in_the_middle() -> None:
    near = passing(3.0, 5.0)[1]
    far = passing(3.0, 5.0, apart_m=3000.0)[1]
    assert np.abs(far).max() < 1e-3 * np.abs(near).max()
    ships = VortexShips(Waterway(wall_m=80.0))
    for k in range(40):
        at_m = np.array([1.5 * k, 1e6])
        loads = ships.step(at_m, np.zeros(2), np.array([3.0, 3.0]), 0.5)
    assert abs(loads.sway_n[0]) < 1e-6 * np.abs(near).max()


def test_a_mirrored_world_has_mirrored_forces() -> None:
    port, starboard = (passing(3.0, -4.0, apart_m=a)[1:] for a in (25.0, -25.0))
    for one, other in zip(port, starboard, strict=True):
        assert other == pytest.approx(-one, abs=1e-9 * np.abs(one).max())


def test_a_thin_hull_blocks_as_a_plate_and_a_small_clearance_as_a_gap() -> None:
    thin = Hull(beam_m=1e-6)
    plate = thin.blockage_m(np.zeros(1), 500.0)[0]  # deep: added mass π T²/2 a section
    assert 2.0 * plate * 500.0 == pytest.approx(0.5 * np.pi * thin.draught_m**2, rel=1e-3)
    close = Hull().blockage_m(np.zeros(1), 5.001)[0]
    gap = 0.5 * Hull().midship * Hull().beam_m * Hull().draught_m / 0.001
    assert close == pytest.approx(gap, rel=1e-3)
