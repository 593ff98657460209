"""Reads an MJCF file, and finds what a system has of it.

In: a file. Out: its `Elements`, or UnusableInput for what no system can have. Only this folder
imports MuJoCo.
"""

import contextlib
import importlib
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput, installs, one_line
from wakedeploy.gap.systems.mjcf.attributes import attributes_of
from wakedeploy.gap.systems.mjcf.bounds import require_bounded
from wakedeploy.gap.systems.mjcf.elements import Actuator, Elements, Joint
from wakedeploy.gap.systems.mjcf.free_bodies import ANGLES, SLIDES, TURNS
from wakedeploy.gap.systems.mjcf.names import word
from wakedeploy.gap.systems.system import FloatArray

_SERVO = 3  # numbers of a position or velocity servo's bias: 0, −kp, −kv


def loaded_mujoco(path: Path) -> Any:
    """The library; UnusableInput says how to install it where it is absent."""
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise UnusableInput(f"{path}: needs mujoco: {installs('mujoco')}.") from error


def read_elements(path: Path) -> Elements:
    """The elements of an MJCF file.

    Raises UnusableInput for a file that is absent or does not compile, and for what no system here
    can have: ball joints, actuators with several commands, plugins.
    """
    library, (model, delays_s) = loaded_mujoco(path), _without_delays(path)
    _refuse_unfit(library, path, model)
    with silent(library):
        joints = _joints(library, path, model)
    actuators = _actuators(library, path, model, delays_s)
    if not joints:
        raise UnusableInput(f"{path}: nothing moves in it; give a model with at least one joint.")
    return Elements(
        path, model, joints, actuators,
        dict(attributes_of(path, model, joints, actuators)),
        _sensed(library, model, joints),
        _coupled(library, model),
        {j.body: _centre(library, model, j.body) for j in joints if j.body},
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
    with silent(loaded_mujoco(path)):
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
    library = loaded_mujoco(path)
    if not path.is_file():
        raise UnusableInput(f"{path}: no such file; give an MJCF file.")
    require_bounded(path)
    try:
        with silent(library):
            spec = library.MjSpec.from_file(str(path))
            # Aligned with its inertia, a body has another frame than the file's. A file that is
            # written from this has the compiler's word alone.
            spec.compiler.alignfree = False
            for joint in spec.joints:
                if joint.type == library.mjtJoint.mjJNT_FREE:
                    joint.align = library.mjtAlignFree.mjALIGNFREE_FALSE
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


def _refuse_unfit(library: Any, path: Path, model: Any) -> None:
    for i in range(model.njnt):
        if int(model.jnt_type[i]) == int(library.mjtJoint.mjJNT_BALL):
            name = model.joint(i).name or f"number {i}"
            raise UnusableInput(
                f"{path}: joint {name!r} is a ball; hold it fast, or make three hinges of it."
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
        kind = int(model.jnt_type[i])
        dof = int(model.jnt_dofadr[i])
        place = int(model.jnt_qposadr[i])
        if kind == int(library.mjtJoint.mjJNT_FREE):
            found += _axes(path, model, i, inertias[dof : dof + 6])
            continue
        turns = kind == int(library.mjtJoint.mjJNT_HINGE)
        found.append(Joint(name, word(path, name, "joint", i), turns, place, dof, inertias[dof]))
    _require_distinct(path, [*(j.position for j in found), *(j.speed for j in found)])
    return tuple(found)


def _axes(path: Path, model: Any, i: int, inertias: Sequence[float]) -> list[Joint]:
    """The axes of the body that joint `i` sets free: its place, then its orientation."""
    at, dof = int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])
    number = int(model.jnt_bodyid[i])
    body = model.body(number).name
    stem = word(path, body, "body", number - 1)  # the world is the first of MuJoCo's bodies
    mass = float(model.body_subtreemass[number])
    slides = [
        Joint(body, f"{stem}_{axis}", False, at + k, dof + k, mass, body)
        for k, axis in enumerate(SLIDES)
    ]
    return slides + [
        Joint(body, f"{stem}_{angle}", True, at + 3, dof + 3 + k, inertias[3 + k], body,
              f"{stem}_{turn}")
        for k, (angle, turn) in enumerate(zip(ANGLES, TURNS, strict=True))
    ]  # fmt: skip


def _inertias(library: Any, path: Path, model: Any) -> list[float]:
    """What each joint alone moves in the pose of the file: 1/(M⁻¹)ᵢᵢ."""
    data = library.MjData(model)
    library.mj_forward(model, data)
    inverse = np.eye(model.nv)
    library.mj_solveM(model, data, inverse, np.eye(model.nv))
    is_singular = data.warning[int(library.mjtWarning.mjWARN_INERTIA)].number > 0
    for i in range(model.nv):
        if is_singular or not 0.0 < inverse[i, i] < math.inf:
            at = int(model.dof_jntid[i])
            name = model.joint(at).name or f"number {at}"
            raise UnusableInput(
                f"{path}: joint {name!r}: what it moves has no usable mass; state mass or inertia "
                "of every moving body."
            )
    return [1.0 / float(inverse[i, i]) for i in range(model.nv)]


def _actuators(
    library: Any, path: Path, model: Any, delays_s: Sequence[float]
) -> tuple[Actuator, ...]:
    found = []
    for i in range(model.nactuator):
        name = model.actuator(i).name
        at = model.joint(int(model.actuator_trnid[i, 0])).name if (
            int(model.actuator_trntype[i]) in _of_joints(library)
            and not _is_of_free_joint(library, model, i)) else ""  # fmt: skip
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
            wrench_unit=_wrench_unit(library, model, i, kind),
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


def _wrench_unit(library: Any, model: Any, i: int, kind: str) -> str:
    """The unit of what a motor at a site or of a free joint pushes with; "" for all others.

    A rotor's thrust turns its body a little, too: what counts is whether it pushes one way.
    """
    is_at_site = int(model.actuator_trntype[i]) == int(library.mjtTrn.mjTRN_SITE)
    if kind != "motor" or not (is_at_site or _is_of_free_joint(library, model, i)):
        return ""
    pushes, turns = np.split(np.abs(model.actuator_gear[i]), 2)
    along = pushes if pushes.any() else turns
    size = along.max() * abs(float(model.actuator_gainprm[i, 0]))
    is_plain = np.count_nonzero(along) == 1 and math.isclose(size, 1.0)
    return ("N" if pushes.any() else "N m") if is_plain else "1"


def _is_of_free_joint(library: Any, model: Any, i: int) -> bool:
    if int(model.actuator_trntype[i]) not in _of_joints(library):
        return False
    return int(model.jnt_type[int(model.actuator_trnid[i, 0])]) == int(library.mjtJoint.mjJNT_FREE)


def _of_joints(library: Any) -> tuple[int, int]:
    return int(library.mjtTrn.mjTRN_JOINT), int(library.mjtTrn.mjTRN_JOINTINPARENT)


def _filters(library: Any) -> tuple[int, int]:
    return int(library.mjtDyn.mjDYN_FILTER), int(library.mjtDyn.mjDYN_FILTEREXACT)


def _require_distinct(path: Path, words: list[str]) -> None:
    for identifier in words:
        if words.count(identifier) > 1:
            raise UnusableInput(f"{path}: two elements are called {identifier!r}; rename one.")


def _sensed(library: Any, model: Any, joints: tuple[Joint, ...]) -> dict[str, float]:
    """The states that sensors show, and the noise that each states; 0 for none.

    Of a body that moves freely that is its turning, by a gyro along its own axes.
    """
    sensors, shown = library.mjtSensor, {}
    data = library.MjData(model)
    library.mj_kinematics(model, data)
    for i in range(model.nsensor):
        kind, at, noise = (int(model.sensor_type[i]), int(model.sensor_objid[i]),
                           float(model.sensor_noise[i]))  # fmt: skip
        for joint in joints:
            if joint.body:
                is_gyro = kind == int(sensors.mjSENS_GYRO)
                if is_gyro and joint.turns and _is_along(model, data, at, joint.body):
                    shown[joint.speed] = noise
            elif at == model.joint(joint.name).id:
                if kind == int(sensors.mjSENS_JOINTPOS):
                    shown[joint.position] = noise
                elif kind == int(sensors.mjSENS_JOINTVEL):
                    shown[joint.speed] = noise
    return shown


def _is_along(model: Any, data: Any, site: int, body: str) -> bool:
    """Whether a site is fast on a body and has its axes."""
    of = model.body(body).id
    is_on = int(model.body_weldid[int(model.site_bodyid[site])]) == int(model.body_weldid[of])
    return is_on and np.allclose(data.site_xmat[site], data.xmat[of], atol=1e-6)


def _centre(library: Any, model: Any, body: str) -> FloatArray:
    """The centre of mass (3,) of a body and what hangs on it, in its axes in the file's pose."""
    data = library.MjData(model)
    library.mj_kinematics(model, data)
    library.mj_comPos(model, data)
    number = model.body(body).id
    axes = np.asarray(data.xmat[number]).reshape(3, 3)
    return np.asarray(axes.T @ (data.subtree_com[number] - data.xpos[number]))


def _coupled(library: Any, model: Any) -> tuple[tuple[str, ...], ...]:
    """The joints of each active equality of joints: two, or one that is held alone."""
    found = []
    for i in range(model.neq):
        is_of_joints = int(model.eq_type[i]) == int(library.mjtEq.mjEQ_JOINT)
        if is_of_joints and model.eq_active0[i]:
            ids = (int(model.eq_obj1id[i]), int(model.eq_obj2id[i]))
            found.append(tuple(model.joint(at).name for at in ids if at >= 0))
    return tuple(found)
