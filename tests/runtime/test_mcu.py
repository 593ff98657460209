"""The MCU's limits, slew, carriage planner and deadman ladder."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from runtime.mcu import Mcu, Outputs
from wakedeploy.rig import default_rig

RIG = default_rig()
DT_S = 1.0 / 1024.0


def flying(t_s: float = 0.0) -> Mcu:
    mcu = Mcu(RIG)
    mcu.arm(t_s)
    mcu.command(t_s, 1800.0, 1700.0, 0.4)
    return mcu


def run(mcu: Mcu, start_s: float, seconds: float) -> list[Outputs]:
    return [mcu.advance(start_s + i * DT_S, DT_S) for i in range(round(seconds / DT_S))]


def test_unarmed_it_does_nothing() -> None:
    mcu = Mcu(RIG)
    mcu.command(0.0, 2000.0, 2000.0, 0.5)
    assert run(mcu, 0.0, 0.1)[-1] == Outputs(1000.0, 1000.0, 0.0)


def test_the_deadman_holds_then_ramps_then_latches() -> None:
    mcu = flying()
    held = run(mcu, 0.0, 0.124)
    assert held[-1].source_us == 1800.0
    assert held[-1].sufferer_us == 1700.0
    ramping = run(mcu, 0.125, 0.25)
    assert ramping[-1].source_us == 1000.0  # from 1800 within its 0.25 s
    assert ramping[-1].carriage_mps == 0.0
    assert 1400.0 < ramping[-1].sufferer_us < 1500.0  # its bounded ramp takes a second
    assert run(mcu, 0.375, 0.7)[-1].sufferer_us == 1000.0
    assert not mcu.status.latched
    run(mcu, 1.075, 0.2)
    assert mcu.status.latched
    mcu.command(1.3, 1800.0, 1700.0, 0.0)
    assert run(mcu, 1.3, 0.05)[-1].source_us == 1000.0
    mcu.arm(1.4)
    mcu.command(1.4, 1800.0, 1700.0, 0.0)
    assert run(mcu, 1.4, 0.05)[-1].source_us == 1800.0


def test_missed_commands_are_counted_and_late_ones_are_not() -> None:
    mcu, period = Mcu(RIG), 1.0 / 32.0
    mcu.arm(0.0)
    for tick in range(10):
        start = tick * period + (0.4 * period if tick == 5 else 0.0)
        mcu.command(start, 1500.0, 1500.0, 0.0)
        run(mcu, start, period)
    assert mcu.status.missed_commands == 0
    run(mcu, 10 * period, 3 * period)
    assert mcu.status.missed_commands == 3


commands = st.tuples(
    st.floats(-5000, 5000), st.floats(-5000, 5000), st.floats(-10, 10), st.floats(0.001, 0.3)
)


@given(st.lists(commands, min_size=1, max_size=8))
def test_no_sequence_of_commands_passes_a_limit(
    sequence: list[tuple[float, float, float, float]],
) -> None:
    mcu, t_s, outputs = Mcu(RIG), 0.0, [Outputs(1000.0, 1000.0, 0.0)]
    mcu.arm(0.0)
    for source, sufferer, speed, wait_s in sequence:
        mcu.command(t_s, source, sufferer, speed)
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
