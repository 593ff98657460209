"""How a run ended, as one sentence: what happened, and what a person can do about it."""

from typing import TYPE_CHECKING

from runtime.io.board import last_reset
from runtime.io.conversation import Conversation
from runtime.io.range_source import RangeSource
from runtime.loop.loop import Loop
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.failsafes import BY_THE_COMPUTER, LATE_GANTRY, hints

if TYPE_CHECKING:
    from runtime.io.recorder import RecorderReport


def recording_sentence(report: "RecorderReport | None") -> str:
    """What is wrong with a recording that is not whole; "" if it is."""
    if report and report.error:
        return f"{report.error}; {report.written} ticks are in the log, {report.dropped} are not."
    if report and report.dropped:
        return (
            f"{report.dropped} of {report.dropped + report.written} ticks were not recorded: the "
            "disk is too slow; record to another one."
        )
    return ""


def judge(
    loop: Loop,
    link: Conversation,
    ranges: RangeSource,
    recording: str,
    *,
    is_virtual: bool,
    is_realtime: bool,
) -> None:
    """CheckFailed naming what ended the flight, what to do about it, and what is not recorded.

    KeyboardInterrupt after a stop by hand; nothing after a whole flight.
    """
    cause = loop.failsafe_cause
    if recording and (not cause or cause[0] in ("recorder_failed", "operator_stop")):
        raise CheckFailed(recording)
    # What else was found in the same tick comes first: a unit bound to the port is also ordered to
    # stop when the cable is pulled.
    if cause[:1] == ("operator_stop",):
        raise KeyboardInterrupt
    if cause:
        why = _why(loop, link, ranges, is_virtual=is_virtual, is_realtime=is_realtime)
        if reset := last_reset(loop.last_reset):
            why += f"; its last reset: {reset}"
        sentence = f"The flight ended in a failsafe ({'+'.join(cause)}): {why}"
        raise CheckFailed(f"{sentence}. {recording}" if recording else sentence)


def _why(
    loop: Loop, link: Conversation, ranges: RangeSource, *, is_virtual: bool, is_realtime: bool
) -> str:
    """A port that is gone explains the rest, then a sensor that says why it stopped."""
    cause = loop.failsafe_cause
    if link.failure is not None:
        return link.failure
    if "sensor_lost" in cause and ranges.failure is not None:
        return ranges.failure
    pause = loop.tally.pause
    gantry = loop.tally.gantry_pause
    if cause[0] in BY_THE_COMPUTER and gantry is not None:
        return f"{LATE_GANTRY}; it stood still for {gantry.length_s:.2f} s at {gantry.at_s:.1f} s"
    if cause[0] in BY_THE_COMPUTER and pause is not None:
        stood = f"this computer stood still for {pause.milliseconds} ms at {pause.at_s:.1f} s"
        return f"{stood}: {_relief(is_virtual=is_virtual, is_realtime=is_realtime)}"
    if cause[0] == "link_lost" and is_virtual:
        return LATE_GANTRY
    return hints(is_virtual=is_virtual)[cause[0]]


def _relief(*, is_virtual: bool, is_realtime: bool) -> str:
    """What helps a loop that the computer holds up."""
    if is_virtual:
        return "fly without --wall-clock, in simulated time, or end what else runs on it"
    if is_realtime:
        return "end what else runs on it; `wakedeploy bench latency` shows when it is quiet enough"
    return "end what else runs on it, and give it SCHED_FIFO (`wakedeploy doctor` says how)"
