"""A system with dry friction, replayed sample by sample, against its motion in small steps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.augmented import Acting
from wakedeploy.gap.systems.logs import LogModel

MASS_KG, SPRING_N_PER_M, FRICTION_N, RATE_HZ, FINE = 2.0, 30.0, 4.0, 50, 200


class Sled(System):
    """A mass on a spring, which a force pulls."""

    rate_hz = float(RATE_HZ)
    inputs = [Input("force_n", "N")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", MASS_KG), Constant("spring_n_per_m", SPRING_N_PER_M)]
    ports = [Port.force("speed_mps", inertia="mass_kg", kinds=["coulomb-friction"])]

    def derivative(self, state, inputs, c):
        pull = inputs.force_n - c.spring_n_per_m * state.position_m
        return {"position_m": state.speed_mps, "speed_mps": pull / c.mass_kg}


class SteppedSled(Sled):
    """The same, as a step of its own."""

    derivative = None

    def step(self, state, inputs, c):
        """By the matrix exponential."""
        w, dt = math.sqrt(c.spring_n_per_m / c.mass_kg), 1.0 / RATE_HZ
        rest = inputs.force_n / c.spring_n_per_m
        away = state.position_m - rest
        return {
            "position_m": rest + away * math.cos(w * dt) + state.speed_mps * math.sin(w * dt) / w,
            "speed_mps": state.speed_mps * math.cos(w * dt) - away * w * math.sin(w * dt),
        }


def in_small_steps(force_n: np.ndarray) -> np.ndarray:
    """Positions (n,) of a sled that stops where it would turn, and stays while it can."""
    x, v, dt, shown = 0.0, 0.0, 1.0 / RATE_HZ / FINE, []
    for force in force_n:
        shown.append(x)
        for _ in range(FINE):
            pull = force - SPRING_N_PER_M * x
            if v == 0.0 and abs(pull) <= FRICTION_N:
                break
            against = math.copysign(FRICTION_N, v if v != 0.0 else pull)
            further = v + (pull - against) / MASS_KG * dt
            v = 0.0 if further * v < 0.0 else further
            x += v * dt
    return np.array(shown)


def replayed(system: System, force_n: np.ndarray, position_m: np.ndarray) -> np.ndarray:
    """Positions (n,) as the filter's own steps have them, from where a log begins."""
    time_s = np.arange(len(force_n)) / RATE_HZ
    columns = {"force_n": force_n, "position_m": position_m}
    model = LogModel(system, [Recording("sled", time_s, columns)])
    acting = Acting(model.system, [model.library["coulomb-friction@speed_mps"]], model.sizes)
    name = "coulomb-friction@speed_mps"
    values = {f"{name}.force": FRICTION_N, f"{name}.turning": 1e-4}
    states, _ = model.filter.free_run(acting, {n: np.array([v]) for n, v in values.items()})
    return states[0]


# A force on a system that steps acts on its speed at the step's end, which is half a step late.
@pytest.mark.parametrize(("sled", "off"), [(Sled, 0.01), (SteppedSled, 0.05)])
@given(seed=st.integers(0, 2**31))
@settings(max_examples=20)
def test_a_sled_slides_sticks_and_is_let_go_as_in_small_steps(sled, off, seed):
    force_n = np.repeat(np.random.default_rng(seed).normal(0.0, 8.0, 16), 25)
    position_m = in_small_steps(force_n)
    most = off * max(np.ptp(position_m), 0.1)
    assert replayed(sled(), force_n, position_m) == pytest.approx(position_m, abs=most)
