"""Ships under way: passages, their observations, their forces, and the ship that steers."""

import itertools

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.core.episodes import read_episode_set
from wakedeploy.domains.ship import (
    OBSERVATION,
    OWN_MOTION,
    RATE_HZ,
    WINDOW_S,
    _drawn,
    _Job,
    _sail,
    _steps,
)
from wakedeploy.physics.ships.hull import WATER_KGPM3, Hull
from wakedeploy.physics.ships.manoeuvring import Ship, State

COLUMN = {c.name: i for i, c in enumerate(OBSERVATION)}


def sailed():
    """A short encounter."""
    return _sail(_Job("vortex", 1, "one"))


@pytest.fixture(scope="module")
def passage():
    return sailed()


@pytest.mark.slow
def test_a_passage_is_scored_from_two_lengths_to_two_lengths_and_repeats_exactly(passage) -> None:
    """Memories warm up while the ships come nearer: a fast encounter would be over by then."""
    one = passage
    dx = one.observation[:, COLUMN["dx_m"]]
    step_m = abs(one.observation[0, COLUMN["dvx_mps"]]) / RATE_HZ
    first = round(WINDOW_S * RATE_HZ)
    assert abs(abs(dx[first]) - 200.0) <= step_m
    assert abs(abs(dx[-1]) - 200.0) <= step_m
    assert np.sign(dx[0]) == -np.sign(dx[-1])
    assert np.array_equal(one.force, sailed().force)


@pytest.mark.slow
def test_speeds_observed_are_those_of_the_places_observed(passage) -> None:
    observed = passage.observation.astype(float)
    for place, speed in (("dx_m", "dvx_mps"), ("dy_m", "dvy_mps")):
        moved = np.diff(observed[:, COLUMN[place]]) * RATE_HZ
        middle = 0.5 * (observed[1:, COLUMN[speed]] + observed[:-1, COLUMN[speed]])
        assert moved == pytest.approx(middle, abs=0.1)


@pytest.mark.slow
def test_both_levels_attract_abreast_and_differ() -> None:
    forces = {}
    for level in ("vortex", "slender"):
        rows = _steps(_drawn(np.random.default_rng([1, 0])), level)
        # The vortices of the second half take as long again, and say no more.
        for abreast, after in itertools.pairwise(rows):
            dx_m = abreast[0][COLUMN["dx_m"]], after[0][COLUMN["dx_m"]]
            if np.sign(dx_m[0]) != np.sign(dx_m[1]):
                break
        else:
            pytest.fail("they never meet")
        assert np.sign(abreast[1][0]) == np.sign(abreast[0][COLUMN["dy_m"]])
        forces[level] = abreast[1][0]
    assert forces["vortex"] != pytest.approx(forces["slender"], rel=0.02)


def test_a_ship_holds_its_lane_and_comes_back_to_it() -> None:
    ship = Ship(Hull(), State(0.0, 10.0, 4.0), 4.0)
    for _ in range(600):
        ship.step(0.0, 0.0, 0.0, 0.5)
    assert ship.state.aside_m == pytest.approx(0.0, abs=0.3)
    assert ship.state.heading_rad == pytest.approx(0.0, abs=0.005)
    assert ship.state.speed_mps == pytest.approx(4.0)


def test_a_ship_that_comes_the_other_way_is_the_same_ship_turned_round() -> None:
    one = Ship(Hull(), State(0.0, 6.0, 4.0, 1), 4.0)
    other = Ship(Hull(), State(0.0, -6.0, 4.0, -1), 4.0)
    for k in range(200):
        sway_n, yaw_nm = 5e4 * np.sin(0.05 * k), 1e6 * np.cos(0.03 * k)
        one.step(2.0, sway_n, yaw_nm, 0.5)
        other.step(-2.0, -sway_n, yaw_nm, 0.5)
    assert other.state.x_m == pytest.approx(-one.state.x_m)
    assert other.state.aside_m == pytest.approx(-one.state.aside_m)
    assert other.state.heading_rad == pytest.approx(one.state.heading_rad)


def test_a_push_begins_to_move_a_ship_with_its_added_mass() -> None:
    """Sway added mass of such hulls is between half and all of what they displace."""
    ship = Ship(Hull(), State(0.0, 0.0, 4.0), 4.0)
    displaced_kg = WATER_KGPM3 * Hull().volume_m3
    ship.step(0.0, 1e5, 0.0, 0.05)
    mass_kg = 1e5 / (ship.state.drift_mps / 0.05)
    assert 1.5 * displaced_kg < mass_kg < 2.1 * displaced_kg


def sailed_under(loads: np.ndarray) -> dict[str, np.ndarray]:
    """What is observed (n,) of a ship that known forces [N] and moments [N·m] (n, 2) push about."""
    ship = Ship(Hull(), State(0.0, 0.0, 4.0), 4.0)
    rows = []
    for k, (sway_n, yaw_nm) in enumerate(loads):
        s = ship.state
        rows.append((150.0 - 1.0 * k - s.x_m, 25.0 - s.aside_m, 2.0 - s.speed_mps, -s.aside_mps,
                     s.speed_mps, s.heading_rad, s.aside_m, 1.5))  # fmt: skip
        ship.step(0.0, sway_n, yaw_nm, 1.0 / RATE_HZ)
    return dict(zip(COLUMN, np.array(rows).T, strict=True))


def share_told(loads: np.ndarray, seen: list[np.ndarray]) -> np.ndarray:
    """R² (2,) of a linear map from the last six samples of some channels, fitted to one half."""
    columns = [np.roll(channel, back) for channel in seen for back in range(6)]
    known = np.column_stack([np.ones(len(loads)), *columns])[6:]
    known /= np.abs(known).max(0)
    half, wanted = len(known) // 2, loads[6:]
    fitted = known[half:] @ np.linalg.lstsq(known[:half], wanted[:half], rcond=None)[0]
    return 1.0 - ((wanted[half:] - fitted) ** 2).mean(0) / wanted[half:].var(0)


def test_own_motion_tells_the_force_and_what_is_left_does_not() -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2, 3040))
    smooth = np.array([np.convolve(row, np.hanning(41), "valid") for row in noise]).T
    loads = smooth / smooth.std(0) * [1e5, 3e6]
    seen = sailed_under(loads)
    assert share_told(loads, [seen[name] for name in OWN_MOTION]).min() > 0.95
    left = [channel for name, channel in seen.items() if name not in OWN_MOTION]
    assert share_told(loads, left).max() < 0.1


@pytest.mark.slow
def test_the_command_writes_a_set(tmp_path) -> None:
    out = tmp_path / "ship"
    told = CliRunner().invoke(main, ["data", "make", "ship", "--out", str(out), "--minutes", "1",
                                     "--seed", "4"])  # fmt: skip
    assert told.exit_code == 0, told.output
    made = read_episode_set(out)
    assert made.domain == "ship"
    assert set(made.split.values()) == {"train", "validation", "test"}
    assert made.provenance["level"] == "vortex"
    assert made.provenance["own_motion"] == [*OWN_MOTION]
    assert made.provenance["groups"] == {name: name for name in made.split}
