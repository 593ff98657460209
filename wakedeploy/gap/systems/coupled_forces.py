"""Speeds that forces move together, where the ports say that each force moves its own speed alone.

In: a system. Out: sentences. A torque in one joint of an arm moves every joint, since masses are
coupled: M(q) q'' = τ. Friction there does the same. A port that adds it to one rate alone makes
another robot of it, and the search names something else.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.system import Point, Port, StateSpace
from wakedeploy.gap.wording import listed

_POINTS = 40
_WIDE = 2.0  # in units of the states: angles of every quadrant, where a thrust's share turns over
_PUSH = 1e-3  # of an input, small beside what bounds it
_LEAST = 1e-4  # of what an input does to the speed that it drives, for another to be coupled
_ALIKE = 1e-3  # relative, between differences of rates

Moved = dict[tuple[str, str], FloatArray]  # how rates change with inputs, by state and input


def coupled_forces(system: StateSpace) -> list[str]:
    """Ports at speeds that inputs move together, as only coupled masses do: one sentence or none.

    The inverse of a mass matrix is symmetric: what the first motor does to the second joint, the
    second does to the first, but for their gears. Two motors of a copter do not. It is positive,
    too: one motor pushes its own joint forward in every pose, and others by a share that depends on
    the pose. A rotor's thrust in axes of the room does not.
    """
    ports = [p for p in system.ports if p.role == "force" and not p.like]
    if hasattr(system, "derivative_under") or len(ports) < 2:
        return []
    does = _moved(system)
    return _of_several(does, system, ports) or _of_one(does, system, ports)


def _of_several(does: Moved, system: StateSpace, ports: Sequence[Port]) -> list[str]:
    """Of two motors or more: which each of them drives is known."""
    driven = {
        first.name: mine
        for first, second in itertools.permutations(ports, 2)
        for mine, other in itertools.permutations((i.name for i in system.inputs), 2)
        if _coupled(does, (first, second), (mine, other))
    }
    if not driven:
        return []
    lines = [f'Port.force("{speed}", like="{mine}")' for speed, mine in driven.items()]
    return [
        f"{listed([*driven.values()])} each move {listed([*driven])} together, as the motors of an "
        "arm do. If a force at one of them does so, too, its port has to say it, by "
        f"{listed(lines)}; else another effect may be named."
    ]


def _of_one(does: Moved, system: StateSpace, ports: Sequence[Port]) -> list[str]:
    """Of a motor alone, as under a cart with a pole."""
    for stated, first in itertools.product(system.inputs, ports):
        drives = does[first.name, stated.name]
        others = [does[p.name, stated.name] for p in ports if p is not first]
        if not np.all(drives > 0.0) or not np.all(np.isfinite(others)):
            continue
        if max(float(np.ptp(other / drives)) for other in others) > _LEAST:
            names = listed([p.name for p in ports if np.any(does[p.name, stated.name])])
            return [
                f"{stated.name} moves {names} together, in shares that depend on the state, as in "
                f"coupled masses. If a force at {first.name} does so, too, its port has to say it, "
                f'by Port.force("{first.name}", like="{stated.name}"), or all by a '
                "derivative_under; else another effect may be named."
            ]
    return []


def _moved(system: StateSpace) -> Moved:
    """How every rate (P,) changes with each input at random points, by state and input."""
    rng = np.random.default_rng(4)
    state = Point("state", {n: rng.standard_normal(_POINTS) * _WIDE for n in system.states})
    at = {i.name: rng.standard_normal(_POINTS) * 0.5 for i in system.inputs}
    c, found = system.values(), {}
    for stated in system.inputs:
        with np.errstate(all="ignore"):
            ends = [
                system.rates(state, Point("input", at | {stated.name: at[stated.name] + push}), c)
                for push in (-_PUSH, _PUSH)
            ]
        for name in system.states:
            less, more = (np.broadcast_to(np.asarray(e[name], float), _POINTS) for e in ends)
            found[name, stated.name] = (more - less) / (2.0 * _PUSH)
    return found


def _coupled(does: Moved, ports: Sequence[Port], inputs: Sequence[str]) -> bool:
    """Whether two inputs move two speeds as through a mass matrix's inverse, times their gains."""
    (first, second), (mine, other) = ports, inputs
    drives, answers = does[first.name, mine], does[second.name, other]
    to_second, to_first = does[second.name, mine], does[first.name, other]
    if not (np.all(np.isfinite([drives, answers, to_second, to_first]))
            and np.all(drives > 0.0) and np.all(answers > 0.0)):  # fmt: skip
        return False
    least = _LEAST * np.sqrt(drives * answers)
    if not (np.all(np.abs(to_second) + np.abs(to_first) > least)
            and np.all(drives * answers > to_second * to_first)):  # fmt: skip
        return False
    # The ratio of gains is the same at every state: to_second / to_first = gain / other gain.
    gains = float(np.sum(to_second * to_first) / np.sum(to_first**2))
    return gains > 0.0 and np.allclose(
        to_second, gains * to_first, rtol=_ALIKE, atol=_ALIKE * float(np.abs(to_second).max())
    )
