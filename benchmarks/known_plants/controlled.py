"""Plants with several sensors under control, some of them unstable: the system, and the truth.

As in `plants`, the truth is written a second time, in plain floats, with constants a few percent
off. A controller that knows only what sensors show drives each; what it commands is logged.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.known_plants.plants import Hidden
from wakedeploy import Constant, Input, Output, Port, System

Rates = Callable[[list[float], list[float], Hidden, float], list[float]]
Shown = Callable[[list[float], list[float], Hidden], list[float]]
Controller = Callable[[int, list[float], float], list[float]]
Controllers = Callable[[np.random.Generator, int], Controller]


@dataclass(frozen=True)
class Controlled:
    """A system, its truth (rates of states, under inputs, at a time), and what controls it.

    `shown` are the true values that sensors see, `pushed` the sd of white noise in each rate, as
    its mean over a sample. A controller gets the sample, what the sensors show, and the sample
    time [s].
    """

    system: type[System]
    rates: Rates
    shown: Shown
    controllers: Controllers
    pushed: tuple[float, ...]
    start: tuple[float, ...]
    samples: int = 2000


class CartAndPole(System):
    """A pole balanced on a cart (two bodies, uniform pole)."""

    rate_hz = 100.0
    inputs = [Input("force_n", "N")]
    states = {"cart_m": "m", "cart_mps": "m/s", "pole_rad": "rad", "pole_radps": "rad/s"}
    outputs = [Output("cart_m", "m", noise=5e-4), Output("pole_rad", "rad", noise=1e-3)]
    constants = [
        Constant("cart_kg", 1.0, 0.05),
        Constant("pole_kg", 0.2, 0.01),
        Constant("half_m", 0.3, 0.01),
        Constant("damping", 0.5, 0.1, "N s/m"),
    ]
    ports = [
        Port.input("force_n"),
        Port.force("cart_mps", position="cart_m", like="force_n"),
        Port.output("cart_m"),
        Port.output("pole_rad"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """The cart carries the pole."""
        sine, cosine = np.sin(state.pole_rad), np.cos(state.pole_rad)
        total, arm = c.cart_kg + c.pole_kg, c.pole_kg * c.half_m
        force = inputs.force_n - c.damping * state.cart_mps
        pushed = (force + arm * state.pole_radps**2 * sine) / total
        swings = (9.81 * sine - cosine * pushed) / (
            c.half_m * (4.0 / 3.0 - c.pole_kg * cosine**2 / total)
        )
        return {
            "cart_m": state.cart_mps,
            "cart_mps": pushed - arm * swings * cosine / total,
            "pole_rad": state.pole_radps,
            "pole_radps": swings,
        }


def cart_and_pole(x: list[float], u: list[float], hidden: Hidden, t: float) -> list[float]:
    """The same of 1.03 and 0.195 kg, on a rail that rubs, or is not level."""
    cart, pole, half = 1.03, 0.195, 0.302
    force = _dead(u[0], hidden) + hidden.get("tilt", 0.0) - 0.53 * x[1]
    force -= hidden.get("coulomb", 0.0) * math.tanh(x[1] / 0.003)
    sine, cosine = math.sin(x[2]), math.cos(x[2])
    pushed = (force + pole * half * x[3] ** 2 * sine) / (cart + pole)
    swings = (9.81 * sine - cosine * pushed) / (
        half * (4.0 / 3.0 - pole * cosine**2 / (cart + pole))
    )
    return [x[1], pushed - pole * half * swings * cosine / (cart + pole), x[3], swings]


def _balancing(rng: np.random.Generator, samples: int) -> Controller:
    wanted, stirred = _steps(rng, samples, 200, 0.3), rng.standard_normal(samples)
    last: list[list[float]] = []

    def control(k: int, y: list[float], dt_s: float) -> list[float]:
        before = last[-1] if last else y
        last[:] = [y]
        cart, pole = ((y[i] - before[i]) / dt_s for i in (0, 1))
        pull = 2.0 * (y[0] - wanted[k]) + 3.5 * cart + 35.0 * y[1] + 6.0 * pole
        return [_within(pull + 0.5 * stirred[k], 20.0)]

    return control


class Ship(System):
    """A ship turns with its rudder (Nomoto, 1957)."""

    rate_hz = 2.0
    inputs = [Input("rudder_rad", "rad")]
    states = {"heading_rad": "rad", "turn_radps": "rad/s"}
    outputs = [Output("heading_rad", "rad", noise=2e-3), Output("turn_radps", "rad/s", noise=5e-4)]
    constants = [Constant("time_s", 20.0, 1.5), Constant("gain", 0.15, 0.01, "1/s")]
    ports = [
        Port.input("rudder_rad"),
        Port.force("turn_radps", position="heading_rad"),
        Port.output("heading_rad"),
        Port.output("turn_radps"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """First order in the turn."""
        turn = (c.gain * inputs.rudder_rad - state.turn_radps) / c.time_s
        return {"heading_rad": state.turn_radps, "turn_radps": turn}


def ship(x: list[float], u: list[float], hidden: Hidden, t: float) -> list[float]:
    """The same, a little slower, in wind, or with a rudder (the third state) that is slow."""
    slow = "most per s" in hidden
    rudder = x[2] if slow else u[0]
    moves = _within((u[0] - x[2]) / 0.05, hidden["most per s"]) if slow else 0.0
    push = hidden.get("wind", 0.0) + hidden.get("weathervane", 0.0) * math.sin(x[0] - 0.4)
    push -= hidden.get("drag", 0.0) * x[1] * abs(x[1])
    return [x[1], (0.155 * rudder - x[1] + push) / 21.0, moves]


def _steering(rng: np.random.Generator, samples: int) -> Controller:
    wanted = _steps(rng, samples, 120, 0.6)
    return lambda k, y, dt_s: [_within(1.5 * (wanted[k] - y[0]) - 12.0 * y[1], 0.5)]


class Car(System):
    """A car on two wheels in plan (the linear single-track model)."""

    rate_hz = 50.0
    inputs = [Input("steer_rad", "rad"), Input("speed_mps", "m/s")]
    states = {"slip_mps": "m/s", "yaw_radps": "rad/s"}
    outputs = [Output("yaw_radps", "rad/s", noise=4e-3), Output("side_mps2", "m/s^2", noise=0.05)]
    constants = [
        Constant("mass_kg", 1500.0, 40.0),
        Constant("inertia_kgm2", 2500.0, 120.0),
        Constant("front", 6e4, 3e3, "N/rad"),
        Constant("rear", 7e4, 3e3, "N/rad"),
    ]
    ports = [
        Port.input("steer_rad"),
        Port.force("slip_mps", inertia="mass_kg"),
        Port.force("yaw_radps", inertia="inertia_kgm2"),
        Port.output("yaw_radps"),
        Port.output("side_mps2"),
    ]

    def forces(self, state: Any, inputs: Any, c: Any) -> tuple[Any, Any]:
        """Side forces of the front and the rear wheel [N]."""
        speed = np.maximum(inputs.speed_mps, 3.0)
        front = inputs.steer_rad - (state.slip_mps + 1.2 * state.yaw_radps) / speed
        return c.front * front, -c.rear * (state.slip_mps - 1.4 * state.yaw_radps) / speed

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """In the axes of the car."""
        front, rear = self.forces(state, inputs, c)
        return {
            "slip_mps": (front + rear) / c.mass_kg - inputs.speed_mps * state.yaw_radps,
            "yaw_radps": (1.2 * front - 1.4 * rear) / c.inertia_kgm2,
        }

    def measure(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """A gyro, and an accelerometer across the car."""
        front, rear = self.forces(state, inputs, c)
        return {"yaw_radps": state.yaw_radps, "side_mps2": (front + rear) / c.mass_kg}


def _tyres(x: list[float], u: list[float], hidden: Hidden) -> tuple[float, float]:
    steer = (x[2] if "lag" in hidden else u[0]) * hidden.get("ratio", 1.0)
    front = 5.8e4 * (steer - (x[0] + 1.2 * x[1]) / u[1])
    return front, -7.2e4 * (x[0] - 1.4 * x[1]) / u[1]


def car(x: list[float], u: list[float], hidden: Hidden, t: float) -> list[float]:
    """The same of 1,520 kg, with a steering (the third state) that lags, in wind from the side."""
    front, rear = _tyres(x, u, hidden)
    slip = (front + rear + hidden.get("wind", 0.0)) / 1520.0 - u[1] * x[1]
    lag = (u[0] - x[2]) / hidden["lag"] if "lag" in hidden else 0.0
    return [slip, (1.2 * front - 1.4 * rear) / 2440.0, lag]


def _driving(rng: np.random.Generator, samples: int) -> Controller:
    steps = _steps(rng, samples + 20, 50, 0.05)
    steer = np.convolve(steps, np.ones(21) / 21.0, "valid")[:samples]
    speed = np.interp(np.arange(samples), np.linspace(0, samples, 9), rng.uniform(12.0, 28.0, 9))
    return lambda k, y, dt_s: [float(steer[k]), float(speed[k])]


class Roll(System):
    """A copter rolls: I w' = τ."""

    rate_hz = 200.0
    inputs = [Input("torque_nm", "N m")]
    states = {"roll_rad": "rad", "rate_radps": "rad/s"}
    outputs = [Output("roll_rad", "rad", noise=2e-3), Output("rate_radps", "rad/s", noise=0.01)]
    constants = [Constant("inertia_kgm2", 0.01, 5e-4)]
    ports = [
        Port.input("torque_nm"),
        Port.force("rate_radps", inertia="inertia_kgm2", position="roll_rad"),
        Port.output("roll_rad"),
        Port.output("rate_radps"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """Torque over inertia."""
        return {"roll_rad": state.rate_radps, "rate_radps": inputs.torque_nm / c.inertia_kgm2}


def roll(x: list[float], u: list[float], hidden: Hidden, t: float) -> list[float]:
    """The same of 0.0097 kg m², with motors (the third state) that lag, on a fading battery."""
    torque = (x[2] if "lag" in hidden else u[0]) * (1.0 - hidden.get("fades per s", 0.0) * t)
    torque += hidden.get("offset", 0.0) - hidden.get("drag", 0.0) * x[1] * abs(x[1])
    return [x[1], torque / 0.0097, (u[0] - x[2]) / hidden["lag"] if "lag" in hidden else 0.0]


def _levelling(rng: np.random.Generator, samples: int) -> Controller:
    wanted = _steps(rng, samples, 120, 0.4)
    return lambda k, y, dt_s: [_within(0.6 * (wanted[k] - y[0]) - 0.09 * y[1], 0.3)]


class Oven(System):
    """A heated plate warms the air of an oven, which loses it to the room."""

    rate_hz = 0.2
    inputs = [Input("duty", "1"), Input("room_k", "K")]
    states = {"plate_k": "K", "air_k": "K"}
    outputs = [Output("air_k", "K", noise=0.05)]
    constants = [
        Constant("power", 0.5, 0.02, "K/s"),
        Constant("passes", 0.01, 5e-4, "1/s"),
        Constant("loses", 0.004, 2e-4, "1/s"),
    ]
    ports = [
        Port.input("duty"),
        Port.input("room_k"),
        Port.force("plate_k"),
        Port.force("air_k"),
        Port.output("air_k"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """Heat goes where it is colder."""
        passed = c.passes * (state.plate_k - state.air_k)
        return {
            "plate_k": c.power * inputs.duty - passed,
            "air_k": 2.0 * passed - c.loses * (state.air_k - inputs.room_k),
        }


def oven(x: list[float], u: list[float], hidden: Hidden, t: float) -> list[float]:
    """The same, a few percent off, with a plate that shines."""
    passed = 0.0102 * (x[0] - x[1])
    shines = hidden.get("radiation", 0.0) * ((x[0] / 100.0) ** 4 - (u[1] / 100.0) ** 4)
    return [0.51 * u[0] - passed - shines, 2.0 * passed - 0.0041 * (x[1] - u[1])]


def _heating(rng: np.random.Generator, samples: int) -> Controller:
    duty = np.clip(0.4 + _steps(rng, samples, 80, 0.5), 0.0, 1.0)
    room = 293.0 + 3.0 * np.sin(np.arange(samples) / 600.0)
    return lambda k, y, dt_s: [float(duty[k]), float(room[k])]


class Diver(System):
    """A diving robot keeps its depth."""

    rate_hz = 20.0
    inputs = [Input("thrust_n", "N")]
    states = {"depth_m": "m", "sink_mps": "m/s"}
    outputs = [Output("depth_m", "m", noise=5e-3)]
    constants = [Constant("mass_kg", 20.0, 1.0), Constant("drag", 15.0, 1.5, "N s/m")]
    ports = [
        Port.input("thrust_n"),
        Port.force("sink_mps", inertia="mass_kg", position="depth_m"),
        Port.output("depth_m"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """Thrust and drag."""
        force = inputs.thrust_n - c.drag * state.sink_mps
        return {"depth_m": state.sink_mps, "sink_mps": force / c.mass_kg}


def diver(x: list[float], u: list[float], hidden: Hidden, t: float) -> list[float]:
    """The same of 20.6 kg, with what buoys it up, a tether, and a thruster of its own mind."""
    force = _dead(u[0], hidden)
    force += hidden.get("uneven", 0.0) * abs(force) - hidden.get("tether", 0.0) * (x[0] - 3.0)
    force -= 14.2 * x[1] + hidden.get("square", 0.0) * x[1] * abs(x[1]) + hidden.get("buoys", 0.0)
    return [x[1], force / 20.6]


def _diving(rng: np.random.Generator, samples: int) -> Controller:
    wanted = 3.0 + _steps(rng, samples, 160, 1.5)
    last: list[float] = []

    def control(k: int, y: list[float], dt_s: float) -> list[float]:
        speed = (y[0] - (last[-1] if last else y[0])) / dt_s
        last[:] = [y[0]]
        return [_within(25.0 * (wanted[k] - y[0]) - 20.0 * speed, 40.0)]

    return control


class Arm(System):
    """Two uniform links of 0.3 m in a plane, a motor in each joint."""

    rate_hz = 100.0
    inputs = [Input("first_nm", "N m"), Input("second_nm", "N m")]
    states = {"first_rad": "rad", "second_rad": "rad", "first_radps": "rad/s",
              "second_radps": "rad/s"}  # fmt: skip
    outputs = [Output("first_rad", "rad", noise=1e-3), Output("second_rad", "rad", noise=1e-3)]
    constants = [
        Constant("first_kg", 1.0, 0.04),
        Constant("second_kg", 0.6, 0.03),
        Constant("first_damping", 0.1, 0.02, "N m s"),
        Constant("second_damping", 0.05, 0.01, "N m s"),
    ]
    ports = [
        Port.input("first_nm"),
        Port.input("second_nm"),
        Port.force("first_radps", position="first_rad", like="first_nm"),
        Port.force("second_radps", position="second_rad", like="second_nm"),
        Port.output("first_rad"),
        Port.output("second_rad"),
    ]

    def derivative(self, state: Any, inputs: Any, c: Any) -> dict[str, Any]:
        """A torque in one joint moves both."""
        cosine = np.cos(state.second_rad)
        m11 = 0.09 * (c.first_kg / 3.0 + c.second_kg * (4.0 / 3.0 + cosine))
        m12 = 0.09 * c.second_kg * (1.0 / 3.0 + cosine / 2.0)
        m22 = 0.03 * c.second_kg
        turning = 0.045 * c.second_kg * np.sin(state.second_rad)
        fast, slow = state.first_radps, state.second_radps
        first = inputs.first_nm - c.first_damping * fast + turning * (2.0 * fast + slow) * slow
        second = inputs.second_nm - c.second_damping * slow - turning * fast**2
        share = m11 * m22 - m12**2
        return {
            "first_rad": fast,
            "second_rad": slow,
            "first_radps": (m22 * first - m12 * second) / share,
            "second_radps": (m11 * second - m12 * first) / share,
        }


def arm(x: list[float], u: list[float], hidden: Hidden, t: float) -> list[float]:
    """The same of 1.03 and 0.585 kg; joints rub, a spring pulls the second one home."""
    heavy, light = 1.03, 0.585
    m11 = 0.09 * (heavy / 3.0 + light * (4.0 / 3.0 + math.cos(x[1])))
    m12, m22 = 0.09 * light * (1.0 / 3.0 + math.cos(x[1]) / 2.0), 0.03 * light
    turning = 0.045 * light * math.sin(x[1])
    first = u[0] - 0.11 * x[2] + turning * (2.0 * x[2] + x[3]) * x[3]
    second = u[1] * hidden.get("second gain", 1.0) - 0.048 * x[3] - turning * x[2] ** 2
    first -= hidden.get("first rubs", 0.0) * math.tanh(x[2] / 0.01)
    second -= hidden.get("second rubs", 0.0) * math.tanh(x[3] / 0.01)
    second -= hidden.get("spring", 0.0) * x[1]
    share = m11 * m22 - m12**2
    return [x[2], x[3], (m22 * first - m12 * second) / share, (m11 * second - m12 * first) / share]


def _reaching(rng: np.random.Generator, samples: int) -> Controller:
    wanted = _steps(rng, samples, 100, 1.0), _steps(rng, samples, 130, 1.2)
    last: list[list[float]] = []

    def control(k: int, y: list[float], dt_s: float) -> list[float]:
        before = last[-1] if last else y
        last[:] = [y]
        fast, slow = ((y[i] - before[i]) / dt_s for i in (0, 1))
        return [
            _within(3.0 * (wanted[0][k] - y[0]) - 0.8 * fast, 3.0),
            _within(1.0 * (wanted[1][k] - y[1]) - 0.15 * slow, 1.5),
        ]

    return control


def _dead(u: float, hidden: Hidden) -> float:
    """What a dead band leaves of a command."""
    return math.copysign(max(abs(u) - hidden.get("band", 0.0), 0.0), u)


def _within(value: float, most: float) -> float:
    return max(-most, min(most, value))


def _steps(rng: np.random.Generator, samples: int, held: int, size: float) -> Any:
    """Steps at random, each held for so many samples."""
    return np.repeat(rng.uniform(-size, size, samples // held + 2), held)[:samples]


def _first(count: int) -> Shown:
    """Sensors that show the first states."""
    return lambda x, u, hidden: x[:count]


def _felt(x: list[float], u: list[float], hidden: Hidden) -> list[float]:
    """A car's gyro and accelerometer."""
    front, rear = _tyres(x, u, hidden)
    return [x[1], (front + rear) / 1520.0]


CONTROLLED: Mapping[str, Controlled] = {
    "cart and pole": Controlled(
        CartAndPole, cart_and_pole, lambda x, u, hidden: [x[0], x[2]], _balancing,
        (0.0, 0.1, 0.0, 0.2), (0.0, 0.0, 0.02, 0.0),
    ),
    "ship": Controlled(Ship, ship, _first(2), _steering, (0.0, 2e-4, 0.0), (0.0,) * 3, 1500),
    "car": Controlled(Car, car, _felt, _driving, (0.3, 0.05, 0.0), (0.0,) * 3),
    "roll": Controlled(Roll, roll, _first(2), _levelling, (0.0, 0.5, 0.0), (0.0,) * 3, 3000),
    "oven": Controlled(
        Oven, oven, lambda x, u, hidden: [x[1]], _heating, (2e-3, 1e-3), (310.0, 300.0), 1500
    ),
    "diver": Controlled(Diver, diver, _first(1), _diving, (0.0, 0.03), (3.0, 0.0)),
    "arm": Controlled(Arm, arm, _first(2), _reaching, (0.0, 0.0, 0.2, 0.3), (0.0,) * 4),
}  # fmt: skip
