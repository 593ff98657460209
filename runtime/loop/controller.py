"""Altitude PID with a force feedforward, and the carriage's position loop. Pure steps."""

from dataclasses import dataclass

from runtime.loop.estimate import Estimate
from runtime.loop.stops import Bounds, Stops
from runtime.reference import Reference
from wakedeploy.core.rig import Rig
from wakedeploy.physics.effects.chain import believed
from wakedeploy.physics.rail import GRAVITY_MPS2, smooth_friction

# Shares of the gains if commands act up to 0.2 s later than the rig file says: half the bandwidth.
_GENTLE = {"kp_n_per_m": 0.25, "ki_n_per_ms": 0.15, "kd_ns_per_m": 0.5}

# The source idles for at least this long: its air is on its way for half a second.
_SPARED_S = 1.0


@dataclass(frozen=True, slots=True)
class Command:
    """What the Pi asks of the MCU: pulse widths [µs] and the carriage's speed [m/s]."""

    source_us: float
    sufferer_us: float
    carriage_mps: float


@dataclass(frozen=True, slots=True)
class ControlState:
    """What the controller carries from tick to tick."""

    integral_n: float = 0.0
    sufferer_us: float = 1000.0
    spared_ticks: int = 0  # ticks for which the source still idles, since thrust was too little


@dataclass(frozen=True, slots=True)
class Terms:
    """The parts of the thrust demand [N], as they are logged."""

    p_n: float
    i_n: float
    d_n: float
    feedforward_n: float


class Controller:
    """PID on height; the feedforward asks for the opposite of the predicted wake force."""

    def __init__(self, rig: Rig, period_s: float) -> None:
        self._rig, self._period_s = believed(rig), period_s
        self._stops, self._spared_ticks = Stops(rig), round(_SPARED_S / period_s)
        self._hover_n = rig.sufferer.mass_kg * GRAVITY_MPS2
        self._gentle = rig.control.model_copy(
            update={name: share * getattr(rig.control, name) for name, share in _GENTLE.items()}
        )

    def initial(self) -> ControlState:
        """At rest, motors idle."""
        return ControlState(0.0, self._rig.limits.pulse_us[0])

    def step(
        self,
        state: ControlState,
        estimate: Estimate,
        aim: Reference,
        feedforward_n: float,
        *,
        other_n: float = 0.0,
        gently: bool = False,
        acts_known: bool = True,
    ) -> tuple[ControlState, Command, Terms]:
        """One tick: thrust demand in newtons, through the inverse thrust curve, limits and slew.

        The reference's speed and acceleration are known and smooth, so they are fed forward; the
        derivative otherwise acts on the measurement alone. `other_n` is the force [N] beside thrust
        and weight, which the way to a stop depends on. `gently` lands while the loop swings.
        `acts_known`: commands act when they should.
        """
        gains = self._gentle if gently else self._rig.control
        error_m = aim.z_m - estimate.z_m
        p_n = gains.kp_n_per_m * error_m
        d_n = gains.kd_ns_per_m * (aim.vz_mps - estimate.vz_mps)
        integral_n = state.integral_n + gains.ki_n_per_ms * error_m * self._period_s
        base_n = self._hover_n + self._rig.sufferer.mass_kg * aim.az_mps2
        base_n += smooth_friction(self._rig.rail, aim.vz_mps)
        demand_n = base_n + p_n + d_n + integral_n + feedforward_n
        # If pulses act late, or the height is mostly noise, nobody knows the way left to a stop.
        is_sure = acts_known and not estimate.has_strays
        stops = self._stops.ahead(estimate, other_n) if is_sure else Bounds()
        wanted_us = self._pulse(min(max(demand_n, stops.least_n), stops.most_n))
        sufferer_us = self._slewed(state.sufferer_us, wanted_us)
        if self._winds_up(sufferer_us, wanted_us, error_m):
            integral_n = state.integral_n
        carriage_mps = self.carriage_mps(estimate, aim)
        spared_ticks = self._spared_ticks if stops.is_short else max(state.spared_ticks - 1, 0)
        after = ControlState(integral_n, sufferer_us, spared_ticks)
        source_us = self._rig.limits.pulse_us[0] if spared_ticks else self._limited(aim.source_us)
        command = Command(source_us, sufferer_us, carriage_mps)
        return after, command, Terms(p_n, integral_n, d_n, feedforward_n)

    def carriage_mps(self, estimate: Estimate, aim: Reference) -> float:
        """The carriage's speed [m/s] for this tick."""
        gain_per_s = self._rig.control.carriage_gain_per_s
        return aim.vx_mps + gain_per_s * (aim.x_m - estimate.x_m)

    def _pulse(self, thrust_n: float) -> float:
        return self._rig.thrust.sufferer.pulse(thrust_n)

    def _limited(self, pulse_us: float) -> float:
        low, high = self._rig.limits.pulse_us
        return min(max(pulse_us, low), high)

    def _slewed(self, before_us: float, wanted_us: float) -> float:
        most_us = self._rig.limits.slew_us_per_s * self._period_s
        return self._limited(min(max(wanted_us, before_us - most_us), before_us + most_us))

    def _winds_up(self, sufferer_us: float, wanted_us: float, error_m: float) -> bool:
        """Whether the motor is at an end of its range and the error pushes it further."""
        low, high = self._rig.limits.pulse_us
        at_top = sufferer_us >= high or sufferer_us < wanted_us - 1e-6
        at_bottom = sufferer_us <= low or sufferer_us > wanted_us + 1e-6
        return (at_top and error_m > 0.0) or (at_bottom and error_m < 0.0)
