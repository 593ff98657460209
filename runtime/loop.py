"""The 32 Hz loop: read → estimate → predict → control → write → record.

In: an open link, a range source, a plan, optionally a predictor. Out: commands, one row per tick,
and a tally. The steps between are `runtime.pilot`'s, the same that simulated flights take.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from runtime import safety
from runtime.blind import blind_pulses
from runtime.controller import Command, Terms
from runtime.conversation import Answer
from runtime.estimator import Measurement
from runtime.pilot import LogValue, Pilot, resting_reference, tick_row
from runtime.prediction import Predictions
from runtime.protocol import TIME_WRAP_US, Arm, Fault, Status
from runtime.protocol import Command as WireCommand
from runtime.range_source import RangeReading, RangeSource
from runtime.realtime import Clock, Laps, Pacer, Tick
from runtime.reference import FlightPlan, Reference
from runtime.safety import Event, Findings, Gate, Mode, SafetyState
from runtime.signs import SignReader, Signs
from runtime.tally import Tally
from runtime.watch import GapWatch
from wakedeploy.errors import UnusableInput
from wakedeploy.rig import LOOP_RATE_HZ, Rig

PERIOD_S = 1.0 / LOOP_RATE_HZ
WRITE_MARGIN_S = 0.003  # kept for control and write when the wait for a prediction ends

Row = dict[str, LogValue]


def budget_s(rig: Rig) -> float:
    """What the Pi may take between measurement and command: the period less the round trip [s]."""
    return PERIOD_S - rig.latency.round_trip_s


def prediction_wait_s(rig: Rig) -> float:
    """How long after a tick's start its prediction is waited for [s]."""
    return budget_s(rig) - WRITE_MARGIN_S


def require_wait(rig: Rig) -> None:
    """UnusableInput when a rig's round trip leaves no time to wait for any prediction."""
    if prediction_wait_s(rig) <= 0.0:
        raise UnusableInput(
            f"latency.round_trip_s = {rig.latency.round_trip_s:g} leaves no time for a prediction "
            f"in a tick of {1e3 * PERIOD_S:g} ms: it must lie below "
            f"{PERIOD_S - WRITE_MARGIN_S:g} s; measure it again, or fly --baseline."
        )


@dataclass(frozen=True, slots=True)
class Prediction:
    """What became of one tick's prediction; `force_n` is None where it must not be used."""

    logged_n: float | None = None
    force_n: float | None = None
    late: bool = False
    bad_prediction: bool = False
    bad_observation: bool = False


class RowSink(Protocol):
    """Where rows go: `runtime.recorder.Recorder`."""

    @property
    def error(self) -> str | None:
        """Why no more rows can be taken; None while all is well."""

    def put(self, row: Mapping[str, LogValue]) -> None:
        """Take one row without blocking."""


class Wire(Protocol):
    """The other end of the wire: `runtime.link.Link`, or a simulation of it."""

    @property
    def answer(self) -> Answer | None:
        """The newest status; None before the first."""

    @property
    def failure(self) -> str | None:
        """Why no more statuses will come; None while all is well."""

    def arm(self, limits: Arm) -> Status:
        """Arm with these limits; the board's answer."""

    def disarm(self) -> None:
        """Motors off."""

    def send(self, message: WireCommand) -> int:
        """Send a command without waiting; its sequence number."""

    def greet_again(self) -> Status | None:
        """The status of a board that fell silent, after a new greeting; None if it stays so."""


class Loop:
    """One run: rest, flight, rest; `run` it once. `beat` is called after every tick.

    What each stage of a tick takes is in its row, unless it is not `is_timed`: on a simulated clock
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
        is_timed: bool = True,
    ) -> None:
        self._rig, self._link, self._ranges, self._plan = rig, link, ranges, plan
        self._worker, self._recorder, self._clock = worker, recorder, clock
        self._watch, self._beat, self._is_timed = watch, beat, is_timed
        self._pilot = Pilot(rig, worker.lead_s if worker is not None else 0.0)
        self._rest_ticks = round(rig.disturbance.rest_s * LOOP_RATE_HZ)
        self._wait_s = prediction_wait_s(rig)
        self._limits = arm_limits(rig, plan.motors_off)
        self._safety, self._gate = SafetyState(), Gate()
        self._last_tick_s: float | None = None
        self._sign_reader, self._signs = SignReader(rig), Signs()
        self._descent: safety.Descent | None = None
        self._last_range_us, self._range_repeats = -1, 0
        self._last_sequence: int | None = None
        self._finished = False
        self.last_reset = Fault.NONE  # of a board that restarted in flight
        self.stop_asked = False
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

        Raises UnusableInput when the carriage is not at home, from where steps are counted, or a
        flight's battery is not there.
        """
        armed = self._link.arm(self._limits)
        self._require_home(armed)
        self._require_battery(armed)
        self._boot = armed.boot
        self._safety = safety.happened(self._safety, Event.ARM)
        self._origin_s = self._range_seen_s = self._clock.monotonic()
        self._state = self._pilot.initial(0.0)
        try:
            pacer = Pacer(PERIOD_S, self._clock)
            while not self._finished:
                self._tick(pacer.wait())
                if self._beat is not None:
                    self._beat()
        except Exception:
            self._let_the_deadman_land()
            raise
        finally:
            self._link.disarm()
            self._safety = safety.happened(self._safety, Event.DISARM)
            self._look_for_a_reboot()
            self.tally.ended = self._ending()
            self.tally.gap = self._watch.report if self._watch is not None else None
        return self.tally

    def _let_the_deadman_land(self) -> None:
        """Without commands the board brings the motors to idle on ramps; disarmed, they stop."""
        if not self._flies:
            return
        limits = self._rig.limits
        ramp_s = max(limits.source_descent_s, limits.sufferer_descent_s)
        self._clock.sleep(safety.LINK_LOST_S + ramp_s)

    def _look_for_a_reboot(self) -> None:
        """A board that restarted answers no command, as behind a cut cable; a greeting it does."""
        if "link_lost" not in self.failsafe_cause:
            return
        status = self._link.greet_again()
        if status is not None and status.boot != self._boot:
            self.last_reset = status.faults
            cause = ("mcu_reboot", *(c for c in self.failsafe_cause if c != "link_lost"))
            self._safety = replace(self._safety, cause=cause)

    def _ending(self) -> str:
        """How the flight ended, as its summary says it."""
        cause = self.failsafe_cause
        stopped = cause == () and self.stop_asked and not self._finished
        if stopped or cause[:1] == ("operator_stop",):
            return "stopped by hand"
        if cause:
            return f"failsafe: {'+'.join(cause)}"
        return "whole" if self._finished else "broken off"

    def _require_home(self, armed: Status) -> None:
        if not armed.homed:
            self._link.disarm()
            raise UnusableInput(
                "The carriage is not at its home mark, from where its steps are counted; switch "
                "the stepper's supply off, push it there, switch it on and start again."
            )

    def _require_battery(self, armed: Status) -> None:
        if not self._rig.battery.has_divider:
            return
        if not armed.battery_mv and not self._plan.motors_off:
            self._link.disarm()
            raise UnusableInput(
                "The board measures no battery: release the emergency stop, plug the battery in "
                "and start again; a rig without a divider has no battery.has_divider."
            )
        self._signs = replace(self._signs, armed_v=armed.battery_mv / 1000.0)

    def _tick(self, tick: Tick) -> None:
        """The order of everything."""
        laps = Laps(self._clock)
        reading, answer, measured = self._read()
        laps.mark("t_read_s")
        self._state = self._pilot.estimate(self._state, measured)
        aim = self._aim(tick.index)
        laps.mark("t_estimate_s")
        prediction = self._predict(aim, tick.start_s + self._wait_s)
        laps.mark("t_predict_s")
        self._supervise(prediction, reading, answer, measured)
        aim, command, terms = self._control(aim, measured.t_s, prediction)
        laps.mark("t_control_s")
        self._write(command)
        laps.mark("t_write_s")
        row = tick_row(tick.index, measured, self._state, aim, command, terms)
        row |= laps.times_s if self._is_timed else {}
        row |= self._reported(reading, answer, prediction)
        if self._watch is not None:  # the command is on its way; nothing waits for the score
            row["gap_score"] = self._watch.step(row)
        self._record(row, tick)

    def _read(self) -> tuple[RangeReading, Answer, Measurement]:
        """The newest range sample and the newest status; neither is waited for."""
        now_s = self._clock.monotonic()
        reading, answer = self._ranges.newest, self._link.answer
        assert reading is not None  # the first one was waited for before arming
        assert answer is not None  # arming was answered
        if reading.sensor_time_us == self._last_range_us:
            self._range_repeats += 1
        else:
            self._range_repeats, self._last_range_us = 0, reading.sensor_time_us
            if reading.status == 0:
                self._range_seen_s = now_s
        age_s = now_s - reading.sensor_time_s
        measured = Measurement(
            now_s - self._origin_s,
            reading.range_m,
            age_s,
            self._range_repeats,
            answer.status.steps,
        )
        return reading, answer, measured

    def _aim(self, index: int) -> Reference:
        """This tick's place in the plan, and the events that come with it."""
        planned = index - self._rest_ticks
        if planned < 0:
            return resting_reference(self._rig)
        if planned < len(self._plan):
            self._safety = safety.happened(self._safety, Event.START)
            return self._plan.at(planned, self._pilot.preview_s)
        self._safety = safety.happened(self._safety, Event.FINISH)
        over = planned >= len(self._plan) + self._rest_ticks - 1
        self._finished = over and self._safety.mode is Mode.ARMED
        return resting_reference(self._rig)

    def _predict(self, aim: Reference, deadline_s: float) -> Prediction:
        """Ask the model and wait until the deadline; what cannot be used resets its memory."""
        if self._worker is None or self._safety.mode is Mode.FAILSAFE:
            return Prediction()
        observed = self._pilot.observe(self._state, aim)
        if safety.far_outside(observed, self._worker.low, self._worker.high):
            self._worker.reset()
            return Prediction(bad_observation=True)
        result = self._worker.step(observed, deadline_s)
        if result is None:
            return Prediction(late=True)
        if not math.isfinite(result.force_n):
            self._worker.reset()
            return Prediction(bad_prediction=True)
        return Prediction(result.force_n, result.force_n if result.ready else None)

    def _supervise(
        self, prediction: Prediction, reading: RangeReading, answer: Answer, measured: Measurement
    ) -> None:
        now_s = measured.t_s + self._origin_s
        # A plant process that the computer has not let run can neither answer nor measure.
        heard_until_s = now_s - reading.behind_s(now_s)
        stalled_s = 0.0 if self._last_tick_s is None else now_s - self._last_tick_s
        self._last_tick_s = now_s
        self.tally.stood_still(stalled_s, measured.t_s)
        status, estimate = answer.status, self._state.estimate
        self._signs = signs = self._sign_reader.step(
            self._signs,
            t_s=measured.t_s,
            range_m=measured.range_m,
            z_m=estimate.z_m,
            thrust_n=estimate.rotor_speed**2,
            battery_v=status.battery_mv / 1000.0,
        )
        found = Findings(
            late=prediction.late,
            bad_prediction=prediction.bad_prediction,
            bad_observation=prediction.bad_observation,
            range_silence_s=math.inf
            if self._ranges.failure
            else heard_until_s - self._range_seen_s,
            stalled_s=stalled_s,
            link_silence_s=heard_until_s - answer.received_s,
            link_failed=self._link.failure is not None,
            mcu_fault=bool(status.faults) or not status.armed,
            recorder_failed=self._recorder is not None and self._recorder.error is not None,
            stop_asked=self.stop_asked,
            range_jump_m=estimate.jumped_m if self._flies else 0.0,
            range_frozen_s=signs.range_frozen_s,
            range_frozen_limit_s=self._sign_reader.frozen_limit_s,
            not_lifting_s=signs.not_lifting_s,
            thrust_share=signs.thrust_share,
            battery_gone_s=signs.battery_gone_s,
            z_m=estimate.z_m,
            x_m=estimate.x_m,
        )
        self._safety = safety.watch(self._safety, found, self._rig.limits)

    def _control(
        self, aim: Reference, t_s: float, prediction: Prediction
    ) -> tuple[Reference, Command, Terms]:
        mode = self._safety.mode
        usable_n = prediction.force_n if mode is Mode.RUNNING else None
        self._gate = safety.gate(self._gate, usable_n)
        # Without a share in the command the estimator must expect any wake, hence None.
        feedforward_n = -self._gate.share * self._gate.force_n if self._gate.share else None
        nothing_flies = self._plan.motors_off or self._safety.failed_in is Mode.ARMED
        if mode is Mode.FAILSAFE and not nothing_flies:
            return self._come_down(t_s, feedforward_n)
        if mode in (Mode.ARMED, Mode.FAILSAFE):
            self._finished |= mode is Mode.FAILSAFE
            self._state, command, terms = self._pilot.rest(self._state)
        elif self._plan.motors_off:
            self._state, command, terms = self._pilot.drive(self._state, aim)
        else:
            self._state, command, terms = self._pilot.control(self._state, aim, feedforward_n)
        return aim, command, terms

    def _come_down(
        self, t_s: float, feedforward_n: float | None
    ) -> tuple[Reference, Command, Terms]:
        """The source idles at once; the sufferer descends, under control while it can be seen."""
        rig, descent = self._rig, self._began_descent(t_s)
        aim = safety.descent_reference(descent, t_s, rig.limits.pulse_us[0])
        if safety.has_landed(descent, t_s, self._state.estimate.z_m, rig.limits):
            self._finished = True
            self._state, command, terms = self._pilot.rest(self._state)
        elif descent.height_known:
            self._state, command, terms = self._pilot.control(self._state, aim, feedforward_n)
        else:
            pulse_us = safety.open_loop_pulse(descent, t_s, rig.limits)
            command, terms = Command(aim.source_us, pulse_us, 0.0), Terms(0.0, 0.0, 0.0, 0.0)
            self._state = replace(self._state, last_us=pulse_us, before_last_us=self._state.last_us)
        return aim, command, terms

    def _began_descent(self, t_s: float) -> safety.Descent:
        """The way down, begun anew when the height gets lost on it."""
        known = safety.BLINDING.isdisjoint(self._safety.faults) and math.isfinite(
            self._state.estimate.z_m
        )
        before = self._descent
        if before is None or (before.height_known and not known):
            now = self._state
            self._descent = safety.Descent(
                t_s, now.estimate.z_m, now.estimate.x_m, now.last_us, known
            )
        assert self._descent is not None
        return self._descent

    def _write(self, command: Command) -> None:
        most = self._limits.max_speed_steps_per_s
        steps = round(command.carriage_mps * self._rig.stepper.steps_per_m)
        steps = min(max(steps, -most), most)
        blind = blind_pulses(self._rig)
        self._link.send(WireCommand(command.source_us, command.sufferer_us, steps, *blind))

    def _reported(self, reading: RangeReading, answer: Answer, prediction: Prediction) -> Row:
        """What board and sensor told, for the log; a status is logged with its round trip once."""
        status = answer.status
        fresh = status.sequence != self._last_sequence
        self._last_sequence = status.sequence
        return {
            "force_pred_n": prediction.logged_n,
            "source_applied_us": status.source_us,
            "sufferer_applied_us": status.sufferer_us,
            "seq_echo": status.sequence,
            "round_trip_s": _or_none(answer.round_trip_s) if fresh else None,
            "applied_time_s": applied_s(answer) - self._origin_s,
            "homed": int(status.homed),
            "battery_v": status.battery_mv / 1000.0 if status.battery_mv else None,
            "mode": self._safety.mode.value,
            "faults": "+".join(self._safety.faults),
            "true_wake_force_n": _or_none(reading.true_wake_force_n),
            "true_hook_force_n": _or_none(reading.true_hook_force_n),
            "true_z_m": _or_none(reading.true_z_m),
        }

    def _record(self, row: Row, tick: Tick) -> None:
        overran = self._clock.monotonic() > tick.start_s + PERIOD_S
        if overran:
            row["faults"] = "+".join(filter(None, (str(row["faults"]), "overrun")))
        if self._recorder is not None:
            # What only some rigs know is no column of the others' logs, rather than an empty one.
            self._recorder.put({name: value for name, value in row.items() if value is not None})
        self.tally.add(row, tick.late_s, tick.skipped, overran=overran)


def arm_limits(rig: Rig, motors_off: bool = False) -> Arm:
    """The rig's limits as the MCU takes them; with `motors_off` nothing turns a motor.

    The MCU refuses an empty range of pulses; a microsecond above idle no ESC starts.
    """
    limits, stepper = rig.limits, rig.stepper
    idle_us, full_us = limits.pulse_us
    return Arm(
        idle_us,
        idle_us + 1.0 if motors_off else full_us,
        round(limits.slew_us_per_s),
        round(1000.0 * limits.source_descent_s),
        round(1000.0 * limits.sufferer_descent_s),
        round(stepper.max_speed_mps * stepper.steps_per_m),
        round(stepper.max_accel_mps2 * stepper.steps_per_m),
        round(1000.0 * limits.brake_s),
        round(1000.0 * limits.sink_s),
        round(limits.sink_rate_us_per_s),
    )


def applied_s(answer: Answer) -> float:
    """When the newest pulses reached the pins [s, monotonic], late by the answer's own way."""
    ago_us = (answer.mcu_time_us - answer.status.applied_time_us) % TIME_WRAP_US
    return answer.received_s - ago_us * 1e-6


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
