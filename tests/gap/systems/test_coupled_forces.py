"""Forces in coupled masses: like a motor's where the port says so, and asked about where not.

The arm is the textbook's (two uniform links, M(q) q'' + c(q, q') = τ), written twice: as a system,
and here in plain floats with what rubs.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.coupled_forces import coupled_forces
from wakedeploy.gap.systems.kinds.library import force_unit
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.sensitivity import column_notes
from wakedeploy.gap.systems.system import Point

RATE_HZ = 100
LINK_M, FIRST_KG, SECOND_KG = 0.3, 1.0, 0.6
JOINTS = (("shoulder_radps", "shoulder_nm"), ("elbow_radps", "elbow_nm"))


def masses(first_kg, second_kg, cosine):
    """m11, m12, m22 [kg m²]."""
    square = LINK_M**2
    return (
        (first_kg / 3.0 + second_kg * (4.0 / 3.0 + cosine)) * square,
        second_kg * (1.0 / 3.0 + cosine / 2.0) * square,
        second_kg * square / 3.0,
    )


class Arm(System):
    """Two links, a motor in each joint."""

    rate_hz = float(RATE_HZ)
    inputs = [Input("shoulder_nm", "N m"), Input("elbow_nm", "N m")]
    states = {
        "shoulder_rad": "rad", "elbow_rad": "rad",
        "shoulder_radps": "rad/s", "elbow_radps": "rad/s",
    }  # fmt: skip
    outputs = [Output("shoulder_rad", "rad", noise=1e-3), Output("elbow_rad", "rad", noise=1e-3)]
    constants = [Constant("first_kg", FIRST_KG, 0.04), Constant("second_kg", SECOND_KG, 0.03)]
    ports = [
        Port.input("shoulder_nm"),
        Port.input("elbow_nm"),
        Port.force("shoulder_radps", position="shoulder_rad", like="shoulder_nm"),
        Port.force("elbow_radps", position="elbow_rad", like="elbow_nm"),
    ]

    def derivative(self, state, inputs, c):
        m11, m12, m22 = masses(c.first_kg, c.second_kg, np.cos(state.elbow_rad))
        turning = c.second_kg * LINK_M**2 * np.sin(state.elbow_rad) / 2.0
        fast, slow = state.shoulder_radps, state.elbow_radps
        first = inputs.shoulder_nm + turning * (2.0 * fast * slow + slow**2)
        second = inputs.elbow_nm - turning * fast**2
        share = m11 * m22 - m12**2
        return {
            "shoulder_rad": fast,
            "elbow_rad": slow,
            "shoulder_radps": (m22 * first - m12 * second) / share,
            "elbow_radps": (m11 * second - m12 * first) / share,
        }


def unlike(system, **changes):
    """The same with ports that say nothing of how forces act."""
    ports = [replace(port, like="") for port in system.ports]
    return type(system.__name__, (system,), {"ports": ports, **changes})


def test_a_force_like_an_input_moves_all_that_the_input_moves():
    """M q'' = f, so that f comes back out of the rise of both rates, wherever the arm is."""
    arm, rng = checked(Arm()), np.random.default_rng(0)
    state = Point("state", {name: rng.standard_normal(30) for name in Arm.states})
    inputs = Point("input", {i.name: rng.standard_normal(30) for i in Arm.inputs})
    forces = {"shoulder_radps": rng.standard_normal(30), "elbow_radps": rng.standard_normal(30)}
    plain, moved = (arm.rates(state, inputs, arm.values(), f) for f in (None, forces))
    first, second = (moved[name] - plain[name] for name, _ in JOINTS)
    m11, m12, m22 = masses(FIRST_KG, SECOND_KG, np.cos(state.elbow_rad))
    assert m11 * first + m12 * second == pytest.approx(forces["shoulder_radps"])
    assert m12 * first + m22 * second == pytest.approx(forces["elbow_radps"])
    assert [force_unit(arm, port) for port in Arm.ports[2:]] == ["N m", "N m"]


def test_a_port_beside_those_like_an_input_moves_its_own_state():
    ports = [Arm.ports[2], Port.force("elbow_radps", inertia="second_kg")]
    arm = checked(type("Arm", (Arm,), {"ports": ports})())
    state = Point("state", dict.fromkeys(Arm.states, 0.3))
    inputs = Point("input", {"shoulder_nm": 0.0, "elbow_nm": 0.0})
    plain, moved = (arm.rates(state, inputs, arm.values(), f) for f in (None, {"elbow_radps": 1.2}))
    rises = {name: moved[name] - plain[name] for name in Arm.states}
    assert rises == pytest.approx(dict.fromkeys(Arm.states, 0.0) | {"elbow_radps": 2.0})


@pytest.mark.parametrize(
    ("like", "changes", "said"),
    [
        ("wrist_nm", {}, "a port names the input 'wrist_nm', which is not there"),
        (
            "shoulder_nm",
            {"derivative": lambda s, x, u, c: dict.fromkeys(Arm.states, 0.0 - u.shoulder_nm)},
            "more of which does not push it forward",
        ),
        ("shoulder_nm", {"derivative_under": Arm.derivative}, "there is a derivative_under"),
    ],
)
def test_an_input_that_a_force_cannot_be_like_is_refused(like, changes, said):
    ports = [Port.force("shoulder_radps", like=like)]
    with pytest.raises(UnusableInput, match=said):
        checked(type("Arm", (Arm,), {"ports": ports, **changes})())


class Geared(unlike(Arm)):
    """The same arm by voltages, each through a gear of its own."""

    def derivative(self, state, inputs, c):
        torques = {"shoulder_nm": 2.0 * inputs.shoulder_nm, "elbow_nm": 0.5 * inputs.elbow_nm}
        return super().derivative(state, Point("input", torques), c)


class Copter(System):
    """A copter in a plane: its two rotors lift, and turn it."""

    rate_hz = 100.0
    inputs = [Input("left_n", "N"), Input("right_n", "N")]
    states = {"climb_mps": "m/s", "turn_radps": "rad/s"}
    outputs = [Output("climb_mps", "m/s"), Output("turn_radps", "rad/s")]
    ports = [Port.force("climb_mps"), Port.force("turn_radps")]

    def derivative(self, state, inputs, c):
        lift, turn = inputs.left_n + inputs.right_n, inputs.right_n - inputs.left_n
        return {"climb_mps": lift - 9.81, "turn_radps": 3.0 * turn}


class Apart(Copter):
    """Two axes that have nothing to do with each other."""

    def derivative(self, state, inputs, c):
        return {"climb_mps": inputs.left_n, "turn_radps": 2.0 * inputs.right_n}


class CartAndPole(System):
    """A pole that is free to swing on a cart that a motor pushes."""

    rate_hz = 100.0
    inputs = [Input("force_n", "N")]
    states = {"angle_rad": "rad", "cart_mps": "m/s", "pole_radps": "rad/s"}
    outputs = [Output("angle_rad", "rad"), Output("cart_mps", "m/s")]
    ports = [Port.force("cart_mps"), Port.force("pole_radps", position="angle_rad")]

    def derivative(self, state, inputs, c):
        cosine, sine = np.cos(state.angle_rad), np.sin(state.angle_rad)
        pushed = (inputs.force_n + 0.06 * state.pole_radps**2 * sine) / 1.2
        swings = (9.81 * sine - cosine * pushed) / (0.3 * (4.0 / 3.0 - 0.2 * cosine**2 / 1.2))
        return {
            "angle_rad": state.pole_radps,
            "cart_mps": pushed - 0.05 * swings * cosine,
            "pole_radps": swings,
        }


class Thrust(System):
    """A copter in a plane, in axes of the room: its thrust goes with its tilt."""

    rate_hz = 100.0
    inputs = [Input("thrust_n", "N"), Input("torque_nm", "N m")]
    states = {"tilt_rad": "rad", "x_mps": "m/s", "z_mps": "m/s", "turn_radps": "rad/s"}
    outputs = [Output("x_mps", "m/s"), Output("z_mps", "m/s"), Output("tilt_rad", "rad")]
    ports = [Port.force("x_mps"), Port.force("z_mps"), Port.force("turn_radps")]

    def derivative(self, state, inputs, c):
        return {
            "tilt_rad": state.turn_radps,
            "x_mps": -inputs.thrust_n * np.sin(state.tilt_rad),
            "z_mps": inputs.thrust_n * np.cos(state.tilt_rad) - 9.81,
            "turn_radps": 20.0 * inputs.torque_nm,
        }


def test_a_motor_alone_that_moves_coupled_masses_is_asked_about():
    (note,) = coupled_forces(checked(CartAndPole()))
    assert note.startswith("force_n moves cart_mps and pole_radps together")
    assert 'Port.force("cart_mps", like="force_n")' in note
    ports = [Port.force("cart_mps", like="force_n"), CartAndPole.ports[1]]
    assert coupled_forces(checked(type("Cart", (CartAndPole,), {"ports": ports})())) == []


@pytest.mark.parametrize("system", [unlike(Arm), Geared])
def test_ports_of_coupled_masses_that_do_not_say_so_are_asked_about(system):
    (note,) = coupled_forces(checked(system()))
    assert "shoulder_nm and elbow_nm each move shoulder_radps and elbow_radps together" in note
    for speed, motor in JOINTS:
        assert f'Port.force("{speed}", like="{motor}")' in note


@pytest.mark.parametrize(
    "system", [Arm, Copter, Thrust, Apart, unlike(Arm, derivative_under=Arm.derivative)]
)
def test_others_are_not(system):
    assert coupled_forces(system()) == []


def recording(torque_nm: float) -> Recording:
    """The arm under a servo that knows nothing of what rubs in its shoulder [N m]."""
    rng, fine = np.random.default_rng(3), 20
    wanted = np.repeat(rng.uniform(-1.0, 1.0, (24, 2)), 80, axis=0)
    x, before, rows = [0.0] * 4, None, []
    for goal in wanted:
        shown = np.array(x[:2]) + 1e-3 * rng.standard_normal(2)
        speed = np.zeros(2) if before is None else (np.array(x[:2]) - before) * RATE_HZ
        before = np.array(x[:2])
        u = np.clip([3.0, 1.0] * (goal - before) - [0.8, 0.15] * speed, [-3, -1.5], [3, 1.5])
        rows.append((*u, *shown))
        for _ in range(fine):
            x = stepped(x, u, torque_nm, 1.0 / RATE_HZ / fine)
    names = ("shoulder_nm", "elbow_nm", "shoulder_rad", "elbow_rad")
    columns = dict(zip(names, np.array(rows).T, strict=True))
    return Recording("arm", np.arange(len(rows)) / RATE_HZ, columns)


def stepped(x, u, torque_nm, dt_s):
    """A step of Heun."""
    first = rates(x, u, torque_nm)
    second = rates([a + dt_s * b for a, b in zip(x, first, strict=True)], u, torque_nm)
    return [a + 0.5 * dt_s * (b + c) for a, b, c in zip(x, first, second, strict=True)]


def rates(x, u, torque_nm):
    m11, m12, m22 = masses(1.02, 0.59, math.cos(x[1]))
    turning = 0.59 * LINK_M**2 * math.sin(x[1]) / 2.0
    first = u[0] + turning * (2.0 * x[2] * x[3] + x[3] ** 2) - torque_nm * math.tanh(x[2] / 0.01)
    second = u[1] - turning * x[2] ** 2
    share = m11 * m22 - m12**2
    return [x[2], x[3], (m22 * first - m12 * second) / share, (m11 * second - m12 * first) / share]


@pytest.mark.whole
def test_the_check_of_columns_asks_too():
    notes = column_notes(LogModel(unlike(Arm)(), [recording(0.0)]))
    assert [note for note in notes if "each move" in note] == coupled_forces(unlike(Arm)())


@pytest.mark.slow
def test_friction_in_a_joint_is_named_where_the_port_is_like_its_motor(tmp_path):
    import wakedeploy as wd

    gap = wd.close_gap(Arm, recording(0.3), tmp_path, report=False, plan=False)
    assert (gap.verdict, *gap.effects) == ("named", "coulomb-friction@shoulder_radps")
    (effect,) = gap.result.effects
    force = effect.parameters["force"]
    assert force.unit == "N m"
    assert force.low < 0.3 < force.high
    assert force.high - force.low < 0.06
