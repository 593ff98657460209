"""Recordings of a system, at its rate and cut into blocks: the episodes of the gap workflow.

A block is scored in pieces that run side by side. A piece begins some samples before those that it
is scored on, so that its filter has settled. At the beginning of a log it cannot, and its first
samples are not scored.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.kinds.inputs import shifted
from wakedeploy.gap.systems.likelihood.between_samples import between
from wakedeploy.gap.systems.system import Input, StateSpace
from wakedeploy.gap.systems.trial_points import function_name, is_number, random_points

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

BLOCKS, SHORTEST = 16, 40  # blocks in all, samples of one
_PIECE, _WARM = 600, 60  # samples scored in a piece, and before it
_MOST_MISSING = 0.05
_RATE_TOLERANCE = 0.01
_WITHIN = 8  # parts of a sample, in which inputs are followed
_STATES = 15  # at which a model is tried with what inputs were


@dataclass(frozen=True, eq=False)
class Log:
    """A recording at the system's rate: inputs (i, n), outputs (m, n), NaN where not measured.

    Inputs are the means of a sample's `rows`, outputs the newest reading since the sample before;
    `driving` (i, n · steps · parts) is each input in every part of each of the model's steps,
    between the samples, too.
    """

    name: str
    inputs: FloatArray
    outputs: FloatArray
    driving: FloatArray
    rows: int = 1


@dataclass(frozen=True)
class Block:
    """Samples `start` to `stop` of a log."""

    name: str
    log: int
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of blocks as columns: `sample` (T, S) in the log, `log` (S,), and what is scored.

    `scored` (T, S) marks what is scored; `block` (S,) is the place of its block among those asked
    for. Beyond the end of a piece its last sample is repeated, and not scored.
    """

    sample: IntArray
    scored: npt.NDArray[np.bool_]
    valid: npt.NDArray[np.bool_]
    log: IntArray
    block: IntArray


def logs_of(system: StateSpace, recordings: Sequence[Recording]) -> list[Log]:
    """Recordings brought to the system's rate: inputs as means, outputs as samples.

    Raises UnusableInput for a missing column, a rate that is no multiple of the system's, or an
    input with many gaps.
    """
    if not recordings:
        raise UnusableInput("no recordings; give at least one.")
    return [_log(system, r) for r in recordings]


def _log(system: StateSpace, recording: Recording) -> Log:
    thinning = recording.rate_hz / system.rate_hz
    every = max(round(thinning), 1)
    if abs(thinning / every - 1.0) > _RATE_TOLERANCE:
        lasts_s = recording.time_s[-1] - recording.time_s[0]
        raise UnusableInput(
            f"{recording.name}: {recording.rate_hz:.6g} samples a second, which is no whole "
            f"multiple of {system.name}.rate_hz = {system.rate_hz:.6g}; change one of them. If it "
            f"did not last {lasts_s:.4g} s, the time's unit is wrong."
        )
    n = len(recording.time_s) // every
    logged = {i: _input(recording, i)[: n * every] for i in system.logged}
    driving = driving_of(
        system, {i.name: _driving(system, i, row, every) for i, row in logged.items()}
    )
    _check_laws(system, recording, driving)
    _check_numbers(system, recording, {i.name: row for i, row in logged.items()})
    means = {
        i.name: shifted(row, i.delay_s * recording.rate_hz).reshape(n, every).mean(1)
        for i, row in logged.items()
    }
    inputs = [
        means.get(i.name, row.reshape(n, -1).mean(1))
        for i, row in zip(system.inputs, driving, strict=True)
    ]
    outputs = [_readings(_column(recording, o.name)[: n * every], every) for o in system.outputs]
    for output, values in zip(system.outputs, outputs, strict=True):
        if np.isfinite(values).sum() < 2:
            raise UnusableInput(
                f"{recording.name}: output {output.name!r} has no measured samples."
            )
    return Log(
        recording.name,
        np.array(inputs).reshape(len(inputs), n),
        np.array(outputs),
        driving.reshape(len(inputs), n * system.steps * parts_in_step(system)),
        every,
    )


def _readings(rows: FloatArray, every: int) -> FloatArray:
    """Each sample's newest measured reading, of the rows since the sample before it."""
    before = np.full(every - 1, np.nan)
    each = np.concatenate([before, rows])[: len(rows)].reshape(-1, every)
    newest = every - 1 - np.argmax(np.isfinite(each[:, ::-1]), axis=1)
    return np.asarray(each[np.arange(len(each)), newest])


def parts_in_step(system: StateSpace) -> int:
    """The number of parts of a model's step in which inputs are followed."""
    return max(_WITHIN // system.steps, 1)


def _driving(system: StateSpace, stated: Input, rows: FloatArray, every: int) -> FloatArray:
    """An input in each part of the model's steps: its mean there, from `every` rows in a sample.

    Its delay is taken in parts, not in rows, just as a dead time that is found is.
    """
    parts = system.steps * parts_in_step(system)
    finer = parts // math.gcd(parts, every)
    means = between(rows, stated.hold, finer).reshape(-1, finer * every // parts).mean(1)
    return shifted(means, stated.delay_s * system.rate_hz * parts)


def driving_of(system: StateSpace, logged: Mapping[str, FloatArray]) -> FloatArray:
    """All inputs (i, N), from the logged ones (N,) by name, in each part of the model's steps."""
    rows = [logged[i.name] if i.law is None else made(system, i, logged) for i in system.inputs]
    return np.array(rows)


def made(system: StateSpace, stated: Input, logged: Mapping[str, FloatArray]) -> FloatArray:
    """What a law makes of the logged inputs (N,) in each part of the model's steps."""
    row = system.made(stated, logged)
    parts = stated.delay_s / system.step_s * parts_in_step(system)
    return shifted(row, parts) if parts else row


def _check_laws(system: StateSpace, recording: Recording, driving: FloatArray) -> None:
    """Check that laws give numbers all along a recording, and act within it."""
    for stated, row in zip(system.inputs, driving, strict=True):
        _check_delay(stated, recording)
        if not np.all(np.isfinite(row)):
            place = int(np.argmin(np.isfinite(row)))
            sources = system.made_of[stated.name] or [i.name for i in system.logged]
            of = ", ".join(
                f"{i.name} = {driving[k, place]:.4g}"
                for k, i in enumerate(system.inputs)
                if i.name in sources
            )
            raise UnusableInput(
                f"{recording.name}: the law of {stated.name!r} gives {row[place]} at {of}; bound "
                "what goes into it (np.maximum, np.clip)."
            )


def _column(recording: Recording, name: str) -> FloatArray:
    if name not in recording.columns:
        known = ", ".join(recording.columns)
        raise UnusableInput(
            f"{recording.name}: no column {name!r} among {known}; call it so, in a columns.toml by "
            f"[columns.{name}]."
        )
    column = np.asarray(recording.columns[name], dtype=float)
    if (infinite := np.isinf(column)).any():
        at = int(np.argmax(infinite))
        raise UnusableInput(
            f"{recording.name}: column {name!r} is infinite at sample {at}, "
            f"{recording.time_s[at]:.6g} s; mend it there, by NaN where nothing was measured."
        )
    return column


def _input(recording: Recording, stated: Input) -> FloatArray:
    """An input as it was logged, its short gaps filled with the last value."""
    name = stated.name
    _check_delay(stated, recording)
    column = _column(recording, name)
    missing = ~np.isfinite(column)
    if missing.mean() > _MOST_MISSING or missing[0]:
        raise UnusableInput(
            f"{recording.name}: {missing.mean():.0%} of input {name!r} is not measured; cut the "
            "log where its inputs are known."
        )
    last = np.maximum.accumulate(np.where(missing, 0, np.arange(len(column))))
    return np.asarray(column[last])


def held(recordings: Sequence[Recording], name: str) -> tuple[int, float]:
    """How many samples of an input have the number before them, and for how long in a row [s]."""
    count, longest_s = 0, 0.0
    for recording in recordings:
        there = np.flatnonzero(np.isfinite(recording.columns[name]))
        silences = np.diff(there, append=len(recording.time_s)) - 1
        count += int(silences.sum())
        longest_s = max(longest_s, float(silences.max()) / recording.rate_hz)
    return count, longest_s


def _check_numbers(
    system: StateSpace, recording: Recording, logged: Mapping[str, FloatArray]
) -> None:
    """Check that a model gives numbers where an input is smallest, largest and nearest to 0.

    With some states, that is: what fails with all that are tried fails because of the inputs.
    """
    rows = {**logged, **{i.name: system.made(i, logged) for i in system.inputs if i.law}}
    tried = random_points(system, (_STATES,))
    for place in {int(f(row)) for row in rows.values() for f in (np.argmin, np.argmax, _nearest)}:
        there = tried | {n: np.full(_STATES, row[place]) for n, row in rows.items()}
        for method in (system.rates, system.readings):
            if not is_number(system, method, there, {}).any():
                of = ", ".join(f"{n} = {rows[n][place]:.4g}" for n in logged)
                raise UnusableInput(
                    f"{recording.name}: at {recording.time_s[place]:.6g} s, where {of}, "
                    f"{function_name(system, method)} gives no number, whatever the states are. If "
                    "a reading failed there, leave it empty, or cut the log; else "
                    "bound what goes into it (np.maximum, np.clip)."
                )


def _nearest(row: FloatArray) -> np.intp:
    """Where a row is nearest to 0."""
    return np.argmin(np.abs(row))


def _check_delay(stated: Input, recording: Recording) -> None:
    lasts_s = float(recording.time_s[-1] - recording.time_s[0])
    if stated.delay_s > 0.0 and not stated.delay_s < lasts_s:
        raise UnusableInput(
            f"{recording.name}: it lasts {lasts_s:.4g} s, and input {stated.name!r} has a delay_s "
            f"of {stated.delay_s:.4g}: nothing of it acts; give seconds."
        )


def blocks_of(logs: Sequence[Log]) -> list[Block]:
    """Blocks of about equal length, in order; many logs are a block each."""
    lengths = [log.outputs.shape[1] for log in logs]
    total = sum(lengths)
    if len(logs) >= BLOCKS // 2:
        wanted = [1] * len(logs)
    else:
        count = min(BLOCKS, max(total // SHORTEST, 1))
        wanted = [max(round(count * n / total), 1) for n in lengths]
    blocks = []
    for k, (log, n, parts) in enumerate(zip(logs, lengths, wanted, strict=True)):
        ends = np.linspace(0, n, parts + 1).astype(int)
        for i in range(parts):
            name = log.name if parts == 1 else f"{log.name} {i + 1}/{parts}"
            blocks.append(Block(name, k, int(ends[i]), int(ends[i + 1])))
    return blocks


def pieces_of(blocks: Sequence[Block], unsettled: int) -> Pieces:
    """The pieces of some blocks; `unsettled` samples at a log's beginning are not scored."""
    starts, stops, firsts, owners = [], [], [], []
    longest = max(b.stop - b.start for b in blocks)
    most = max(_PIECE, math.ceil(longest / 8))
    for k, block in enumerate(blocks):
        n = block.stop - block.start
        ends = np.linspace(block.start, block.stop, math.ceil(n / most) + 1).astype(int)
        for low, high in itertools.pairwise(ends):
            starts.append(max(int(low) - _WARM, 0))
            firsts.append(max(int(low), unsettled))
            stops.append(int(high))
            owners.append(k)
    length = max(b - a for a, b in zip(starts, stops, strict=True))
    at = np.arange(length)[:, None] + np.array(starts)[None, :]
    valid = at < np.array(stops)[None, :]
    scored = valid & (at >= np.array(firsts)[None, :])
    sample = np.minimum(at, np.array(stops)[None, :] - 1)
    log = np.array([blocks[k].log for k in owners])
    return Pieces(sample, scored, valid, log, np.array(owners))
