"""Effects at given values, composed in their fixed order; and a rig as its own model believes it.

In: a rig's `[[effect]]` entries, or values that a fit tries. Out: what all of them together change.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Effect as Entry
from wakedeploy.core.rig import EffectParameter, Rig
from wakedeploy.core.units import same_unit
from wakedeploy.physics.constants import NEUTRAL, Constants, constants_of, with_constants
from wakedeploy.physics.effects import LIBRARY, effect
from wakedeploy.physics.effects.base import (
    STAGES,
    Effect,
    FloatArray,
    Motion,
    Number,
    Parameter,
    Setting,
    Values,
    as_numbers,
)
from wakedeploy.physics.effects.symbolic import SYMBOLIC, symbolic_effect
from wakedeploy.physics.rail import GRAVITY_MPS2

Parts = tuple[tuple[Effect, Values], ...]
METHODS: Final = (
    "pulse_us",
    "source_n",
    "sufferer_n",
    "carriage_m",
    "wake_offset_m",
    "wake_mps",
    "force_n",
    "added_mass_kg",
    "range_m",
)
_NONE: Final[Mapping[str, Parts]] = dict.fromkeys(METHODS, ())


class Chain:
    """Effects with values, in the library's order whatever the order they are given in.

    `values` maps an effect's name to its parameters; `others` are effects that the library lacks,
    each of which acts after the library's of its stage. Raises UnusableInput for a name that
    neither knows. Values are not checked: a fit may step over a bound. `Chain.of` checks those of a
    rig file.
    """

    def __init__(self, values: Mapping[str, Values], others: Sequence[Effect] = ()) -> None:
        added = {one.name: one for one in others}
        known = [added.get(name) or effect(name) for name in values]
        order = [*LIBRARY, *added]
        known.sort(key=lambda one: (STAGES.index(one.stage), order.index(one.name)))
        self._keep(tuple((one, as_numbers(values[one.name])) for one in known))

    def _keep(self, parts: Parts) -> None:
        self.parts = parts
        acting = dict(_NONE)
        for part in parts:
            for method in _changed_by(part[0]):
                acting[method] += (part,)
        self._acting = acting

    @classmethod
    def in_order(cls, parts: Parts) -> "Chain":
        """Effects with values that already stand in the order in which they act."""
        chain = cls.__new__(cls)
        chain._keep(parts)
        return chain

    @classmethod
    def of(cls, rig: Rig) -> "Chain":
        """The effects that a rig file lists.

        Raises UnusableInput for an unknown effect, one listed twice, an unknown or missing
        parameter, another unit, or a value out of bounds.
        """
        values: dict[str, Values] = {}
        others: list[Effect] = []
        for entry in rig.effect:
            if entry.name in values:
                raise UnusableInput(
                    f"The rig file lists the effect {entry.name!r} twice; keep one of them."
                )
            one = effect_of(entry)
            values[entry.name] = checked_values(entry, one)
            if entry.name not in LIBRARY:
                others.append(one)
        return cls(values, others)

    @property
    def values(self) -> dict[str, float]:
        """All values by dotted name: `{"battery-sag.sag_per_s": 0.003}`."""
        return {f"{one.name}.{name}": value for one, p in self.parts for name, value in p.items()}

    def acting(self, method: str) -> Parts:
        """The effects that change a quantity, named as `Effect`'s method, with their values."""
        return self._acting[method]

    def acts_on(self, method: str) -> bool:
        """Whether any of the effects changes this quantity."""
        return bool(self._acting[method])

    @property
    def moves(self) -> bool:
        """Whether any effect does more than to replace a constant."""
        return any(self._acting.values())

    def constants(self, constants: Constants) -> Constants:
        """The constants with those replaced that effects replace."""
        moved = dict(constants)
        for one, p in self.parts:
            for parameter in one.parameters:
                if parameter.constant is not None:
                    moved[parameter.constant] = p[parameter.name]
        return moved

    def pulses_us(self, pulses_us: FloatArray, motor: str, idle_us: float) -> FloatArray:
        """What an ESC takes over of a flight's pulses [µs], (n,), from idle on."""
        for one, p in self._acting["pulse_us"]:
            pulses_us = one.pulses_us(p, pulses_us, motor, idle_us)
        return pulses_us

    def pulse_us(self, pulse_us: float, applied_us: float, motor: str, idle_us: float) -> float:
        """The pulse [µs] that an ESC takes over; `applied_us` is the answer of the frame before."""
        for one, p in self._acting["pulse_us"]:
            pulse_us = one.pulse_us(p, pulse_us, applied_us, motor, idle_us)
        return pulse_us

    def source_n(self, m: Motion, s: Setting) -> Number:
        """The source's thrust [N], from that in `m`."""
        for one, p in self._acting["source_n"]:
            m = replace(m, source_n=one.source_n(p, m, s))
        return m.source_n

    def sufferer_n(self, m: Motion, s: Setting) -> Number:
        """The sufferer's thrust [N], from that in `m`."""
        for one, p in self._acting["sufferer_n"]:
            m = replace(m, sufferer_n=one.sufferer_n(p, m, s))
        return m.sufferer_n

    def carriage_m(self, drive_m: float, before_m: float | None) -> float:
        """Where the carriage is [m]; `before_m` is the answer of the step before.

        In the first step that is None: the carriage then is where its drive is, amid any play.
        """
        before_m = drive_m if before_m is None else before_m
        for one, p in self._acting["carriage_m"]:
            drive_m = one.carriage_m(p, drive_m, before_m)
        return drive_m

    def carriages_m(self, drive_m: FloatArray) -> FloatArray:
        """Where the carriage is [m] along its drive's path, (N,)."""
        for one, p in self._acting["carriage_m"]:
            drive_m = one.carriages_m(p, drive_m)
        return drive_m

    def wake_offset_m(self, m: Motion, s: Setting) -> Number:
        """How far to the right [m] the wake lies; offsets add up."""
        total: Number = 0.0
        for one, p in self._acting["wake_offset_m"]:
            total = total + one.wake_offset_m(p, m, s)
        return total

    def wake_mps(self, m: Motion, s: Setting) -> Number:
        """The air's vertical speed [m/s] at the sufferer, from that in `m`."""
        for one, p in self._acting["wake_mps"]:
            m = replace(m, wake_mps=one.wake_mps(p, m, s))
        return m.wake_mps

    def force_n(self, m: Motion, s: Setting) -> Number:
        """The extra vertical force [N] on the sufferer; forces add up."""
        total: Number = 0.0
        for one, p in self._acting["force_n"]:
            total = total + one.force_n(p, m, s)
        return total

    def added_mass_kg(self, m: Motion, s: Setting) -> Number:
        """What the sufferer's inertia gains [kg]; masses add up."""
        total: Number = 0.0
        for one, p in self._acting["added_mass_kg"]:
            total = total + one.added_mass_kg(p, m, s)
        return total

    def range_m(self, range_m: Number, m: Motion, s: Setting) -> Number:
        """The range [m] that is read where `range_m` would have been."""
        for one, p in self._acting["range_m"]:
            range_m = one.range_m(p, range_m, m, s)
        return range_m


@functools.lru_cache(maxsize=256)
def _changed_by(one: Effect) -> frozenset[str]:
    """The quantities that an effect changes; a fit asks it a million times."""
    return frozenset(method for method in METHODS if one.changes(method))


def require_effects(rig: Rig) -> None:
    """UnusableInput for effects that a rig file may not list; as `Chain.of`."""
    if rig.effect:
        Chain.of(rig)


def setting_of(rig: Rig) -> Setting:
    """What effects may know of a rig."""
    return Setting(
        source_height_m=rig.source.height_m,
        mass_kg=rig.sufferer.mass_kg,
        weight_n=rig.sufferer.mass_kg * GRAVITY_MPS2,
        rotor_radius_m=rig.sufferer.rotor_radius_m,
        travel_m=rig.sufferer.travel_m,
    )


def neutral_values(one: Effect, constants: Constants) -> dict[str, float]:
    """An effect's values at which it changes nothing on a rig with these constants."""
    return {p.name: constants[p.constant] if p.constant else p.neutral for p in one.parameters}


def believed(rig: Rig) -> Rig:
    """The rig whose sections state what its effects say of its constants; other effects stay.

    Effects on constants that no section has a place for (delays and sensor errors) stay, too.
    """
    if not rig.effect:
        return rig
    chain = Chain.of(rig)
    folded = with_constants(rig, chain.constants(constants_of(rig)))
    kept = tuple(entry for entry in rig.effect if not _in_sections(effect_of(entry)))
    return folded.model_copy(update={"effect": kept})


def default_lead_s(rig: Rig) -> float:
    """How long a command takes to act [s]: round trip, latency, and the sufferer's mean spool lag.

    Effects of the rig file that replace these constants count.
    """
    constants = constants_of(rig)
    if rig.effect:
        constants = Chain.of(rig).constants(constants)
    lags_s = constants["spool.sufferer.up_s"] + constants["spool.sufferer.down_s"]
    return round(rig.latency.round_trip_s + constants["command.delay_s"] + 0.5 * lags_s, 4)


def unplaced_constants(rig: Rig) -> Constants:
    """Command delay, range bias, scale, delay and hold as the rig and its effects state them."""
    return {
        name: value
        for name, value in Chain.of(rig).constants(constants_of(rig)).items()
        if name in NEUTRAL and not name.startswith("thrust.")
    }


def effect_of(entry: Entry) -> Effect:
    """The effect that a rig file's entry names, or the expression that it holds."""
    return symbolic_effect(entry) if entry.name == SYMBOLIC else effect(entry.name)


def checked_values(entry: Entry, one: Effect) -> dict[str, float]:
    """The values of a rig file's entry; raises UnusableInput for what the effect does not allow."""
    known = {parameter.name: parameter for parameter in one.parameters}
    for name in entry.parameters:
        if name not in known:
            raise UnusableInput(
                f"The effect {entry.name!r} has no parameter {name!r}; it has {', '.join(known)}."
            )
    for name in known:
        if name not in entry.parameters:
            raise UnusableInput(
                f"The rig file's effect {entry.name!r} lacks its parameter {name!r}; add it."
            )
    for name, stated in entry.parameters.items():
        _check(entry.name, known[name], stated)
    return {name: entry.parameters[name].value for name in known}


def _check(effect_name: str, known: Parameter, stated: EffectParameter) -> None:
    if not same_unit(stated.unit, known.unit):
        raise UnusableInput(
            f"{effect_name}.{known.name} is in {known.unit}, but its unit says {stated.unit!r}; "
            "convert it."
        )
    if not known.low <= stated.value <= known.high:
        raise UnusableInput(
            f"{effect_name}.{known.name} = {stated.value:g} {known.unit}: must lie within "
            f"{known.low:g} and {known.high:g}."
        )


def _in_sections(one: Effect) -> bool:
    """Whether all that the effect does is to replace constants that a section has."""
    replaced = [parameter.constant for parameter in one.parameters]
    return all(name and (name not in NEUTRAL or name.startswith("thrust.")) for name in replaced)
