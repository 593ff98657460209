"""Kinds of files of a user's own system: a MuJoCo model, a plain CSV log, what `gap name` wrote."""

import functools
import re
from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np

from benchmarks.fuzz.documents import as_json, json_file
from benchmarks.fuzz.kind import Files, Kind
from benchmarks.fuzz.tables import csv_file
from benchmarks.fuzz.text import NUMBERS, any_text
from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.artefacts import Answer
from wakedeploy.gap.systems.files import read_plain
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.known import NAME, stated_answer, stated_sizes
from wakedeploy.gap.systems.ports import Point

LOG = "tuesday.csv"
_DRAG, _LAG = "viscous-friction@speed_mps", "lag@force_n"


def kinds() -> dict[str, Callable[[], Kind]]:
    """What makes each kind, by its name."""
    return {"mjcf": _mjcf, "own-log": _log, "own-answer": _answer}


class _Mass(System):
    """A mass on a spring."""

    rate_hz = 50.0
    inputs = [Input("force_n", "N", low=-20.0, high=20.0)]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", 2.0)]
    ports = [
        Port.input("force_n", kinds=["dead-time", "lag"]),
        Port.force("speed_mps", inertia="mass_kg", position="position_m",
                   kinds=["viscous-friction"]),
    ]  # fmt: skip

    def derivative(self, state: Point, inputs: Point, c: Point) -> dict[str, object]:
        """Speed and acceleration."""
        force = inputs.force_n - 30.0 * state.position_m - 3.0 * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": force / c.mass_kg}


@functools.cache
def _recorded() -> Recording:
    """What the reader does not look at need not be physical."""
    time_s = np.arange(400) / _Mass.rate_hz
    columns = {"force_n": 5.0 * np.sin(3.0 * time_s), "position_m": 0.1 * np.sin(2.9 * time_s)}
    return Recording("made", time_s, columns)


def _log() -> Kind:
    recorded = _recorded()
    names = ["time_s", *recorded.columns]
    table = np.column_stack([recorded.time_s, *recorded.columns.values()])
    lines = [",".join(names), *(",".join(f"{value:.6g}" for value in row) for row in table)]
    text = "\n".join(lines).encode() + b"\n"
    return Kind("own-log", "plain logs of own systems", ({LOG: text},), _opened,
                {"*.csv": csv_file}, names=(Path(LOG).stem,))  # fmt: skip


def _opened(folder: Path) -> None:
    """As every gap command with `--system` does."""
    system = _Mass()
    LogModel(system, [read_plain(folder / LOG, system)])


_SIZE = {"value": 0.05, "low": 0.04, "high": 0.06, "unit": "s"}


@functools.cache
def _model() -> LogModel:
    return LogModel(_Mass(), [_recorded()])


def _ranked(name: str, gain: float) -> dict[str, object]:
    sizes = {}
    for free in _model().effects[name]:
        value = 0.5 * (free.neutral + free.high)
        sizes[free.name] = _SIZE | {"value": value, "unit": free.unit}
    return {"name": name, "gain_nats": gain, "needed_nats": 3.0,
            "interval": [gain - 2.0, gain + 2.0], "parameters": sizes}  # fmt: skip


def _answer() -> Kind:
    rounds = [{"given": [], "threshold_nats": 3.0, "steady_nats": 3.0, "class": [_DRAG, _LAG],
               "ranking": [_ranked(_DRAG, 9.0), _ranked(_LAG, 8.0)]}]  # fmt: skip
    content = Answer.model_validate({
        "domain": "_Mass", "key": "0" * 64, "verdict": "class", "class": [_DRAG, _LAG],
        "threshold_nats": 3.0, "effects": [], "parameters": {}, "constants": {"mass_kg": _SIZE},
        "noise": {"position_m": {"value": 1e-3, "unit": "m"}}, "rounds": rounds, "unsettled": [],
        "sealed_gain_nats": 4.0, "found_theta": {"mass_kg": 2.0},
    }).as_json()  # fmt: skip
    sound: tuple[Files, ...] = ({NAME: as_json(content)},)
    return Kind("own-answer", "answers of own systems", sound, _planned, {"*.json": json_file})


def _planned(folder: Path) -> None:
    """As `gap plan --system` begins."""
    answer = stated_answer(folder)
    if answer is not None:
        stated_sizes(folder, answer, _model(), tuple(answer.rivals))


_ARM = b"""<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.05" armature="0.01" frictionloss="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" type="slide" axis="0 1 0" damping="0.03" range="-1 1" limited="true"/>
        <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="30" kv="1.0" forcerange="-20 20"/>
    <motor name="elbow" joint="elbow" gear="2"/>
  </actuator>
  <sensor><jointpos joint="shoulder"/><jointvel joint="elbow"/></sensor>
</mujoco>
"""
_LEVER = b"""<mujoco>
  <size nuserdata="1"/>
  <default><joint damping="0.1"/></default>
  <worldbody>
    <body name="link">
      <inertial pos="0.1 0 0" mass="0.5" diaginertia="0.01 0.01 0.01"/>
      <joint name="pivot" axis="0 1 0"/>
      <replicate count="2"><site pos="0 0 0.1"/></replicate>
    </body>
  </worldbody>
  <actuator><general name="pivot" joint="pivot" dyntype="filterexact" dynprm="0.05"/></actuator>
</mujoco>
"""


def _mjcf() -> Kind:
    from wakedeploy.gap.systems.mjcf.template import mjcf_template

    def read(folder: Path) -> None:
        """As `gap init --mjcf` does, and every gap command with what it writes."""
        mjcf_template(folder / "model.xml", folder / "model.py")

    sound: tuple[Files, ...] = ({"model.xml": _ARM}, {"model.xml": _LEVER})
    return Kind("mjcf", "MuJoCo models", sound, read, {"*.xml": xml_file})


_ATTRIBUTE = re.compile(rb'(\w+)="([^"]*)"')
_ELEMENT = re.compile(rb"<\w+[^<>]*/>")
_ADDED = (
    b'nuser_body="9"', b'nsample="5"', b'delay="0.1"', b'user="1 2"', b'mass="1"', b'limited="1"',
    b'ref="1"', b'stiffness="1"', b'armature="0"', b'class="x"', b'group="9"', b'count="9"',
)  # fmt: skip


def xml_file(draw: Random, data: bytes, other: bytes) -> bytes:
    """An XML file with other attributes or elements, or damaged as a text."""
    for _ in range(draw.choice((1, 1, 2, 4))):
        attributes, elements = list(_ATTRIBUTE.finditer(data)), list(_ELEMENT.finditer(data))
        if not attributes or not elements or draw.random() < 0.25:
            return any_text(draw, data, other)
        way = draw.randrange(6)
        found = draw.choice(attributes if way < 4 else elements)
        new = b""  # left out
        if way < 2:
            new = b'%s="%s"' % (found[1], draw.choice(NUMBERS).encode())
        elif way == 2:
            new = b'%s="%s"' % (found[1], draw.choice(attributes)[2])
        elif way == 3:
            new = draw.choice((b"", found[0] + b" " + draw.choice(_ADDED)))
        elif way == 4:
            new = draw.choice((b"", found[0] * 2, draw.choice(elements)[0]))
        else:
            new = found[0] * draw.choice((3, 200))
        data = data[: found.start()] + new + data[found.end() :]
    return data
