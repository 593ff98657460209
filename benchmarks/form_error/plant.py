"""The gantry as the electronics see it: pulse widths and carriage speed in, readings out.

In: `Build`, seed. Out: what a loop asks of a plant. Imports nothing of the project.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .equations import OTHER_N, ROTOR, SOURCE, SPEED, STATES, WAKE_N, Numbers, Z, advance
from .profiles import FloatArray, Jet

_LONGEST_S = 60.0


class Sample(NamedTuple):
    """A reading: range [m] (NaN before the first), the time it is stamped with [s], status."""

    range_m: float
    sensor_time_s: float
    status: int


@dataclass(frozen=True)
class Electronics:
    """Servo frame, range sensor and the air's unrest. SI units, pulse widths in µs."""

    frame_s: float = 0.02
    command_delay_s: float = 0.0
    period_s: float = 0.02
    noise_m: float = 0.004
    noise_per_m: float = 0.0  # grows with height
    resolution_m: float = 0.001
    bias_m: float = 0.0
    scale: float = 1.0
    stale_s: float = 0.0
    window_s: float = 0.0  # over which a reading averages the height
    stamp_jitter_s: float = 0.0  # of the bus: a stamp is late by so much (exponential)
    delay_s: float = 0.009
    outlier_probability: float = 0.005
    outlier_size_m: float = 0.15
    turbulence_fraction: float = 0.04
    turbulence_time_s: float = 0.08
    bursts: float = 0.0  # how much the turbulence's strength itself comes and goes
    steps_per_m: float = 4200.0
    idle_us: float = 1000.0


@dataclass(frozen=True, eq=False)
class Build:
    """One gantry: numbers, electronics, jet, and both motors' curves (µs, N)."""

    numbers: Numbers
    electronics: Electronics
    jet: Jet
    source: tuple[FloatArray, FloatArray]
    sufferer: tuple[FloatArray, FloatArray]


class FormPlant:
    """A gantry of another form, deterministic by seed."""

    dt_s = 1.0 / 256.0
    _RING = 1024

    def __init__(self, build: Build, *, seed: int) -> None:
        self._b, self._e = build, build.electronics
        chances = [np.random.default_rng(s) for s in np.random.SeedSequence([seed, 91]).spawn(3)]
        steps = round(_LONGEST_S / self.dt_s)
        self._gusts = _gusts(self._e, chances[0], steps, self.dt_s)
        self._chance = chances[1]
        self._next_frame_s = float(chances[2].uniform(0.0, self._e.frame_s))
        self._next_sample_s = float(chances[2].uniform(0.0, self._e.period_s))
        self._y, self._ring = np.zeros(STATES), np.zeros(self._RING)
        self._targets = np.zeros(2)
        self._commands: deque[tuple[float, float, float]] = deque()
        self._waiting: deque[tuple[float, Sample]] = deque()
        self._reading = Sample(math.nan, -math.inf, 255)
        self._heights: deque[float] = deque([0.0] * 64, maxlen=64)
        self._count = self.steps = 0
        self.x_m = self.vx_mps = self.pulse_applied_s = 0.0
        self.source_applied_us = self.sufferer_applied_us = self._e.idle_us

    @property
    def t_s(self) -> float:
        """Time since the plant was made [s]."""
        return self._count * self.dt_s

    @property
    def z_m(self) -> float:
        """True height [m]."""
        return float(self._y[Z])

    @property
    def vz_mps(self) -> float:
        """True vertical speed [m/s]."""
        return float(self._y[SPEED])

    @property
    def source_thrust_n(self) -> float:
        """The source's thrust [N]."""
        return float(self._y[SOURCE] ** 2)

    @property
    def sufferer_thrust_n(self) -> float:
        """The sufferer's static thrust [N]."""
        return float(self._y[ROTOR] ** 2)

    @property
    def wake_force_n(self) -> float:
        """The wake's force [N], up positive."""
        return float(self._y[WAKE_N])

    @property
    def hook_force_n(self) -> float:
        """What effects add to the forces of a plain gantry [N]."""
        return float(self._y[OTHER_N])

    def range_sample(self) -> Sample:
        """The newest reading that the Pi can have by now."""
        return self._reading

    def step(self, source_us: float, sufferer_us: float, carriage_mps: float) -> None:
        """One step of `dt_s`; what the MCU puts out is held over it."""
        start, carriage_mps = self.t_s, float(carriage_mps)
        self._commands.append((start, source_us, sufferer_us))
        self._take_pulses(start)
        root = math.sqrt(self.source_thrust_n / self._b.numbers.reference_thrust_n)
        self._ring[self._count % self._RING] = root
        jet = self._b.jet
        advance(
            self._y, self.dt_s, self._b.numbers, self._targets, self.x_m, carriage_mps,
            float(self._gusts[self._count % len(self._gusts)]), self._ring, self._count,
            jet.speed_mps, jet.delay_s, jet.mixing_s,
        )  # fmt: skip
        self._count += 1
        self.vx_mps = carriage_mps
        self.x_m += carriage_mps * self.dt_s
        self.steps = math.floor(self.x_m * self._e.steps_per_m + 1e-6)
        self._heights.append(self.z_m)
        self._sense(self.t_s)

    def _take_pulses(self, now_s: float) -> None:
        """A servo frame that begins within the step takes what was given by then."""
        if self._next_frame_s > now_s + self.dt_s:
            return
        frame_s = self._next_frame_s
        self._next_frame_s += self._e.frame_s
        ready_s = frame_s - self._e.command_delay_s
        while len(self._commands) > 1 and self._commands[1][0] <= ready_s:
            self._commands.popleft()
        given_s, *pulses = self._commands[0]
        if given_s > ready_s:
            return
        curves = (self._b.source, self._b.sufferer)
        thrusts = [np.interp(p, *curve) for p, curve in zip(pulses, curves, strict=True)]
        self._targets = np.sqrt(np.maximum(np.array(thrusts), 0.0))
        self.source_applied_us, self.sufferer_applied_us = pulses
        self.pulse_applied_s = frame_s

    def _sense(self, now_s: float) -> None:
        e = self._e
        while self._next_sample_s <= now_s:
            taken_s = self._next_sample_s
            self._next_sample_s += e.period_s
            stamp_s = taken_s + float(self._chance.exponential(e.stamp_jitter_s or 1e-9))
            sample = Sample(self._measured(taken_s - e.stale_s), stamp_s, 0)
            self._waiting.append((stamp_s + e.delay_s, sample))
        while self._waiting and self._waiting[0][0] <= now_s + 1e-9:
            self._reading = self._waiting.popleft()[1]

    def _measured(self, t_s: float) -> float:
        e = self._e
        shares = (np.arange(5) - 2.0) / 5.0 if e.window_s > 0.0 else np.zeros(1)
        z_m = float(
            np.mean([self._height_at(t_s - 0.5 * e.window_s + e.window_s * s) for s in shares])
        )
        reading_m = e.scale * z_m + e.bias_m
        reading_m += (e.noise_m + e.noise_per_m * z_m) * float(self._chance.standard_normal())
        stray, size = self._chance.random(), self._chance.uniform(-1.0, 1.0)
        if stray < e.outlier_probability:
            reading_m += e.outlier_size_m * size
        if e.resolution_m > 0.0:
            reading_m = e.resolution_m * round(reading_m / e.resolution_m)
        return max(0.0, reading_m)

    def _height_at(self, t_s: float) -> float:
        back = max((self.t_s - t_s) / self.dt_s, 0.0)
        whole = min(int(back), len(self._heights) - 2)
        share = back - whole
        newer, older = self._heights[-1 - whole], self._heights[-2 - whole]
        return newer + share * (older - newer)


def _gusts(e: Electronics, chance: np.random.Generator, steps: int, dt_s: float) -> FloatArray:
    """The wake's relative unrest (S,): Ornstein–Uhlenbeck, its strength constant or in bursts."""
    gust = e.turbulence_fraction * _coloured(chance, steps, e.turbulence_time_s, dt_s)
    if e.bursts > 0.0:
        swell = _coloured(chance, steps, 1.0, dt_s)
        gust = gust * np.exp(e.bursts * swell - e.bursts**2)
    return np.asarray(gust)


def _coloured(chance: np.random.Generator, steps: int, time_s: float, dt_s: float) -> FloatArray:
    from scipy.signal import lfilter

    keep = math.exp(-dt_s / time_s)
    kicks = chance.standard_normal(steps) * math.sqrt(1.0 - keep * keep)
    kicks[0] /= math.sqrt(1.0 - keep * keep)
    return np.asarray(lfilter([1.0], [1.0, -keep], kicks))
