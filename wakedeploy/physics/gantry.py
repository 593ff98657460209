"""The gantry plant: pulse widths and carriage speed in, motion and readings out.

Advanced in constant inner steps. The four hooks stand where an effect can hide: commands on their
way to the ESCs, a force on the sufferer, readings on their way out, and the wake field itself. Each
is called once per inner step, in order of time, and its result held over the step.

The effects that the rig file lists act in their own fixed order. A command passes command_hook,
then an effect's delay, then waits for the ESC's frame, and there meets dead band and quantisation.
The motors' thrusts follow, the source's first; then the wake, displaced, from the field or from
wake_hook; then what the wake leaves of the sufferer's thrust; forces, to which force_hook adds its
own; inertia. The range passes the effects, then the sensor with its noise, then sensor_hook.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.physics.constants import constants_of, with_constants
from wakedeploy.physics.effects.acting import ActingEffects, DelayLine
from wakedeploy.physics.effects.chain import Chain
from wakedeploy.physics.jet import VerticalJet, drag_force
from wakedeploy.physics.motor import EscFrame, Motor
from wakedeploy.physics.rail import RailBody
from wakedeploy.physics.range_sensor import RangeSample, RangeSensorModel, seen_m
from wakedeploy.physics.turbulence import OrnsteinUhlenbeck

INNER_RATE_HZ = 256.0

CommandHook = Callable[[float, float, float, float], tuple[float, float]]
ForceHook = Callable[[float, Mapping[str, float]], float]
SensorHook = Callable[[float, float, int], tuple[float, int]]
WakeHook = Callable[[float, float, float, float], tuple[float, float]]


class GantryPlant:
    """The simulated rig between the MCU's outputs and the sensors, deterministic by seed.

    All quantities in SI units, pulse widths in µs. `steps` and `range_sample()` are what the
    electronics report; the other attributes are the truth. The sufferer begins at rest on the stop,
    or on a spacer of `spacer_m`.
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
        spacer_m: float = 0.0,
    ) -> None:
        chain = Chain.of(rig)
        constants = chain.constants(constants_of(rig))
        self._rig = rig = with_constants(rig, constants)
        self._effects = ActingEffects(chain, rig, self.dt_s) if chain.moves else None
        self._command_hook, self._force_hook = command_hook, force_hook
        self._sensor_hook, self._wake_hook = sensor_hook, wake_hook
        sensing, air, timing = np.random.SeedSequence([seed, 0]).spawn(3)
        self._source = Motor(rig.thrust.source, rig.spool.source)
        self._sufferer = Motor(rig.thrust.sufferer, rig.spool.sufferer)
        self._body = RailBody(
            rig.sufferer.mass_kg,
            rig.rail,
            rig.sufferer.travel_m,
            z_m=spacer_m,
            floor_m=spacer_m,
        )
        self._jet = VerticalJet(rig.wake, rig.source.height_m, self.dt_s)
        self._turbulence = OrnsteinUhlenbeck(
            rig.disturbance.turbulence_time_s, self.dt_s, np.random.default_rng(air)
        )
        self._sensor = RangeSensorModel(
            rig.range_sensor,
            rig.disturbance,
            0.5 * rig.latency.round_trip_s,
            np.random.default_rng(sensing),
            constants["range.hold_s"],
        )
        self._seen = _Seen(constants, self.dt_s)
        self._late = _delayed_commands(constants["command.delay_s"], self.dt_s, rig)
        frame_s = rig.disturbance.esc_frame_s
        phase_s = float(np.random.default_rng(timing).uniform(0.0, frame_s))
        self._frame = EscFrame(frame_s, phase_s)
        self._count = 0
        self.x_m = self.vx_mps = 0.0
        self.wake_force_n = self.hook_force_n = 0.0
        self.source_thrust_n = self.sufferer_thrust_n = 0.0  # after spool, and after effects
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

    def range_sample(self) -> RangeSample:
        """The newest range reading that the Pi can have by now."""
        return self._reading

    def step(self, source_us: float, sufferer_us: float, carriage_mps: float) -> None:
        """One inner step; the MCU's outputs are held over it."""
        if self._effects is not None:
            self._effects.look(self.t_s, self.x_m, self.vx_mps, self.z_m, self.vz_mps)
        self._read_sensors()
        self._drive_motors(source_us, sufferer_us)
        self.wake_force_n = self._wake_force()
        effect_n = self._act_on_sufferer()
        self.hook_force_n = self._extra_force()
        total_n = self.sufferer_thrust_n + self.wake_force_n + effect_n + self.hook_force_n
        self._body.step(total_n, self.dt_s)
        self.vx_mps = carriage_mps
        self.x_m += carriage_mps * self.dt_s
        if self._effects is not None:
            self._effects.travel(carriage_mps)
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
        x_m = self.x_m + self.vx_mps * lead_s
        if self._effects is not None:
            x_m = self._effects.wake_x_m(x_m)
        vz = self._jet.velocity_ahead(x_m, z_m, lead_s)
        if self._effects is not None:
            vz = self._effects.wake_mps(vz)
        return drag_force(self._rig.wake, 0.0, vz)

    def _drive_motors(self, source_us: float, sufferer_us: float) -> None:
        t_s = self.t_s
        driven = (source_us, sufferer_us)
        if self._command_hook is not None:
            driven = self._command_hook(t_s, source_us, sufferer_us, self.dt_s)
        if self._late is not None:
            driven = (self._late[0].passed(driven[0]), self._late[1].passed(driven[1]))
        if self._frame.due(t_s):
            self._apply(*driven)
            self.source_applied_us, self.sufferer_applied_us = source_us, sufferer_us
            self.pulse_applied_s = t_s
        self.source_thrust_n = self._source.step(self.dt_s)
        self.sufferer_thrust_n = self._sufferer.step(self.dt_s)
        if self._effects is not None:
            self.source_thrust_n = self._effects.source_n(
                t_s, self.source_thrust_n, self.sufferer_thrust_n
            )

    def _apply(self, source_us: float, sufferer_us: float) -> None:
        """A servo frame begins with these pulses."""
        if self._effects is not None:
            source_us = self._effects.pulse_us(source_us, "source")
            sufferer_us = self._effects.pulse_us(sufferer_us, "sufferer")
        self._source.set_pulse(source_us)
        self._sufferer.set_pulse(sufferer_us)

    def _wake_force(self) -> float:
        self._jet.inject(self.source_thrust_n)
        x_m = self.x_m if self._effects is None else self._effects.wake_x_m(self.x_m)
        vx, vz = 0.0, 0.0
        if self._wake_hook is not None:
            vx, vz = self._wake_hook(self.t_s, self.source_thrust_n, x_m, self.z_m)
        else:
            vz = self._jet.velocity(x_m, self.z_m)
        if self._effects is not None:
            vz = self._effects.wake_mps(vz)
        force_n = drag_force(self._rig.wake, vx, vz)
        gust = self._rig.disturbance.turbulence_fraction * self._turbulence.step()
        return force_n * (1.0 + gust)

    def _act_on_sufferer(self) -> float:
        """The effects' force [N], after they have changed the sufferer's thrust and inertia."""
        if self._effects is None:
            return 0.0
        pushed = self._effects.push(self.wake_force_n)
        self.sufferer_thrust_n, force_n, self._body.added_kg = pushed
        return force_n

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
        seen_m = self._seen.height_m(self.z_m)
        if self._effects is not None:
            seen_m = self._effects.range_m(seen_m)
        self._sensor.observe(t_s, seen_m)
        sample = self._sensor.newest(t_s)
        steps = math.floor(self.x_m * self._rig.stepper.steps_per_m + 1e-6)
        if self._sensor_hook is not None:
            range_m, hooked = self._sensor_hook(t_s, sample.range_m, steps)
            sample = RangeSample(float(range_m), sample.sensor_time_s, sample.status)
            steps = int(hooked)
        self._reading, self.steps = sample, steps


class _Seen:
    """The height [m] as a sensor with these constants sees it, noise apart."""

    def __init__(self, constants: Mapping[str, float], dt_s: float) -> None:
        self._bias_m, self._scale = constants["range.bias_m"], constants["range.scale"]
        delay_s = constants["range.delay_s"]
        self._late = DelayLine(delay_s, dt_s, 0.0) if delay_s > 0.0 else None

    def height_m(self, z_m: float) -> float:
        """What is seen while the sufferer is at `z_m`; called once per step."""
        if self._late is not None:
            z_m = self._late.passed(z_m)
        return seen_m(z_m, self._bias_m, self._scale)


def _delayed_commands(delay_s: float, dt_s: float, rig: Rig) -> tuple[DelayLine, DelayLine] | None:
    """Delay lines for source and sufferer, or None without a delay."""
    if delay_s <= 0.0:
        return None
    idle_us = rig.limits.pulse_us[0]
    return DelayLine(delay_s, dt_s, idle_us), DelayLine(delay_s, dt_s, idle_us)
