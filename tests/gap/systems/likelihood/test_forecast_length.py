"""How far ahead forecasts go: no further than a system that runs away lets them tell anything."""

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.forecast_length import growth_per_s
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


def test_a_discrete_system_runs_away_as_well():
    stepped = type("Step", (System,), {**_statements(), "step": _step})
    model = LogModel(checked(stepped()), _model().recordings)
    assert model.horizon == 25


def test_a_function_that_fails_somewhere_leaves_the_usual_length():
    def broken(self, state, inputs, c):
        rates = Standing.derivative(self, state, inputs, c)
        return {name: np.where(state.angle_rad > 0.0, np.nan, rate) for name, rate in rates.items()}

    assert growth_per_s(_model(derivative=broken)) == pytest.approx(12.0, rel=0.05)


def _statements():
    names = ("rate_hz", "inputs", "states", "outputs", "constants", "ports")
    return {name: getattr(Standing, name) for name in names}
