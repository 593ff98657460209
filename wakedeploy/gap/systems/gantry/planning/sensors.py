"""Sensors that one could buy, and what each would add to the information about effects.

In: the evidence of some flights. Out: the same with the sensor's readings beside the range's. Each
sensor is emulated: its reading's change with every nuisance and effect comes from the forces along
the flight, its noise is assumed, and its zero is unknown in every flight.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wakedeploy.core.rig import LOOP_RATE_HZ
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.separation import Evidence
from wakedeploy.gap.systems.gantry.flight import DT_S, GRID_HZ, Flight, FloatArray
from wakedeploy.gap.systems.gantry.forces import Forces
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.acting import motion_along
from wakedeploy.physics.effects.chain import setting_of
from wakedeploy.physics.rail import GRAVITY_MPS2

_STRIDE = round(GRID_HZ / LOOP_RATE_HZ)
_PLAIN_MOTION = ("accelerometer", "anemometer")  # every effect shows in them


@dataclass(frozen=True)
class Sensor:
    """A sensor read once per tick: noise in its own unit, `gain_sd` how well its gain is known.

    `euros` is about what it costs. `sees` are the beginnings of names of constants that its reading
    depends on; effects say in which sensors they show. `_READINGS` has what it reads.
    """

    name: str
    description: str
    noise: float
    unit: str
    gain_sd: float
    euros: float
    sees: tuple[str, ...] = ()


# Prices are those of hobby parts; noise is what their data sheets and a moving rig leave. The force
# that a measured air speed means is not known from outside, so the anemometer's gain is loose.
SENSORS = (
    Sensor("battery-voltage", "the sufferer's battery on an analogue input of the UNO",
           0.005, "1", 0.02, 2.0),
    Sensor("sufferer-speed", "rotor speed of the sufferer, optical or from the ESC",
           0.005, "1", 0.02, 8.0, ("command.", "spool.sufferer")),
    Sensor("source-speed", "rotor speed of the source, optical or from the ESC",
           0.005, "1", 0.02, 8.0, ("command.", "spool.source")),
    Sensor("accelerometer", "on the sufferer, along the rail", 0.2, "m/s^2", 0.02, 10.0),
    Sensor("carriage-position", "a linear encoder beside the carriage",
           0.001, "m", 0.001, 40.0),
    Sensor("second-range", "a laser triangulation sensor beside the first",
           0.0045, "m", 0.003, 50.0, ("range.",)),
    Sensor("anemometer", "a pitot tube on the sufferer, in the jet", 0.4, "m/s", 0.3, 60.0),
)  # fmt: skip


def with_sensor(evidence: Evidence, model: GantryModel, base: Fit, sensor: Sensor) -> Evidence:
    """The evidence of the same flights, had they carried this sensor as well.

    Its gain is one more nuisance, shared by all flights.
    """
    p = len(evidence.precision)
    grams = []
    for place, episode in enumerate(base.episodes):
        rows = _sensitivities(evidence, model, base, sensor, episode)
        rows = (rows - rows.mean(axis=0)) / sensor.noise
        known = np.insert(np.insert(evidence.gram[place], p, 0.0, axis=0), p, 0.0, axis=1)
        grams.append(known + rows.T @ rows)
    precision = np.append(evidence.precision, sensor.gain_sd**-2)
    return replace(evidence, gram=np.array(grams), precision=precision)


def _sensitivities(
    evidence: Evidence, model: GantryModel, base: Fit, sensor: Sensor, episode: int
) -> FloatArray:
    """How the readings (n,) change with nuisances, own gain and effect directions, (n, q + 1)."""

    def reading(hypothesis: tuple[str, ...], theta: FloatArray) -> FloatArray:
        return _reading(model, replace(base, hypothesis=hypothesis, theta=theta), sensor, episode)

    here = reading(base.hypothesis, base.theta)
    columns = []
    for i, free in enumerate(base.free):
        moved = base.theta.copy()
        moved[i] += free.step
        known = _is_seen(sensor, free.name) and not free.name.startswith("noise.")
        columns.append(
            (reading(base.hypothesis, moved) - here) / free.step if known else np.zeros_like(here)
        )
    columns.append(here)  # a gain that is a little off
    for c in evidence.columns:
        if c.nuisances:  # the same readings, or curvature would pass for a difference
            columns.append(np.sum([amount * columns[i] for i, amount in c.nuisances], axis=0))
            continue
        known = _is_seen(sensor, c.effect)
        near = reading(c.hypothesis, c.near) if known else here
        origin = reading(c.hypothesis, c.origin) if known else here
        columns.append((near - origin) / c.share)
    return np.stack(columns, axis=1)


def _is_seen(sensor: Sensor, name: str) -> bool:
    if sensor.name in _PLAIN_MOTION:
        return True
    effect = LIBRARY.get(name.partition(".")[0])
    return sensor.name in effect.shows_in if effect else name.startswith(sensor.sees)


def _reading(model: GantryModel, fitted: Fit, sensor: Sensor, episode: int) -> FloatArray:
    """What the sensor would read while the sufferer is in the air, (n,)."""
    flight = model.flights[episode]
    if sensor.name == "second-range":
        # With a true second sensor the first range's errors show with the noise of both.
        forces = model.forces(fitted, episode)
        return np.asarray(forces.expected[0][flight.counted])
    if sensor.name == "carriage-position":
        values = _carriage_error(model, fitted, flight)
    else:
        values = _READINGS[sensor.name](model.forces(fitted, episode))
    flown = [values[a:b:_STRIDE] for a, b in zip(flight.start, flight.stop, strict=True)]
    return np.concatenate(flown)


def _voltage(forces: Forces) -> FloatArray:
    """The voltage relative to a fresh battery: thrust goes with its square."""
    return np.asarray(0.5 * np.log(np.maximum(forces.sufferer_n, 1e-3)))


def _sufferer_speed(forces: Forces) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(forces.sufferer_n, 0.0)) / _ROOT_N)


def _source_speed(forces: Forces) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(forces.source_n, 0.0)) / _ROOT_N)


def _accelerometer(forces: Forces) -> FloatArray:
    return np.asarray(forces.acceleration[0] + GRAVITY_MPS2)


def _anemometer(forces: Forces) -> FloatArray:
    return forces.wake_mps


_ROOT_N = 2.0  # √N, near hover: speeds count in shares of it
_READINGS: dict[str, Callable[[Forces], FloatArray]] = {
    "battery-voltage": _voltage,
    "sufferer-speed": _sufferer_speed,
    "source-speed": _source_speed,
    "accelerometer": _accelerometer,
    "anemometer": _anemometer,
}


def _carriage_error(model: GantryModel, fitted: Fit, flight: Flight) -> FloatArray:
    """How far the carriage is from where its steps say, (N,) [m]."""
    motion = motion_along(flight.grid_s, flight.take_off_s, flight.x_m, flight.vx_mps, DT_S)
    setting = setting_of(model.rig)
    theta = dict(zip((f.name for f in model.free(fitted.hypothesis)), fitted.theta, strict=True))
    error, carriage_m = np.zeros(len(flight.grid_s)), flight.x_m
    for name in fitted.hypothesis:
        effect = model.effect(name)
        if effect.stage == "sensor":
            values = {p.name: theta[f"{name}.{p.name}"] for p in effect.parameters}
            carriage_m = effect.carriages_m(values, carriage_m)
            error = error + effect.wake_offset_m(values, motion, setting)
    return np.asarray(error + flight.x_m - carriage_m)
