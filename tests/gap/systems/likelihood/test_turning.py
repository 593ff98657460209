"""Effects that remember where a motion turned, stepped coarsely: against an adaptive integrator."""

from typing import ClassVar

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import neutral
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.filter import Noise, Stepping
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


class Discrete(Swinging):
    """The same in steps of its own."""

    derivative = property()

    def step(self, state, inputs, c):
        rates = Swinging.derivative(self, state, inputs, c)
        return {n: getattr(state, n) + rates[n] / RATE for n in rates}


def recordings():
    time_s = np.arange(SAMPLES) / RATE
    x = OUT_M * np.cos(np.sqrt(STIFFNESS / MASS_KG) * time_s)
    columns = {"push_n": 0.0 * x, "x_m": x, "v_mps": np.gradient(x, time_s)}
    return [Recording("run", time_s, columns)]


@pytest.fixture(scope="module")
def model():
    known = LogModel(checked(Swinging()), recordings())
    known.filter.guesses[:, 0] = OUT_M, 0.0
    return known


def values_of(model, effect, parameters):
    """Parameter sets of one, (1,) each, without any form of the model's own."""
    values = model.values((effect,), neutral(model.free((effect,))))
    values |= {f"{effect}.{n}": v for n, v in parameters.items()}
    values |= {n: 0.0 for n in values if n.startswith(("form.", "clock."))}
    return {n: np.array([v]) for n, v in values.items()}


BEGUN_MPS = [0.05, 0.01, 1e-4, 1e-6, 0.0, -1e-6, -1e-4, -0.01]


def stepped(model, effect, parameters, begun, push_mps2=0.0):
    """The memory after one step of the filter, and after as much time by an adaptive integrator."""
    (rate,) = (r for n, _, r in EFFECTS if n == effect)
    values, acting = values_of(model, effect, parameters), model.acting((effect,))
    lanes = {n: v[None, :] for n, v in values.items()}
    lanes |= acting.formed(lanes)
    reached, time_s = np.array([*begun, push_mps2])[:, None], np.zeros((1, 1))
    inputs = model.filter.arriving(acting, values).at(0, np.array([0]))
    one = np.ones((1, 1))
    noise = Noise(one, 0.0 * one, 0.0 * one, one, 0.0 * one)
    stepping = Stepping(acting, model.filter.aside(acting, 1), noise, [1])
    constants = acting.constants(lanes, time_s)
    stepping.on(reached, np.zeros((4, 4, 1)), inputs, constants, lanes, time_s)

    def derivative(t, s):
        x, v, z = s
        force = -DAMPING * v - STIFFNESS * x - parameters["force"] * z
        return [v, force / MASS_KG + push_mps2, rate(v, z, parameters)]

    exact = solve_ivp(derivative, (0.0, 1.0 / RATE), begun, rtol=1e-9, atol=1e-11, max_step=2e-5)
    return reached[2, 0], exact.y[2, -1]


@pytest.mark.parametrize("begun_mps", BEGUN_MPS)
@pytest.mark.parametrize(("effect", "parameters", "rate"), EFFECTS)
def test_a_turn_within_a_step_counts_from_where_it_is(model, effect, parameters, rate, begun_mps):
    """Without, the memory is off by 0.1 where the turn is near the step's begin."""
    reached, exact = stepped(model, effect, parameters, [OUT_M, begun_mps, 0.95])
    assert reached == pytest.approx(exact, abs=0.02)


@pytest.mark.parametrize("begun_mps", BEGUN_MPS)
@pytest.mark.parametrize(("effect", "parameters", "rate"), EFFECTS)
def test_a_push_that_lasts_turns_as_well(model, effect, parameters, rate, begun_mps):
    reached, exact = stepped(model, effect, parameters, [0.0, begun_mps, 0.95], push_mps2=-24.0)
    assert reached == pytest.approx(exact, abs=0.03)


@pytest.mark.parametrize("begun_mps", [0.05, 1e-6])
@pytest.mark.parametrize(("effect", "parameters", "rate"), EFFECTS)
def test_a_turn_over_many_lengths_leaves_the_memory_in_its_range(
    model, effect, parameters, rate, begun_mps
):
    """A memory of a tenth of a millimetre that goes back half a millimetre: extrapolated, −4.6."""
    short = parameters | {"length": 1e-4}
    reached, exact = stepped(model, effect, short, [OUT_M, begun_mps, 0.95])
    assert abs(reached - exact) < 0.2


def test_a_discrete_system_has_no_within():
    """Its memory goes on by what the step's begin says: the same on both sides of a turn."""
    model = LogModel(checked(Discrete()), recordings())
    effect, parameters, _ = EFFECTS[1]
    ends = [stepped(model, effect, parameters, [OUT_M, v, 0.95])[0] for v in (1e-6, -1e-6)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("effect", "parameters", "most"),
    [(*EFFECTS[0][:2], 25.0), (*EFFECTS[1][:2], 5.0)],
)
def test_a_motion_goes_smoothly_with_a_parameter(model, effect, parameters, most):
    """A likelihood that jumps keeps a climb where it is, far below the top; by 168 and 36 once."""
    sizes = parameters["length"] * (1.0 + 0.0002 * np.arange(40))
    acting = model.acting((effect,))
    sets = (values_of(model, effect, parameters | {"length": size}) for size in sizes)
    shown = np.array([model.filter.free_run(acting, values)[1][0] for values in sets])
    changes = np.abs(np.diff(shown[:, [60, 100, 150, 199]], axis=0))
    assert np.all(changes.max(axis=0) < most * np.median(changes, axis=0))
