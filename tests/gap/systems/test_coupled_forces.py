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
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.coupled_forces import bent_inputs, coupled_forces
from wakedeploy.gap.systems.kinds.library import force_unit
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.ports import Point
from wakedeploy.gap.systems.sensitivity import column_notes

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


def test_ports_beside_those_like_an_input_move_their_own_state():
    """Two at one speed, each over its own inertia, beside one that is like a motor."""
    at_elbow = ("shoulder_rad", "first_kg"), ("elbow_rad", "second_kg")
    ports = [Arm.ports[2]]
    ports += [
        Port.force("elbow_radps", inertia=m, position=p, kinds=["offset"]) for p, m in at_elbow
    ]
    model = LogModel(checked(type("Arm", (Arm,), {"ports": ports})()), [recording(0.0)])
    offsets = [
        replace(model.library["offset@elbow_radps"], name=f"offset {k}", port=port)
        for k, port in enumerate(ports[1:])
    ]
    acting = Acting(model.system, offsets, model.sizes)
    values = {"offset 0.force": np.array([[3.0]]), "offset 1.force": np.array([[1.2]])}
    x = np.full((4, 1, 1), 0.3)
    inputs = {"shoulder_nm": np.zeros((1, 1)), "elbow_nm": np.zeros((1, 1))}
    c = model.system.values()
    plain, moved = (
        Acting(model.system, effects, model.sizes).rates(x, inputs, c, values, np.zeros((1, 1)))
        for effects in ((), offsets)
    )
    assert acting.states == tuple(Arm.states)
    assert (moved - plain).ravel() == pytest.approx([0.0, 0.0, 0.0, 3.0 / 1.0 + 1.2 / 0.6])


@pytest.mark.parametrize("thrust", [lambda u: u**2, lambda u: np.maximum(np.abs(u) - 25.0, 0.0)])
def test_an_input_that_pushes_only_within_its_limits_is_one(thrust):
    """A rotor's speed, or pulses with a dead band: at small or negative ones nothing is pushed."""

    class Rotor(System):
        rate_hz = 100.0
        inputs = [Input("rotor", "rad/s", low=0.0, high=1000.0)]
        states = {"climb_mps": "m/s"}
        outputs = [Output("climb_mps", "m/s")]
        ports = [Port.force("climb_mps", like="rotor")]

        def derivative(self, state, inputs, c):
            return {"climb_mps": thrust(inputs.rotor) - 9.81}

    assert checked(Rotor()).distributes(Rotor.ports[0])


@pytest.mark.parametrize(
    ("like", "changes", "said"),
    [
        ("wrist_nm", {}, "a port names the input 'wrist_nm', which is not there"),
        (
            "shoulder_nm",
            {"derivative": lambda s, x, u, c: dict.fromkeys(Arm.states, 0.0 - u.shoulder_nm)},
            'never pushes it forward; write like="-shoulder_nm"',
        ),
        ("shoulder_nm", {"derivative_under": Arm.derivative}, "there is a derivative_under"),
        ("shoulder_nm", {"inertia": "first_kg"}, "leave out inertia='first_kg'"),
        ("shoulder_nm", {"unit": "N"}, "leave out unit='N'"),
        ("shoulder_nm", {"friction": "first_kg"}, "its friction 'first_kg' is in kg"),
        ("shoulder_nm", {"second": True}, "another port acts at 'shoulder_radps', too"),
    ],
)
def test_what_a_force_cannot_be_like_is_refused(like, changes, said):
    of_port = {n: v for n, v in changes.items() if n in ("inertia", "unit", "friction")}
    ports = [Port.force("shoulder_radps", like=like, **of_port)]
    ports += [Port.force("shoulder_radps")] * ("second" in changes)
    changes = {n: v for n, v in changes.items() if n.startswith("derivative")}
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


def logged(system, size: float = 1.0) -> LogModel:
    """Logs of inputs and outputs at random: they show which poses and commands there are."""
    rng, n = np.random.default_rng(2), 400
    columns = {c.name: size * rng.standard_normal(n) for c in (*system.inputs, *system.outputs)}
    return LogModel(checked(system()), [Recording("log", np.arange(n) / system.rate_hz, columns)])


def asked(system, size: float = 1.0) -> list[str]:
    return coupled_forces(logged(system, size))


def test_a_motor_alone_that_moves_coupled_masses_is_asked_about():
    (note,) = asked(CartAndPole)
    assert note.startswith("force_n moves cart_mps and pole_radps together")
    assert 'Port.force("cart_mps", like="force_n")' in note


@pytest.mark.parametrize("system", [unlike(Arm), Geared])
def test_ports_of_coupled_masses_that_do_not_say_so_are_asked_about(system):
    (note,) = asked(system)
    assert "shoulder_nm and elbow_nm move shoulder_radps and elbow_radps together" in note
    for speed, motor in JOINTS:
        assert f'Port.force("{speed}", like="{motor}")' in note


@pytest.mark.parametrize("ports", [Arm.ports[2:3], Arm.ports[3:]])
def test_a_port_that_was_forgotten_is_asked_about_alone(ports):
    """Beside one that says it, and where the other joint has none."""
    (forgotten,) = [port for port in Arm.ports[2:] if port not in ports]
    for kept in (ports, []):
        changed = type("Arm", (Arm,), {"ports": [*kept, replace(forgotten, like="")]})
        (note,) = asked(changed)
        assert note.count("Port.force(") == 1
        assert f'Port.force("{forgotten.name}", like="{forgotten.like}")' in note


class Reversed(unlike(Arm)):
    """The elbow's motor turns the other way."""

    def derivative(self, state, inputs, c):
        given = {"shoulder_nm": inputs.shoulder_nm, "elbow_nm": 0.0 - inputs.elbow_nm}
        return super().derivative(state, Point("input", given), c)


def test_a_motor_that_turns_the_other_way_has_a_sign():
    """A force at its port still pushes the joint forward, as it does beside a right motor."""
    (note,) = asked(Reversed)
    assert 'Port.force("shoulder_radps", like="shoulder_nm")' in note
    assert 'Port.force("elbow_radps", like="-elbow_nm")' in note
    ports = [Arm.ports[2], replace(Arm.ports[3], like="-elbow_nm")]
    turned = checked(type("Turned", (Reversed,), {"ports": ports})())
    state, rng = Point("state", dict.fromkeys(Arm.states, 0.4)), np.random.default_rng(1)
    forces = {"elbow_radps": rng.standard_normal(9), "shoulder_radps": rng.standard_normal(9)}
    inputs = [Point("input", {"shoulder_nm": 0.3, "elbow_nm": torque}) for torque in (0.2, -0.2)]
    wanted = checked(Arm()).rates(state, inputs[0], Arm().values(), forces)
    moved = turned.rates(state, inputs[1], turned.values(), forces)
    assert all(moved[name] == pytest.approx(wanted[name]) for name in Arm.states)
    assert force_unit(turned, ports[1]) == "N m"
    ports = [replace(Arm.ports[3], like="elbow_nm")]
    with pytest.raises(UnusableInput, match='never pushes it forward; write like="-elbow_nm"'):
        checked(type("Turned", (Reversed,), {"ports": ports})())


class Limited(unlike(Arm)):
    """An arm whose model limits its torques, which is seen at what was commanded."""

    def derivative(self, state, inputs, c):
        given = {i.name: np.clip(getattr(inputs, i.name), -0.3, 0.3) for i in self.inputs}
        return super().derivative(state, Point("input", given), c)


def test_limits_and_ranges_of_a_model_are_no_hindrance():
    assert len(asked(Limited)) == 1

    class Raising(unlike(Arm)):
        def derivative(self, state, inputs, c):
            if np.any(np.abs(state.elbow_rad) > 2.0):
                raise ValueError("outside of the table")
            return super().derivative(state, inputs, c)

    assert asked(Raising, 0.3) == []

    class Guarded(Arm):
        def derivative(self, state, inputs, c):
            if np.any(np.abs(inputs.shoulder_nm) > 4.0):
                raise ValueError("more than the motor gives")
            return super().derivative(state, inputs, c)

    model = logged(Guarded, 0.3)
    model.logs[0].inputs[0, 0] = 9.0
    assert bent_inputs(model) == []


def test_a_force_like_an_input_that_the_model_limits_is_told():
    """A clip cuts the friction, too; an input that a law makes is what it acts on."""
    bent = type("Bent", (Limited,), {"ports": Arm.ports})
    notes = bent_inputs(logged(bent))
    assert [note.split(":")[0] for note in notes] == ["force shoulder_radps", "force elbow_radps"]
    assert "as an input with a law" in notes[0]
    assert bent_inputs(logged(bent, 0.05)) == []  # none of these commands reaches the limit
    assert bent_inputs(logged(Arm)) == []

    class Scaled(Arm):  # another input scales it, as a battery's voltage does
        inputs = [*Arm.inputs, Input("supply", "1")]

        def derivative(self, state, inputs, c):
            torque = (2.0 + inputs.supply) * inputs.shoulder_nm
            given = {"shoulder_nm": torque, "elbow_nm": inputs.elbow_nm}
            return super().derivative(state, Point("input", given), c)

    assert bent_inputs(logged(Scaled)) == []


class Room(System):
    """Temperature and carbon dioxide of a room that a fan airs: no speeds, whatever moves both."""

    rate_hz = 1.0
    inputs = [Input("fan_w", "W")]
    states = {"inside_k": "K", "gas": "1"}
    outputs = [Output("inside_k", "K"), Output("gas", "1")]
    ports = [Port.force("inside_k"), Port.force("gas")]

    def derivative(self, state, inputs, c):
        return {
            "inside_k": inputs.fan_w * (1.0 + state.gas**2),
            "gas": inputs.fan_w * state.inside_k,
        }


class Aircraft(System):
    """Aileron and rudder both roll and yaw it, by gains that no pose changes."""

    rate_hz = 50.0
    inputs = [Input("aileron_rad", "rad"), Input("rudder_rad", "rad")]
    states = {"roll_rad": "rad", "roll_radps": "rad/s", "yaw_radps": "rad/s"}
    outputs = [Output("roll_rad", "rad"), Output("yaw_radps", "rad/s")]
    ports = [Port.force("roll_radps"), Port.force("yaw_radps")]

    def derivative(self, state, inputs, c):
        return {
            "roll_rad": state.roll_radps,
            "roll_radps": 5.0 * inputs.aileron_rad + 0.4 * inputs.rudder_rad,
            "yaw_radps": 0.3 * inputs.aileron_rad + 2.0 * inputs.rudder_rad,
        }


class Quadrotor(System):
    """Four rotors lift it along its own axis, and turn it; velocities are in axes of the room."""

    rate_hz = 100.0
    inputs = [Input(f"rotor_{i}_n", "N") for i in range(4)]
    states = {
        "roll_rad": "rad", "pitch_rad": "rad", "x_mps": "m/s", "y_mps": "m/s", "z_mps": "m/s",
        "p_radps": "rad/s", "q_radps": "rad/s", "r_radps": "rad/s",
    }  # fmt: skip
    outputs = [Output(name, unit) for name, unit in states.items()]
    ports = [Port.force(n) for n, unit in states.items() if unit != "rad"]

    def derivative(self, state, inputs, c):
        a, b, d, e = (getattr(inputs, i.name) for i in self.inputs)
        lift, roll, pitch = a + b + d + e, state.roll_rad, state.pitch_rad
        return {
            "roll_rad": state.p_radps,
            "pitch_rad": state.q_radps,
            "x_mps": lift * np.cos(roll) * np.sin(pitch),
            "y_mps": -lift * np.sin(roll),
            "z_mps": lift * np.cos(roll) * np.cos(pitch) - 9.81,
            "p_radps": 50.0 * (a + b - d - e),
            "q_radps": 50.0 * (a - b - d + e),
            "r_radps": 5.0 * (a - b + d - e),
        }


class Car(System):
    """Front-wheel drive: what the wheels' push does depends on the steering, a command."""

    rate_hz = 50.0
    inputs = [Input("drive_n", "N"), Input("steer_rad", "rad")]
    states = {"ahead_mps": "m/s", "aside_mps": "m/s", "yaw_radps": "rad/s"}
    outputs = [Output(name, unit) for name, unit in states.items()]
    ports = [Port.force(name) for name in states]

    def derivative(self, state, inputs, c):
        aside = inputs.drive_n * np.sin(inputs.steer_rad)
        ahead = inputs.drive_n * np.cos(inputs.steer_rad)
        return {"ahead_mps": ahead, "aside_mps": aside, "yaw_radps": 1.2 * aside}


class TwoSterns(System):
    """A boat by two thrusters astern and one in the bow, which does not push it ahead."""

    rate_hz = 20.0
    inputs = [Input(name, "N") for name in ("left_n", "right_n", "bow_n")]
    states = {"surge_mps": "m/s", "sway_mps": "m/s", "yaw_radps": "rad/s"}
    outputs = [Output(name, unit) for name, unit in states.items()]
    ports = [Port.force(name) for name in states]

    def derivative(self, state, inputs, c):
        return {
            "surge_mps": inputs.left_n + inputs.right_n - state.surge_mps,
            "sway_mps": 0.5 * inputs.bow_n - state.sway_mps,
            "yaw_radps": inputs.right_n - inputs.left_n + 2.0 * inputs.bow_n,
        }


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "system",
    [Arm, Copter, Thrust, Apart, Room, Aircraft, Quadrotor, Car, TwoSterns],
)
def test_others_are_not(system):
    assert asked(system) == []


def test_a_mechanism_that_says_how_forces_act_is_not():
    """Its own function has the forces, whatever its ports say."""

    class Under(unlike(Arm)):
        def derivative_under(self, state, inputs, c, forces):
            given = {i.name: getattr(inputs, i.name) + forces.get(s, 0.0)
                     for i, (s, _) in zip(self.inputs, JOINTS, strict=True)}  # fmt: skip
            return self.derivative(state, Point("input", given), c)

    assert asked(Under) == []


def recording(torque_nm: float, seed: int = 3) -> Recording:
    """The arm under a servo that knows nothing of what rubs in its shoulder [N m]."""
    rng, fine = np.random.default_rng(seed), 20
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
    model = LogModel(unlike(Arm)(), [recording(0.0)])
    (note,) = coupled_forces(model)
    assert note in column_notes(model)


@pytest.mark.slow
def test_friction_in_a_joint_is_named_where_the_port_is_like_its_motor(tmp_path):
    import wakedeploy as wd

    gap = wd.close_gap(Arm, recording(0.3), tmp_path, report=False, plan=False)
    assert (gap.verdict, *gap.effects) == ("named", "coulomb-friction@shoulder_radps")
    (effect,) = gap.result.effects
    force = effect.parameters["force"]
    assert force.unit == "N m"
    assert abs(force.value - 0.3) < force.high - force.low < 0.06


@pytest.mark.slow
def test_nine_intervals_of_ten_hold_the_friction_in_a_joint():
    name = "coulomb-friction@shoulder_radps"
    held = 0
    for seed in range(6):
        model = LogModel(Arm(), [recording(0.3, seed)])
        used = [e for e in range(model.episodes) if e not in model.sealed()]
        low, high = fit(model, (name,), used).interval(f"{name}.force")
        held += low < 0.3 < high
    assert held >= 4  # fewer have a chance of 1.6 %
