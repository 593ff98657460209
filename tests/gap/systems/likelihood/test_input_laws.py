"""A signal that a law makes of what is logged: a place for what acts behind the law."""

from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System, UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.results import answer_of
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.kinds.inputs import DeadBand, Lag
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.plan import plan
from wakedeploy.gap.systems.sensitivity import column_notes
from wakedeploy.gap.systems.simulation import simulated
from wakedeploy.gap.systems.system import Point

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


@pytest.mark.whole
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
    assert model.system.curved == {"pulse_us": "speed_mps"}
    assert model.curved_inputs(["lag@pulse_us"]) == ["pulse_us"]
    assert model.curved_inputs(["sensor-lag@depth_m"]) == ["pulse_us"]
    assert model.curved_inputs(["gain@pulse_us", "dead-time@pulse_us"]) == []
    assert checked(Pod()).curved == {}
    notes = [note for note in column_notes(model) if "law=" in note]
    assert notes == [
        "input pulse_us: the rate of speed_mps goes with a curve of it. What lags, is late or "
        "limited behind that curve, as a motor is behind the square of its command, has no port: "
        "state the curve as an input of its own, Input(…, law=…)."
    ]


class Limited(Pod):
    """A limit is no curve."""

    inputs: ClassVar = [Input("pulse_us", "us")]
    ports: ClassVar = [Port.output("depth_m")]

    def derivative(self, state, inputs, c):
        return {"depth_m": state.speed_mps, "speed_mps": np.clip(inputs.pulse_us, -0.7, 0.7)}


def test_a_limit_is_no_curve():
    assert checked(Limited()).curved == {}


def test_a_plan_commands_what_can_be_commanded():
    model = LogModel(checked(Pod()), [log(40.0)])
    found = plan(model, fitted_base(model), ["lag@square_us2", "sensor-lag@depth_m"])
    assert found.best is not None
    assert found.best.moved == ("pulse_us",)
    assert np.abs(found.best.columns["pulse_us"]).max() <= 300.0
    assert found.best.columns.keys() == {"pulse_us", "depth_m"}


def wrong(law, **stated):
    class Wrong(Pod):
        inputs: ClassVar = [Input("pulse_us", "us"), Input("square_us2", "us²", law=law, **stated)]

    return Wrong()


@pytest.mark.parametrize(
    ("system", "said"),
    [
        (wrong(lambda i: i.rudder_rad), r"'rudder_rad' is not there; there are: pulse_us"),
        (
            wrong(lambda i: np.sqrt(i.pulse_us)),
            r"law of 'square_us2' gives nan for 'square_us2' at pulse_us = -",
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
