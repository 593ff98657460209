"""When the ESCs take a pulse: the servo frames of one flight.

In: a run log and the rig. Out: the frames as the rig file has them, with the phase that the log's
`applied_time_s` shows, and the frames that the log itself shows where they differ.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects.chain import Chain

FloatArray = npt.NDArray[np.float64]

_FEWEST = 20  # different times of frames; fewer say nothing
_COHERENT = 0.7  # of the unit circle's radius, from which times lie on a grid
_SHORTEST_S, _LONGEST_S, _RATIO = 0.005, 0.1, 1.003  # periods tried
_FITS = 0.005  # how far a period may be from the one whose frames were counted
_SCATTER = 0.1  # of a period, 1 sd
_CLEARLY = 1.3  # times less of its own length than the times scatter about any other period
_EXPECTED = 0.9  # of the ticks see as many new frames as fit between two ticks
_SEEN = 0.01  # of the ticks see one frame fewer than the others: half the period would show as two
_NO_AGE_S = 0.001  # no frames are always this near to the ticks unless they keep step with them
_OTHER_CLOCK_S = 0.5  # a pulse applied so long before or after is not on the ticks' clock
_COARSE_S = 0.005
_EXACT_S = 2e-5  # what a number of 32 bits leaves of a time within minutes
_ROUNDED = 0.95  # of the unit circle's radius, from which ticks lie on the same grid
_SAME = 0.05  # a period farther off is another one, not a board's clock


@dataclass(frozen=True, eq=False)
class Frames:
    """Times [s] at which the ESCs take a pulse over a flight.

    `stated_s` (F,) are the rig file's; `reported_s` (G,) are the log's if that shows another
    period, else None. `doubt` is what had to be assumed, or "".
    """

    stated_s: FloatArray
    reported_s: FloatArray | None = None
    doubt: str = ""


def frames_of(log: RunLog, rig: Rig, grid_s: FloatArray) -> Frames:
    """The servo frames over the flight's grid (N,)."""
    stated_s = rig.disturbance.esc_frame_s
    seen_s, applied_s = _times_of_frames(log)
    phase_s = _phase_s(applied_s, stated_s)
    told_s = reported_period_s(seen_s, applied_s)
    if told_s is None or (phase_s is not None and told_s < 1.5 * stated_s):
        return _by_rig_file(stated_s, phase_s, grid_s, applied_s)
    told_phase_s = _phase_s(applied_s, told_s)
    if told_phase_s is None:
        return _by_rig_file(stated_s, phase_s, grid_s, applied_s)
    reported_s = _grid(told_s, told_phase_s, grid_s)
    if abs(told_s - stated_s) < _SAME * stated_s:  # the board's clock: the same frame, not twice
        return Frames(reported_s)
    stated = _by_rig_file(stated_s, None, grid_s, applied_s).stated_s
    return Frames(stated, reported_s, _contradiction(told_s, rig))


def period_s(frames_s: FloatArray) -> float:
    """The period [s] of frames at regular times (F,)."""
    return float((frames_s[-1] - frames_s[0]) / (len(frames_s) - 1))


def reported_period_s(seen_s: FloatArray, applied_s: FloatArray) -> float | None:
    """The servo frames' period [s] from the time of the newest frame (n,), seen at n ticks.

    None if the times leave it open. They are multiples of the period apart, but also of its half
    and, with some scatter, of others: between two ticks as many frames begin as fit there, or one
    more. The one of these periods is taken on whose grid the times scatter least, if that is clear
    and both counts were seen: otherwise half of it might be the period. Times that are rounded
    coarsely, or as the ticks' own are, lie on the grid of the rounding.
    """
    if len(applied_s) <= _FEWEST or _coarse(applied_s):
        return None
    periods_s = np.geomspace(
        _SHORTEST_S, _LONGEST_S, 1 + round(np.log(_LONGEST_S / _SHORTEST_S) / np.log(_RATIO))
    )[:, None]
    new = np.rint(np.diff(applied_s) / periods_s)
    fit_in = np.floor(float(np.median(np.diff(seen_s))) / periods_s)
    fewer, more = (new == fit_in).mean(axis=1), (new == fit_in + 1).mean(axis=1)
    possible = fewer + more > _EXPECTED
    if not possible.any():
        return None
    both_seen = np.minimum(fewer, more)[possible] > _SEEN
    periods_s, count = periods_s[possible, 0], np.cumsum(new[possible], axis=1)
    count -= count.mean(axis=1, keepdims=True)
    times_s = applied_s[1:] - applied_s[1:].mean()
    fitted_s = (count * times_s).sum(axis=1) / np.maximum((count**2).sum(axis=1), 1.0)
    scatter_s = (times_s - fitted_s[:, None] * count).std(axis=1)
    fits = np.abs(fitted_s - periods_s) < _FITS * periods_s
    scatter = np.where(fits, scatter_s / periods_s, np.inf)
    best = int(scatter.argmin())
    others = np.abs(fitted_s - fitted_s[best]) > 2.0 * _FITS * fitted_s[best]
    rival = float(scatter[others].min(initial=np.inf))
    if not both_seen[best] or scatter[best] > min(_SCATTER, rival / _CLEARLY):
        return None
    rounded = abs(np.exp(2j * np.pi * seen_s / fitted_s[best]).mean()) > _ROUNDED
    return None if rounded else float(fitted_s[best])


def _times_of_frames(log: RunLog) -> tuple[FloatArray, FloatArray]:
    """Ticks (n,) and the times at which the pulse seen at each was applied; empty without any.

    A column may copy the ticks: this one's time, that of a command which is only then sent, or that
    of the tick before. It would look like frames that keep step with the loop; times of another
    clock would look like frames of any phase.
    """
    known = np.isfinite(log["applied_time_s"]) & (log["applied_time_s"] > 0.0)
    seen_s = np.asarray(log["t_s"][known], float)
    applied_s = np.asarray(log["applied_time_s"][known], float)
    age_s = seen_s - applied_s
    is_this, is_last = age_s < _NO_AGE_S, np.abs(age_s[1:] - np.diff(seen_s)) < _NO_AGE_S
    copies = max(float(marks.mean()) for marks in (is_this, is_last)) if len(seen_s) > 1 else 1.0
    if copies > _EXPECTED or float(np.median(np.abs(age_s))) > _OTHER_CLOCK_S:
        return np.zeros(0), np.zeros(0)
    return seen_s, applied_s


def _by_rig_file(
    frame_s: float, phase_s: float | None, grid_s: FloatArray, applied_s: FloatArray
) -> Frames:
    if frame_s <= 0.0:
        return Frames(grid_s.copy())
    if phase_s is not None:
        rounded = (
            "applied_time_s has multiples of 5 ms only: if they are rounded, a latency is "
            "uncertain by as much"
        )
        return Frames(_grid(frame_s, phase_s, grid_s), doubt=rounded if _coarse(applied_s) else "")
    return Frames(
        _grid(frame_s, 0.5 * frame_s, grid_s),
        doubt="applied_time_s does not tell when the ESCs take a pulse: the middle of the servo "
        "frame is assumed, and a latency is uncertain by half a frame",
    )


def _coarse(applied_s: FloatArray) -> bool:
    """Whether the times (n,) look rounded to 5 ms or to hundredths of a second."""
    off_s = applied_s - _COARSE_S * np.rint(applied_s / _COARSE_S)
    return bool((np.abs(off_s) < _EXACT_S).all())


def _phase_s(applied_s: FloatArray, frame_s: float) -> float | None:
    """When within a servo frame [s] the ESCs take a pulse; None if the times leave it open."""
    if len(np.unique(applied_s)) <= _FEWEST or frame_s <= 0.0:
        return None
    turn = np.exp(2j * np.pi * applied_s / frame_s).mean()
    if abs(turn) <= _COHERENT:
        return None
    return float(np.angle(turn) / (2 * np.pi) * frame_s)


def _grid(frame_s: float, phase_s: float, grid_s: FloatArray) -> FloatArray:
    first = np.floor((grid_s[0] - phase_s) / frame_s)
    count = int((grid_s[-1] - grid_s[0]) / frame_s) + 2
    return np.asarray(phase_s + frame_s * (first + np.arange(count)))


def _contradiction(told_s: float, rig: Rig) -> str:
    """What the log says against the rig file, its effects included; "" if they agree."""
    believed_s = Chain.of(rig).constants(constants_of(rig))["disturbance.esc_frame_s"]
    if abs(told_s - believed_s) < _SAME * told_s:
        return ""
    return (
        f"applied_time_s says that pulses were applied every {1e3 * told_s:.3g} ms, the rig file "
        f"every {1e3 * believed_s:.3g}: esc_frame_s under [disturbance] should be {told_s:.3g}, or "
        "an effect esc-frame say so"
    )
