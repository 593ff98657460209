"""A battery that goes and comes back: a pulled plug, a bad contact, an emergency stop released."""

import itertools

import numpy as np
import pytest
from simulated_bench import ended_by

from runtime.reference import hold_plan
from wakedeploy.rig import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 1.0})
IDLE_US = RIG.limits.pulse_us[0]
PERIOD_S = 1.0 / 32.0
GONE_AT = 160  # ticks: in hover


class Battery:
    """Power that is cut and comes back; the board measures it, both motors need it."""

    def __init__(self, away_s: float) -> None:
        self._away_s, self._gone_s, self._bench, self._now_s = away_s, None, None, 0.0

    def plug_in(self, loop, bench, rows):
        bench.changes = {"battery_mv": 11_100}
        rows.put = lambda row: (rows.rows.append(row), self._after(bench, len(rows.rows)))

    def _after(self, bench, ticks):
        if ticks == GONE_AT:
            self._gone_s = self._now_s
        bench.changes = {"battery_mv": 0 if self._is_gone(self._now_s) else 11_100}

    def _is_gone(self, t_s):
        return self._gone_s is not None and 0.0 <= t_s - self._gone_s < self._away_s

    def power(self, t_s, source_us, sufferer_us, dt_s):
        self._now_s = t_s
        return (IDLE_US, IDLE_US) if self._is_gone(t_s) else (source_us, sufferer_us)


@pytest.mark.parametrize("away_s", [0.4, 0.7, 1.5, 60.0])
def test_no_pulse_rises_after_the_battery_went_whenever_it_comes_back(away_s):
    battery = Battery(away_s)
    plan = hold_plan(RIG, 12.0, 0.5, 1400.0)
    loop, bench, rows = ended_by(RIG, plan, 1, battery.plug_in, command_hook=battery.power)
    assert "battery_lost" in loop.failsafe_cause
    began = [row["mode"] for row in rows].index("FAILSAFE")
    pulses_us = [sufferer_us for _, sufferer_us in bench.commands[began:]]
    assert all(after <= before for before, after in itertools.pairwise(pulses_us))
    assert pulses_us[-1] == IDLE_US
    # Within its descent time, and on the stop without a jump.
    assert len(pulses_us) * PERIOD_S == pytest.approx(RIG.limits.sufferer_descent_s, abs=0.1)
    assert np.max([row["true_z_m"] for row in rows[began + 8 :]]) < 0.1
