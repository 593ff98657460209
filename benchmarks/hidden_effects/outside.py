"""Effects that the library lacks, on both plants, and what the judge needs to measure them.

In: a size in newtons (a share of the voltage for the supply). Out: hooks for the first plant,
numbers for the second, and the same physics as an effect, with which the judge, and nobody else,
measures how strong the hidden effect is.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.signal import lfilter

from wakedeploy.core.rig import Rig
from wakedeploy.physics.effects.base import Effect, Motion, Number, Parameter, Setting, Values

Hooks = dict[str, Callable[..., Any]]

VIBRATION_HZ, DETENT_M, GUST_S = 2.0, 0.09, (8.0, 11.0)
MAST_HZ, MAST_DAMPING = 2.2, 0.08
_GRID_S = 1.0 / 128.0  # of the workflow's flights
_SPOOL_S = 0.06
_PLANT_S = 1.0 / 256.0


@dataclass(frozen=True)
class Outside:
    """One effect that no library knows.

    `unit` is the size at which a calibration of its strength begins; `fields` are the numbers of
    the second plant that the size sets, as multiples of it; `force` is the first plant's.
    """

    name: str
    physics: str
    unit: float
    fields: Mapping[str, float]
    hooks: Callable[[float, Rig], Hooks]
    effect: Effect


class _Force(Effect):
    """Base of the judge's versions: a force of one amplitude."""

    stage = "force"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("size", "N", scale=0.1, low=-10.0, high=10.0),
    )


class _Vibration(_Force):
    name, physics = "vibration", "The frame shakes at 2 Hz."
    parameters = (
        Parameter("size", "N", scale=0.1, low=-10.0, high=10.0),
        Parameter("quadrature", "N", scale=0.1, low=-10.0, high=10.0),
    )

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        turn = 2.0 * np.pi * VIBRATION_HZ * m.time_s
        return p["size"] * np.sin(turn) + p["quadrature"] * np.cos(turn)


class _Detent(_Force):
    name, physics = "detent", "The rail's magnets hold the sufferer at every 9 cm."

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        return p["size"] * np.sin(2.0 * np.pi * m.z_m / DETENT_M)


class _Bend(_Force):
    name, physics = "bent-rail", "A force that grows with the carriage's position."

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        return p["size"] * m.x_m


class _ClimbDrag(_Force):
    name, physics = "climb-drag", "A cable is dragged along in climb alone."

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        return -p["size"] * np.maximum(m.vz_mps, 0.0) ** 2


class _Gust(_Force):
    name, physics = "gust", "A gust comes and goes once in each flight."

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        # Flights take off some 3.5 s after the plant's clock began.
        share = (m.time_s + 3.5 - GUST_S[0]) / (GUST_S[1] - GUST_S[0])
        inside = np.clip(share, 0.0, 1.0)
        return p["size"] * np.sin(np.pi * inside) ** 2


class _Supply(_Force):
    name, physics = "supply-coupling", "The supply dips while the source spools up."
    parameters = (Parameter("size", "1", scale=0.03, low=-1.0, high=1.0),)

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        root = np.sqrt(np.maximum(np.atleast_1d(np.asarray(m.source_n, float)), 0.01))
        surge = _SPOOL_S * np.maximum(np.gradient(root, _GRID_S), 0.0)
        return np.asarray(-2.0 * p["size"] * surge * m.sufferer_n)


class _Mast(_Force):
    name, physics = "mast-resonance", "The source's thrust swings the mast at 2.2 Hz."

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        pull = np.atleast_1d(np.asarray(m.source_n, float)) / 4.41
        swing = np.asarray(lfilter(*_mast_filter(_GRID_S), pull))
        return np.asarray(p["size"] * swing)


def _mast_filter(dt_s: float) -> tuple[list[float], list[float]]:
    """From pull to speed over ω, by the bilinear rule: ω s / (s² + 2 ζ ω s + ω²)."""
    omega, k = 2.0 * math.pi * MAST_HZ, 2.0 / dt_s
    lead = k * k + 2.0 * MAST_DAMPING * omega * k + omega * omega
    b = [omega * k / lead, 0.0, -omega * k / lead]
    middle = 2.0 * (omega * omega - k * k) / lead
    return b, [1.0, middle, (k * k - 2.0 * MAST_DAMPING * omega * k + omega * omega) / lead]


def _vibration(size: float, rig: Rig) -> Hooks:
    return {"force_hook": lambda t, s: size * math.sin(2.0 * math.pi * VIBRATION_HZ * t)}


def _detent(size: float, rig: Rig) -> Hooks:
    return {"force_hook": lambda t, s: size * math.sin(2.0 * math.pi * s["z_m"] / DETENT_M)}


def _bend(size: float, rig: Rig) -> Hooks:
    return {"force_hook": lambda t, s: size * s["x_m"]}


def _climb_drag(size: float, rig: Rig) -> Hooks:
    return {"force_hook": lambda t, s: -size * max(s["vz_mps"], 0.0) ** 2}


def _gust(size: float, rig: Rig) -> Hooks:
    def force(t_s: float, state: Mapping[str, float]) -> float:
        share = (t_s - GUST_S[0]) / (GUST_S[1] - GUST_S[0])
        return size * math.sin(math.pi * share) ** 2 if 0.0 < share < 1.0 else 0.0

    return {"force_hook": force}


def _supply(size: float, rig: Rig) -> Hooks:
    target = [0.0]

    def watch(t_s: float, source_us: float, sufferer_us: float, dt_s: float) -> tuple[float, float]:
        target[0] = math.sqrt(rig.thrust.source.thrust(source_us))
        return source_us, sufferer_us

    def force(t_s: float, state: Mapping[str, float]) -> float:
        surge = max(target[0] - math.sqrt(max(state["source_thrust_n"], 0.0)), 0.0)
        return ((1.0 - size * surge) ** 2 - 1.0) * state["sufferer_thrust_n"]

    return {"command_hook": watch, "force_hook": force}


def _mast(size: float, rig: Rig) -> Hooks:
    (b0, _, b2), (_, a1, a2) = _mast_filter(_PLANT_S)
    past = [0.0, 0.0, 0.0, 0.0]  # pulls and swings one and two steps ago

    def force(t_s: float, state: Mapping[str, float]) -> float:
        pull = state["source_thrust_n"] / rig.wake.reference_thrust_n
        swing = b0 * pull + b2 * past[1] - a1 * past[2] - a2 * past[3]
        past[:] = [pull, past[0], swing, past[2]]
        return size * swing

    return {"force_hook": force}


_ALL = (
    (_Vibration(), 0.1, {"vibration_n": 1.0}, _vibration),
    (_Detent(), 0.1, {"detent_n": 1.0}, _detent),
    (_Bend(), 0.4, {"bend_n_per_m": 1.0}, _bend),
    (_ClimbDrag(), 1.0, {"climb_drag_n_s2_per_m2": 1.0}, _climb_drag),
    (_Gust(), 0.2, {"gust_n": 1.0}, _gust),
    (_Supply(), 0.03, {"coupling": 1.0}, _supply),
    (_Mast(), 0.1, {"mast_n": 1.0}, _mast),
)
OUTSIDE: Mapping[str, Outside] = {
    effect.name: Outside(effect.name, effect.physics, unit, fields, hooks, effect)
    for effect, unit, fields, hooks in _ALL
}
