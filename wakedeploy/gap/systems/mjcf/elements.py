"""What of an MJCF file a system has: its joints and actuators, and the attributes that may be off.

In: a file. Out: joints and actuators with the names of states and inputs, and attributes with the
names of constants. Only this folder imports MuJoCo.
"""

import contextlib
import functools
import importlib
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput, installs, one_line
from wakedeploy.gap.systems.mjcf.bounds import require_bounded

_SERVO = 3  # numbers of a position or velocity servo's bias: 0, −kp, −kv


@dataclass(frozen=True)
class Joint:
    """A joint that turns or slides: `name` as in the file, `word` as in names of the system.

    `qpos` and `dof` are its places in MuJoCo's state; `inertia` is what the joint alone moves in
    the pose of the file [kg m², kg for one that slides].
    """

    name: str
    word: str
    turns: bool
    qpos: int
    dof: int
    inertia: float

    @property
    def position(self) -> str:
        """The state that is its position."""
        return f"{self.word}_{'rad' if self.turns else 'm'}"

    @property
    def speed(self) -> str:
        """The state that is its speed."""
        return f"{self.word}_{'radps' if self.turns else 'mps'}"

    @property
    def inertia_name(self) -> str:
        """The constant that is its inertia."""
        return f"{self.word}_inertia_{'kgm2' if self.turns else 'kg'}"


@dataclass(frozen=True)
class Actuator:
    """An actuator with one command; `act` is the place of its own state, −1 where it has none.

    `follows` is what its command asks for, "" where that has no unit of its own; it `integrates` or
    `filters` its command into its state. With `has_fixed_gain` its force is in proportion to them.
    `has_bias` says that an affine bias is beside that, `is_affine` that there is none of another
    kind. By `delay_s` its command acts later; `Elements.model` has none of that.
    """

    name: str
    word: str
    index: int
    act: int
    kind: str  # "position", "velocity", "motor" or "general"
    joint: str  # the joint on which it acts, "" for another transmission
    follows: str  # "position", "velocity", "pressure", "voltage", "force" or ""
    integrates: bool
    filters: bool
    has_fixed_gain: bool
    has_bias: bool
    is_affine: bool
    delay_s: float

    @property
    def command(self) -> str:
        """The input that is its command."""
        return f"{self.word}_command"

    @property
    def state(self) -> str:
        """The state that is its activation."""
        return f"{self.word}_activation"


@dataclass(frozen=True)
class Attribute:
    """A number of the file that may be off: `set` writes it into a compiled model.

    `element`, `of` and `attribute` are its place in the file; `spread` is a share of its value.
    """

    element: str
    of: str
    attribute: str
    value: float
    spread: float
    unit: str
    set: Callable[[Any, float], None]


@dataclass(frozen=True, eq=False)
class Elements:
    """A compiled model, and what a system has of it; `attributes` by the names of constants."""

    path: Path
    model: Any
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    attributes: dict[str, Attribute]
    sensed: Mapping[str, float]  # the noise that sensors state of the states that they show
    coupled: tuple[tuple[str, ...], ...]  # joints that an equality holds to each other, or alone


def mujoco(path: Path) -> Any:
    """The library; UnusableInput says how to install it where it is absent."""
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise UnusableInput(f"{path}: needs mujoco: {installs('mujoco')}.") from error


def read_elements(path: Path) -> Elements:
    """The elements of an MJCF file.

    Raises UnusableInput for a file that is absent or does not compile, and for what no system here
    can have: free and ball joints, actuators with several commands, plugins.
    """
    library, (model, delays_s) = mujoco(path), _without_delays(path)
    _refuse_unfit(library, path, model)
    with silent(library):
        joints = _joints(library, path, model)
    actuators = _actuators(library, path, model, delays_s)
    if not joints:
        raise UnusableInput(f"{path}: no hinge or slide joint; give a model with at least one.")
    return Elements(
        path, model, joints, actuators,
        dict(_attributes(path, model, joints, actuators)),
        _sensed(library, model, joints),
        _coupled(library, model),
    )  # fmt: skip


def _without_delays(path: Path) -> tuple[Any, list[float]]:
    """A file compiled with no command that waits, and by how much each would [s]."""
    spec, model = read_spec(path)
    delays_s = [_delay_s(model, i) for i in range(model.nactuator)]
    if not any(delays_s):
        return model, delays_s
    for actuator, delay_s in zip(spec.actuators, delays_s, strict=True):
        if delay_s > 0.0:
            actuator.delay, actuator.nsample = 0.0, 0
    with silent(mujoco(path)):
        return spec.compile(), delays_s


def _delay_s(model: Any, i: int) -> float:
    """By how much a command acts later [s]: by no more than MuJoCo remembers.

    Without interpolation it is late by whole steps.
    """
    step_s = float(model.opt.timestep)
    remembered, interpolation = (int(number) for number in model.actuator_history[i])
    delay_s = min(float(model.actuator_delay[i]), remembered * step_s)
    if delay_s <= 0.0 or interpolation:
        return max(delay_s, 0.0)
    return step_s * math.ceil(delay_s / step_s - 1e-6)


def read_spec(path: Path) -> tuple[Any, Any]:
    """A file as MuJoCo's specification, and compiled; UnusableInput where it is damaged."""
    library = mujoco(path)
    if not path.is_file():
        raise UnusableInput(f"{path}: no such file; give an MJCF file.")
    require_bounded(path)
    try:
        with silent(library):
            spec = library.MjSpec.from_file(str(path))
            return spec, spec.compile()
    except ValueError as error:
        reason = re.sub(r"^Error:\s*", "", one_line(error)).rstrip(". ")
        raise UnusableInput(f"{path}: MuJoCo cannot read it ({reason}); mend the file.") from error


@contextlib.contextmanager
def silent(library: Any) -> Iterator[None]:
    """MuJoCo neither prints nor writes MUJOCO_LOG.TXT: what it warns of is checked here."""
    before = library.get_mju_user_warning()
    library.set_mju_user_warning(lambda message: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        library.set_mju_user_warning(before)


def word(path: Path, name: str, what: str, number: int) -> str:
    """An element's name as part of a Python name; UnusableInput for an element without one."""
    identifier = re.sub(r"\W+", "_", name).strip("_").lower()
    if not identifier:
        article = "an" if what[0] in "aeiou" else "a"
        raise UnusableInput(
            f"{path}: {article} {what} has no name (number {number + 1} of the model), and logs "
            'refer to it by name; add name="..." to its element.'
        )
    identifier = identifier if identifier[0].isalpha() else f"{what}_{identifier}"
    if not identifier.isidentifier():  # as with ²
        raise UnusableInput(f"{path}: {what} {name!r}: give it a name of letters and digits.")
    return identifier


def _refuse_unfit(library: Any, path: Path, model: Any) -> None:
    kinds = library.mjtJoint
    for i in range(model.njnt):
        if int(model.jnt_type[i]) not in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)):
            name = model.joint(i).name or f"number {i}"
            raise UnusableInput(
                f"{path}: joint {name!r} is free or a ball; hold it fast, as hinges and slides "
                "alone are understood."
            )
    for i in range(model.nactuator):
        name = model.actuator(i).name or f"number {i}"
        if model.actuator_ctrlnum[i] != 1 or model.actuator_actnum[i] > 1:
            raise UnusableInput(
                f"{path}: actuator {name!r} has several commands or states; give it one of each."
            )
        if model.actuator_plugin[i] >= 0:
            raise UnusableInput(f"{path}: actuator {name!r} is a plugin; use one of MuJoCo's own.")
    carried = library.mj_stateSize(model, library.mjtState.mjSTATE_FULLPHYSICS)
    if carried != 1 + model.nq + model.nv + model.na:
        raise UnusableInput(
            f"{path}: the model keeps more from step to step than positions, speeds and "
            "activations; take out `nsample` of actuators and sensors, and plugins."
        )


def _joints(library: Any, path: Path, model: Any) -> tuple[Joint, ...]:
    inertias = _inertias(library, path, model)
    found = []
    for i in range(model.njnt):
        name = model.joint(i).name
        turns = int(model.jnt_type[i]) == int(library.mjtJoint.mjJNT_HINGE)
        dof = int(model.jnt_dofadr[i])
        place = int(model.jnt_qposadr[i])
        found.append(Joint(name, word(path, name, "joint", i), turns, place, dof, inertias[dof]))
    _require_distinct(path, [joint.word for joint in found])
    return tuple(found)


def _inertias(library: Any, path: Path, model: Any) -> list[float]:
    """What each joint alone moves in the pose of the file: 1/(M⁻¹)ᵢᵢ."""
    data = library.MjData(model)
    library.mj_forward(model, data)
    inverse = np.eye(model.nv)
    library.mj_solveM(model, data, inverse, np.eye(model.nv))
    is_singular = data.warning[int(library.mjtWarning.mjWARN_INERTIA)].number > 0
    for i in range(model.nv):
        if is_singular or not 0.0 < inverse[i, i] < math.inf:
            name = model.joint(int(model.dof_jntid[i])).name
            raise UnusableInput(
                f"{path}: joint {name!r}: what it moves has no usable mass; state mass or inertia "
                "of every moving body."
            )
    return [1.0 / float(inverse[i, i]) for i in range(model.nv)]


def _actuators(
    library: Any, path: Path, model: Any, delays_s: Sequence[float]
) -> tuple[Actuator, ...]:
    joint = [int(library.mjtTrn.mjTRN_JOINT), int(library.mjtTrn.mjTRN_JOINTINPARENT)]
    found = []
    for i in range(model.nactuator):
        name = model.actuator(i).name
        at = model.joint(int(model.actuator_trnid[i, 0])).name if (
            int(model.actuator_trntype[i]) in joint) else ""  # fmt: skip
        act = int(model.actuator_actadr[i]) if model.actuator_actnum[i] else -1
        kind = _kind(library, model, i)
        dynamics = int(model.actuator_dyntype[i])
        gain, bias = int(model.actuator_gaintype[i]), int(model.actuator_biastype[i])
        none, affine = int(library.mjtBias.mjBIAS_NONE), int(library.mjtBias.mjBIAS_AFFINE)
        found.append(Actuator(
            name, word(path, name, "actuator", i), i, act, kind, at,
            follows=_followed(library, model, i, kind),
            integrates=dynamics == int(library.mjtDyn.mjDYN_INTEGRATOR),
            filters=dynamics in _filters(library),
            has_fixed_gain=gain == int(library.mjtGain.mjGAIN_FIXED),
            has_bias=bias == affine,
            is_affine=bias in (none, affine),
            delay_s=delays_s[i],
        ))  # fmt: skip
    _require_distinct(path, [actuator.word for actuator in found])
    return tuple(found)


def _kind(library: Any, model: Any, i: int) -> str:
    """What an actuator is, by how its force depends on command, position and speed."""
    gain, bias = model.actuator_gainprm[i], model.actuator_biasprm[i]
    if int(model.actuator_gaintype[i]) != int(library.mjtGain.mjGAIN_FIXED):
        return "general"
    bias_type = int(model.actuator_biastype[i])
    if bias_type == int(library.mjtBias.mjBIAS_NONE):
        return "motor"
    if bias_type != int(library.mjtBias.mjBIAS_AFFINE) or any(bias[_SERVO:]):
        return "general"
    if not any(bias[1:_SERVO]):  # a constant force beside a motor's
        return "motor"
    if gain[0] > 0.0 and math.isclose(bias[1], -gain[0]):
        return "position"
    is_velocity = gain[0] > 0.0 and math.isclose(bias[2], -gain[0]) and bias[1] == 0.0
    return "velocity" if is_velocity else "general"


def _followed(library: Any, model: Any, i: int, kind: str) -> str:
    """What a command asks for: as MuJoCo declares it, else as the force depends on it.

    What an integrator makes of a velocity is the position of a servo.
    """
    inputs = library.mjtCtrlInput
    declared = {
        int(inputs.mjINPUT_POS): "position",
        int(inputs.mjINPUT_VEL): "velocity",
        int(inputs.mjINPUT_PRESSURE): "pressure",
        int(inputs.mjINPUT_VOLTAGE): "voltage",
    }.get(int(model.actuator_ctrlspec[i]))
    if declared is not None:
        return declared
    integrates = int(model.actuator_dyntype[i]) == int(library.mjtDyn.mjDYN_INTEGRATOR)
    if kind == "position":
        return "velocity" if integrates else "position"
    if integrates or kind == "general":
        return ""
    if kind == "velocity":
        return "velocity"
    is_direct = model.actuator_gainprm[i, 0] == 1.0 and model.actuator_gear[i, 0] == 1.0
    return "force" if is_direct else ""


def _filters(library: Any) -> tuple[int, int]:
    return int(library.mjtDyn.mjDYN_FILTER), int(library.mjtDyn.mjDYN_FILTEREXACT)


def _require_distinct(path: Path, words: list[str]) -> None:
    for identifier in words:
        if words.count(identifier) > 1:
            raise UnusableInput(f"{path}: two elements are called {identifier!r}; rename one.")


def _attributes(
    path: Path, model: Any, joints: tuple[Joint, ...], actuators: tuple[Actuator, ...]
) -> Iterator[tuple[str, Attribute]]:
    for joint in joints:
        yield from _of_joint(model, joint)
    turns = {j.name: j.turns for j in joints}
    for actuator in actuators:
        yield from _of_actuator(model, actuator, turns.get(actuator.joint))
    yield from _masses(path, model)


def _of_joint(model: Any, joint: Joint) -> Iterator[tuple[str, Attribute]]:
    """Damping, dry friction, armature and spring, where the file has them: 0 may be missing."""
    torque, speed = ("N m", "rad/s") if joint.turns else ("N", "m/s")
    inertia = "kg m²" if joint.turns else "kg"
    stated = {
        "damping": (0.3, f"{torque}/({speed})"),
        "frictionloss": (0.3, torque),
        "armature": (0.2, inertia),
    }
    for attribute, (spread, unit) in stated.items():
        value = float(getattr(model, f"dof_{attribute}")[joint.dof])
        if value > 0.0:
            setter = functools.partial(_set, f"dof_{attribute}", (joint.dof,))
            yield (
                f"{joint.word}_{attribute}",
                Attribute("joint", joint.name, attribute, value, spread, unit, setter),
            )
    at = int(model.dof_jntid[joint.dof])
    stiffness, unit = float(model.jnt_stiffness[at]), "N m/rad" if joint.turns else "N/m"
    if stiffness > 0.0:
        setter = functools.partial(_set, "jnt_stiffness", (at,))
        yield (
            f"{joint.word}_stiffness",
            Attribute("joint", joint.name, "stiffness", stiffness, 0.2, unit, setter),
        )


def _of_actuator(
    model: Any, actuator: Actuator, turns: bool | None
) -> Iterator[tuple[str, Attribute]]:
    """Gains: kp and kv of servos, the gear of everything else; the time constant of a filter."""
    units = {True: ("N m/rad", "N m/(rad/s)"), False: ("N/m", "N/(m/s)"), None: ("1", "1")}[turns]
    i = actuator.index
    gain, bias = model.actuator_gainprm[i], model.actuator_biasprm[i]
    kp, kv = (float(gain[0]), -float(bias[2])) if actuator.kind == "position" else (0.0, 0.0)
    kv = float(gain[0]) if actuator.kind == "velocity" else kv
    for attribute, value, unit in (("kp", kp, units[0]), ("kv", kv, units[1])):
        if value > 0.0:
            setter = functools.partial(_set_gain, i, attribute, actuator.kind)
            yield (
                f"{actuator.word}_{attribute}",
                Attribute("actuator", actuator.name, attribute, value, 0.2, unit, setter),
            )
    if actuator.kind in ("motor", "general"):
        gear = float(model.actuator_gear[i, 0])
        setter = functools.partial(_set, "actuator_gear", (i, 0))
        yield (
            f"{actuator.word}_gear",
            Attribute("actuator", actuator.name, "gear", gear, 0.1, "1", setter),
        )
    timeconst_s = float(model.actuator_dynprm[i, 0])
    if actuator.filters and timeconst_s > 0.0:
        setter = functools.partial(_set, "actuator_dynprm", (i, 0))
        yield (
            f"{actuator.word}_timeconst_s",
            Attribute("actuator", actuator.name, "dynprm[0]", timeconst_s, 0.2, "s", setter),
        )


def _masses(path: Path, model: Any) -> Iterator[tuple[str, Attribute]]:
    """Masses of what moves; inertias follow in proportion."""
    for i in range(1, model.nbody):
        mass, name = float(model.body_mass[i]), model.body(i).name
        if mass <= 0.0 or not name or not model.body_weldid[i]:
            continue
        setter = functools.partial(_set_mass, i)
        constant = f"{word(path, name, 'body', i)}_mass_kg"
        yield constant, Attribute("body", name, "mass", mass, 0.05, "kg", setter)


def _set(field: str, at: tuple[int, ...], model: Any, value: float) -> None:
    getattr(model, field)[at] = value


def _set_gain(i: int, attribute: str, kind: str, model: Any, value: float) -> None:
    if attribute == "kp":
        model.actuator_gainprm[i, 0], model.actuator_biasprm[i, 1] = value, -value
        return
    model.actuator_biasprm[i, 2] = -value
    if kind == "velocity":
        model.actuator_gainprm[i, 0] = value


def _set_mass(i: int, model: Any, value: float) -> None:
    model.body_inertia[i] *= value / model.body_mass[i]
    model.body_mass[i] = value


def _sensed(library: Any, model: Any, joints: tuple[Joint, ...]) -> dict[str, float]:
    """The states that sensors of joints show, and the noise that each states; 0 for none."""
    shown = {}
    for i in range(model.nsensor):
        for joint in joints:
            if int(model.sensor_objid[i]) != model.joint(joint.name).id:
                continue
            kind = int(model.sensor_type[i])
            if kind == int(library.mjtSensor.mjSENS_JOINTPOS):
                shown[joint.position] = float(model.sensor_noise[i])
            elif kind == int(library.mjtSensor.mjSENS_JOINTVEL):
                shown[joint.speed] = float(model.sensor_noise[i])
    return shown


def _coupled(library: Any, model: Any) -> tuple[tuple[str, ...], ...]:
    """The joints of each active equality of joints: two, or one that is held alone."""
    found = []
    for i in range(model.neq):
        is_of_joints = int(model.eq_type[i]) == int(library.mjtEq.mjEQ_JOINT)
        if is_of_joints and model.eq_active0[i]:
            ids = (int(model.eq_obj1id[i]), int(model.eq_obj2id[i]))
            found.append(tuple(model.joint(at).name for at in ids if at >= 0))
    return tuple(found)
