"""Servo frames that are not the rig file's: what a log tells of them, and that they are named."""

import functools

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from recorded import RIG, changed, flown, with_effects

from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.gap.systems.gantry.forces import Physics
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.gap.systems.gantry.servo_frames import frames_of, period_s, reported_period_s
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects.chain import Chain

TICK_S = 0.03125
SEEDS = (40, 41, 42)


def with_frame(frame_s: float):
    """The default rig with another servo frame."""
    return RIG.changed(disturbance={"esc_frame_s": frame_s})


@functools.cache
def logged(frame_s: float | None = None) -> RunLog:
    """A flight by the default rig file, flown once; of frames that are this long, or the file's."""
    truth = RIG if frame_s is None else with_frame(frame_s)
    return record(truth, seconds=12.0, seed=SEEDS[0], model_rig=RIG)


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
    log = logged(frame_s)
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
    log = logged(0.038).without_truth()
    as_effect = with_effects(esc_frame={"frame_s": (0.0379, "s")})
    for rig in (with_frame(0.038), as_effect):
        assert flight_from_log(log, rig, "x").notes == ()
    assert flight_from_log(log, with_frame(0.038), "x").reported_frame_s is None


@pytest.mark.whole
def test_a_board_whose_clock_is_off_keeps_its_phase() -> None:
    """By 0.1 % the rig file's frames would slip by a whole one within the flight."""
    log = record(RIG, seconds=20.0, seed=SEEDS[0]).without_truth()
    slow = changed(log, applied_time_s=1.001 * log["applied_time_s"], t_s=1.001 * log["t_s"])
    flight = flight_from_log(slow, RIG, "x")
    assert flight.notes == ()
    assert flight.reported_frame_s is None
    assert period_s(flight.frame_s) == pytest.approx(1.001 * 0.020, rel=1e-5)


def test_a_column_that_does_not_tell_leaves_the_rig_files_frames() -> None:
    log = logged(0.038).without_truth()
    for column in (np.full(len(log), np.nan), np.full(len(log), 0.3)):
        flight = flight_from_log(changed(log, applied_time_s=column), RIG, "x")
        assert flight.reported_frame_s is None
        assert np.diff(flight.frame_s) == pytest.approx(0.020)
        assert "does not tell when the ESCs take a pulse" in " ".join(flight.notes)


# Of a loop at 50 Hz any of these would seem to keep step with the rig file's frames of 20 ms.
@pytest.mark.parametrize("loop_s", [0.010, 0.020, TICK_S])
@pytest.mark.parametrize("step_s", [0.0, 0.001, 0.004])
@pytest.mark.parametrize("after_s", [0.0, 0.003, "the tick before"])
def test_a_column_that_copies_the_ticks_tells_no_frames(loop_s, step_s, after_s) -> None:
    rng = np.random.default_rng(3)
    ticks_s = 0.1 + loop_s * np.arange(1 + round(14.0 / loop_s))
    ticks_s += 3e-4 * np.abs(rng.standard_normal(len(ticks_s)))
    copied_s = ticks_s[1:] + after_s if after_s != "the tick before" else ticks_s[:-1]
    if step_s > 0.0:
        copied_s = step_s * np.floor(copied_s / step_s)
    log = RunLog({"t_s": ticks_s[1:], "applied_time_s": copied_s})
    frames = frames_of(log, RIG, np.arange(0.0, 14.0, 1.0 / 128.0))
    assert frames.reported_s is None
    assert frames.stated_s[1:3] == pytest.approx([0.010, 0.030])  # in the middle
    assert "does not tell when the ESCs take a pulse" in frames.doubt


@pytest.mark.parametrize("loop_s", [0.010, 0.020, TICK_S])
def test_logs_of_other_loops_tell_their_frames(loop_s) -> None:
    """The board's clock is 0.1 % off a loop's, or frames of 20 ms would keep step with some."""
    rng = np.random.default_rng(4)
    ticks_s = 0.1 + loop_s * np.arange(round(20.0 / loop_s))
    ticks_s += 3e-4 * np.abs(rng.standard_normal(len(ticks_s)))
    for frame_s in (0.01503, 0.02002, 0.038):
        told_s = frame_s * np.floor((ticks_s - 0.004) / frame_s) + 0.002
        for written_s in (told_s, np.round(told_s, 3), told_s.astype(np.float32).astype(float)):
            period = reported_period_s(ticks_s, written_s)
            assert period is None or period == pytest.approx(frame_s, rel=1e-3)
            assert period is not None or loop_s < TICK_S


def test_times_of_another_clock_tell_no_phase() -> None:
    log = logged().without_truth()
    of_its_own = changed(log, applied_time_s=log["applied_time_s"] + 1000.0)
    assert "does not tell when" in " ".join(flight_from_log(of_its_own, RIG, "x").notes)
    both = changed(of_its_own, t_s=log["t_s"] + 1000.0)
    assert flight_from_log(both, RIG, "x").notes == ()


@pytest.mark.parametrize(
    ("step_s", "said"), [(0.005, "multiples of 5 ms only"), (0.010, "does not tell when")]
)
def test_times_with_too_few_digits_tell_no_period(step_s, said) -> None:
    """They lie on the grid of their rounding, whatever the frames are."""
    for frame_s in (0.0125, 0.020, 0.038):
        ticks_s, frames_s = seen(frame_s, 1e-4, 0)
        rounded_s = step_s * np.floor(frames_s / step_s)
        assert reported_period_s(ticks_s, rounded_s) is None
    log = logged().without_truth()
    coarse = changed(log, applied_time_s=step_s * np.floor(log["applied_time_s"] / step_s))
    assert said in " ".join(flight_from_log(coarse, RIG, "x").notes)


def test_a_clock_of_coarse_ticks_tells_no_period() -> None:
    """Of 1/64 s, as of an operating system: both columns have it, and a loop at 50 Hz sees it."""
    ticks_s = np.floor((0.1 + 0.020 * np.arange(900)) * 64.0) / 64.0
    assert reported_period_s(ticks_s, ticks_s - 1.0 / 64.0) is None


def test_with_the_logs_period_thrusts_are_those_of_the_rig_that_has_it() -> None:
    truth = with_frame(0.038)
    log = logged(0.038).without_truth()
    constants = constants_of(RIG) | {"disturbance.esc_frame_s": 0.038}
    found = Physics(RIG, flight_from_log(log, RIG, "x")).forces(constants, Chain({}))
    true = Physics(truth, flight_from_log(log, truth, "x")).forces(constants, Chain({}))
    plain = Physics(RIG, flight_from_log(log, RIG, "x")).forces(constants_of(RIG), Chain({}))
    away_n = np.abs(plain.sufferer_n - true.sufferer_n)
    assert np.abs(found.sufferer_n - true.sufferer_n).max() < 0.02 * away_n.max()
    assert away_n.max() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("frame_s", [0.013, 0.0225, 0.038])
def test_another_frame_than_the_rig_files_is_named(frame_s) -> None:
    """A base bends latency for it, from where the frames that the log tells would look absurd."""
    flights = [flown(seed, with_frame(frame_s), seconds=12.0) for seed in SEEDS]
    model, base = fitted_base(GantryModel(RIG, flights))
    best, *others = rank(model, base, ["command-latency", "esc-frame", "spool-lag-sufferer"])
    assert best.name == "esc-frame"
    assert best.gain_nats > max(c.gain_nats for c in others) + 10.0
    assert best.fit.value("esc-frame.frame_s") == pytest.approx(frame_s, abs=0.0015)
