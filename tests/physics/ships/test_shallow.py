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


def along_pairs(
    place: np.ndarray, ends: np.ndarray, aside_m: float, jump: np.ndarray
) -> np.ndarray:
    """Flow across (p,) at complex places by panels, each a pair of opposite point vortices.

    `ends` (q, 2): of each panel, seen the way the ship goes, the aft and the fore end.
    """
    way = np.sign(ends[:, 1] - ends[:, 0])
    told = np.zeros(len(place))
    for end, turns in ((0, -way * jump), (1, way * jump)):  # anticlockwise
        vortex = ends[:, end] + 1j * aside_m
        flow = turns / (2j * np.pi * (place[:, None] - vortex))  # u − iv
        told -= flow.sum(1).imag
    return told


def displaced(
    place: np.ndarray, ends: np.ndarray, aside_m: float, source: np.ndarray
) -> np.ndarray:
    """Flow across (p,) by panels of sources (q,) of so much a length."""
    low, high = np.sort(ends, axis=1).T + 1j * aside_m
    flow = source / (2.0 * np.pi) * np.log((place[:, None] - low) / (place[:, None] - high))
    return -flow.sum(1).imag


@pytest.mark.parametrize("speeds", [(3.0, 5.0), (3.0, -4.0)])
def test_what_a_hull_has_shed_stays_in_the_water_as_strong_as_it_was(speeds) -> None:
    """The jump at the stern at every step, written down here, makes the flow from then on.

    Each hull's jump must be 2 C times the flow across by the other's sources, by both hulls'
    vortices, and by wakes made of what was written down (Kutta for their newest panel, Helmholtz
    for all others), as point vortices make it in the plane.
    """
    ships = VortexShips(Waterway(wake_lengths=100.0))
    way = np.sign(speeds)
    x_m, speed = np.array([0.0, -150.0 * way[1]]), np.abs(speeds)
    local = HULL.length_m * np.linspace(-0.5, 0.5, 41)
    middle = 0.5 * (local[1:] + local[:-1])
    blockage = HULL.blockage_m(middle, ships.waterway.depth_m)
    wakes: list[list[tuple[float, float, float, float]]] = [[], []]  # ends, aside, jump
    sterns: list[float | None] = [None, None]
    largest = 0.0
    for k in range(120):
        aside_m = np.array([20.0 + 3.0 * np.sin(0.03 * k), -8.0 + 2.0 * np.cos(0.05 * k)])
        ships.step(x_m, aside_m, np.array(speeds), 0.5)
        hulls = [x_m[i] + way[i] * np.stack([local[:-1], local[1:]], 1) for i in range(2)]
        for i, jump in enumerate(ships._jump):
            stern = float(hulls[i][0, 0])
            if sterns[i] is not None:
                wakes[i].append((sterns[i], stern, aside_m[i], jump[0]))
            sterns[i] = stern
        for i in range(2) if k % 20 == 19 else ():
            at = x_m[i] + way[i] * middle + 1j * aside_m[i]
            source = -speed[1 - i] / ships.waterway.depth_m * HULL.area_slope_m(middle)
            flow = displaced(at, hulls[1 - i], aside_m[1 - i], source)
            for j in range(2):
                flow += along_pairs(at, hulls[j], aside_m[j], ships._jump[j])
                for start, end, place, jump in wakes[j]:
                    flow += along_pairs(at, np.array([[start, end]]), place, np.array([jump]))
            assert ships._jump[i] == pytest.approx(2.0 * blockage * flow, abs=1e-9)
            largest = max(largest, np.abs(flow).max())
        x_m = x_m + np.array(speeds) * 0.5
    assert largest > 0.05


def overtaking(swerve_m: float, ahead_m: float) -> float:
    """Sway force on a ship that overtakes one which had swerved, but has not for ten seconds."""
    ships = VortexShips(Waterway())
    for k in range(161):
        left_s = 80.0 - 0.5 * k
        swerving = 10.0 < left_s < 30.0
        aside_m = swerve_m * np.sin(np.pi * (left_s - 10.0) / 20.0) ** 2 if swerving else 0.0
        x_m = np.array([-5.0 * left_s, ahead_m - 3.0 * left_s])
        loads = ships.step(x_m, np.array([25.0, aside_m]), np.array([5.0, 3.0]), 0.5)
    return float(loads.sway_n[0])


def test_ten_seconds_of_both_ships_motion_do_not_tell_the_force() -> None:
    """The wake that a ship left farther back acts on the one that comes up beside it.

    Places, speeds and accelerations of both are the same for ten seconds: no differentiation of
    them tells the two pasts apart.
    """
    largest_n = max(abs(overtaking(0.0, ahead_m)) for ahead_m in (-40.0, 0.0, 40.0))
    apart_n = abs(overtaking(12.0, 60.0) - overtaking(-12.0, 60.0))
    assert apart_n > 0.05 * largest_n
    # It is the wake that does it: far behind it, nothing is left of the difference.
    assert abs(overtaking(12.0, 300.0) - overtaking(-12.0, 300.0)) < 0.005 * largest_n


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
