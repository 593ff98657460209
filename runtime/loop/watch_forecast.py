"""What a rig file says the sufferer should feel, and how its calibration could change it.

Pulses become thrust and wake, together with what each uncertain constant would add. In: the
commands as they were sent, and the frames that the board reports. Out: one `Forces` per step of
1/64 s. Each takes the same number of operations, so that it runs beside the loop on a Pi.
"""

import functools
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.rig import Rig
from wakedeploy.core.rig_sections import SpoolLag, Wake
from wakedeploy.physics.constants import NEUTRAL, Constants, moved_thrust
from wakedeploy.physics.effects.acting import ActingEffects
from wakedeploy.physics.effects.chain import Chain, believed, unplaced_constants
from wakedeploy.physics.jet import PuffTable, drag_force, paces
from wakedeploy.physics.motor import mean_thrust, spooled
from wakedeploy.physics.rail import GRAVITY_MPS2

FloatArray = npt.NDArray[np.float64]

STEP_S = 1.0 / 64.0
_SMALL_N = 1e-3  # a thrust's logarithm says nothing below this
_OF_WAKE = ("speed_mps", "strength", "width_m", "diffusivity_m2ps", "decay_per_s")


@dataclass(frozen=True)
class Model:
    """A rig's effects, and the constants that are in no section of it."""

    chain: Chain
    constants: Constants

    @classmethod
    def of(cls, rig: Rig) -> "tuple[Rig, Model]":
        """The rig with its effects' constants in place, and what is left of its effects."""
        plain = believed(rig)
        return plain, cls(Chain.of(plain), NEUTRAL | unplaced_constants(rig))


@dataclass(frozen=True, slots=True)
class Segment:
    """A span [s] over which both ESCs hold their pulses [µs]."""

    span_s: float
    source_us: float
    sufferer_us: float


class PulsePath:
    """Commands on their way to the ESCs: the wire, the MCU's slew, the servo frame."""

    def __init__(self, rig: Rig, model: "Model") -> None:
        self._delay_s = 0.5 * rig.latency.round_trip_s + model.constants["command.delay_s"]
        self._chain = model.chain
        self._slew = rig.limits.slew_us_per_s
        self._frame_s = rig.disturbance.esc_frame_s or STEP_S
        self._phased = rig.disturbance.esc_frame_s > 0.0
        self._idle_us = idle_us = rig.limits.pulse_us[0]
        self._target = self._output = self._held = (idle_us, idle_us)
        self._output_s = 0.0
        self._next_frame_s = 0.0
        self._under_way: deque[tuple[float, tuple[float, float]]] = deque()

    def sent(self, t_s: float, source_us: float, sufferer_us: float) -> None:
        """A command left at `t_s`; it arrives half a round trip later."""
        self._under_way.append((t_s + self._delay_s, (source_us, sufferer_us)))

    def frame_seen(self, applied_s: float) -> None:
        """The board put a pulse out at `applied_s`; its other frames keep that phase."""
        if self._phased:
            periods = math.ceil((self._next_frame_s - applied_s) / self._frame_s - 0.5)
            self._next_frame_s = applied_s + periods * self._frame_s

    def advance(self, from_s: float, to_s: float) -> list[Segment]:
        """What the ESCs hold between two times [s]; time only goes forward."""
        segments: list[Segment] = []
        now_s = from_s
        self._next_frame_s = max(self._next_frame_s, from_s)
        while self._next_frame_s < to_s:
            if self._next_frame_s > now_s:
                segments.append(Segment(self._next_frame_s - now_s, *self._held))
                now_s = self._next_frame_s
            self._move_to(now_s)
            self._held = self._accepted()
            self._next_frame_s += self._frame_s
        segments.append(Segment(to_s - now_s, *self._held))
        return segments

    def _accepted(self) -> tuple[float, float]:
        """What the ESCs make of the outputs."""
        if not self._chain.acts_on("pulse_us"):
            return self._output
        source, sufferer = (
            self._chain.pulse_us(output, held, motor, self._idle_us)
            for output, held, motor in zip(
                self._output, self._held, ("source", "sufferer"), strict=True
            )
        )
        return source, sufferer

    def _move_to(self, t_s: float) -> None:
        """The MCU's outputs at `t_s`: towards the newest command, no faster than the slew."""
        while self._under_way and self._under_way[0][0] <= t_s:
            arrived_s, target = self._under_way.popleft()
            self._slewed(max(arrived_s, self._output_s))
            self._target = target
        self._slewed(t_s)

    def _slewed(self, t_s: float) -> None:
        most = self._slew * (t_s - self._output_s)
        source, sufferer = (
            min(max(goal, now - most), now + most)
            for goal, now in zip(self._target, self._output, strict=True)
        )
        self._output, self._output_s = (source, sufferer), t_s


class Rotors:
    """One motor, run side by side with each of its spool lags changed by one spread."""

    def __init__(self, rig: Rig, motor: str, spreads: Mapping[str, float]) -> None:
        self._curve = getattr(rig.thrust, motor)
        lag: SpoolLag = getattr(rig.spool, motor)
        self.names: list[str] = []
        self._lags = [lag]
        for which in ("up_s", "down_s"):
            name = f"spool.{motor}.{which}"
            if name in spreads:
                self.names.append(name)
                moved = {which: min(getattr(lag, which) + spreads[name], 2.0)}
                self._lags.append(lag.model_copy(update=moved))
        self._speeds = [0.0] * len(self._lags)

    def advance(self, spans: list[tuple[float, float]]) -> list[float]:
        """Mean thrusts [N] over (span [s], pulse [µs]) pairs: the rig's, then per moved lag."""
        totals, whole_s = [0.0] * len(self._lags), 0.0
        for span_s, pulse_us in spans:
            target = math.sqrt(self._curve.thrust(pulse_us))
            whole_s += span_s
            for i, lag in enumerate(self._lags):
                speed = self._speeds[i]
                after = spooled(speed, target, lag, span_s)
                totals[i] += span_s * mean_thrust(speed, after, lag)
                self._speeds[i] = after
        return [total / whole_s for total in totals]


class WakeForecast:
    """The jet's speed at the sufferer, side by side for each changed constant of the wake.

    One history of √thrust per changed source, one table of puffs per changed wake.
    """

    def __init__(self, rig: Rig, spreads: Mapping[str, float], histories: int) -> None:
        self._height_m = rig.source.height_m
        self._reference_n = rig.wake.reference_thrust_n
        self.names = [f"wake.{n}" for n in _OF_WAKE if f"wake.{n}" in spreads]
        wakes = [rig.wake]
        for name in self.names:
            leaf = name.removeprefix("wake.")
            moved = getattr(rig.wake, leaf) + spreads[name]
            wakes.append(rig.wake.model_copy(update={leaf: moved}))
        tables = [_table(wake, rig.source.height_m) for wake in wakes]
        length = max(len(table.ages_s) for table in tables)
        self._amplitude = np.stack([_padded(t.amplitude_mps, length) for t in tables])  # (W, M)
        self._narrow = np.stack([_padded(t.inverse_2width2, length) for t in tables])
        self._sunk = np.stack([_padded(t.sunk_m, length) for t in tables])
        self._length, self._newest = length, 0
        self._speed_exponent = rig.wake.speed_exponent
        self._roots = np.zeros((histories, 2 * length))  # a ring written twice: always a plain view

    def inject(self, thrusts_n: list[float]) -> None:
        """Add the puff of one step for every history's thrust [N]."""
        roots = [math.sqrt(max(n, 0.0) / self._reference_n) for n in thrusts_n]
        self._newest = (self._newest - 1) % self._length
        self._roots[:, self._newest] = roots
        self._roots[:, self._newest + self._length] = roots

    def velocities(self, x_m: float, z_m: float) -> tuple[list[float], list[float]]:
        """Vertical speeds [m/s]: (per changed wake, nominal first; per history, nominal first)."""
        roots = self._roots[:, self._newest : self._newest + self._length]  # (H, M)
        sunk = self._sunk
        if self._speed_exponent:
            sunk = sunk * paces(roots[0], self._speed_exponent)
        distance2 = x_m * x_m + (z_m - self._height_m + sunk) ** 2
        puffs = self._amplitude * np.exp(-distance2 * self._narrow)  # (W, M)
        by_wake, by_source = -(puffs @ roots[0]), -(roots @ puffs[0])
        return by_wake.tolist(), by_source.tolist()


@dataclass(frozen=True, slots=True)
class Forces:
    """Mean forces [N] over a step and their change [N] per spread of each constant (P,).

    `other_n` is what the rig's effects add, `added_kg` what they add to the inertia.
    """

    thrust_n: float
    wake_n: float
    change_n: FloatArray
    other_n: float = 0.0
    added_kg: float = 0.0


@dataclass(frozen=True, slots=True)
class Place:
    """Where the sufferer is over a step, and how fast [SI]."""

    x_m: float
    vx_mps: float
    z_m: float
    vz_mps: float


class ForceForecast:
    """Forces on the sufferer, step by step, as the rig file explains them."""

    def __init__(self, rig: Rig, model: Model, spreads: Mapping[str, float]) -> None:
        self._spreads = dict(spreads)
        self._effects = ActingEffects(model.chain, rig, STEP_S)
        self._hover_n = rig.sufferer.mass_kg * GRAVITY_MPS2
        self._force = functools.partial(drag_force, rig.wake, 0.0)
        self._path = PulsePath(rig, model)
        self._source = Rotors(rig, "source", spreads)
        self._sufferer = Rotors(rig, "sufferer", spreads)
        self._bends_source = "thrust.source.exponent" in spreads
        histories = 1 + len(self._source.names) + int(self._bends_source)
        self._wake = WakeForecast(rig, spreads, histories)
        self._last_thrust_n = 0.0
        self.names = self._ordered_names()

    def _ordered_names(self) -> tuple[str, ...]:
        """The constants whose change is forecast, in the order of `Forces.change_n`."""
        bent = ["thrust.source.exponent"] if self._bends_source else []
        plain = [n for n in _THRUST_CHANGES if n in self._spreads]
        scale = [n for n in ("thrust.source.scale",) if n in self._spreads]
        source = (*self._source.names, *bent, *scale)
        return (*plain, *self._sufferer.names, *self._wake.names, *source)

    def sent(self, t_s: float, source_us: float, sufferer_us: float) -> None:
        """Take in a command that left at `t_s` [s]."""
        self._path.sent(t_s, source_us, sufferer_us)

    def frame_seen(self, applied_s: float) -> None:
        """Take in a frame that the board reported at `applied_s` [s]."""
        self._path.frame_seen(applied_s)

    def advance(self, from_s: float, place: Place) -> Forces:
        """The forces of one step from `from_s` on, with the sufferer at this place."""
        segments = self._path.advance(from_s, from_s + STEP_S)
        thrusts = self._sufferer.advance([(s.span_s, s.sufferer_us) for s in segments])
        sources = self._source.advance([(s.span_s, s.source_us) for s in segments])
        effects, base_n = self._effects, sources[0]
        effects.look(from_s, place.x_m, place.vx_mps, place.z_m, place.vz_mps)
        if self._bends_source:
            sources.append(self._bent(base_n, "thrust.source.exponent"))
        sources = _scaled(sources, effects.source_n(from_s, base_n, thrusts[0]))
        self._wake.inject(sources)
        by_wake, by_source = self._wake.velocities(effects.wake_x_m(place.x_m), place.z_m)
        air_mps = effects.wake_mps(by_wake[0])
        wake_n = self._force(air_mps)
        thrust_n, other_n, added_kg = effects.push(wake_n)
        thrusts = _scaled(thrusts, thrust_n)
        changes = self._of_thrust(thrusts)
        changes += [self._force(v) - wake_n for v in _scaled(by_wake, air_mps)[1:]]
        changes += [self._force(v) - wake_n for v in _scaled(by_source, air_mps)[1:]]
        if "thrust.source.scale" in self._spreads:
            changes.append(self._spreads["thrust.source.scale"] * wake_n)
        self._last_thrust_n = thrust_n
        effects.travel(place.vx_mps)
        return Forces(thrust_n, wake_n, np.array(changes), other_n, added_kg)

    def range_m(self, range_m: float) -> float:
        """The sensor's reading [m] of `range_m` under the rig's effects."""
        return self._effects.range_m(range_m)

    def _of_thrust(self, thrusts: list[float]) -> list[float]:
        slope = (thrusts[0] - self._last_thrust_n) / STEP_S
        known = {name: change(thrusts[0], slope, self._hover_n) for name, change in _CHANGES}
        plain = [self._spreads[n] * known[n] for n in _THRUST_CHANGES if n in self._spreads]
        return plain + [n - thrusts[0] for n in thrusts[1:]]

    def _bent(self, thrust_n: float, name: str) -> float:
        """A thrust [N] with its curve's exponent moved by one spread; hover stays."""
        return float(moved_thrust(thrust_n, 1.0, 1.0 + self._spreads[name], self._hover_n))


def _scaled(values: list[float], after: float) -> list[float]:
    """A quantity's variants, all scaled by the share that makes the first one `after`."""
    before = values[0]
    if after == before:
        return values
    return [value * after / before if before else after for value in values]


def _log_thrust(thrust_n: float, slope: float, hover_n: float) -> float:
    return thrust_n * math.log(max(thrust_n, _SMALL_N) / hover_n)


Change = Callable[[float, float, float], float]
_CHANGES: tuple[tuple[str, Change], ...] = (
    ("thrust.sufferer.scale", lambda thrust_n, slope, hover_n: thrust_n),
    ("thrust.sufferer.exponent", _log_thrust),
    ("command.delay_s", lambda thrust_n, slope, hover_n: -slope),
)
_THRUST_CHANGES = tuple(name for name, _ in _CHANGES)


def _table(wake: Wake, height_m: float) -> PuffTable:
    return PuffTable(wake, STEP_S, height_m, 0.5 * STEP_S)


def _padded(values: npt.NDArray[Any], length: int) -> FloatArray:
    return np.pad(values, (0, length - len(values)))
