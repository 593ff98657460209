"""The 2D downwash simulator: two planar multicopters, one flying through the other's wake.

In: a seed and what is hidden. Out: flights in the paper's wake field in which the source's motors
spool, and a baseline whose source follows its commands at once. The sufferer flies closed loop
(`wakedeploy.physics.body`); the field is computed anew for every hypothesis along the way that it
was seen to fly.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import FloatArray, Free
from wakedeploy.gap.progress import Progress
from wakedeploy.gap.search.comparison import Record
from wakedeploy.gap.systems.domains.domain import GapDomain
from wakedeploy.gap.systems.likelihood.response import ResponseModel, Values, covariance
from wakedeploy.physics.body import PlanarBody
from wakedeploy.physics.field import FieldGrid, FieldPhysics, WakeField
from wakedeploy.physics.field_grid import drag_force_n
from wakedeploy.physics.rail import GRAVITY_MPS2

DT_S = 0.04
SECONDS = 10.0
SEPARATIONS_M = (1.4, 2.4)  # two, which tell a slow wake from a slow motor
HIDDEN: Mapping[str, float] = {"spool-lag.tau_up_s": 0.08, "spool-lag.tau_down_s": 0.12}

_GRID = FieldGrid(cell_x_m=0.1, cell_z_m=0.1, left_m=-1.35, bottom_m=-3.15, columns=28, rows=40)
# Estimates that give a tenth of the sufferer's weight 2.3 m below a hovering source.
_SPEED_MPS, _DIFFUSIVITY, _DECAY, _WIDTH_M = 6.0, 0.3, 0.3, 0.25
_STRENGTH = 126.0
_HOVER_N, _MASS_KG, _INERTIA, _AREA_M2 = 10.0, 1.0, 0.02, 0.06
_NOISE_N = (0.04, 0.15, 0.03)  # coloured, its time constant [s], white

EFFECTS = {
    "spool-lag": (
        Free("spool-lag.tau_up_s", "s", 0.0, 0.1, 0.0, 1.0, 2e-3, (0.05,)),
        Free("spool-lag.tau_down_s", "s", 0.0, 0.1, 0.0, 1.0, 2e-3, (0.05,)),
    ),
    "command-latency": (
        Free("command-latency.delay_s", "s", 0.0, 0.05, 0.0, 0.4, 2e-3, (0.02, 0.08)),
    ),
    "transport-speed": (
        Free("transport-speed.speed_mps", "m/s", _SPEED_MPS, 1.5, 2.0, 12.0, 2e-2, (5.0,)),
    ),
    "wake-width": (Free("wake-width.width_m", "m", _WIDTH_M, 0.08, 0.1, 0.6, 1e-3, (0.3,)),),
    "wake-decay": (Free("wake-decay.per_s", "1/s", _DECAY, 0.3, 0.0, 3.0, 5e-3, (0.5,)),),
    "crosswind": (Free("crosswind.offset_m", "m", 0.0, 0.1, -0.8, 0.8, 2e-3, (0.05, -0.05)),),
}


@dataclass(frozen=True, eq=False)
class Way:
    """Commands and the way flown in all episodes, (T, E) each."""

    source_n: FloatArray
    x_m: FloatArray
    z_m: FloatArray


class DownwashModel(ResponseModel):
    """The vertical force [N] of the wake on the sufferer, as measured."""

    name = "downwash"
    channels = (("wake force", "N"),)
    noise_start = (_NOISE_N,)
    effects = EFFECTS

    def __init__(self, way: Way, force_n: FloatArray) -> None:
        self.way = way
        time_s = np.asarray(np.arange(len(force_n)) * DT_S, float)
        self.records = [
            Record(f"flight-{e + 1}", time_s, force_n[None, :, e]) for e in range(force_n.shape[1])
        ]
        self._computed = functools.lru_cache(maxsize=24)(self._compute)

    def nuisances(self) -> tuple[Free, ...]:
        """How strong the wake is, as far as it was calibrated."""
        return (Free("wake.strength", "1", 1.0, 0.1, 0.0, 5.0, 2e-3),)

    def response(self, values: Values, episode: int) -> FloatArray:
        """The force (1, n)."""
        field = tuple(sorted((k, v) for k, v in values.items() if not k.startswith("noise.")))
        return self._computed(field)[None, :, episode]

    def coordinates(self, episode: int) -> dict[str, tuple[str, FloatArray]]:
        """The source's command and its slope, and where the sufferer is."""
        command = self.way.source_n[:, episode]
        return {
            "source command": ("N", command),
            "source command's slope": ("N/s", np.gradient(command) / DT_S),
            "sideways": ("m", self.way.x_m[:, episode]),
            "height": ("m", self.way.z_m[:, episode]),
        }

    def _compute(self, values: tuple[tuple[str, float], ...]) -> FloatArray:
        return wake_force_n(self.way, dict(values))


def open_model(path: Path | None) -> DownwashModel:
    """Six flights with a hidden spool lag; UnusableInput for a path: there is nothing to read."""
    if path is not None:
        raise UnusableInput(f"{path}: downwash flies its own simulation; leave the path out.")
    return fly(HIDDEN)


def further(model: DownwashModel, progress: Progress) -> dict[str, Any]:
    """What had been hidden; revealed after everything else is settled."""
    return {"hidden": dict(HIDDEN)}


def fly(hidden: Values, *, flights: int = 6, seed: int = 0) -> DownwashModel:
    """Flights of 10 s, at two separations, in a world with the hidden values."""
    rng = np.random.default_rng(seed)
    steps = round(SECONDS / DT_S)
    source_n = _commands(rng, steps, flights)
    wanted_z = -np.resize(SEPARATIONS_M, flights)
    phase = rng.uniform(0.0, 2.0 * np.pi, flights)
    world = _World(flights, hidden)
    body = PlanarBody(_MASS_KG, _INERTIA)
    state = np.zeros((flights, 6))
    state[:, 0], state[:, 1] = 0.15 * np.sin(phase), wanted_z
    way = Way(source_n, np.empty((steps, flights)), np.empty((steps, flights)))
    force_n = np.empty((steps, flights))
    for k in range(steps):
        way.x_m[k], way.z_m[k] = state[:, 0], state[:, 1]
        force = world.step(source_n[k], state[:, 0], state[:, 1])
        force_n[k] = force[:, 1]
        wanted_x = 0.15 * np.sin(phase + 0.9 * k * DT_S)
        state = body.step(state, *_controlled(state, wanted_x, wanted_z), force, DT_S)
    model = DownwashModel(way, force_n)
    return _noisy(model, rng)


def wake_force_n(way: Way, values: Values) -> FloatArray:
    """Vertical force (T, E) [N] on a sufferer that flies `way`, by the field of a hypothesis."""
    world = _World(way.source_n.shape[1], values)
    rows = zip(way.source_n, way.x_m, way.z_m, strict=True)
    return np.array([world.step(*row)[:, 1] for row in rows])


class _World:
    """Source motors and wake field of all flights, in lockstep."""

    def __init__(self, flights: int, values: Values) -> None:
        self._values = values
        physics = FieldPhysics(
            speed_mps=values.get("transport-speed.speed_mps", _SPEED_MPS),
            diffusivity_m2ps=_DIFFUSIVITY,
            decay_per_s=values.get("wake-decay.per_s", _DECAY),
            strength=_STRENGTH * max(values.get("wake.strength", 1.0), 0.0) ** 0.5,
            width_m=values.get("wake-width.width_m", _WIDTH_M),
            reference_thrust_n=_HOVER_N,
        )
        self._field = WakeField(_GRID, physics, dt_s=DT_S, episodes=flights)
        self._thrust = np.full(flights, _HOVER_N)
        self._commands: list[FloatArray] = []

    def step(self, command_n: FloatArray, x_m: FloatArray, z_m: FloatArray) -> FloatArray:
        """Force (E, 2) [N] on sufferers at a place, after one more step of the commands."""
        self._commands.append(command_n)
        late = self._late()
        self._thrust = self._spooled(late)
        # A puff sinks for the whole step in which it is pushed, its air for half of it.
        above_m = 0.5 * DT_S * self._values.get("transport-speed.speed_mps", _SPEED_MPS)
        aside_m = self._values.get("crosswind.offset_m", 0.0)
        self._field.step(aside_m, above_m, 0.0, self._thrust)
        return drag_force_n(self._field.velocity(x_m, z_m), _AREA_M2)

    def _late(self) -> FloatArray:
        behind = self._values.get("command-latency.delay_s", 0.0) / DT_S
        whole = int(behind)
        newest, older = (
            self._commands[max(len(self._commands) - 1 - whole - k, 0)] for k in (0, 1)
        )
        return newest + (behind - whole) * (older - newest)

    def _spooled(self, wanted_n: FloatArray) -> FloatArray:
        up, down = (self._values.get(f"spool-lag.tau_{k}_s", 0.0) for k in ("up", "down"))
        tau_s = np.where(wanted_n > self._thrust, up, down)
        kept = np.exp(-DT_S / np.maximum(tau_s, 1e-6))
        return np.asarray(wanted_n + (self._thrust - wanted_n) * kept)


def _commands(rng: np.random.Generator, steps: int, flights: int) -> FloatArray:
    """Source thrust (T, E): hover, stepped by up to a third every half to whole second."""
    commands = np.full((steps, flights), _HOVER_N)
    for e in range(flights):
        at = 25
        while at < steps:
            commands[at:, e] = _HOVER_N * (1.0 + rng.uniform(-0.3, 0.3))
            at += int(rng.integers(12, 25))
    return commands


def _controlled(
    state: FloatArray, wanted_x: FloatArray, wanted_z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Thrust and torque (E,) of a cascade: place → pitch → torque."""
    x, z, pitch, vx, vz, rate = state.T
    thrust = _MASS_KG * (GRAVITY_MPS2 + 25.0 * (wanted_z - z) - 8.0 * vz)
    wanted_pitch = np.clip(-(4.0 * (wanted_x - x) - 3.0 * vx) / GRAVITY_MPS2, -0.4, 0.4)
    torque = _INERTIA * (40.0 * (wanted_pitch - pitch) - 12.0 * rate)
    return np.maximum(thrust, 0.0), torque


def _noisy(model: DownwashModel, rng: np.random.Generator) -> DownwashModel:
    """The flights with the noise of the force measurement, whatever moved the bodies."""
    noise = np.log(_NOISE_N)
    records = []
    for record in model.records:
        factor = np.linalg.cholesky(covariance(tuple(noise), record.time_s))
        noisy = record.measured + factor @ rng.standard_normal(len(factor))
        records.append(Record(record.name, record.time_s, noisy))
    model.records = records
    return model


GAP_DOMAIN = GapDomain(open_model, further, is_simulated=True)
