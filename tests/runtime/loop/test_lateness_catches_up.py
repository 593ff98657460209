"""The filters that believe in late readings take no time before the command."""

import numpy as np
import pytest

from runtime.loop.estimate import Measurement
from runtime.loop.lateness import Lateness
from runtime.loop.pilot import Pilot
from wakedeploy.rig.file import default_rig

RIG = default_rig()


@pytest.fixture
def flown():
    """A tick after another over readings that rise, with what the pilot makes of each."""
    pilot = Pilot(RIG)
    states, ticks = [pilot.initial(0.0)], []
    for number in range(1, 20):
        measured = Measurement(number / 32.0, 0.01 * number, 0.02, 0, 0)
        states.append(pilot.estimate(states[-1], measured))
        ticks.append((states[-2], states[-1], measured))
    return ticks


def test_what_a_tick_tells_is_counted_once_its_command_is_out(flown):
    prompt, slow = Lateness(RIG), Lateness(RIG)
    for before, now, measured in flown:
        assert slow.step(before, now, measured) is now
        assert prompt.step(before, now, measured) is now
        prompt.catch_up()
    assert slow.evidence == 0.0
    assert all(rival.t_s == 0.0 for rival in slow._rivals.values())
    assert all(rival.t_s == flown[-1][2].t_s for rival in prompt._rivals.values())


def test_one_that_is_adopted_is_followed_at_once_and_once(flown):
    adopted = Lateness(RIG)
    for before, now, measured in flown[:-1]:
        adopted.step(before, now, measured)
        adopted.catch_up()
    adopted.adopt()
    before, now, measured = flown[-1]
    present = adopted.step(before, now, measured)
    assert present is not now
    held = dict(adopted._rivals)
    adopted.catch_up()
    assert adopted._rivals == held
    assert np.isfinite(present.estimate.z_m)
