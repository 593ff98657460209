"""The file that `gap init --mjcf` writes: an MJCF model's names, constants and ports, to be edited.

In: an MJCF file and the path of the Python file. Out: its text. What is 0 in the model (damping,
dry friction, a lag) is no constant there: it may be missing, and the search says so by name.
"""

import os
import textwrap
from dataclasses import replace
from pathlib import Path

from wakedeploy.gap.systems.mjcf.elements import Actuator, Attribute, Elements, Joint
from wakedeploy.gap.systems.mjcf.reading import read_elements
from wakedeploy.gap.systems.template import class_name, filled, in_docstring, literal
from wakedeploy.gap.wording import listed

_UNITS = {  # of a command, by what it asks for: on a slide, on a hinge
    "position": ("m", "rad"), "velocity": ("m/s", "rad/s"), "force": ("N", "N m"),
    "pressure": ("Pa", "Pa"), "voltage": ("V", "V"),
}  # fmt: skip
_NOISE = {"_rad": 1e-3, "_m": 1e-4, "_radps": 1e-2, "_mps": 1e-3}

_BODY = """
# What a body that moves freely may lack, along the world's axes and about its own; damping,
# dry friction and armature of its joint are taken as exact.
BODY = [
    "viscous-friction", "quadratic-drag", "added-inertia", "offset", "ground-effect",
]"""

_TEXT = '''"""STEM: the MuJoCo model FILE, as a system for `wakedeploy gap`."""

from pathlib import Path

from wakedeploy import Constant, Input, MjcfSystem, Output, Port

# What an actuator, a joint and a sensor may lack; leave `kinds` away for all that is known.
COMMAND = ["dead-time", "lag", "rate-limit", "backlash", "dead-band", "saturation", "gain", "bias"]
JOINT = [
    "viscous-friction", "coulomb-friction", "stribeck-friction", "pre-sliding-friction",
    "quadratic-drag", "added-inertia", "stiffness", "gravity", "offset", "periodic-force",
]
SENSOR = ["sensor-gain", "sensor-bias", "sensor-lag", "sensor-dead-time"]BODIES


class CLASS(MjcfSystem):
    """FILE as it is; what logs show beyond it is what the search names."""

    mjcf = Path(__file__).parent / PLACE
    rate_hz = 100.0  # samples a second; divides that of the logs, and half takes half as long
    inputs = [  # the commands, by the names of the log or of [columns.NAME]
INPUTS
    ]
    states = {
STATES
    }
    outputs = [  # what the log has; a sensor's sd, roughly; take out what is not logged
OUTPUTS
    ]
    # The model's numbers, and how well they are known; spread=0 is exact. Taken as exact, too:
    # lengths, inertias beside masses, gravity, limits, springref, equalities, and what is 0.
    constants = [
CONSTANTS
    ]
    ports = [  # where effects may act; take out what is known to be right
PORTS
    ]
'''


def mjcf_template(model: Path, target: Path) -> str:
    """The text of the Python file `target` for an MJCF file; UnusableInput where it is damaged."""
    elements = read_elements(model)
    file = os.path.relpath(model.resolve(), target.resolve().parent)
    shown = _outputs(elements)
    sections = {
        "INPUTS": [_input(actuator, elements) for actuator in elements.actuators],
        "STATES": [f'"{name}": "{unit}",' for name, unit in _states(elements)],
        "OUTPUTS": [f'Output("{n}", "{u}", noise={_noise(n, elements):g}),' for n, u in shown],
        "CONSTANTS": [
            *(_constant(name, attribute) for name, attribute in elements.attributes.items()),
            *(_inertia(j) for j in elements.joints),
        ],
        "PORTS": [
            *(f"# {line}" for names in elements.coupled for line in _wrapped(_coupling(names))),
            *(f'Port.input("{a.command}", kinds=COMMAND),' for a in elements.actuators),
            *(_force(j) for j in elements.joints),
            *(f'Port.output("{n}", kinds=SENSOR),' for n, _ in shown),
        ],
    }
    values = {
        part: "\n".join(f"        {line}" for line in lines) for part, lines in sections.items()
    }
    values |= {"CLASS": class_name(target.stem), "STEM": in_docstring(target.stem)}
    values |= {"BODIES": _BODY if any(j.body for j in elements.joints) else ""}
    return filled(_TEXT, values | {"FILE": in_docstring(file), "PLACE": literal(file)})


def coupling_notes(model: Path) -> list[str]:
    """What each equality between joints costs a search, and what to do about it."""
    return [_coupling(names) for names in read_elements(model).coupled]


def _coupling(names: tuple[str, ...]) -> str:
    held = f"joints {listed(names)} are" if len(names) > 1 else f"joint {names[0]} is"
    return (
        f"{held} held by an equality, and each counts in full: with twice as many joints a search "
        "takes many times as long. Where it is not about them, take them and the equality out of "
        "the model, or at least their ports out of the system"
    )


def _states(elements: Elements) -> list[tuple[str, str]]:
    """Positions, speeds and activations with their units."""
    joints = elements.joints
    states = [(j.position, "rad" if j.turns else "m") for j in joints]
    states += [(j.speed, "rad/s" if j.turns else "m/s") for j in joints]
    return states + [(a.state, _state_unit(a, elements)) for a in elements.actuators if a.act >= 0]


def _outputs(elements: Elements) -> list[tuple[str, str]]:
    """What sensors of joints show, or every position where the model has no such sensor.

    Where a body is that moves freely is logged by what stands beside it.
    """
    of_joints = _states(elements)[: 2 * len(elements.joints)]
    beside = {j.position for j in elements.joints if j.body}
    sensed = {*elements.sensed, *beside}
    if not any({j.position, j.speed} & sensed for j in elements.joints if not j.body):
        sensed |= {j.position for j in elements.joints}
    return [(n, u) for n, u in of_joints if n in sensed]


def _input(actuator: Actuator, elements: Elements) -> str:
    delay = f", delay_s={actuator.delay_s:.6g}" if actuator.delay_s else ""
    return f'Input("{actuator.command}", "{_unit(actuator, elements)}"{delay}),'


def _unit(actuator: Actuator, elements: Elements) -> str:
    """A command's unit: that of what it asks for, "1" where joint and actuator do not say."""
    turns = elements.turns(actuator)
    if actuator.wrench_unit:
        return actuator.wrench_unit
    if actuator.follows in ("pressure", "voltage"):
        return _UNITS[actuator.follows][0]
    return "1" if turns is None or not actuator.follows else _UNITS[actuator.follows][turns]


def _state_unit(actuator: Actuator, elements: Elements) -> str:
    """An activation's unit: that of the command it filters, or of the position it integrates to."""
    if actuator.integrates and actuator.follows == "velocity":
        return _unit(replace(actuator, follows="position"), elements)
    return _unit(actuator, elements) if actuator.filters else "1"


def _noise(name: str, elements: Elements) -> float:
    """As its sensor states it, else roughly what such sensors have."""
    return elements.sensed.get(name) or next(sd for end, sd in _NOISE.items() if name.endswith(end))


def _constant(name: str, attribute: Attribute) -> str:
    unit = "" if name.endswith(("_kg", "_s")) else f', unit="{attribute.unit}"'
    spread = abs(attribute.spread * attribute.value)
    return f'Constant("{name}", {attribute.value:.6g}, spread={spread:.2g}{unit}),'


def _inertia(joint: Joint) -> str:
    """The size of forces at a joint; it is no attribute of the file."""
    return f'Constant("{joint.inertia_name}", {joint.inertia:.4g}),  # in the pose of the file'


def _force(joint: Joint) -> str:
    if joint.body:
        height = f'height="{joint.position}", ' if joint.word.endswith("_z") else ""
        return f'Port.force("{joint.speed}", inertia="{joint.inertia_name}", {height}kinds=BODY),'
    return (
        f'Port.force("{joint.speed}", inertia="{joint.inertia_name}", '
        f'position="{joint.position}", kinds=JOINT),'
    )


def _wrapped(sentence: str) -> list[str]:
    return textwrap.wrap(sentence, 86)
