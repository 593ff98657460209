"""Effects that remember where a motion turned, stepped coarsely: against an adaptive integrator."""

from typing import ClassVar

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import neutral
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.filter import Stepping
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE, SAMPLES = 200.0, 200
MASS_KG, DAMPING, STIFFNESS = 2.0, 3.0, 2000.0
OUT_M = 0.02  # where it is let go


class Swinging(System):
    """A mass on a spring; about forty samples a swing."""

    rate_hz = RATE
    inputs: ClassVar = [Input("push_n", "N")]
    states: ClassVar = {"x_m": "m", "v_mps": "m/s"}
    outputs: ClassVar = [Output("x_m", "m"), Output("v_mps", "m/s")]
    constants: ClassVar = [Constant("mass_kg", MASS_KG)]
    ports: ClassVar = [Port.force("v_mps", inertia="mass_kg", position="x_m")]

    def derivative(self, state, inputs, c):
        force = inputs.push_n - DAMPING * state.v_mps - STIFFNESS * state.x_m
        return {"x_m": state.v_mps, "v_mps": force / c.mass_kg}


def bent(v, z, p):
    return (v - abs(v) * z) / p["length"]


def remembered(v, z, p):
    return (v - abs(v) * z - p["shape"] * v * abs(z)) / p["length"]


EFFECTS = [
    ("hysteresis@v_mps", {"force": 30.0, "length": 0.006, "shape": -0.9}, remembered),
    ("pre-sliding-friction@v_mps", {"force": 8.0, "length": 0.004}, bent),
]


@pytest.fixture(scope="module")
def model():
    time_s = np.arange(SAMPLES) / RATE
    x = OUT_M * np.cos(np.sqrt(STIFFNESS / MASS_KG) * time_s)
    columns = {"push_n": 0.0 * x, "x_m": x, "v_mps": np.gradient(x, time_s)}
    known = LogModel(checked(Swinging()), [Recording("run", time_s, columns)])
    known.filter.guesses[:, 0] = OUT_M, 0.0
    return known


def values_of(model, effect, parameters):
    """Parameter sets of one, (1,) each, without any form of the model's own."""
    values = model.values((effect,), neutral(model.free((effect,))))
    values |= {f"{effect}.{n}": v for n, v in parameters.items()}
    values |= {n: 0.0 for n in values if n.startswith(("form.", "clock."))}
    return {n: np.array([v]) for n, v in values.items()}


@pytest.mark.parametrize("begun_mps", [0.05, 0.01, 1e-4, 1e-6, 0.0, -1e-6, -1e-4, -0.01])
@pytest.mark.parametrize(("effect", "parameters", "rate"), EFFECTS)
def test_a_turn_within_a_step_counts_from_where_it_is(model, effect, parameters, rate, begun_mps):
    """Without, the memory is off by 0.1 where the turn is near the step's begin."""
    values, acting = values_of(model, effect, parameters), model.acting((effect,))
    lanes = {n: v[None, :] for n, v in values.items()}
    lanes |= acting.formed(lanes)
    begun = [OUT_M, begun_mps, 0.95]
    reached, time_s = np.array(begun)[:, None], np.zeros((1, 1))
    inputs = model.filter.arriving(acting, values).at(0, np.array([0]))
    stepping = Stepping(acting, model.filter.aside(acting, 1))
    constants = acting.constants(lanes, time_s)
    stepping.on(reached, np.zeros((3, 3, 1)), inputs, constants, lanes, time_s)

    def derivative(t, s):
        x, v, z = s
        force = -DAMPING * v - STIFFNESS * x - parameters["force"] * z
        return [v, force / MASS_KG, rate(v, z, parameters)]

    exact = solve_ivp(derivative, (0.0, 1.0 / RATE), begun, rtol=1e-10, atol=1e-12, max_step=1e-5)
    assert reached[2, 0] == pytest.approx(exact.y[2, -1], abs=0.02)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("effect", "parameters", "most"),
    [(*EFFECTS[0][:2], 25.0), (*EFFECTS[1][:2], 5.0)],
)
def test_a_motion_goes_smoothly_with_a_parameter(model, effect, parameters, most):
    """A likelihood that jumps keeps a climb where it is, far below the top; by 168 and 36 once."""
    sizes = parameters["length"] * (1.0 + 0.0002 * np.arange(100))
    acting = model.acting((effect,))
    sets = (values_of(model, effect, parameters | {"length": size}) for size in sizes)
    shown = np.array([model.filter.free_run(acting, values)[1][0] for values in sets])
    changes = np.abs(np.diff(shown[:, [60, 100, 150, 199]], axis=0))
    assert np.all(changes.max(axis=0) < most * np.median(changes, axis=0))
