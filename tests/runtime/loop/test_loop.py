"""The loop in real time against plant and MCU in the same process, failures included."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from world import RIG, World, resting_plan

from runtime.io.conversation import Answer
from runtime.io.protocol import Command as WireCommand
from runtime.loop.arming import arm_limits, require_home
from runtime.loop.blind import ladder_s
from runtime.loop.loop import Loop, applied_s, budget_s, require_wait
from runtime.loop.prediction_worker import Result
from runtime.loop.safety import LINK_LOST_S
from runtime.loop.watch import GapWatch
from runtime.reference import hold_plan, random_plan
from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig.file import default_rig

FLIGHT_S = 5.2


class Forces:
    """Predictions that a test scripts: `force(n)` answers the n-th observation; None is late."""

    def __init__(self, force=lambda n: 0.0, ready_after=4, low=-10.0, high=10.0):
        self.force, self.ready_after = force, ready_after
        self.lead_s = default_lead_s(RIG)
        self.low, self.high = np.full(5, low, np.float32), np.full(5, high, np.float32)
        self.most_n = np.inf
        self.calls = self.resets = self.seen = 0
        self.deadlines_s = []

    def is_possible(self, force_n):
        return abs(force_n) <= self.most_n

    def reset(self):
        self.resets += 1
        self.seen = 0

    def step(self, observation, deadline_s):
        self.seen += 1
        self.calls += 1
        self.deadlines_s.append(deadline_s)
        force_n = self.force(self.calls)
        return None if force_n is None else Result(force_n, self.seen >= self.ready_after)


class Rows:
    def __init__(self):
        self.rows, self.error = [], None

    def put(self, row):
        self.rows.append(row)

    def column(self, name):
        return [row.get(name) for row in self.rows]


def fly(world, predictor=None, seconds=FLIGHT_S, during=None, plan=None):
    rows = Rows()
    plan = plan or hold_plan(RIG, seconds, 0.4, 1400.0)
    loop = Loop(RIG, world, world, plan, predictor, rows, world)
    if during:
        put = rows.put
        rows.put = lambda row: (put(row), during(loop, len(rows.rows)))
    loop.run()
    assert world.disarmed
    return loop, rows


def test_a_clean_flight_rests_flies_rests_and_tracks():
    world = World()
    loop, rows = fly(world)
    modes = rows.column("mode")
    assert modes[:8] == ["ARMED"] * 8
    assert modes[-8:] == ["ARMED"] * 8
    landing = modes.index("LANDING")
    assert set(modes[8:landing]) == {"RUNNING"}
    assert set(modes[landing:-8]) == {"LANDING"}
    assert loop.failsafe_cause == ()
    assert loop.tally.rmse_m < 0.1
    assert max(rows.column("z_est_m")) > 0.3
    assert rows.rows[-1]["source_cmd_us"] == rows.rows[-1]["sufferer_cmd_us"] == 1000.0
    assert {row["homed"] for row in rows.rows} == {1}


def test_each_row_has_timings_round_trips_and_the_time_of_application():
    _, rows = fly(World(), seconds=0.5)
    row = rows.rows[-1]
    stages = [row[f"t_{s}_s"] for s in ("read", "estimate", "predict", "control", "write")]
    assert all(0.0 < s < 1e-3 for s in stages)
    trips = [trip for trip in rows.column("round_trip_s") if trip is not None]
    assert min(trips) >= 0.009
    assert row["t_s"] - 0.1 < row["applied_time_s"] <= row["t_s"]
    assert row["seq_echo"] > rows.rows[0]["seq_echo"]


def test_a_usable_force_is_fed_forward_once_the_memory_is_full():
    _, rows = fly(World(), Forces(lambda n: -0.2, ready_after=20), seconds=1.0)
    feedforward = rows.column("feedforward_n")
    assert feedforward[:8] == [0.0] * 8
    opened = next(i for i, f in enumerate(feedforward) if f > 0.0)
    assert opened >= 19
    assert feedforward[opened : opened + 4] == pytest.approx([0.05, 0.1, 0.15, 0.2])
    assert rows.rows[opened - 1]["force_pred_n"] == pytest.approx(-0.2)


def test_late_predictions_are_not_waited_for_degrade_and_recover_after_a_clean_second():
    predictor = Forces(lambda n: None if 16 <= n < 20 else -0.2)
    world = World()
    loop, rows = fly(world, predictor, seconds=2.2)
    modes, faults = rows.column("mode"), rows.column("faults")
    late = [i for i, f in enumerate(faults) if "late_prediction" in f]
    assert late == [15, 16, 17, 18]
    degraded = [i for i, m in enumerate(modes) if m == "DEGRADED"]
    assert degraded[0] == late[2]
    assert modes[degraded[-1] + 1] == "RUNNING"
    assert degraded[-1] - late[-1] == 31
    assert rows.rows[late[-1] + 4]["feedforward_n"] == 0.0
    assert loop.failsafe_cause == ()
    # The wait ends within the budget, with time left for control and write.
    waits_s = np.diff(predictor.deadlines_s)
    assert waits_s == pytest.approx(1.0 / 32.0, abs=1e-4)
    assert predictor.deadlines_s[0] - world.started_s < budget_s(RIG)


WEIGHT_N = RIG.sufferer.mass_kg * GRAVITY_MPS2


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e30, 1.01 * WEIGHT_N, -1.01 * WEIGHT_N])
def test_a_number_that_is_none_or_more_than_the_weight_degrades_resets_and_warms_the_memory_again(
    bad,
):
    predictor = Forces(lambda n: bad if n == 12 else -0.2, ready_after=10)
    _, rows = fly(World(), predictor, seconds=1.8)
    hit = rows.column("faults").index("bad_prediction")
    assert rows.rows[hit]["mode"] == "DEGRADED"
    assert rows.rows[hit].get("force_pred_n") is None
    assert predictor.resets == 1
    assert "RUNNING" in rows.column("mode")[hit + 32 :]
    assert all(math.isfinite(row["sufferer_cmd_us"]) for row in rows.rows)


def test_a_force_that_no_training_has_shown_degrades_however_small():
    predictor = Forces(lambda n: 0.3 if n == 12 else -0.1)
    predictor.most_n = 0.2
    _, rows = fly(World(), predictor, seconds=0.6)
    hit = rows.column("faults").index("bad_prediction")
    assert hit == 11
    assert rows.rows[hit]["mode"] == "DEGRADED"
    assert predictor.resets == 1


def test_an_observation_far_outside_training_is_never_shown_to_the_model():
    predictor = Forces(low=0.0, high=0.5)  # the height below the source is 2 m
    _, rows = fly(World(), predictor, seconds=0.4)
    assert set(rows.column("faults")) == {"bad_observation"}
    assert predictor.calls == 0
    assert set(rows.column("feedforward_n")) == {0.0}


def at_tick(wanted, act):
    return lambda loop, tick: act(loop) if tick == wanted else None


def test_a_stop_by_hand_idles_the_source_at_once_and_lands_softly():
    world, heights_m = World(), []

    def stop(loop, tick):
        loop.stop_asked = tick >= 80
        heights_m.append(world.plant.z_m)

    loop, rows = fly(world, during=stop)
    assert loop.failsafe_cause == ("operator_stop",)
    down = [row for row in rows.rows if row["mode"] == "FAILSAFE"]
    assert down[0]["source_cmd_us"] == 1000.0
    assert down[0]["sufferer_cmd_us"] > 1400.0
    assert len(down) > 16
    assert np.min(32.0 * np.diff(heights_m[-len(down) :])) > -0.6
    assert down[-1]["sufferer_cmd_us"] == 1000.0
    assert world.plant.z_m < 0.05


def test_a_failsafes_reference_never_goes_back_to_the_plan():
    def stop(loop, tick):
        loop.stop_asked = tick >= 80

    _, rows = fly(World(), during=stop)
    heights_m = [row["z_ref_m"] for row in rows.rows if row["mode"] == "FAILSAFE"]
    assert heights_m[0] > 0.2  # it began in the air
    assert np.all(np.diff(heights_m) <= 0.0)
    last = rows.rows[-1]
    assert heights_m[-1] == 0.0
    assert last["x_ref_m"] == last["x_m"] != 0.0


def test_a_sensor_that_stops_brings_the_sufferer_down_blind_and_softly():
    world, speeds_mps = World(), []
    world.plant._sensor_hook = lambda t, z, steps: (z if t < 2.6 else math.nan, steps)
    loop, rows = fly(world, during=lambda loop, tick: speeds_mps.append(world.plant.vz_mps))
    assert loop.failsafe_cause == ("sensor_lost",)
    down = [row for row in rows.rows if row["mode"] == "FAILSAFE"]
    assert len(down) / 32.0 == pytest.approx(ladder_s(RIG.limits), abs=0.15)
    sinking = down[round(32 * RIG.limits.brake_s) + 1 :]
    assert np.all(np.diff([row["sufferer_cmd_us"] for row in sinking]) <= 0.0)
    assert {row["source_cmd_us"] for row in down} == {1000.0}
    assert min(speeds_mps) > -0.8
    assert world.plant.z_m == 0.0


def test_a_board_that_falls_silent_ends_the_flight():
    def mute(loop):
        loop._link.muted = True

    loop, _ = fly(World(), during=at_tick(20, mute))
    assert loop.failsafe_cause == ("link_lost",)


@pytest.mark.parametrize("plan", [hold_plan(RIG, FLIGHT_S, 0.4, 1400.0), resting_plan(40)])
def test_a_board_that_restarts_is_told_from_a_cable_that_is_cut(plan):
    """It answers no command, as if it were gone, but a greeting: with another boot number."""

    def reboot(loop):
        world = loop._link
        world.port.opened(world.plant.t_s)

    world = World()
    loop, rows = fly(world, during=at_tick(20, reboot), plan=plan)
    assert loop.failsafe_cause == ("mcu_reboot",)
    assert loop.tally.ended == "failsafe: mcu_reboot"
    assert loop.last_reset == 0  # the virtual board knows of no fault
    began = rows.column("mode").index("FAILSAFE")
    assert rows.rows[began]["faults"] == "link_lost+answers_missing"  # what was known then
    assert began - 20 == pytest.approx(32 * LINK_LOST_S, abs=2)
    assert world.answer.status.boot == 2
    assert not world.answer.status.armed
    if plan.motors_off:
        assert {command.sufferer_us for command in world.commands} == {1000.0}


def test_a_recording_that_fails_and_a_limit_that_is_left_end_the_flight():
    def full(loop):
        loop._recorder.error = "disk full"

    assert fly(World(), during=at_tick(20, full))[0].failsafe_cause == ("recorder_failed",)
    shifted = World(sensor_hook=lambda t, z, steps: (z, steps + (8400 if t > 1.0 else 0)))
    assert fly(shifted)[0].failsafe_cause == ("x_limit",)


def stalling_world(rows, at, for_s, rig=RIG):
    """A world in which the tick after so many rows takes so much longer, once."""
    world = World(rig)
    send, stalls = world.send, iter([True])

    def stalling(command):
        if len(rows.rows) == at and next(stalls, False):
            world.now_s += for_s
        return send(command)

    world.send = stalling
    return world


def test_a_slow_tick_is_counted_logged_and_not_repaid():
    rows = Rows()
    world = stalling_world(rows, at=20, for_s=0.045)
    tally = Loop(RIG, world, world, hold_plan(RIG, 1.0, 0.4, 1400.0), None, rows, world).run()
    ticks = rows.column("tick")
    assert [b - a for a, b in itertools.pairwise(ticks) if b - a > 1] == [2]
    assert [row["tick"] for row in rows.rows if "overrun" in row["faults"]] == [20]
    assert tally.overruns == 2  # the slow one and the one that could not begin


def test_a_loop_that_stood_still_is_no_broken_cable_and_comes_down_under_control():
    rows, rig = Rows(), RIG.changed(limits={"brake_s": 0.0, "sink_s": 0.0})
    world = stalling_world(rows, at=60, for_s=0.25, rig=rig)
    loop = Loop(rig, world, world, hold_plan(RIG, FLIGHT_S, 0.4, 1400.0), None, rows, world)
    loop.run()
    assert loop.failsafe_cause[0] == "loop_stalled"
    assert "link_lost" not in loop.failsafe_cause
    down = [row for row in rows.rows if row["mode"] == "FAILSAFE"]
    assert max(row["sufferer_cmd_us"] for row in down[8:]) > 1500.0  # no blind descent
    assert abs(down[-1]["true_z_m"]) < 0.05


@pytest.mark.parametrize("broken", ["_read", "_supervise", "_control", "_write", "_record"])
@pytest.mark.parametrize("for_ever", [False, True])
def test_an_error_of_the_program_in_flight_lands_the_sufferer_and_is_told(broken, for_ever):
    world, rows, speeds_mps = World(), Rows(), []
    loop = Loop(RIG, world, world, hold_plan(RIG, FLIGHT_S, 0.4, 1400.0), None, rows, world)
    whole, fails = getattr(loop, broken), itertools.repeat(True) if for_ever else iter([True])

    def broken_stage(*arguments):
        if loop.tally.ticks >= 80 and next(fails, False):
            raise ZeroDivisionError
        return whole(*arguments)

    loop._beat = lambda: speeds_mps.append(world.plant.vz_mps)
    setattr(loop, broken, broken_stage)
    with pytest.raises(ZeroDivisionError):
        loop.run()
    assert loop.failsafe_cause == ("loop_error",)
    assert world.disarmed
    assert min(speeds_mps) > -0.8
    assert world.plant.z_m < 0.05


def test_a_watch_that_stumbles_ends_no_flight(monkeypatch):
    told = []
    watch = GapWatch(RIG, told.append)
    monkeypatch.setattr(watch._filter, "step", lambda row: 1 / 0)
    world, rows = World(), Rows()
    plan = hold_plan(RIG, 1.0, 0.4, 1400.0)
    tally = Loop(RIG, world, world, plan, None, rows, world, watch=watch).run()
    assert tally.ended == "whole"
    assert "stopped (" in tally.gap.sentence()


def test_nothing_flies_from_a_carriage_that_is_not_at_home():
    world = World()
    world.plant.x_m = 0.2
    with pytest.raises(UnusableInput, match="home mark"):
        fly(world)
    assert world.disarmed
    assert world.commands == []


def test_of_a_virtual_gantry_nobody_is_told_to_push_the_carriage():
    with pytest.raises(UnusableInput, match="begin it anew") as told:
        require_home(SimpleNamespace(homed=False), is_plant=True)
    assert "push" not in str(told.value)
    require_home(SimpleNamespace(homed=True), is_plant=True)


def test_limits_cross_the_wire_in_its_units():
    limits = arm_limits(default_rig())
    assert limits == type(limits).unpack(limits.pack())
    assert limits.max_speed_steps_per_s == 2100


@given(
    low=st.floats(500, 2499),
    width=st.floats(1, 2000),
    slew=st.floats(1, 1e7),
    descents=st.tuples(st.floats(0.01, 10), st.floats(0.01, 10)),
    steps_per_m=st.floats(2, 1e6),
    steps_per_s=st.floats(1, 32_767),
    accel_mps2=st.floats(0.5, 50),
)
@settings(max_examples=50, deadline=None)
def test_every_rig_that_is_accepted_can_be_armed_and_commanded(
    low, width, slew, descents, steps_per_m, steps_per_s, accel_mps2
):
    try:
        rig = default_rig().changed(
            limits={
                "pulse_us": [low, min(low + width, 2500)],
                "slew_us_per_s": slew,
                "source_descent_s": descents[0],
                "sufferer_descent_s": descents[1],
            },
            stepper={
                "steps_per_m": steps_per_m,
                "max_speed_mps": steps_per_s / steps_per_m,
                "max_accel_mps2": accel_mps2,
            },
        )
    except UnusableInput:
        assume(False)
    for limits in (arm_limits(rig), arm_limits(rig, motors_off=True)):
        assert type(limits).unpack(limits.pack()).is_usable
    most = limits.max_speed_steps_per_s
    assert most >= 1
    WireCommand(low, low, -most, low, low).pack()
    # The board's rig may be another one: the limits are the host's all the same.
    world = World()
    assert world.arm(limits).armed
    world.sleep(0.3)


def test_a_round_trip_that_leaves_no_time_to_predict_is_refused():
    require_wait(default_rig().changed(latency={"round_trip_s": 0.028}))
    slow = default_rig().changed(latency={"round_trip_s": 0.0283})
    with pytest.raises(UnusableInput, match=r"round_trip_s = 0\.0283 .* below 0\.02825 s"):
        require_wait(slow)


def test_a_carriage_command_never_asks_for_more_than_the_rigs_top_speed():
    rig = RIG.changed(control={"carriage_gain_per_s": 100.0})
    world = World(rig)
    plan = random_plan(rig, 6.0, 1)
    Loop(rig, world, world, plan, None, Rows(), world).run()
    steps_per_s = {abs(command.carriage_steps_per_s) for command in world.commands}
    assert max(steps_per_s) == 2100


def test_how_a_flight_ended_is_in_its_tally():
    assert fly(World(), seconds=0.3)[0].tally.ended == "whole"

    def stop(loop):
        loop.stop_asked = True

    assert fly(World(), during=at_tick(12, stop))[0].tally.ended == "stopped by hand"

    def mute(loop):
        loop._link.muted = True

    assert fly(World(), during=at_tick(12, mute))[0].tally.ended == "failsafe: link_lost"

    ended = []

    def drop(loop):  # as a second Ctrl-C does
        loop.stop_asked = loop.is_dropped = True
        ended.append(loop)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fly(World(), during=at_tick(12, drop))
    assert ended[0].tally.ended == "stopped by hand, and its motors switched off at once"

    def cut_then_dropped(loop, ticks):
        if ticks == 12:
            mute(loop)
        if "link_lost" in loop.failsafe_cause:
            drop(loop)

    with pytest.raises(KeyboardInterrupt):
        fly(World(), during=cut_then_dropped)
    assert ended[-1].tally.ended == "failsafe: link_lost"  # nobody could switch them off

    def break_off(loop):
        raise RuntimeError("a bug")

    ended = []
    with pytest.raises(RuntimeError, match="a bug"):
        fly(
            World(),
            during=lambda loop, tick: ended.append(loop) or at_tick(3, break_off)(loop, tick),
        )
    assert ended[0].tally.ended == "broken off"


def test_the_time_of_application_survives_the_wrap_of_the_boards_clock():
    world = World()
    world.arm(arm_limits(RIG))
    status = world.answer.status
    before_wrap = type(status)(**{**vars(status), "applied_time_us": 2**32 - 500})
    answer = Answer(before_wrap, mcu_time_us=1500, received_s=50.0, round_trip_s=0.01)
    assert applied_s(answer) == pytest.approx(50.0 - 0.002)
