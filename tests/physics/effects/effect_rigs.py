"""Rigs with effects, and open-loop flights of the plant, for the tests beside this file."""

from collections.abc import Callable, Mapping

import numpy as np

from wakedeploy.core.rig import Effect, EffectParameter, Rig
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects import Effect as Shape
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig

CLEAN = default_rig().changed(
    disturbance={
        "turbulence_fraction": 0.0,
        "outlier_probability": 0.0,
        "clock_jitter_s": 0.0,
        "esc_frame_s": 0.0,
    },
    rail={"coulomb_n": 0.0, "stiction_n": 0.0, "viscous_n_per_mps": 0.0},
    range_sensor={"noise_m": 0.0, "resolution_m": 0.0, "period_s": 1.0 / 64.0},
    latency={"round_trip_s": 0.0},
)
NO_WAKE = CLEAN.changed(wake={"strength": 0.0})
PROMPT = NO_WAKE.without("spool")  # motors follow at once
WEIGHT_N = CLEAN.sufferer.mass_kg * 9.81
HOVER_US = CLEAN.thrust.sufferer.pulse(WEIGHT_N)
DT_S = GantryPlant.dt_s


def with_effects(rig: Rig, **effects: Mapping[str, float]) -> Rig:
    """The rig with effects; underscores in their names stand for hyphens."""
    entries = []
    for name, values in effects.items():
        one = LIBRARY[name.replace("_", "-")]
        unit = {parameter.name: parameter.unit for parameter in one.parameters}
        entries.append(
            Effect(
                name=one.name,
                parameters={p: EffectParameter(value=v, unit=unit[p]) for p, v in values.items()},
            )
        )
    return rig.model_copy(update={"effect": tuple(entries)})


def neutral_values(shape: Shape, constants: Mapping[str, float]) -> dict[str, float]:
    """An effect's values at which it changes nothing on a rig with these constants."""
    return {p.name: p.neutral_on(constants) for p in shape.parameters}


def flown(
    plant: GantryPlant,
    seconds: float,
    *,
    sufferer_us: Callable[[float], float] = lambda t_s: HOVER_US,
    source_us: Callable[[float], float] = lambda t_s: 1000.0,
    carriage_mps: Callable[[float], float] = lambda t_s: 0.0,
) -> dict[str, np.ndarray]:
    """Step a plant open loop; its state after each step, (N,) each."""
    names = ("z_m", "vz_mps", "x_m", "wake_force_n", "sufferer_thrust_n", "source_thrust_n")
    rows = []
    for _ in range(round(seconds / DT_S)):
        t_s = plant.t_s
        plant.step(source_us(t_s), sufferer_us(t_s), carriage_mps(t_s))
        sample = plant.range_sample()
        rows.append([*(getattr(plant, n) for n in names), sample.range_m, sample.sensor_time_s])
    columns = np.array(rows).T
    return dict(zip((*names, "range_m", "sensor_time_s"), columns, strict=True))
