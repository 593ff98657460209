"""The menu of manoeuvres: within the limits of any rig, and what their names promise."""

import numpy as np
import pytest

from runtime.reference import PLAN_RATE_HZ
from runtime.reference_file import read_reference, require_flyable, write_reference
from wakedeploy.domains.gantry import record
from wakedeploy.gap.systems.gantry.planning.manoeuvres import menu
from wakedeploy.rig.file import default_rig

RIG = default_rig()
SMALL = RIG.changed(
    sufferer={"travel_m": 0.6},
    limits={"x_m": [-0.2, 0.25], "z_m": [-0.02, 0.58], "slew_us_per_s": 4000.0},
    stepper={"max_speed_mps": 0.2, "max_accel_mps2": 0.5},
)
NAMES = [each.name for each in menu()]
MENU = {each.name: each for each in menu()}


def test_names_are_unique_and_every_entry_says_what_it_does() -> None:
    assert len(set(NAMES)) == len(NAMES)
    assert all(each.description for each in menu())


@pytest.mark.parametrize("rig", [RIG, SMALL], ids=["default", "small"])
@pytest.mark.parametrize("name", NAMES)
def test_each_stays_within_the_rigs_limits(name: str, rig) -> None:
    plan = MENU[name].plan(rig)
    require_flyable(plan, rig, name)
    assert np.max(plan.z_m) > 0.15 * rig.sufferer.travel_m
    rest_s = 2.0 * rig.disturbance.rest_s
    assert MENU[name].seconds(rig) == pytest.approx(len(plan) / PLAN_RATE_HZ + rest_s)


def test_as_a_file_it_is_the_same_flight(tmp_path) -> None:
    plan = MENU["source-steps-both"].plan(RIG)
    write_reference(tmp_path / "plan.csv", plan, RIG)
    back = read_reference(tmp_path / "plan.csv", RIG)
    np.testing.assert_allclose(back.source_us, plan.source_us, atol=1e-3)
    np.testing.assert_allclose(back.z_m, plan.z_m, atol=1e-6)


@pytest.mark.whole
@pytest.mark.parametrize("name", ["triangles-both", "carriage-fast", "height-chirp-wake"])
def test_the_simulated_gantry_flies_it_whole(name: str) -> None:
    plan = MENU[name].plan(RIG)
    log = record(RIG, seconds=0.0, seed=3, plan=plan)
    assert log.flying.sum() == len(plan)
    assert np.std(log["true_z_m"][log.flying] - plan.z_m) < 0.08


def test_passes_go_both_ways_at_the_speed_they_are_named_for() -> None:
    for name, share in (("carriage-slow", 0.3), ("carriage-fast", 0.9)):
        speed = np.diff(MENU[name].plan(RIG).x_m) * PLAN_RATE_HZ
        top = share * RIG.stepper.max_speed_mps
        inner = slice(5 * 32, -5 * 32)  # without the ways out and home
        assert speed[inner].max() == pytest.approx(top, rel=0.15)
        assert speed[inner].min() == pytest.approx(-top, rel=0.15)


def test_triangles_hold_their_speeds_in_still_air() -> None:
    plan = MENU["triangles-both"].plan(RIG)
    speed = np.abs(np.diff(plan.z_m)) * PLAN_RATE_HZ
    top_m = min(RIG.sufferer.travel_m, RIG.limits.z_m[1]) / RIG.sufferer.travel_m
    for wanted in (0.08, 0.4):
        assert np.sum(np.abs(speed - wanted * top_m) < 0.01 * wanted) > 1.5 * PLAN_RATE_HZ
    assert np.all(plan.source_us == RIG.limits.pulse_us[0])
