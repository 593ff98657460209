"""A system with effects that act: rates and readings of many points at once.

In: a `System`, effects of its library, and values of constants and parameters. The user's states
come first, then the effects' own. Arrays are (…, L): lanes are last, points before them.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.kinds.forces import AT_ONCE, At, DryFriction, ForceKind
from wakedeploy.gap.systems.kinds.inputs import InputKind, Saturation, shifted
from wakedeploy.gap.systems.kinds.library import Effect
from wakedeploy.gap.systems.kinds.sensors import ConstantKind, OutputKind, SensorSaturation
from wakedeploy.gap.systems.likelihood.blocks import made, parts_in_step
from wakedeploy.gap.systems.ports import Point, Port
from wakedeploy.gap.systems.system import Input, StateSpace
from wakedeploy.physics.kalman import bumped

Arrays = Mapping[str, Any]

BUMPS = (-1.5, -0.75, 0.0, 0.75, 1.5)  # of the model-form term, in usual sizes of the state
_BUMP_WIDTH = 0.75
_CENTRES = np.array(BUMPS)
_FARTHEST_BUMP = 6.0  # usual sizes; no bump reaches there
FORM_SD = 0.05  # of the model-form term, as a share of the rate
FORM_EACH = FORM_SD / 1.4  # of one bump: neighbours overlap
FORM_MOST = 2.0 * FORM_EACH  # long logs would outvote a prior


_OWN_CLOCKS: Mapping[str, str] = {}


class Acting:
    """A system and the effects of a hypothesis.

    `sizes` are usual sizes by name, `form` the states whose rate has a model-form term. `clocks`
    says by input whose clock it shares, where that is not its own.
    """

    def __init__(
        self,
        system: StateSpace,
        effects: Sequence[Effect],
        sizes: Mapping[str, float],
        form: Sequence[str] = (),
        clocks: Mapping[str, str] = _OWN_CLOCKS,
    ) -> None:
        self.system, self.effects, self.sizes, self.form = system, tuple(effects), sizes, form
        self._clocks = clocks
        # Looked up once: the functions below are called in every step.
        self._has_step = system.has_step
        # What a rate is multiplied by to be added to what the system returns.
        self._dt_s = 1.0 / system.rate_hz if system.has_step else 1.0
        self.states = (*system.states, *(n for e in effects for n in e.own_states))
        self._of = {
            role: [e for e in effects if e.port.role == role]
            for role in ("input", "force", "between", "output", "constant", "custom")
        }
        # A limit on a reading acts last: readings are cut with whatever else is wrong with them.
        self._of["output"].sort(key=lambda e: isinstance(e.kind, SensorSaturation))
        # A limit on a command acts first, so that one beyond all commands does nothing.
        self._of["input"].sort(key=lambda e: not isinstance(e.kind, Saturation))
        self._dry = [e for e in self._of["force"] if isinstance(e.kind, DryFriction)]
        self._smooth = [e for e in self._of["force"] if e not in self._dry]
        self._smooth += self._of["between"]
        self._given = [e for e in self._smooth if system.distributes(e.port)]
        self._beside = [e for e in self._smooth if e not in self._given]
        self.remembers = any(e.own_states for e in self._smooth)
        self._known = {p.name: p for p in system.ports if p.friction}
        ports = dict.fromkeys([*self._known, *(e.port.name for e in self._dry)])
        self.dry = [self.states.index(name) for name in ports]  # speeds that it acts on
        self._constants = {c.name: c.value for c in system.constants}
        self._inputs = {i.name: (place, i) for place, i in enumerate(system.inputs)}
        self._outputs = [o.name for o in system.outputs]
        late = {e.port.name for e in self._of["output"] if e.own_states}
        self.is_late = bool(late and late & system.direct_outputs)

    def column(self, name: str, driving: FloatArray, values: Arrays) -> FloatArray:
        """What of an input reaches the system in every step (2, n); `driving` is (i, n · parts).

        First its mean over each step, then how much more of it comes early in the step than late:
        the integral of (1/2 - s) u over the share s of the step. What comes early acts for longer.
        """
        parts = self.parts(name, driving, values)
        count = parts.shape[1]
        early = (0.5 - (np.arange(count) + 0.5) / count) / count
        return np.array([parts.mean(1), (parts - parts[:, :1]) @ early])

    def parts(self, name: str, driving: FloatArray, values: Arrays) -> FloatArray:
        """The same in the parts of each step, (n, parts): effects act between samples, too."""
        return self._affected(name, driving, values).reshape(-1, parts_in_step(self.system))

    def _affected(self, name: str, driving: FloatArray, values: Arrays) -> FloatArray:
        """An input (n · parts,) after all that acts on it, and on the inputs of its law."""
        count = parts_in_step(self.system)
        step_s, in_sample = self.system.step_s / count, count * self.system.steps
        place, stated = self._inputs[name]
        column = driving[place] if stated.law is None else self._made(stated, driving, values)
        for effect in self._of["input"]:
            if effect.port.name == name:
                kind = effect.kind
                assert isinstance(kind, InputKind)
                p = effect.parameters(values)
                if kind.by_sample:
                    samples = column.reshape(-1, in_sample).mean(1)
                    held = kind.filtered(samples, p, in_sample * step_s)
                    column = np.repeat(held, in_sample)
                else:
                    column = kind.filtered(column, p, step_s)
        if stated.law is not None:
            return column  # what it is made of is shifted already
        return shifted(column, float(self._clock_s(name, values)) / step_s)

    def _made(self, stated: Input, driving: FloatArray, values: Arrays) -> FloatArray:
        """What a law makes of the logged inputs after all that acts on them."""
        logged = {i.name: self._affected(i.name, driving, values) for i in self.system.logged}
        return made(self.system, stated, logged)

    def depends(self, name: str) -> tuple[str, ...]:
        """The parameters that change an input's column."""
        acting = (e for e in self._of["input"] if e.port.name == name)
        parameters = tuple(f"{e.name}.{p.name}" for e in acting for p in e.kind.parameters)
        if self._inputs[name][1].law is None:
            return (self.clock(name), *parameters)
        before = (n for logged in self.system.logged for n in self.depends(logged.name))
        return (*before, *parameters)

    def _clock_s(self, name: str, values: Arrays) -> Any:
        """The time [s] by which an input acts later than its stamp."""
        return values.get(self.clock(name), 0.0)

    def clock(self, name: str) -> str:
        """The parameter by which an input acts later than its stamp."""
        return f"clock.{self.system.clocked(name, self._clocks)}"

    def formed(self, values: Arrays) -> dict[str, FloatArray]:
        """Sizes (B, L) of the bumps of each model-form term, from values (1, L) by name."""
        lanes = next(iter(values.values())).shape[1]
        none = np.zeros((1, lanes))
        return {
            f"form.{name}": np.vstack(
                [values.get(f"form.{name}.{k}", none) for k in range(len(BUMPS))]
            )
            for name in self.form
        }

    def constants(self, values: Arrays, time_s: FloatArray) -> Point:
        """Values of the constants, with the effects that act on them."""
        constants = {n: values.get(f"constant.{n}", v) for n, v in self._constants.items()}
        for effect in self._of["constant"]:
            kind, name = effect.kind, effect.port.name
            assert isinstance(kind, ConstantKind)
            constants[name] = kind.value(constants[name], time_s, effect.parameters(values))
        return Point("constant", constants)

    def rates(
        self,
        x: FloatArray,
        inputs: Arrays,
        c: Point,
        values: Arrays,
        time_s: FloatArray,
    ) -> FloatArray:
        """Derivatives (k, …) of states `x` (k, …), or the next states of a discrete system.

        Dry friction is left out: what it does follows from these rates, see `rubbed`.
        """
        named = dict(zip(self.states, x, strict=True))
        state = Point("state", {n: named[n] for n in self.system.states})
        own_rates: dict[str, Any] = {}
        inputs = self._arriving(inputs, named, values, time_s, own_rates)
        driven = Point("input", inputs)
        if self._given:
            rates = self._loaded(named, state, driven, c, values, own_rates)
        else:
            rates = self.system.rates(state, driven, c)
        base = dict(rates)
        for effect in self._beside:
            self._force(effect, named, base, inputs, c, values, rates, own_rates)
        for effect in self._of["custom"]:
            self._custom(effect, state, driven, values, time_s, rates)
        # A share of all that acts but dry friction, which bears what it has to. A share of the
        # system's own rate alone would let two forces that cancel give it a force of any size to
        # act on.
        for name in self.form:
            rates[name] = rates[name] + self._form(name, named, rates, values)
        if self._of["output"]:
            self._sensed(state, driven, c, values, named, own_rates)
        result = np.empty_like(x)
        for i, name in enumerate(self.states):
            result[i] = rates[name] if name in rates else own_rates[name]
        return result

    def correct_memories(
        self, x: FloatArray, rates: FloatArray, pushed: FloatArray, values: Arrays, step_s: float
    ) -> None:
        """Add to `rates` (k, …, L), in place, what memories lack of a step: `own_corrections`.

        `rates` at the state `x` (k, L) and lasting pushes on them, `pushed` (k, L), say how speeds
        change within the step, dry friction left out. What is added is the same at the points
        beside the state.
        """
        named = dict(zip(self.states, x, strict=True))
        for effect in self._smooth:
            kind = effect.kind
            if not effect.own_states or not isinstance(kind, ForceKind):
                continue
            port = effect.port
            rising = {
                name: rates[place, 0] + pushed[place]
                for name in port.speeds or (port.name,)
                for place in [self.states.index(name)]
            }
            faster = step_s * (
                port.ahead(rising, port.speeds) if port.speeds else rising[port.name]
            )
            given = self._at(effect, named, {}), faster, effect.parameters(values), step_s
            for name, rate in zip(effect.own_states, kind.own_corrections(*given), strict=True):
                rates[self.states.index(name)] += rate

    def rubbed(
        self, x: FloatArray, inputs: Arrays, c: Point, values: Arrays, time_s: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What dry friction can bear at states `x` (k, L), and what a unit of it changes.

        Returns strengths (q, L), speeds over which it turns (q, L), and changes (q, k, L) of every
        derivative or of the next states. Frictions on one speed count as one, as strong as all
        together.
        """
        count, lanes = len(self.dry), x.shape[1]
        if not count:
            none = np.zeros((0, lanes))
            return none, none, np.zeros((0, *x.shape))
        strengths, weighted = np.zeros((count, lanes)), np.zeros((count, lanes))
        answers, named = [], dict(zip(self.states, x[:, None], strict=True))
        for q, place in enumerate(self.dry):
            alike = [e for e in self._dry if e.port.name == self.states[place]]
            for bears, turning in self._strengths(
                self.states[place], alike, named, inputs, c, values
            ):
                strengths[q] += bears
                weighted[q] += bears * turning
            port = self._known.get(self.states[place]) or alike[0].port
            answers.append(self._answer(port, strengths[q], named, inputs, c))
        turnings = weighted / np.where(strengths > 0.0, strengths, 1.0)
        return strengths, turnings, np.array(answers).reshape(count, *x.shape)

    def _strengths(
        self,
        name: str,
        alike: Sequence[Effect],
        named: Arrays,
        inputs: Arrays,
        c: Point,
        values: Arrays,
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """What each friction on a speed bears, and the speed over which it turns, (L,) each."""
        port, still = self._known.get(name), 0.0 * named[name]
        if port is not None:
            strength = np.maximum(getattr(c, port.friction) + still, 0.0)
            yield strength[0], (AT_ONCE * self.sizes[name] + still)[0]
        for effect in alike:
            kind, at, p = effect.kind, self._at(effect, named, inputs), effect.parameters(values)
            assert isinstance(kind, DryFriction)
            yield kind.strength(at, p)[0], kind.turning(at, p)[0]

    def _answer(
        self, port: Port, strength: FloatArray, named: Arrays, inputs: Arrays, c: Point
    ) -> FloatArray:
        """How a unit of force at a port changes derivatives or next states (k, L)."""
        speed = named[port.name]
        changes = np.zeros((len(self.states), *speed.shape[1:]))
        if not strength.any():
            return changes
        if not self.system.distributes(port):
            inertia = getattr(c, port.inertia) if port.inertia else 1.0
            changes[self.states.index(port.name)] = self._dt_s / inertia
            if self._has_step and port.position:  # a derivative brings this by itself
                changes[self.states.index(port.position)] = 0.5 * self._dt_s**2 / inertia
            return changes
        state = Point("state", {n: named[n] for n in self.system.states})
        driven = Point("input", inputs)
        # At full strength: the answer may depend on it where the system has limits of its own.
        force = np.where(speed > 0.0, -1.0, 1.0) * np.where(strength > 0.0, strength, 1.0)
        free, pushed = (
            self.system.rates(state, driven, c, {port.name: f}) for f in (0.0 * force, force)
        )
        for name, rise in free.items():
            changes[self.states.index(name)] = ((pushed[name] - rise) / force)[0]
        return changes

    def readings(
        self,
        x: FloatArray,
        inputs: Arrays,
        c: Point,
        values: Arrays,
        time_s: FloatArray,
        measured: tuple[FloatArray, FloatArray] | None = None,
        before: Arrays | None = None,
    ) -> FloatArray:
        """What the sensors show (m, …); near `measured` and its sd, (m, L) each, if that is given.

        `before` are the inputs of the step before, where `is_late`: a lagging sensor has not yet
        seen an output jump with its input.
        """
        named = dict(zip(self.states, x, strict=True))
        readings = self._plain(inputs, named, c, values, time_s)
        seen = self._plain(before, named, c, values, time_s) if before else dict(readings)
        for effect in self._of["output"]:
            kind, name = effect.kind, effect.port.name
            assert isinstance(kind, OutputKind)
            given = (tuple(named[n] for n in effect.own_states), time_s, effect.parameters(values))
            if effect.own_states and before:
                jump = kind.at_once(given[2], self.system.step_s) * (readings[name] - seen[name])
                seen[name] = kind.reading(seen[name], *given)
                readings[name] = seen[name] + jump
                continue
            if before:
                seen[name] = kind.reading(seen[name], *given)
            if measured is None:
                readings[name] = kind.reading(readings[name], *given)
                continue
            logged, sd = (row[self._outputs.index(name)] for row in measured)
            readings[name] = kind.reading_near(readings[name], *given, logged, sd)
        result = np.empty((len(readings), *x.shape[1:]))
        for i, value in enumerate(readings.values()):
            result[i] = value
        return result

    def _plain(
        self, inputs: Arrays, named: Arrays, c: Point, values: Arrays, time_s: FloatArray
    ) -> dict[str, Any]:
        """Readings before any effect of a sensor."""
        state = Point("state", {n: named[n] for n in self.system.states})
        inputs = self._arriving(inputs, named, values, time_s, {})
        return self.system.readings(state, Point("input", inputs), c)

    def _arriving(
        self,
        inputs: Arrays,
        named: Arrays,
        values: Arrays,
        time_s: FloatArray,
        own_rates: dict[str, Any],
    ) -> Arrays:
        """Inputs with what reaches the system from before the log; also fills the rates of that.

        An input's effects are a chain: what was on its way in one effect does not pass through
        those after it, except for a law.
        """
        late: dict[str, Any] = {}
        dt_s = 1.0 / self.system.rate_hz
        for effect in self._of["input"]:
            if effect.own_states:
                kind, mine = effect.kind, tuple(named[n] for n in effect.own_states)
                assert isinstance(kind, InputKind)
                p = effect.parameters(values)
                rates = kind.own_rates(mine, p, dt_s, self._has_step)
                for name, rate in zip(effect.own_states, rates, strict=True):
                    own_rates[name] = self._advanced(named[name], rate)
                name = effect.port.name
                since_s = time_s - self._clock_s(name, values)
                late[name] = late.get(name, 0.0) + kind.from_before(mine, since_s, p, dt_s)
        for stated in self._made_later(late):
            logged = {i.name: inputs[i.name] for i in self.system.logged}
            then = {n: u + late.get(n, 0.0) for n, u in logged.items()}
            more = self.system.made(stated, then) - self.system.made(stated, logged)
            late[stated.name] = late.get(stated.name, 0.0) + more
        return {**inputs, **{name: inputs[name] + more for name, more in late.items()}}

    def _made_later(self, late: Arrays) -> list[Input]:
        """Inputs whose law passes on what reaches logged inputs from before the log."""
        made_of = self.system.made_of if late else {}
        return [i for i in self.system.inputs if {*made_of.get(i.name, ())} & {*late}]

    def _base(self, name: str, named: Arrays, rates: Arrays) -> Any:
        """The rate of a state, from rates or from next states."""
        if self._has_step:
            return (rates[name] - named[name]) / self._dt_s
        return rates[name]

    def _form(self, name: str, named: Arrays, rates: Arrays, values: Arrays) -> Any:
        """A small smooth share of the rate, over the state itself; its sizes come from `formed`."""
        at = named[name] / self.sizes[name]
        sizes = values.get(f"form.{name}")
        if sizes is None:
            return 0.0
        flat = at.reshape(-1, at.shape[-1])
        share = bumped(flat, sizes, _CENTRES, _BUMP_WIDTH, _FARTHEST_BUMP).reshape(at.shape)
        return self._dt_s * share * self._base(name, named, rates)

    def _force(
        self,
        effect: Effect,
        named: Arrays,
        base: Arrays,
        inputs: Arrays,
        c: Point,
        values: Arrays,
        rates: dict[str, Any],
        own_rates: dict[str, Any],
    ) -> None:
        port = effect.port
        inertia = getattr(c, port.inertia) if port.inertia else 1.0
        force = self._pull(effect, named, base, inputs, inertia, values, own_rates)
        for k, (name, share) in enumerate(_shares(port)):
            over = getattr(c, port.inertias[k]) if port.inertias else inertia
            rates[name] = rates[name] + share * force / over * self._dt_s

    def _loaded(
        self,
        named: Arrays,
        state: Point,
        driven: Point,
        c: Point,
        values: Arrays,
        own_rates: dict[str, Any],
    ) -> dict[str, Any]:
        """Rates of a system that distributes forces itself, under the forces of the effects."""
        effects = self._given
        asks = any(e.kind.needs == ("inertia",) for e in effects)
        base = self.system.rates(state, driven, c) if asks else {}
        inputs = {i.name: getattr(driven, i.name) for i in self.system.inputs}
        forces: dict[str, Any] = {}
        for effect in effects:
            inertia = getattr(c, effect.port.inertia) if effect.port.inertia else 1.0
            pull = self._pull(effect, named, base, inputs, inertia, values, own_rates)
            for name, share in _shares(effect.port):
                forces[name] = forces.get(name, 0.0) + share * pull
        return self.system.rates(state, driven, c, forces)

    def _pull(
        self,
        effect: Effect,
        named: Arrays,
        base: Arrays,
        inputs: Arrays,
        inertia: Any,
        values: Arrays,
        own_rates: dict[str, Any],
    ) -> Any:
        """The force of an effect; also fills the rates of its own states."""
        port, kind = effect.port, effect.kind
        assert isinstance(kind, ForceKind)
        force = self._base(port.name, named, base) * inertia if kind.needs == ("inertia",) else None
        at = self._at(effect, named, inputs, force)
        p = effect.parameters(values)
        for name, rate in zip(effect.own_states, kind.own_rates(at, p), strict=True):
            own_rates[name] = self._advanced(named[name], rate)
        return kind.force(at, p)

    def _at(self, effect: Effect, named: Arrays, inputs: Arrays, force: Any = None) -> At:
        port = effect.port
        if port.speeds:
            speed = port.ahead(named, port.speeds)
            position = port.ahead(named, port.positions) if port.positions else speed
        else:
            speed = named[port.name]
            position = named.get(port.position, speed)
        return At(
            speed=speed,
            position=position,
            height=named.get(port.height, speed),
            force=speed if force is None else force,
            other={**named, **inputs}[effect.other] if effect.other else speed,
            own_states=tuple(named[n] for n in effect.own_states),
            sizes=effect.scales.sizes,
        )

    def _custom(
        self,
        effect: Effect,
        state: Point,
        inputs: Point,
        values: Arrays,
        time_s: FloatArray,
        rates: dict[str, Any],
    ) -> None:
        assert effect.port.function is not None
        p = Point("parameter", effect.parameters(values))
        added = self.system.added(effect.port, effect.port.function, time_s, state, inputs, p)
        for name, increment in added.items():
            rates[name] = rates[name] + increment

    def _sensed(
        self,
        state: Point,
        inputs: Point,
        c: Point,
        values: Arrays,
        named: Arrays,
        own_rates: dict[str, Any],
    ) -> None:
        """Rates of the sensors' own states."""
        shown = self.system.readings(state, inputs, c)
        for effect in self._of["output"]:
            kind = effect.kind
            assert isinstance(kind, OutputKind)
            mine = tuple(named[n] for n in effect.own_states)
            p = effect.parameters(values)
            rates = kind.own_rates(shown[effect.port.name], mine, p, self._dt_s, self._has_step)
            for name, rate in zip(effect.own_states, rates, strict=True):
                own_rates[name] = self._advanced(named[name], rate)

    def _advanced(self, value: Any, rate: Any) -> Any:
        return value + self._dt_s * rate if self._has_step else rate


def _shares(port: Port) -> list[tuple[str, float]]:
    """The speeds that a force at a port acts on, and how much of it acts there."""
    if not port.speeds:
        return [(port.name, 1.0)]
    first, second = port.speeds
    return [(first, 1.0 / port.ratio), (second, -1.0)]
