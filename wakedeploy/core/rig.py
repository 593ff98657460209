"""A gantry's constants and effects as types: what `rig.toml` holds, and how it is written.

In: the tables of a rig file; `wakedeploy.rig.file` reads it. Out: a frozen `Rig` in SI units (pulse
widths in µs), and its text. Any constant may be written as `{value, spread, unit, date}`, in any
unit of its dimension; its spread, the calibration uncertainty, is kept in `Rig.calibration`.
"""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import pydantic
import tomli_w
from pydantic import Field

from wakedeploy.core.errors import UnusableInput, own_errors
from wakedeploy.core.expression import expression_of
from wakedeploy.core.files import path_from, sha256_of, write_text_whole
from wakedeploy.core.rig_sections import (
    Battery,
    Control,
    Discrepancy,
    Disturbance,
    Latency,
    Limits,
    MotorTables,
    Rail,
    RangeSensor,
    Repeatability,
    Section,
    Source,
    Spool,
    Stepper,
    Sufferer,
    Wake,
)
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
    ("discrepancy", "fitted"),
    ("repeatability", "thrust"),
    ("repeatability", "sag_per_s"),
    ("repeatability", "bias_m"),
    ("limits", "brake_s"),
    ("limits", "sink_s"),
    ("limits", "sink_rate_us_per_s"),
)


class Calibration(pydantic.BaseModel, frozen=True, extra="forbid"):
    """What is known about a constant beside its value: uncertainty (1 sd), unit, date."""

    spread: Annotated[float, Field(ge=0)] | None = None
    unit: str | None = None
    date: str | None = None


class EffectParameter(Section):
    """One parameter of an effect, with its unit and its interval."""

    value: float
    unit: str
    low: float | None = None
    high: float | None = None


class Effect(Section):
    """A named piece of physics that this rig's simulation includes.

    A force without a name is the effect "symbolic-force"; its `expression`, in newtons, is built of
    its parameters and of what an effect may look at (`wakedeploy.core.expression`).
    """

    name: str
    expression: str | None = None
    parameters: dict[str, EffectParameter] = Field(default={})
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


class Rig(Section):
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
    repeatability: Repeatability = Repeatability()
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
            if not isinstance(values, Mapping):
                raise UnusableInput(
                    f"{section} is {values!r:.60}: give its constants by name, as {{name: value}}."
                )
            raw[section] = _merged(raw.get(section, {}), values)
        return rig_from_tables(raw, "changed rig")

    def without(self, section: str) -> "Rig":
        """A copy without an optional section: without "spool" the motors follow at once."""
        raw = self._as_toml()
        raw.pop(section, None)
        return rig_from_tables(raw, f"rig without [{section}]")

    def write(self, path: Path | str) -> None:
        """Write the rig as TOML; a killed process leaves the old file.

        UnusableInput where no file can be written at `path`.
        """
        with own_errors():
            write_text_whole(path_from(path, "path"), self.text)

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
        raise UnusableInput(f"{name}: {first_problem(error, Rig)}.") from error


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
