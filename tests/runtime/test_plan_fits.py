"""Plans and the rig's position limits: what is built in stays within, what does not is refused."""

import numpy as np
import pytest
from simulated_site import SimulatedSite

from runtime.calibration import noise, spool, thrust
from runtime.calibration.session import resting
from runtime.calibration.steps_per_metre import driving
from runtime.reference import ceiling_m, hold_plan, random_plan, require_plan_fits
from runtime.request import RunRequest
from runtime.run import fly
from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.systems.gantry.planning.manoeuvres import menu
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 1.0})
LOW = RIG.changed(limits={"z_m": [-0.05, 0.5]})
PLANS = {
    "random": lambda rig: random_plan(rig, 20.0, 3),
    "noise": noise.hovering,
    "thrust": thrust.swinging,
    "spool": spool.stepping,
}


@pytest.mark.whole
@pytest.mark.parametrize("name", PLANS)
def test_a_built_in_flight_stays_below_a_low_limit_and_ends_whole(name):
    plan = PLANS[name](LOW)
    require_plan_fits(plan, LOW)
    assert 0.3 < plan.z_m.max() <= ceiling_m(LOW) + 1e-9
    log = SimulatedSite(LOW, seed=2).flown(name, LOW, plan)  # which allows no failsafe
    assert set(log["mode"]) == {"ARMED", "RUNNING", "LANDING"}
    assert log["z_est_m"].max() > 0.3


@pytest.mark.parametrize("name", PLANS)
def test_a_limit_that_is_far_away_changes_no_plan(name):
    far = RIG.changed(limits={"z_m": [-0.05, 9.0]})
    for column in ("z_m", "x_m", "source_us"):
        here, there = (getattr(PLANS[name](rig), column) for rig in (RIG, far))
        assert np.array_equal(here, there)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("top_m", [0.15, 0.3, 0.5, 0.8])
def test_random_plans_fit_whatever_the_limit(seed, top_m):
    rig = RIG.changed(limits={"z_m": [-0.05, top_m]})
    plan = random_plan(rig, 20.0, seed)
    require_plan_fits(plan, rig)
    assert plan.z_m.max() > 0.4 * top_m


@pytest.mark.parametrize("top_m", [0.3, 0.5, 1.15])
def test_the_manoeuvres_that_gap_plans_fit(top_m):
    rig = RIG.changed(limits={"z_m": [-0.05, top_m]})
    for manoeuvre in menu():
        require_plan_fits(manoeuvre.plan(rig), rig)


def test_what_only_rests_or_drives_fits():
    for rig, plan in (resting(LOW, 2.0), driving(LOW, LOW.limits.x_m[1], 3.0)):
        require_plan_fits(plan, rig)


@pytest.mark.parametrize(
    ("limits", "plan", "sentence"),
    [
        ({"z_m": [-0.05, 0.5]}, hold_plan(RIG, 8.0, 0.46, 1400.0),
         "The plan rises to 0.46 m, and below limits.z_m = 0.5 m a flight needs room for control, "
         "so that 0.45 m are allowed: raise the limit or fly lower."),
        ({"z_m": [-0.005, 0.5]}, hold_plan(RIG, 8.0, 0.4, 1400.0),
         "The plan goes down to 0 m; it must end on the stop, at 0, and limits.z_m begin 0.01 m "
         "below that or lower, not at -0.005 m."),
        ({"z_m": [-0.5, 0.5]}, hold_plan(RIG, 8.0, -0.1, 1400.0), "The plan goes down to -0.1 m;"),
        ({"x_m": [-0.2, 0.3]}, driving(RIG, 0.4, 3.0)[1],
         "The plan drives the carriage from 0 to 0.4 m, and limits.x_m allows -0.2 to 0.3 m: "
         "widen it or drive less far."),
    ],
)  # fmt: skip
def test_a_plan_beyond_the_limits_is_refused_before_the_port_is_opened(limits, plan, sentence):
    rig = RIG.changed(limits=limits)
    with pytest.raises(UnusableInput) as refused:
        fly(RunRequest(rig, 0.0, plan=plan, port="/dev/none-there"))
    assert str(refused.value).startswith(sentence)


def test_a_reference_file_is_held_to_the_same_ceiling(tmp_path):
    t_s, path = np.arange(0.0, 8.0, 0.1), tmp_path / "reference.csv"
    rise = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.clip((t_s - 1.0) / 6.0, 0.0, 1.0))
    rows = [f"{t:.1f},{0.48 * z:.4f},0,1000" for t, z in zip(t_s, rise, strict=True)]
    path.write_text("\n".join(["t_s,z_m,x_m,source_us", *rows]))
    with pytest.raises(UnusableInput, match=r"rises to 0\.48 m"):
        fly(RunRequest(LOW, 0.0, reference=path, port="/dev/none-there"))
