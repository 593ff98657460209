"""Effects whose sizes have a summit each: a hold's period, the steps of a command."""

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.search.scan import ranked
from wakedeploy.gap.search.weighing import crossed, weight_of, without
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE_HZ, N = 100.0, 1200
HOLD, STEPS = "sample-and-hold@force_n", "quantisation@force_n"


class Slider(System):
    """A mass with drag under a force, its place measured."""

    rate_hz = RATE_HZ
    inputs = [Input("force_n", "N")]
    states = {"x_m": "m", "speed_mps": "m/s"}
    outputs = [Output("x_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", 2.0), Constant("drag", 1.5, 0.3)]
    ports = [Port.input("force_n"), Port.force("speed_mps", inertia="mass_kg", position="x_m")]

    def derivative(self, state, inputs, c):
        pull = inputs.force_n - c.drag * state.speed_mps
        return {"x_m": state.speed_mps, "speed_mps": pull / c.mass_kg}


def _model(period: int = 1, step_n: float = 0.0) -> LogModel:
    """A log whose force changes in every sample, as a controller's does that is fed noise."""
    rng = np.random.default_rng(5)
    t = np.arange(N) / RATE_HZ
    command = 12.0 * np.sin(1.9 * t) + 6.0 * np.sin(5.3 * t) + 8.0 * rng.standard_normal(N)
    acting = command[np.arange(N) // period * period]
    acting = step_n * np.round(acting / step_n) if step_n else acting
    x, v, places = 0.0, 0.0, []
    for force in acting:  # exact for a force that is kept
        places.append(x)
        keep, dt = np.exp(-1.5 / 2.0 / RATE_HZ), 1.0 / RATE_HZ
        end = force / 1.5
        x += end * dt + (v - end) * (1.0 - keep) * 2.0 / 1.5
        v = end + (v - end) * keep
    shown = np.array(places) + 1e-3 * rng.standard_normal(N)
    return LogModel(Slider(), [Recording("log", t, {"force_n": command, "x_m": shown})])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "hidden", "size", "among"),
    [
        (HOLD, {"period": 6}, 0.06, False),
        (HOLD, {"period": 13}, 0.13, True),
        (STEPS, {"step_n": 7.0}, 7.0, False),
    ],
)
def test_the_summit_that_is_right_is_found_where_each_size_has_one(name, hidden, size, among):
    """With the noise that a base without it needs, the right size is no better than a wrong one.

    Nor does it lead a race among all effects then.
    """
    model = _model(**hidden)
    base = fitted_base(model)
    ranking, _ = ranked(model, base, list(model.effects) if among else [name])
    found = ranking[0]
    assert found.name == name
    (parameter,) = (f.name for f in found.fit.free if f.name.startswith(name))
    low, high = found.fit.interval(parameter)
    assert found.fit.value(parameter) == pytest.approx(size, rel=0.03)
    assert low <= size <= high
    assert found.gain_nats > 50.0
    # Forecasts of blocks that are left out keep the size: no slope tells where they would have it.
    place = found.fit.names.index(parameter)
    assert without(found.fit, [0, 1])[place] == found.fit.theta[place]
    assert weight_of(crossed(model, base), crossed(model, found.fit)).low > 0.3
