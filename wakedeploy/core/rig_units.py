"""The units in a rig file: each constant is put into its own, or refused by name.

In: a rig file as TOML reads it. Out: the same, values, spreads and bounds in the units that the
names of the constants end in, and those of an effect's parameters in the library's.
"""

from collections.abc import Mapping
from typing import Any

from wakedeploy.core.units import conversion, converted, unit_of

_CONVERTED = ("value", "spread", "low", "high")

EffectUnits = Mapping[str, Mapping[str, str]]  # of effects' parameters, by both names


def in_own_units(raw: Mapping[str, Any], effect_units: EffectUnits) -> dict[str, Any]:
    """A rig file's tables in their own units, -0.0 as 0.0; ValueError says which cannot be."""
    raw = _with_one_zero(raw)
    tables = {name: _section(table, name) for name, table in raw.items() if name != "effect"}
    if "effect" in raw:
        tables["effect"] = _effects(raw["effect"], effect_units)
    return tables


def _with_one_zero(entry: Any) -> Any:
    """What is not below nothing by its bounds, as -0.0, may be so where it is computed with."""
    if isinstance(entry, Mapping):
        return {key: _with_one_zero(below) for key, below in entry.items()}
    if isinstance(entry, list | tuple):
        return [_with_one_zero(item) for item in entry]
    return entry + 0.0 if isinstance(entry, float) else entry


def _section(entry: Any, path: str) -> Any:
    if not isinstance(entry, Mapping):
        return entry
    if "value" in entry:
        return _in(unit_of(path.rsplit(".", 1)[-1]), entry, path)
    return {name: _section(below, f"{path}.{name}") for name, below in entry.items()}


def _effects(entries: Any, units: EffectUnits) -> Any:
    if not isinstance(entries, list | tuple):
        return entries
    return [_effect(entry, units) if isinstance(entry, Mapping) else entry for entry in entries]


def _effect(entry: Mapping[str, Any], units: EffectUnits) -> dict[str, Any]:
    """An entry with its parameters in the library's units; those of an expression stay."""
    parameters, effect = entry.get("parameters"), str(entry.get("name"))
    if effect not in units or not isinstance(parameters, Mapping):
        return dict(entry)
    converted_parameters = {
        name: _in(units[effect].get(name), stated, f"{effect}.{name}")
        for name, stated in parameters.items()
    }
    return {**entry, "parameters": converted_parameters}


def _in(wanted: str | None, entry: Any, path: str) -> Any:
    """A table `{value, unit, …}` in the unit wanted; what has no unit is left as it is."""
    if wanted is None or not isinstance(entry, Mapping) or not isinstance(entry.get("unit"), str):
        return entry
    try:
        factor = conversion(entry["unit"], wanted)
    except ValueError as error:
        raise ValueError(f"{path} is in {wanted}, and its unit {error}") from None
    made = {**entry, "unit": wanted}
    for name in _CONVERTED:
        if factor != 1 and name in made:
            made[name] = _times(made[name], factor)
    return made


def _times(value: Any, factor: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_times(item, factor) for item in value]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return converted(value, factor) if is_number else value
