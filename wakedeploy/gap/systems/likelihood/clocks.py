"""Faults of a log's clocks and stamps that look like an effect: inputs or outputs that are late.

In: a `LogModel` and a fit. Out: inputs that come later than the outputs that they drive, which no
effect does, and delays that may be rows of a log. A search that is run all the same names the
effect that comes nearest.
"""

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.core.recording import Recording
from wakedeploy.core.units import same_unit
from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.systems.likelihood.blocks import Log
from wakedeploy.gap.systems.likelihood.filter import Filter
from wakedeploy.gap.systems.system import StateSpace

if TYPE_CHECKING:
    from wakedeploy.gap.systems.likelihood.logs import LogModel

_FEWEST, _MOST = 2, 64  # samples that an input may be late; one depends on how logs are stamped
_NEAR = (1, 2, 4)  # samples that are always tried, and how many more that errors point at
_LIKELY = 3
_EARLIER, _LATER = 1, -1
_TOGETHER = 0.5  # correlation of inputs, or of their changes, that follow one controller
_ONE_ROW = 0.2  # of a sample: a delay this near to one sample counts as one row


def shared_clocks(system: StateSpace, recordings: Sequence[Recording]) -> dict[str, str]:
    """By input the first that the logs stamp together with it, where that is another.

    The commands of one row are, and so are its measured inputs, which come by another way.
    """
    first: dict[tuple[bool, tuple[str, ...]], str] = {}
    shared = {}
    for stated in system.logged:
        clocks = tuple(r.clocks.get(stated.name, "") for r in recordings)
        leader = first.setdefault((stated.is_commanded, clocks), stated.name)
        if leader != stated.name:
            shared[stated.name] = leader
    return shared


def late_inputs(model: "LogModel", base: Fit, found: Fit | None = None) -> dict[str, float]:
    """How late each input is [s], by name; inputs on time are left out.

    If something is missing, as drag, outputs may lead what the base expects. If effects `found`
    explain more than a shift of the input does, the shift is sought again on top of them. Inputs
    that a controller moves together, as the thrusts of four rotors, are of one clock: alone, one
    of them would come earlier only to bend their sum. Outputs that never change lead nothing.
    """
    late: dict[str, float] = {}
    if not model.has_motion:
        return late
    for places in _moving_together(model):
        samples = _late_by(model, base, places)
        if samples and found is not None and found.hypothesis:
            earlier = _refitted(model, base, places, samples)
            if found.objective > earlier + RULES.late_nats:
                samples = _late_by(model, found, places)
        if samples:
            late |= {model.system.inputs[i].name: samples * model.dt_s for i in places}
    return late


def _moving_together(model: "LogModel") -> list[list[int]]:
    """The inputs' places in groups: those of one unit that change with or against one another."""
    rows = np.hstack([log.inputs for log in model.logs])
    alike = np.maximum(_correlations(rows), _correlations(np.diff(rows))) > _TOGETHER
    inputs, groups = model.system.inputs, list[list[int]]()
    for i, stated in enumerate(inputs):
        if stated.law is not None:
            continue
        known = [
            g for g in groups if alike[i, g].any() and same_unit(inputs[g[0]].unit, stated.unit)
        ]
        if known:
            known[0].append(i)
        else:
            groups.append([i])
    return groups


def _correlations(rows: FloatArray) -> FloatArray:
    """How much rows (i, n) follow one another, (i, i) from 0 to 1; 0 for one that never changes."""
    apart = rows - rows.mean(1, keepdims=True)
    size = np.sqrt((apart**2).sum(1))
    size = np.where(size > 0.0, size, np.inf)
    return np.asarray(np.abs(apart @ apart.T) / np.outer(size, size))


def late_by_a_row(model: "LogModel", found: Fit) -> list[str]:
    """Effects found as delays of one sample, if some output shows an input directly.

    A controller makes such delays if it logs what it reads, and what it then commands, in one row.
    """
    if not model.system.direct_outputs:
        return []
    delays = {n: f"{n}.delay_s" for n in found.hypothesis if model.library[n].kind.is_delay}
    late_s = {n: found.value(p) + model.clock_s(found, p) for n, p in delays.items()}
    return [n for n, s in late_s.items() if abs(s / model.dt_s - 1.0) < _ONE_ROW]


def _late_by(model: "LogModel", base: Fit, places: Sequence[int]) -> int:
    """The number of samples that inputs are late; 0 where a delay of the system explains as much.

    For a periodic input a delay and a lead are the same.
    """
    gained, samples = _best(model, base, places, _EARLIER)
    if samples < _FEWEST or gained < RULES.late_nats:
        return 0
    delayed, _ = _best(model, base, places, _LATER)
    return samples if gained - delayed > RULES.late_nats else 0


def _best(model: "LogModel", base: Fit, places: Sequence[int], way: int) -> tuple[float, int]:
    """The most that a shift of inputs earlier or later gains [nats], and its samples.

    This first look keeps the fit, which has followed the input as well as it could.
    """
    seen = _nats(model, base)
    tried = {*_NEAR, *_likely(model, base, places, way)}
    looks = {n: _nats(_moved(model, places, way * n), base) - seen for n in tried}
    most = max(looks.values())
    if most < RULES.late_nats:
        return 0.0, 0
    nats = {0: base.objective}
    nats |= {
        n: _refitted(model, base, places, way * n)
        for n, gained in looks.items()
        if gained > most / 2
    }
    while (best := max(nats, key=nats.__getitem__)) == max(nats) and 2 * best <= _MOST:
        nats[2 * best] = _refitted(model, base, places, way * 2 * best)
    step = max(best // 2, 1)
    while step > 0:
        for samples in (best - step, best + step):
            if samples > 0 and samples not in nats:
                nats[samples] = _refitted(model, base, places, way * samples)
        best, step = max(nats, key=nats.__getitem__), step // 2
    return nats[best] - nats[0], best


def _likely(model: "LogModel", base: Fit, places: Sequence[int], way: int) -> list[int]:
    """The shifts at which errors of the next reading best follow changes of the input.

    An error shows one sample later, so the shifts before those are likely, too.
    """
    found = np.zeros(_MOST)
    scores = model.scores(base.hypothesis, base.theta[None], base.episodes)[0]
    for episode, score in zip(base.episodes, scores, strict=True):
        block = model.blocks[episode]
        errors = score.white.reshape(len(model.channels), -1)
        rows = model.logs[block.log].inputs[places]
        against = np.sign(np.diff(rows) @ np.diff(rows[0]))  # one may fall where another rises
        row = np.where(against < 0.0, -1.0, 1.0) @ rows
        change = np.pad(np.diff(row, prepend=row[0]), _MOST)
        beside = np.lib.stride_tricks.sliding_window_view(change, block.stop - block.start)
        at = block.start + _MOST + way * np.arange(1, _MOST + 1)
        found += ((beside[at] @ errors.T) ** 2).sum(1)
    best = np.argsort(-found)[:_LIKELY] + 1
    return [int(samples) for samples in (*best, *best[best > 1] - 1)]


def _refitted(model: "LogModel", base: Fit, places: Sequence[int], samples: int) -> float:
    moved = _moved(model, places, samples)
    return fit(moved, base.hypothesis, base.episodes, base.theta).objective


def _nats(model: "LogModel", base: Fit) -> float:
    scores = model.scores(base.hypothesis, base.theta[None], base.episodes)[0]
    return float(sum(score.log_density.sum() for score in scores))


def _moved(model: "LogModel", places: Sequence[int], samples: int) -> "LogModel":
    """The model of logs in which inputs come earlier; later if `samples` is negative."""
    logs = [_shifted(log, places, samples) for log in model.logs]
    moved = copy.copy(model)
    moved.logs = logs
    known = model.filter
    moved.filter = Filter(logs, known.blocks, known.starts, known.driven, known.outliers)
    moved.filter.stretch = known.stretch
    return moved


def _shifted(log: Log, places: Sequence[int], samples: int) -> Log:
    inputs, driving = log.inputs.copy(), log.driving.copy()
    within = driving.shape[1] // inputs.shape[1]
    for place in places:
        inputs[place] = _advanced(inputs[place], samples)
        driving[place] = _advanced(driving[place], samples * within)
    return replace(log, inputs=inputs, driving=driving)


def _advanced(row: FloatArray, samples: int) -> FloatArray:
    """A row moved `samples` samples earlier; its last value is held, or its first."""
    return row[np.clip(np.arange(len(row)) + samples, 0, len(row) - 1)]
