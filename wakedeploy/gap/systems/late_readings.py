"""Readings that count later than they were taken, as a system's samples are farther apart.

In: a system and a recording, or a `LogModel`. Out: the recording from a row on at which readings
count in time, and sentences. A log finer than `rate_hz` gives each sample its newest reading; a
sensor that is read between two samples is late by the rest, which looks like a lag of that sensor.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.system import StateSpace

_MOST_ROWS = 20  # of a sample at which a sensor that keeps time is read
_LATE = 0.05  # of a system's sample, from which on a mean lateness is said


def in_time(system: StateSpace, recording: Recording) -> Recording:
    """The recording without its first rows, where its readings then count sooner."""
    names = [o.name for o in system.outputs if o.name in recording.columns]
    late_s = {
        row: sum(float(_lateness_s(recording, name, system.rate_hz, row).sum()) for name in names)
        for row in _begins(recording, names, system.rate_hz)
    }
    begin = min(late_s, key=late_s.__getitem__)
    if begin == 0:
        return recording
    columns = {name: values[begin:] for name, values in recording.columns.items()}
    return replace(recording, time_s=recording.time_s[begin:], columns=columns)


def _begins(recording: Recording, names: Sequence[str], rate_hz: float) -> list[int]:
    """The rows that a system's first sample may have: 0, and those of slow sensors that keep time.

    A sensor whose clock is another is read at all rows of a sample by turns.
    """
    every, rows = _rows(recording, rate_hz), {0}
    for name in names:
        at = np.flatnonzero(np.isfinite(np.asarray(recording.columns[name], dtype=np.float64)))
        found = np.unique(at % every)
        rows |= set(found.tolist()) if len(found) <= _MOST_ROWS and len(found) < every else set()
    return sorted(rows)


def late_readings(model: LogModel) -> list[str]:
    """Outputs whose readings count late, by how much, and what takes them in time."""
    system, notes = model.system, []
    for output in system.outputs:
        each_s = [_lateness_s(r, output.name, system.rate_hz) for r in model.recordings]
        late_s = float(np.concatenate(each_s).mean())
        if late_s * system.rate_hz > _LATE:
            notes.append(
                f"output {output.name}: its readings count {1e3 * late_s:.3g} ms late on average, "
                f"at the next sample of {system.name}, which has one each "
                f"{1e3 / system.rate_hz:.3g} ms. A lag or a delay of its sensor may be no more "
                "than that. With a higher `rate_hz` of the system they count sooner."
            )
    return notes


def _rows(recording: Recording, rate_hz: float) -> int:
    """The rows of a recording for each sample of a system of this rate."""
    return max(round(recording.rate_hz / rate_hz), 1)


def _lateness_s(recording: Recording, name: str, rate_hz: float, begin: int = 0) -> FloatArray:
    """By how much each reading that counts is late [s]: of several at one sample, the newest.

    The system's first sample is at the row `begin`.
    """
    every = _rows(recording, rate_hz)
    column = np.asarray(recording.columns[name], dtype=np.float64)[begin:]
    at = np.flatnonzero(np.isfinite(column[: len(column) // every * every]))
    sample = -(-at // every)
    is_newest = np.append(np.diff(sample) > 0, True)[: len(at)]
    return np.asarray((sample * every - at)[is_newest] / recording.rate_hz)
