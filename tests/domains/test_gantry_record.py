"""Simulated flights repeat, are dirty where they should be, and gain from the truth fed forward."""

import math
from pathlib import Path

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import _job, episode_from_log, make_set, record
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

RIG = default_rig()


def tracking_mm(log: RunLog) -> float:
    return 1e3 * log.tracking_rmse_m("true_z_m")


@pytest.fixture(scope="module")
def pid_flight() -> RunLog:
    return record(None, seconds=15.0, seed=3)


def test_a_flight_repeats_by_seed(pid_flight: RunLog) -> None:
    again = record(default_rig(), seconds=15.0, seed=3)
    other = record(None, seconds=1.0, seed=4)
    for name, values in pid_flight.columns.items():
        assert np.array_equal(values, again[name], equal_nan=values.dtype != object), name
    assert not np.array_equal(pid_flight["z_est_m"][:128], other["z_est_m"][:128])


def test_three_seconds_of_rest_stand_before_and_after(pid_flight: RunLog) -> None:
    resting = pid_flight["mode"] == "ARMED"
    landing = np.flatnonzero(pid_flight["mode"] == "LANDING")
    assert 0 < len(landing) < 64
    assert len(pid_flight) == round((15.0 + 6.0) * 32) + len(landing)
    assert np.all(resting[:96])
    assert np.all(resting[-96:])
    assert not np.any(resting[96:-96])
    assert np.all(pid_flight["sufferer_cmd_us"][resting] == 1000.0)
    assert np.all(np.abs(pid_flight["true_z_m"][-64:]) < 1e-6)
    assert np.all(pid_flight["homed"][-64:] == 1.0)


def test_the_flight_follows_its_reference(pid_flight: RunLog) -> None:
    assert tracking_mm(pid_flight) < 150.0
    assert np.ptp(pid_flight["true_z_m"]) > 0.3
    assert np.ptp(pid_flight["x_m"]) > 0.05
    error_m = (pid_flight["z_est_m"] - pid_flight["true_z_m"])[96:-96]
    assert np.std(error_m) < 0.008


def test_commands_wait_for_the_servo_frame(pid_flight: RunLog) -> None:
    """50 Hz against 32 Hz: the time from tick to pulse is a sawtooth within 20 ms."""
    sent_s = pid_flight["t_s"][96:-97]
    applied_s = pid_flight["applied_time_s"][97:-96]
    wait_s = applied_s - sent_s
    assert np.ptp(wait_s) > 0.015
    assert np.max(wait_s) < 0.04


@pytest.mark.slow
def test_the_truth_fed_forward_helps_and_its_future_helps_more() -> None:
    flown = {
        lead_s: np.mean(
            [tracking_mm(record(None, seconds=10.0, seed=s, lead_oracle_s=lead_s)) for s in (1, 2)]
        )
        for lead_s in (None, 0.0, default_lead_s(RIG))
    }
    assert flown[0.0] < 0.5 * flown[None]
    assert flown[default_lead_s(RIG)] < 0.6 * flown[0.0]


def test_each_disturbance_can_be_switched_off() -> None:
    clean = RIG.changed(
        disturbance={
            "turbulence_fraction": 0.0,
            "outlier_probability": 0.0,
            "clock_jitter_s": 0.0,
            "rest_s": 0.0,
            "esc_frame_s": 0.0,
        },
        range_sensor={"noise_m": 0.0, "resolution_m": 0.0},
    )
    log = record(clean, seconds=8.0, seed=1)
    assert len(log) == 8 * 32 + 56 + 1  # the touch-down, and the tick that switches the motors off
    assert np.allclose(np.diff(log["t_s"]), 1 / 32, atol=1e-12)
    # In flight: a touch-down carries less than the weight, which the filter takes for a fall.
    assert np.nanmax(np.abs(log["innovation_m"][: 8 * 32])) < 0.03


@pytest.mark.whole
def test_a_hidden_force_reaches_the_flight_and_its_own_column() -> None:
    log = record(None, seconds=10.0, seed=1, force_hook=lambda t, state: -0.3)
    plain = record(None, seconds=10.0, seed=1)
    assert np.all(log["true_hook_force_n"][log["mode"] == "RUNNING"] == -0.3)
    thrust_n, without_n = (
        np.mean([RIG.thrust.sufferer.thrust(us) for us in commands])
        for flown in (log, plain)
        for commands in [flown["sufferer_cmd_us"][flown["mode"] == "RUNNING"]]
    )
    assert thrust_n - without_n > 0.1


def test_a_wake_hook_cannot_be_foreseen() -> None:
    with pytest.raises(UnusableInput, match="wake_hook"):
        record(None, seconds=5.0, seed=0, lead_oracle_s=0.09, wake_hook=lambda *a: (0.0, 0.0))


def test_a_sensor_that_goes_blind_brings_the_sufferer_down() -> None:
    def blind(t_s: float, range_m: float, steps: int) -> tuple[float, int]:
        return (math.nan if t_s > 8.0 else range_m), steps

    log = record(None, seconds=10.0, seed=0, sensor_hook=blind)
    blind_ticks = log["t_s"] > 8.1
    assert np.all(np.isnan(log["range_m"][blind_ticks]))
    assert log["mode"][-1] == "FAILSAFE"
    assert "sensor_lost" in log["faults"][-1]
    assert log["true_z_m"][-1] < 0.05
    assert np.all(np.isfinite(log["z_est_m"]))


@pytest.mark.parametrize("lead_s", [-0.1, math.nan, math.inf, 5.0])
def test_an_impossible_lead_is_refused(lead_s: float) -> None:
    with pytest.raises(UnusableInput, match="lead_oracle_s"):
        record(None, seconds=5.0, seed=0, lead_oracle_s=lead_s)


def test_a_lead_beyond_the_jet_is_the_present_thrust_held() -> None:
    assert tracking_mm(record(None, seconds=8.0, seed=0, lead_oracle_s=1.0)) < 300.0


def test_the_loop_knows_its_own_rig_and_not_the_truth() -> None:
    """Two truths, one rig file: references and metadata are those of the file."""
    model = RIG.changed(sufferer={"mass_kg": 0.44})
    flown = [record(truth, seconds=8.0, seed=2, model_rig=model) for truth in (RIG, model)]
    flying = flown[0]["mode"] == "RUNNING"  # how they touch down differs
    assert np.array_equal(flying[:250], flown[1]["mode"][:250] == "RUNNING")
    assert np.array_equal(flown[0]["z_ref_m"][:250], flown[1]["z_ref_m"][:250])
    assert flown[0].metadata["rig_sha256"] == model.sha256
    heights_m = [log["true_z_m"][:250] for log in flown]
    assert not np.allclose(*heights_m, atol=1e-4)


@pytest.mark.whole
def test_a_set_splits_by_episode_and_repeats(monkeypatch) -> None:
    """Of episodes of 5 s, flown in this process: those of 25 s are flown alike."""
    monkeypatch.setattr("wakedeploy.domains.gantry.EPISODE_S", 5.0)
    data = make_set(None, minutes=0.25, seed=5, workers=1)
    assert len(data.episodes) == 3
    assert [data.split[e.name] for e in data.episodes][-2:] == ["validation", "test"]
    assert data.provenance["default_lead_s"] == default_lead_s(RIG)
    again = make_set(None, minutes=0.25, seed=5, workers=1)
    assert again.sha256 == data.sha256


def test_a_set_mixes_flights_without_and_with_feedforward() -> None:
    jobs = [_job(RIG, 0, i, ()) for i in range(8)]
    assert [job.oracle_s for job in jobs[:4]] == [None, 0.0, None, default_lead_s(RIG)]
    packages = (Path("a.onnx"), Path("b.onnx"))
    jobs = [_job(RIG, 0, i, packages) for i in range(8)]
    assert [job.package for job in jobs[:4]] == [None, packages[0], None, packages[1]]
    assert all(job.oracle_s is None for job in jobs)


def test_no_training_flight_is_one_that_a_person_flies() -> None:
    """`run-gantry --seed` counts from 0, training flights from a million."""
    assert min(_job(RIG, 0, i, ()).seed for i in range(100)) >= 1_000_000


def test_an_episode_holds_what_the_pilot_saw(pid_flight: RunLog) -> None:
    episode = episode_from_log(pid_flight, RIG, "flight")
    flying = pid_flight["mode"] == "RUNNING"
    assert episode.observation.shape == (15 * 32, 5)
    dz = RIG.source.height_m - pid_flight["z_est_m"][flying]
    assert np.allclose(episode.observation[:, 1], dz, atol=1e-6)
    assert np.allclose(episode.force[:, 0], pid_flight["true_wake_force_n"][flying], atol=1e-6)
