"""The file that `gap init` writes: a system that runs as it is, for a person to make their own."""

import json
import keyword
import re
from collections.abc import Mapping

TEMPLATE = '''"""NAME: a system for `wakedeploy gap`; the library does the rest."""

import numpy as np

from wakedeploy import Constant, Input, Output, Port, System


class CLASS(System):
    """A mass that a motor pushes: m a = k u."""

    rate_hz = 100.0  # samples a second at which it is compared; divides that of the logs
    inputs = [Input("voltage_v", "V")]  # logged; hold="bandlimited" for a recorder's own signal
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-4)]  # logged; a sensor's sd, roughly
    constants = [
        Constant("mass_kg", 2.0, spread=0.1),  # as measured, ± 0.1 kg; 0 is exact
        Constant("gain_n_per_v", 1.5, spread=0.1),  # float("inf"): nobody has measured it
    ]
    ports = [  # where effects may act
        Port.input("voltage_v"),
        Port.force("speed_mps", inertia="mass_kg", position="position_m"),
        Port.output("position_m"),
    ]

    def derivative(self, state, inputs, c):
        """Written for one point, called with arrays: numpy alone, np.where instead of if."""
        force = c.gain_n_per_v * np.asarray(inputs.voltage_v)
        return {"position_m": state.speed_mps, "speed_mps": force / c.mass_kg}
'''


def template(stem: str) -> str:
    """The file's text; `stem` is its name without the ending."""
    return filled(TEMPLATE, {"NAME": in_docstring(stem), "CLASS": class_name(stem)})


def filled(text: str, values: Mapping[str, str]) -> str:
    """A text with values for its words in capitals, none of which is looked into again."""
    return re.sub(rf"\b(?:{'|'.join(values)})\b", lambda found: values[found[0]], text)


def in_docstring(name: str) -> str:
    """A file's name as part of a docstring."""
    return literal(name)[1:-1]


def literal(name: str) -> str:
    """A file's name in Python, in quotes."""
    return json.dumps(name, ensure_ascii=False)


def class_name(stem: str) -> str:
    """What a file's class is called: `my_robot` has `MyRobot`, `3 arms.v2` has `System3ArmsV2`."""
    allowed = (c if f"a{c}".isidentifier() and c != "_" else " " for c in stem)
    name = "".join(w[:1].upper() + w[1:] for w in "".join(allowed).split()) or "Robot"
    return name if name.isidentifier() and not keyword.iskeyword(name) else f"System{name}"
