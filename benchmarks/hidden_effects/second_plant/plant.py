"""The second plant as the electronics see it: pulse widths and carriage speed in, readings out."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .constants import Constants, Curve
from .integrator import advance
from .jet import calibrated_jet
from .motion import ROTOR, SOURCE, SPEED, STATES, Inputs, Z, driving_force

FloatArray = npt.NDArray[np.float64]


class Sample(NamedTuple):
    """One reading: range [m] (NaN while there is none), when it was taken [s], 0 for a good one."""

    range_m: float
    sensor_time_s: float
    status: int


class SecondPlant:
    """A gantry written from equations alone, deterministic by seed; SI units and µs.

    `step` holds its inputs over `dt_s`; inside, time is continuous: the servo's frames fall where
    they fall, and the integrator keeps its error below `tolerance`.
    """

    dt_s = 1.0 / 256.0
    _RING = 1024  # samples of the source's past, four seconds

    def __init__(self, constants: Constants, *, seed: int, tolerance: float = 1e-6) -> None:
        self._c, self._tolerance = constants, tolerance
        self._jet = calibrated_jet(constants.wake)
        self._ground = np.array([constants.ground_height_m, constants.ground_factor])
        chances = np.random.SeedSequence([seed, 77]).spawn(3)
        self._sensing, self._air, timing = (np.random.default_rng(s) for s in chances)
        self._state: FloatArray = np.zeros(STATES)
        self._history: FloatArray = np.zeros(self._RING)
        self._count = self.integrator_steps = 0
        self._gust = float(self._air.standard_normal())
        self._next_frame_s = float(timing.uniform(0.0, constants.sensing.frame_s))
        self._next_sample_s = float(timing.uniform(0.0, constants.sensing.period_s))
        self._hold_phase = float(timing.random())  # of the clock that a hold keeps
        self._commands: deque[tuple[float, float, float]] = deque()
        self._waiting: deque[Sample] = deque()
        self._reading = Sample(math.nan, -math.inf, 255)
        self._heights: deque[float] = deque([0.0] * 64, maxlen=64)
        self._made_s, self._value_m = -math.inf, math.nan
        self._held = [constants.idle_us, constants.idle_us]
        self._targets = [0.0, 0.0]
        self._took_off_s = math.nan
        self._travelled_m = self._behind_m = 0.0
        self.x_m = self.vx_mps = 0.0
        self.steps = 0
        self.pulse_applied_s = 0.0
        self.source_applied_us = self.sufferer_applied_us = constants.idle_us
        self.wake_force_n = self.hook_force_n = 0.0

    @property
    def t_s(self) -> float:
        """Time since the plant was made [s]."""
        return self._count * self.dt_s

    @property
    def z_m(self) -> float:
        """True height [m]."""
        return float(self._state[Z])

    @property
    def vz_mps(self) -> float:
        """True vertical speed [m/s]."""
        return float(self._state[SPEED])

    @property
    def source_thrust_n(self) -> float:
        """The source's thrust after spool [N]."""
        return float(self._state[SOURCE] ** 2)

    @property
    def sufferer_thrust_n(self) -> float:
        """The sufferer's static thrust after spool [N]."""
        return float(self._state[ROTOR] ** 2)

    def range_sample(self) -> Sample:
        """The newest range reading that the Pi can have by now."""
        return self._reading

    def step(self, source_us: float, sufferer_us: float, carriage_mps: float) -> None:
        """One step of `dt_s`; the MCU's outputs are held over it."""
        carriage_mps = float(carriage_mps)  # one type, one compilation
        start, end = self.t_s, self.t_s + self.dt_s
        self._commands.append((start, source_us, sufferer_us))
        self._move_gust()
        lateral_m = self.x_m - self._c.numbers.lost_steps * self._travelled_m - self._behind_m
        pulled_mps = self._pulled(carriage_mps)
        root = math.sqrt(self.source_thrust_n / self._jet.reference_thrust_n)
        self._history[self._count % self._RING] = root
        now = start
        while now < end - 1e-12:
            if self._next_frame_s <= now + 1e-12:
                self._take_pulses(now)
            until = min(end, self._next_frame_s) if self._c.sensing.frame_s > 0.0 else end
            inputs = self._inputs(now, lateral_m + pulled_mps * (now - start), pulled_mps)
            self._advance(now, until, inputs)
            now = until
        self._tell(inputs, end)
        self.vx_mps = carriage_mps
        self.x_m += carriage_mps * self.dt_s
        self._travelled_m += abs(carriage_mps) * self.dt_s
        self._count += 1
        self._heights.append(self.z_m)
        self.steps = math.floor(self.x_m * self._c.sensing.steps_per_m + 1e-6)
        self._sense(end)

    def _inputs(self, now_s: float, lateral_m: float, pulled_mps: float) -> Inputs:
        gust = self._c.sensing.turbulence_fraction * self._gust
        return Inputs(
            now_s,
            lateral_m,
            pulled_mps,
            self._targets[0],
            self._targets[1],
            gust,
            self._count,
            self.dt_s,
        )

    def _advance(self, now_s: float, until_s: float, inputs: Inputs) -> None:
        self.integrator_steps += advance(
            self._state,
            now_s,
            until_s,
            self._tolerance,
            self._c.numbers,
            self._jet,
            inputs,
            self._history,
            self._ground,
        )

    def _tell(self, inputs: Inputs, t_s: float) -> None:
        """Keep the truth that logs may show: the wake's force and the hidden one."""
        _, self.wake_force_n, self.hook_force_n, _ = driving_force(
            t_s, self._state, self._c.numbers, self._jet, inputs, self._history, self._ground
        )
        if math.isnan(self._took_off_s) and self.z_m > 0.0:
            self._took_off_s = t_s

    def _take_pulses(self, now_s: float) -> None:
        """A servo frame starts: the ESCs take over what the MCU gave `command_delay_s` ago."""
        sensing = self._c.sensing
        self._next_frame_s += sensing.frame_s
        ready_s = now_s - sensing.command_delay_s + 1e-12
        while len(self._commands) > 1 and self._commands[1][0] <= ready_s:
            self._commands.popleft()
        given_s, *pulses = self._commands[0]
        if given_s > ready_s:
            return
        for motor, (pulse, curve) in enumerate(
            zip(pulses, (self._c.source, self._c.sufferer), strict=True)
        ):
            self._held[motor] = self._taken_over(pulse, self._held[motor])
            self._targets[motor] = math.sqrt(self._thrust(curve, self._held[motor]))
        newest = self._commands[-1]
        self.source_applied_us, self.sufferer_applied_us = newest[1], newest[2]
        self.pulse_applied_s = now_s

    def _taken_over(self, pulse_us: float, held_us: float) -> float:
        """What an ESC makes of a pulse: steps of `quantum_us`, changes within the dead band not."""
        sensing = self._c.sensing
        if sensing.quantum_us > 0.0:
            idle = self._c.idle_us
            pulse_us = idle + sensing.quantum_us * round((pulse_us - idle) / sensing.quantum_us)
        return held_us if abs(pulse_us - held_us) < sensing.dead_band_us else pulse_us

    def _thrust(self, curve: Curve, pulse_us: float) -> float:
        hover = self._c.numbers.mass_kg * self._c.numbers.gravity_mps2
        static = float(np.interp(pulse_us, curve.pulse_us, curve.thrust_n))
        return float(curve.scale * hover * (max(static, 0.0) / hover) ** curve.exponent)

    def _pulled(self, carriage_mps: float) -> float:
        """The carriage's own speed [m/s] over a step: a belt with play first moves without it."""
        slack_m, way_m = 0.5 * self._c.numbers.backlash_m, carriage_mps * self.dt_s
        behind_m = min(max(self._behind_m + way_m, -slack_m), slack_m)
        pulled_m = way_m - (behind_m - self._behind_m)
        self._behind_m = behind_m
        return pulled_m / self.dt_s

    def _move_gust(self) -> None:
        keep = math.exp(-self.dt_s / self._c.sensing.turbulence_time_s)
        kick = math.sqrt(1.0 - keep * keep)
        self._gust = keep * self._gust + kick * float(self._air.standard_normal())

    def _sense(self, now_s: float) -> None:
        """Samples that fell due within the step, and what can be read by now."""
        sensing = self._c.sensing
        while self._next_sample_s <= now_s:
            taken_s = self._next_sample_s
            self._next_sample_s += sensing.period_s
            made_s = taken_s
            if sensing.hold_s > 0.0:  # the sensor makes readings at a pace of its own
                phase_s = self._hold_phase * sensing.hold_s
                made_s = phase_s + sensing.hold_s * math.floor((taken_s - phase_s) / sensing.hold_s)
            if made_s > self._made_s:
                self._made_s = made_s
                self._value_m = self._measured(self._height_at(made_s - sensing.stale_s), made_s)
            self._waiting.append(Sample(self._value_m, taken_s, 0))
        while self._waiting and self._waiting[0].sensor_time_s + sensing.delay_s <= now_s + 1e-9:
            self._reading = self._waiting.popleft()

    def _height_at(self, t_s: float) -> float:
        """The true height at a time within the last tenth of a second."""
        back = (self.t_s - t_s) / self.dt_s  # steps ago
        whole = min(int(back), len(self._heights) - 2)
        share = back - whole
        newer, older = self._heights[-1 - whole], self._heights[-2 - whole]
        return newer + share * (older - newer)

    def _measured(self, z_m: float, t_s: float) -> float:
        s = self._c.sensing
        flown = t_s - self._took_off_s if math.isfinite(self._took_off_s) else 0.0
        reading_m = s.scale * z_m + s.bias_m + s.drift_mps * flown
        reading_m += s.noise_m * float(self._sensing.standard_normal())
        stray, size = self._sensing.random(), self._sensing.uniform(-1.0, 1.0)
        if stray < s.outlier_probability:
            reading_m += s.outlier_size_m * size
        if s.resolution_m > 0.0:
            reading_m = s.resolution_m * round(reading_m / s.resolution_m)
        return max(0.0, reading_m)
