"""What the loop may do in which state: one transition table and the pure steps around it.

In: what one tick found (late prediction, silent link, height …). Out: the mode, the faults by name,
how much of the feedforward to use, and the way down after a failsafe.
"""

import enum
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from runtime.loop.copies import replace
from wakedeploy.core.rig import LOOP_RATE_HZ
from wakedeploy.core.rig_sections import Limits

LATE_LIMIT = 3  # late predictions, or late answers, in a row that degrade the mode
CLEAN_TICKS = round(LOOP_RATE_HZ)  # a clean second brings it back
SENSOR_LOST_S = 0.25  # without a new range sample
SAMPLE_OLD_S = 0.15  # an older sample is as good as none: the motion since then is a guess
# Since an unanswered command was sent. The MCU's own deadman begins its descent after four periods
# without commands; if only answers are lost, it hears every command, and the loop flies on by PID
# alone for a while.
ANSWERS_MISSING_S = 0.125
LINK_LOST_S = 0.5
STALLED_S = 0.125  # between two ticks: the MCU's deadman has begun its descent meanwhile
# Time beyond the rig file's round trip: an answer this late means commands that act late.
LATE_ANSWER_S = 0.02  # the feedforward is for another moment then: PID alone
LATE_COMMAND_S = 0.03  # this late for a quarter of a second, PID itself is no longer stable
LATE_COMMANDS = 8

# The same reading again and again in the air. A VL53L0X's noise, 3 to 6 mm at 1 mm resolution,
# gives the same twice in 7 to 10 % of readings, and never 24 times in a row. A sensor that holds
# each reading for up to 0.15 s, as some do, says at least five different things in that time.
RANGE_FROZEN_S = 0.75
# Five samples in a row, the first one included, are this far from where the sufferer can be. A fall
# that the filter does not know of ends 5 cm away after a tenth of a second, and goes on from there.
# Something has come into the beam; a controller that believes it pushes the sufferer onto a stop.
RANGE_JUMP_M = 0.1
REPEATED_S = 0.1  # the same for longer: the sensor froze, and the sufferer has moved
# On the stop while the commands should give 1.5 times the weight. That lifts within 0.15 s at
# 5 m/s², even if the rig file's thrust curve is a third too strong. Only a wake of more than half
# the weight holds it down: 1.5 times the default one, gusts of 6 N, did so for 0.6 s.
NOT_LIFTING_S = 1.0
# A force that swings this much is no force: the loop swings, because a sensor's stamps lie or
# pulses act late. Healthy flights stay below 0.8 N, with wakes three times as strong as in the rig
# file.
UNEXPLAINED_SD_N, UNEXPLAINED_S = 2.0, 0.5
# Log likelihood that readings are late. Of eighty flights with wakes up to three times as strong,
# none by PID alone comes to 9, and one with a package comes to 10.5: its feedforward can look like
# a late reading. So the feedforward is dropped first, and the flight ends only if that does not
# help.
RANGE_DOUBTED, RANGE_LATE = 9.0, 12.0
# Late readings make the loop swing; a thrust or a wake off its model looks like them without that.
SWINGING_SD_N, CALM_SHARE = 0.8, 0.75
RANGE_SUSPECTED = 6.0  # enough if the loop swings already
# With a thrust of less than two fifths of its weight, a sufferer in the air is this much faster a
# quarter of a second later. One that hardly moves then stands on something: mostly on the stop.
HELD_SHARE, HELD_UP_MPS, HELD_MPS = 0.4, 1.5, 0.4
# Below the lower z limit while the commands should give more than the weight: only a fall ends
# there (the filter runs on past the stop). 10 % are for errors of the thrust curve and the weight.
FELL_SHARE = 1.1
# The battery has fallen far below its voltage at arming. The UNO looks every 0.1 s, and a bad
# contact is over within two looks.
BATTERY_LOST_S = 0.25
FAR_OUTSIDE = 0.5  # of a channel's trained range, beyond either end
GATE_TICKS = 4  # the feedforward is slewed to zero and back over this
# Of the weight, either way: the most that is fed forward. No wake to be flown in pushes harder.
MOST_FEEDFORWARD = 1.0


class Mode(enum.StrEnum):
    """The state of a run."""

    DISARMED = "DISARMED"
    ARMED = "ARMED"
    RUNNING = "RUNNING"
    DEGRADED = "DEGRADED"
    LANDING = "LANDING"
    FAILSAFE = "FAILSAFE"


class Event(enum.Enum):
    """What can change the mode."""

    ARM = enum.auto()  # the MCU accepted the limits and switched its outputs on
    START = enum.auto()  # the rest before the flight is over
    TROUBLE = enum.auto()  # predictions cannot be used: PID alone
    RECOVERED = enum.auto()  # a clean second
    LAND = enum.auto()  # the plan is over: the touch-down begins
    FINISH = enum.auto()  # the sufferer stands: motors idle
    FAULT = enum.auto()  # flying on is not safe
    DISARM = enum.auto()  # outputs off; the only way out of a failsafe


TRANSITIONS: dict[tuple[Mode, Event], Mode] = {
    (Mode.DISARMED, Event.ARM): Mode.ARMED,
    (Mode.ARMED, Event.START): Mode.RUNNING,
    (Mode.ARMED, Event.FAULT): Mode.FAILSAFE,
    (Mode.ARMED, Event.DISARM): Mode.DISARMED,
    (Mode.RUNNING, Event.TROUBLE): Mode.DEGRADED,
    (Mode.RUNNING, Event.LAND): Mode.LANDING,
    (Mode.RUNNING, Event.FINISH): Mode.ARMED,
    (Mode.RUNNING, Event.FAULT): Mode.FAILSAFE,
    (Mode.RUNNING, Event.DISARM): Mode.DISARMED,
    (Mode.DEGRADED, Event.RECOVERED): Mode.RUNNING,
    (Mode.DEGRADED, Event.LAND): Mode.LANDING,
    (Mode.DEGRADED, Event.FINISH): Mode.ARMED,
    (Mode.DEGRADED, Event.FAULT): Mode.FAILSAFE,
    (Mode.DEGRADED, Event.DISARM): Mode.DISARMED,
    (Mode.LANDING, Event.FINISH): Mode.ARMED,
    (Mode.LANDING, Event.FAULT): Mode.FAILSAFE,
    (Mode.LANDING, Event.DISARM): Mode.DISARMED,
    (Mode.FAILSAFE, Event.DISARM): Mode.DISARMED,
}


def next_mode(mode: Mode, event: Event) -> Mode:
    """The mode after an event; an event that the table does not list changes nothing."""
    return TRANSITIONS.get((mode, event), mode)


@dataclass(frozen=True, slots=True)
class Findings:
    """What one tick found out. Positions in m, times in s."""

    late: bool = False  # the prediction did not arrive in time
    bad_prediction: bool = False  # not finite, or more than any wake
    doubted: bool = False  # predictions explain the force worse than none would
    bad_observation: bool = False  # not finite, or far outside the trained range
    bad_range: bool = False  # a sample that no sensor of this rig can mean
    range_silence_s: float = 0.0  # since the last new range sample that can be believed
    link_silence_s: float = 0.0  # since the oldest command without an answer
    late_answers: int = 0  # in a row, by more than LATE_ANSWER_S
    late_commands: int = 0  # the same, by more than LATE_COMMAND_S
    tick_failed: bool = False  # by an error of the program
    stalled_s: float = 0.0  # since the tick before
    link_failed: bool = False
    mcu_fault: bool = False
    recorder_failed: bool = False
    stop_asked: bool = False  # by the operator
    range_jump_m: float = 0.0  # the least error of five samples in a row
    is_noisy: bool = False  # too much of what the sensor says is noise or makes no sense
    held_up_mps: float = 0.0  # speed that gravity should have taken, in the air by the sensor
    range_frozen_s: float = 0.0  # since the range sensor began to say the same in the air
    range_frozen_limit_s: float = RANGE_FROZEN_S  # longer for a sensor of little noise
    moves_unseen: bool = False  # in the air, while the range sensor says the very same
    not_lifting_s: float = 0.0  # on the stop with a thrust that should lift
    rises_unseen: bool = False  # the commands should have lifted it, and the sensor denies it
    unexplained_s: float = 0.0  # since a force began to swing that nothing explains
    range_late: float = 0.0  # evidence that readings are older than their stamps say
    thrust_share: float = 0.0  # what the commands should give by now, over the weight
    battery_gone_s: float = 0.0  # since a battery that was measured went missing
    z_m: float = 0.0
    x_m: float = 0.0


@dataclass(frozen=True, slots=True)
class SafetyState:
    """Mode and counters between ticks; `faults` are this tick's, `cause` are the failsafe's.

    `failed_in` is the mode that the failsafe began in.
    """

    mode: Mode = Mode.DISARMED
    late_in_a_row: int = 0
    clean_ticks: int = 0
    faults: tuple[str, ...] = ()
    cause: tuple[str, ...] = ()
    failed_in: Mode | None = None


def happened(state: SafetyState, event: Event) -> SafetyState:
    """The state after an event that the loop itself brings about."""
    mode = next_mode(state.mode, event)
    return state if mode is state.mode else replace(state, mode=mode)


def watch(state: SafetyState, found: Findings, limits: Limits) -> SafetyState:
    """One tick of supervision: faults first, then the predictor's health."""
    fatal, troubles = fatal_faults(found, limits), lesser_troubles(found)
    late = state.late_in_a_row + 1 if found.late else 0
    clean = 0 if troubles else state.clean_ticks + 1
    cause = fatal if fatal and state.mode is not Mode.FAILSAFE else state.cause
    counted = replace(
        state, late_in_a_row=late, clean_ticks=clean, faults=fatal + troubles, cause=cause
    )
    if fatal:
        failed_in = state.failed_in if state.mode is Mode.FAILSAFE else state.mode
        return happened(replace(counted, failed_in=failed_in), Event.FAULT)
    if late >= LATE_LIMIT or set(troubles) & _DEGRADING:
        return happened(counted, Event.TROUBLE)
    return happened(counted, Event.RECOVERED) if clean >= CLEAN_TICKS else counted


def fatal_faults(found: Findings, limits: Limits) -> tuple[str, ...]:
    """Names of the faults that end a flight; those that explain others come first."""
    fell = found.z_m < limits.z_m[0] and found.thrust_share > FELL_SHARE
    stands = found.not_lifting_s > NOT_LIFTING_S or found.rises_unseen
    lost_thrust = fell or stands
    # A board that restarts answers nothing, and its motors stop.
    is_mute = lost_thrust and found.link_silence_s > ANSWERS_MISSING_S
    named = {
        "loop_error": found.tick_failed,
        "loop_stalled": found.stalled_s > STALLED_S and not found.link_failed,
        "link_lost": found.link_failed or found.link_silence_s > LINK_LOST_S or is_mute,
        "commands_late": found.late_commands >= LATE_COMMANDS,
        "battery_lost": found.battery_gone_s > BATTERY_LOST_S,
        "sensor_lost": found.range_silence_s > SENSOR_LOST_S,
        "sensor_frozen": found.range_frozen_s > found.range_frozen_limit_s or found.moves_unseen,
        "sensor_jump": found.range_jump_m > RANGE_JUMP_M and found.range_frozen_s < REPEATED_S,
        "sensor_noisy": found.is_noisy,
        "height_impossible": found.held_up_mps > HELD_UP_MPS,
        "thrust_lost": lost_thrust,
        "range_late": found.range_late > RANGE_LATE,
        "motion_unexplained": found.unexplained_s > UNEXPLAINED_S,
        "mcu_fault": found.mcu_fault,
        "recorder_failed": found.recorder_failed,
        "operator_stop": found.stop_asked,
        "x_limit": not limits.x_m[0] <= found.x_m <= limits.x_m[1],
        "z_limit": not limits.z_m[0] <= found.z_m <= limits.z_m[1] and not fell,
    }
    return tuple(name for name, true in named.items() if true)


def doubts_the_range(state: SafetyState, found: Findings) -> bool:
    """Whether a filter that believes in late readings is to fly the way down."""
    swings = "motion_unexplained" in state.cause and found.range_late > RANGE_SUSPECTED
    return swings or "range_late" in state.cause


def lesser_troubles(found: Findings) -> tuple[str, ...]:
    """Names of the troubles that a flight goes on with, mostly by PID alone."""
    named = {
        "late_prediction": found.late,
        "bad_prediction": found.bad_prediction,
        "bad_observation": found.bad_observation,
        "prediction_doubted": found.doubted,
        "range_doubted": found.range_late > RANGE_DOUBTED,
        "answers_missing": found.link_silence_s > ANSWERS_MISSING_S,
        "answers_late": found.late_answers >= LATE_LIMIT,
        "bad_range": found.bad_range,
    }
    return tuple(name for name, true in named.items() if true)


_DEGRADING = frozenset(
    {
        "bad_prediction",
        "bad_observation",
        "prediction_doubted",
        "range_doubted",
        "answers_missing",
        "answers_late",
    }
)


def far_outside(
    observation: npt.NDArray[np.float32],
    low: npt.NDArray[np.float32],
    high: npt.NDArray[np.float32],
) -> bool:
    """Whether an observation (d,) is not finite or far outside the trained range, low to high.

    Each tick is judged alone and costs the feedforward, so the margin is wide: half the range.
    `predict` in Python only warns, about many values together, and starts at a quarter
    (`wakedeploy.core.observations.out_of_range`).
    """
    ranges = zip(observation.tolist(), low.tolist(), high.tolist(), strict=True)
    return not all(
        least - FAR_OUTSIDE * (most - least) <= value <= most + FAR_OUTSIDE * (most - least)
        for value, least, most in ranges
    )


@dataclass(frozen=True, slots=True)
class Gate:
    """How much of the feedforward passes, and the force [N] it last let through."""

    share: float = 0.0
    force_n: float = 0.0


def gate(before: Gate, force_n: float | None) -> Gate:
    """Open towards a usable force; without one, close on the last. Neither happens in one jump."""
    if force_n is None:
        return Gate(max(0.0, before.share - 1.0 / GATE_TICKS), before.force_n)
    return Gate(min(1.0, before.share + 1.0 / GATE_TICKS), force_n)
