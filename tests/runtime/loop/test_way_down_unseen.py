"""Ways down on which the loop does not see what it does: late commands, a drifted sensor."""

from dataclasses import replace

import numpy as np
import pytest
from sufferer_in_numbers import AGE_S, DT_S, HOVER_US, MASS_KG, RIG, WEIGHT_N, hovering

from runtime.loop.controller import Command
from runtime.loop.estimate import Measurement
from runtime.loop.pilot import Pilot
from runtime.loop.way_down import BLIND_LATE_S, WayDown
from wakedeploy.physics.rail import smooth_friction

IDLE_US = RIG.limits.pulse_us[0]
LATE = ("commands_late",)


def descended(late_s, heights_m, held_us=HOVER_US):
    """The sufferer's pulses of a way down on which the estimate says these heights."""
    pilot, start = Pilot(RIG), hovering(heights_m[0])
    way, pulses_us = WayDown(RIG, pilot), []
    state = replace(pilot.initial(0.0), estimate=start, last_us=held_us, before_last_us=held_us)
    way.late_s = late_s
    for tick, z_m in enumerate(heights_m):
        measured = Measurement(tick * DT_S, z_m, AGE_S, 0, 0)
        now = replace(start, t_s=measured.t_s, height=np.array([z_m, 0.0, 0.0]), innovation_m=0.0)
        state = replace(state, estimate=now)
        way.reckon(state, measured, DT_S, believe=True)
        down = way.descend(state, measured, LATE, LATE, None)
        assert down is not None
        state, _, command, _ = down
        pulses_us.append(command.sufferer_us)
    return pulses_us


def test_commands_that_act_too_late_are_not_controlled_by_a_height():
    high, low = [0.6] * 20, [0.6, *[0.5] * 19]
    assert descended(BLIND_LATE_S + 0.05, high) == descended(BLIND_LATE_S + 0.05, low)
    assert descended(BLIND_LATE_S - 0.05, high) != descended(BLIND_LATE_S - 0.05, low)


def test_what_is_still_held_meanwhile_is_part_of_the_plan():
    """A pulse that carries too little makes it the faster, the longer it holds: so brakes more."""
    low_us = RIG.thrust.sufferer.pulse(0.9 * WEIGHT_N)
    brakes_us = [descended(late_s, [0.6] * 2, low_us)[0] for late_s in (0.15, 0.2, 0.25)]
    assert min(np.diff(brakes_us)) > 2.0


@pytest.mark.parametrize("seed", range(3))
def test_a_touch_down_by_a_sensor_that_drifted_to_the_stop_is_no_fall(seed):
    """The sensor says the stop 0.65 m too early; test after test nothing is seen of the speed."""
    rng, pilot = np.random.default_rng(seed), Pilot(RIG)
    way, z_m, vz_mps, hardest_mps = WayDown(RIG, pilot), 0.7, 0.0, 0.0
    start = replace(hovering(0.7), t_s=0.0)
    state = replace(pilot.initial(0.0), estimate=start, last_us=HOVER_US, before_last_us=HOVER_US)
    for tick in range(1, 640):
        t_s = tick * DT_S
        said_m = z_m - min(0.2 * t_s, 0.65) + 0.004 * float(rng.standard_normal())
        measured = Measurement(t_s, max(round(said_m, 3), 0.0), AGE_S, 0, 0)
        state = pilot.estimate(state, measured)
        way.reckon(state, measured, DT_S, believe=True)
        pulse_us = HOVER_US if t_s < 3.5 else way.settle(state, measured)
        if pulse_us is None:
            break
        state, _, _ = pilot.held(state, Command(IDLE_US, pulse_us, 0.0))
        if t_s < 3.5:
            continue  # held where it is
        thrust_n = RIG.thrust.sufferer.thrust(pulse_us)
        vz_mps += (thrust_n - WEIGHT_N - smooth_friction(RIG.rail, vz_mps)) / MASS_KG * DT_S
        z_m += vz_mps * DT_S
        if z_m <= 0.0:
            hardest_mps, z_m, vz_mps = max(hardest_mps, -vz_mps), 0.0, 0.0
    assert z_m == 0.0
    assert 0.2 < hardest_mps < 0.9
