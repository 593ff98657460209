"""The compiled sketch on a simulated chip, in virtual time: what its pins and its port do."""

import random
from dataclasses import replace

import needs
import numpy as np
import pytest
from simulated import the_uno

from runtime.io.protocol import (
    PROTOCOL_VERSION,
    Arm,
    Command,
    Disarm,
    Fault,
    Frame,
    FrameDecoder,
    Hello,
    encode_frame,
)
from runtime.virtual.simulated_uno import DIRECTION_PIN, SOURCE_PIN, STEP_PIN, SUFFERER_PIN

pytestmark = needs.simulator

LIMITS = Arm(1000, 2000, 20_000, 250, 1000, 2100, 8400, 0, 0, 0)
AT_ONCE = Arm(1000, 2000, 2**32 - 1, 250, 1000, 2100, 2**32 - 1, 0, 0, 0)
PERIOD_S = 1.0 / 32.0
BOOT_S = 0.01  # a bootloader in a hurry


class Bench:
    """A board freshly reset, and a host with its sequence numbers."""

    def __init__(self, *, boot_s: float = BOOT_S, reset_flags: int = 0) -> None:
        self.uno = the_uno()
        self.uno.open_port(boot_s, reset_flags=reset_flags)
        self.run(boot_s + 0.01)
        self.uno.receive()
        self.uno.edges()
        self.decoder = FrameDecoder()
        self.sequence = 0

    def run(self, seconds: float) -> None:
        self.uno.run_until(self.uno.t_s + seconds)

    def send_bytes(self, data: bytes, seconds: float = 0.005) -> list[Frame]:
        self.uno.send(data)
        self.run(seconds)
        return list(self.decoder.feed(self.uno.receive()))

    def send(self, message, seconds: float = 0.005):
        self.sequence += 1
        heard = self.send_bytes(encode_frame(Frame(self.sequence, 0, message)), seconds)
        return heard[-1].message if heard else None

    def armed(self, limits: Arm = LIMITS) -> "Bench":
        assert self.send(Hello()).version == PROTOCOL_VERSION
        assert self.send(limits).armed
        return self

    def deliver(self, message) -> float:
        """Send and stop the time when the board has heard [s]."""
        self.sequence += 1
        self.uno.send(encode_frame(Frame(self.sequence, 0, message)))
        while self.uno.bytes_under_way:
            self.run(0.0001)
        return self.uno.t_s


@pytest.mark.parametrize("pulse_us", [1000.0, 1000.5, 1234.5, 1500.0, 1999.5, 2000.0])
def test_the_pulses_on_the_pins_are_those_commanded(pulse_us):
    bench = Bench().armed(AT_ONCE)
    other_us = 3000.0 - pulse_us
    for _ in range(4):
        status = bench.send(Command(pulse_us, other_us, 0, 1000, 1000), PERIOD_S)
    bench.uno.edges()
    for _ in range(8):
        status = bench.send(Command(pulse_us, other_us, 0, 1000, 1000), PERIOD_S)
    seen = bench.uno.edges()
    for pin, asked_us in ((SOURCE_PIN, pulse_us), (SUFFERER_PIN, other_us)):
        start_s, width_us = seen.pulses(pin)
        assert len(width_us) >= 11
        assert np.abs(width_us - asked_us).max() < 0.2
        assert np.abs(1e6 * np.diff(start_s) - 20_000).max() < 0.2
    assert (status.source_us, status.sufferer_us) == (pulse_us, other_us)


def test_outside_the_limits_the_pins_stay_at_them():
    bench = Bench().armed(AT_ONCE)
    for _ in range(3):
        bench.send(Command(2400, 600, 0, 1000, 1000), PERIOD_S)
    bench.uno.edges()
    bench.send(Command(2400, 600, 0, 1000, 1000), 2 * PERIOD_S)
    seen = bench.uno.edges()
    assert np.abs(seen.pulses(SOURCE_PIN)[1] - 2000).max() < 0.2
    assert np.abs(seen.pulses(SUFFERER_PIN)[1] - 1000).max() < 0.2


def test_a_board_that_nobody_armed_idles():
    bench = Bench()
    bench.send(Hello())
    assert not bench.send(Command(2000, 2000, 2000, 1000, 1000), 0.2).armed
    seen = bench.uno.edges()
    assert np.abs(seen.pulses(SOURCE_PIN)[1] - 1000).max() < 0.2
    assert STEP_PIN not in seen.pin


def test_the_slew_and_every_change_reach_the_pins_whole():
    """Widths change between frames, never within a pulse: 400 µs a frame at 20 µs a millisecond."""
    bench = Bench().armed()
    for _ in range(3):
        bench.send(Command(1000, 2000, 0, 1000, 1000), PERIOD_S)
    bench.uno.edges()
    for tick in range(64):
        bench.send(Command(1000 + 1000 * (tick // 4 % 2), 1500, 0, 1000, 1000), PERIOD_S)
    _, width_us = bench.uno.edges().pulses(SOURCE_PIN)
    assert len(width_us) >= 99
    assert width_us.min() > 999.8
    assert width_us.max() < 2000.2
    assert 390 < np.abs(np.diff(width_us)).max() < 402


def test_the_deadman_holds_ramps_and_latches_to_the_millisecond():
    bench = Bench().armed(AT_ONCE)
    for _ in range(3):
        bench.send(Command(1800, 1700, 2000, 1000, 1000), PERIOD_S)
    heard_s = bench.deliver(Command(1800, 1700, 2000, 1000, 1000))
    bench.uno.edges()
    bench.uno.run_until(heard_s + 1.124)
    seen = bench.uno.edges()
    last_step_s = seen.pulses(STEP_PIN)[0][-1] - heard_s
    assert last_step_s == pytest.approx(0.0625, abs=0.001)
    for pin, held_us, ramp_us_per_ms in ((SOURCE_PIN, 1800, 4.0), (SUFFERER_PIN, 1700, 1.0)):
        start_s, width_us = seen.pulses(pin)
        ramped_ms = np.maximum(0.0, 1e3 * (start_s - heard_s) - 125.0)
        expected_us = np.maximum(1000.0, held_us - ramp_us_per_ms * ramped_ms)
        assert np.abs(width_us - expected_us).max() <= ramp_us_per_ms + 0.5


# 100 ms of braking and 400 ms of sinking, then half a second from full to idle.
DESCENDING = replace(
    AT_ONCE, sufferer_descent_ms=500, brake_ms=100, sink_ms=400, sink_rate_us_per_s=100
)
ASKED = Command(1800, 1700, 2000, 1750, 1650)


def descended_us(silent_ms):
    """The sufferer's pulses after a silence, as `DESCENDING` and `ASKED` have it."""
    sinking_ms = silent_ms - 225.0
    sunk_us = np.where(sinking_ms < 0.0, 1750.0, 1650.0 - 0.1 * sinking_ms)
    ramped_us = np.maximum(1000.0, 1610.0 - 2.0 * (sinking_ms - 400.0))
    return np.where(silent_ms < 125.0, 1700.0, np.where(sinking_ms < 400.0, sunk_us, ramped_us))


def test_the_sufferer_brakes_sinks_and_ramps_on_the_pin():
    bench = Bench().armed(DESCENDING)
    for _ in range(3):
        bench.send(ASKED, PERIOD_S)
    heard_s = bench.deliver(ASKED)
    bench.uno.edges()
    bench.uno.run_until(heard_s + 1.1)
    start_s, width_us = bench.uno.edges().pulses(SUFFERER_PIN)
    assert len(width_us) >= 54
    assert np.abs(width_us - descended_us(1e3 * (start_s - heard_s))).max() <= 2.5
    assert bench.send(LIMITS).faults == Fault.NONE
    bench.uno.run_until(heard_s + 1.13)
    assert bench.send(LIMITS).faults == Fault.DEADMAN


@pytest.mark.parametrize(("silent_s", "fault"), [(1.124, Fault.NONE), (1.126, Fault.DEADMAN)])
def test_the_latch_comes_with_the_longest_descent(silent_s, fault):
    bench = Bench().armed(AT_ONCE)
    heard_s = bench.deliver(Command(1800, 1700, 0, 1000, 1000))
    asking_s = 0.0015  # an Arm on the wire; without a handshake it does nothing but is answered
    bench.uno.run_until(heard_s + silent_s - asking_s)
    bench.uno.receive()
    assert bench.send(LIMITS).faults == fault


def test_a_main_loop_that_hangs_in_flight_is_brought_down_before_the_watchdog_bites():
    bench = Bench().armed(DESCENDING)
    boot = bench.send(ASKED, PERIOD_S).boot
    for _ in range(3):
        bench.send(ASKED, PERIOD_S)
    heard_s = bench.deliver(ASKED)
    bench.run(0.001)
    bench.uno.edges()
    bench.uno.hang()
    bench.uno.run_until(heard_s + 1.1)
    bench.uno.mend()  # what hangs goes on hanging, what boots is well
    bench.uno.receive()
    start_s, width_us = bench.uno.edges().pulses(SUFFERER_PIN)
    assert np.abs(np.diff(start_s) - 0.02).max() < 1e-6  # no frame is missing, so no reset was
    assert np.abs(width_us - descended_us(1e3 * (start_s - heard_s))).max() <= 2.5
    bench.uno.hang()
    bench.run(0.3)
    bench.uno.mend()
    bench.run(0.2)
    assert bench.send(Hello()).boot == boot + 1
    assert bench.send(Disarm()).faults == Fault.WATCHDOG
    assert bench.send(LIMITS).faults == Fault.NONE


def test_without_interrupts_the_watchdog_bites_at_once():
    bench = Bench().armed(AT_ONCE)
    boot = bench.send(Command(1800, 1700, 0, 1000, 1000), PERIOD_S).boot
    bench.uno.hang(with_interrupts_off=True)
    bench.run(0.05)
    bench.uno.mend(sleeps=False)
    bench.run(0.2)
    bench.uno.mend()
    assert bench.send(Hello()).boot == boot + 1
    # The chip's own register says so: the sketch had no time to leave its mark.
    assert bench.send(Disarm()).faults == Fault.WATCHDOG


POWER_ON, BY_HOST, BROWNOUT, WATCHDOG = 1, 2, 4, 8  # bits of the chip's MCUSR


@pytest.mark.parametrize(
    ("flags", "faults"),
    [
        (0, Fault.NONE),
        (BY_HOST, Fault.NONE),
        (POWER_ON, Fault.NONE),
        (POWER_ON | BROWNOUT, Fault.NONE),  # switching on passes through low voltages, too
        (BROWNOUT, Fault.BROWNOUT),
        (BROWNOUT | BY_HOST, Fault.BROWNOUT),
        (WATCHDOG, Fault.WATCHDOG),
        (WATCHDOG | BROWNOUT, Fault.WATCHDOG | Fault.BROWNOUT),
    ],
)
def test_the_chips_register_of_resets_is_told_as_faults(flags: int, faults: Fault) -> None:
    Bench().run(0.05)  # nothing hung before
    bench = Bench(reset_flags=flags)
    bench.send(Hello())
    assert bench.send(Disarm()).faults == faults


def test_opening_the_port_reboots_the_board():
    first = Bench().send(Hello())
    bench = Bench(boot_s=1.7)
    assert bench.send(Command(1500, 1500, 0, 1000, 1000)) is None  # it knows of no handshake
    second = bench.send(Hello())
    assert second.boot == first.boot + 1
    assert second.board == 1


def test_while_the_bootloader_runs_nothing_is_heard_and_no_pin_moves():
    bench = Bench().armed(AT_ONCE)
    bench.send(Command(1800, 1800, 2000, 1000, 1000), PERIOD_S)
    bench.uno.open_port(1.7)
    bench.uno.edges()
    assert bench.send(Hello(), 1.6) is None
    assert bench.uno.edges().pin.size == 0
    bench.run(0.2)
    seen = bench.uno.edges()
    assert np.abs(seen.pulses(SOURCE_PIN)[1] - 1000).max() < 0.2


def test_bad_frames_are_dropped_and_counted():
    bench = Bench().armed(AT_ONCE)
    good = encode_frame(Frame(10, 0, Command(1300, 1300, 0, 1000, 1000)))
    (answer,) = bench.send_bytes(good)
    assert answer.message.sequence == 10
    assert bench.send_bytes(good) == []  # duplicated
    assert (
        bench.send_bytes(encode_frame(Frame(9, 0, Command(1900, 1900, 0, 1000, 1000)))) == []
    )  # reordered
    assert bench.send_bytes(good[:4] + b"\x55" + good[5:]) == []  # corrupted
    assert bench.send_bytes(b"\x41" * 200 + b"\0", 0.02) == []  # oversized
    hello = encode_frame(Frame(1, 0, Hello()))
    assert bench.send_bytes(hello) == []  # duplicated: that of the handshake, once more
    (answer,) = bench.send_bytes(encode_frame(Frame(11, 0, Command(1300, 1300, 0, 1000, 1000))))
    assert answer.message.malformed == 5
    assert answer.message.armed
    bench.uno.edges()
    bench.run(0.05)
    assert np.abs(bench.uno.edges().pulses(SOURCE_PIN)[1] - 1300).max() < 0.2


def test_random_bytes_neither_hang_nor_move_anything():
    bench, rng = Bench(), random.Random(13)
    steps = bench.uno.steps
    for _ in range(100):
        bench.send_bytes(rng.randbytes(1000), 0.05)
    bench.send_bytes(b"\0")
    seen = bench.uno.edges()
    for pin in (SOURCE_PIN, SUFFERER_PIN):
        assert np.abs(seen.pulses(pin)[1] - 1000).max() < 0.2
    assert bench.uno.steps == steps
    bench.sequence = 40_000
    assert bench.send(Hello()).version == PROTOCOL_VERSION
    assert bench.send(LIMITS).armed


def test_random_bytes_between_commands_change_no_pulse():
    bench, rng = Bench().armed(AT_ONCE), random.Random(19)
    for wait_s in (PERIOD_S, PERIOD_S, 0.005):
        bench.send(Command(1400, 1400, 0, 1000, 1000), wait_s)
    bench.uno.edges()
    for _ in range(200):
        bench.send_bytes(rng.randbytes(500) + b"\0", PERIOD_S - 0.005)
        status = bench.send(Command(1400, 1400, 0, 1000, 1000))
        assert status.armed
    seen = bench.uno.edges()
    for pin in (SOURCE_PIN, SUFFERER_PIN):
        start_s, width_us = seen.pulses(pin)
        assert len(width_us) >= 310  # 6.25 s
        assert np.abs(np.diff(start_s) - 0.02).max() < 1e-6
        assert np.abs(width_us - 1400).max() < 0.2
    assert STEP_PIN not in seen.pin
    assert (status.missed, status.faults) == (0, Fault.NONE)
    assert status.malformed > 300


def step_for(seconds: float) -> None:
    """Changing speeds, one a period: the count is that of the pulses, and the speeds' integral."""
    bench, rng, travelled = Bench().armed(AT_ONCE), random.Random(17), 0.0
    before = bench.uno.steps
    heard_s, speed = bench.uno.t_s, 0
    for _ in range(round(seconds * 32)):
        next_speed = rng.randint(-2100, 2100)
        next_s = bench.deliver(Command(1000, 1000, next_speed, 1000, 1000))
        travelled += speed * (next_s - heard_s)
        heard_s, speed = next_s, next_speed
        bench.run(PERIOD_S - 0.001)
        bench.uno.receive()
        if bench.sequence % 64 == 0:
            bench.uno.edges()
    travelled += speed * (bench.deliver(Disarm()) - heard_s)
    status = bench.send(Disarm())
    assert status.steps == bench.uno.steps - before
    late_steps = 2100 * 0.0002 * (1.0 + seconds * 32) ** 0.5  # when a frame acts is known to 0.1 ms
    assert status.steps == pytest.approx(travelled, abs=2.0 + late_steps)
    assert status.missed == status.malformed == 0


def test_the_step_count_is_that_of_the_pulses():
    step_for(5.0)


@pytest.mark.slow
def test_the_step_count_is_that_of_the_pulses_for_a_minute():
    step_for(60.0)


def test_the_interrupt_ends_before_a_third_byte_can_arrive():
    bench = Bench().armed(replace(DESCENDING, slew_us_per_s=20_000, max_accel_steps_per_s2=8400))
    bench.uno.longest_tick_us()
    for tick in range(64):  # both pulses slew, the carriage accelerates and reverses
        speed = 300 if tick % 4 < 2 else -300
        source_us, sufferer_us = (1000, 2000) if tick % 2 else (2000, 1000)
        bench.send(Command(source_us, sufferer_us, speed, 2000, 1500), PERIOD_S)
    _, rose = bench.uno.edges().changes(DIRECTION_PIN)
    assert rose.sum() > 10
    assert 10 < bench.uno.longest_tick_us() < 60  # 80 µs are two bytes, the chip holds no more
    bench.run(1.2)  # and on every rung of the way down
    assert bench.uno.longest_tick_us() < 60


def test_a_constant_speed_is_exact():
    bench = Bench().armed(AT_ONCE)
    bench.deliver(Command(1000, 1000, 2100, 1000, 1000))
    bench.uno.edges()
    for _ in range(32):
        bench.send(Command(1000, 1000, 2100, 1000, 1000), PERIOD_S)
    start_s, width_us = bench.uno.edges().pulses(STEP_PIN)
    assert (len(start_s) - 1) / (start_s[-1] - start_s[0]) == pytest.approx(2100, rel=2e-4)
    assert width_us.min() >= 5.0  # what drivers for a NEMA 23 want


def test_the_direction_stands_5_us_before_each_step_and_while_it_lasts():
    bench, rng = Bench().armed(AT_ONCE), random.Random(23)
    steps = bench.uno.steps
    for _ in range(96):
        bench.send(Command(1000, 1000, rng.randint(-2100, 2100), 1000, 1000), PERIOD_S)
    status = bench.send(Disarm())
    seen = bench.uno.edges()
    turned_s, _ = seen.changes(DIRECTION_PIN)
    step_s, width_us = seen.pulses(STEP_PIN)
    assert len(turned_s) > 30
    assert len(step_s) > 2000
    before = np.searchsorted(step_s, turned_s)  # the step after each turn
    setup_us = 1e6 * (step_s[before] - turned_s)
    hold_us = 1e6 * (turned_s[1:] - step_s[before[1:] - 1]) - width_us[before[1:] - 1]
    assert setup_us.min() >= 5.0
    assert hold_us.min() >= 5.0
    assert width_us.min() >= 5.0
    assert status.steps == bench.uno.steps - steps


def test_more_edges_than_are_kept_are_told_and_then_forgotten():
    bench = Bench().armed(Arm(1000, 2000, 20_000, 250, 1000, 10_000, 2**32 - 1, 0, 0, 0))
    for _ in range(32 * 4):  # 20,000 edges a second
        bench.send(Command(1000, 1000, 10_000, 1000, 1000), PERIOD_S)
    with pytest.raises(RuntimeError, match="look more often"):
        bench.uno.edges()
    bench.send(Command(1000, 1000, 10_000, 1000, 1000), PERIOD_S)
    assert len(bench.uno.edges().pulses(STEP_PIN)[1]) == pytest.approx(312, abs=2)


def test_the_time_reported_is_that_at_which_the_pulse_began():
    bench = Bench().armed(AT_ONCE)
    statuses = [bench.send(Command(1200, 1200, 0, 1000, 1000), PERIOD_S) for _ in range(32)]
    start_s, _ = bench.uno.edges().pulses(SOURCE_PIN)
    applied_us = np.array([status.applied_time_us for status in statuses])
    since_us = 1e6 * (start_s[:, None] - start_s[0])
    offset = np.median(applied_us - since_us[np.argmin(np.abs(since_us - applied_us), axis=0), 0])
    gaps_us = np.abs(since_us + offset - applied_us).min(axis=0)
    assert gaps_us.max() <= 8  # micros() counts in fours


def test_home_switch_and_battery_are_told():
    bench = Bench()
    bench.uno.set_home(True)
    bench.uno.set_battery(3.0)
    bench.send(Hello())
    bench.run(0.2)
    status = bench.send(Disarm())
    assert status.homed
    assert status.battery_mv == pytest.approx(12_000, abs=60)
    bench.uno.set_home(False)
    bench.uno.set_battery(0.1)
    bench.run(0.2)
    status = bench.send(Disarm())
    assert not status.homed
    assert status.battery_mv == 0  # not wired
