"""Small plants: the textbook system of each, and the truth, written here a second time.

In: a state, what reaches the plant, and what is hidden in it. Out: rates. The truth is in plain
floats and shares no code with the library's effects.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wakedeploy import Constant, Input, Output, Port, System

INF = float("inf")
Hidden = Mapping[str, float]
Rates = Callable[[list[float], float, Hidden], list[float]]


class Cart(System):
    """A cart on a rail: m a = F − b v."""

    rate_hz = 100.0
    inputs = [Input("force_n", "N")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", 2.0, spread=0.1), Constant("damping", 1.0, 0.1, "N s/m")]
    ports = [
        Port.input("force_n"),
        Port.force("speed_mps", inertia="mass_kg", position="position_m"),
        Port.output("position_m"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """Force over mass."""
        force = inputs.force_n - c.damping * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": force / c.mass_kg}


def cart(x: list[float], u: float, hidden: Hidden) -> list[float]:
    """The same of 2.06 kg, with what rubs, springs, teeth of a rack, and a magnet beside the rail.

    The magnet holds it back. A bristle, where there is one, is a third state (Dahl, 1968).
    """
    force = u - 0.97 * x[1] - _rubbing(x[1], hidden)
    force -= (
        hidden.get("spring", 0.0) * (x[0] - hidden.get("rests_m", 0.0))
        + hidden.get("cubic", 0.0) * x[0] ** 3
    )
    force -= hidden.get("teeth", 0.0) * math.sin(2 * math.pi * x[0] / hidden.get("pitch_m", 1.0))
    force -= hidden.get("magnet", 0.0) * math.exp(-(((x[0] - 0.1) / 0.2) ** 2))
    if "bristle" in hidden:
        bent = (x[1] - abs(x[1]) * x[2]) / hidden["bends_m"]
        return [x[1], (force - hidden["bristle"] * x[2]) / 2.06, bent]
    return [x[1], force / 2.06]


class Swing(System):
    """A driven pendulum: I θ'' = τ − m g l sin θ − b θ'."""

    rate_hz = 100.0
    inputs = [Input("torque_nm", "N m")]
    states = {"angle_rad": "rad", "speed_radps": "rad/s"}
    outputs = [Output("angle_rad", "rad", noise=1e-3)]
    constants = [
        Constant("inertia_kgm2", 0.15, spread=0.006),
        Constant("weight_nm", 3.0, spread=0.1, unit="N m"),
        Constant("damping", 0.05, 0.01, "N m s"),
    ]
    ports = [
        Port.input("torque_nm"),
        Port.force("speed_radps", inertia="inertia_kgm2", position="angle_rad"),
        Port.output("angle_rad"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """Torque over inertia."""
        torque = inputs.torque_nm - c.weight_nm * np.sin(state.angle_rad)
        torque = torque - c.damping * state.speed_radps
        return {"angle_rad": state.speed_radps, "speed_radps": torque / c.inertia_kgm2}


def swing(x: list[float], u: float, hidden: Hidden) -> list[float]:
    """The same of 0.146 kg m², with what rubs."""
    torque = u - 3.06 * math.sin(x[0]) - 0.052 * x[1] - _rubbing(x[1], hidden)
    return [x[1], (torque - hidden.get("drag", 0.0) * x[1] * abs(x[1])) / 0.146]


class TwoMasses(System):
    """A motor turns a load through a shaft; speed of the motor and twist of the shaft are seen."""

    rate_hz = 200.0
    inputs = [Input("torque_nm", "N m")]
    states = {"twist_rad": "rad", "motor_radps": "rad/s", "load_radps": "rad/s"}
    outputs = [
        Output("motor_radps", "rad/s", noise=0.05),
        Output("load_radps", "rad/s", noise=0.05),
    ]
    constants = [
        Constant("motor_kgm2", 0.01, spread=3e-4),
        Constant("load_kgm2", 0.03, spread=1e-3),
        Constant("shaft", 20.0, 1.0, "N m/rad"),
        Constant("damping", 0.02, 0.005, "N m s"),
    ]
    ports = [
        Port.input("torque_nm"),
        Port.force("motor_radps", inertia="motor_kgm2"),
        Port.force("load_radps", inertia="load_kgm2"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """Torques over inertias."""
        apart = state.motor_radps - state.load_radps
        shaft = c.shaft * state.twist_rad + c.damping * apart
        return {
            "twist_rad": apart,
            "motor_radps": (inputs.torque_nm - shaft) / c.motor_kgm2,
            "load_radps": shaft / c.load_kgm2,
        }


def two_masses(x: list[float], u: float, hidden: Hidden) -> list[float]:
    """The same of 0.0098 and 0.031 kg m²; the load rubs."""
    apart = x[1] - x[2]
    shaft = 20.6 * x[0] + 0.021 * apart
    load = shaft - _rubbing(x[2], hidden)
    return [apart, (u - shaft) / 0.0098, load / 0.031]


class Tank(System):
    """A pump fills a tank that drains through a hole."""

    rate_hz = 1.0
    inputs = [Input("pump", "V")]
    states = {"level_m": "m"}
    outputs = [Output("level_m", "m", noise=2e-3)]
    constants = [
        Constant("inflow", 0.004, 2e-4, "m/s/V"),
        Constant("outflow", 0.012, 4e-4, "m^0.5/s"),
    ]
    ports = [
        Port.input("pump"),
        Port.force("level_m", position="level_m"),
        Port.output("level_m"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """What flows in less what flows out."""
        out = c.outflow * np.sqrt(np.maximum(state.level_m, 1e-4))
        return {"level_m": c.inflow * inputs.pump - out}


def tank(x: list[float], u: float, hidden: Hidden) -> list[float]:
    """The same with constants of its own, a rim, and a leak that does not ask for the level."""
    level = max(x[0], 1e-4)
    flow = 0.00408 * u - 0.0118 * math.sqrt(level) - hidden.get("leak", 0.0)
    return [flow - 0.2 * max(x[0] - hidden.get("rim", 1e9), 0.0)]


class Motor(System):
    """A motor's speed: J w' = k u − b w."""

    rate_hz = 100.0
    inputs = [Input("voltage_v", "V")]
    states = {"speed_radps": "rad/s"}
    outputs = [Output("speed_radps", "rad/s", noise=0.3)]
    constants = [
        Constant("inertia_kgm2", 0.002, spread=6e-5),
        Constant("gain", 0.05, 2e-3, "N m/V"),
        Constant("damping", 0.004, INF, "N m s"),
    ]
    ports = [
        Port.input("voltage_v"),
        Port.force("speed_radps", inertia="inertia_kgm2"),
        Port.output("speed_radps"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """Torque over inertia."""
        torque = c.gain * inputs.voltage_v - c.damping * state.speed_radps
        return {"speed_radps": torque / c.inertia_kgm2}


def motor(x: list[float], u: float, hidden: Hidden) -> list[float]:
    """The same with constants of its own, a propeller's drag, a shaft that shakes at a speed."""
    drag = hidden.get("drag", 0.0) * x[0] * abs(x[0])
    drag += hidden.get("shaking", 0.0) * math.exp(-(((abs(x[0]) - 35.0) / 10.0) ** 2))
    torque = 0.0515 * u - 0.0037 * x[0] - drag - _rubbing(x[0], hidden)
    return [torque / 0.00196]


class Servo(System):
    """A joint follows its command as a servo of second order."""

    rate_hz = 50.0
    inputs = [Input("command_rad", "rad")]
    states = {"angle_rad": "rad", "speed_radps": "rad/s"}
    outputs = [Output("angle_rad", "rad", noise=2e-3)]
    constants = [
        Constant("stiffness_per_s2", 300.0, spread=INF),
        Constant("damping_per_s", 30.0, spread=INF),
    ]
    ports = [
        Port.input("command_rad"),
        Port.force("speed_radps", position="angle_rad"),
        Port.output("angle_rad"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """Towards the command, damped."""
        pull = c.stiffness_per_s2 * (inputs.command_rad - state.angle_rad)
        return {
            "angle_rad": state.speed_radps,
            "speed_radps": pull - c.damping_per_s * state.speed_radps,
        }


def servo(x: list[float], u: float, hidden: Hidden) -> list[float]:
    """The same, a little stiffer, with weight and what rubs."""
    pull = 320.0 * (u - x[0]) - 29.0 * x[1] - _rubbing(x[1], hidden)
    return [x[1], pull - hidden.get("weight", 0.0) * math.sin(x[0])]


def _rubbing(speed: float, hidden: Hidden) -> float:
    """Friction that is larger at rest, by a Stribeck curve."""
    still = hidden.get("still", 0.01)
    dry = hidden.get("coulomb", 0.0)
    dry += hidden.get("stribeck", 0.0) * math.exp(-((speed / hidden.get("fast", 1.0)) ** 2))
    return dry * math.tanh(speed / still) + hidden.get("viscous", 0.0) * speed


@dataclass(frozen=True)
class Plant:
    """A system and its truth. `drive` is the input's usual size and `held` how long it stays [s].

    `pushed` is white noise in the rates of `pushed_at`, sd of its mean over a sample; `shown` the
    states that the outputs show, with the sensors' sd. `start` are the first states; `follows` the
    gains of position and speed where the input comes from a controller.
    """

    system: type[System]
    rates: Rates
    drive: float
    held: float
    pushed: float
    pushed_at: tuple[int, ...]
    shown: tuple[tuple[int, float], ...]
    start: tuple[float, ...]
    mean: float = 0.0
    follows: tuple[float, float] | None = None
    reach: float = 1.0


PLANTS = {
    "cart": Plant(Cart, cart, 8.0, 0.3, 0.4, (1,), ((0, 1e-3),), (0.0, 0.0),
                  follows=(40.0, 12.0), reach=0.5),
    "swing": Plant(Swing, swing, 1.5, 0.3, 0.5, (1,), ((0, 1e-3),), (0.1, 0.0),
                   follows=(8.0, 0.8), reach=0.8),
    "two masses": Plant(TwoMasses, two_masses, 1.0, 0.1, 1.0, (1, 2), ((1, 0.05), (2, 0.05)),
                        (0.0, 0.0, 0.0)),
    "tank": Plant(Tank, tank, 0.6, 40.0, 1e-4, (0,), ((0, 2e-3),), (0.4,), mean=2.0),
    "motor": Plant(Motor, motor, 6.0, 0.2, 20.0, (0,), ((0, 0.3),), (0.0,), follows=(0.4, 0.0),
                   reach=40.0),
    "servo": Plant(Servo, servo, 0.5, 0.4, 1.0, (1,), ((0, 2e-3),), (0.0, 0.0)),
}  # fmt: skip
