"""Servo frames that are not the rig file's: what a log tells of them, and that they are named."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from recorded import RIG, changed, flown, with_effects

from wakedeploy.domains.gantry import record
from wakedeploy.gap.flight import flight_from_log
from wakedeploy.gap.forces import Physics
from wakedeploy.gap.frames import period_s, reported_period_s
from wakedeploy.gap.gantry import GantryModel
from wakedeploy.gap.naming import fitted_base
from wakedeploy.gap.ranking import rank
from wakedeploy.physics.constants import constants_of

TICK_S = 0.03125
SEEDS = (40, 41, 42)


def with_frame(frame_s: float):
    """The default rig with another servo frame."""
    return RIG.changed(disturbance={"esc_frame_s": frame_s})


def seen(frame_s: float, jitter_s: float, seed: int, step_s: float = 0.0):
    """Ticks, and the newest frame's time at each as a board reports it, 22 s long."""
    rng = np.random.default_rng(seed)
    late_s, asked_s, read_s = jitter_s * np.abs(rng.standard_normal((3, 700)))
    ticks_s = 0.1 + TICK_S * np.arange(700) + late_s
    phase_s = rng.uniform(0.0, frame_s)
    board_s = ticks_s - 0.029 + asked_s
    frames_s = phase_s + frame_s * np.floor((board_s - phase_s) / frame_s)
    if step_s > 0.0:
        frames_s = step_s * np.ceil(frames_s / step_s)
    return ticks_s, frames_s + read_s


def strangeness(frame_s: float) -> float:
    """How far a tick is from a whole number of frames, of which half would do as well."""
    return abs(TICK_S / frame_s - round(TICK_S / frame_s))


@given(st.floats(0.005, 0.06), st.floats(0.0, 3e-4), st.integers(0, 99))
@example(0.005, 0.0, 0)
@example(0.010, 0.0, 0)
@example(0.0125, 1e-4, 0)
@example(0.038, 3e-4, 0)
@settings(max_examples=60, deadline=None)
def test_a_period_is_told_rightly_or_not_at_all(frame_s, jitter_s, seed) -> None:
    told_s = reported_period_s(*seen(frame_s, jitter_s, seed))
    if frame_s > 0.008 and strangeness(frame_s) > 0.03:
        assert told_s is not None
    if told_s is not None:
        assert told_s == pytest.approx(frame_s, rel=1e-3)


@given(st.floats(0.005, 0.06), st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_a_board_that_looks_every_4_ms_tells_no_wrong_period(frame_s, seed) -> None:
    told_s = reported_period_s(*seen(frame_s, 3e-4, seed, 1.0 / 256.0))
    assume(told_s is not None)
    assert told_s == pytest.approx(frame_s, rel=2e-3)


@pytest.mark.parametrize("frame_s", [TICK_S, TICK_S / 2, TICK_S / 3, TICK_S / 5])
def test_frames_that_keep_step_with_the_ticks_do_not_tell_their_period(frame_s) -> None:
    """They look like frames as long as the ticks are apart, whatever their number."""
    assert reported_period_s(*seen(frame_s, 0.0, 1)) is None


def test_times_on_no_grid_tell_no_period() -> None:
    rng = np.random.default_rng(0)
    ticks_s = TICK_S * np.arange(700)
    assert reported_period_s(ticks_s, np.full(700, 0.5)) is None
    assert reported_period_s(ticks_s, ticks_s - rng.uniform(0.0, TICK_S, 700)) is None
    assert reported_period_s(ticks_s[:10], ticks_s[:10]) is None


# Of 40 ms each second frame of the rig file's would be one, and the times lie on its grid, too.
@pytest.mark.parametrize("frame_s", [0.013, 0.038, 0.040])
def test_a_flight_keeps_the_frames_of_its_log_beside_the_rig_files(frame_s) -> None:
    log = record(with_frame(frame_s), seconds=12.0, seed=SEEDS[0], model_rig=RIG)
    flight = flight_from_log(log.without_truth(), RIG, "x")
    assert np.diff(flight.frame_s) == pytest.approx(0.020)
    assert period_s(flight.reported_frame_s) == pytest.approx(frame_s, rel=1e-4)
    applied_s = log["applied_time_s"][log["applied_time_s"] > 0.1]
    late_s = (applied_s - flight.reported_frame_s[0] + 0.5 * frame_s) % frame_s - 0.5 * frame_s
    assert np.abs(late_s).max() < 0.005  # the plant looks every 4 ms
    said = f"every {1e3 * frame_s:g} ms, the rig file every 20: esc_frame_s"
    assert said in " ".join(flight.notes)
    assert f"should be {frame_s:g}" in " ".join(flight.notes)


def test_a_rig_file_that_has_the_frame_is_not_contradicted() -> None:
    log = record(with_frame(0.038), seconds=12.0, seed=SEEDS[0], model_rig=RIG).without_truth()
    as_effect = with_effects(esc_frame={"frame_s": (0.0379, "s")})
    for rig in (with_frame(0.038), as_effect):
        assert flight_from_log(log, rig, "x").notes == ()
    assert flight_from_log(log, with_frame(0.038), "x").reported_frame_s is None


def test_a_board_whose_clock_is_off_keeps_its_phase() -> None:
    """By 0.1 % the rig file's frames would slip by a whole one within the flight."""
    log = record(RIG, seconds=20.0, seed=SEEDS[0]).without_truth()
    slow = changed(log, applied_time_s=1.001 * log["applied_time_s"], t_s=1.001 * log["t_s"])
    flight = flight_from_log(slow, RIG, "x")
    assert flight.notes == ()
    assert flight.reported_frame_s is None
    assert period_s(flight.frame_s) == pytest.approx(1.001 * 0.020, rel=1e-5)


def test_a_column_that_does_not_tell_leaves_the_rig_files_frames() -> None:
    log = record(with_frame(0.038), seconds=12.0, seed=SEEDS[0], model_rig=RIG).without_truth()
    for column in (np.full(len(log), np.nan), np.full(len(log), 0.3)):
        flight = flight_from_log(changed(log, applied_time_s=column), RIG, "x")
        assert flight.reported_frame_s is None
        assert np.diff(flight.frame_s) == pytest.approx(0.020)
        assert "does not tell when the ESCs take a pulse" in " ".join(flight.notes)


def test_with_the_logs_period_thrusts_are_those_of_the_rig_that_has_it() -> None:
    truth = with_frame(0.038)
    log = record(truth, seconds=12.0, seed=SEEDS[0], model_rig=RIG).without_truth()
    constants = constants_of(RIG) | {"disturbance.esc_frame_s": 0.038}
    found = Physics(RIG, flight_from_log(log, RIG, "x")).forces(constants, ())
    true = Physics(truth, flight_from_log(log, truth, "x")).forces(constants, ())
    plain = Physics(RIG, flight_from_log(log, RIG, "x")).forces(constants_of(RIG), ())
    away_n = np.abs(plain.sufferer_n - true.sufferer_n)
    assert np.abs(found.sufferer_n - true.sufferer_n).max() < 0.02 * away_n.max()
    assert away_n.max() > 0.1


@pytest.mark.parametrize("frame_s", [0.013, 0.0225, 0.038])
def test_another_frame_than_the_rig_files_is_named(frame_s) -> None:
    """A base bends latency for it, from where the frames that the log tells would look absurd."""
    flights = [flown(seed, with_frame(frame_s)) for seed in SEEDS]
    model, base = fitted_base(GantryModel(RIG, flights))
    best, *others = rank(model, base, ["command-latency", "esc-frame", "spool-lag-sufferer"])
    assert best.name == "esc-frame"
    assert best.gain_nats > max(c.gain_nats for c in others) + 10.0
    assert best.fit.value("esc-frame.frame_s") == pytest.approx(frame_s, abs=0.0015)
