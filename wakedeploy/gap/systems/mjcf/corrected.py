"""An answer as a corrected MJCF, and as ranges from which to randomise.

In: an MJCF file and what `gap name` found in a system of it. Out: `corrected.xml`, with damping,
dry friction, armature, gains, masses, dead times and lags as the logs have them, and `ranges.toml`
with the value and the interval of each. What MJCF has no attribute for is said by name.
"""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from wakedeploy.core.files import write_text_whole
from wakedeploy.gap.systems.mjcf.elements import Attribute, Elements, read_spec

CORRECTED, RANGES = "corrected.xml", "ranges.toml"
_LINEAR = 1  # interpolation between the commands that an actuator remembers

Told = Mapping[str, Any]
Key = tuple[str, str, str]


@dataclass(frozen=True)
class Range:
    """An attribute of the file: its value by the logs, and the interval in which it may lie."""

    element: str
    name: str
    attribute: str
    nominal: float
    low: float
    high: float
    unit: str

    @property
    def key(self) -> Key:
        """Its place in the file."""
        return self.element, self.name, self.attribute

    def more(self, size: Told, factor: float = 1.0) -> "Range":
        """The same with a found value on top, its interval with it."""
        nominal, low, high = (factor * float(size[k]) for k in ("value", "low", "high"))
        return replace(
            self, nominal=self.nominal + nominal, low=self.low + low, high=self.high + high
        )


def write_corrected(elements: Elements, answer: Told, out: Path) -> list[str]:
    """Write both files into a folder; returns a sentence for each, and for what has no attribute.

    `answer` is what `name.json` has: effects and constants with `value`, `low`, `high` and `unit`.
    """
    ranges, inexpressible = ranges_of(elements, answer)
    spec, model = read_spec(elements.path)
    for fitted in ranges:
        _WRITERS.get(fitted.attribute, _write_number)(spec, model, fitted)
    for folder in ("meshdir", "texturedir"):
        _rebase(spec, folder, elements.path, out)
    spec.compile()
    write_text_whole(out / CORRECTED, spec.to_xml())
    rows = [{f: getattr(fitted, f) for f in Range.__dataclass_fields__} for fitted in ranges]
    write_text_whole(out / RANGES, tomli_w.dumps({"version": 1, "range": rows}))
    lines = [f"MJCF: {out / CORRECTED}, and what to randomise: {out / RANGES}"]
    return lines + [
        f"  MJCF has no attribute for {name}; {CORRECTED} is without it." for name in inexpressible
    ]


def ranges_of(elements: Elements, answer: Told) -> tuple[list[Range], list[str]]:
    """Every attribute that was fitted or found, and the effects that MJCF cannot express."""
    found: dict[Key, Range] = {}
    for name, value in answer["constants"].items():
        if name in elements.attributes:
            fitted = _zero(elements.attributes[name], value["unit"]).more(value)
            found[fitted.key] = fitted
    inexpressible = []
    for effect in answer["effects"]:
        kind, _, port = effect["name"].partition("@")
        added = _added(elements, kind, port, effect["parameters"])
        if added is None:
            inexpressible.append(effect["name"])
            continue
        start, value, factor = added
        found[start.key] = found.get(start.key, start).more(value, factor)
    return list(found.values()), inexpressible


def _zero(of: Attribute, unit: str) -> Range:
    return Range(of.element, of.of, of.attribute, 0.0, 0.0, 0.0, unit)


_OF_JOINT = {  # kinds: the attribute to which a parameter is added
    "viscous-friction": ("damping", "coefficient"),
    "coulomb-friction": ("frictionloss", "force"),
    "pre-sliding-friction": ("frictionloss", "force"),
    "stiffness": ("stiffness", "stiffness"),
    "added-inertia": ("armature", "ratio"),
}
_OF_ACTUATOR = {"dead-time": ("delay", "delay_s"), "lag": ("lag", "tau_s")}


def _added(
    elements: Elements, kind: str, port: str, parameters: Told
) -> tuple[Range, Told, float] | None:
    """An attribute as the file has it, what is added to it, and a factor; None for no attribute."""
    for joint in elements.joints:
        if port == joint.speed and kind in _OF_JOINT:
            attribute, parameter = _OF_JOINT[kind]
            is_inertia = kind == "added-inertia"
            factor = joint.inertia if is_inertia else 1.0
            inertia = "kg m²" if joint.turns else "kg"
            unit = inertia if is_inertia else parameters[parameter]["unit"]
            start = _as_is(
                "joint", joint.name, attribute, _of_joint(elements, joint.dof, attribute)
            )
            return replace(start, unit=unit), parameters[parameter], factor
    for actuator in elements.actuators:
        if port == actuator.command and kind in _OF_ACTUATOR:
            if kind == "lag" and actuator.act >= 0:
                return None
            attribute, parameter = _OF_ACTUATOR[kind]
            start = _as_is("actuator", actuator.name, attribute, 0.0)
            return replace(start, unit="s"), parameters[parameter], 1.0
    return None


def _as_is(element: str, name: str, attribute: str, value: float) -> Range:
    return Range(element, name, attribute, value, value, value, "")


def _of_joint(elements: Elements, dof: int, attribute: str) -> float:
    if attribute == "stiffness":
        return float(elements.model.jnt_stiffness[elements.model.dof_jntid[dof]])
    return float(getattr(elements.model, f"dof_{attribute}")[dof])


def _write_number(spec: Any, model: Any, fitted: Range) -> None:
    """A number of an element; in MJCF some are the first of a polynomial's."""
    element = getattr(spec, fitted.element)(fitted.name)
    if isinstance(getattr(element, fitted.attribute), np.ndarray):
        getattr(element, fitted.attribute)[0] = fitted.nominal
    else:
        setattr(element, fitted.attribute, fitted.nominal)


def _write_kp(spec: Any, model: Any, fitted: Range) -> None:
    actuator = spec.actuator(fitted.name)
    actuator.gainprm[0], actuator.biasprm[1] = fitted.nominal, -fitted.nominal


def _write_kv(spec: Any, model: Any, fitted: Range) -> None:
    actuator = spec.actuator(fitted.name)
    if actuator.biasprm[1] == 0.0:  # a velocity servo
        actuator.gainprm[0] = fitted.nominal
    actuator.biasprm[2] = -fitted.nominal


def _write_delay(spec: Any, model: Any, fitted: Range) -> None:
    """With as many remembered commands as the delay has steps."""
    actuator = spec.actuator(fitted.name)
    actuator.delay, actuator.interp = max(fitted.nominal, 0.0), _LINEAR
    actuator.nsample = math.ceil(actuator.delay / model.opt.timestep) + 1


def _write_lag(spec: Any, model: Any, fitted: Range) -> None:
    import mujoco

    actuator = spec.actuator(fitted.name)
    actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    actuator.dynprm[0] = fitted.nominal


def _write_mass(spec: Any, model: Any, fitted: Range) -> None:
    """The compiled body's inertia, explicit and scaled with the mass."""
    body, compiled = spec.body(fitted.name), model.body(fitted.name)
    share = fitted.nominal / float(compiled.mass[0])
    body.explicitinertial, body.mass = True, fitted.nominal
    body.ipos, body.iquat = compiled.ipos, compiled.iquat
    body.inertia = share * compiled.inertia


def _rebase(spec: Any, folder: str, model: Path, out: Path) -> None:
    """Meshes and textures stay where they are."""
    there = getattr(spec, folder)
    if not os.path.isabs(there):
        setattr(spec, folder, os.path.relpath(model.resolve().parent / there, out.resolve()))


_WRITERS: dict[str, Callable[[Any, Any, Range], None]] = {
    "kp": _write_kp,
    "kv": _write_kv,
    "delay": _write_delay,
    "lag": _write_lag,
    "mass": _write_mass,
}
