"""What of an MJCF file an effect changes, so that MuJoCo then does what the effect does.

In: effects that were named, and what is to be written so far. Out: more of that, and a sentence for
an effect that stands elsewhere than under its own name, or nowhere. Only exact counterparts are
written, but for three: a lag or a delay is one of the command within limits, the bias of a filtered
command acts from the first moment, and friction that bends before it slides is plain dry friction.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from wakedeploy.gap.search.artefacts import Measured
from wakedeploy.gap.systems.mjcf.elements import Actuator, Elements, Joint
from wakedeploy.gap.systems.mjcf.ranges import CORRECTED, Fitted, Found, Range, as_is
from wakedeploy.gap.wording import listed

_RESISTS = {  # kinds: the attribute to which a parameter is added
    "viscous-friction": ("damping", "coefficient"),
    "quadratic-drag": ("damping[1]", "coefficient"),
    "coulomb-friction": ("frictionloss", "force"),
    "pre-sliding-friction": ("frictionloss", "force"),
}
_SPRINGS = {
    "stiffness": ("stiffness", "stiffness"),
    "square-stiffness": ("stiffness[1]", "coefficient"),
    "cubic-stiffness": ("stiffness[2]", "coefficient"),
}


def add_effect(written: Fitted, effect: Found) -> None:
    """Write an effect down, with a sentence where it has no attribute, or another than its own."""
    said = _added(written, effect)
    if isinstance(said, NoAttribute):
        written.absent.append(said)
        return
    written.has_effects = True
    written.said += [said] if said else []


def _added(written: Fitted, effect: Found) -> str:
    for joint in written.elements.joints:
        if joint.speed == effect.port and effect.kind in _OF_JOINT:
            if joint.body:
                return _without(effect, "a free joint has one number for all six axes")
            return _OF_JOINT[effect.kind](written, joint, effect)
    for actuator in written.elements.actuators:
        if actuator.command == effect.port and effect.kind in _OF_ACTUATOR:
            return _OF_ACTUATOR[effect.kind](written, actuator, effect)
    return _without(effect)


def add_commands(written: Fitted) -> None:
    """What acts on commands, once all is known: gain · (factor · command + sum)."""
    model = written.elements.model
    by_name = {a.name: a for a in written.elements.actuators}
    for name, (factor, added) in written.commands.items():
        actuator = by_name[name]
        i, gain = actuator.index, _gain_of(written, actuator)
        if factor.nominal != 1.0:
            scaled = gain.times(factor.size)
            written.ranges[scaled.key] = scaled
        if added.nominal != 0.0:
            written.add(_bias_of(written, actuator), added.size, gain.nominal)
        if model.actuator_ctrllimited[i]:
            low, high = ((float(end) - added.nominal) / factor.nominal
                         for end in model.actuator_ctrlrange[i])  # fmt: skip
            written.follow("actuator", name, "ctrlrange", low, high)
    for name, ends in written.cut.items():
        _cut(written, by_name[name], *ends)


def _cut(written: Fitted, actuator: Actuator, low: Range, high: Range) -> None:
    """Limits of a command that were found, within those that it has."""
    model, i = written.elements.model, actuator.index
    known = written.following.get(("actuator", actuator.name, "ctrlrange"))
    ends = (-math.inf, math.inf)
    if known is not None:
        ends = (known.values[0], known.values[1])
    elif model.actuator_ctrllimited[i]:
        ends = (float(model.actuator_ctrlrange[i, 0]), float(model.actuator_ctrlrange[i, 1]))
    tighter = [low] * (low.nominal > ends[0]) + [high] * (high.nominal < ends[1])
    written.ranges |= {end.key: end for end in tighter}
    within = max(low.nominal, ends[0]), min(high.nominal, ends[1])
    written.follow("actuator", actuator.name, "ctrlrange", *within)


class NoAttribute(str):
    """Says that MJCF has no attribute for an effect, and why."""


def _without(effect: Found, reason: str = "") -> NoAttribute:
    because = f", as {reason}" if reason else ""
    return NoAttribute(f"MJCF has no attribute for {effect.name}{because}")


def _resist(written: Fitted, joint: Joint, effect: Found) -> str:
    attribute, parameter = _RESISTS[effect.kind]
    _add_to_joint(written, joint, attribute, effect.parameters[parameter])
    return ""


def _add_to_joint(written: Fitted, joint: Joint, attribute: str, size: Measured) -> None:
    value = _of_joint(written.elements.model, joint, attribute)
    written.add(as_is("joint", joint.name, attribute, value, size.unit), size)


def _of_joint(model: Any, joint: Joint, attribute: str) -> float:
    name, _, place = attribute.rstrip("]").partition("[")
    kind, at = (
        ("jnt", int(model.dof_jntid[joint.dof])) if name == "stiffness" else ("dof", joint.dof)
    )
    if place:
        return float(getattr(model, f"{kind}_{name}poly")[at, int(place) - 1])
    return float(getattr(model, f"{kind}_{name}")[at])


def _inertia(written: Fitted, joint: Joint, effect: Found) -> str:
    value = float(written.elements.model.dof_armature[joint.dof])
    start = as_is("joint", joint.name, "armature", value, "kg m²" if joint.turns else "kg")
    written.add(start, effect.parameters["ratio"], joint.inertia)
    return ""


def _spring(written: Fitted, joint: Joint, effect: Found) -> str:
    """The effect's spring rests at position 0; the joint's own, if there is one, at springref."""
    attribute, parameter = _SPRINGS[effect.kind]
    model, size = written.elements.model, effect.parameters[parameter]
    at_m_rad = _rest(written, joint)
    of_file = [_of_joint(model, joint, key) for key, _ in _SPRINGS.values()]
    stiffness = written.value("joint", joint.name, "stiffness", of_file[0])
    if at_m_rad != 0.0:
        both = stiffness + size.value
        if not stiffness and not any(of_file):
            written.follow("joint", joint.name, "springref", 0.0)
        elif effect.kind == "stiffness" and both and not any(of_file[1:]):
            written.follow("joint", joint.name, "springref", stiffness * at_m_rad / both)
        else:
            return _without(effect, "the joint's own spring does not rest at 0")
    _add_to_joint(written, joint, attribute, size)
    return ""


def _preloaded(written: Fitted, joint: Joint, effect: Found) -> str:
    """A spring that rests where it bears nothing; a joint has one such place."""
    model = written.elements.model
    stiffness, preload = (effect.parameters[name] for name in ("stiffness", "preload"))
    springs = (
        written.value("joint", joint.name, attribute, _of_joint(model, joint, attribute))
        for attribute, _ in _SPRINGS.values()
    )
    if any(springs):
        return _without(effect, "the joint has a spring of its own, which rests elsewhere")
    if not stiffness.value > 0.0:
        return _without(effect, "the spring pushes away from where it rests")
    rest = preload.value / stiffness.value
    written.follow("joint", joint.name, "springref", rest)
    _add_to_joint(written, joint, "stiffness", stiffness)
    return ""


def _rest(written: Fitted, joint: Joint) -> float:
    """Where the joint's spring rests [rad, m], as it will be written."""
    moved = written.following.get(("joint", joint.name, "springref"))
    in_file = float(written.elements.model.qpos_spring[joint.qpos])
    return in_file if moved is None else moved.values[0]


def _offset(written: Fitted, joint: Joint, effect: Found) -> str:
    """A constant force is the bias of an actuator of the joint, times its gear."""
    model = written.elements.model
    driving = [a for a in written.elements.actuators if a.joint == joint.name]
    carrier = next((a for a in driving if a.is_affine and model.actuator_gear[a.index, 0]), None)
    if not driving:
        return _without(effect, f"no actuator drives joint {joint.name!r}")
    if carrier is None:
        return _without(effect, f"no actuator of joint {joint.name!r} has a bias to carry it")
    i, size = carrier.index, effect.parameters["force"]
    gear = written.value("actuator", carrier.name, "gear", float(model.actuator_gear[i, 0]))
    written.add(_bias_of(written, carrier), size, 1.0 / gear)
    moved = []
    if model.actuator_forcelimited[i]:
        _move(written, "actuator", carrier.name, "forcerange", model.actuator_forcerange[i],
              size.value / gear)  # fmt: skip
        moved.append("forcerange")
    at = int(model.dof_jntid[joint.dof])
    if model.jnt_actfrclimited[at]:
        _move(written, "joint", joint.name, "actfrcrange", model.jnt_actfrcrange[at],
              size.value)  # fmt: skip
        moved.append("actuatorfrcrange")
    return _carried(effect, carrier, "biasprm[0]", moved)


def _bias_of(written: Fitted, actuator: Actuator) -> Range:
    """The constant part of an actuator's force as the file has it."""
    value = float(written.elements.model.actuator_biasprm[actuator.index, 0])
    unit = _force_unit(written.elements, actuator)
    return as_is("actuator", actuator.name, "biasprm[0]", value if actuator.has_bias else 0.0, unit)


def _force_unit(elements: Elements, actuator: Actuator) -> str:
    return {True: "N m", False: "N", None: "1"}[elements.turns(actuator)]


def _move(written: Fitted, element: str, name: str, attribute: str, limits: Any, by: float) -> None:
    """A limit along with the force that now counts towards it; it clips the rest as before."""
    before = written.following.get((element, name, attribute))
    low, high = limits if before is None else before.values
    written.follow(element, name, attribute, float(low) + by, float(high) + by)


def _carried(effect: Found, actuator: Actuator, attribute: str, moved: list[str]) -> str:
    limits = f"; with it moves its {listed(moved)}, to clip as before" if moved else ""
    return f"{effect.name} is {attribute} of actuator {actuator.name!r} in {CORRECTED}{limits}."


def _delay(written: Fitted, actuator: Actuator, effect: Found) -> str:
    start = as_is("actuator", actuator.name, "delay", actuator.delay_s, "s")
    written.add(start, effect.parameters["delay_s"])
    return ""


def _lag(written: Fitted, actuator: Actuator, effect: Found) -> str:
    if actuator.act >= 0:
        return _without(effect, f"actuator {actuator.name!r} has a state of its own already")
    start = as_is("actuator", actuator.name, "dynprm[0]", 0.0, "s")
    written.add(start, effect.parameters["tau_s"])
    return ""


def _command(written: Fitted, actuator: Actuator, effect: Found) -> str:
    """A command that is scaled or moved: the actuator's own factor and constant, and its limits.

    An integrator would add up a constant, and limits of a state stay where they are.
    """
    if not (actuator.is_affine and actuator.has_fixed_gain):
        return _without(
            effect, f"the force of actuator {actuator.name!r} is not linear in its command"
        )
    model, i = written.elements.model, actuator.index
    if actuator.act >= 0 and (not actuator.filters or model.actuator_actlimited[i]):
        return _without(
            effect, f"actuator {actuator.name!r} integrates its command or limits its state"
        )
    factor, added = written.commands.get(actuator.name) or _as_given(actuator)
    limits = ["ctrlrange"] * int(model.actuator_ctrllimited[i])
    if effect.kind == "bias":
        written.commands[actuator.name] = factor, added.plus(effect.parameters["bias"])
        return _carried(effect, actuator, "biasprm[0]", limits)
    error = effect.parameters["error"]
    scale = Measured(value=1.0 + error.value, low=1.0 + error.low, high=1.0 + error.high, unit="1")
    if scale.value <= 0.0:
        return _without(effect, "a command that is turned round or lost is none")
    written.commands[actuator.name] = factor.times(scale), added.times(scale)
    return _carried(effect, actuator, "gainprm[0]", limits)


def _as_given(actuator: Actuator) -> tuple[Range, Range]:
    """The factor and the sum of a command that nothing acts on."""
    factor, added = (as_is("actuator", actuator.name, "", number, "") for number in (1.0, 0.0))
    return factor, added


def _gain_of(written: Fitted, actuator: Actuator) -> Range:
    """The factor of a command, as it is fitted: kp or kv of a servo."""
    attribute = {"position": "kp", "velocity": "kv"}.get(actuator.kind, "gainprm[0]")
    fit = written.ranges.get(("actuator", actuator.name, attribute))
    if fit is not None:
        return replace(fit, attribute="gainprm[0]")
    value = float(written.elements.model.actuator_gainprm[actuator.index, 0])
    stated = written.elements.attributes.get(f"{actuator.word}_{attribute}")
    unit = _force_unit(written.elements, actuator) if stated is None else stated.unit
    return as_is("actuator", actuator.name, "gainprm[0]", value, unit)


def _saturation(written: Fitted, actuator: Actuator, effect: Found) -> str:
    """A limit to the command, which acts before all else: a range of commands."""
    limit = effect.parameters["limit"]
    if not limit.value > 0.0:
        return _without(effect, "it cuts all of the command")
    low, high = (
        as_is("actuator", actuator.name, attribute, 0.0, limit.unit).plus(limit, way)
        for attribute, way in (("ctrlrange[0]", -1.0), ("ctrlrange[1]", 1.0))
    )
    written.cut[actuator.name] = low, high
    return f"{effect.name} is the ctrlrange of actuator {actuator.name!r} in {CORRECTED}."


_OF_JOINT: dict[str, Callable[[Fitted, Joint, Found], str]] = {
    **dict.fromkeys(_RESISTS, _resist),
    **dict.fromkeys(_SPRINGS, _spring),
    "preloaded-spring": _preloaded,
    "added-inertia": _inertia,
    "offset": _offset,
}
_OF_ACTUATOR: dict[str, Callable[[Fitted, Actuator, Found], str]] = {
    "dead-time": _delay,
    "lag": _lag,
    "bias": _command,
    "gain": _command,
    "saturation": _saturation,
}
