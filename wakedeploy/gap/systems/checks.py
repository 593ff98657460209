"""A user's system, checked by name and tried once.

In: a `System`. Out: the same, if what it states fits together and its functions give one number a
point; UnusableInput with one sentence else. A constant that may be on either side of 0 has bounds.
"""

import functools
import math
import numbers
from collections.abc import Callable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, TypeVar

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.units import same_unit
from wakedeploy.gap.systems.calls import called
from wakedeploy.gap.systems.kinds.library import kind_named
from wakedeploy.gap.systems.ports import Point, Port
from wakedeploy.gap.systems.statements import check_statements, is_unit, names_of
from wakedeploy.gap.systems.system import Constant, FloatArray, Input, StateSpace
from wakedeploy.gap.systems.trial_points import (
    at,
    bearable,
    function_name,
    is_number,
    limits_of,
    random_points,
    split,
)

_System = TypeVar("_System", bound=StateSpace)
Method = Callable[[Point, Point, Point], dict[str, Any]]
Evaluate = Callable[[Mapping[str, FloatArray]], dict[str, Any]]

_WIDEST = 3.0  # times its value: the largest spread of a constant that keeps its sign
_POINTS = 20  # at which a constant is tried on either side of 0
_MISTYPED = 0.92  # likeness of two names: `step_m`, which may be one's own, is less like `steps`
_FAR = 4.0  # spreads from its value: bounds of a constant whose spread lets it turn
# What a class states or may write anew; every other name of `StateSpace` is the library's own.
_FUNCTIONS = ("derivative", "derivative_under", "step", "measure", "start")
_OVERRIDDEN = ("geometric", "log_notes", "export")
_OPEN = {*StateSpace.__annotations__, *_FUNCTIONS, *_OVERRIDDEN} - {"correction"}


def checked(system: _System) -> _System:
    """The same system, if what it states fits together and its functions can be evaluated.

    A constant whose spread is more than three times its value may be on either side of 0, up to
    four spreads away, if the functions give numbers there.

    Raises UnusableInput as `require_sound` does.
    """
    vars(system)["constants"] = require_sound(system)
    return system


def require_sound(system: StateSpace) -> list[Constant]:
    """The system's constants with their bounds; nothing of the system is changed.

    Raises UnusableInput by name and in one sentence for what is missing, unknown, of the wrong
    shape or not finite.
    """
    _check_hidden_names(system)
    _check_mistyped_names(system)
    check_statements(system)
    _check_ports(system)
    _check_functions(system)
    return [_bounded(system, c) for c in system.constants]


def _bounded(system: StateSpace, c: Constant) -> Constant:
    """The constant, on either side of 0 where its spread says so and the system bears it.

    UnusableInput for what divides, or bears no other sign for another reason, as a mass.
    """
    if not (c.keeps_sign and _WIDEST * abs(c.value) < c.spread < math.inf):
        return c
    wide = replace(c, low=c.value - _FAR * c.spread, high=c.value + _FAR * c.spread)
    why = _unborne(system, wide)
    if not why:
        return wide
    raise UnusableInput(
        f"{system.name}: constant {c.name!r} is {c.value:g} with a spread of {c.spread:g}, "
        f"{c.spread / abs(c.value):.0f} times its value. It may then be 0 or have the other sign, "
        f"but {why}. Bound it with low and high, or state a smaller spread in the constant's unit: "
        f"spread={0.1 * abs(c.value):.2g} is 10 % of it. If nobody has measured it, write "
        'spread=float("inf").'
    )


def _unborne(system: StateSpace, c: Constant) -> str:
    """Why a constant cannot be 0, or as far to either side as it states; "" where it can."""
    for port in system.ports:
        if c.name in (port.inertia, port.friction, *port.inertias):
            what = "friction" if c.name == port.friction else "inertia"
            return f"it is the {what} of the port {port.name!r}"
    tried = bearable(system, random_points(system, (_POINTS,)))
    for method in (system.rates, system.readings):
        usual = is_number(system, method, tried, {})
        for value in (0.0, *c.bounds):
            if np.any(usual & ~is_number(system, method, tried, {c.name: value})):
                return f"{function_name(system, method)} gives no number where it is {value:.3g}"
    return ""


def _check_hidden_names(system: StateSpace) -> None:
    """UnusableInput where the user's class, or what else it derives from, hides the library's."""
    kinds = type(system).__mro__
    library = [kind for kind in kinds if kind.__module__.partition(".")[0] == "wakedeploy"]
    taken = {name for kind in library for name in vars(kind) if not name.startswith("__")} - _OPEN
    places: list[tuple[type, Mapping[str, Any]]]
    places = [(kind, vars(kind)) for kind in kinds if kind not in {*library, object}]
    # What the library keeps there itself, as a cached property, hides no function.
    functions = {n for kind in library for n, v in vars(kind).items() if callable(v)}
    places.append((type(system), {n: v for n, v in vars(system).items() if n in functions}))
    for kind, stated in places:
        for name in sorted(taken & stated.keys()):
            raise UnusableInput(
                f"{kind.__name__}.{name}: the library has `{name}` for its own use, and would get "
                f"yours. Call it otherwise, as `my_{name.lstrip('_')}`."
            )


def _check_mistyped_names(system: StateSpace) -> None:
    """UnusableInput for an attribute that is spelled much like one that may be stated, and is not.

    What a class keeps for itself under another name, its functions, and names with an underscore
    are its own.
    """
    kinds = [k for k in type(system).__mro__ if k.__module__.partition(".")[0] != "wakedeploy"]
    own = {n: v for kind in reversed(kinds[:-1]) for n, v in vars(kind).items()} | vars(system)
    stated = {n for n, v in own.items() if not callable(v) and not hasattr(v, "__get__")}
    missing = sorted(StateSpace.__annotations__.keys() - own.keys() - {"correction"})
    for name in sorted(stated - StateSpace.__annotations__.keys()):
        close = [] if name.startswith("_") else get_close_matches(name, missing, 1, _MISTYPED)
        if close:
            raise UnusableInput(
                f"{system.name}.{name} is nothing that a system states; did you mean "
                f"`{close[0]}`? A name of your own may begin with an underscore."
            )


def _check_ports(system: StateSpace) -> None:
    known = {
        "input": names_of(system.inputs),
        "force": tuple(system.states),
        "output": names_of(system.outputs),
        "constant": names_of(system.constants),
    }
    rubbing = [p.name for p in system.ports if p.friction]
    if twice := next((name for name in rubbing if rubbing.count(name) > 1), ""):
        raise UnusableInput(
            f"{system.name}: two ports state a friction of {twice!r}; add up what acts there in one"
            " constant."
        )
    for port in system.ports:
        wanted = [(port.role, port.name)] if port.role in known else []
        wanted += [("constant", n) for n in (port.inertia, port.friction, *port.inertias) if n]
        both = (*port.speeds, *port.positions) if port.speeds else (port.position,)
        wanted += [("force", n) for n in (*both, port.height) if n]
        wanted += [("input", port.acts_like)] if port.like else []
        for role, name in wanted:
            if name not in known[role]:
                thing = "state" if role == "force" else role
                raise UnusableInput(
                    f"{system.name}: a port names the {thing} {name!r}, which is not there; "
                    f"there are: {', '.join(known[role]) or 'none'}."
                )
        if port.like:
            _require_like_alone(system, port)
        if port.speeds:
            _check_between(system, port)
        if port.role == "custom" and not port.name.replace("-", "_").isidentifier():
            raise UnusableInput(
                f"{system.name}: an effect of your own is called {port.name!r}; use letters, "
                "digits, - and _."
            )
        _check_sizes(system, port)


def _check_between(system: StateSpace, port: Port) -> None:
    """UnusableInput where what two bodies state cannot be compared, or is that of one body."""
    where = f"{system.name}: the port between {port.speeds[0]!r} and {port.speeds[1]!r}"
    for what, pair in (("state", port.speeds), ("position", port.positions)):
        if pair and pair[0] == pair[1]:
            raise UnusableInput(
                f"{where} names one {what} for both; use Port.force for what acts on one body."
            )
    pairs = [frozenset(p.speeds) for p in system.ports if p.speeds]
    if pairs.count(frozenset(port.speeds)) > 1:
        raise UnusableInput(f"{where} is there twice; state it once, with the ratio that holds.")
    if any(p.like and p.name in port.speeds for p in system.ports):
        raise UnusableInput(
            f"{where} acts on speeds that move each other, as another port is like an input; write "
            "derivative_under, and leave out `like`."
        )
    if isinstance(port.ratio, bool) or not (
        isinstance(port.ratio, numbers.Real) and 0.0 < abs(float(port.ratio)) < math.inf
    ):
        raise UnusableInput(f"{where} has the ratio {port.ratio!r}; give a number but 0.")
    if port.unit and not is_unit(port.unit):
        raise UnusableInput(
            f"{where} has the unit {port.unit!r}, which is not known; give one such as N, N m or W."
        )
    for name in port.kinds:
        if not port.positions and "position" in kind_named(port, name).needs:
            raise UnusableInput(
                f"{where} is asked for {name!r}, which depends on how far one is ahead of the "
                "other; give the positions, too."
            )
    units = [[system.states[n] for n in pair] for pair in (port.speeds, port.positions) if pair]
    units.append([system.unit_of_constant(n) for n in port.inertias] or ["1", "1"])
    for first, second in units:
        if abs(port.ratio) == 1.0 and not same_unit(first, second):
            raise UnusableInput(
                f"{where} compares {first} with {second}; state both in one unit, or the ratio of "
                "the transmission: how far the first goes while the second goes one."
            )


def _check_positions(system: StateSpace, port: Port) -> None:
    """UnusableInput where the positions between two bodies are not those that its speeds move."""
    moved = system.kinematic()
    for position, speed in zip(port.positions, port.speeds, strict=True):
        if moved.get(position, speed) != speed:
            raise UnusableInput(
                f"{system.name}: the port between {port.speeds[0]!r} and {port.speeds[1]!r} has the"
                f" position {position!r} beside {speed!r}, but its rate is {moved[position]!r}; "
                "give the positions in the order of the speeds."
            )


def _require_like_alone(system: StateSpace, port: Port) -> None:
    """Refuse beside an input that a force acts like what says otherwise how it acts."""
    where = f"{system.name}: the port {port.name!r} is like {port.like!r}"
    if hasattr(system, "derivative_under"):
        raise UnusableInput(
            f"{where}, and there is a derivative_under, which says how forces act; drop one of "
            "them."
        )
    for what, stated in (("inertia", port.inertia), ("unit", port.unit)):
        if stated:
            raise UnusableInput(
                f"{where}: its force is in that input's unit and acts as that does; leave out "
                f"{what}={stated!r}."
            )
    if sum(p.role == "force" and p.name == port.name for p in system.ports) > 1:
        raise UnusableInput(
            f"{where}, and another port acts at {port.name!r}, too; state one, with the position "
            "that most depends on."
        )
    if port.friction:
        unit = next(i.unit for i in system.inputs if i.name == port.acts_like)
        known = system.unit_of_constant(port.friction)
        if known != "1" and not same_unit(known, unit):
            raise UnusableInput(
                f"{where}, in {unit}, and its friction {port.friction!r} is in {known}; state it "
                "in the input's unit."
            )


def _check_sizes(system: StateSpace, port: Port) -> None:
    """Refuse a name both parameter and shape, a custom effect without parameters, and bad sizes."""
    if both := sorted({*port.parameters} & {*port.shapes}):
        raise UnusableInput(
            f"{system.name}: the effect {port.name!r} has {both[0]!r} as a parameter and as a "
            "shape; state it once: a shape if the effect does not vanish with it."
        )
    if port.role == "custom" and not port.parameters:
        raise UnusableInput(
            f"{system.name}: the effect {port.name!r} has no parameter at which it vanishes; state "
            "its size as one."
        )
    for name, given in (*port.parameters.items(), *port.shapes.items()):
        if not isinstance(given, (tuple, list)) or len(given) != 2:
            raise UnusableInput(
                f"{system.name}: {name!r} of the effect {port.name!r} is {given!r:.60}; give its "
                'unit and a usual size, as ("N", 0.1).'
            )
        unit, size = given
        if not is_unit(unit):
            raise UnusableInput(
                f"{system.name}: {name!r} of the effect {port.name!r} has the unit {unit!r}, which "
                'is not known; give one such as N, m or 1/s, "1" for none.'
            )
        if not isinstance(size, (int, float)) or not 0.0 < size < math.inf:
            raise UnusableInput(
                f"{system.name}: {name!r} of the effect {port.name!r} has the usual size {size!r}; "
                "give a positive number."
            )


def _check_functions(system: StateSpace) -> None:
    """One point, then a batch of the same points: both have to give the same numbers."""
    shape = (3, 5)
    tried = random_points(system, shape)
    tried = {n: np.where(np.arange(15).reshape(shape) == 0, 0.0, v) for n, v in tried.items()}
    tried = bearable(system, tried)
    for stated in system.inputs:
        if stated.law is not None:
            _check_made(system, stated, {i.name: tried[i.name] for i in system.logged})
    for method in (system.rates, system.readings):
        evaluate = functools.partial(at, system, method, constants={})
        _check_points(function_name(system, method), evaluate, tried)
    state, inputs = split(system, tried)
    if hasattr(system, "derivative_under") and not system.has_step:
        _check_forces(system, state, inputs)
    for port in system.ports:
        if port.like:
            _check_like(system, port)
        if port.positions:
            _check_positions(system, port)
    for port in system.ports:
        if port.function is not None:
            _check_custom(system, port, state, inputs, shape)


def _check_made(system: StateSpace, stated: Input, logged: dict[str, FloatArray]) -> None:
    """What a law makes of logged inputs, and that it is made of any."""
    where = f"{system.name}: the law of {stated.name!r}"

    def evaluate(logged: Mapping[str, FloatArray]) -> dict[str, Any]:
        return {stated.name: system.made(stated, logged)}

    _check_points(where, evaluate, logged)
    if not system.made_of[stated.name]:
        raise UnusableInput(
            f"{where} depends on no logged input; make it of one, or state a constant."
        )


def _check_points(where: str, evaluate: Evaluate, tried: dict[str, FloatArray]) -> None:
    """Points (3, 5), and some of them alone: the same numbers."""
    shape = next(iter(tried.values())).shape if tried else (3, 5)
    many = _evaluated(where, evaluate, tried, shape)
    for index in ((0, 0), (1, 2), (2, 4)):
        single = {n: np.asarray(v[index]) for n, v in tried.items()}
        for name, value in _evaluated(where, evaluate, single, ()).items():
            if not np.allclose(value, many[name][index], rtol=1e-9, atol=1e-12):
                raise UnusableInput(
                    f"{where} gives another {name!r} for one point than for the same point in an "
                    "array; use numpy (np.where, not if) throughout."
                )


def _check_forces(system: StateSpace, state: Point, inputs: Point) -> None:
    """Where no force acts `derivative_under` gives the derivative."""
    c = system.values()
    with np.errstate(all="ignore"):
        plain, idle = system.rates(state, inputs, c), system.rates(state, inputs, c, {})
    for name, value in plain.items():
        if not np.allclose(value, idle[name], rtol=1e-6, atol=1e-9):
            raise UnusableInput(
                f"{system.name}.derivative_under gives another {name!r} than derivative where no "
                "force acts; write both by one function of the forces."
            )


def _check_like(system: StateSpace, port: Port) -> None:
    """More of the input that a force acts like pushes the state the stated way somewhere."""
    rng = np.random.default_rng(5)
    state = Point("state", {n: rng.standard_normal(_POINTS) * 0.5 for n in system.states})
    at = {i.name: _of_every_size(i, rng) for i in system.inputs}
    name = port.acts_like
    ends = [at | {name: at[name] * share} for share in (0.999, 1.001)]
    with np.errstate(all="ignore"):
        try:
            rates = [system.rates(state, Point("input", end), system.values()) for end in ends]
        except UnusableInput:  # a command of a size that the model refuses: nothing is known
            return
        less, more = (np.broadcast_to(np.asarray(r[port.name], float), _POINTS) for r in rates)
    pushed = port.sign * np.sign(at[name]) * (more - less)
    if not np.any(pushed > 0.0):
        other = name if port.sign < 0.0 else f"-{name}"
        advice = f'write like="{other}"' if np.any(pushed < 0.0) else "name an input that does"
        raise UnusableInput(
            f"{system.name}: the port {port.name!r} is like {port.like!r}, which never pushes it "
            f"forward; {advice}, or write derivative_under."
        )


def _of_every_size(stated: Input, rng: np.random.Generator) -> FloatArray:
    """An input (N,) of either sign and every size, within its limits."""
    low, high = limits_of(stated)
    if math.isfinite(high - low):
        return np.asarray(rng.uniform(low, high, _POINTS))
    values = rng.choice([-1.0, 1.0], _POINTS) * np.geomspace(1e-3, 1e3, _POINTS)
    return np.asarray(np.clip(values, low, high))


def _check_custom(
    system: StateSpace, port: Port, state: Point, inputs: Point, shape: tuple[int, ...]
) -> None:
    """An effect of the user's own acts on states, and at 0 on none."""
    what = f"{system.name}: the effect {port.name!r}"
    for size in (0.0, 1.0):
        with np.errstate(all="ignore"):
            added = called(what, port.increments, 0.0, state, inputs, size)
        for name, value in added.items():
            if name not in system.states:
                known = ", ".join(system.states)
                raise UnusableInput(f"{what} adds to {name!r}, no state; there are: {known}.")
            if _shape(value) not in ((), shape):
                given = _shape_in_words(_shape(value))
                raise UnusableInput(f"{what} adds {given} for states of shape {shape}.")
            if not np.all(np.isfinite(value)):
                raise UnusableInput(f"{what} adds something that is no number; bound what goes in.")
            if size == 0.0 and np.any(value):
                raise UnusableInput(
                    f"{what} adds to {name!r} where its parameters are 0; it has to vanish there. "
                    "What it does not vanish with is a shape."
                )


def _evaluated(
    where: str, evaluate: Evaluate, tried: Mapping[str, FloatArray], shape: tuple[int, ...]
) -> dict[str, FloatArray]:
    with np.errstate(all="ignore"):
        returned = evaluate(tried)
    result = {}
    for name, value in returned.items():
        given = _shape(value)
        if given not in ((), shape):
            raise UnusableInput(
                f"{where} gives {name!r} {_shape_in_words(given)} for points of shape {shape}; "
                "return one number a point."
            )
        result[name] = np.broadcast_to(np.asarray(value, dtype=float), shape)
        if not np.all(np.isfinite(result[name])):
            at = tuple(np.argwhere(~np.isfinite(result[name]))[0])
            point = ", ".join(f"{n} = {tried[n][at]:.3g}" for n in tried)
            raise UnusableInput(
                f"{where} gives {result[name][at]} for {name!r} at {point}; a search tries such "
                "points, so bound what goes into it (np.maximum, np.clip), or state `low` and "
                "`high` of an input that never takes such values."
            )
    return result


def _shape(value: Any) -> tuple[int, ...] | None:
    """An array's shape; None where its parts have several."""
    try:
        return tuple(np.shape(value))
    except ValueError:
        return None


def _shape_in_words(shape: tuple[int, ...] | None) -> str:
    return "parts of several shapes" if shape is None else f"the shape {shape}"
