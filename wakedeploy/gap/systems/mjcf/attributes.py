"""Numbers of an MJCF file that may be off: how large they are, how far off, and how to set them.

In: a compiled model with its joints and actuators. Out: attributes by the names of constants.
"""

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wakedeploy.gap.systems.mjcf.elements import Actuator, Attribute, Joint
from wakedeploy.gap.systems.mjcf.names import word


def attributes_of(
    path: Path, model: Any, joints: tuple[Joint, ...], actuators: tuple[Actuator, ...]
) -> Iterator[tuple[str, Attribute]]:
    """Damping, gains, masses and the like, each with the name of its constant."""
    hinged = [j for j in joints if not j.body]
    for joint in hinged:
        yield from _of_joint(model, joint)
    turns = {j.name: j.turns for j in hinged}
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
    if actuator.wrench_unit:
        # Its gear has six numbers, and only their common factor is a gain.
        setter = functools.partial(_set, "actuator_gainprm", (i, 0))
        yield (
            f"{actuator.word}_gain",
            Attribute("actuator", actuator.name, "gainprm[0]", float(gain[0]), 0.1, "1", setter),
        )
    elif actuator.kind in ("motor", "general"):
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
