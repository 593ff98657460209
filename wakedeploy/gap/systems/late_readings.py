"""Readings that count later than they were taken, as a system's samples are farther apart.

In: a `LogModel`. Out: sentences. A log finer than `rate_hz` gives each sample its newest reading; a
sensor that is read between two samples is late by the rest, which looks like a lag of that sensor.
"""

import numpy as np

from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.logs import LogModel

_LATE = 0.05  # of a system's sample, from which on a mean lateness is said


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


def _lateness_s(recording: Recording, name: str, rate_hz: float) -> FloatArray:
    """By how much each reading that counts is late [s]: of several at one sample, the newest."""
    every = max(round(recording.rate_hz / rate_hz), 1)
    column = np.asarray(recording.columns[name], dtype=np.float64)
    at = np.flatnonzero(np.isfinite(column[: len(column) // every * every]))
    sample = -(-at // every)
    is_newest = np.append(np.diff(sample) > 0, True)[: len(at)]
    return np.asarray((sample * every - at)[is_newest] / recording.rate_hz)
