"""Prediction errors of a Kalman filter around a system's own model, many parameter sets at once.

In: a system with effects that act, logs, blocks and parameter sets. Out: for each sample its
innovation, variance, log density and weight; the states; and forecasts over a horizon.

One loop over time serves all parameter sets and all pieces of the logs: each is a lane of the
arrays that the user's functions are called with (after Kristensen, Madsen and Jørgensen,
Automatica 40, 2004, whose estimates are those of an extended Kalman filter, too).
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from wakedeploy.gap.evidence.fits import LOST_NATS, FloatArray
from wakedeploy.gap.systems.kinds.inputs import InputKind
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.blocks import Block, Log, Pieces, parts_in_step, pieces_of
from wakedeploy.gap.systems.system import StateSpace
from wakedeploy.physics.kalman import corrected, stepped
from wakedeploy.physics.series import IntArray

OUTLIER_SPREAD = 6.0  # sd of outliers over that of the other samples
_ASIDE = 1e-4  # of a usual size: how far beside a state a Jacobian looks
_OWN_STATES = 6  # samples more that settle what effects may add; the same for every hypothesis
_GATHERED = 64  # steps whose inputs are gathered at once
_LOST = 1e12  # in its own unit: a state this far away has left the model


@dataclass(frozen=True, eq=False)
class Start:
    """Where a log's filter begins: states (n, N) at every sample, and their sd (n,)."""

    states: FloatArray
    spread: FloatArray


class Driving(NamedTuple):
    """Inputs of lanes in a step, (1, L) by name: their `mean`, and how much comes `early`.

    `early` is empty if no input changes within a step. `before` are means in the step before, if
    some sensor does not follow at once.
    """

    mean: Mapping[str, FloatArray]
    early: Mapping[str, FloatArray]
    before: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Run:
    """A filter's output: `statistics` (4, T, m, K, S) and the corrected states (T, k + d, K, S).

    The last d of the states are the lasting pushes on the driven states.
    """

    statistics: FloatArray
    states: FloatArray
    pieces: Pieces


@dataclass(frozen=True, eq=False)
class Noise:
    """What disturbs lanes, (…, L): variances of sensors, sd of white pushes, and lasting ones.

    A lasting push has the sd `lasting`, keeps the share `keep` of itself from one sample to the
    next, and gets fresh noise of sd `fresh`: an Ornstein–Uhlenbeck process. It stands for all that
    acts on a rate and is not white, including what the model lacks, so that innovations are white
    under every hypothesis.
    """

    sensor: FloatArray
    white: FloatArray
    lasting: FloatArray
    keep: FloatArray
    fresh: FloatArray

    @classmethod
    def of(
        cls, system: StateSpace, driven: Sequence[str], values: Mapping[str, FloatArray]
    ) -> "Noise":
        """The noise in one of the model's steps, from parameters by name, (1, L) each.

        Nothing lasts if no parameter says so. White noise is stated by the sd of its mean over a
        sample; the sd over a step is larger.
        """
        lanes = next(iter(values.values())).shape[1]

        def rows(prefix: str) -> FloatArray:
            found = [np.exp(values[f"{prefix}.{n}"][0]) for n in driven]
            return np.array(found).reshape(len(driven), lanes)

        lasting = keep = np.zeros((len(driven), lanes))
        if all(f"push.{n}" in values for n in driven):
            lasting, keep = rows("push"), np.exp(-system.step_s / rows("lasting"))
        sensor = np.array([np.exp(2 * values[f"noise.{o.name}"][0]) for o in system.outputs])
        fresh = lasting * np.sqrt(1.0 - keep**2)
        return cls(sensor, system.steps**0.5 * rows("force"), lasting, keep, fresh)


class Stepping:
    """Takes lanes of states and covariances one step on; without noise nothing disturbs them."""

    def __init__(
        self, acting: Acting, aside: FloatArray, noise: Noise | None = None, driven: Any = ()
    ) -> None:
        self._acting, self._aside = acting, aside
        self._has_step, self._step_s = acting.system.has_step, acting.system.step_s
        k, lanes = aside.shape
        self._points = np.empty((k, k + 2, lanes))  # and the state again, as if under early inputs
        self._dry = np.array(acting.dry, dtype=np.int64)
        self._driven = np.array(driven, dtype=np.int64)
        self._noise = (np.zeros((0, aside.shape[1])),) * 3
        if noise is not None:
            self._noise = (noise.white, noise.keep, noise.fresh)

    def on(
        self, x: FloatArray, p: FloatArray, u: Driving, *given: Any, step_s: float | None = None
    ) -> None:
        """Change `x` (k + d, L) and `p` in place; `given` are constants, values, time."""
        acting, k = self._acting, len(self._aside)
        # Away from zero, where much has a corner: a slope across it would be neither side's.
        aside = np.where(x[:k] < 0.0, -self._aside, self._aside)
        points, inputs = points_around(x, aside, self._points[:, : k + 1]), u.mean
        if u.early and not self._has_step:
            self._points[:, k + 1] = points[:, 0]
            points = self._points
            inputs = {n: self._twice(mean, u.early[n]) for n, mean in u.mean.items()}
        rates = acting.rates(points, inputs, *given)
        if acting.remembers and not self._has_step:  # of its own, it has no within
            pushed = np.zeros_like(x[:k])
            pushed[self._driven[: len(x) - k]] = x[k:]
            acting.correct_memories(x[:k], rates, pushed, given[1], step_s or self._step_s)
        stepped(x, p, rates, aside, self._driven, *self._noise,
                step_s or self._step_s, self._has_step, self._dry,
                *acting.rubbed(x[:k], u.mean, *given))  # fmt: skip

    def _twice(self, mean: FloatArray, early: FloatArray) -> FloatArray:
        """An input at all points: its mean; at the last point plus what comes early."""
        rows = np.empty(self._points.shape[1:])
        rows[:-1], rows[-1] = mean, mean + early
        return rows


class Inputs:
    """Columns (K, 2, N · steps) of every input by name: means, and what comes early in a step."""

    def __init__(self, columns: Mapping[str, FloatArray], begins: IntArray | None) -> None:
        """`begins` are the logs' first steps, if the step before counts; else None."""
        self._columns, self._begins = columns, begins
        self._is_bent = any(rows[:, 1].any() for rows in columns.values())

    def at(self, sets: Any, step: IntArray) -> Driving:
        """The inputs in some steps, with the parameter set of each: (1, L)."""
        early = self._part(1, sets, step) if self._is_bent else {}
        before: Mapping[str, FloatArray] = {}
        if self._begins is not None:
            before = self._part(0, sets, step - 1 + np.isin(step, self._begins))
        return Driving(self._part(0, sets, step), early, before)

    def along(self, at: IntArray, steps: int) -> Iterator[Driving]:
        """The inputs in every step of samples `at` (T, S), in order, for all sets: (1, L)."""
        samples = max(_GATHERED // steps, 1)
        for first in range(0, len(at), samples):
            some = steps * at[first : first + samples, None, :] + np.arange(steps)[:, None]
            step = some.reshape(-1, at.shape[1])
            mean = self._gathered(0, step)
            early = self._gathered(1, step) if self._is_bent else {}
            before: dict[str, FloatArray] = {}
            if self._begins is not None:
                before = self._gathered(0, step - 1 + np.isin(step, self._begins))
            for i in range(len(step)):
                yield Driving(
                    {n: rows[i] for n, rows in mean.items()},
                    {n: rows[i] for n, rows in early.items()} if early else early,
                    {n: rows[i] for n, rows in before.items()} if before else before,
                )

    def _gathered(self, part: int, step: IntArray) -> dict[str, FloatArray]:
        """Inputs in steps (C, S) for all parameter sets: (C, 1, L)."""
        return {
            n: np.moveaxis(rows[:, part, step], 0, 1).reshape(len(step), 1, -1)
            for n, rows in self._columns.items()
        }

    def _part(self, part: int, sets: Any, step: IntArray) -> dict[str, FloatArray]:
        return {n: rows[sets, part, step].reshape(1, -1) for n, rows in self._columns.items()}


class Filter:
    """The logs of a system, and how a filter runs over them."""

    def __init__(
        self,
        logs: Sequence[Log],
        blocks: Sequence[Block],
        starts: Sequence[Start],
        driven: Sequence[str],
        outliers: float = 0.0,
    ) -> None:
        self.logs, self.blocks, self.starts = logs, blocks, starts
        self.driven, self.outliers = tuple(driven), float(outliers)
        self.stretch = (1, 1)  # the samples of a stretch, and those of its readings looked at
        self._offset = np.cumsum([0, *(log.outputs.shape[1] for log in logs)])
        self._logged = np.concatenate([log.inputs for log in logs], axis=1)
        self._driving = np.concatenate([log.driving for log in logs], axis=1)
        self._outputs = np.concatenate([log.outputs for log in logs], axis=1)
        self.guesses = np.concatenate([s.states for s in starts], axis=1)

    def ends(self, log: int) -> tuple[int, int]:
        """Where a log begins and ends among all samples."""
        return int(self._offset[log]), int(self._offset[log + 1])

    def run(
        self,
        acting: Acting,
        values: Mapping[str, FloatArray],
        episodes: Sequence[int],
        outputs: FloatArray | None = None,
        all_readings: bool = False,
    ) -> Run:
        """Run over some blocks, for parameter sets `values` of arrays (K,)."""
        blocks = [self.blocks[e] for e in episodes]
        unsettled = acting.system.unheard + 2 * len(acting.system.states) + _OWN_STATES
        pieces = pieces_of(blocks, unsettled)
        count, parts = len(next(iter(values.values()))), pieces.sample.shape[1]
        lanes = count * parts
        at = pieces.sample + self._offset[pieces.log][None, :]
        driving = self.arriving(acting, values).along(at, acting.system.steps)
        spread = {n: np.repeat(v, parts)[None, :] for n, v in values.items()}
        spread |= acting.formed(spread)
        logged = self._outputs if outputs is None else outputs
        dt_s, steps = 1.0 / acting.system.rate_hz, acting.system.steps
        noise = Noise.of(acting.system, self.driven, spread)
        x, p = self._begin(acting, at[0], count, noise)
        for name, sd in self._unsettled(acting, values, pieces).items():
            place = acting.states.index(name)
            p[place, place] = sd**2
        k, m = len(acting.states), len(logged)
        aside = self.aside(acting, lanes)
        stepping = Stepping(acting, aside, noise, self._places(acting))
        statistics = np.empty((len(at), 4, m, lanes))
        states = np.empty((len(at), len(x), lanes))
        timeless = not any(e.port.role == "constant" for e in acting.effects)
        c = acting.constants(spread, np.zeros((1, 1)))
        points = np.empty((k, k + 1, lanes))
        times = np.tile(pieces.sample * dt_s, count)
        measured = np.where(pieces.valid[:, None], np.moveaxis(logged[:, at], 0, 1), np.nan)
        if not all_readings:
            measured[self._passed_over(measured, pieces)] = np.nan
        measured, sensor_sd = np.tile(measured, (1, 1, count)), np.sqrt(noise.sensor)
        for t in range(len(at)):
            time_s, u = times[t][None, :], next(driving)
            if not timeless:
                c = acting.constants(spread, time_s)
            around = points_around(x, aside, points)
            shown = acting.readings(around, u.mean, c, spread, time_s, (measured[t], sensor_sd),
                                    u.before)  # fmt: skip
            corrected(x, p, shown, aside, measured[t], noise.sensor, self.outliers, OUTLIER_SPREAD,
                      statistics[t])  # fmt: skip
            states[t] = x
            for j in range(steps):
                u = next(driving) if j else u
                stepping.on(x, p, u, c, spread, time_s)
            if not np.abs(x).max() < _LOST:  # also if something is no number
                lost = ~(np.abs(x).max(0) < _LOST)
                x[:, lost], p[:, :, lost] = 0.0, 0.0
                statistics[t][:, :, lost] = np.array([0.0, 1.0, LOST_NATS, 1.0])[:, None, None]
        shape = (len(at), 4, m, count, parts)
        states = states.reshape(len(at), len(x), count, parts)
        return Run(np.moveaxis(statistics.reshape(shape), 1, 0), states, pieces)

    def forecasts(
        self,
        acting: Acting,
        values: Mapping[str, FloatArray],
        episodes: Sequence[int],
        horizon: int,
        chosen: Sequence[int] | None = None,
    ) -> list[FloatArray]:
        """Measured less forecast (m, n) of each block, NaN where nothing is forecast.

        From every `horizon`-th sample the model goes on alone, without measurements. All readings
        say where it begins, also those that are otherwise passed over. `chosen` says which
        parameter set is each block's; by default the first.
        """
        run = self.run(acting, values, episodes, all_readings=True)
        every = [(t, s) for s in range(run.pieces.sample.shape[1])
                 for t in range(0, len(run.states), horizon)
                 if run.pieces.scored[t, s]]  # fmt: skip
        result = [np.full((len(self._outputs), self.blocks[e].stop - self.blocks[e].start), np.nan)
                  for e in episodes]  # fmt: skip
        if not every:
            return result
        t0, s0 = (np.array(column) for column in zip(*every, strict=True))
        lanes = len(t0)
        owner = run.pieces.block[s0]
        set_of = np.zeros(lanes, dtype=int) if chosen is None else np.array(chosen)[owner]
        spread = {n: v[set_of][None, :] for n, v in values.items()}
        spread |= acting.formed(spread)
        inputs = self.arriving(acting, values)
        x = np.ascontiguousarray(run.states[t0, : len(acting.states), set_of, s0].T)
        p = np.zeros((len(x), len(x), lanes))
        stepping = Stepping(acting, self.aside(acting, lanes))
        dt_s, steps = 1.0 / acting.system.rate_hz, acting.system.steps
        last = len(run.states) - 1
        first = np.array([self.blocks[e].start for e in episodes])[owner]
        for step in range(horizon):
            t = np.minimum(t0 + step, last)
            sample = run.pieces.sample[t, s0]
            here = steps * (sample + self._offset[run.pieces.log[s0]])
            time_s = (sample * dt_s)[None, :]
            c = acting.constants(spread, time_s)
            for j in range(steps):
                stepping.on(x, p, inputs.at(set_of, here + j), c, spread, time_s)
            x[:, ~(np.abs(x).max(0) < _LOST)] = np.nan
            t = t0 + step + 1
            inside = (t <= last) & run.pieces.scored[np.minimum(t, last), s0]
            sample = run.pieces.sample[np.minimum(t, last), s0]
            time_s = (sample * dt_s)[None, :]
            c = acting.constants(spread, time_s)
            here = sample + self._offset[run.pieces.log[s0]]
            u = inputs.at(set_of, steps * here)
            shown = acting.readings(x[:, None, :], u.mean, c, spread, time_s, None, u.before)[:, 0]
            error = self._outputs[:, here] - shown
            for block in range(len(episodes)):
                of_block = inside & (owner == block)
                result[block][:, sample[of_block] - first[of_block]] = error[:, of_block]
        return result

    def free_run(
        self, acting: Acting, values: Mapping[str, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """States (k, n) and readings (m, n) of the first log, from its first sample on."""
        inputs = self.arriving(acting, values)
        spread = {n: v[None, :] for n, v in values.items()}
        spread |= acting.formed(spread)
        x, p = self._begin(acting, np.zeros(1, dtype=np.int64), 1, None)
        stepping = Stepping(acting, self.aside(acting, 1))
        dt_s, steps = 1.0 / acting.system.rate_hz, acting.system.steps
        states, shown = [], []
        for t in range(self.logs[0].outputs.shape[1]):
            time_s = np.full((1, 1), t * dt_s)
            c = acting.constants(spread, time_s)
            states.append(x[:, 0].copy())
            for j in range(steps):
                u = inputs.at(0, np.array([steps * t + j]))
                if not j:
                    given = (x[:, None, :], u.mean, c, spread, time_s, None, u.before)
                    shown.append(acting.readings(*given)[:, 0, 0])
                stepping.on(x, p, u, c, spread, time_s)
        return np.array(states).T, np.array(shown).T

    def advanced(
        self,
        acting: Acting,
        values: Mapping[str, FloatArray],
        at: IntArray,
        samples: int,
        finer: int = 1,
    ) -> FloatArray:
        """Readings (m, S) `samples` after those at the places `at` (S,), from guessed states.

        Each of the model's steps is taken in `finer` smaller ones; the inputs are held over them
        all.
        """
        inputs, lanes = self.arriving(acting, values), len(at)
        spread = {n: np.repeat(v, lanes)[None, :] for n, v in values.items()}
        spread |= acting.formed(spread)
        x, p = self._begin(acting, at, 1, None)
        stepping, step_s = Stepping(acting, self.aside(acting, lanes)), acting.system.step_s
        for step in range(samples * acting.system.steps):
            here = acting.system.steps * at + step
            time_s = np.asarray(here * step_s, dtype=np.float64)[None, :]
            u, given = inputs.at(0, here), (acting.constants(spread, time_s), spread, time_s)
            held = u._replace(early={})  # a finer step has none of what a whole one has early
            for _ in range(finer):
                stepping.on(x, p, held, *given, step_s=step_s / finer)
        return acting.readings(x[:, None, :], u.mean, *given, None, u.before)[:, 0]

    def onward(
        self, acting: Acting, values: Mapping[str, FloatArray], at: IntArray, samples: int
    ) -> Iterator[FloatArray]:
        """States (n, S) after each of some samples from the places `at` (S,), as guessed there."""
        inputs, lanes, steps = self.arriving(acting, values), len(at), acting.system.steps
        spread = {n: np.repeat(v, lanes)[None, :] for n, v in values.items()}
        spread |= acting.formed(spread)
        x, p = self._begin(acting, at, 1, None)
        stepping = Stepping(acting, self.aside(acting, lanes))
        for step in range(samples * steps):
            here = steps * at + step
            time_s = np.asarray(here * acting.system.step_s, dtype=np.float64)[None, :]
            u, c = inputs.at(0, here), acting.constants(spread, time_s)
            stepping.on(x, p, u, c, spread, time_s)
            if (step + 1) % steps == 0:
                yield x[: len(acting.system.states)].copy()

    def _passed_over(self, measured: FloatArray, pieces: Pieces) -> npt.NDArray[np.bool_]:
        """The readings (T, m, S) that are not looked at: all but a channel's first of each part.

        All readings before the scored part of a piece are looked at, so that its filter settles.
        """
        samples, readings = self.stretch
        part = np.arange(len(measured)) * readings // samples
        begins = np.searchsorted(part, part)
        known = np.isfinite(measured)
        count = np.cumsum(known, axis=0)
        before = (count - known)[begins]
        return np.asarray(known & pieces.scored[:, None] & (count - before > 1))

    def arriving(self, acting: Acting, values: Mapping[str, FloatArray]) -> "Inputs":
        """Every input as it reaches the system in each of the model's steps."""
        count = len(next(iter(values.values())))
        parts = acting.system.steps * parts_in_step(acting.system)
        ends = parts * self._offset
        columns = {}
        for stated in acting.system.inputs:
            names = [n for n in acting.depends(stated.name) if n in values]
            known: dict[tuple[float, ...], FloatArray] = {}
            rows = []
            for k in range(count):
                key = tuple(float(values[n][k]) for n in names)
                if key not in known:
                    parameters = dict(zip(names, key, strict=True))
                    known[key] = np.concatenate([
                        acting.column(stated.name, self._driving[:, a:b], parameters)
                        for a, b in itertools.pairwise(ends)
                    ], axis=1)  # fmt: skip
                rows.append(known[key])
            shape = (count, *known[key].shape)
            alike = len(known) == 1  # as nearly always: then one row is enough for all
            columns[stated.name] = np.broadcast_to(rows[0], shape) if alike else np.array(rows)
        begins = acting.system.steps * self._offset[:-1]
        return Inputs(columns, begins if acting.is_late else None)

    def _unsettled(
        self, acting: Acting, values: Mapping[str, FloatArray], pieces: Pieces
    ) -> dict[str, FloatArray]:
        """Sd (L,) of what reaches the system from before its log, where each lane begins."""
        dt_s, count = 1.0 / acting.system.rate_hz, len(next(iter(values.values())))
        found: dict[str, FloatArray] = {}
        for effect in acting.effects:
            kind = effect.kind
            if not isinstance(kind, InputKind) or not effect.own_states:
                continue
            row = [i.name for i in acting.system.inputs].index(effect.port.name)
            columns = np.split(self._logged[row], self._offset[1:-1])
            sd = np.empty((count, pieces.sample.shape[1]))
            for k in range(count):
                parameters = effect.parameters({n: v[k] for n, v in values.items()})
                at_start = np.array([kind.unsettled(c, parameters, dt_s) for c in columns])
                clock = values.get(acting.clock(effect.port.name))
                since_s = pieces.sample[0] * dt_s - (0.0 if clock is None else clock[k])
                sd[k] = at_start[pieces.log] * kind.remaining(since_s, parameters, dt_s)
            found |= dict.fromkeys(effect.own_states, sd.reshape(-1))
        return found

    def _begin(
        self, acting: Acting, at: IntArray, count: int, noise: "Noise | None"
    ) -> tuple[FloatArray, FloatArray]:
        """States and covariances at the first sample of every lane, lasting pushes after them."""
        states = self.guesses[:, at]  # (n, S)
        sd = np.tile(self.starts[0].spread[:, None], (1, states.shape[1]))
        for effect in acting.effects:
            for _ in effect.own_states:
                value = np.zeros(states.shape[1])
                width = 0.0 if effect.port.role == "input" else 0.5
                if effect.port.role == "output":
                    value = self._outputs[
                        [o.name for o in acting.system.outputs].index(effect.port.name)
                    ][at]
                    value, width = np.nan_to_num(value), effect.scales.sizes["output"]
                states = np.vstack([states, value[None]])
                sd = np.vstack([sd, np.full((1, sd.shape[1]), width)])
        x = states
        x, sd = np.tile(x, (1, count)), np.tile(sd, (1, count))
        if noise is not None:
            x, sd = np.vstack([x, 0.0 * noise.lasting]), np.vstack([sd, noise.lasting])
        p = np.zeros((len(x), *x.shape))
        for i in range(len(x)):
            p[i, i] = sd[i] ** 2
        return np.ascontiguousarray(x), p

    def _places(self, acting: Acting) -> IntArray:
        """The places of the driven states among all states."""
        return np.array([acting.states.index(n) for n in self.driven], dtype=np.int64)

    def aside(self, acting: Acting, lanes: int) -> FloatArray:
        """How far beside each state a Jacobian looks, (k, lanes)."""
        # What an effect adds at an input or a sensor has that size; its part in a force is about 1.
        port_sizes = {
            name: effect.scales.sizes[effect.port.role]
            for effect in acting.effects
            if effect.port.role in ("input", "output")
            for name in effect.own_states
        }
        sizes = [port_sizes.get(n) or acting.sizes.get(n, 1.0) for n in acting.states]
        return np.tile(_ASIDE * np.array(sizes)[:, None], (1, lanes))


def points_around(x: FloatArray, aside: FloatArray, points: FloatArray | None = None) -> FloatArray:
    """The first k states of `x` (≥ k, L) and those beside them in each direction, (k, k + 1, L).

    `points`, if given, is written to.
    """
    k = len(aside)
    points = np.empty((k, k + 1, x.shape[1])) if points is None else points
    points[:] = x[:k, None, :]
    for i in range(k):
        points[i, i + 1] += aside[i]
    return points
