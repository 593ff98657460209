"""Inputs that come later in a log than what they drive are told, and by how much."""

from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.systems.answers.words import late_words
from wakedeploy.gap.systems.likelihood.clocks import late_inputs
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE_HZ, MASS_KG = 50.0, 2.0


class Wagon(System):
    """A mass that a motor pushes and a wind that is measured, too."""

    rate_hz = RATE_HZ
    inputs: ClassVar = [Input("motor_n", "N"), Input("wind_n", "N")]
    states: ClassVar = {"speed_mps": "m/s"}
    outputs: ClassVar = [Output("speed_mps", "m/s", noise=2e-3)]
    constants: ClassVar = [Constant("mass_kg", MASS_KG, spread=0.1), Constant("drag", 1.0, 0.2)]
    ports: ClassVar = [Port.input("motor_n"), Port.force("speed_mps", inertia="mass_kg")]

    def derivative(self, state, inputs, c):
        force = inputs.motor_n + inputs.wind_n - c.drag * state.speed_mps
        return {"speed_mps": force / c.mass_kg}


def model(motor_late=0, wind_late=0, output_late=0, samples=900):
    """A minute of the wagon, with columns that come so many samples late."""
    rng = np.random.default_rng(4)
    motor = np.repeat(rng.normal(0.0, 4.0, samples // 20), 20)
    wind = np.repeat(rng.normal(0.0, 2.0, samples // 15), 15)
    speed = np.zeros(samples)
    for k in range(samples - 1):
        keep = np.exp(-1.0 / MASS_KG / RATE_HZ)
        speed[k + 1] = keep * speed[k] + (1.0 - keep) * (motor[k] + wind[k])
    columns = {
        "motor_n": _late(motor, motor_late),
        "wind_n": _late(wind, wind_late),
        "speed_mps": _late(speed, output_late) + 2e-3 * rng.standard_normal(samples),
    }
    return LogModel(Wagon(), [Recording("made", np.arange(samples) / RATE_HZ, columns)])


@pytest.mark.slow
@pytest.mark.parametrize("period", [40, pytest.param(50, marks=pytest.mark.slow)])
def test_of_an_input_that_repeats_itself_a_delay_is_no_lead(period):
    """A square wave: a delay of a sixth of it is a lead of the rest."""
    samples, late = 900, period // 6
    rng = np.random.default_rng(4)
    motor = np.where(np.arange(samples) % period < period // 2, 4.0, -4.0)
    keep, speed = np.exp(-1.0 / MASS_KG / RATE_HZ), np.zeros(samples)
    acting = _late(motor, late)
    for k in range(samples - 1):
        speed[k + 1] = keep * speed[k] + (1.0 - keep) * acting[k]
    columns = {
        "motor_n": motor,
        "wind_n": np.zeros(samples),
        "speed_mps": speed + 2e-3 * rng.standard_normal(samples),
    }
    made = LogModel(Wagon(), [Recording("made", np.arange(samples) / RATE_HZ, columns)])
    assert late_inputs(made, fitted_base(made)) == {}


def _late(column, samples):
    return np.concatenate([np.full(samples, column[0]), column[: len(column) - samples]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("late", "told"),
    [
        pytest.param({"motor_late": 6}, {"motor_n": 0.12}, marks=pytest.mark.slow),
        ({"motor_late": 3}, {"motor_n": 0.06}),
        pytest.param({"wind_late": 11}, {"wind_n": 0.22}, marks=pytest.mark.slow),
        ({}, {}),
        ({"output_late": 4}, {}),  # a delay, which effects explain
    ],
)
def test_an_input_that_comes_after_what_it_drives_is_late(late, told):
    made = model(**late)
    assert late_inputs(made, fitted_base(made)) == pytest.approx(told)


def test_an_output_that_never_changes_moves_before_nothing():
    """A sensor that hangs: any shift of the input explains its silence as well or better."""
    motor = np.repeat(np.random.default_rng(2).normal(3.0, 1.0, 45), 20)
    columns = {"motor_n": motor, "wind_n": np.zeros(900), "speed_mps": np.full(900, 3.0)}
    made = LogModel(Wagon(), [Recording("made", np.arange(900) / RATE_HZ, columns)])
    assert late_inputs(made, fitted_base(made)) == {}


@pytest.mark.parametrize("late", [0, 4])
def test_inputs_that_a_controller_moves_together_are_late_together_or_not_at_all(late):
    rng = np.random.default_rng(7)
    common = np.repeat(rng.normal(0.0, 2.0, 45), 20)
    turning = np.repeat(rng.normal(0.0, 4.0, 225), 4)
    left, right = common + turning, common - turning
    keep, speed = np.exp(-1.0 / MASS_KG / RATE_HZ), np.zeros(len(left))
    for k in range(len(left) - 1):
        speed[k + 1] = keep * speed[k] + (1.0 - keep) * (left[k] + right[k])
    columns = {"motor_n": _late(left, late), "wind_n": _late(right, late)}
    columns["speed_mps"] = speed + 2e-3 * rng.standard_normal(len(speed))
    made = LogModel(Wagon(), [Recording("made", np.arange(len(left)) / RATE_HZ, columns)])
    told = {"motor_n": late / RATE_HZ, "wind_n": late / RATE_HZ} if late else {}
    assert late_inputs(made, fitted_base(made)) == pytest.approx(told)


class Pod(System):
    """A thruster pod on a slide, whose drag in water nobody has written."""

    rate_hz = RATE_HZ
    inputs: ClassVar = [Input("thrust_n", "N")]
    states: ClassVar = {"heave_m": "m", "heave_mps": "m/s"}
    outputs: ClassVar = [Output("heave_m", "m", noise=2e-3)]
    constants: ClassVar = [Constant("mass_kg", 5.3, spread=0.2), Constant("drag", 2.0, 0.6)]
    ports: ClassVar = [Port.force("heave_mps", inertia="mass_kg", kinds=["quadratic-drag"])]

    def derivative(self, state, inputs, c):
        force = inputs.thrust_n - c.drag * state.heave_mps
        return {"heave_m": state.heave_mps, "heave_mps": force / c.mass_kg}


def pod(late, samples=900, fine=10):
    """It in water: a controller of its place follows slow waves of several periods."""
    rng = np.random.default_rng(2)
    time_s = np.arange(samples) / RATE_HZ
    waves = [(f, rng.uniform(0.0, 2.0 * np.pi)) for f in (0.12, 0.29, 0.43, 0.64)]
    wanted = sum(11.0 * np.sin(2.0 * np.pi * f * time_s + phase) for f, phase in waves)
    place, speed, shown, thrust = 0.0, 0.0, np.zeros(samples), np.zeros(samples)
    for k in range(samples):
        shown[k] = place + 2e-3 * rng.standard_normal()
        thrust[k] = wanted[k] - 25.0 * shown[k]
        for _ in range(fine):
            force = thrust[k] - 2.0 * speed - 18.0 * speed * abs(speed)
            speed += force / 5.3 / RATE_HZ / fine
            place += speed / RATE_HZ / fine
    columns = {"thrust_n": _late(thrust, late), "heave_m": shown}
    return LogModel(Pod(), [Recording("water", time_s, columns)])


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, 6])
def test_outputs_that_lead_only_as_drag_is_missing_are_no_late_input(late):
    made = pod(late)
    base = fitted_base(made)
    assert late_inputs(made, base)  # without drag, what moves seems to come too early
    drag = settled(made, fit(made, ("quadratic-drag@heave_mps",), base.episodes))[0]
    told = late_inputs(made, base, drag)
    assert told == ({"thrust_n": pytest.approx(late / RATE_HZ)} if late else {})


def test_the_sentence_says_which_column_to_shift_and_by_how_much():
    (sentence,) = late_words({"motor_n": 0.12})
    assert "120 ms before motor_n" in sentence
    assert "shift_s in columns.toml, less by 0.12" in sentence
    assert late_words({}) == []
