"""What a system states: inputs, states, outputs, constants, ports; and its functions, called.

In: a class derived from `own_system.System`. Out: what the likelihood asks of it. The class's
functions are written for one point; they are called with arrays whose leading axes are batches, so
they use numpy alone.
"""

import functools
import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.units import unit_at_end, unit_of
from wakedeploy.gap.systems.calls import called, complete
from wakedeploy.gap.systems.ports import DIFFERENCE, Point, Port
from wakedeploy.gap.systems.trial_points import bearable, limits_of, split

if TYPE_CHECKING:
    from wakedeploy.gap.search.artefacts import Answer
    from wakedeploy.gap.systems.correction import Correction

FloatArray = npt.NDArray[np.float64]
Law = Callable[[Point], Any]

_FARTHEST = 1e3  # how many times its value a constant without bounds may become
_ANYWHERE = (-math.inf, math.inf)
_SIZES, _POINTS = 10.0 ** np.arange(-1, 7), 20  # of inputs at which a law is tried, and how many


@dataclass(frozen=True)
class Input:
    """A logged column that drives the system, or what a law makes of such columns.

    `hold` says what the input does between two samples: "step" keeps the older one, as a digital
    controller does; "linear" goes straight to the next, as a sampled signal does;
    "bandlimited" is for one that was filtered before it was sampled, as by most recorders. `unit`
    is one of the project's, "" for none; a log's column (T,) is converted to it. `low` and `high`
    are limits that `gap plan` keeps to, without them those of the logs; the model need not give
    numbers beyond them. With `is_commanded=False` nobody can command it, as a battery's voltage
    that is measured: `gap plan` leaves it at its logged mean. `delay_s` is by how much later than
    its row it acts, as far as that is known; until then a log's first value does. A name or a unit
    that is not known, limits in the wrong order and a delay below 0 raise UnusableInput when the
    system is loaded.

    `law(inputs)` computes the input, in `unit`, from the logged ones: a thrust that goes with the
    square of a pulse. These are numbers or arrays of one shape, which it returns and does not write
    into. It is no column of a log then. What acts behind the law, as the lag of a motor, acts at
    its port. It has neither a hold nor limits of its own: those are stated of what is logged; its
    `delay_s` comes on top of theirs. A law that fails, or gives no numbers, raises UnusableInput by
    its name.
    """

    name: str
    unit: str
    hold: str = "step"
    low: float | None = None
    high: float | None = None
    is_commanded: bool = True
    delay_s: float = 0.0
    law: Law | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class Output:
    """A logged column (T,) that the system predicts, in `unit`.

    `noise` is the sensor's standard deviation in that unit, a first guess. A negative one raises
    UnusableInput when the system is loaded.
    """

    name: str
    unit: str
    noise: float | None = None


@dataclass(frozen=True)
class Constant:
    """A number of the model: `value`, known to a standard deviation of `spread`, in the same unit.

    A spread of 0 is a constant that is known; it is not fitted. An infinite one is a constant that
    nobody has measured. Without `low` and `high` a constant keeps its sign. All are in `unit`, and
    single numbers; a fit that tries N of them at once gives the system's functions arrays (N,).
    Bounds that do not hold the value raise UnusableInput when the system is loaded.
    """

    name: str
    value: float
    spread: float = 0.0
    unit: str = ""
    low: float | None = None
    high: float | None = None

    @property
    def keeps_sign(self) -> bool:
        """Whether a fit may not turn it round: it is not 0, and states no bounds."""
        return self.value != 0.0 and self.low is None and self.high is None

    @property
    def bounds(self) -> tuple[float, float]:
        """The lowest and the highest value that a fit may give it."""
        ends = sorted((self.value / _FARTHEST, self.value * _FARTHEST))
        if self.value == 0.0:
            reach = _FARTHEST * (self.spread if 0.0 < self.spread < math.inf else 1e3)
            ends = [-reach, reach]
        low = ends[0] if self.low is None else self.low
        return low, ends[1] if self.high is None else self.high


class Forces(dict[str, Any]):
    """Forces at ports by the states that they act on: `forces.speed_mps`, 0 where nothing acts.

    `forces["speed_mps"]` is the same. A state without a force port is an error by name.
    """

    def __init__(self, acting: Mapping[str, Any], ports: Sequence[str]) -> None:
        super().__init__(acting)
        self._ports = ports

    def __missing__(self, name: str) -> Any:
        if name in self._ports:
            return 0.0
        known = ", ".join(self._ports) or "none"
        raise KeyError(f"force at {name!r} is not there; there are ports at: {known}")

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None


class StateSpace:
    """What a user's system states, and what its functions give.

    `own_system.System` is the class that users derive from: it says what each attribute means and
    which functions there are. Values are in the units that the class states; each is a number, or
    (N,) where N points are tried at once. What a function of the user does wrong raises
    UnusableInput by the name of method, state and point.
    """

    rate_hz: ClassVar[float]
    inputs: ClassVar[Sequence[Input]]
    states: ClassVar[Mapping[str, str]]
    outputs: ClassVar[Sequence[Output]]
    constants: ClassVar[Sequence[Constant]] = ()
    ports: ClassVar[Sequence[Port]] = ()
    process_noise: ClassVar[Mapping[str, float]] = {}
    start_spread: ClassVar[Mapping[str, float]] = {}
    outlier_share: ClassVar[float] = 0.0
    forecast_s: ClassVar[float | None] = None
    steps: ClassVar[int] = 1
    costs_by_point: ClassVar[bool] = False
    exported: ClassVar[Sequence[str]] = ()

    correction: "Correction | None" = None

    def __repr__(self) -> str:
        """Its name and what goes in and out."""
        inputs, outputs = (", ".join(x.name for x in some) for some in (self.logged, self.outputs))
        return f"{self.name}({inputs} -> {outputs}; {len(self.states)} states)"

    def export(self, answer: "Answer", out: Path) -> list[str]:
        """Write what `gap name` found in further formats; none unless overridden.

        `answer` is the artefact that name.json holds. Returns a sentence for each file in the
        folder `out`; their names stand in `exported`.
        """
        return []

    @property
    def unheard(self) -> int:
        """Samples of a log in which an input acts that came before it, and that nobody knows."""
        logged_s = max((i.delay_s for i in self.logged), default=0.0)
        behind_s = max((i.delay_s for i in self.inputs if i.law), default=0.0)
        return math.ceil(self.rate_hz * (logged_s + behind_s) - 1e-9)

    @property
    def logged(self) -> tuple[Input, ...]:
        """The inputs that are columns of a log."""
        return tuple(i for i in self.inputs if i.law is None)

    @functools.cached_property
    def made_of(self) -> dict[str, tuple[str, ...]]:
        """The logged inputs that each input with a law depends on.

        Numbers of many sizes are tried: a law may be flat about 0, as one with a dead zone is.
        """
        points, others = self._points_of_laws(2), self._points_of_laws(3)
        found = {}
        for stated in (i for i in self.inputs if i.law):
            usual = self.made(stated, points)
            found[stated.name] = tuple(
                name
                for name in points
                if not np.array_equal(
                    self.made(stated, points | {name: others[name]}), usual, equal_nan=True
                )
            )
        return found

    def _points_of_laws(self, seed: int) -> dict[str, FloatArray]:
        """Logged inputs (N,) of every size, of either sign, and within their limits."""
        rng = np.random.default_rng(seed)
        sizes = np.repeat(_SIZES, _POINTS)
        found = {}
        for stated in self.logged:
            low = -1.0 if stated.low is None else stated.low
            high = max(low, 1.0) if stated.high is None else stated.high
            within = rng.uniform(min(low, high), high, _POINTS)
            found[stated.name] = np.concatenate(
                [sizes * rng.uniform(-1.0, 1.0, len(sizes)), within]
            )
        return found

    def clocked(self, name: str, shared: Mapping[str, str]) -> str:
        """The input whose clock one has, "" for none.

        Its own, or the one that is `shared` with it in logs. A law has that of its sources, if it
        is one.
        """
        clocks = {shared.get(n, n) for n in self.made_of.get(name, (name,))}
        return clocks.pop() if len(clocks) == 1 else ""

    def made(self, stated: Input, logged: Mapping[str, FloatArray]) -> FloatArray:
        """What the law of an input makes of logged ones, of their shape."""
        where, law = f"{self.name}: the law of {stated.name!r}", stated.law
        assert law is not None
        with np.errstate(all="ignore"):
            given = called(where, lambda p: {stated.name: law(p)}, Point("input", logged))
        return np.asarray(given[stated.name], dtype=float)

    def log_notes(self, outputs: Mapping[str, FloatArray]) -> list[str]:
        """Sentences about what logs show of this system; none unless overridden.

        `gap check` says them, and every search before it begins. `outputs` (N,) by name are all
        samples of all logs, NaN where nothing was measured.
        """
        return []

    def geometric(self) -> tuple[str, ...]:
        """States whose rates are geometry, which nothing disturbs; none unless overridden."""
        return ()

    def start(self, measured: Point) -> Mapping[str, Any]:
        """States at the first sample that the outputs do not show; none unless overridden."""
        return {}

    @property
    def has_step(self) -> bool:
        """Whether the model is discrete."""
        return hasattr(self, "step")

    @property
    def step_s(self) -> float:
        """How long one of the model's steps is."""
        return 1.0 / float(self.rate_hz * self.steps)

    @property
    def takes_forces(self) -> bool:
        """Whether it has a `derivative_under`, which lets forces at ports act as in a mechanism."""
        return hasattr(self, "derivative_under")

    def distributes(self, port: Port) -> bool:
        """Whether `rates` takes the force at a port: by `derivative_under`, or like an input."""
        return self.takes_forces or bool(port.like)

    @functools.cached_property
    def _inputs_of_forces(self) -> dict[str, tuple[str, float]]:
        """The input that the force on each speed acts like, and the sign, by the speed."""
        return {p.name: (p.acts_like, p.sign) for p in self.ports if p.like}

    @property
    def name(self) -> str:
        """What the user called the class."""
        return type(self).__name__

    def constant(self, name: str) -> Constant:
        """A constant by name; UnusableInput for one that is not stated."""
        for constant in self.constants:
            if constant.name == name:
                return constant
        known = ", ".join(c.name for c in self.constants) or "none"
        raise UnusableInput(f"{self.name}: no constant {name!r}; there are: {known}.")

    def point(self, what: str, values: Mapping[str, Any]) -> Point:
        """Values as a user's function gets them."""
        return Point(what, values)

    def values(self, constants: Mapping[str, Any] | None = None) -> Point:
        """The constants, some of them replaced."""
        stated = {c.name: c.value for c in self.constants}
        return Point("constant", stated | dict(constants or {}))

    def unit_of_state(self, name: str) -> str:
        """The unit of a state, or of the difference of two: that of the second."""
        return self.states[name.split(DIFFERENCE)[-1]]

    def unit_of_constant(self, name: str) -> str:
        """As stated, or the one that the constant's name ends in."""
        return self.constant(name).unit or unit_at_end(name) or unit_of(name) or "1"

    def kinematic(self) -> dict[str, str]:
        """States that are the derivative of another, by that other: {"position": "speed"}."""
        if self.has_step:
            return {}
        tried, rates = self._probed()
        return {
            name: other
            for name in self.states
            for other in self.states
            if name != other and np.array_equal(rates[name], tried[other])
        }

    def shown_states(self) -> dict[str, str]:
        """The states that outputs show as they are, by the output's name."""
        tried, _ = self._probed()
        shown = {n: np.broadcast_to(np.asarray(v, dtype=float), 20)
                 for n, v in self._shown(tried).items()}  # fmt: skip
        return {
            name: state
            for name, values in shown.items()
            for state in self.states
            if np.array_equal(values, tried[state])
        }

    def is_shown_without(self, output: str, others: Container[str] = ()) -> bool:
        """Whether each state that an output shows has an output of its own, but for some others.

        A position and its speed show each other.
        """
        reads = self._read_by_outputs
        alone = [s for n, s in reads.items() if n != output and n not in others and len(s) == 1]
        known: set[str] = set().union(*alone)
        pairs = self.kinematic().items()
        known |= {a for a, b in pairs if b in known} | {b for a, b in pairs if a in known}
        return bool(reads[output]) and reads[output] <= known

    @functools.cached_property
    def _read_by_outputs(self) -> dict[str, set[str]]:
        """The states on which each output's reading depends."""
        plain = self._shown(self._probed()[0])
        found: dict[str, set[str]] = {name: set() for name in plain}
        for state in self.states:
            for name, moved in self._shown(self._probed(state)[0]).items():
                if not np.array_equal(moved, plain[name], equal_nan=True):
                    found[name].add(state)
        return found

    def shown_afar(self) -> dict[str, FloatArray]:
        """What sensors show at states of either sign, however large, (20,) by the output's name.

        {} for functions that do not bear such states.
        """
        try:
            tried, _ = self._probed(far=True)
            with np.errstate(all="ignore"):
                shown = self._shown(tried)
        except UnusableInput:
            return {}
        return {n: np.broadcast_to(np.asarray(v, dtype=float), 20) for n, v in shown.items()}

    def remembered(self) -> dict[str, str]:
        """States of a discrete system that are a state or an input of the step before, by that.

        They are so at large values of either sign, too, and whatever the constants are: a gain of 1
        or a limit remembers nothing.
        """
        if not self.has_step:
            return {}
        try:
            each = [self._probed(), self._probed(far=True)]
        except UnusableInput:  # a user's function need not work that far away
            return {}
        return {
            name: other
            for name in self.states
            for other in each[0][0]
            if name != other and all(np.array_equal(after[name], now[other]) for now, after in each)
        }

    def drivers(self, state: str) -> set[str]:
        """The inputs and states on which a state's derivative depends, through laws, too."""
        found = self.uses(state)
        return found.union(*(self.made_of[name] for name in found & {*self.made_of}))

    def uses(self, state: str) -> set[str]:
        """The inputs and states that a state's derivative itself reads."""
        tried, rates = self._probed()
        return {
            name
            for name in tried
            if not np.array_equal(self._probed(name)[1][state], rates[state], equal_nan=True)
        }

    def reached_from(self, state: str) -> set[str]:
        """The states that one drives, itself and through others."""
        drives = {name: self.uses(name) for name in self.states}
        found = {state}
        while more := {n for n, by in drives.items() if n not in found and by & found}:
            found |= more
        return found

    @functools.cached_property
    def direct_outputs(self) -> set[str]:
        """The outputs that an input changes at once, as a rate gyro of a car that is steered."""
        found = set[str]()
        for stated in self.inputs:
            shown = [self._shown(self._probed(moved)[0]) for moved in ("", stated.name)]
            found |= {
                n for n, v in shown[0].items() if not np.array_equal(v, shown[1][n], equal_nan=True)
            }
        return found

    def _shown(self, tried: Mapping[str, FloatArray]) -> dict[str, Any]:
        """What the sensors would show at states and inputs."""
        return self.readings(*split(self, tried), self.values())

    def probed(self) -> dict[str, FloatArray]:
        """What the functions give at some points: a fingerprint of what they compute."""
        tried, found = self._probed()
        state, inputs = split(self, tried)
        each: list[tuple[str, Mapping[str, Any]]]
        each = [("measure", self._shown(tried))]
        each += [
            (p.name, self.added(p, p.increments, 0.0, state, inputs, 1.0))
            for p in self.ports
            if p.function
        ]
        for what, values in each:
            for name, value in values.items():
                found[f"{what} {name}"] = np.broadcast_to(np.asarray(value, dtype=float), 20)
        points = self._points_of_laws(2)
        found |= {f"law {i.name}": self.made(i, points) for i in self.inputs if i.law}
        return found

    def _probed(
        self, moved: str = "", far: bool = False
    ) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Random states and inputs, and the derivatives there; one of them moved away.

        Those that are `far` have either sign, and constants another value.
        """
        tried = self._random(-1e6, 1e6) if far else dict(self._ordinary)
        constants = {c.name: 1.1 * c.value + 0.01 for c in self.constants} if far else {}
        if moved:
            low, high = {i.name: limits_of(i) for i in self.inputs}.get(moved, _ANYWHERE)
            far_off = min(0.5, 0.5 * (high - low))
            there = tried[moved]
            tried[moved] = there + np.where(there + far_off <= high, far_off, -far_off)
        with np.errstate(all="ignore"):
            rates = self.rates(*split(self, tried), self.values(constants))
        return tried, {n: np.broadcast_to(np.asarray(v, dtype=float), 20) for n, v in rates.items()}

    @functools.cached_property
    def _ordinary(self) -> dict[str, FloatArray]:
        """Random states and inputs (20,) below 1, or of a size that the system bears."""
        return bearable(self, self._random(0.1, 1.0))

    def _random(self, low: float, high: float) -> dict[str, FloatArray]:
        rng = np.random.default_rng(1)
        names = (*self.states, *(i.name for i in self.inputs))
        return {n: rng.uniform(low, high, 20) for n in names}

    def rates(
        self, state: Point, inputs: Point, c: Point, forces: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """What `derivative` or `step` returns, with what fails in it said by name.

        `forces` by the states of the ports that the system `distributes`.
        """
        method = "step" if self.has_step else "derivative"
        given: list[Mapping[str, Any] | Point] = [state, inputs, c]
        if forces is not None and hasattr(self, "derivative_under"):
            ports = [port.name for port in self.ports if port.role == "force"]
            ports += [name for port in self.ports for name in port.speeds]
            method, given = "derivative_under", [*given, Forces(forces, ports)]
        elif forces:
            given[1] = self._with_forces(inputs, forces)
        returned = called(f"{self.name}.{method}", getattr(self, method), *given)
        return complete(returned, self.states, f"{self.name}.{method}", "state")

    def _with_forces(self, inputs: Point, forces: Mapping[str, Any]) -> Point:
        """The inputs, with more of those that forces act like."""
        values = {i.name: getattr(inputs, i.name) for i in self.inputs}
        for speed, (name, sign) in self._inputs_of_forces.items():
            values[name] = values[name] + sign * forces.get(speed, 0.0)
        return Point("input", values)

    def added(self, port: Port, function: Callable[..., Any], *given: Any) -> Mapping[str, Any]:
        """What an effect of the user's own returns, with what fails in it said by its name."""
        return called(f"{self.name}: the effect {port.name!r}", function, *given)

    def first(self, measured: Point) -> dict[str, Any]:
        """What `start` returns, with what fails in it said by name."""
        where = f"{self.name}.start"
        returned = called(where, self.start, measured)
        for name in returned:
            if name not in self.states:
                raise UnusableInput(
                    f"{where} returns {name!r}, which is no state; there are: "
                    f"{', '.join(self.states)}."
                )
        return dict(returned)

    def readings(self, state: Point, inputs: Point, c: Point) -> dict[str, Any]:
        """What the sensors would show: `measure`, and states for outputs that it leaves out."""
        measured: dict[str, Any] = {}
        if hasattr(self, "measure"):
            measured = dict(called(f"{self.name}.measure", self.measure, state, inputs, c))
        shown = {o.name: getattr(state, o.name) for o in self.outputs if o.name in self.states}
        names = {o.name: o.unit for o in self.outputs}
        return complete(shown | measured, names, f"{self.name}.measure", "output")
