"""A sensor that shows nothing below a limit, in whose prediction a jump stands for a slope."""

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search import scan
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE_HZ, N = 0.2, 1500
FLOOR = "sensor-floor@temp_k"


class Heater(System):
    """A body that loses heat; the temperature is over that of the room."""

    rate_hz = RATE_HZ
    inputs = [Input("power_w", "W")]
    states = {"temp_k": "K"}
    outputs = [Output("temp_k", "K", noise=0.05)]
    constants = [
        Constant("capacity_jpk", 800.0, spread=80.0, unit="J/K"),
        Constant("loss_wpk", 2.0, spread=0.3, unit="W/K"),
    ]
    ports = [
        Port.input("power_w"),
        Port.force("temp_k", position="temp_k"),
        Port.output("temp_k"),
    ]

    def derivative(self, state, inputs, c):
        return {"temp_k": (inputs.power_w - c.loss_wpk * state.temp_k) / c.capacity_jpk}


def _model(seed: int) -> tuple[LogModel, float]:
    """A log of steps of power, most of whose readings are at the sensor's floor, and the floor."""
    rng = np.random.default_rng(seed)
    power = np.repeat(rng.uniform(0.0, 100.0, N // 40 + 1), 40)[:N]
    keep, temp, shown = np.exp(-2.0 / 800.0 / RATE_HZ), 0.0, []
    for watts in power:  # exact for a power that is kept
        shown.append(temp)
        temp = watts / 2.0 + (temp - watts / 2.0) * keep
    measured = np.array(shown) + 0.05 * rng.standard_normal(N)
    floor = float(np.quantile(measured, 0.6))
    columns = {"power_w": power, "temp_k": np.maximum(measured, floor)}
    return LogModel(Heater(), [Recording("made", np.arange(N) / RATE_HZ, columns)]), floor


@pytest.mark.whole
@pytest.mark.parametrize(
    "seed", [pytest.param(1, marks=pytest.mark.slow), 9, pytest.param(14, marks=pytest.mark.slow)]
)
def test_a_floor_leads_although_the_estimate_crosses_it(seed: int) -> None:
    """In the last two the parabola of one block loses thousands of nats, and a stop would lead."""
    model, floor = _model(seed)
    base = fitted_base(model)
    best, chance = scan.ranked(model, base, list(model.effects))
    assert best[0].name == FLOOR
    assert best[0].gain_nats > 3.0 * chance.nats
    assert best[0].fit.value(f"{FLOOR}.limit") == pytest.approx(floor, abs=0.05)
    bent, left = (abs(f.value("constant.capacity_jpk") - 800.0) for f in (base, best[0].fit))
    assert left < 0.5 * bent  # the capacity had bent to what the sensor hides
