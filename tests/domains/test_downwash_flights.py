"""The 2D downwash simulator closed loop: delay out of the field, oracle, lockstep, sets."""

import functools

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.core.episodes import read_episode_set
from wakedeploy.domains import downwash
from wakedeploy.domains.downwash import (
    DT_S,
    OBSERVATION,
    OWN_MOTION,
    World,
    fly,
    make_set,
    shifted,
)
from wakedeploy.physics.field_grid import FieldGrid, drag_force_n
from wakedeploy.physics.rail import GRAVITY_MPS2


@pytest.mark.parametrize("separation_m", [1.5, 2.3, 3.0])
def test_the_transport_delay_comes_out_of_the_field(separation_m: float) -> None:
    """Half of a step of the source has arrived after separation / speed, within a sample."""
    world = World()
    air = world.field(1)
    hover_n = world.mass_kg * GRAVITY_MPS2
    forces = []
    for k in range(300):  # as `fly` does it: the force of now, then the push until the next step
        told = drag_force_n(air.velocity(0.0, -separation_m), world.drag_area_m2)
        forces.append(np.sqrt(-told[0, 1]))
        thrust_n = hover_n * (1.0 if k < 200 else 1.4)
        air.step(0.0, 0.5 * DT_S * 6.0, 0.0, thrust_n)
    before, after = forces[200], forces[-1]
    halfway = np.interp(0.5, (np.array(forces[200:]) - before) / (after - before), np.arange(100))
    # A little early: decay and spreading make young air count for more.
    assert halfway * DT_S == pytest.approx(separation_m / 6.0, abs=DT_S)


def test_a_hovering_source_pushes_with_a_tenth_of_the_weight() -> None:
    world = World()
    air = world.field(1)
    for _ in range(200):
        air.step(0.0, 0.0, 0.0, world.mass_kg * GRAVITY_MPS2)
    told = drag_force_n(air.velocity(0.0, -2.3), world.drag_area_m2)[0]
    assert told[1] / (world.mass_kg * GRAVITY_MPS2) == pytest.approx(-0.1, abs=0.02)
    edge = air.velocity_mps[0, 1]
    for border in (edge[0], edge[-1], edge[:, -1]):
        assert np.abs(border).max() < 1e-3 * np.abs(edge).max()


def test_what_flows_out_below_the_grid_is_missed_by_no_sufferer() -> None:
    """At the bottom the field has not died out, but nothing comes back from there."""
    deeper = FieldGrid(bottom_m=-4.77, rows=100)
    told = []
    for world in (World(), World(grid=deeper)):
        air = world.field(1)
        for _ in range(200):
            air.step(0.0, 0.0, 0.0, world.mass_kg * GRAVITY_MPS2)
        told.append(np.array([air.velocity(0.0, z)[0] for z in (-2.3, -2.6, -2.9)]))
    assert np.abs(told[0][:, 1]).min() > 1.0
    assert told[0] == pytest.approx(told[1], abs=1e-3)


def test_whoever_knows_the_force_follows_better() -> None:
    without, oracle = (fly([3, 4], seconds=8.0, expect=e) for e in ("nothing", "truth"))
    assert (oracle.tracking_m < 0.5 * without.tracking_m).all()
    assert not without.expected_n.any()
    assert np.array_equal(oracle.expected_n, oracle.force_n)


def test_an_episode_does_not_depend_on_its_companions() -> None:
    together, alone = fly([5, 6, 7], seconds=2.0), fly([6], seconds=2.0)
    assert np.array_equal(together.observation[:, 1], alone.observation[:, 0])
    assert np.array_equal(together.force_n[:, 1], alone.force_n[:, 0])


def test_a_predictor_sees_every_step_once_and_is_believed() -> None:
    calls = []

    def predict(observed: np.ndarray) -> np.ndarray:
        calls.append(observed.copy())
        return np.full((2, 2), [0.05, -0.3])

    flown = fly([8, 9], seconds=1.0, expect=predict)
    assert len(calls) > 200
    assert np.array_equal(np.array(calls)[-100:], flown.observation)
    assert np.array_equal(flown.expected_n[0, 0], [0.05, -0.3])
    with pytest.raises(ValueError, match="oracle"):
        fly([1], seconds=0.1, expect="oracle")


def test_what_is_observed_is_what_the_names_say() -> None:
    flown = fly([10], seconds=3.0)
    observed = {c.name: flown.observation[:, 0, i] for i, c in enumerate(OBSERVATION)}
    for place, speed in (("dx_m", "dvx_mps"), ("dz_m", "dvz_mps")):
        moved = np.diff(observed[place]) / DT_S
        middle = 0.5 * (observed[speed][1:] + observed[speed][:-1])
        assert moved == pytest.approx(middle, abs=0.02)
    size = np.hypot(observed["source_thrust_x_n"], observed["source_thrust_z_n"])
    assert size.mean() == pytest.approx(GRAVITY_MPS2, rel=0.1)


@pytest.mark.slow
def test_shifted_worlds_stay_within_their_spread_and_on_their_grid() -> None:
    seeds = range(6)
    world = shifted(seeds, 0.75)
    for values, nominal in ((world.speed_mps, 6.0), (world.separation_m, 2.3)):
        assert np.ptp(values) > 0.3 * nominal
        assert np.abs(np.asarray(values) / nominal - 1.0).max() <= 0.75
    flown = fly(seeds, world=world, seconds=2.0)
    assert np.isfinite(flown.force_n).all()
    bottom_m = world.grid.bottom_m
    assert bottom_m < -np.max(world.separation_m) - 0.5
    again = fly([3], world=shifted([3], 0.75), seconds=2.0)
    assert np.array_equal(again.force_n[:, 0], flown.force_n[:, 3])


@pytest.mark.whole
def test_a_set_has_both_kinds_of_flight_and_repeats_exactly(monkeypatch) -> None:
    """Of episodes of 5 s, which are flown as those of 20 s are."""
    fly = functools.partial(downwash.fly, seconds=5.0)
    monkeypatch.setattr(downwash, "fly", fly)
    one, two = (make_set(minutes=0.5, seed=1, spread=0.1) for _ in range(2))
    assert one.sha256 == two.sha256
    assert len(one.episodes) == 3
    assert set(one.split.values()) == {"train", "validation", "test"}
    assert one.sha256 != make_set(minutes=0.5, seed=2, spread=0.1).sha256
    plain = make_set(minutes=0.5, seed=1).episodes  # by turns without and with roughly the force
    for number, episode in enumerate(plain):
        alone = fly([2_000_000 + number], expect="nothing")
        same = np.allclose(episode.force, alone.force_n[: len(episode), 0], atol=1e-5)
        assert same is (number % 2 == 0)


def test_differences_of_own_motion_tell_most_of_the_force() -> None:
    """m·(a_source − a_sufferer), less the thrusts: why a table has lines kept from that past."""
    world = World()
    flown = fly([5], world=world, seconds=3.0)
    seen = dict(zip((c.name for c in OBSERVATION), flown.observation[:, 0].T, strict=True))
    told = seen["source_thrust_z_n"] - seen["sufferer_thrust_z_n"]
    told = told[:-1] - world.mass_kg * np.diff(seen["dvz_mps"]) / DT_S
    force_n = flown.force_n[:-1, 0, 1]
    assert np.sqrt(np.mean((told - force_n) ** 2)) < 0.3 * force_n.std()
    assert {"dvz_mps", "sufferer_thrust_z_n"} <= set(OWN_MOTION)
    assert "source_thrust_z_n" not in OWN_MOTION


@pytest.mark.whole
def test_ways_go_as_far_and_as_fast_as_the_world_says() -> None:
    column = {channel.name: i for i, channel in enumerate(OBSERVATION)}

    def flown(**estimates: float) -> np.ndarray:
        world = World(**estimates)
        return fly([1, 2, 3, 4], seconds=8.0, expect="truth", world=world).observation

    def spread(name: str, observed: np.ndarray) -> float:
        return float(observed[..., column[name]].std())

    usual = flown()
    assert spread("dx_m", flown(sway_m=0.2)) == pytest.approx(0.5 * spread("dx_m", usual), rel=0.1)
    assert spread("dvx_mps", flown(turning_rad_ps=1.75)) < 0.65 * spread("dvx_mps", usual)
    still = spread("source_thrust_z_n", flown(heave_m=0.0, sway_m=0.0))
    assert still < 0.2 * spread("source_thrust_z_n", flown(sway_m=0.0))


@pytest.mark.whole
def test_the_command_writes_a_set(tmp_path) -> None:
    out = tmp_path / "downwash"
    told = CliRunner().invoke(main, ["data", "make", "downwash", "--out", str(out), "--minutes",
                                     "0.5"])  # fmt: skip
    assert told.exit_code == 0, told.output
    assert read_episode_set(out).domain == "downwash"
