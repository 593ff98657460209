"""The gantry plant: pulse widths and carriage speed in, motion and readings out.

Advanced in constant inner steps. The four hooks stand where an effect can hide: commands on their
way to the ESCs, a force on the sufferer, readings on their way out, and the wake field itself. Each
is called once per inner step, in order of time, and its result held over the step.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from wakedeploy.errors import UnusableInput
from wakedeploy.physics.jet import VerticalJet, drag_force
from wakedeploy.physics.motor import EscFrame, Motor
from wakedeploy.physics.rail import RailBody
from wakedeploy.physics.range_sensor import RangeSample, RangeSensorModel
from wakedeploy.physics.turbulence import OrnsteinUhlenbeck
from wakedeploy.rig import Rig

INNER_RATE_HZ = 256.0

CommandHook = Callable[[float, float, float, float], tuple[float, float]]
ForceHook = Callable[[float, Mapping[str, float]], float]
SensorHook = Callable[[float, float, int], tuple[float, int]]
WakeHook = Callable[[float, float, float, float], tuple[float, float]]


class GantryPlant:
    """The simulated rig between the MCU's outputs and the sensors, deterministic by seed.

    All quantities in SI units, pulse widths in µs. `steps` and `range_sample()` are what the
    electronics report; the other attributes are the truth.
    """

    dt_s = 1.0 / INNER_RATE_HZ

    def __init__(
        self,
        rig: Rig,
        *,
        seed: int,
        command_hook: CommandHook | None = None,
        force_hook: ForceHook | None = None,
        sensor_hook: SensorHook | None = None,
        wake_hook: WakeHook | None = None,
    ) -> None:
        _refuse_effects(rig)
        self._rig = rig
        self._command_hook, self._force_hook = command_hook, force_hook
        self._sensor_hook, self._wake_hook = sensor_hook, wake_hook
        sensing, air, timing = np.random.SeedSequence([seed, 0]).spawn(3)
        self._source = Motor(rig.thrust.source, rig.spool.source)
        self._sufferer = Motor(rig.thrust.sufferer, rig.spool.sufferer)
        self._body = RailBody(rig.sufferer.mass_kg, rig.rail, rig.sufferer.travel_m)
        self._jet = VerticalJet(rig.wake, rig.source.height_m, self.dt_s)
        self._turbulence = OrnsteinUhlenbeck(
            rig.disturbance.turbulence_time_s, self.dt_s, np.random.default_rng(air)
        )
        self._sensor = RangeSensorModel(
            rig.range_sensor,
            rig.disturbance,
            0.5 * rig.latency.round_trip_s,
            np.random.default_rng(sensing),
        )
        frame_s = rig.disturbance.esc_frame_s
        phase_s = float(np.random.default_rng(timing).uniform(0.0, frame_s))
        self._frame = EscFrame(frame_s, phase_s)
        self._count = 0
        self.x_m = self.vx_mps = 0.0
        self.wake_force_n = self.hook_force_n = 0.0
        self.steps = 0
        self.pulse_applied_s = 0.0
        self.source_applied_us = self.sufferer_applied_us = rig.limits.pulse_us[0]
        self._reading = self._sensor.newest(0.0)

    @property
    def t_s(self) -> float:
        """Time since the plant was made [s]."""
        return self._count * self.dt_s

    @property
    def z_m(self) -> float:
        """True height [m]."""
        return self._body.z_m

    @property
    def vz_mps(self) -> float:
        """True vertical speed [m/s]."""
        return self._body.vz_mps

    @property
    def source_thrust_n(self) -> float:
        """The source's thrust after spool [N]."""
        return self._source.thrust_n

    @property
    def sufferer_thrust_n(self) -> float:
        """The sufferer's thrust after spool [N]."""
        return self._sufferer.thrust_n

    def range_sample(self) -> RangeSample:
        """The newest range reading that the Pi can have by now."""
        return self._reading

    def step(self, source_us: float, sufferer_us: float, carriage_mps: float) -> None:
        """One inner step; the MCU's outputs are held over it."""
        self._read_sensors()
        self._drive_motors(source_us, sufferer_us)
        self.wake_force_n = self._wake_force()
        self.hook_force_n = self._extra_force()
        total_n = self._sufferer.thrust_n + self.wake_force_n + self.hook_force_n
        self._body.step(total_n, self.dt_s)
        self.vx_mps = carriage_mps
        self.x_m += carriage_mps * self.dt_s
        self._count += 1

    def wake_force_ahead(self, lead_s: float) -> float:
        """The wake's force [N] `lead_s` from now where the sufferer will be at its present speed.

        From the air that is already on its way, without the turbulence still to come. Raises
        UnusableInput when a hook has replaced the field: its future cannot be asked for.
        """
        if lead_s <= 0.0:
            return self.wake_force_n
        if self._wake_hook is not None:
            raise UnusableInput("A wake_hook replaces the field, so its future force is not known.")
        z_m = min(max(self.z_m + self.vz_mps * lead_s, 0.0), self._rig.sufferer.travel_m)
        vz = self._jet.velocity_ahead(self.x_m + self.vx_mps * lead_s, z_m, lead_s)
        return drag_force(self._rig.wake, 0.0, vz)

    def _drive_motors(self, source_us: float, sufferer_us: float) -> None:
        t_s = self.t_s
        driven = (source_us, sufferer_us)
        if self._command_hook is not None:
            driven = self._command_hook(t_s, source_us, sufferer_us, self.dt_s)
        if self._frame.due(t_s):
            self._source.set_pulse(driven[0])
            self._sufferer.set_pulse(driven[1])
            self.source_applied_us, self.sufferer_applied_us = source_us, sufferer_us
            self.pulse_applied_s = t_s
        self._source.step(self.dt_s)
        self._sufferer.step(self.dt_s)

    def _wake_force(self) -> float:
        thrust_n = self._source.thrust_n
        self._jet.inject(thrust_n)
        vx, vz = 0.0, 0.0
        if self._wake_hook is not None:
            vx, vz = self._wake_hook(self.t_s, thrust_n, self.x_m, self.z_m)
        else:
            vz = self._jet.velocity(self.x_m, self.z_m)
        force_n = drag_force(self._rig.wake, vx, vz)
        gust = self._rig.disturbance.turbulence_fraction * self._turbulence.step()
        return force_n * (1.0 + gust)

    def _extra_force(self) -> float:
        if self._force_hook is None:
            return 0.0
        state = {
            "z_m": self.z_m,
            "vz_mps": self.vz_mps,
            "x_m": self.x_m,
            "vx_mps": self.vx_mps,
            "source_thrust_n": self.source_thrust_n,
            "sufferer_thrust_n": self.sufferer_thrust_n,
        }
        return float(self._force_hook(self.t_s, MappingProxyType(state)))

    def _read_sensors(self) -> None:
        t_s = self.t_s
        self._sensor.observe(t_s, self.z_m)
        sample = self._sensor.newest(t_s)
        steps = math.floor(self.x_m * self._rig.stepper.steps_per_m + 1e-6)
        if self._sensor_hook is not None:
            range_m, hooked = self._sensor_hook(t_s, sample.range_m, steps)
            sample = RangeSample(float(range_m), sample.sensor_time_s, sample.status)
            steps = int(hooked)
        self._reading, self.steps = sample, steps


def _refuse_effects(rig: Rig) -> None:
    if rig.effect:
        name = rig.effect[0].name
        raise UnusableInput(
            f"The rig file lists the effect {name!r}, which cannot be simulated here; remove it."
        )
