"""A gantry's constants and effects as types: what `rig.toml` holds, and how it is written.

In: the tables of a rig file; `wakedeploy.rig.file` reads it. Out: a frozen `Rig` in SI units (pulse
widths in µs), and its text. Any constant may be written as `{value, spread, unit, date}`, in any
unit of its dimension; its spread, the calibration uncertainty, is kept in `Rig.calibration`.
"""

import bisect
import functools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
import pydantic
import tomli_w
from pydantic import Field

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.expression import expression_of
from wakedeploy.core.files import sha256_of, write_text_whole
from wakedeploy.core.rig_units import EffectUnits, in_own_units
from wakedeploy.core.validation import first_problem

SCHEMA = 1
LOOP_RATE_HZ = 32.0
MOST_STEPS_PER_S = 10_000  # the board makes one step a tick, as arduino_sketch/tick_limits.h says

_CALIBRATION_KEYS = {"value", "spread", "unit", "date"}
_LATER = (  # constants that rig files once did not have; without them they have their defaults
    ("wake", "speed_exponent"),
    ("range_sensor", "bias_m"),
    ("range_sensor", "scale"),
    ("battery", "has_divider"),
    ("discrepancy", "wake"),
    ("discrepancy", "friction"),
    ("limits", "brake_s"),
    ("limits", "sink_s"),
    ("limits", "sink_rate_us_per_s"),
)


class Calibration(pydantic.BaseModel, frozen=True, extra="forbid"):
    """What is known about a constant beside its value: uncertainty (1 sd), unit, date."""

    spread: Annotated[float, Field(ge=0)] | None = None
    unit: str | None = None
    date: str | None = None


class _Section(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Source(_Section):
    """The wake source's motor, fixed at the centre of the top beam, jet pointing down."""

    height_m: float = Field(gt=0.2, le=20)


class Sufferer(_Section):
    """The robot on the vertical rail."""

    mass_kg: float = Field(gt=0.01, le=50)
    rotor_radius_m: float = Field(gt=0.005, le=2)
    travel_m: float = Field(gt=0.05, le=20)


class ThrustCurve(_Section):
    """Static thrust of one motor over the pulse width, linear between the points."""

    pulse_us: tuple[float, ...] = Field(min_length=2)
    thrust_n: tuple[float, ...] = Field(min_length=2)

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


class MotorTables(_Section):
    """The two motors' thrust curves."""

    source: ThrustCurve
    sufferer: ThrustCurve


class SpoolLag(_Section):
    """First-order lag of one rotor's speed; zero follows at once."""

    up_s: float = Field(default=0.0, ge=0, le=2)
    down_s: float = Field(default=0.0, ge=0, le=2)


class Spool(_Section):
    """The two motors' spool lags."""

    source: SpoolLag = SpoolLag()
    sufferer: SpoolLag = SpoolLag()


class Rail(_Section):
    """Friction of the sufferer's vertical rail."""

    coulomb_n: float = Field(default=0.0, ge=0, le=20)
    stiction_n: float = Field(default=0.0, ge=0, le=40)
    viscous_n_per_mps: float = Field(default=0.0, ge=0, le=50)


class Stepper(_Section):
    """The carriage's drive in X."""

    steps_per_m: float = Field(gt=1, le=1e6)
    max_speed_mps: float = Field(gt=0, le=5)
    max_accel_mps2: float = Field(gt=0, le=50)


class RangeSensor(_Section):
    """The time-of-flight sensor on the carriage base, looking up at the sufferer's reflector.

    It reads `bias_m` on the stop, and `scale` metres more for every metre above.
    """

    noise_m: float = Field(ge=0, le=0.2)
    period_s: float = Field(gt=0.001, le=1)
    resolution_m: float = Field(ge=0, le=0.1)
    bias_m: float = Field(default=0.0, ge=-0.3, le=0.3)
    scale: float = Field(default=1.0, ge=0.7, le=1.3)


class Latency(_Section):
    """Measurement to actuation, without the motors: half of it sensing, half the command's way."""

    round_trip_s: float = Field(ge=0, le=0.2)


_Pulse = Annotated[float, Field(ge=500, le=2500)]
_Position = Annotated[float, Field(ge=-20, le=20)]


class Limits(_Section):
    """What the MCU and the loop never exceed, and how the MCU descends without commands.

    It brakes for `brake_s`, sinks for `sink_s` with a pulse that it takes back by
    `sink_rate_us_per_s`, and ramps to idle within `sufferer_descent_s`.
    """

    pulse_us: tuple[_Pulse, _Pulse] = (1000.0, 2000.0)
    slew_us_per_s: float = Field(default=20_000.0, ge=1, le=1e7)
    x_m: tuple[_Position, _Position] = (-0.6, 0.6)
    z_m: tuple[_Position, _Position] = (-0.05, 1.15)
    source_descent_s: float = Field(default=0.25, ge=0.01, le=10)
    sufferer_descent_s: float = Field(default=1.0, ge=0.01, le=10)
    brake_s: float = Field(default=0.3, ge=0, le=2)
    sink_s: float = Field(default=9.0, ge=0, le=20)
    sink_rate_us_per_s: float = Field(default=6.0, ge=0, le=1000)

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


class Battery(_Section):
    """The flight battery; measured through a divider on A0, it is asked for and watched."""

    has_divider: bool = False


class Wake(_Section):
    """The paper's field: injection S, width σ, descent w_a, diffusivity κ, decay λ, area Cd·A.

    A puff sinks at `speed_mps` times the `speed_exponent`-th power of the thrust that made it, over
    the reference thrust; the paper's wake has one speed, an exponent of 0.
    """

    speed_mps: float = Field(gt=0.1, le=100)
    diffusivity_m2ps: float = Field(ge=0, le=10)
    decay_per_s: float = Field(ge=0, le=50)
    strength: float = Field(ge=0, le=1e5)
    width_m: float = Field(gt=0.005, le=5)
    drag_area_m2: float = Field(ge=0, le=10)
    reference_thrust_n: float = Field(default=4.41, gt=0, le=1000)
    speed_exponent: float = Field(default=0.0, ge=-1, le=1)


class Control(_Section):
    """Altitude PID (force per metre) and the carriage's position loop."""

    kp_n_per_m: float = Field(default=8.0, ge=0, le=1e4)
    ki_n_per_ms: float = Field(default=5.0, ge=0, le=1e4)
    kd_ns_per_m: float = Field(default=3.2, ge=0, le=1e4)
    carriage_gain_per_s: float = Field(default=4.0, ge=0, le=100)


class Disturbance(_Section):
    """What the virtual gantry suffers beyond the model; zero switches each off."""

    turbulence_fraction: float = Field(default=0.04, ge=0, le=2)
    turbulence_time_s: float = Field(default=0.08, gt=0, le=10)
    outlier_probability: float = Field(default=0.005, ge=0, le=0.5)
    outlier_size_m: float = Field(default=0.15, ge=0, le=2)
    clock_jitter_s: float = Field(default=0.0003, ge=0, le=0.005)
    rest_s: float = Field(default=3.0, ge=0, le=60)
    esc_frame_s: float = Field(default=0.02, ge=0, le=0.1)


class Discrepancy(_Section):
    """How far the model's form may be off (1 sd): a share of the force that it corrects.

    Of the wake's force on its axis, and of the rail's Coulomb friction. The gap workflow allows for
    so much in every hypothesis; zero says that a form is exact.
    """

    wake: float = Field(default=0.05, ge=0, le=0.5)
    friction: float = Field(default=0.15, ge=0, le=1)


class EffectParameter(_Section):
    """One parameter of an effect, with its unit and its interval."""

    value: float
    unit: str
    low: float | None = None
    high: float | None = None


class Effect(_Section):
    """A named piece of physics that this rig's simulation includes.

    A force without a name is the effect "symbolic-force"; its `expression`, in newtons, is built of
    its parameters and of what an effect may look at (`wakedeploy.core.expression`).
    """

    name: str
    expression: str | None = None
    parameters: dict[str, EffectParameter] = {}
    data_sha256: str | None = None
    date: str | None = None

    @pydantic.model_validator(mode="after")
    def _expression_is_arithmetic(self) -> Self:
        if (self.name == "symbolic-force") != (self.expression is not None):
            raise ValueError("an expression belongs to the effect symbolic-force, and to no other")
        if self.expression is not None:
            try:
                expression_of(self.expression, self.parameters)
            except UnusableInput as error:
                raise ValueError(str(error).removesuffix(".")) from error
        return self


class Rig(_Section):
    """Everything the model of one gantry knows. Pulse widths in µs, everything else in SI units.

    `rig.changed(…)` is a copy with other constants, `rig.write(path)` keeps it. A thrust curve is
    two rows of as many numbers, (N,) each. UnusableInput for a name or a value that is not allowed.
    """

    schema_version: Literal[1] = Field(alias="schema")
    source: Source
    sufferer: Sufferer
    thrust: MotorTables
    spool: Spool = Spool()
    rail: Rail = Rail()
    stepper: Stepper
    range_sensor: RangeSensor
    latency: Latency
    limits: Limits = Limits()
    battery: Battery = Battery()
    wake: Wake
    control: Control = Control()
    disturbance: Disturbance = Disturbance()
    discrepancy: Discrepancy = Discrepancy()
    effect: tuple[Effect, ...] = ()
    calibration: dict[str, Calibration] = Field(default={}, exclude=True)

    @pydantic.model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.sufferer.travel_m >= self.source.height_m:
            raise ValueError("sufferer.travel_m must end below source.height_m")
        hover_n = self.sufferer.mass_kg * 9.81
        if self.thrust.sufferer.thrust_n[-1] <= hover_n:
            raise ValueError(f"thrust.sufferer ends below the sufferer's weight of {hover_n:.2f} N")
        steps_per_s = self.stepper.max_speed_mps * self.stepper.steps_per_m
        if not 1 <= steps_per_s <= MOST_STEPS_PER_S:
            raise ValueError(
                "stepper.max_speed_mps times stepper.steps_per_m must lie within 1 and "
                f"{MOST_STEPS_PER_S} steps/s, and it is {steps_per_s:g}"
            )
        if self.stepper.max_accel_mps2 * self.stepper.steps_per_m < 1:
            raise ValueError(
                "stepper.max_accel_mps2 times stepper.steps_per_m must be at least 1 step/s^2"
            )
        return self

    def __repr__(self) -> str:
        effects = ", ".join(effect.name for effect in self.effect) or "none"
        return (
            f"<Rig {self.sha256[:8]}: sufferer of {self.sufferer.mass_kg:g} kg below a source at"
            f" {self.source.height_m:g} m; effects: {effects}>"
        )

    def _repr_html_(self) -> str:
        from markupsafe import Markup

        return Markup("<pre>{}</pre>").format(self.text)

    @property
    def text(self) -> str:
        """The rig as TOML, calibration included; `parse_rig` reads it back to an equal rig."""
        return tomli_w.dumps(self._as_toml())

    @property
    def sha256(self) -> str:
        """Hash over the canonical text: equal rigs have equal hashes, comments do not count."""
        return sha256_of(self.text.encode())

    def changed(self, **sections: Mapping[str, Any]) -> "Rig":
        """A copy with some constants replaced: `rig.changed(wake={"speed_mps": 5.0})`.

        Raises UnusableInput when a name or a value is not allowed.
        """
        raw = self._as_toml()
        for section, values in sections.items():
            raw[section] = _merged(raw.get(section, {}), values)
        return rig_from_tables(raw, "changed rig")

    def without(self, section: str) -> "Rig":
        """A copy without an optional section: without "spool" the motors follow at once."""
        raw = self._as_toml()
        raw.pop(section, None)
        return rig_from_tables(raw, f"rig without [{section}]")

    def write(self, path: Path | str) -> None:
        """Write the rig as TOML; a killed process leaves the old file."""
        write_text_whole(Path(path), self.text)

    def _as_toml(self) -> dict[str, Any]:
        raw: dict[str, Any] = self.model_dump(mode="json", by_alias=True, exclude_none=True)
        for path, known in self.calibration.items():
            *sections, name = path.split(".")
            owner = functools.reduce(lambda table, key: table[key], sections, raw)
            owner[name] = {"value": owner[name]} | known.model_dump(exclude_none=True)
        if not raw["effect"]:
            del raw["effect"]
        for section, name in _LATER:  # a rig without them keeps its hash
            if raw[section][name] == type(getattr(self, section)).model_fields[name].default:
                del raw[section][name]
                if not raw[section]:
                    del raw[section]
        return raw


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


def rig_from_tables(
    raw: Mapping[str, Any], name: str, effect_units: EffectUnits | None = None
) -> Rig:
    """A rig from the tables of a rig file; `name` stands in the sentence of UnusableInput.

    `effect_units` has the units of effects' parameters, by both names: an effect that it lists may
    be stated in others. Whether there are such effects is for `wakedeploy.rig.file` to check.
    """
    schema = raw.get("schema")
    if isinstance(schema, int) and schema > SCHEMA:
        raise UnusableInput(
            f"{name}: schema {schema} is newer than this wakedeploy reads ({SCHEMA}); upgrade it."
        )
    if "calibration" in raw:
        raise UnusableInput(f"{name}: [calibration] is not a section; spreads stand at constants.")
    try:
        raw = in_own_units(raw, effect_units or {})
    except ValueError as error:
        raise UnusableInput(f"{name}: {error}.") from None
    effects = raw.get("effect", ())
    calibration: dict[str, dict[str, Any]] = {}
    plain = _without_calibration({k: v for k, v in raw.items() if k != "effect"}, "", calibration)
    try:
        return Rig.model_validate(plain | {"effect": effects, "calibration": calibration})
    except pydantic.ValidationError as error:
        raise UnusableInput(f"{name}: {first_problem(error)}.") from error


def _without_calibration(
    table: Mapping[str, Any], path: str, found: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    """The table with `{value, spread, …}` replaced by the value; the rest goes into `found`."""
    plain: dict[str, Any] = {}
    for key, entry in table.items():
        here = f"{path}{key}"
        if isinstance(entry, Mapping) and "value" in entry and set(entry) <= _CALIBRATION_KEYS:
            found[here] = {k: _plain_date(v) for k, v in entry.items() if k != "value"}
            plain[key] = entry["value"]
        elif isinstance(entry, Mapping):
            plain[key] = _without_calibration(entry, f"{here}.", found)
        else:
            plain[key] = entry
    return plain


def _plain_date(entry: Any) -> Any:
    return entry.isoformat() if hasattr(entry, "isoformat") else entry


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(old)
    for key, entry in new.items():
        nested = isinstance(entry, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], entry) if nested and "value" not in entry else entry
    return merged
