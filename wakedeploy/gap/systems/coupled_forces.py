"""Whether forces at ports act as they do in a mechanism: coupled masses, and inputs that are bent.

In: a system and its logs. Out: sentences. A torque in one joint of an arm moves every joint, since
masses are coupled: M(q) q'' = τ. Friction there does the same. A port that adds it to one rate
alone makes another robot of it, and the search names something else.
"""

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.ports import Point, Port
from wakedeploy.gap.systems.system import StateSpace
from wakedeploy.gap.wording import listed

_TIMES, _POSES = 6, 16  # samples of the logs, and states in each of which inputs stay
_PUSH = 1e-3  # of an input's usual size
_FEWEST = 0.25  # of the points at which an input has to act; in a dead band it does not
_LEAST = 1e-3  # relative: how much a share has to vary, and how near two gains have to be
_BENT = 0.1  # relative: how much less an input may do where it is large
_SPEEDS = {"m/s", "mm/s", "cm/s", "rad/s", "deg/s", "rev/s", "rpm"}
_TURNS = {"rad": math.pi, "deg": 180.0}

IntArray = npt.NDArray[np.int64]
Gains = Mapping[tuple[str, str], FloatArray]  # of rates by inputs (times, poses)


def coupled_forces(model: LogModel) -> list[str]:
    """Ports at speeds that inputs move together, as masses that are coupled do: one or none.

    The shares of such speeds depend on the pose. The inverse of a mass matrix is symmetric: what
    the first motor does to the second joint, the second does to the first, but for their gears;
    and it is positive: a motor pushes its own joint the same way in every pose. A rotor's thrust
    in axes of the room does not.
    """
    system = model.system
    speeds = _speeds(system)
    ports = [p for p in system.ports if p.role == "force" and not p.like and p.name in speeds]
    if hasattr(system, "derivative_under") or not ports or len(speeds) < 2:
        return []
    try:
        gains = _gains(model)
    except UnusableInput:  # raised in a pose that the logs do not have
        return []
    moving = [i.name for i in system.inputs if any(gains[s, i.name].any() for s in speeds)]
    if len(moving) == 1:
        return _of_one(gains, moving[0], ports, speeds)
    return _of_several(gains, moving, ports, speeds)


def bent_inputs(model: LogModel) -> list[str]:
    """Ports whose force is like an input that the model limits or bends: so is the force then."""
    names = [i.name for i in model.system.inputs]
    notes = []
    for port in (p for p in model.system.ports if p.like):
        place = names.index(port.acts_like)
        logged = np.concatenate([log.inputs[place] for log in model.logs])
        ranked = np.argsort(logged)
        when = ranked[np.linspace(0, len(ranked) - 1, _TIMES).astype(int)]  # from least to most
        try:
            does = _gains(model, when, alone=port.acts_like)[port.name, port.acts_like].ravel()
        except UnusableInput:  # raised at a command that the logs do not have in this state
            continue
        if np.ptp(does) > _BENT * float(np.abs(does).max()):
            notes.append(
                f"force {port.name}: it is like {port.acts_like}, which the model limits or bends, "
                "and so it bends the force. State what the model makes of it as an input with a "
                "law, and let the port be like that one."
            )
    return notes


def _speeds(system: StateSpace) -> list[str]:
    """The states that are speeds: of a position, or by their unit."""
    of_positions = {*system.kinematic().values()}
    return [n for n, unit in system.states.items() if n in of_positions or unit in _SPEEDS]


def _of_several(
    gains: Gains, inputs: Sequence[str], ports: Sequence[Port], speeds: Sequence[str]
) -> list[str]:
    """Of two motors or more: which each of them drives is known."""
    driven: dict[str, str] = {}
    together: set[str] = set()
    for port, other_speed in itertools.product(ports, speeds):
        for mine, other in itertools.permutations(inputs, 2):
            pair = (port.name, other_speed), (mine, other)
            if port.name != other_speed and _coupled(gains, *pair):
                driven[port.name] = mine
                together |= {port.name, other_speed}
    if not driven:
        return []
    both = [speed for speed in speeds if speed in together]
    return [
        f"{listed([*dict.fromkeys(driven.values())])} move {listed(both)} together, as the motors "
        f"of an arm do. {_advice(gains, driven)}"
    ]


def _of_one(gains: Gains, stated: str, ports: Sequence[Port], speeds: Sequence[str]) -> list[str]:
    """Of a motor alone, as under a cart with a pole."""
    for port in ports:
        others = [s for s in speeds if s != port.name and _varies(gains, (port.name, s), stated)]
        if others and _drives(gains[port.name, stated]):
            return [
                f"{stated} moves {listed([port.name, *others])} together, in shares that depend on "
                f"the state, as in coupled masses. {_advice(gains, {port.name: stated})}"
            ]
    return []


def _advice(gains: Gains, driven: Mapping[str, str]) -> str:
    """What to write where a force does as an input, of each speed."""
    signs = {s: "-" if _drives(gains[s, i]) < 0 else "" for s, i in driven.items()}
    lines = [f'Port.force("{s}", like="{signs[s]}{mine}")' for s, mine in driven.items()]
    return (
        f"If a force at one of them does so, too, its port has to say it, by {listed(lines)}; else "
        "another effect may be named."
    )


def _gains(model: LogModel, when: IntArray | None = None, alone: str = "") -> Gains:
    """How every rate changes with each input, at samples of the logs' inputs.

    In states of the logs with angles of all sizes; or in one state, and with what was commanded
    then but for one input `alone`.
    """
    system, rng = model.system, np.random.default_rng(4)
    logged = np.concatenate([log.inputs for log in model.logs], axis=1)
    states = model.along_logs()
    when = rng.integers(logged.shape[1], size=_TIMES) if when is None else when
    poses = 1 if alone else _POSES
    then = rng.integers(states.shape[1], size=poses)
    tried = {n: states[k, then] for k, n in enumerate(system.states)}
    for name, unit in system.states.items():
        if not alone and unit in _TURNS:
            tried[name] = rng.uniform(-_TURNS[unit], _TURNS[unit], poses)
    shape = (len(when), poses)
    state = Point("state", {n: np.broadcast_to(v, shape).copy() for n, v in tried.items()})
    at = {i.name: np.repeat(logged[k, when], poses).reshape(shape)
          for k, i in enumerate(system.inputs)}  # fmt: skip
    for name in at:
        if alone and name != alone:
            at[name][:] = at[name][0]
    c, found = system.values(), {}
    for stated in system.inputs:
        push = _PUSH * model.sizes[stated.name]
        with np.errstate(all="ignore"):
            ends = [
                system.rates(state, Point("input", at | {stated.name: at[stated.name] + p}), c)
                for p in (-push, push)
            ]
        for name in system.states:
            less, more = (np.broadcast_to(np.asarray(e[name], float), shape) for e in ends)
            found[name, stated.name] = np.nan_to_num((more - less) / (2.0 * push))
    return found


def _drives(does: FloatArray) -> int:
    """1 where more of an input pushes forward in every pose in which it acts, -1 backward, or 0."""
    acting = does[does != 0.0]
    if acting.size < _FEWEST * does.size:
        return 0
    return int(np.sign(acting[0])) if abs(float(np.sign(acting).sum())) == acting.size else 0


def _varies(gains: Gains, speeds: tuple[str, str], stated: str) -> bool:
    """Whether the share that the second speed has of an input depends on the pose."""
    first, second = (gains[speed, stated] for speed in speeds)
    for mine, other in zip(first, second, strict=True):  # one command after another
        acting = mine != 0.0
        share = other[acting] / mine[acting]
        if share.size > 1 and np.ptp(share) > _LEAST * float(np.abs(share).max()) > 0.0:
            return True
    return False


def _coupled(gains: Gains, speeds: tuple[str, str], inputs: tuple[str, str]) -> bool:
    """Whether two inputs move two speeds as through a mass matrix's inverse, times their gains."""
    (first, second), (mine, other) = speeds, inputs
    signs = _drives(gains[first, mine]), _drives(gains[second, other])
    if 0 in signs or not _varies(gains, speeds, mine):
        return False
    drives, to_second = (signs[0] * gains[speed, mine] for speed in speeds)
    to_first, answers = (signs[1] * gains[speed, other] for speed in speeds)
    if not (to_first.any() and to_second.any()):
        return False
    acting = (drives != 0.0) & (answers != 0.0)
    if not acting.any() or np.any((drives * answers <= to_second * to_first)[acting]):
        return False
    # The ratio of gains is the same in every pose: to_second / to_first = gain / other gain.
    ratio = float(np.sum(to_second * to_first) / np.sum(to_first**2))
    return ratio > 0.0 and np.allclose(
        to_second[acting],
        ratio * to_first[acting],
        rtol=_LEAST,
        atol=_LEAST * float(np.abs(to_second).max()),
    )
