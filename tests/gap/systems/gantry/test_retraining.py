"""Retraining: errors on measured flights as arithmetic gives them; each rig with its package."""

import math

import numpy as np
import pytest
from scipy.stats import t as student

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.gantry import record
from wakedeploy.gap.systems.gantry.retraining import (
    Pilot,
    TrackingError,
    fly_both,
    retrain,
    rms_over_flights,
    rms_ratio,
)
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

TRUTH = default_rig()
OLD = TRUTH.without("spool")


def test_the_interval_is_that_of_equal_flights_mean_squares():
    squares = np.array([4.0, 6.0, 5.0, 9.0])
    value, (low, high) = rms_over_flights(np.stack([squares, np.full(4, 2.0)], 1))
    means = squares / 2.0
    assert value == pytest.approx(math.sqrt(means.mean()))
    error = means.std(ddof=1) / 2.0  # standard error of four
    log_half = student.ppf(0.95, 3) * error / means.mean() / 2.0  # of the root: half as much
    assert math.log(high / value) == pytest.approx(log_half)
    assert math.log(value / low) == pytest.approx(log_half)


def test_longer_flights_count_more():
    value, _ = rms_over_flights(np.array([[100.0, 100.0], [8.0, 2.0]]))
    assert value == pytest.approx(math.sqrt(108.0 / 102.0))


def test_one_flight_has_no_interval():
    value, interval = rms_over_flights(np.array([[8.0, 2.0]]))
    assert value == pytest.approx(2.0)
    assert interval is None


def test_paired_flights_compare_closely():
    rng = np.random.default_rng(6)
    hard = rng.uniform(0.5, 2.0, 6)  # flights differ a lot, and in the same way for both
    old = np.stack([100.0 * hard, np.full(6, 100.0)], 1)
    new = np.stack([25.0 * hard * rng.uniform(0.98, 1.02, 6), np.full(6, 100.0)], 1)
    ratio, (low, high) = rms_ratio(old, new)
    assert low < 0.5 < high
    assert high - low < 0.02
    assert ratio == pytest.approx(rms_over_flights(new)[0] / rms_over_flights(old)[0])


def test_the_interval_holds_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(2000):
        flights = rng.standard_normal((7, 200)) * rng.uniform(0.7, 1.3, (7, 1))
        _, (low, high) = rms_over_flights(np.stack([(flights**2).sum(1), np.full(7, 200.0)], 1))
        inside += low < math.sqrt((1.3**3 - 0.7**3) / 3 / 0.6) < high
    assert 0.86 < inside / 2000 < 0.94


def test_without_flights_nothing_is_trained(tmp_path):
    with pytest.raises(UnusableInput, match="at least one log"):
        retrain(OLD, TRUTH, [], tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_architecture_is_refused(tmp_path):
    log = tmp_path / "never-read.mcap"
    with pytest.raises(UnusableInput, match="transformer"):
        retrain(OLD, TRUTH, [log], tmp_path, arch="transformer")


@pytest.mark.slow
def test_both_pilots_fly_the_hidden_effect_with_their_own_rig():
    flown = fly_both(TRUTH, Pilot(OLD), Pilot(TRUTH), [4, 5], seconds=4.0, workers=2)
    for when, rig in (("before", OLD), ("after", TRUTH)):
        alone = [
            1e3 * record(TRUTH, seconds=4.0, seed=s, model_rig=rig).tracking_rmse_m("true_z_m")
            for s in (4, 5)
        ]
        error = getattr(flown.pid, when)
        assert error.per_flight == alone == getattr(flown.feedforward, when).per_flight
        assert error.rmse == pytest.approx(np.mean(alone))
        assert error.low < error.rmse < error.high


@pytest.mark.slow
def test_a_flight_that_a_failsafe_ends_has_no_error():
    light = TRUTH.changed(sufferer={"mass_kg": 0.1})  # rises above the limit under hover's thrust
    assert "FAILSAFE" in record(light, seconds=8.0, seed=4, model_rig=TRUTH)["mode"]
    flown = fly_both(light, Pilot(TRUTH), Pilot(TRUTH), [4], seconds=8.0, workers=1)
    assert flown.pid.before == TrackingError(None, None, None, [None])


@pytest.mark.slow
def test_the_corrected_rig_makes_the_better_predictor(tmp_path):
    logs = [record(TRUTH, seconds=16.0, seed=60 + i, model_rig=OLD) for i in range(3)]
    paths = []
    for i, log in enumerate(logs[:2]):
        paths.append(tmp_path / f"log{i}.mcap")
        log.without_truth().write_mcap(paths[-1])
    told = retrain(OLD, TRUTH, [*paths, logs[2]], tmp_path / "out", minutes=4, epochs=20)
    assert told.new_rmse < told.old_rmse
    assert told.ratio_interval[1] < 1.0
    assert told.label_sd < told.new_rmse < told.measured_rms
    assert told.flights == 3
    by_old = told.by_old_label
    assert by_old.flights == 3
    assert by_old.old_rmse != told.old_rmse  # another lag taken off is another force
    assert told.scored_on == [*(str(path) for path in paths), "flight2"]
    assert told.unit == "N"
    alone = retrain(OLD, TRUTH, paths[:1], tmp_path / "alone", minutes=2, epochs=1)
    assert (alone.flights, alone.ratio_interval) == (1, None)  # of one flight there is none
    assert told.lead_s == {"old": default_lead_s(OLD), "new": default_lead_s(TRUTH)}
    pilots = [
        Pilot(rig, tmp_path / "out" / f"{name}.onnx")
        for name, rig in (("old", OLD), ("new", TRUTH))
    ]
    flown = fly_both(TRUTH, *pilots, [70, 71], seconds=12.0)
    assert flown.feedforward.after.rmse < flown.feedforward.before.rmse
    assert flown.feedforward.after.rmse < 0.3 * flown.pid.after.rmse
