"""How far ahead forecasts go: no further than a system that runs away lets them tell anything."""

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.forecast_length import growth_per_s, samples_ahead
from wakedeploy.gap.systems.likelihood.logs import LogModel


class Standing(System):
    """A pendulum about its upper end: θ'' = k sin θ + u, which runs away at √k a second."""

    rate_hz = 100.0
    inputs = [Input("push", "rad/s^2")]
    states = {"angle_rad": "rad", "speed_radps": "rad/s"}
    outputs = [Output("angle_rad", "rad", noise=1e-3)]
    constants = [Constant("k", 144.0, spread=1.0, unit="1/s^2")]
    ports = [Port.force("speed_radps", unit="rad/s^2", position="angle_rad")]

    def derivative(self, state, inputs, c):
        rate = c.k * np.sin(state.angle_rad) + inputs.push
        return {"angle_rad": state.speed_radps, "speed_radps": rate}


def _step(self, state, inputs, c):
    """The same, as a step of one sample by Euler's way."""
    rates = Standing.derivative(self, state, inputs, c)
    return {name: getattr(state, name) + 0.01 * rate for name, rate in rates.items()}


def _model(kind=Standing, **changes):
    rng = np.random.default_rng(0)
    columns = {"push": rng.standard_normal(4000), "angle_rad": 0.05 * np.sin(np.arange(4000) / 30)}
    system = type("Made", (kind,), changes)()
    return LogModel(system, [Recording("log", np.arange(4000) / 100.0, columns)])


def test_errors_grow_as_the_linear_system_says():
    assert growth_per_s(_model()) == pytest.approx(12.0, rel=0.01)
    hanging = _model(constants=[Constant("k", -144.0, spread=1.0, unit="1/s^2")])
    assert growth_per_s(hanging) == pytest.approx(0.0, abs=0.01)


def test_a_forecast_ends_where_an_error_has_grown_twentyfold():
    assert _model().horizon == 25  # of 1/100 s: e^(12 · 0.25) = 20
    assert (
        _model(constants=[Constant("k", -144.0, unit="1/s^2")]).horizon == 62
    )  # a quarter of a block
    assert (
        _model(constants=[Constant("k", 4.0, unit="1/s^2")]).horizon == 62
    )  # a quarter of a block
    assert _model(constants=[Constant("k", 2e4, unit="1/s^2")]).horizon == 3
    assert _model(forecast_s=0.7).horizon == 70


def _in_steps(step, **changes):
    stepped = type("Step", (System,), {**_statements(), "step": step, **changes})
    return LogModel(checked(stepped()), _model().recordings)


def test_a_discrete_system_runs_away_as_well():
    growth = np.log(1.0 + 0.01 * 12.0) / 0.01  # of Euler's step, whose eigenvalues are 1 ± h λ
    model = _in_steps(_step)
    assert growth_per_s(model) == pytest.approx(growth, rel=0.01)
    assert model.horizon == int(3.0 / (0.01 * growth))


@pytest.mark.parametrize("turn", [0.0, 1.2, np.pi])
def test_a_fast_oscillation_that_grows_in_steps_runs_away(turn):
    def step(self, state, inputs, c):
        x, y = state.angle_rad, state.speed_radps
        cosine, sine = 1.3 * np.cos(turn), 1.3 * np.sin(turn)
        return {"angle_rad": cosine * x - sine * y + 0.0 * inputs.push, "speed_radps":
                sine * x + cosine * y + 0.0 * c.k}  # fmt: skip

    model = _in_steps(step)
    assert growth_per_s(model) == pytest.approx(np.log(1.3) / 0.01, rel=1e-3)
    assert model.horizon == 11


def test_places_where_a_function_gives_no_number_do_not_count():
    def broken(self, state, inputs, c):
        rates = Standing.derivative(self, state, inputs, c)
        return {name: np.where(state.angle_rad > 0.0, np.nan, rate) for name, rate in rates.items()}

    assert growth_per_s(_model(derivative=broken)) == pytest.approx(12.0, rel=0.05)


def test_a_function_that_fails_leaves_the_usual_length(monkeypatch):
    def fail(self, states, inputs):
        raise UnusableInput("it fails there")

    model = _model()
    monkeypatch.setattr(LogModel, "rates_at", fail)
    assert samples_ahead(model) == 62


def _statements():
    names = ("rate_hz", "inputs", "states", "outputs", "constants", "ports")
    return {name: getattr(Standing, name) for name in names}
