"""Pairs of flights: the same reference without and with the wake, and what lies between them."""

import numpy as np
import pytest

from runtime.pair import fly_pairs, legs
from runtime.pair_wake import PairWake, combined, compare
from runtime.reference import hold_plan, random_plan
from runtime.request import RunRequest
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.domains.gantry import record
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.5})


def test_the_order_alternates_so_that_a_draining_battery_is_no_wake(tmp_path):
    flown = legs(tmp_path, 3)
    assert [leg.wake for leg in flown] == ["off", "on", "on", "off", "off", "on"]
    assert [leg.log.name for leg in flown[:2]] == ["wake-off-01.mcap", "wake-on-01.mcap"]
    assert [leg.order for leg in flown] == [1, 2] * 3
    assert [leg.log.name for leg in legs(tmp_path, 1)] == ["wake-off.mcap", "wake-on.mcap"]


def test_a_plan_without_wake_differs_in_nothing_but_the_source():
    plan = random_plan(RIG, 8.0, 3)
    calm = plan.without_wake(1000.0)
    assert set(calm.source_us) == {1000.0}
    assert np.ptp(plan.source_us) > 100.0
    for tick in (0, 77, 200):
        with_it, without = plan.at(tick, 0.05), calm.at(tick, 0.05)
        assert without.source_us == 1000.0
        assert without.z_m == with_it.z_m
        assert without.x_m == with_it.x_m
        assert without.az_mps2 == with_it.az_mps2


def test_no_flight_begins_when_a_later_one_could_not_be_recorded(tmp_path):
    (tmp_path / "wake-on.mcap").write_bytes(b"an earlier one")
    with pytest.raises(UnusableInput, match=r"wake-on\.mcap: there is already a recording"):
        fly_pairs(RunRequest(RIG, 6.0), tmp_path)
    assert not (tmp_path / "wake-off.mcap").exists()
    assert (tmp_path / "wake-on.mcap").read_bytes() == b"an earlier one"


def test_who_says_no_between_the_flights_keeps_the_first(tmp_path, monkeypatch):
    asked, flown = [], []
    monkeypatch.setattr("runtime.pair.fly", lambda request, *_: flown.append(request))
    with pytest.raises(CheckFailed, match="wake on was not flown"):
        fly_pairs(RunRequest(RIG, 6.0, port="/x"), tmp_path, ask=asked.append)
    assert [request.wake_off for request in flown] == [True]
    assert len(asked) == 1
    assert "source running" in asked[0]


@pytest.fixture(scope="module")
def pair():
    """The thrust is a tenth less than both flights' rig file says, which must cancel."""
    weaker = [0.9 * thrust for thrust in RIG.thrust.sufferer.thrust_n]
    truth = RIG.changed(thrust={"sufferer": {"thrust_n": weaker}})
    plan = random_plan(RIG, 14.0, 5)
    fly = {"seconds": 14.0, "model_rig": RIG}
    off = record(truth, seed=11, plan=plan.without_wake(1000.0), **fly)
    return off, record(truth, seed=12, plan=plan, **fly)


@pytest.mark.whole
def test_the_difference_is_the_wake_though_the_thrust_curve_is_wrong(pair):
    off, on = pair
    (wake,) = compare([pair], RIG)
    assert wake.rmse_off_m == off.tracking_rmse_m() < on.tracking_rmse_m() == wake.rmse_on_m
    assert wake.airborne_s > 9.0
    both = min(len(on), len(off))  # one may touch down later
    airborne = on.flying[:both] & (on["true_z_m"][:both] > 0.05) & (off["true_z_m"][:both] > 0.05)
    true_n = on["true_wake_force_n"][:both][airborne]
    # What carries the wake is a tenth less than the rig file says, too: that does not cancel.
    assert wake.mean_n == pytest.approx(np.mean(true_n) / 0.9, abs=3.0 * wake.mean_sd_n)
    assert wake.max_abs_n == pytest.approx(np.max(np.abs(true_n)), rel=0.3)
    assert wake.thrust_n == pytest.approx(-np.mean(true_n), rel=0.3)
    assert 0.0 < wake.mean_sd_n < 0.05
    assert wake.noise_abs_n < 0.3 * wake.mean_abs_n


@pytest.mark.slow
def test_two_flights_without_wake_differ_by_no_more_than_their_error(pair):
    off, _ = pair
    plan = random_plan(RIG, 14.0, 5).without_wake(1000.0)
    again = record(RIG, seconds=14.0, seed=13, plan=plan)
    other = record(RIG, seconds=14.0, seed=14, plan=plan)
    (wake,) = compare([(again, other)], RIG)
    assert abs(wake.mean_n) < 4.0 * wake.mean_sd_n
    # Of the weaker thrust against the right one nothing cancels.
    (weaker,) = compare([(again, off)], RIG)
    assert weaker.mean_n < -0.3


def test_flights_that_hardly_leave_the_stop_have_tracking_only():
    plan = hold_plan(RIG, 6.0, 0.01, 1000.0)
    log = record(RIG, seconds=6.0, seed=1, plan=plan)
    (wake,) = compare([(log, log)], RIG)
    assert not wake.is_measured
    assert wake.rmse_on_m > 0.0
    assert np.isnan(combined([wake])).all()


def test_the_error_of_several_pairs_is_the_wider_of_their_own_and_their_spread():
    def one(mean_n):
        return PairWake(0.0, 0.0, airborne_s=9.0, mean_n=mean_n, mean_sd_n=0.02)

    assert combined([one(-0.5)]) == pytest.approx((-0.5, 0.02))
    assert combined([one(-0.5)] * 4) == pytest.approx((-0.5, 0.01))
    assert combined([one(-0.3), one(-0.7)]) == pytest.approx((-0.5, 0.2))
