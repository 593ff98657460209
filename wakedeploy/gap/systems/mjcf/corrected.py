"""An answer as a corrected MJCF, and as ranges from which to randomise.

In: an MJCF file and what `gap name` found in a system of it. Out: `corrected.xml`, with effects and
constants as the logs have them, and `ranges.toml` with the value and the interval of each. Where
nothing is named, or nothing that MJCF has an attribute for, both are absent: constants alone are
fitted to the logs' noise, too, or to what is missing.
"""

import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from wakedeploy.core.files import write_text_whole
from wakedeploy.gap.search.artefacts import Answer
from wakedeploy.gap.systems.mjcf.effects import add_commands, add_effect
from wakedeploy.gap.systems.mjcf.elements import Elements
from wakedeploy.gap.systems.mjcf.ranges import (
    CORRECTED,
    RANGES,
    Fitted,
    Following,
    Found,
    Range,
    add_constants,
)
from wakedeploy.gap.systems.mjcf.reading import loaded_mujoco, read_spec, silent
from wakedeploy.gap.systems.system import Constant
from wakedeploy.gap.wording import listed, quantity

_LINEAR = 1  # interpolation between the commands that an actuator remembers


def write_corrected(
    elements: Elements, constants: Mapping[str, Constant], answer: Answer, out: Path
) -> list[str]:
    """Write both files into a folder; returns sentences about what is written and what is not.

    `constants` are those that the system states, by name; `answer` has those that were fitted.
    """
    if answer.verdict in ("none", "unknown"):
        why = {"none": "nothing that matters is missing", "unknown": "what is missing is unknown"}
        return [_left_alone(elements, why[answer.verdict], out)]
    written = fitted(elements, constants, answer)
    if not written.has_effects:
        absent = [f"  {sentence}." for sentence in written.absent]
        return [_left_alone(elements, "MJCF has no attribute for what was found", out), *absent]
    write_text_whole(out / CORRECTED, _corrected(written, out))
    rows = [number.row() for number in written.ranges.values()]
    write_text_whole(out / RANGES, tomli_w.dumps({"version": 1, "range": rows}))
    for inputs, by in answer.shifted_together:
        if by.value > 0.0:
            acts = "acts" if len(inputs) == 1 else "act"
            written.said.append(
                f"{listed(inputs)} {acts} {quantity(by.value, 's')} after the logs' stamps, and "
                f"{CORRECTED} has no delay for that"
            )
    lines = [f"MJCF: {out / CORRECTED}, and what to randomise: {out / RANGES}"]
    absent = [f"{sentence}; {CORRECTED} is without it." for sentence in written.absent]
    return lines + [f"  {sentence}" for sentence in (*written.said, *absent)]


def fitted(elements: Elements, constants: Mapping[str, Constant], answer: Answer) -> Fitted:
    """Every number of the file that was fitted, stated otherwise or found."""
    written = Fitted(elements)
    add_constants(written, constants, answer.constants, is_open=bool(answer.rivals))
    for effect in answer.effects:
        add_effect(written, Found(effect.name, effect.parameters))
    add_commands(written)
    return written


def _left_alone(elements: Elements, why: str, out: Path) -> str:
    """Neither file, nor those of an earlier answer, which would pass for this one's."""
    earlier = [out / name for name in (CORRECTED, RANGES) if (out / name).exists()]
    for path in earlier:
        path.unlink()
    gone = "; those of an earlier answer are removed" if earlier else ""
    return (
        f"MJCF: {elements.path.name} stays as it is, as {why}: no {CORRECTED} and no {RANGES} with "
        f"refitted constants alone{gone}."
    )


def _corrected(written: Fitted, out: Path) -> str:
    """The file's text."""
    path = written.elements.path
    spec, model = read_spec(path)
    with silent(loaded_mujoco(path)):
        _keep_masses(spec, model)
        for number in written.ranges.values():
            _WRITERS.get(number.attribute, _write_number)(spec, model, number)
        for following in written.following.values():
            _write_following(spec, following)
        for folder in ("meshdir", "texturedir"):
            _rebase(spec, folder, path, out)
        spec.compile()
        return str(spec.to_xml())


def _keep_masses(spec: Any, model: Any) -> None:
    """All masses as compiled, where the compiler would make a fitted one what it was.

    It would scale them to a total once more, or take them from geoms in spite of what is stated.
    """
    import mujoco

    is_of_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if spec.compiler.settotalmass <= 0.0 and not is_of_geoms:
        return
    spec.compiler.settotalmass = -1.0
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    for body in spec.bodies:
        if body.name != "world" and model.body_mass[body.id] > 0.0:
            _set_inertia(body, model, float(model.body_mass[body.id]))


def _write_number(spec: Any, model: Any, number: Range) -> None:
    """A number of an element; in MJCF some are the first of several."""
    element = getattr(spec, number.element)(number.name)
    attribute, _, place = number.attribute.rstrip("]").partition("[")
    if isinstance(getattr(element, attribute), np.ndarray):
        getattr(element, attribute)[int(place or 0)] = number.nominal
    else:
        setattr(element, attribute, number.nominal)


def _write_following(spec: Any, following: Following) -> None:
    element = getattr(spec, following.element)(following.name)
    if following.attribute == "springref":
        import mujoco

        in_degrees = spec.compiler.degree and element.type == mujoco.mjtJoint.mjJNT_HINGE
        element.springref = math.degrees(following.values[0]) if in_degrees else following.values[0]
        return
    if following.attribute == "ctrlrange":
        element.inheritrange, element.ctrllimited = 0.0, True  # the range is stated now
    getattr(element, following.attribute)[:] = following.values


def _write_bias(spec: Any, model: Any, number: Range) -> None:
    """The constant of an affine bias; a motor has none yet, whatever numbers stand there."""
    import mujoco

    actuator = spec.actuator(number.name)
    if actuator.biastype == mujoco.mjtBias.mjBIAS_NONE:
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.biasprm[:] = 0.0
    actuator.biasprm[0] = number.nominal


def _write_kp(spec: Any, model: Any, number: Range) -> None:
    actuator = spec.actuator(number.name)
    actuator.gainprm[0], actuator.biasprm[1] = number.nominal, -number.nominal


def _write_kv(spec: Any, model: Any, number: Range) -> None:
    actuator = spec.actuator(number.name)
    if actuator.biasprm[1] == 0.0:  # a velocity servo
        actuator.gainprm[0] = number.nominal
    actuator.biasprm[2] = -number.nominal


def _write_delay(spec: Any, model: Any, number: Range) -> None:
    """With as many remembered commands as the delay has steps."""
    actuator = spec.actuator(number.name)
    actuator.delay, actuator.interp = max(number.nominal, 0.0), _LINEAR
    actuator.nsample = math.ceil(actuator.delay / model.opt.timestep) + 1


def _write_lag(spec: Any, model: Any, number: Range) -> None:
    import mujoco

    actuator = spec.actuator(number.name)
    if actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE:
        actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    actuator.dynprm[0] = number.nominal


def _write_mass(spec: Any, model: Any, number: Range) -> None:
    """The compiled body's inertia, explicit and scaled with the mass."""
    _set_inertia(spec.body(number.name), model, number.nominal)


def _set_inertia(body: Any, model: Any, mass_kg: float) -> None:
    import mujoco

    at = body.id
    body.explicitinertial, body.mass = True, mass_kg
    body.ipos, body.iquat = model.body_ipos[at], model.body_iquat[at]
    # Angles that the file states, and that inertias from geoms had left aside, would turn these.
    body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    body.fullinertia[:] = math.nan  # the compiled axes are those of the inertia
    body.inertia = mass_kg / float(model.body_mass[at]) * model.body_inertia[at]


def _rebase(spec: Any, folder: str, model: Path, out: Path) -> None:
    """Meshes and textures stay where they are."""
    there = getattr(spec, folder)
    if not os.path.isabs(there):
        setattr(spec, folder, os.path.relpath(model.resolve().parent / there, out.resolve()))


_WRITERS: dict[str, Callable[[Any, Any, Range], None]] = {
    "kp": _write_kp,
    "kv": _write_kv,
    "delay": _write_delay,
    "dynprm[0]": _write_lag,
    "mass": _write_mass,
    "biasprm[0]": _write_bias,
}
