"""The MCU's limits, slew, carriage planner and deadman ladder."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.virtual.mcu import Mcu, Outputs, latch_s
from wakedeploy.rig.file import default_rig

LADDER = {"brake_s": 0.3, "sink_s": 4.0, "sink_rate_us_per_s": 6.0, "sufferer_descent_s": 1.0}
RIG = default_rig().changed(limits=LADDER)
DT_S = 1.0 / 1024.0


def flying(t_s: float = 0.0) -> Mcu:
    mcu = Mcu(RIG)
    mcu.arm(t_s)
    mcu.command(t_s, 1800.0, 1700.0, 0.4, 1750.0, 1650.0)
    return mcu


def run(mcu: Mcu, start_s: float, seconds: float) -> list[Outputs]:
    return [mcu.advance(start_s + i * DT_S, DT_S) for i in range(round(seconds / DT_S))]


def test_unarmed_it_does_nothing() -> None:
    mcu = Mcu(RIG)
    mcu.command(0.0, 2000.0, 2000.0, 0.5, 2000.0, 2000.0)
    assert run(mcu, 0.0, 0.1)[-1] == Outputs(1000.0, 1000.0, 0.0)


def test_the_deadman_holds_brakes_sinks_ramps_and_latches() -> None:
    mcu = flying()
    held = run(mcu, 0.0, 0.124)
    assert (held[-1].source_us, held[-1].sufferer_us) == (1800.0, 1700.0)
    braking = run(mcu, 0.125, 0.3)
    assert braking[-1].source_us == 1000.0  # from 1800 within its 0.25 s
    assert braking[-1].sufferer_us == 1750.0
    assert braking[-1].carriage_mps == 0.0
    sinking = run(mcu, 0.425, 4.0)
    assert sinking[100].sufferer_us == pytest.approx(1650.0 - 6.0 * 100 * DT_S, abs=0.1)
    assert sinking[-1].sufferer_us == pytest.approx(1650.0 - 6.0 * 4.0, abs=0.1)
    ramping = run(mcu, 4.425, 1.0)
    assert ramping[0].sufferer_us == pytest.approx(1626.0, abs=2.0)
    assert ramping[512].sufferer_us == pytest.approx(1126.0, abs=2.0)  # the range within a second
    assert ramping[-1].sufferer_us == 1000.0
    assert not mcu.status.latched
    run(mcu, 5.425, 0.01)
    assert mcu.status.latched
    assert latch_s(RIG.limits) == 5.425
    mcu.command(5.5, 1800.0, 1700.0, 0.0, 1750.0, 1650.0)
    assert run(mcu, 5.5, 0.05)[-1].source_us == 1000.0
    mcu.arm(5.6)
    mcu.command(5.6, 1800.0, 1700.0, 0.0, 1750.0, 1650.0)
    assert run(mcu, 5.6, 0.05)[-1].source_us == 1800.0


@pytest.mark.parametrize("silent_s", [0.2, 1.0, 5.0])
def test_a_command_on_the_way_down_is_followed_at_once(silent_s: float) -> None:
    mcu = flying()
    run(mcu, 0.0, silent_s)
    mcu.command(silent_s, 1300.0, 1400.0, 0.0, 1450.0, 1350.0)
    assert run(mcu, silent_s, 0.12)[-1] == Outputs(1300.0, 1400.0, 0.0)
    assert run(mcu, silent_s + 0.12, 0.2)[-1].sufferer_us == 1450.0


def test_without_a_command_since_arming_the_descent_is_at_idle() -> None:
    mcu = flying()
    mcu.arm(0.0)
    assert {out.sufferer_us for out in run(mcu, 0.0, 5.5)} == {1000.0}
    assert mcu.status.latched


def test_missed_commands_are_counted_and_late_ones_are_not() -> None:
    mcu, period = Mcu(RIG), 1.0 / 32.0
    mcu.arm(0.0)
    for tick in range(10):
        start = tick * period + (0.4 * period if tick == 5 else 0.0)
        mcu.command(start, 1500.0, 1500.0, 0.0, 1500.0, 1500.0)
        run(mcu, start, period)
    assert mcu.status.missed_commands == 0
    run(mcu, 10 * period, 3 * period)
    assert mcu.status.missed_commands == 3


PULSE = st.floats(-5000, 5000)
COMMANDS = st.tuples(PULSE, PULSE, st.floats(-10, 10), PULSE, PULSE)
# With a shorter ladder than the default one, so that every rung of it is reached.
SHORT = RIG.changed(limits={"brake_s": 0.05, "sink_s": 0.1, "sink_rate_us_per_s": 1000.0})


@pytest.mark.whole
@given(st.lists(st.tuples(COMMANDS, st.floats(0.001, 0.4)), min_size=1, max_size=8))
def test_no_sequence_of_commands_passes_a_limit(
    sequence: list[tuple[tuple[float, float, float, float, float], float]],
) -> None:
    mcu, t_s, outputs = Mcu(SHORT), 0.0, [Outputs(1000.0, 1000.0, 0.0)]
    mcu.arm(0.0)
    for command, wait_s in sequence:
        mcu.command(t_s, *command)
        outputs += run(mcu, t_s, wait_s)
        t_s += wait_s
    for before, after in itertools.pairwise(outputs):
        assert 1000.0 <= after.source_us <= 2000.0
        assert 1000.0 <= after.sufferer_us <= 2000.0
        assert abs(after.carriage_mps) <= RIG.stepper.max_speed_mps
        most_us = RIG.limits.slew_us_per_s * DT_S + 1e-9
        assert abs(after.sufferer_us - before.sufferer_us) <= most_us
        change = abs(after.carriage_mps - before.carriage_mps)
        assert change <= RIG.stepper.max_accel_mps2 * DT_S + 1e-9
