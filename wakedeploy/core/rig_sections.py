"""The sections of a rig file as types: what each constant is, and between which bounds it lies.

In: the tables of a rig file. Out: frozen sections in SI units (pulse widths in µs). Whether they
fit together is for `wakedeploy.core.rig` to say.
"""

import bisect
import math
from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
import numpy.typing as npt
import pydantic
from pydantic import Field


class Section(pydantic.BaseModel):
    """A table of a rig file: what it holds cannot be changed, and it holds nothing else."""

    model_config = pydantic.ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Source(Section):
    """The wake source's motor, fixed at the centre of the top beam, jet pointing down."""

    height_m: float = Field(
        gt=0.2, le=20, description="Height of the source above the stop of the rail"
    )


class Sufferer(Section):
    """The robot on the vertical rail."""

    mass_kg: float = Field(gt=0.01, le=50, description="Mass that moves up and down the rail")
    rotor_radius_m: float = Field(gt=0.005, le=2, description="Radius of its rotor")
    travel_m: float = Field(
        gt=0.05, le=20, description="Way from the stop up to the end of the rail"
    )


class ThrustCurve(Section):
    """Static thrust of one motor over the pulse width, linear between the points."""

    pulse_us: tuple[float, ...] = Field(
        min_length=2, description="Pulse widths at which the thrust was measured, rising"
    )
    thrust_n: tuple[float, ...] = Field(
        min_length=2, description="Thrust at each of these pulse widths, rising"
    )

    @pydantic.model_validator(mode="after")
    def _table_is_a_curve(self) -> Self:
        if len(self.pulse_us) != len(self.thrust_n):
            raise ValueError("pulse_us and thrust_n need the same number of points")
        if np.any(np.diff(self.pulse_us) <= 0) or np.any(np.diff(self.thrust_n) <= 0):
            raise ValueError("pulse_us and thrust_n must both rise from point to point")
        if self.thrust_n[0] < 0 or self.pulse_us[0] < 500 or self.pulse_us[-1] > 2500:
            raise ValueError("pulse widths lie within 500 and 2500 us, thrusts are not negative")
        return self

    def thrust(self, pulse_us: float) -> float:
        """Thrust [N] at a pulse width [us]; the ends of the table are held beyond it."""
        return _between(pulse_us, self.pulse_us, self.thrust_n)

    def thrusts(self, pulses_us: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The same at many pulse widths, (N,)."""
        return np.asarray(np.interp(pulses_us, self.pulse_us, self.thrust_n))

    def pulse(self, thrust_n: float) -> float:
        """Pulse width [us] for a thrust [N]; saturates at the ends of the table."""
        return _between(thrust_n, self.thrust_n, self.pulse_us)

    def throttle(self, pulse_us: float) -> float:
        """Pulse width as a share of the table's range, 0…1."""
        low, high = self.pulse_us[0], self.pulse_us[-1]
        return min(max((pulse_us - low) / (high - low), 0.0), 1.0)


class MotorTables(Section):
    """The two motors' thrust curves."""

    source: ThrustCurve
    sufferer: ThrustCurve


class SpoolLag(Section):
    """First-order lag of one rotor's speed; zero follows at once."""

    up_s: float = Field(
        default=0.0, ge=0, le=2, description="Time constant while the rotor speeds up"
    )
    down_s: float = Field(default=0.0, ge=0, le=2, description="Time constant while it slows down")


class Spool(Section):
    """The two motors' spool lags."""

    source: SpoolLag = SpoolLag()
    sufferer: SpoolLag = SpoolLag()


class Rail(Section):
    """Friction of the sufferer's vertical rail."""

    coulomb_n: float = Field(
        default=0.0, ge=0, le=20, description="Friction of a motion, whatever its speed"
    )
    stiction_n: float = Field(
        default=0.0, ge=0, le=40, description="Force that breaks a resting sufferer loose"
    )
    viscous_n_per_mps: float = Field(
        default=0.0, ge=0, le=50, description="Friction in proportion to speed"
    )


class Stepper(Section):
    """The carriage's drive in X."""

    steps_per_m: float = Field(
        gt=1, le=1e6, description="Steps of the motor for a metre of the carriage's way"
    )
    max_speed_mps: float = Field(gt=0, le=5, description="Largest speed of the carriage")
    max_accel_mps2: float = Field(gt=0, le=50, description="Largest acceleration of the carriage")


class RangeSensor(Section):
    """The time-of-flight sensor on the carriage base, looking up at the sufferer's reflector.

    It reads `bias_m` on the stop, and `scale` metres more for every metre above.
    """

    noise_m: float = Field(ge=0, le=0.2, description="Standard deviation of a reading")
    period_s: float = Field(gt=0.001, le=1, description="Time from one reading to the next")
    resolution_m: float = Field(ge=0, le=0.1, description="Step in which readings come")
    bias_m: float = Field(default=0.0, ge=-0.3, le=0.3, description="What it reads on the stop")
    scale: float = Field(
        default=1.0, ge=0.7, le=1.3, description="Metres that it reads for each metre of height"
    )


class Latency(Section):
    """Measurement to actuation, without the motors: half of it sensing, half the command's way."""

    round_trip_s: float = Field(
        ge=0,
        le=0.2,
        description="From measurement to actuation, communication and sensing together",
    )


_Pulse = Annotated[float, Field(ge=500, le=2500)]
_Position = Annotated[float, Field(ge=-20, le=20)]


class Limits(Section):
    """What the MCU and the loop never exceed, and how the MCU descends without commands.

    It brakes for `brake_s`, sinks for `sink_s` with a pulse that it takes back by
    `sink_rate_us_per_s`, and ramps to idle within `sufferer_descent_s`.
    """

    pulse_us: tuple[_Pulse, _Pulse] = Field(
        default=(1000.0, 2000.0),
        description="Shortest and longest pulse width that a motor is sent",
    )
    slew_us_per_s: float = Field(
        default=20_000.0, ge=1, le=1e7, description="How fast a pulse width may change"
    )
    x_m: tuple[_Position, _Position] = Field(
        default=(-0.6, 0.6), description="Where the carriage may go; beyond, the run is stopped"
    )
    z_m: tuple[_Position, _Position] = Field(
        default=(-0.05, 1.15),
        description="Heights between which a flight goes on; beyond, the run is stopped",
    )
    source_descent_s: float = Field(
        default=0.25,
        ge=0.01,
        le=10,
        description="The source's ramp from full to idle when commands stop",
    )
    sufferer_descent_s: float = Field(
        default=1.0,
        ge=0.01,
        le=10,
        description="The sufferer's ramp from full to idle at the end of its descent",
    )
    brake_s: float = Field(
        default=0.3, ge=0, le=2, description="How long the sufferer brakes when commands stop"
    )
    sink_s: float = Field(default=9.0, ge=0, le=20, description="How long it then sinks")
    sink_rate_us_per_s: float = Field(
        default=6.0, ge=0, le=1000, description="How fast its pulse is taken back while it sinks"
    )

    @pydantic.field_validator("pulse_us", "x_m", "z_m")
    @classmethod
    def _low_before_high(cls, pair: tuple[float, float]) -> tuple[float, float]:
        if not pair[0] < pair[1]:
            raise ValueError("the lower limit must lie below the upper one")
        return pair

    @pydantic.field_validator("pulse_us")
    @classmethod
    def _apart_on_the_wire(cls, pair: tuple[float, float]) -> tuple[float, float]:
        if pair[1] - pair[0] < 1.0:  # half microseconds there
            raise ValueError("the limits must lie at least 1 us apart")
        return pair


class Battery(Section):
    """The flight battery; measured through a divider on A0, it is asked for and watched."""

    has_divider: bool = Field(
        default=False,
        description="Whether it is wired to A0: a flight without a battery is then refused",
    )


class Wake(Section):
    """The paper's field: injection S, width σ, descent w_a, diffusivity κ, decay λ, area Cd·A.

    A puff sinks at `speed_mps` times the `speed_exponent`-th power of the thrust that made it, over
    the reference thrust; the paper's wake has one speed, an exponent of 0.
    """

    speed_mps: float = Field(
        gt=0.1, le=100, description="Speed at which a puff sinks at the reference thrust, w_a"
    )
    diffusivity_m2ps: float = Field(
        ge=0, le=10, description="How fast the wake widens on its way, κ"
    )
    decay_per_s: float = Field(
        ge=0, le=50, description="Share of its speed that the wake loses each second, λ"
    )
    strength: float = Field(
        ge=0, le=1e5, description="Acceleration of the air at the reference thrust, S"
    )
    width_m: float = Field(
        gt=0.005, le=5, description="Width of the wake where it leaves the source, σ"
    )
    drag_area_m2: float = Field(
        ge=0, le=10, description="Area by which the wake pushes the sufferer, Cd·A"
    )
    reference_thrust_n: float = Field(
        default=4.41, gt=0, le=1000, description="Source's thrust at which strength and speed hold"
    )
    speed_exponent: float = Field(
        default=0.0,
        ge=-1,
        le=1,
        description="Power of the source's thrust with which the speed grows; 0: one speed",
    )


class Control(Section):
    """Altitude PID (force per metre) and the carriage's position loop."""

    kp_n_per_m: float = Field(
        default=8.0, ge=0, le=1e4, description="Force for each metre of error in height"
    )
    ki_n_per_ms: float = Field(
        default=5.0, ge=0, le=1e4, description="Force for each metre of error that lasts a second"
    )
    kd_ns_per_m: float = Field(
        default=3.2, ge=0, le=1e4, description="Force for each metre per second of vertical speed"
    )
    carriage_gain_per_s: float = Field(
        default=4.0,
        ge=0,
        le=100,
        description="Carriage's speed for each metre of error in its position",
    )


class Disturbance(Section):
    """What the virtual gantry suffers beyond the model; zero switches each off."""

    turbulence_fraction: float = Field(
        default=0.04,
        ge=0,
        le=2,
        description="Fluctuation of the wake's force (1 sd) as a share of the force",
    )
    turbulence_time_s: float = Field(
        default=0.08, gt=0, le=10, description="How long a fluctuation lasts: its correlation time"
    )
    outlier_probability: float = Field(
        default=0.005,
        ge=0,
        le=0.5,
        description="Share of range readings that have nothing to do with the reflector",
    )
    outlier_size_m: float = Field(
        default=0.15, ge=0, le=2, description="Most by which such a reading is off"
    )
    clock_jitter_s: float = Field(
        default=0.0003, ge=0, le=0.005, description="How late the loop wakes up (1 sd)"
    )
    rest_s: float = Field(
        default=3.0, ge=0, le=60, description="Rest on the stop before a flight, and after it"
    )
    esc_frame_s: float = Field(
        default=0.02,
        ge=0,
        le=0.1,
        description="Time from one servo frame of the ESCs to the next; 0: they follow at once",
    )


_FormTerm = Annotated[
    str,
    Field(pattern=r"^(wake\.(even[0-5]|odd[0-2]|height[12])|friction\.(speed[01]|along))$"),
]
_Size = Annotated[float, Field(ge=-3, le=3)]
_FormSpread = Annotated[float, Field(ge=1e-6, le=3)]


class Discrepancy(Section):
    """How far the model's form may be off (1 sd): a share of the force that it corrects.

    Of the wake's force on its axis, and of the rail's Coulomb friction. The gap workflow allows for
    so much in every hypothesis; zero says that a form is exact. What reference flights have shown
    of the form stands in `fitted`: the size of each smooth correction and its standard deviation.
    """

    wake: float = Field(
        default=0.05,
        ge=0,
        le=0.5,
        description="How far the wake's form may be off, as a share of its force on the axis",
    )
    friction: float = Field(
        default=0.15,
        ge=0,
        le=1,
        description="How far the friction's form may be off, as a share of coulomb_n",
    )
    fitted: dict[_FormTerm, tuple[_Size, _FormSpread]] = Field(
        default={},
        description="What reference flights have shown: size and spread of each correction",
    )


class Repeatability(Section):
    """How much changes from one flight to the next (1 sd); zero: nothing, or nothing known.

    The sufferer's thrust as a share, how fast it fades with each second of hovering, and the range
    sensor's bias. The gap workflow lets each flight have values of its own.
    """

    thrust: float = Field(
        default=0.0,
        ge=0,
        le=0.3,
        description="Change of the sufferer's thrust from flight to flight, as a share",
    )
    sag_per_s: float = Field(
        default=0.0,
        ge=0,
        le=0.02,
        description="Share of the thrust that a second of hovering takes, in one flight or another",
    )
    bias_m: float = Field(
        default=0.0,
        ge=0,
        le=0.1,
        description="Change of the range sensor's bias from flight to flight",
    )


def _between(x: float, xs: Sequence[float], ys: Sequence[float]) -> float:
    """As `np.interp` for one number, which makes arrays of the table before it looks.

    The loop asks five times a tick, a simulation at each of its steps.
    """
    above = bisect.bisect_right(xs, x)
    if math.isnan(x) or above == 0:
        return float(x) if math.isnan(x) else ys[0]
    if above == len(xs):
        return ys[-1]
    slope = (ys[above] - ys[above - 1]) / (xs[above] - xs[above - 1])
    return float(slope * (x - xs[above - 1]) + ys[above - 1])
