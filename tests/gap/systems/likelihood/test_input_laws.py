"""A signal that a law makes of what is logged: a place for what acts behind the law."""

from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System, UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import extended
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.results import answer_of
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.correction import correction_of, write_correction
from wakedeploy.gap.systems.kinds.inputs import DeadBand, Lag
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.plan import _same_delay
from wakedeploy.gap.systems.ports import Point
from wakedeploy.gap.systems.sensitivity import column_notes
from wakedeploy.gap.systems.simulation import simulated

RATE = 20.0
PUSH, MASS, DRAG, TAU_S = 6e-5, 12.0, 9.0, 0.4  # N/us², kg, N/(m/s), s


def squared(inputs):
    """Thrust of a propeller, but for a constant."""
    return inputs.pulse_us * np.abs(inputs.pulse_us)


class Pod(System):
    """A vehicle under water that one thruster heaves."""

    rate_hz = RATE
    inputs: ClassVar = [Input("pulse_us", "us"), Input("square_us2", "us²", law=squared)]
    states: ClassVar = {"depth_m": "m", "speed_mps": "m/s"}
    outputs: ClassVar = [Output("depth_m", "m", noise=2e-3)]
    constants: ClassVar = [
        Constant("push_n_per_us2", PUSH, spread=6e-6),
        Constant("mass_kg", MASS),
        Constant("drag_n_s_per_m", DRAG, spread=0.5),
    ]
    ports: ClassVar = [
        Port.input("square_us2", kinds=["lag", "gain"]),
        Port.force("speed_mps", inertia="mass_kg", kinds=["quadratic-drag"]),
        Port.output("depth_m", kinds=["sensor-lag"]),
    ]

    def derivative(self, state, inputs, c):
        force = c.push_n_per_us2 * inputs.square_us2 - c.drag_n_s_per_m * state.speed_mps
        return {"depth_m": state.speed_mps, "speed_mps": force / c.mass_kg}


def pulses(seconds, seed=2):
    rng = np.random.default_rng(seed)
    count = int(seconds * RATE)
    return np.repeat(rng.uniform(-300.0, 300.0, count // 12 + 1), 12)[:count]


def heaved(command, tau_s, fine=40):
    """Depths, by small Euler steps; the thrust lags behind its square."""
    thrust, speed, depth, shown = PUSH * command[0] * abs(command[0]), 0.0, 0.0, []
    for pulse in command:
        shown.append(depth)
        for _ in range(fine):
            wanted, dt_s = PUSH * pulse * abs(pulse), 1.0 / (RATE * fine)
            thrust = wanted if not tau_s else thrust + dt_s / tau_s * (wanted - thrust)
            depth += dt_s * speed
            speed += dt_s * (thrust - DRAG * speed) / MASS
    noise = 2e-3 * np.random.default_rng(3).standard_normal(len(shown))
    return np.array(shown) + noise


def log(seconds=45.0, tau_s=TAU_S):
    command = pulses(seconds)
    columns = {"pulse_us": command, "depth_m": heaved(command, tau_s)}
    return Recording("pod", np.arange(len(command)) / RATE, columns)


@pytest.mark.slow
def test_a_lag_behind_a_square_is_named_where_it_is():
    model = LogModel(checked(Pod()), [log()])
    answer = answer_of(named(model, fitted_base(model)))
    assert [e.name for e in answer.effects] == ["lag@square_us2"]
    assert answer.verdict == "named"
    tau = answer.effects[0].parameters["tau_s"]
    assert tau.low < TAU_S < tau.high
    assert tau.high - tau.low < 0.3 * TAU_S


def test_nothing_is_named_where_nothing_lags():
    model = LogModel(checked(Pod()), [log(tau_s=0.0)])
    assert answer_of(named(model, fitted_base(model))).verdict == "none"


class Banded(Pod):
    """The same, asked for what acts before the law as well."""

    ports: ClassVar = [Port.input("pulse_us"), Port.input("square_us2"), Port.output("depth_m")]


def test_what_acts_before_the_law_passes_through_it():
    model = LogModel(checked(Banded()), [log(12.0)])
    acting = model.acting(("dead-band@pulse_us", "lag@square_us2"))
    values = {
        "dead-band@pulse_us.half_width": 40.0,
        "lag@square_us2.tau_s": 0.3,
        "clock.pulse_us": 0.0,
    }
    rows = model.logs[0].driving
    parts_s = 1.0 / RATE / (rows.shape[1] / len(model.logs[0].inputs[0]))
    cut = DeadBand().filtered(rows[0], {"half_width": 40.0}, parts_s)
    expected = Lag().filtered(cut * np.abs(cut), {"tau_s": 0.3}, parts_s)
    parts = acting.parts("square_us2", rows, values)
    np.testing.assert_allclose(parts.ravel(), expected, rtol=1e-12)
    np.testing.assert_array_equal(model.logs[0].driving[1], rows[0] * np.abs(rows[0]))


def test_the_same_delay_before_and_behind_the_law_is_offered_once():
    model = LogModel(checked(Banded()), [log(12.0)])
    assert "dead-time@pulse_us" in model.effects
    assert "sample-and-hold@pulse_us" in model.effects
    assert "dead-time@square_us2" not in model.effects
    assert "sample-and-hold@square_us2" not in model.effects
    assert {"lag@pulse_us", "lag@square_us2"} <= set(model.effects)


class Logged(Pod):
    """The same, its square a column of the log."""

    inputs: ClassVar = [Input("pulse_us", "us"), Input("square_us2", "us²")]


def test_a_replay_is_that_of_a_log_that_has_the_square_as_a_column():
    recording = log(20.0)
    squares = {"square_us2": squared(Point("input", recording.columns))}
    logged = Recording("pod", recording.time_s, recording.columns | squares)
    replays = simulated(checked(Pod()), recording), simulated(checked(Logged()), logged)
    np.testing.assert_array_equal(replays[0]["depth_m"], replays[1]["depth_m"])


class Curved(Pod):
    """The square within the equations: no port stands behind it."""

    inputs: ClassVar = [Input("pulse_us", "us")]
    ports: ClassVar = [
        Port.input("pulse_us", kinds=["lag", "gain", "dead-time"]),
        Port.output("depth_m", kinds=["sensor-lag", "sensor-bias"]),
    ]

    def derivative(self, state, inputs, c):
        force = c.push_n_per_us2 * squared(inputs) - c.drag_n_s_per_m * state.speed_mps
        return {"depth_m": state.speed_mps, "speed_mps": force / c.mass_kg}


def test_a_curve_within_the_equations_is_seen_and_what_may_stand_for_a_lag_behind_it():
    model = LogModel(checked(Curved()), [log(12.0)])
    assert model.curves == {"pulse_us": ("speed_mps",)}
    assert model.curved_inputs(["lag@pulse_us"]) == ["pulse_us"]
    assert model.curved_inputs(["sensor-lag@depth_m"]) == ["pulse_us"]
    assert model.curved_inputs(["gain@pulse_us", "dead-time@pulse_us"]) == []
    assert LogModel(checked(Pod()), [log(12.0)]).curves == {}
    notes = [note for note in column_notes(model) if "law=" in note]
    assert notes == [
        "input pulse_us: the rate of speed_mps goes with a curve of it. What lags behind that "
        "curve, as a motor behind the square of its command, has no port: state the curve as an "
        "input of its own, Input(…, law=…)."
    ]


def dead_zone(pulse):
    return np.where(np.abs(pulse) > 25.0, pulse * np.abs(pulse), 0.0)


def tabled(pulse):
    return np.interp(pulse, [-300.0, -40.0, 40.0, 300.0], [-9e4, 0.0, 0.0, 9e4])


@pytest.mark.parametrize(
    ("rate", "is_curve"),
    [
        (dead_zone, True),
        (tabled, True),
        (lambda pulse: 3.0 * np.clip(pulse, -100.0, 100.0), True),
        (lambda pulse: 9e4 * np.tan(pulse / 2000.0), False),  # hardly bent where the log has been
        (lambda pulse: 300.0 * pulse, False),
    ],
)
def test_what_is_a_curve_is_asked_where_the_log_has_been(rate, is_curve):
    class Driven(Curved):
        def derivative(self, state, inputs, c):
            force = c.push_n_per_us2 * rate(inputs.pulse_us) - c.drag_n_s_per_m * state.speed_mps
            return {"depth_m": state.speed_mps, "speed_mps": force / c.mass_kg}

    model = LogModel(checked(Driven()), [log(12.0)])
    assert (model.curves == {"pulse_us": ("speed_mps",)}) == is_curve


class Servo(System):
    """Holds a depth that is asked for, with no more force than it has, beside one that rests."""

    rate_hz = 20.0
    inputs: ClassVar = [Input("wanted_m", "m"), Input("tilt_rad", "rad")]
    states: ClassVar = {"depth_m": "m", "speed_mps": "m/s", "turn_radps": "rad/s"}
    outputs: ClassVar = [Output("depth_m", "m", noise=1e-3)]
    constants: ClassVar = [Constant("most_n", 3.0), Constant("play_m", 0.0)]
    ports: ClassVar = [Port.input("wanted_m")]

    def derivative(self, state, inputs, c):
        wanted = np.sign(inputs.wanted_m) * np.maximum(np.abs(inputs.wanted_m) - c.play_m, 0.0)
        pull = np.clip(20.0 * (wanted - state.depth_m), -c.most_n, c.most_n)
        return {
            "depth_m": state.speed_mps,
            "speed_mps": pull - 6.0 * state.speed_mps,
            "turn_radps": inputs.tilt_rad + 1e-18 * inputs.wanted_m,  # rounding moves it
        }


@pytest.mark.parametrize(
    ("most_n", "play_m", "is_curve"), [(3.0, 0.0, False), (0.3, 0.0, True), (3.0, 0.1, True)]
)
def test_a_servo_s_limit_is_a_curve_where_it_was_reached_and_its_dead_band(
    most_n, play_m, is_curve
):
    class Limited(Servo):
        constants: ClassVar = [Constant("most_n", most_n), Constant("play_m", play_m)]

    time_s = np.arange(600) / 20.0
    wanted = 0.6 * np.sin(0.25 * time_s)  # as asked from where it is; from its farthest, 24 N
    columns = {"wanted_m": wanted, "tilt_rad": 0.0 * wanted, "depth_m": 0.0 * wanted}
    depth = Limited().simulate(Recording("dive", time_s, columns))["depth_m"]
    model = LogModel(checked(Limited()), [Recording("dive", time_s, columns | {"depth_m": depth})])
    assert (model.curves == {"wanted_m": ("speed_mps",)}) == is_curve
    assert is_curve or model.curves == {}


class Steered(System):
    """A cart whose steering, by a curve, does not move how fast it goes."""

    rate_hz = RATE
    inputs: ClassVar = [Input("pull_n", "N"), Input("steer_rad", "rad")]
    states: ClassVar = {"speed_mps": "m/s", "yaw_rad": "rad"}
    outputs: ClassVar = [Output("speed_mps", "m/s"), Output("yaw_rad", "rad")]
    ports: ClassVar = [
        Port.output("speed_mps", kinds=["sensor-lag"]),
        Port.output("yaw_rad", kinds=["sensor-lag"]),
    ]

    def derivative(self, state, inputs, c):
        turn = np.tan(inputs.steer_rad) * state.speed_mps
        return {"speed_mps": inputs.pull_n - state.speed_mps, "yaw_rad": turn}


def test_a_curve_is_no_reason_to_doubt_an_output_that_it_does_not_drive():
    rng, time_s = np.random.default_rng(0), np.arange(400) / RATE
    names = ("pull_n", "steer_rad", "speed_mps", "yaw_rad")
    columns = {name: 0.5 + rng.uniform(-0.8, 0.8, 400) for name in names}
    model = LogModel(checked(Steered()), [Recording("cart", time_s, columns)])
    assert model.curves == {"steer_rad": ("yaw_rad",)}
    assert model.curved_inputs(["sensor-lag@speed_mps"]) == []
    assert model.curved_inputs(["sensor-lag@yaw_rad"]) == ["steer_rad"]


class Slipping(Steered):
    """The same, slowed down by how far it steers: one input bends two states."""

    def derivative(self, state, inputs, c):
        turn = np.tan(1.5 * inputs.steer_rad) * state.speed_mps
        slowed = inputs.pull_n - state.speed_mps - 3.0 * np.abs(inputs.steer_rad)
        return {"speed_mps": slowed, "yaw_rad": turn}


def test_an_output_is_doubted_by_whichever_of_two_states_drives_it():
    rng, time_s = np.random.default_rng(0), np.arange(400) / RATE
    names = ("pull_n", "steer_rad", "speed_mps", "yaw_rad")
    columns = {name: 0.5 + rng.uniform(-0.8, 0.8, 400) for name in names}
    columns["steer_rad"] -= 0.5
    model = LogModel(checked(Slipping()), [Recording("cart", time_s, columns)])
    assert model.curves == {"steer_rad": ("speed_mps", "yaw_rad")}
    for output in ("speed_mps", "yaw_rad"):
        assert model.curved_inputs([f"sensor-lag@{output}"]) == ["steer_rad"]


def mixed(inputs):
    """What two logged inputs make together."""
    return inputs.pulse_us * inputs.battery_v


class Mixed(System):
    """Two logged inputs with ports, two laws, one of them of both."""

    rate_hz = RATE
    inputs: ClassVar = [
        Input("power_us_v", "us V", law=mixed, delay_s=0.1),
        Input("pulse_us", "us"),
        Input("square_us2", "us²", law=squared),
        Input("battery_v", "V"),
    ]
    states: ClassVar = {"speed_mps": "m/s"}
    outputs: ClassVar = [Output("speed_mps", "m/s", noise=1e-3)]
    constants: ClassVar = [Constant("gain", 1e-4, spread=1e-5, unit="1")]
    ports: ClassVar = [Port.input(i.name) for i in inputs]

    def derivative(self, state, inputs, c):
        return {"speed_mps": c.gain * (inputs.power_us_v + inputs.square_us2) - state.speed_mps}


def recorded(count=240):
    pulse, rng = pulses(count / RATE), np.random.default_rng(4)
    columns = {
        "pulse_us": pulse,
        "battery_v": 12.0 + rng.standard_normal(count),
        "speed_mps": rng.standard_normal(count),
    }
    return Recording("mixed", np.arange(count) / RATE, columns)


def test_laws_stand_beside_logged_inputs_each_with_its_port():
    model = LogModel(checked(Mixed()), [recorded()])
    assert model.system.made_of == {
        "power_us_v": ("pulse_us", "battery_v"), "square_us2": ("pulse_us",)
    }  # fmt: skip
    assert model.system.unheard == 2
    columns = recorded().columns
    late = np.concatenate([np.full(2, columns["pulse_us"][0] * columns["battery_v"][0]),
                           (columns["pulse_us"] * columns["battery_v"])[:-2]])  # fmt: skip
    np.testing.assert_allclose(model.logs[0].inputs[0], late, rtol=1e-12)
    for name in ("lag@battery_v", "lag@pulse_us", "lag@power_us_v", "lag@square_us2"):
        fitted = fit(model, (name,), range(model.episodes))
        assert np.isfinite(fitted.objective)
    assert "dead-time@power_us_v" in model.effects  # of two inputs at once: no logged one's
    assert "dead-time@square_us2" not in model.effects


def test_a_correction_with_an_effect_behind_a_law_is_read_back(tmp_path):
    model = LogModel(checked(Mixed()), [recorded()])
    base = fit(model, (), range(model.episodes))
    start = extended(base, model.free(("lag@square_us2",)))
    start[-1] = 0.4
    fitted = fit(model, ("lag@square_us2",), range(model.episodes), start)
    write_correction(correction_of(model, fitted), tmp_path / "correction.toml")
    plain, corrected = Mixed(), Mixed.corrected(tmp_path / "correction.toml")
    tau_s = fitted.value("lag@square_us2.tau_s")
    assert corrected.correction.values["lag@square_us2.tau_s"] == tau_s > 0.0
    shown = [s.simulate(recorded())["speed_mps"] for s in (checked(plain), corrected)]
    assert np.abs(shown[0] - shown[1]).max() > 1e-3


def test_what_was_on_its_way_before_the_log_passes_through_the_law():
    model = LogModel(checked(Banded()), [log(12.0)])
    acting = model.acting(("lag@pulse_us",))
    names = (*acting.states, *model.system.states)
    values = {"lag@pulse_us.tau_s": np.array([0.3])}
    for own, expected in ((0.0, 100.0**2), (50.0, 150.0**2), (-200.0, -(100.0**2))):
        named = dict.fromkeys(names, np.zeros(1)) | {
            acting.effects[0].own_states[0]: np.array([own])
        }
        inputs = {"pulse_us": np.array([100.0]), "square_us2": np.array([1e4])}
        reached = acting._arriving(inputs, named, values, np.zeros(1), {})
        assert reached["square_us2"] == pytest.approx(expected)


class Twice(System):
    """The pulse acts by its square and beside it."""

    rate_hz = RATE
    inputs: ClassVar = Pod.inputs
    states: ClassVar = {"speed_mps": "m/s"}
    outputs: ClassVar = [Output("speed_mps", "m/s")]
    ports: ClassVar = [Port.input("pulse_us"), Port.input("square_us2")]

    def derivative(self, state, inputs, c):
        return {"speed_mps": inputs.square_us2 + inputs.pulse_us - state.speed_mps}


def test_a_delay_of_the_law_alone_is_offered_where_it_is_something_else():
    model = LogModel(checked(Twice()), [recorded()])
    assert {"dead-time@pulse_us", "dead-time@square_us2"} <= set(model.effects)


class Stepped(System):
    """A discrete system driven by a law."""

    rate_hz = RATE
    inputs: ClassVar = Pod.inputs
    states: ClassVar = {"speed_mps": "m/s"}
    outputs: ClassVar = [Output("speed_mps", "m/s", noise=1e-3)]
    constants: ClassVar = [Constant("gain", 1e-5, spread=1e-6, unit="1")]
    ports: ClassVar = [Port.input("square_us2", kinds=["lag", "gain"])]

    def step(self, state, inputs, c):
        return {"speed_mps": 0.9 * state.speed_mps + c.gain * inputs.square_us2}


def test_a_discrete_system_is_driven_by_a_law():
    model = LogModel(checked(Stepped()), [recorded()])
    replay = checked(Stepped()).simulate(recorded())["speed_mps"]
    speed, expected = replay[0], []
    for pulse in recorded().columns["pulse_us"]:
        expected.append(speed)
        speed = 0.9 * speed + 1e-5 * pulse * abs(pulse)
    np.testing.assert_allclose(replay, expected, rtol=1e-9, atol=1e-12)
    assert np.isfinite(fit(model, ("lag@square_us2",), range(model.episodes)).objective)


def test_a_law_that_gives_no_number_on_a_log_is_refused_with_what_it_got():
    class Inverse(Pod):
        inputs: ClassVar = [
            Input("pulse_us", "us"),
            Input("square_us2", "us²", law=lambda i: 1.0 / np.where(i.pulse_us == 7.0, 0.0, 9.0)),
        ]

    recording = log(12.0)
    recording.columns["pulse_us"][50] = 7.0
    with pytest.raises(UnusableInput, match="the law of 'square_us2' gives inf at pulse_us = 7"):
        LogModel(Inverse(), [recording])


def test_a_delay_behind_a_law_is_shorter_than_the_log():
    class Late(Pod):
        inputs: ClassVar = [
            Input("pulse_us", "us"), Input("square_us2", "us²", law=squared, delay_s=40.0)
        ]  # fmt: skip

    with pytest.raises(UnusableInput, match="input 'square_us2' has a delay_s of 40"):
        LogModel(checked(Late()), [log(12.0)])


@pytest.mark.parametrize("law", [dead_zone, tabled, lambda u: np.maximum(u - 1500.0, 0.0) ** 2])
def test_a_law_may_be_flat_about_zero(law):
    class Flat(Pod):
        inputs: ClassVar = [
            Input("pulse_us", "us"), Input("square_us2", "us²", law=lambda i: law(i.pulse_us))
        ]  # fmt: skip

    assert checked(Flat()).made_of == {"square_us2": ("pulse_us",)}


def test_a_law_that_changes_beyond_the_log_is_another_system():
    class Cut(Pod):
        inputs: ClassVar = [
            Input("pulse_us", "us"),
            Input("square_us2", "us²", law=lambda i: np.clip(squared(i), -9.2e4, 9.2e4)),
        ]

    found = [checked(system).probed()["law square_us2"] for system in (Pod(), Cut())]
    assert found[0].tobytes() != found[1].tobytes()


def test_of_one_input_and_one_output_no_plan_tells_a_delay_before_from_one_behind():
    model = LogModel(checked(Banded()), [log(12.0)])
    assert _same_delay(model, ("dead-time@pulse_us", "sensor-dead-time@depth_m"))
    assert _same_delay(model, ("sensor-dead-time@depth_m", "dead-time@square_us2"))
    assert not _same_delay(model, ("dead-time@pulse_us", "lag@square_us2"))


def wrong(law, **stated):
    class Wrong(Pod):
        inputs: ClassVar = [Input("pulse_us", "us"), Input("square_us2", "us²", law=law, **stated)]

    return Wrong()


@pytest.mark.parametrize(
    ("system", "said"),
    [
        (wrong(lambda i: i.rudder_rad), r"'rudder_rad' is not there; there are: pulse_us"),
        (
            wrong(lambda i: np.sqrt(-1.0 - i.pulse_us**2)),
            r"law of 'square_us2' gives nan for 'square_us2' at pulse_us = ",
        ),
        (wrong(lambda i: 3.0), r"law of 'square_us2' depends on no logged input"),
        (wrong(lambda i: np.mean(i.pulse_us)), r"another 'square_us2' for one point"),
        (
            wrong(lambda i: i.pulse_us[..., None]),
            r"law of 'square_us2' gives 'square_us2' the shape",
        ),
        (wrong(lambda i: {"a": 1.0}), r"law of 'square_us2' gives .*no real number"),
        (wrong(7.0), r"law of input 'square_us2' is 7.0; give a function"),
        (
            wrong(squared, hold="linear"),
            r"law of input 'square_us2' makes it of what is logged: state `hold`",
        ),
    ],
)
def test_a_law_that_cannot_be_one_is_refused_by_its_name(system, said):
    with pytest.raises(UnusableInput, match=said):
        checked(system)
