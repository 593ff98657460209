"""What an input does between samples, and steps within one: against solutions by SciPy."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.comparison import errors
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.between_samples import between
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.sensitivity import checked_base, step_notes

RATE = 100.0
TONES = np.array([[1.0, 3.1, 0.3], [0.8, 9.7, 1.1], [0.7, 14.2, 2.0], [0.5, 23.0, 0.7]])
# amplitude, frequency [Hz], phase [rad]; the system swings at 12 Hz


class Hard(System):
    """A spring that hardens, sampled eight times a swing."""

    rate_hz = RATE
    inputs = [Input("push_n", "N", hold="bandlimited")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-4)]
    constants = [
        Constant("stiffness", 5700.0, spread=600.0, unit="1/s²"),
        Constant("damping", 6.0, spread=3.0, unit="1/s"),
        Constant("cubic", 2e6, spread=1e6, unit="1/s²/m²"),
    ]
    ports = [Port.force("speed_mps", position="position_m")]

    def derivative(self, state, inputs, c):
        back = c.stiffness * state.position_m + c.cubic * state.position_m**3
        rate = 60.0 * inputs.push_n - back - c.damping * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": rate}


def push_n(time_s):
    amplitude, frequency_hz, phase = TONES.T[:, :, None]
    waves = amplitude * np.sin(2.0 * np.pi * frequency_hz * np.atleast_1d(time_s) + phase)
    return waves.sum(0)


def swung(seconds=8.0, force=push_n, noise_m=1e-4, rate_hz=RATE):
    """The spring by an integrator of high order, its input as it is at every moment."""

    def slope(t, y):
        rate = 60.0 * force(t)[0] - 5700.0 * y[0] - 2e6 * y[0] ** 3 - 6.0 * y[1]
        return [y[1], rate]

    time_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    x = solve_ivp(slope, (0.0, seconds), [0.0, 0.0], "DOP853", time_s, rtol=1e-9, atol=1e-12).y[0]
    shown = x + noise_m * np.random.default_rng(0).standard_normal(len(x))
    return Recording("swung", time_s, {"push_n": force(time_s), "position_m": shown})


def variant(**changes):
    return checked(type("Hard", (Hard,), changes)())


@pytest.mark.parametrize(
    ("hold", "steps", "off"),
    [("bandlimited", 4, 2e-4), ("bandlimited", 1, 2e-4), ("linear", 4, 0.3)],
)
def test_values_between_samples_are_those_of_the_signal(hold, steps, off):
    time_s = np.arange(400) / RATE
    middles = (np.arange(400 * steps) + 0.5) / RATE / steps
    inside = slice(30 * steps, -30 * steps)
    found = between(push_n(time_s), hold, steps)
    assert np.abs(found - push_n(middles))[inside].max() < off


def test_a_step_is_kept_and_a_constant_stays_what_it_is():
    held = between(np.array([1.0, -2.0, 3.0]), "step", 2)
    assert held.tolist() == [1.0, 1.0, -2.0, -2.0, 3.0, 3.0]
    for hold in ("step", "linear", "bandlimited"):
        assert between(np.full(50, 7.0), hold, 3) == pytest.approx(np.full(150, 7.0), abs=1e-3)


@pytest.mark.slow
def test_a_replay_in_fine_steps_is_that_of_an_integrator():
    recording = swung(noise_m=0.0)
    truth = recording.columns["position_m"]
    swing = np.sqrt(np.mean(truth**2))

    def off(**changes):
        replay = variant(**changes).simulate(recording)["position_m"]
        return np.sqrt(np.mean((replay - truth)[100:] ** 2)) / swing

    assert off(steps=8) < 0.02
    assert off(steps=16) < off(steps=4)
    assert off(inputs=[Input("push_n", "N")]) > 0.5  # held, it comes half a sample late


@pytest.mark.slow
def test_rows_that_are_finer_than_the_rate_are_the_inputs_of_its_steps():
    """What a controller holds for a step is what acts in that step."""
    values = np.random.default_rng(3).standard_normal(4800)

    def held(time_s):
        return values[np.minimum((np.atleast_1d(time_s) * 4 * RATE + 1e-9).astype(int), 4799)]

    recording = swung(2.0, held, 0.0, 4 * RATE)
    truth = recording.columns["position_m"][::4]

    def off(steps):
        system = variant(steps=steps, inputs=[Input("push_n", "N")])
        return np.std((system.simulate(recording)["position_m"] - truth)[100:]) / np.std(truth)

    assert off(8) < 0.05
    assert off(3) < 0.25  # rows that fill no step are what comes early and late in one


@pytest.mark.slow
def test_constants_come_out_true_where_a_held_input_bends_them():
    recording = swung()
    model = LogModel(variant(steps=4), [recording])
    base = fitted_base(model)
    truth = {"stiffness": 5700.0, "damping": 6.0, "cubic": 2e6}
    for name, value in truth.items():
        assert base.value(f"constant.{name}") == pytest.approx(value, rel=0.02)
    (error_m,) = errors(model, base, model.sealed())
    coarse = LogModel(variant(), [recording])
    (coarse_m,) = errors(coarse, fitted_base(coarse), coarse.sealed())
    assert error_m < 0.3 * coarse_m


@pytest.mark.whole
def test_a_check_says_where_steps_are_too_coarse_and_how_many_will_do():
    recording = swung(seconds=4.0)
    coarse = LogModel(variant(), [recording])
    (note,) = step_notes(coarse, checked_base(coarse))
    assert "position_m: the model's steps are too coarse" in note
    steps = int(re.search(r"State `steps = (\d+)`", note)[1])
    fine = LogModel(variant(steps=steps), [recording])
    assert step_notes(fine, checked_base(fine)) == []


def test_what_is_too_short_to_look_ahead_in_has_no_note():
    short = swung(seconds=0.08)
    model = LogModel(variant(), [short])
    assert step_notes(model, checked_base(model)) == []


@pytest.mark.whole
def test_steps_that_are_recommended_fit_the_rows_of_a_sample():
    model = LogModel(variant(), [swung(seconds=2.0, rate_hz=5 * RATE)])
    (note,) = step_notes(model, checked_base(model))
    steps = int(re.search(r"State `steps = (\d+)`", note)[1])
    assert steps % 5 == 0
    assert len(LogModel(variant(steps=steps), [swung(seconds=2.0, rate_hz=5 * RATE)]).logs) == 1


def test_logged_inputs_stay_what_was_logged_however_a_signal_swings_between():
    square = np.where(np.arange(600) // 30 % 2 == 0, 10.0, 0.0)
    columns = {"push_n": square, "position_m": 1e-3 * np.sin(np.arange(600) / 9.0)}
    model = LogModel(variant(steps=4), [Recording("square", np.arange(600) / RATE, columns)])
    assert (model.logs[0].inputs.min(), model.logs[0].inputs.max()) == (0.0, 10.0)
    assert model.logs[0].driving.max() > 10.5  # a band-limited signal overshoots
    assert model.sizes["turns push_n"] == 0.0


class Line(System):
    """A linear system, of which every step is exact."""

    rate_hz = RATE
    inputs = [Input("push_n", "N")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-3)]

    def derivative(self, state, inputs, c):
        back = 40.0 * state.position_m + 3.0 * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": inputs.push_n - back}


def test_noise_is_the_same_in_however_many_steps_a_sample_is_gone():
    rng = np.random.default_rng(1)
    columns = {"push_n": rng.standard_normal(400), "position_m": 0.02 * rng.standard_normal(400)}
    recording = Recording("line", np.arange(400) / RATE, columns)
    likelihoods = []
    for steps in (1, 4):
        model = LogModel(checked(type("Line", (Line,), {"steps": steps})()), [recording])
        theta = np.array([f.neutral for f in model.free(())])
        scores = model.scores((), theta[None], range(model.episodes))[0]
        likelihoods.append(sum(s.log_density.sum() for s in scores))
    assert likelihoods[1] == pytest.approx(likelihoods[0], abs=0.5)
    other = np.where([f.name == "force.speed_mps" for f in model.free(())], theta + 0.7, theta)
    moved = sum(
        s.log_density.sum() for s in model.scores((), other[None], range(model.episodes))[0]
    )
    assert abs(moved - likelihoods[1]) > 5.0  # twice the noise would show
