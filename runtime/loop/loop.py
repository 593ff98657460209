"""The 32 Hz loop: read → estimate → predict → supervise → control → write → record.

In: an open link, a range source, a plan, optionally a predictor. Out: commands, one row per tick,
and a tally. The steps between are `runtime.loop.pilot`'s, the same that simulated flights take.
"""

import contextlib
import math
import time
from collections.abc import Callable

from runtime.io.conversation import Answer
from runtime.io.protocol import TIME_WRAP_US, Fault
from runtime.io.protocol import Command as WireCommand
from runtime.io.range_source import RangeReading, RangeSource
from runtime.io.realtime import Clock, Laps, Pacer, Tick
from runtime.loop import safety
from runtime.loop.answers import OLD_TICKS, AnswerDoor, Heard
from runtime.loop.arming import arm_limits, require_battery, require_home
from runtime.loop.blind import ladder_s
from runtime.loop.controller import Command, Terms
from runtime.loop.copies import replace
from runtime.loop.estimate import Measurement
from runtime.loop.estimator import SAME_TICKS
from runtime.loop.forecasting import Forecasting, Prediction
from runtime.loop.interfaces import Onlooker, RowSink, Wire
from runtime.loop.lateness import Lateness
from runtime.loop.pilot import LogValue, Pilot, finite_or_none, resting_reference, tick_row
from runtime.loop.prediction_worker import Predictions
from runtime.loop.readings import RangeDoor, Seen
from runtime.loop.safety import ANSWERS_MISSING_S, Event, Findings, Mode, SafetyState
from runtime.loop.silent_faults import SignReader, Signs
from runtime.loop.tally import DROPPED, Tally
from runtime.loop.watch import GapWatch
from runtime.loop.way_down import DEADMAN_S, WayDown
from runtime.reference import FlightPlan, Reference
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig

PERIOD_S = 1.0 / LOOP_RATE_HZ
KNOWN_TICKS = 3  # after this many ticks with the same answer nobody knows which pulses act
SILENT_S = 2.0 * PERIOD_S  # after this long without an answer nobody knows what the board hears
WRITE_MARGIN_S = 0.003  # kept for control and write when the wait for a prediction ends

Row = dict[str, LogValue]


def budget_s(rig: Rig) -> float:
    """The Pi's time between measurement and command: the period less the round trip [s]."""
    return PERIOD_S - rig.latency.round_trip_s


def prediction_wait_s(rig: Rig) -> float:
    """How long after a tick's start the loop waits for its prediction [s]."""
    return budget_s(rig) - WRITE_MARGIN_S


def require_wait(rig: Rig) -> None:
    """UnusableInput when a rig's round trip leaves no time to wait for any prediction."""
    if prediction_wait_s(rig) <= 0.0:
        raise UnusableInput(
            f"latency.round_trip_s = {rig.latency.round_trip_s:g} leaves no time for a prediction "
            f"in a tick of {1e3 * PERIOD_S:g} ms: it must lie below "
            f"{PERIOD_S - WRITE_MARGIN_S:g} s; measure it again, or fly --baseline."
        )


class Loop:
    """One run: rest, flight, rest; `run` it once. `beat` is called after every tick.

    A tick's row holds the time that each stage took, if the loop `is_timed`: on a simulated clock
    computing takes no time.
    """

    def __init__(
        self,
        rig: Rig,
        link: Wire,
        ranges: RangeSource,
        plan: FlightPlan,
        worker: Predictions | None = None,
        recorder: RowSink | None = None,
        clock: Clock = time,
        watch: GapWatch | None = None,
        beat: Callable[[], None] | None = None,
        *,
        onlooker: Onlooker | None = None,
        is_timed: bool = True,
    ) -> None:
        self._rig, self._link, self._ranges, self._plan = rig, link, ranges, plan
        self._worker, self._recorder, self._clock = worker, recorder, clock
        self._watch, self._beat, self._is_timed = watch, beat, is_timed
        self._onlooker = onlooker
        self._pilot = Pilot(rig, worker.lead_s if worker is not None else 0.0)
        self._rest_ticks = round(rig.disturbance.rest_s * LOOP_RATE_HZ)
        self._wait_s = prediction_wait_s(rig)
        self._limits = arm_limits(rig, plan.motors_off)
        self._forecasting = Forecasting(rig, self._pilot, worker)
        self._safety, self._lateness = SafetyState(), Lateness(rig)
        self._last_tick_s: float | None = None
        self._sign_reader, self._signs = SignReader(rig), Signs()
        self._way_down = WayDown(rig, self._pilot)
        self._range_door, self._answer_door = RangeDoor(rig), AnswerDoor(rig)
        self._finished, self._rested = False, 0
        self._late_writes = 0  # commands in a row that went out after their tick was over
        self.error: Exception | None = None  # of the program; after it the flight landed
        self.last_reset = Fault.NONE  # of a board that restarted in flight
        self.stop_asked = self.is_dropped = False  # by hand: brought down, or motors off at once
        self.tally = Tally(PERIOD_S)

    @property
    def failsafe_cause(self) -> tuple[str, ...]:
        """The faults that ended the flight; empty after a good one."""
        return self._safety.cause

    @property
    def _flies(self) -> bool:
        """Whether motors may be turning; else a person may hold the sufferer, or put it down."""
        return not self._plan.motors_off and self._safety.mode is not Mode.ARMED

    def run(self) -> Tally:
        """Arm, fly, come to rest. The motors are idle when it returns or raises.

        Raises UnusableInput if the carriage is not at home, where its steps are counted from, or if
        a flight's battery is not there.
        """
        armed = self._link.arm(self._limits)
        try:
            newest = self._ranges.newest
            require_home(armed, is_plant=newest is not None and newest.plant_time_us > 0)
            require_battery(armed, self._rig, self._plan)
        except UnusableInput:
            self._link.disarm()
            raise
        self._signs = replace(self._signs, armed_v=armed.battery_mv / 1000.0)
        self._boot = armed.boot
        self._safety = safety.happened(self._safety, Event.ARM)
        self._origin_s = self._clock.monotonic()
        self._state = self._pilot.initial(0.0)
        try:
            pacer = Pacer(PERIOD_S, self._clock)
            while not self._finished:
                self._guarded_tick(pacer.wait())
                self._look_for_a_stop()
                if self._beat is not None:
                    self._beat()
        except Exception:
            self._let_the_deadman_land()
            raise
        finally:
            self._wait_for_a_board_that_hears_nothing()
            self._link.disarm()
            self._safety = safety.happened(self._safety, Event.DISARM)
            self._look_for_a_reboot()
            self.tally.ended = self._ending()
            self.tally.gap = self._watch.report if self._watch is not None else None
        if self.error is not None:
            raise self.error
        return self.tally

    def _look_for_a_stop(self) -> None:
        """An onlooker may ask for the way down, as Ctrl-C does."""
        if self._onlooker is not None and self._onlooker.stop_asked():
            self.stop_asked = True

    def _wait_for_a_board_that_hears_nothing(self) -> None:
        """Wait for a board that cannot be disarmed: its own descent ends in idle motors."""
        descent_s = DEADMAN_S + ladder_s(self._rig.limits)
        while not self._plan.motors_off:
            since_s = self._link.unanswered_since_s
            silent_s = 0.0 if since_s is None else self._clock.monotonic() - since_s
            if not SILENT_S < silent_s < descent_s:
                return
            self._clock.sleep(PERIOD_S)

    def _let_the_deadman_land(self) -> None:
        """Wait: without commands the board lands the sufferer; disarmed, it would drop it."""
        if not self._flies:
            return
        limits = self._rig.limits
        self._clock.sleep(DEADMAN_S + max(limits.source_descent_s, ladder_s(limits)))

    def _look_for_a_reboot(self) -> None:
        """A restarted board answers no command, as behind a cut cable; it answers a greeting."""
        if "link_lost" not in self.failsafe_cause:
            return
        status = self._link.greet_again()
        if status is not None and status.boot != self._boot:
            self.last_reset = status.faults
            others = (c for c in self.failsafe_cause if c not in ("link_lost", "thrust_lost"))
            cause = ("mcu_reboot", *others)
            self._safety = replace(self._safety, cause=cause)

    def _ending(self) -> str:
        """How the flight ended, for its summary."""
        cause = self.failsafe_cause
        # A board that hears nothing comes down by itself, whatever a person asked for.
        if self.is_dropped and "link_lost" not in cause and not self._plan.motors_off:
            return DROPPED
        stopped = cause == () and self.stop_asked and not self._finished
        if stopped or cause[:1] == ("operator_stop",):
            return "stopped by hand"
        if cause:
            return f"failsafe: {'+'.join(cause)}"
        return "whole" if self._finished else "broken off"

    def _guarded_tick(self, tick: Tick) -> None:
        """A tick; if the program fails in it in flight, the way down takes its place.

        After the first error nothing is predicted, and no log or watch can end a tick. If something
        still fails, the pulses of a blind descent remain.
        """
        try:
            self._tick(tick)
        except Exception as error:
            if not self._flies:
                raise
            is_first = self.error is None
            self.error = self.error or error
            with contextlib.suppress(Exception):
                if is_first:
                    self._tick(tick)
                    return
            self._sink()

    def _tick(self, tick: Tick) -> None:
        """One tick's steps in their order."""
        laps = Laps(self._clock)
        reading, seen, heard, measured = self._read()
        laps.mark("t_read_s")
        before, self._state = self._state, self._pilot.estimate(self._state, measured)
        self._state = self._lateness.step(before, self._state, measured)
        if measured.same > SAME_TICKS:
            self._state = self._way_down.without_the_last_samples(self._state)
        aim = self._pilot.spared(self._state, self._aim(tick.index))
        laps.mark("t_estimate_s")
        prediction = self._predict(aim, measured.t_s, tick.start_s + self._wait_s)
        laps.mark("t_predict_s")
        self._supervise(prediction, reading, seen, heard, measured)
        passed_s = self._state.estimate.t_s - before.estimate.t_s
        aim, command, terms = self._control(aim, passed_s, measured, prediction)
        laps.mark("t_control_s")
        self._write(command)
        is_late = self._clock.monotonic() > tick.start_s + PERIOD_S
        self._late_writes = self._late_writes + 1 if is_late else 0
        laps.mark("t_write_s")
        self._lateness.catch_up()
        row = tick_row(tick.index, measured, self._state, aim, command, terms)
        row |= laps.times_s if self._is_timed else {}
        row |= self._reported(reading, heard, prediction)
        with contextlib.suppress(*(() if self.error is None else (Exception,))):
            self._score_and_log(row, tick)

    def _score_and_log(self, row: Row, tick: Tick) -> None:
        """Score and log after the command is on its way, so that it does not wait for them."""
        if self._watch is not None:
            row["gap_score"] = self._watch.step(row)
        self._record(row, tick)
        if self._onlooker is not None:
            self._onlooker.put(row | {"force_now_n": self._state.unexplained_n})

    def _sink(self) -> None:
        """Send a blind descent's pulses only; if they do not go out, the board has its own."""
        self._safety = safety.watch(self._safety, Findings(tick_failed=True), self._rig.limits)
        command = self._way_down.sink(self._clock.monotonic() - self._origin_s)
        self._finished |= command is None
        if command is not None:
            with contextlib.suppress(Exception):
                self._write(command)

    def _read(self) -> tuple[RangeReading, Seen, Heard, Measurement]:
        """The newest range sample and the newest status, without waiting for either."""
        now_s = self._clock.monotonic()
        reading, answer = self._ranges.newest, self._link.answer
        assert reading is not None  # the first one was waited for before arming
        assert answer is not None  # arming was answered
        seen, heard = self._range_door.step(reading, now_s), self._answer_door.step(answer)
        measured = Measurement(
            now_s - self._origin_s,
            seen.range_m,
            seen.age_s,
            seen.repeats,
            answer.status.steps,
            heard.repeats,
            seen.same,
            seen.alike,
            acts_known=heard.late_answers == 0 and heard.repeats < KNOWN_TICKS,
        )
        return reading, seen, heard, measured

    def _aim(self, index: int) -> Reference:
        """This tick's place in the plan, and the events that come with it."""
        planned = index - self._rest_ticks
        if planned < 0:
            return resting_reference(self._rig)
        if planned < len(self._plan):
            self._safety = safety.happened(self._safety, Event.START)
            return self._plan.at(planned, self._pilot.preview_s)
        over = Event.FINISH if self._plan.motors_off else Event.LAND
        self._safety = safety.happened(self._safety, over)
        if self._safety.mode is Mode.ARMED:
            self._rested += 1
            self._finished = self._rested >= self._rest_ticks
        return resting_reference(self._rig)

    def _predict(self, aim: Reference, t_s: float, deadline_s: float) -> Prediction:
        if self._safety.mode is Mode.FAILSAFE or self.error is not None:
            return Prediction()
        return self._forecasting.ask(self._state, aim, t_s, deadline_s)

    def _supervise(
        self,
        prediction: Prediction,
        reading: RangeReading,
        seen: Seen,
        heard: Heard,
        measured: Measurement,
    ) -> None:
        now_s = measured.t_s + self._origin_s
        # A plant process that the computer has not let run can neither answer nor measure.
        behind_s = reading.behind_s(now_s)
        stalled_s = self._stalled_s(now_s, reading)
        asked_s, at_rest = self._link.unanswered_since_s, self._safety.mode is Mode.ARMED
        silent_s = 0.0 if asked_s is None else now_s - behind_s - asked_s
        self._way_down.late_s = heard.answer.round_trip_s - self._rig.latency.round_trip_s
        status, estimate = heard.answer.status, self._state.estimate
        signs = self._read_signs(measured, status.battery_mv / 1000.0)
        found = Findings(
            late=prediction.late,
            bad_prediction=prediction.bad_prediction,
            bad_observation=prediction.bad_observation,
            doubted=prediction.doubted,
            bad_range=seen.is_bad,
            range_silence_s=math.inf
            if self._ranges.failure
            else max(seen.silence_s - behind_s, estimate.rejected_s if self._flies else 0.0),
            tick_failed=self.error is not None,
            stalled_s=stalled_s,
            link_silence_s=silent_s,
            late_answers=0 if behind_s else heard.late_answers,
            late_commands=0 if behind_s else max(heard.late_commands, self._late_writes),
            link_failed=self._link.failure is not None
            or (at_rest and silent_s > ANSWERS_MISSING_S),
            mcu_fault=bool(status.faults) or not status.armed,
            recorder_failed=self._recorder is not None and self._recorder.error is not None,
            stop_asked=self.stop_asked,
            range_jump_m=estimate.jumped_m if self._flies else 0.0,
            is_noisy=estimate.is_noisy and self._flies,
            held_up_mps=signs.held_up_mps if self._flies else 0.0,
            range_frozen_s=signs.range_frozen_s,
            range_frozen_limit_s=self._sign_reader.frozen_limit_s,
            moves_unseen=self._way_down.moves_unseen,
            not_lifting_s=signs.not_lifting_s,
            rises_unseen=self._way_down.rises_unseen,
            unexplained_s=self._way_down.unexplained_s,
            range_late=self._range_late(),
            thrust_share=signs.thrust_share,
            battery_gone_s=signs.battery_gone_s,
            z_m=estimate.z_m,
            x_m=estimate.x_m,
        )
        self._safety = safety.watch(self._safety, found, self._rig.limits)
        if safety.doubts_the_range(self._safety, found):
            self._lateness.adopt()

    def _stalled_s(self, now_s: float, reading: RangeReading) -> float:
        """The time since the last tick [s]; a pause before a failsafe is remembered."""
        stalled_s = 0.0 if self._last_tick_s is None else now_s - self._last_tick_s
        self._last_tick_s = now_s
        if not self._safety.cause:  # later ones explain nothing
            self.tally.stood_still(stalled_s, now_s - self._origin_s)
            self.tally.gantry_stood_still(reading.late_s(now_s), now_s - self._origin_s)
        return stalled_s

    def _read_signs(self, measured: Measurement, battery_v: float) -> Signs:
        """What the motion shows of faults that report themselves nowhere."""
        estimate = self._state.estimate
        self._signs = self._sign_reader.step(
            self._signs,
            t_s=measured.t_s,
            range_m=measured.range_m,
            z_m=estimate.z_m,
            vz_mps=estimate.vz_mps,
            thrust_n=estimate.rotor_speed**2,
            battery_v=battery_v,
        )
        return self._signs

    def _range_late(self) -> float:
        """Evidence that readings are late; less counts if the loop does not swing."""
        evidence = self._lateness.evidence if self._flies else 0.0
        if self._way_down.unexplained_sd_n > safety.SWINGING_SD_N:
            return evidence
        return min(evidence, max(safety.RANGE_LATE, safety.CALM_SHARE * evidence))

    def _control(
        self,
        aim: Reference,
        passed_s: float,
        measured: Measurement,
        prediction: Prediction,
    ) -> tuple[Reference, Command, Terms]:
        mode = self._safety.mode
        usable_n = prediction.force_n if mode is Mode.RUNNING else None
        feedforward_n = self._forecasting.fed_forward_n(usable_n)
        believe = self._flies and not self._safety.cause
        self._way_down.reckon(self._state, measured, passed_s, believe=believe)
        nothing_flies = self._plan.motors_off or self._safety.failed_in is Mode.ARMED
        if mode is Mode.FAILSAFE and not nothing_flies:
            aim, command, terms = self._come_down(measured, feedforward_n)
        elif mode is Mode.FAILSAFE:
            aim, command, terms = self._rest_for_good()
        elif mode is Mode.ARMED:
            self._state, command, terms = self._pilot.rest(self._state)
        elif self._plan.motors_off:
            self._state, command, terms = self._pilot.drive(self._state, aim)
        elif mode is Mode.LANDING:
            command, terms = self._touch_down(measured)
        else:
            self._state, command, terms = self._pilot.control(self._state, aim, feedforward_n)
        if measured.steps_repeats > OLD_TICKS and self._flies:
            command = replace(command, carriage_mps=0.0)  # nobody knows where the carriage is
        self._way_down.commanded(command, flies=self._flies)
        return aim, command, terms

    def _touch_down(self, measured: Measurement) -> tuple[Command, Terms]:
        """One tick between a plan's end and the rest: the motors stop once the sufferer stands."""
        pulse_us = self._way_down.settle(self._state, measured)
        if pulse_us is None:
            self._safety = safety.happened(self._safety, Event.FINISH)
            self._rested, self._finished = 1, self._rest_ticks <= 1
            self._state, command, terms = self._pilot.rest(self._state)
            return command, terms
        wanted = replace(self._pilot.homing(self._state), sufferer_us=pulse_us)
        self._state, command, terms = self._pilot.held(self._state, wanted)
        return command, terms

    def _come_down(
        self, measured: Measurement, feedforward_n: float | None
    ) -> tuple[Reference, Command, Terms]:
        """One tick of a failsafe's way down; at its end the motors rest."""
        now = self._safety
        down = self._way_down.descend(self._state, measured, now.faults, now.cause, feedforward_n)
        if down is None:
            return self._rest_for_good()
        self._state, aim, command, terms = down
        return aim, command, terms

    def _rest_for_good(self) -> tuple[Reference, Command, Terms]:
        """A failsafe's last tick: it aims at rest, the carriage where it is, not at the plan."""
        self._finished = True
        self._state, command, terms = self._pilot.rest(self._state)
        x_m = self._state.estimate.x_m
        return replace(resting_reference(self._rig), x_m=x_m), command, terms

    def _write(self, command: Command) -> None:
        most = self._limits.max_speed_steps_per_s
        steps = round(command.carriage_mps * self._rig.stepper.steps_per_m)
        steps = min(max(steps, -most), most)
        blind = self._way_down.pulses
        self._link.send(
            WireCommand(
                command.source_us, command.sufferer_us, steps, blind.brake_us, blind.sink_us
            )
        )

    def _reported(self, reading: RangeReading, heard: Heard, prediction: Prediction) -> Row:
        """What board and sensor said, for the log; a status is logged once, with its round trip."""
        answer, status = heard.answer, heard.answer.status
        return {
            "force_pred_n": prediction.logged_n,
            "source_applied_us": status.source_us,
            "sufferer_applied_us": status.sufferer_us,
            "seq_echo": status.sequence,
            "round_trip_s": finite_or_none(answer.round_trip_s) if heard.is_new else None,
            "applied_time_s": applied_s(answer) - self._origin_s,
            "homed": int(status.homed),
            "battery_v": status.battery_mv / 1000.0 if status.battery_mv else None,
            "mode": self._safety.mode.value,
            "faults": "+".join(self._safety.faults),
            "true_wake_force_n": finite_or_none(reading.true_wake_force_n),
            "true_hook_force_n": finite_or_none(reading.true_hook_force_n),
            "true_z_m": finite_or_none(reading.true_z_m),
        }

    def _record(self, row: Row, tick: Tick) -> None:
        overran = self._clock.monotonic() > tick.start_s + PERIOD_S
        if overran:
            row["faults"] = "+".join(filter(None, (str(row["faults"]), "overrun")))
        if self._recorder is not None:
            # A column that only some rigs know is missing in the others' logs, rather than empty.
            self._recorder.put({name: value for name, value in row.items() if value is not None})
        self.tally.add(row, tick.late_s, tick.skipped, overran=overran)


def applied_s(answer: Answer) -> float:
    """When the newest pulses reached the pins [s, monotonic]; late by the answer's way."""
    ago_us = (answer.mcu_time_us - answer.status.applied_time_us) % TIME_WRAP_US
    return answer.received_s - ago_us * 1e-6
