"""Logs of any system as a `Model`: what is free in every hypothesis, and how likely blocks are.

In: a `System` and recordings. Out: scores of blocks under hypotheses, many parameter sets at once.
Free in every hypothesis, the base included, are noise of sensors and of rates, clocks within a
sample, constants within their spreads, and a small smooth error of each rate's form (Kennedy and
O'Hagan, J. R. Stat. Soc. B 63, 2001).
"""

import copy
import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.names import near, one_of
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import Fit, FloatArray, Free, Hypothesis, Score
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Leftover, Measured, Quantity
from wakedeploy.gap.search.comparison import ComparisonDefaults, Record
from wakedeploy.gap.systems.kinds.library import Effect, held_by, offered, ports_alike
from wakedeploy.gap.systems.likelihood.always_free import (
    clocks,
    constants,
    form,
    pushes,
    sensor_noise,
)
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.blocks import Block, blocks_of, logs_of, pieces_of
from wakedeploy.gap.systems.likelihood.clocks import (
    late_by_a_row,
    late_inputs,
    shared_clocks,
)
from wakedeploy.gap.systems.likelihood.curves import curves, taken_for
from wakedeploy.gap.systems.likelihood.filter import Filter, Run, Start
from wakedeploy.gap.systems.likelihood.forecast_length import samples_ahead
from wakedeploy.gap.systems.likelihood.initial_states import InitialStates, initial_states
from wakedeploy.gap.systems.likelihood.leftover import leftovers
from wakedeploy.gap.systems.likelihood.strays import without_strays
from wakedeploy.gap.systems.likelihood.unseen_states import followed
from wakedeploy.gap.systems.likelihood.unshown_constants import unshown
from wakedeploy.gap.systems.likelihood.usual_sizes import usual_sizes
from wakedeploy.gap.systems.ports import Point
from wakedeploy.gap.systems.system import StateSpace

_TOGETHER = 15000  # samples times effects that are looked at in one run
# Pieces times parameter sets up to which a step of the filter costs at most twice that of one.
_LANES_AT_ONCE = 300
_SEARCHED = 24000  # samples times states that a search looks at
_FEW = 3  # samples between readings, from which readings are few
_STILL = 0.02  # of its usual size: an output that changes no more rests
_IN_NOISE = 6.0  # median changes from one reading to the next: white noise spans some four
_WITHOUT_STRAYS = 0.02, 0.98  # quantiles
_FEWEST_MOVING = 4  # blocks, one of which can confirm what three show
_SHIFTED = 0.1  # of a sample, by which an input acts late: less is next to nothing


class LogModel(ComparisonDefaults):
    """A system, its logs, and the effects that it may lack.

    `channels` are the outputs with their units; an episode is a block of a log.
    """

    def __init__(self, system: StateSpace, recordings: Sequence[Recording]) -> None:
        self.system, self.name = system, system.name
        self._shared = shared_clocks(system, recordings)
        self.recordings = tuple(recordings)
        share = system.outlier_share
        read = logs_of(system, recordings)
        self.logs = [without_strays(log, share) for log in read] if share else read
        left_out = sum(
            (np.isnan(kept.outputs) & np.isfinite(log.outputs)).sum(axis=1)
            for kept, log in zip(self.logs, read, strict=True)
        )
        self.strays = dict(zip((o.name for o in system.outputs), map(int, left_out), strict=True))
        self.blocks = blocks_of(self.logs)
        self.dt_s = 1.0 / system.rate_hz
        self.channels = tuple((o.name, o.unit) for o in system.outputs)
        self._kinematic = system.kinematic()
        known = [initial_states(system, log, self._kinematic) for log in self.logs]
        guessed = [
            k.stacked(system, log.outputs.shape[1]) for k, log in zip(known, self.logs, strict=True)
        ]
        stated = {*known[0].along, *known[0].first, *system.start_spread}
        self.hidden = tuple(n for n in system.states if n not in stated)  # begin anywhere
        self.sizes = usual_sizes(system, self.logs, guessed, self.rates_at)
        self.driven = self._driven()
        guessed = self._followed(known, guessed)
        self.sizes = usual_sizes(system, self.logs, guessed, self.rates_at)
        spread = self._start_spread()
        self._starts = [Start(g, spread) for g in guessed]
        self.span_s = max(log.outputs.shape[1] for log in self.logs) * self.dt_s
        self.library = offered(system, self.sizes, (self.dt_s, self.span_s))
        self.effects = {name: effect.free for name, effect in self.library.items()}
        self.filter = Filter(self.logs, self.blocks, self._starts, self.driven, share)
        self.records = [self._record(b) for b in self.blocks]
        self._sealed = self._confirming()
        self.is_pushed = True  # whether pushes that last are free in every hypothesis
        self.horizon = samples_ahead(self)  # samples over which a forecast goes

    def offer(self, effects: Mapping[str, Effect]) -> None:
        """Add effects of other logs that these logs have no reason to look for."""
        self.library |= {n: e for n, e in effects.items() if n not in self.library}
        self.effects = {name: effect.free for name, effect in self.library.items()}

    @property
    def has_motion(self) -> bool:
        """Whether a reading of some output changes."""
        return any(np.ptp(row[np.isfinite(row)]) > 0.0 for row in self._readings())

    def require_effects(self) -> None:
        """UnusableInput if no effect can be asked for: "nothing is missing" would be no answer."""
        if not self.has_motion:
            which = " and ".join(repr(o.name) for o in self.system.outputs)
            raise UnusableInput(
                f"{self.name}: no output moves in these logs ({which}); mend them if a sensor "
                "hangs, name other columns, or record a log that moves."
            )
        if why := self.without_effects:
            raise UnusableInput(why)

    @property
    def without_effects(self) -> str:
        """Why there is no effect to search for, and what to do; "" where there is one."""
        if self.library:
            return ""
        if self.system.ports:
            return (
                f"{self.name}: its ports offer no effect that these logs could show; leave out "
                "their `kinds`, state further ports, or record a log that moves more."
            )
        return (
            f"{self.name} states no ports, so that there is no effect to ask for; state where one "
            "may act: ports = [Port.input(…), Port.force(…), Port.output(…)]."
        )

    def _readings(self) -> FloatArray:
        """Every output (m, N) along all logs."""
        return np.concatenate([log.outputs for log in self.logs], axis=1)

    @property
    def episodes(self) -> int:
        """How many blocks there are."""
        return len(self.blocks)

    def log_of(self, episode: int) -> int:
        """The log that a block is of."""
        return self.blocks[episode].log

    def thinned(self) -> "LogModel":
        """The same with the first samples of each block alone, if the logs are long; else itself.

        Some thousand samples show which effect is missing; all of them say how large it is.
        """
        enough = max(_SEARCHED // len(self.system.states) // self.episodes, 2 * self.horizon)
        if max(b.stop - b.start for b in self.blocks) <= enough:
            return self
        part = copy.copy(self)
        part.unshown = self.unshown  # by all samples: what is free is the same in both
        part.blocks = [replace(b, stop=min(b.stop, b.start + enough)) for b in self.blocks]
        part.filter = copy.copy(self.filter)
        part.filter.blocks = part.blocks
        part.records = [part._record(b) for b in part.blocks]
        return part

    def far_ahead(self) -> "LogModel | None":
        """The same, asked to predict far ahead: few readings per forecast, and no push that lasts.

        A push that drifts predicts the next reading as well as a law does, the more so where
        readings repeat; but what is fitted to such predictions may err after a forecast's length.
        None if a forecast is so short that all its readings would be looked at.
        """
        if self.horizon < _FEW * RULES.readings_ahead:
            return None
        view = copy.copy(self)
        view.unshown = self.unshown
        view.filter = copy.copy(self.filter)
        view.filter.stretch = self.horizon, RULES.readings_ahead
        view.is_pushed = False
        view.__dict__.pop("_nuisances", None)
        return view

    def first_states(self) -> FloatArray:
        """Where the first log begins, as far as its outputs show, (n,)."""
        return np.asarray(self._starts[0].states[:, 0])

    def first_rates(self) -> FloatArray:
        """The states' rates by the model where the logs begin, (n, logs)."""
        states = np.array([start.states[:, 0] for start in self._starts]).T
        inputs = np.array([log.inputs[:, 0] for log in self.logs]).T
        return self.rates_at(states, inputs)

    def sealed(self) -> tuple[int, ...]:
        """The last quarter of the blocks, in one piece: excitations may repeat.

        If most of these are at rest, as where a log goes on after the motion, it is the last
        quarter of those that move: at rest hardly anything bears an answer out.
        """
        return self._sealed

    def _confirming(self) -> tuple[int, ...]:
        """The blocks that are sealed."""
        count = max(round(RULES.sealed_share * self.episodes), 1)
        last = tuple(range(self.episodes - count, self.episodes))
        moving = [e for e in range(self.episodes) if self._moves(self.blocks[e])]
        if 2 * len(set(last) & set(moving)) >= count or len(moving) < _FEWEST_MOVING:
            return last
        return tuple(moving[-max(round(RULES.sealed_share * len(moving)), 1) :])

    def _moves(self, block: Block) -> bool:
        """Whether any output's readings span a part of their usual size, and more than noise does.

        What noise does is seen from one reading to the next. A steady speed does not span that; a
        channel that drifts by itself, as a temperature, always does.
        """
        for output, row in zip(self.system.outputs, self.logs[block.log].outputs, strict=True):
            read = row[block.start : block.stop]
            read = read[np.isfinite(read)]
            if len(read) < 3:
                continue
            low, high = np.quantile(read, _WITHOUT_STRAYS)
            noise = float(np.median(np.abs(np.diff(read))))
            if high - low > max(_STILL * self.sizes[f"y {output.name}"], _IN_NOISE * noise):
                return True
        return False

    def free(self, hypothesis: Hypothesis) -> tuple[Free, ...]:
        """Noise, clocks, constants, form, and the effects' parameters."""
        parameters = tuple(f for effect in hypothesis for f in self.effects[effect])
        return (*self._nuisances, *parameters)

    def score(self, hypothesis: Hypothesis, theta: FloatArray, episode: int) -> Score:
        """One block under one parameter set."""
        return self.scores(hypothesis, np.asarray(theta)[None], (episode,))[0][0]

    def scores(
        self, hypothesis: Hypothesis, thetas: FloatArray, episodes: Sequence[int]
    ) -> list[tuple[Score, ...]]:
        """Blocks under parameter sets (K, p): for each set a score of each block."""
        run = self.run(hypothesis, thetas, episodes)
        each = [self._scored(run, i, episode) for i, episode in enumerate(episodes)]
        return list(zip(*each, strict=True))

    def sets_at_once(self, episodes: Sequence[int]) -> int:
        """The number of parameter sets that take at most twice the time of one."""
        if self.system.costs_by_point:
            return 1
        pieces = pieces_of([self.filter.blocks[e] for e in episodes], 0)
        return _LANES_AT_ONCE // len(pieces.log)

    def run(self, hypothesis: Hypothesis, thetas: FloatArray, episodes: Sequence[int]) -> Run:
        """The filter over some blocks."""
        names = [f.name for f in self.free(hypothesis)]
        values = dict(zip(names, np.asarray(thetas, dtype=float).T, strict=True))
        with np.errstate(all="ignore"):
            return self.filter.run(self.acting(hypothesis), values, episodes)

    def acting(self, hypothesis: Hypothesis) -> Acting:
        """The system with a hypothesis's effects."""
        for name in hypothesis:
            if name not in self.library:
                close, known = near(name, self.library), ", ".join(self.library) or "none"
                hint = f"did you mean {one_of(close)}?" if close else f"there are: {known}."
                raise UnusableInput(f"{self.name}: no effect {name!r}; {hint}")
        effects = [self.library[name] for name in hypothesis]
        return Acting(self.system, effects, self.sizes, self.driven, self._shared)

    def disagreement(self, values: Mapping[str, float], episode: int) -> FloatArray:
        """Measured less forecast (m, n) of a block, 0 where nothing is forecast."""
        acting = {n.rsplit(".", 1)[0] for n in values}
        hypothesis = tuple(n for n in self.library if n in acting)
        return np.nan_to_num(self._forecast(hypothesis, values, (episode,))[0])

    def disagreements(self, fitted: Fit, episodes: Sequence[int]) -> list[FloatArray]:
        """Measured less forecast (m, n) of blocks, NaN where nothing is forecast."""
        values = self.values(fitted.hypothesis, fitted.theta)
        return self._forecast(fitted.hypothesis, values, episodes)

    def groups(self, names: Sequence[str]) -> list[list[str]]:
        """Effects in groups that one run can judge together, if short logs make that faster.

        Those with states of their own stay alone.
        """
        simple = [n for n in names if not self.library[n].own_states]
        size = max(_TOGETHER // sum(b.stop - b.start for b in self.blocks), 1)
        groups = [simple[i : i + size] for i in range(0, len(simple), size)]
        return groups + [[n] for n in names if self.library[n].own_states]

    def ports_alike(self, name: str) -> list[str]:
        """The same kind at other ports of the same role and unit: at the other wheel's motor."""
        return ports_alike(self.library, name)

    def simpler_effects(self, name: str) -> tuple[str, ...]:
        """Effects at the same port that this one only elaborates, offered or not."""
        effect = self.library[name]
        return tuple(f"{kind}@{effect.port.name}" for kind in effect.kind.simpler)

    def is_friction_law(self, name: str) -> bool:
        """Whether an effect is a finer law of the friction that a simpler one is."""
        return self.library[name].kind.is_friction_law

    def held_by_friction(self, hypothesis: Hypothesis) -> list[str]:
        """Constant effects that a dry friction of a hypothesis may hold."""
        return held_by(self.system, self.library, hypothesis)

    def inputs_answered(self, fitted: Fit, name: str) -> float:
        """What inputs do with an effect, as fitted, as a share of what they do without.

        All, with a sensor's gain, where other sensors show that what it measures does answer.
        """
        effect = self.library[name]
        sizes = {p.name: fitted.value(f"{name}.{p.name}") for p in effect.kind.parameters}
        share = effect.kind.inputs_answered(sizes)
        if share == 1.0 or effect.port.role != "output":
            return share
        scaled = [self.library[n] for n in fitted.hypothesis if n in self.library]
        doubted = {e.port.name for e in scaled if e.port.role == "output" and e.kind.is_gain}
        return 1.0 if self.system.is_shown_without(effect.port.name, doubted) else share

    def leftovers(self, fitted: Fit) -> tuple[Leftover, ...]:
        """What still acts and nothing explains; () far ahead."""
        return leftovers(self, fitted) if self.is_pushed else ()

    def late_inputs(self, base: Fit, found: Fit) -> dict[str, float]:
        """Inputs that come later than the outputs that they drive, and by how much [s]."""
        return late_inputs(self, base, found)

    def late_by_a_row(self, found: Fit) -> list[str]:
        """Delays of one sample, in a system that shows an input directly."""
        return late_by_a_row(self, found)

    def shifted_inputs(self, found: Fit) -> dict[str, Measured]:
        """By how much inputs surely act later than their stamps [s]; negative for sooner.

        What a named delay of the input has with its clock is left out, as are shifts that chance
        may bring or that are next to none.
        """
        acting = map(self.library.__getitem__, found.hypothesis)
        delayed = {e.port.name for e in acting if e.kind.is_delay and e.port.role == "input"}
        delayed |= {n for name in delayed for n in self.system.made_of.get(name, ())}
        shifted: dict[str, Measured] = {}
        for clock, names in self._stamped_together().items():
            value, (low, high) = found.value(f"clock.{clock}"), found.interval(f"clock.{clock}")
            if low * high > 0.0 and abs(value) > _SHIFTED * self.dt_s:
                late = Measured(value=value, low=low, high=high, unit="s")
                shifted |= dict.fromkeys((n for n in names if n not in delayed), late)
        return shifted

    def clocked(self, name: str) -> str:
        """The input whose clock one has in these logs, "" for none."""
        return self.system.clocked(name, self._shared)

    def _stamped_together(self) -> dict[str, list[str]]:
        """The logged inputs of each clock, by its first."""
        together: dict[str, list[str]] = {}
        for stated in self.system.logged:
            together.setdefault(self.clocked(stated.name), []).append(stated.name)
        return together

    def curved_inputs(self, named: Sequence[str]) -> list[str]:
        """Inputs that act by a curve, if a named effect says that they or an output are slow.

        A lag behind a curve has no port, so the effect may stand for it.
        """
        return taken_for(self, named)

    def clock_s(self, fitted: Fit, parameter: str) -> float:
        """What an input's clock took of a dead time [s]: half a sample may be either's."""
        effect, _, short = parameter.rpartition(".")
        known = self.library.get(effect)
        if known is None or short != "delay_s" or known.port.role != "input":
            return 0.0
        clock = f"clock.{self.clocked(known.port.name)}"
        return fitted.value(clock) if clock in fitted.names else 0.0

    @functools.cached_property
    def curves(self) -> dict[str, tuple[str, ...]]:
        """States that an input drives by a curve, by that input."""
        return curves(self)

    def along_logs(self) -> FloatArray:
        """The states (n, N) along all logs, as outputs show them."""
        return np.concatenate([start.states for start in self._starts], axis=1)

    def with_effects(self, effects: Mapping[str, Effect]) -> "LogModel":
        """The same system with these effects offered as well."""
        wider = copy.copy(self)
        wider.library = {**self.library, **effects}
        wider.effects = {name: each.free for name, each in wider.library.items()}
        return wider

    def crossed_disagreements(
        self, fitted: Fit, thetas: FloatArray, chosen: Sequence[int]
    ) -> list[FloatArray]:
        """The same for a fit's own blocks, each with one of several parameter sets (K, p)."""
        sets = dict(zip(fitted.names, np.asarray(thetas, dtype=float).T, strict=True))
        acting = self.acting(fitted.hypothesis)
        with np.errstate(all="ignore"):
            return self.filter.forecasts(acting, sets, fitted.episodes, self.horizon, chosen)

    def held(self, episodes: Sequence[int]) -> list[list[FloatArray]]:
        """The same (m, n) for two forecasts without a model: the last reading, and the log's mean.

        The last reading is the newest that was measured, however slow its sensor is; before a log's
        first reading it is the mean.
        """
        last, mean = [], []
        for block in (self.blocks[e] for e in episodes):
            whole = self.logs[block.log].outputs
            read = whole[:, block.start : block.stop]
            means = np.nanmean(whole, axis=1, keepdims=True)
            begin = block.start + np.arange(read.shape[1]) // self.horizon * self.horizon
            last.append(read - _newest(whole, means)[:, begin])
            mean.append(read - means)
        return [last, mean]

    def _forecast(
        self, hypothesis: Hypothesis, values: Mapping[str, float], episodes: Sequence[int]
    ) -> list[FloatArray]:
        sets = {n: np.array([v]) for n, v in values.items()}
        with np.errstate(all="ignore"):
            return self.filter.forecasts(self.acting(hypothesis), sets, episodes, self.horizon)

    def coordinates(self, episode: int) -> dict[str, tuple[str, FloatArray]]:
        """Where a sample lies: time, inputs, and the states that outputs show."""
        block = self.blocks[episode]
        cut = slice(block.start, block.stop)
        coordinates: dict[str, tuple[str, FloatArray]] = {"time": ("s", self._time_s(block))}
        for i, stated in enumerate(self.system.inputs):
            coordinates[stated.name] = (stated.unit, self.logs[block.log].inputs[i, cut])
        states = self._starts[block.log].states
        for i, (name, unit) in enumerate(self.system.states.items()):
            if np.ptp(states[i]) > 0.0:
                coordinates[name] = (unit, states[i, cut])
        return coordinates

    def noise_time_s(self, fitted: Fit, channel: int) -> float:
        """The longest time for which errors may keep their sign: a forecast's length."""
        return self.horizon * self.dt_s

    def _scored(self, run: Run, place: int, episode: int) -> list[Score]:
        """One block's part of a run under each parameter set, one channel after another.

        Each channel has all samples of the block.
        """
        block = self.blocks[episode]
        n, m, sets = block.stop - block.start, len(self.channels), run.statistics.shape[3]
        statistics = np.zeros((sets, 4, m, n))
        statistics[:, 1] = 1.0
        for s in np.flatnonzero(run.pieces.block == place):
            inside = run.pieces.scored[:, s]
            at = run.pieces.sample[inside, s] - block.start
            statistics[..., at] = run.statistics[..., s][:, inside].transpose(3, 0, 2, 1)
        channels = tuple(slice(c * n, (c + 1) * n) for c in range(m))
        scores = []
        for one_set in statistics.reshape(sets, 4, m * n):
            # Copied: fits keep the scores of a few sets for long.
            innovation, variance, density, weight = one_set.copy()
            scores.append(Score(density, innovation, variance, weight, channels))
        return scores

    @functools.cached_property
    def _nuisances(self) -> tuple[Free, ...]:
        hidden = {f"constant.{name}" for name in self.unshown}
        return tuple(free for free in self._may_be_free() if free.name not in hidden)

    def _may_be_free(self) -> list[Free]:
        """Noise, clocks, constants and form, also of constants that no output shows."""
        system, sizes, driven, dt_s = self.system, self.sizes, self.driven, self.dt_s
        return [
            *sensor_noise(system, sizes),
            *pushes(system, sizes, driven, dt_s, is_pushed=self.is_pushed),
            *clocks(list(self._stamped_together()), dt_s),
            *constants(system),
            *form(system, sizes, driven, self.along_logs()),
        ]

    @functools.cached_property
    def unshown(self) -> set[str]:
        """Constants of unlimited spread that no output of the logs shows: they are not fitted."""
        return unshown(self, tuple(self._may_be_free()))

    def unknown_constants(self) -> dict[str, Quantity]:
        """What is stated of the constants that these logs say nothing of, in the system's order."""
        return {
            c.name: Quantity(value=c.value, unit=self.system.unit_of_constant(c.name))
            for c in self.system.constants
            if c.name in self.unshown
        }

    def _followed(
        self, known: Sequence[InitialStates], guessed: Sequence[FloatArray]
    ) -> list[FloatArray]:
        """States (n, N) along each log; the model gives those that nothing shows.

        A piece within a log starts from them, too: an actuator that starts again at 0 looks like a
        lag.
        """
        along = [n for n in self.system.states if n in known[0].along]
        if len(along) == len(self.system.states):
            return list(guessed)
        spread = np.zeros(len(self.system.states))
        alone = Filter(self.logs, (), [Start(g, spread) for g in guessed], self.driven)
        rows = {n: np.concatenate([k.along[n] for k in known]) for n in along}
        acting, correction = Acting(self.system, (), self.sizes), self.system.correction
        values = {} if correction is None else correction.values
        constants = {n: v for n, v in values.items() if n.startswith("constant.")}
        states = followed(alone, acting, rows, self.hidden, constants)
        ends = np.cumsum([log.outputs.shape[1] for log in self.logs])[:-1]
        return np.split(states, ends, axis=1)

    def rates_at(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """The rates (n, …) by the model at states (n, …) and inputs (i, …)."""
        state = Point("state", dict(zip(self.system.states, states, strict=True)))
        names = [i.name for i in self.system.inputs]
        driven = Point("input", dict(zip(names, inputs, strict=True)))
        with np.errstate(all="ignore"):
            returned = self.system.rates(state, driven, self.system.values())
        rates = np.array([np.broadcast_to(v, states.shape[1:]) for v in returned.values()])
        return (rates - states) / self.dt_s if self.system.has_step else rates

    def _driven(self) -> tuple[str, ...]:
        """States with noisy rates: all but integrals, memories and those said to be exact."""
        stated = self.system.process_noise
        exact = {n for n, size in stated.items() if size == 0.0}
        exact |= {*self._kinematic, *self.system.geometric()}
        acted_on = {p.name for p in self.system.ports if p.role in ("force", "custom")}
        acted_on |= {name for port in self.system.ports for name in port.speeds}
        kept = exact | {n for n in self.system.remembered() if n not in {*stated, *acted_on}}
        # A model that is nothing but memory has its noise there.
        return tuple(n for n in self.system.states if n not in kept) or tuple(
            n for n in self.system.states if n not in exact
        )

    def _start_spread(self) -> FloatArray:
        stated = self.system.start_spread
        return np.array([stated.get(n, self.sizes[n]) for n in self.system.states], dtype=float)

    def _time_s(self, block: Block) -> FloatArray:
        return np.asarray(self.dt_s * np.arange(block.start, block.stop), dtype=np.float64)

    def _record(self, block: Block) -> Record:
        cut = slice(block.start, block.stop)
        return Record(block.name, self._time_s(block), self.logs[block.log].outputs[:, cut])


def _newest(read: FloatArray, before: FloatArray) -> FloatArray:
    """The newest measured reading (m, n) at each sample; `before` (m, 1) until there is one."""
    at = np.where(np.isfinite(read), np.arange(read.shape[1]), -1)
    newest = np.maximum.accumulate(at, axis=1)
    known = np.take_along_axis(read, np.maximum(newest, 0), axis=1)
    return np.where(newest >= 0, known, before)
