"""The modes, transition by transition, and the pure steps around them."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.loop import safety
from runtime.loop.safety import Event, Findings, Gate, Mode, SafetyState, next_mode, watch
from wakedeploy.core.rig_sections import Limits

LIMITS = Limits()

# Written out again on purpose: from, event, to. What is not listed changes nothing.
EXPECTED = {
    ("DISARMED", "ARM", "ARMED"),
    ("ARMED", "START", "RUNNING"),
    ("ARMED", "FAULT", "FAILSAFE"),
    ("ARMED", "DISARM", "DISARMED"),
    ("RUNNING", "TROUBLE", "DEGRADED"),
    ("RUNNING", "LAND", "LANDING"),
    ("RUNNING", "FINISH", "ARMED"),
    ("RUNNING", "FAULT", "FAILSAFE"),
    ("RUNNING", "DISARM", "DISARMED"),
    ("DEGRADED", "RECOVERED", "RUNNING"),
    ("DEGRADED", "LAND", "LANDING"),
    ("DEGRADED", "FINISH", "ARMED"),
    ("DEGRADED", "FAULT", "FAILSAFE"),
    ("DEGRADED", "DISARM", "DISARMED"),
    ("LANDING", "FINISH", "ARMED"),
    ("LANDING", "FAULT", "FAILSAFE"),
    ("LANDING", "DISARM", "DISARMED"),
    ("FAILSAFE", "DISARM", "DISARMED"),
}


@pytest.mark.parametrize(("mode", "event"), list(itertools.product(Mode, Event)))
def test_each_mode_answers_each_event_as_the_table_says(mode, event):
    listed = [to for start, name, to in EXPECTED if (start, name) == (mode.value, event.name)]
    assert next_mode(mode, event) == Mode(listed[0] if listed else mode.value)


@given(st.lists(st.sampled_from([e for e in Event if e is not Event.DISARM])))
def test_a_failsafe_is_latched(events):
    mode = Mode.FAILSAFE
    for event in events:
        mode = next_mode(mode, event)
    assert mode is Mode.FAILSAFE


@given(st.lists(st.sampled_from(Event)))
def test_nothing_flies_without_arming_and_starting(events):
    mode, armed, started = Mode.DISARMED, False, False
    for event in events:
        mode = next_mode(mode, event)
        armed |= event is Event.ARM
        started |= event is Event.START
        if mode in (Mode.RUNNING, Mode.DEGRADED, Mode.LANDING):
            assert armed
            assert started


def run(state, findings):
    for found in findings:
        state = watch(state, found, LIMITS)
    return state


RUNNING, CLEAN, LATE = SafetyState(Mode.RUNNING), Findings(), Findings(late=True)


def test_late_predictions_degrade_only_in_a_row():
    assert run(RUNNING, [LATE, LATE, CLEAN] * 5).mode is Mode.RUNNING
    assert run(RUNNING, [LATE] * 3).mode is Mode.DEGRADED


@pytest.mark.parametrize(
    ("found", "name"),
    [
        (Findings(bad_prediction=True), "bad_prediction"),
        (Findings(bad_observation=True), "bad_observation"),
        (Findings(doubted=True), "prediction_doubted"),
        (Findings(range_late=9.5), "range_doubted"),
        (Findings(link_silence_s=0.2), "answers_missing"),
        (Findings(late_answers=3), "answers_late"),
    ],
)
def test_what_spoils_the_feedforward_degrades_at_once_and_is_named(found, name):
    state = run(RUNNING, [found])
    assert state.mode is Mode.DEGRADED
    assert state.faults == (name,)


def test_one_bad_sample_is_named_and_flown_with():
    state = run(RUNNING, [Findings(bad_range=True)])
    assert state.mode is Mode.RUNNING
    assert state.faults == ("bad_range",)


def test_recovery_needs_a_clean_second():
    degraded = run(RUNNING, [LATE] * 3)
    assert run(degraded, [CLEAN] * 31).mode is Mode.DEGRADED
    assert run(degraded, [CLEAN] * 32).mode is Mode.RUNNING
    assert run(degraded, [CLEAN] * 31 + [LATE] + [CLEAN] * 31).mode is Mode.DEGRADED


def test_what_passes_soon_ends_no_flight():
    soon = Findings(
        stalled_s=0.1,
        range_jump_m=0.3,  # from a sensor that says the same: the sufferer has moved
        range_frozen_s=0.7,
        not_lifting_s=0.9,
        battery_gone_s=0.2,
        thrust_share=2.0,
        late_commands=7,
        unexplained_s=0.4,
    )
    assert run(RUNNING, [soon]).mode is Mode.RUNNING


@pytest.mark.parametrize(
    ("found", "name"),
    [
        (Findings(link_failed=True), "link_lost"),
        (Findings(link_silence_s=0.6), "link_lost"),
        (Findings(link_silence_s=0.2, stalled_s=0.19), "loop_stalled"),
        (Findings(link_failed=True, stalled_s=0.19), "link_lost"),
        (Findings(range_jump_m=0.15, range_frozen_s=0.07), "sensor_jump"),
        (Findings(is_noisy=True), "sensor_noisy"),
        (Findings(held_up_mps=1.6), "height_impossible"),
        (Findings(range_silence_s=0.3), "sensor_lost"),
        (Findings(mcu_fault=True), "mcu_fault"),
        (Findings(range_frozen_s=0.8), "sensor_frozen"),
        (Findings(not_lifting_s=1.1), "thrust_lost"),
        (Findings(z_m=-0.1, thrust_share=1.2), "thrust_lost"),
        (Findings(z_m=-0.1, thrust_share=1.0), "z_limit"),
        (Findings(z_m=1.2, thrust_share=1.2), "z_limit"),
        (Findings(battery_gone_s=0.3), "battery_lost"),
        (Findings(recorder_failed=True), "recorder_failed"),
        (Findings(stop_asked=True), "operator_stop"),
        (Findings(late_commands=8), "commands_late"),
        (Findings(unexplained_s=0.6), "motion_unexplained"),
        (Findings(range_late=12.5), "range_late"),
        (Findings(tick_failed=True), "loop_error"),
        (Findings(moves_unseen=True), "sensor_frozen"),
        (Findings(rises_unseen=True), "thrust_lost"),
        (Findings(x_m=0.7), "x_limit"),
        (Findings(x_m=float("nan")), "x_limit"),
        (Findings(z_m=1.2), "z_limit"),
        (Findings(z_m=-0.1), "z_limit"),
    ],
)
def test_each_fault_ends_the_flight_and_its_cause_is_kept(found, name):
    for mode in (Mode.ARMED, Mode.RUNNING, Mode.DEGRADED):
        state = run(SafetyState(mode), [found, CLEAN, Findings(z_m=9.0)])
        assert (state.mode, state.cause) == (Mode.FAILSAFE, (name,))


def test_an_observation_is_far_outside_beyond_half_the_trained_range():
    low, high = np.float32([0.0, -1.0]), np.float32([1.0, 1.0])
    assert not safety.far_outside(np.float32([1.4, -1.9]), low, high)
    for bad in ([1.6, 0.0], [0.0, -2.1], [np.nan, 0.0], [np.inf, 0.0]):
        assert safety.far_outside(np.float32(bad), low, high)


@given(st.lists(st.one_of(st.none(), st.floats(-2.0, 2.0)), max_size=40))
def test_the_feedforward_opens_and_closes_within_four_ticks_without_a_jump(forces):
    now = Gate()
    for force in forces:
        after = safety.gate(now, force)
        assert abs(after.share - now.share) <= 0.25
        assert 0.0 <= after.share <= 1.0
        assert after.force_n == (now.force_n if force is None else force)
        now = after
