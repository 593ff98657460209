"""A battery that goes and comes back: a pulled plug, a bad contact, an emergency stop released."""

import itertools
import math

import numpy as np
import pytest
from simulated_bench import Bench, ended_by

from runtime.calibration.session import resting
from runtime.loop.blind import ladder_s
from runtime.loop.loop import Loop
from runtime.reference import hold_plan
from wakedeploy.core.errors import UnusableInput
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 1.0}, battery={"has_divider": True})
IDLE_US = RIG.limits.pulse_us[0]
PERIOD_S = 1.0 / 32.0
GONE_AT = 160  # ticks: in hover


class Battery:
    """Power that is cut and comes back; both motors need it.

    The board measures it behind the cut, where capacitors of a time constant `held_s` drain slowly,
    and as the UNO does: each 0.1 s, and nothing below 2 V.
    """

    def __init__(self, away_s: float, held_s: float, gone_at: int = GONE_AT) -> None:
        self._away_s, self._held_s, self._gone_at = away_s, held_s, gone_at
        self._gone_s, self._now_s = None, 0.0

    def plug_in(self, loop, bench, rows):
        rows.put = lambda row: (rows.rows.append(row), self._after(bench, len(rows.rows)))

    def _after(self, bench, ticks):
        if ticks == self._gone_at:
            self._gone_s = self._now_s
        looked_s = math.floor(self._now_s * 10.0) / 10.0
        volts = 11.1
        if self._is_gone(looked_s):
            volts *= math.exp(-(looked_s - self._gone_s) / self._held_s)
        bench.changes = {"battery_mv": round(1000.0 * volts) if volts >= 2.0 else 0}

    def _is_gone(self, t_s):
        return self._gone_s is not None and 0.0 <= t_s - self._gone_s < self._away_s

    def power(self, t_s, source_us, sufferer_us, dt_s):
        self._now_s = t_s
        return (IDLE_US, IDLE_US) if self._is_gone(t_s) else (source_us, sufferer_us)


def flown(battery, rig=RIG):
    plan = hold_plan(rig, 12.0, 0.5, 1400.0)
    loop, bench, rows = ended_by(rig, plan, 1, battery.plug_in, command_hook=battery.power)
    modes = [row["mode"] for row in rows]
    return loop.failsafe_cause, bench, rows, modes.index("FAILSAFE") if loop.failsafe_cause else -1


# With a time constant of 0.3 s and more the fall is noticed before the voltage is: what takes
# longer than 0.4 s to come to light can also be over by then.
@pytest.mark.parametrize(
    ("away_s", "held_s", "cause"),
    [
        *((away_s, 0.01, "battery_lost") for away_s in (0.4, 0.7, 1.5, 60.0)),
        *((away_s, 0.05, "battery_lost") for away_s in (0.7, 1.5, 60.0)),
        *((away_s, 5.0, "thrust_lost") for away_s in (0.7, 1.5, 60.0)),
    ],
)
def test_no_pulse_rises_after_the_battery_went_whenever_it_comes_back(away_s, held_s, cause):
    causes, bench, rows, began = flown(Battery(away_s, held_s))
    assert cause in causes
    pulses_us = [sufferer_us for _, sufferer_us in bench.commands[began:]]
    assert all(after <= before for before, after in itertools.pairwise(pulses_us))
    assert pulses_us[-1] == IDLE_US
    assert len(pulses_us) * PERIOD_S == pytest.approx(ladder_s(RIG.limits), abs=0.1)
    # The pulse carries the weight at most: what stands on the stop stays there.
    assert np.max([row["true_z_m"] for row in rows[began + 16 :]]) < 0.1


@pytest.mark.parametrize("held_s", [0.01, 0.5, 2.0])
def test_a_stop_pressed_at_rest_is_noticed_before_the_capacitors_are_empty(held_s):
    rig = RIG.changed(disturbance={"rest_s": 3.0})
    causes, bench, _, began = flown(Battery(60.0, held_s, gone_at=32), rig)
    assert causes == ("battery_lost",)
    # Six tenths are left after half a time constant; the board looks each 0.1 s, the loop waits.
    expected_s = held_s * math.log(1.0 / 0.6) + 0.25
    assert (began - 32) * PERIOD_S == pytest.approx(expected_s + 0.08, abs=0.1)
    assert set(bench.commands) == {(IDLE_US, IDLE_US)}


class Sagging(Battery):
    """Load takes a third of the voltage, and no power."""

    def _after(self, bench, ticks):
        bench.changes = {"battery_mv": 11_100 if ticks < GONE_AT else 7_400}


def test_a_battery_that_sags_by_a_third_flies_on():
    assert flown(Sagging(0.0, 1.0))[0] == ()


def test_no_flight_begins_without_a_battery_where_one_is_measured():
    plan = hold_plan(RIG, 6.0, 0.5, 1400.0)
    refused = Bench(RIG)
    refused.changes = {"battery_mv": 0}
    with pytest.raises(UnusableInput, match="measures no battery: release the emergency stop"):
        Loop(RIG, refused, refused, plan, clock=refused).run()
    assert refused.commands == []
    for rig, flight in ((RIG.changed(battery={"has_divider": False}), plan), resting(RIG, 2.0)):
        bench = Bench(rig)
        bench.changes = {"battery_mv": 0}
        loop = Loop(rig, bench, bench, flight, clock=bench)
        loop.run()
        assert loop.failsafe_cause == ()
