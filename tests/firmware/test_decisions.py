"""The firmware decides as mcu.py and mcu_port.py of runtime/virtual do, within limits."""

import dataclasses
import math
import random

import needs
import numpy as np
import pytest
from decisions_library import (
    AT_ONCE,
    FRAME_TICKS,
    LIMITS,
    SHORT_LADDER,
    TICKS_PER_S,
    Board,
    LoopWatch,
    flying,
    library,
    unhurried,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.io.protocol import (
    SEQUENCE_WRAP,
    Arm,
    Command,
    Disarm,
    Fault,
    Frame,
    FrameDecoder,
    Hello,
    Status,
    encode_frame,
)
from runtime.loop.arming import arm_limits
from runtime.virtual.mcu_port import McuPort
from wakedeploy.rig.file import default_rig

pytestmark = needs.compiler

RESOLUTION_US = 0.5
PERIOD_TICKS = TICKS_PER_S / 32
RIG = default_rig().changed(latency={"round_trip_s": 0.0})
TICK_S = 1.0 / TICKS_PER_S
LATER_S = 1e-9  # a frame arrives between two ticks, where rounding decides nothing


class Twin:
    """The virtual gantry's board at the firmware's tick; its plant only counts and remembers."""

    def __init__(self) -> None:
        self.port = McuPort(RIG, boot_s=0.0)
        self.port.opened(0.0)
        self.decoder = FrameDecoder()
        self.tick = 0
        self.x_m, self.steps = 0.0, 0
        self.source_applied_us = self.sufferer_applied_us = 1000.0
        self.pulse_applied_s = LATER_S

    def hear(self, data: bytes) -> list[Frame]:
        now_s = self.tick * TICK_S + LATER_S
        self.port.receive(now_s, data)
        return list(self.decoder.feed(self.port.answer(now_s, self)))

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.tick % FRAME_TICKS == 0:
                self.source_applied_us, self.sufferer_applied_us = self.port._mcu._pulses
                self.pulse_applied_s = self.tick * TICK_S + LATER_S
            self.x_m += self.port.advance(self.tick * TICK_S, TICK_S).carriage_mps * TICK_S
            self.steps = math.floor(self.x_m * RIG.stepper.steps_per_m + 1e-6)
            self.tick += 1


def assert_same(ours: list[Frame], theirs: list[Frame]) -> None:
    """The two boards' answers, but for what they call themselves and what a pulse can resolve."""
    assert len(ours) == len(theirs)
    for our, their in zip(ours, theirs, strict=True):
        assert (our.sequence, our.time_us) == (their.sequence, their.time_us)
        if not isinstance(our.message, Status):
            assert our.message.version == their.message.version
            continue
        for name in ("sequence", "boot", "faults", "armed", "missed", "malformed"):
            assert getattr(our.message, name) == getattr(their.message, name), name
        assert our.message.applied_time_us == their.message.applied_time_us
        for name in ("source_us", "sufferer_us"):
            gap_us = abs(getattr(our.message, name) - getattr(their.message, name))
            assert gap_us <= RESOLUTION_US, name
        assert abs(our.message.steps - their.message.steps) <= 1


# Rates that the tick divides: the rest is rounded down, which has its own test.
ARMS = st.builds(
    Arm,
    st.sampled_from([1000.0, 1050.5, 900.0, 2000.0, 499.5]),
    st.sampled_from([2000.0, 1800.5, 1001.0, 1000.0, 2500.0, 2500.5]),
    st.integers(0, 80).map(lambda n: 625 * n),
    st.integers(0, 700),
    st.integers(0, 700),
    st.integers(0, 10_000),
    st.integers(0, 60).map(lambda n: 625 * n),
    st.integers(0, 300),
    st.integers(0, 300),
    st.integers(0, 8).map(lambda n: 625 * n),
)
ANY_PULSE = st.integers(0, 2**16 - 1).map(lambda half: half / 2)
USUAL_PULSE = st.floats(900, 2100)
MESSAGES = st.one_of(
    st.builds(Command, ANY_PULSE, USUAL_PULSE, st.integers(-12_000, 12_000), ANY_PULSE, ANY_PULSE),
    st.builds(
        Command, USUAL_PULSE, USUAL_PULSE, st.integers(-2500, 2500), USUAL_PULSE, USUAL_PULSE
    ),
    st.just(LIMITS),
    ARMS,
    st.just(Disarm()),
    st.sampled_from([Hello(), Hello(), Hello(0, 9), Hello(3, 5), Hello(0, 1)]),
)
AHEAD = st.sampled_from([1, 1, 1, 1, 1, 2, 0, -1, SEQUENCE_WRAP // 2, -SEQUENCE_WRAP // 2 + 1])
SENT = st.tuples(MESSAGES, AHEAD, st.sampled_from([None] * 9 + [3, 9]))
WAITS = st.one_of(st.integers(0, 700), st.integers(1200, 1300), st.integers(2000, 9000))


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([None, LIMITS, SHORT_LADDER, SHORT_LADDER]),
    st.integers(0, SEQUENCE_WRAP - 1),
    st.lists(st.tuples(SENT, WAITS), min_size=1, max_size=12),
)
def test_over_any_conversation_both_boards_say_the_same(limits, sequence, conversation):
    ours, theirs = Board(), Twin()
    opening = [((Hello(), 1, None), 3), ((limits, 1, None), 50)] if limits else []
    for (message, ahead, damaged), wait in opening + conversation:
        sequence = (sequence + ahead) % SEQUENCE_WRAP
        wire = bytearray(encode_frame(Frame(sequence, 0, message)))
        if damaged is not None:
            wire[damaged] ^= 0x55
        assert_same(ours.hear(bytes(wire)), theirs.hear(bytes(wire)))
        ours.run(wait)
        theirs.run(wait)
    last = encode_frame(Frame(sequence + 1, 0, Command(1500, 1500, 0, 1000, 1000)))
    assert_same(ours.hear(last), theirs.hear(last))
    assert not library().unbalanced_interrupts()


def test_unarmed_it_offers_idle_and_stands():
    board = Board()
    board.send(1, Hello())
    assert not board.send(2, Command(2000, 2000, 2000, 1000, 1000)).armed
    trace = board.run(5000)
    assert set(trace["source_half_us"]) == set(trace["sufferer_half_us"]) == {2000}
    assert not trace["step"].any()


def test_from_the_first_moment_a_board_idles():
    board = Board()
    first = board.run(1)
    assert (first["source_half_us"], first["sufferer_half_us"]) == (2000, 2000)
    untouched = Board()
    untouched.send(1, Hello())
    status = untouched.send(2, Disarm())
    assert (status.source_us, status.sufferer_us, status.applied_time_us) == (1000, 1000, 0)


def test_disarming_idles_the_motors_and_stops_the_carriage_at_once():
    board = flying()
    for sequence in range(3, 35):
        board.send(sequence, Command(1800, 1700, -2000, 1000, 1000))
        moving = board.run(312)
    assert moving["step"].sum() < -55
    assert moving["source_half_us"][-1] == 3600
    board.send(35, Disarm())
    after = board.run(1000)
    assert set(after["source_half_us"]) == set(after["sufferer_half_us"]) == {2000}
    assert not after["step"].any()


def test_the_deadman_holds_then_ramps_then_latches_to_the_tick():
    board = flying(AT_ONCE)
    board.send(3, Command(1800, 1700, 10_000, 1000, 1000))
    assert (board.run(626)["step"] == 1).all()  # a step a tick, the fastest there is
    stopped = board.run(624)
    assert not stopped["step"].any()  # 2 periods of silence and the carriage stands
    assert set(stopped["source_half_us"]) == {3600}  # while the pulses are held
    ramped = board.run(11)
    assert ramped["source_half_us"][0] == 3600
    assert ramped["source_half_us"][1] < 3600  # 4 periods have passed, 125 ms
    assert board.is_flying
    board.run(1)
    assert not board.is_flying  # and the descent's millisecond


def test_commands_are_missed_to_the_tick_half_a_period_after_they_were_due():
    board, sequence = flying(), 3
    for number in range(1, 9):
        due_tick = math.ceil((number + 0.5) * PERIOD_TICKS)
        board.run(due_tick - board.tick)
        asked = [board.send(sequence, LIMITS).missed]  # an Arm without a handshake is a question
        board.run(1)
        asked.append(board.send(sequence + 1, LIMITS).missed)
        assert asked == [number - 1, number]
        sequence += 2


def test_each_motor_takes_its_own_descent_time():
    board = flying()
    board.send(3, Command(2000, 2000, 0, 1000, 1000))
    trace = board.run(1251 + 10_000 + 10)
    for name, descent_ms in (("source_half_us", 250), ("sufferer_half_us", 1000)):
        moving = np.flatnonzero(trace[name][1000:] != 4000)
        idle = np.flatnonzero(trace[name][1000:] == 2000)
        assert moving[0] + 1000 == pytest.approx(1251, abs=descent_ms / 100)
        assert (idle[0] - moving[0]) / 10 == pytest.approx(descent_ms, rel=0.01)
    assert not board.is_flying


def test_without_commands_the_sufferer_brakes_sinks_and_ramps_to_the_tick():
    board = flying(SHORT_LADDER)
    board.send(3, Command(1800, 1700, 0, 1750, 1650))
    seen = board.run(1251 + 2000)
    assert set(seen["sufferer_half_us"][:1251]) == {3400}
    assert set(seen["sufferer_half_us"][1251:1451]) == {3500}  # 20 ms
    sinking = 3300 - 0.125 * np.arange(1, 401)  # 40 ms, 625 µs/s
    ramping = 3250 - 2.0 * np.arange(1, 626)  # the whole range within 100 ms
    expected = np.floor(np.concatenate([sinking, ramping]) + 0.5)
    assert (seen["sufferer_half_us"][1451 : 1451 + 1025] == expected).all()
    assert set(seen["sufferer_half_us"][1451 + 1025 :]) == {2000}
    source = np.maximum(2000, 3600 - 4 * np.arange(1, 2001))  # at once, within 50 ms
    assert (seen["source_half_us"][1251:] == source).all()


def test_the_latch_waits_for_the_longer_of_the_two_descents():
    for source_ms, latch_ms in ((50, 285), (160, 285), (161, 286)):
        board = flying(dataclasses.replace(SHORT_LADDER, source_descent_ms=source_ms))
        board.send(3, Command(1800, 1700, 0, 1750, 1650))
        board.run(10 * latch_ms + 1)
        assert board.is_flying
        board.run(1)
        assert not board.is_flying


DESCENDING = {"brake": 1300, "sink": 1500, "ramp": 1900}  # ticks of silence


@pytest.mark.parametrize("silent_ticks", DESCENDING.values(), ids=DESCENDING)
def test_a_command_before_the_latch_is_followed_at_once_and_begins_a_new_ladder(silent_ticks):
    board = flying(SHORT_LADDER)
    board.send(3, Command(1800, 1700, 0, 1750, 1650))
    board.run(silent_ticks)
    board.send(4, Command(1200, 1300, 0, 1400, 1350))
    seen = board.run(1452)
    assert set(seen["source_half_us"][:1251]) == {2400}
    assert set(seen["sufferer_half_us"][:1251]) == {2600}
    assert set(seen["sufferer_half_us"][1251:1451]) == {2800}
    assert seen["sufferer_half_us"][1451] == 2700


@pytest.mark.parametrize("silent_ticks", DESCENDING.values(), ids=DESCENDING)
def test_a_disarm_on_the_way_down_idles_at_once(silent_ticks):
    board = flying(SHORT_LADDER)
    board.send(3, Command(1800, 1700, 0, 1750, 1650))
    assert board.run(silent_ticks)["sufferer_half_us"][-1] > 2000
    board.send(4, Disarm())
    assert set(board.run(3000)["sufferer_half_us"]) == {2000}


def test_a_flight_in_which_no_command_has_come_descends_at_idle():
    board = flying(SHORT_LADDER)
    assert set(board.run(1600)["sufferer_half_us"]) == {2000}
    board.send(3, Command(1800, 1700, 0, 1750, 1650))
    board.send(4, Disarm())
    board.send(5, Hello())
    assert board.send(6, SHORT_LADDER).armed
    assert set(board.run(3000)["sufferer_half_us"]) == {2000}
    assert not board.is_flying


def test_on_the_way_down_too_no_pulse_leaves_the_limits():
    board = flying(dataclasses.replace(SHORT_LADDER, sink_rate_us_per_s=2**16 - 1))
    board.send(3, Command(1800, 1700, 0, 32_767.5, 1010))
    board.run(1251)
    assert set(board.run(200)["sufferer_half_us"]) == {4000}
    sinking = board.run(400)["sufferer_half_us"]
    assert sinking[0] > 2000
    assert set(sinking[2:]) == {2000}
    board = flying(SHORT_LADDER)
    board.send(3, Command(1800, 1700, 0, 0, 0))
    assert set(board.run(3000)["sufferer_half_us"][1251:]) == {2000}


def test_the_sufferer_brakes_and_sinks_no_faster_than_the_rigs_slew():
    board = flying(dataclasses.replace(SHORT_LADDER, slew_us_per_s=5000))
    for sequence in range(3, 15):
        board.send(sequence, Command(1500, 1500, 0, 1600, 1400))
        board.run(312)
    board.run(1251 - 312)
    sufferer = board.run(600)["sufferer_half_us"]
    assert (sufferer[:200] == np.minimum(3200, 3001 + np.arange(200))).all()
    assert (sufferer[200:] == 3199 - np.arange(400)).all()


@pytest.mark.parametrize("rate_us_per_s", [1, 6, 7, 999])
def test_a_slow_sink_takes_its_pulse_back_in_time(rate_us_per_s):
    board = flying(
        dataclasses.replace(SHORT_LADDER, sink_ms=20_000, sink_rate_us_per_s=rate_us_per_s)
    )
    board.send(3, Command(1800, 1700, 0, 1700, 1990))
    sinking = board.run(1451 + 200_000)["sufferer_half_us"] / 2
    for seconds in (0, 1, 20):
        expected_us = max(1000.0, 1990.0 - rate_us_per_s * seconds)
        assert sinking[1450 + 10_000 * seconds + (not seconds)] == pytest.approx(expected_us, abs=1)


def test_the_longest_ladder_there_can_be_is_climbed_down_to_its_end():
    longest = 2**16 - 1
    board = flying(Arm(1000, 2000, 20_000, longest, longest, 2100, 8400, longest, longest, longest))
    board.send(3, Command(1800, 1700, 0, 1750, 1650))
    board.run(1251 + 3 * 10 * longest)
    assert board.is_flying
    board.run(1)
    assert not board.is_flying


def test_the_slowest_descent_has_arrived_when_the_latch_falls():
    """A tick's share is rounded: over 655,350 ticks that must not leave the motors above idle."""
    board = flying(Arm(1000, 1999.5, 2**32 - 1, 2**16 - 1, 2**16 - 1, 2100, 8400, 0, 0, 0))
    board.send(3, Command(2000, 2000, 0, 1000, 1000))
    board.run(1251)
    ramp = board.run(655_351)
    assert not board.is_flying
    for name in ("source_half_us", "sufferer_half_us"):
        assert ramp[name][-1] == 2000
        assert ramp[name][-2000] > 2000


def test_after_the_latch_only_a_handshake_helps():
    board = flying()
    board.send(3, Command(1300, 1600, 0, 1000, 1000))
    board.run(20_000)
    status = board.send(4, Command(1300, 1600, 0, 1000, 1000))
    assert (status.faults, status.armed, status.source_us) == (Fault.DEADMAN, False, 1000)
    assert not board.send(5, LIMITS).armed
    board.send(6, Hello())
    armed = board.send(7, LIMITS)
    assert (armed.faults, armed.missed) == (Fault.NONE, 0)


def test_a_handshake_stands_a_carriage_that_brakes_for_longer_than_the_ladder():
    board = flying(dataclasses.replace(LIMITS, max_accel_steps_per_s2=300))
    for sequence in range(3, 3 + 4 * 32):
        board.send(sequence, Command(1000, 1000, 2100, 1000, 1000))
        board.run(312)
    while board.is_flying:
        board.run(1)
    assert board.run(1000)["step"].any()
    board.send(200, Hello())
    assert not board.run(20_000)["step"].any()


def test_a_reset_by_the_watchdog_is_told_until_the_host_arms():
    board = Board(reset_faults=Fault.WATCHDOG | Fault.BROWNOUT)
    board.send(1, Hello())
    assert board.send(2, Disarm()).faults == Fault.WATCHDOG | Fault.BROWNOUT
    assert (
        board.send(3, Arm(1000, 1000, 1, 1, 1, 1, 1, 0, 0, 0)).faults
        == Fault.WATCHDOG | Fault.BROWNOUT
    )
    assert board.send(4, LIMITS).faults == Fault.NONE


def test_a_board_tells_where_it_is():
    board = Board()
    assert board.send(1, Hello()).boot == 1
    for sequence, homed in ((2, False), (3, True), (4, False)):
        board.place(boot=517, homed=homed, battery_mv=12_345)
        status = board.send(sequence, Disarm())
        assert (status.boot, status.homed, status.battery_mv) == (517, homed, 12_345)


@pytest.mark.parametrize(
    ("oldest", "newest", "chosen"),
    [(0, 0, 0), (1, 1, 0), (0, 2, 2), (2, 2, 2), (2, 9, 2), (3, 9, 0)],
)
def test_a_foreign_version_is_told_that_none_fits_and_cannot_arm(oldest, newest, chosen):
    board = Board()
    assert board.send(1, Hello(oldest, newest)).version == chosen
    assert board.send(2, LIMITS).armed == bool(chosen)


def test_before_a_handshake_nothing_is_answered_but_all_is_counted():
    board = Board()
    assert board.send(1, LIMITS) is None
    assert board.send(2, Command(1500, 1500, 0, 1000, 1000)) is None
    board.send(3, Hello())
    assert board.send(4, Disarm()).malformed == 2


def test_limits_that_no_motor_understands_are_refused():
    for low, high, source_ms, sufferer_ms in (
        (499.5, 2000, 250, 1000),
        (1000, 2500.5, 250, 1000),
        (1500, 1500, 250, 1000),
        (1000, 2000, 0, 1000),
        (1000, 2000, 250, 0),
    ):
        board = Board()
        board.send(1, Hello())
        refused = Arm(low, high, 20_000, source_ms, sufferer_ms, 2100, 8400, 0, 0, 0)
        assert not refused.is_usable
        assert not board.send(2, refused).armed
        assert board.send(3, LIMITS).armed
    widest = Arm(500, 2500, 2**32 - 1, 2**16 - 1, 1, 2**16 - 1, 2**32 - 1, 0, 0, 0)
    assert flying(widest).is_flying


@pytest.mark.parametrize("idle_us", [500.0, 1000.0, 2499.0])
def test_a_board_armed_without_motors_puts_out_nothing_that_turns_one(idle_us):
    rig = RIG.changed(limits={"pulse_us": (idle_us, 2500.0)})
    board = flying(arm_limits(rig, motors_off=True))
    board.send(3, Command(2500.0, 2500.0, 0, 1000, 1000))
    seen = board.run(3 * FRAME_TICKS)
    assert max(seen["source_half_us"].max(), seen["sufferer_half_us"].max()) <= 2 * idle_us + 2


@unhurried
@given(
    st.integers(1000, 5000), st.integers(1, 4000), st.integers(1, 2**32 - 1),
    st.lists(st.tuples(st.integers(0, 2**16 - 1), st.integers(1, 400)), max_size=10),
)  # fmt: skip
def test_no_command_passes_a_limit_or_outruns_the_slew(low, span, slew, commands):
    high = min(low + span, 5000)
    if low == high:
        return
    board = flying(Arm(low / 2, high / 2, slew, 250, 1000, 2100, 8400, 0, 0, 0))
    seen = [np.array([low])]
    for number, (half_us, wait) in enumerate(commands):
        board.send(3 + number, Command(half_us / 2, 1000, 0, 1000, 1000))
        seen.append(board.run(wait)["source_half_us"])
    pulses = np.concatenate(seen).astype(int)
    assert low <= pulses.min() <= pulses.max() <= high
    for over in (1, 10, 100):
        moved = np.abs(pulses[over:] - pulses[:-over])
        assert (moved <= 2 * slew * over * TICK_S + 1).all()  # a pulse is rounded by half a step


def test_a_slow_slew_arrives_in_time():
    board = flying(Arm(1000, 2000, 100, 250, 1000, 2100, 8400, 0, 0, 0))
    for tick in range(320):
        board.send(3 + tick, Command(2000, 1000, 0, 1000, 1000))
        board.run(312)
    seconds = 320 * 312 * TICK_S
    assert board.run(1)["source_half_us"][0] / 2 == pytest.approx(1000 + 100 * seconds, abs=1.0)


def test_the_step_count_is_exact_over_a_minute_of_changing_speeds():
    """Without an acceleration limit, v steps/s over n ticks are v·n / 10,000 steps, exactly."""
    rng, board, travelled, stepped = random.Random(5), flying(AT_ONCE), 0, 0
    for number in range(60 * 32):
        speed, ticks = rng.randint(-10_000, 10_000), rng.choice([312, 313])
        board.send(3 + number, Command(1000, 1000, speed, 1000, 1000))
        stepped += int(board.run(ticks)["step"].sum())
        travelled += speed * ticks
        assert stepped == travelled // TICKS_PER_S
    assert board.send(30_000, Disarm()).steps == stepped


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_speed_beyond_a_step_a_tick_is_a_step_a_tick(sign):
    board, stepped = flying(AT_ONCE), 0
    for sequence in range(3, 103):
        board.send(sequence, Command(1000, 1000, sign * 12_000, 1000, 1000))
        stepped += int(board.run(300)["step"].sum())
    assert stepped in (sign * 30_000, sign * 30_000 + 1)  # at most one short, of the first
    board.send(103, Command(1000, 1000, 0, 1000, 1000))
    assert not board.run(100)["step"].any()  # no step is owed


def test_the_carriage_never_accelerates_faster_than_the_host_allows():
    """From the step pulses alone: over windows of w, second differences are at most a·w²."""
    rng, board, steps = random.Random(7), flying(), []
    for number in range(10 * 32):
        speed = rng.choice([-3000, -2100, 0, 700, 2100, 3000])
        board.send(3 + number, Command(1000, 1000, speed, 1000, 1000))
        steps.append(board.run(313)["step"])
    position = np.concatenate(steps).astype(int).cumsum()
    for window in (100, 500, 1000):
        second = position[2 * window :] - 2 * position[window:-window] + position[: -2 * window]
        assert np.abs(second).max() <= 8400 * (window * TICK_S) ** 2 + 2
    fastest = position[1000:] - position[:-1000]
    assert np.abs(fastest).max() <= 210 + 1


def test_the_carriage_follows_the_runtimes_planner_for_a_minute():
    rng, ours, theirs = random.Random(11), flying(), Twin()
    theirs.hear(encode_frame(Frame(1, 0, Hello())) + encode_frame(Frame(2, 0, LIMITS)))
    for number in range(60 * 32):
        wire = encode_frame(
            Frame(3 + number, 0, Command(1000, 1000, rng.randint(-2200, 2200), 1000, 1000))
        )
        (our,), (their,) = ours.hear(wire), theirs.hear(wire)
        assert abs(our.message.steps - their.message.steps) <= 1
        ours.run(312)
        theirs.run(312)


def test_the_count_of_missed_commands_stays_at_its_end():
    board = flying(Arm(1000, 2000, 20_000, 1, 2**16 - 1, 2100, 8400, 0, 0, 0))
    for sequence in range(3, 40):
        board.run(600_000)
        missed = board.send(sequence, Command(1000, 1000, 0, 1000, 1000)).missed
        assert missed == min((sequence - 2) * 1919, 0xFFFF)


def test_the_watchdog_starves_when_the_main_loop_hangs_but_never_in_flight():
    watch = LoopWatch()
    assert [watch.may_feed(is_flying=False) for _ in range(1000)] == [True] * 999 + [False]
    for _ in range(3):
        watch.turned()
        fed = [watch.may_feed(is_flying=False) for _ in range(1002)]
        assert fed == [True] * 1000 + [False] * 2  # 100 ms
        assert watch.may_feed(is_flying=True)
    watch.turned()
    assert all(watch.may_feed(is_flying=True) for _ in range(5000))
    assert not watch.may_feed(is_flying=False)
