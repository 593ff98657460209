"""Points at which a user's functions are tried before any log is there.

In: a system. Out: random states and inputs at which it gives numbers, if there are such. States go
wherever a search takes them; inputs are what a log says, and no rope is 0 m long.
"""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.gap.systems.ports import Point
    from wakedeploy.gap.systems.system import Input, StateSpace

FloatArray = npt.NDArray[np.float64]
Points = Mapping[str, FloatArray]  # of states and inputs, by name
Method = Callable[["Point", "Point", "Point"], dict[str, Any]]
_POSITIVE = 0.5  # the least of inputs that are tried above 0


def random_points(system: "StateSpace", shape: tuple[int, ...]) -> dict[str, FloatArray]:
    """States and inputs at random."""
    rng = np.random.default_rng(0)
    names = (*system.states, *(i.name for i in system.inputs))
    return {n: rng.standard_normal(shape) * 0.5 for n in names}


def bearable(system: "StateSpace", tried: Points) -> dict[str, FloatArray]:
    """The points with inputs within their limits; with others if only these give numbers.

    The others are positive, and what laws make of positive ones.
    """
    limits = {i.name: limits_of(i) for i in system.inputs}
    within = {n: np.clip(tried[n], *ends) for n, ends in limits.items()}
    positive = {n: np.clip(_POSITIVE + np.abs(tried[n]), *ends) for n, ends in limits.items()}
    for inputs in (within, positive, positive | _made(system, positive)):
        points = {**tried, **inputs}
        if _gives_numbers(system, points):
            return points
    return {**tried, **within}


def limits_of(stated: "Input") -> tuple[float, float]:
    """An input's limits, infinite where it states none."""
    low = -math.inf if stated.low is None else stated.low
    return low, math.inf if stated.high is None else stated.high


def function_name(system: "StateSpace", method: Callable[..., Any]) -> str:
    """What a user calls the function behind `rates` or `readings`."""
    dynamics = "step" if system.has_step else "derivative"
    return f"{system.name}.{'measure' if method == system.readings else dynamics}"


def at(
    system: "StateSpace", method: Method, tried: Points, constants: Mapping[str, float]
) -> dict[str, Any]:
    """What a function of the system gives at the points."""
    return method(*split(system, tried), system.values(constants))


def is_number(
    system: "StateSpace", method: Method, tried: Points, constants: Mapping[str, float]
) -> npt.NDArray[np.bool_]:
    """At which of the points (...) a function gives finite numbers; nowhere if it fails."""
    shape = np.shape(next(iter(tried.values())))
    try:
        with np.errstate(all="ignore"):
            given = at(system, method, tried, constants)
            finite = [np.broadcast_to(np.isfinite(value), shape) for value in given.values()]
    except (UnusableInput, ValueError):  # what the function itself raises there; wrong shapes
        return np.zeros(shape, dtype=bool)
    return np.asarray(np.logical_and.reduce(finite))


def named_by_ports(system: "StateSpace") -> set[str]:
    """Constants that effects at the ports are about, also where no equation reads them."""
    named = {n for p in system.ports for n in (p.inertia, p.friction, *p.inertias)}
    return named | {p.name for p in system.ports if p.role == "constant"}


def _gives_numbers(system: "StateSpace", points: Points) -> bool:
    """Whether the system's functions, its laws and a user's effects give numbers everywhere."""
    made = _made(system, points)
    if any(i.name not in made for i in system.inputs if i.law):
        return False
    if not all(is_number(system, m, points, {}).all() for m in (system.rates, system.readings)):
        return False
    state, inputs = split(system, points)
    try:
        with np.errstate(all="ignore"):
            added = [
                value
                for port in system.ports
                if port.function is not None
                for value in port.increments(0.0, state, inputs, 1.0).values()
            ]
            return all(bool(np.all(np.isfinite(value))) for value in added)
    except Exception:  # whatever a user's function raises is said where it is checked
        return True


def _made(system: "StateSpace", points: Points) -> dict[str, FloatArray]:
    """What laws make of logged inputs, as far as these are numbers."""
    logged = {i.name: points[i.name] for i in system.logged}
    made = {}
    for stated in system.inputs:
        if stated.law is None:
            continue
        try:
            value = system.made(stated, logged)
        except UnusableInput:
            continue
        if value.shape == np.shape(points[stated.name]) and np.isfinite(value).all():
            made[stated.name] = value
    return made


def split(system: "StateSpace", points: Points) -> tuple["Point", "Point"]:
    """The states and the inputs of points."""
    states = {n: points[n] for n in system.states}
    return (
        system.point("state", states),
        system.point("input", {i.name: points[i.name] for i in system.inputs}),
    )
