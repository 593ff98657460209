"""A hovering drone whose rotors give less than they say: its mass bends, and has to come back."""

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel

SHARE, MASS_KG, GRAVITY_MPS2 = 0.6, 0.5, 9.81
RATE_HZ, SAMPLES, FINE = 50.0, 1000, 20


class Drone(System):
    """Thrust over mass, less gravity."""

    rate_hz = RATE_HZ
    inputs = [Input("thrust_n", "N")]
    states = {"height_m": "m", "climb_mps": "m/s"}
    outputs = [Output("height_m", "m", noise=1e-3)]
    constants = [
        Constant("mass_kg", MASS_KG, spread=0.01),
        Constant("gravity_mps2", GRAVITY_MPS2),
    ]
    ports = [
        Port.input("thrust_n", kinds=["gain", "bias", "lag", "dead-time"]),
        Port.force(
            "climb_mps", inertia="mass_kg", position="height_m",
            kinds=["offset", "viscous-friction", "quadratic-drag", "added-inertia"],
        ),
        Port.output("height_m"),
    ]  # fmt: skip

    def derivative(self, state, inputs, c):
        return {
            "height_m": state.climb_mps,
            "climb_mps": inputs.thrust_n / c.mass_kg - c.gravity_mps2,
        }


def _flown(seed):
    """20 s after a reference of slow waves, under a controller that knows the height."""
    random, times = np.random.default_rng(seed), np.arange(SAMPLES) / RATE_HZ
    rates_hz, phases = random.uniform(0.05, 0.6, 6), random.uniform(0.0, 2.0 * np.pi, 6)
    waves = np.sin(2.0 * np.pi * rates_hz * times[:, None] + phases).sum(1)
    height, climb, held, step_s = 1.0, 0.0, 0.0, 1.0 / RATE_HZ / FINE
    thrust, read = np.zeros(SAMPLES), np.zeros(SAMPLES)
    for k, wanted in enumerate(1.0 + 0.16 * waves):
        read[k] = height + 1e-3 * random.standard_normal()
        held += 0.04 * (wanted - read[k])
        push = MASS_KG * (GRAVITY_MPS2 + 20.0 * (wanted - read[k]) - 7.0 * climb)
        thrust[k] = np.clip(push + held, 0.0, 20.0)
        for _ in range(FINE):
            climb += step_s * (SHARE * thrust[k] / MASS_KG - GRAVITY_MPS2)
            height += step_s * climb
    return Recording(f"drone {seed}", times, {"thrust_n": thrust, "height_m": read})


@pytest.mark.slow
def test_a_gain_is_named_although_the_mass_has_bent_to_it():
    """Beside a mass that is bent by twenty spreads a push explains nearly as much."""
    model = LogModel(checked(Drone()), [_flown(seed) for seed in range(3)])
    base = fitted_base(model)
    assert base.value("constant.mass_kg") > 0.6
    outcome = named(model, base)
    assert outcome.found.hypothesis == ("gain@thrust_n",)
    assert not outcome.rivals
    assert outcome.found.value("gain@thrust_n.error") == pytest.approx(SHARE - 1.0, abs=0.02)
    assert outcome.found.value("constant.mass_kg") == pytest.approx(MASS_KG, abs=0.02)
