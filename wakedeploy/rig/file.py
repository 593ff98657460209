"""Rig files: `rig.toml`, read and checked here and nowhere else.

In: a TOML file. Out: a `Rig`, whose effects the library has, with values within its bounds.
"""

import importlib.resources
from pathlib import Path

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import path_from, text_of, toml_of
from wakedeploy.core.rig import Effect, EffectParameter, Rig, rig_from_tables
from wakedeploy.core.rig_units import EffectUnits
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects import effect as known_effect
from wakedeploy.physics.effects.chain import require_effects


def read_rig(path: Path | str) -> Rig:
    """Read and validate a rig file.

    Args:
        path: The file; a constant may state its unit, another of the same dimension.

    Returns:
        The rig, pulse widths in µs and everything else in SI units; thrust curves are (N,) each.

    Raises:
        UnusableInput: Names file, section, key, value and bound.
    """
    return parse_rig(read_rig_text(path_from(path, "path")), str(path))


def read_rig_text(path: Path) -> str:
    """The text of a rig file as it is, comments included; UnusableInput where it cannot be read."""
    try:
        return text_of(path)
    except (OSError, ValueError) as error:
        raise UnusableInput(
            f"{path}: cannot be read as a rig file ({one_line(error)}); give a text in UTF-8, such "
            "as `wakedeploy rig init` writes."
        ) from error


def parse_rig(text: str, name: str = "rig.toml") -> Rig:
    """Validate the text of a rig file; `name` stands in error messages."""
    try:
        raw = toml_of(text)
    except ValueError as error:
        raise UnusableInput(f"{name}: not valid TOML: {one_line(error)}.") from error
    rig = rig_from_tables(raw, name, _effect_units())
    try:
        require_effects(rig)
    except UnusableInput as error:
        raise UnusableInput(f"{name}: {error}") from error
    return rig


def default_rig() -> Rig:
    """The gantry described by the founding paper, its open constants estimated.

    Pulse widths are in µs, all else in SI units; thrust curves are (N,) each. Raises nothing.
    """
    return parse_rig(default_rig_text(), "default rig")


def with_effect(rig: Rig, effect: str, /, **parameters: float) -> Rig:
    """A copy of a rig that has one effect more: `with_effect(rig, "spool-lag-source", up_s=0.1)`.

    Args:
        rig: The rig to copy.
        effect: The name of an effect of the library.
        **parameters: Its parameters by name, in the library's units, one number each.

    Returns:
        The rig with the effect; its thrust curves are (N,) each, as before.

    Raises:
        UnusableInput: There is no such effect or parameter, one is missing, or a value lies beyond
            its bounds.
    """
    for name, value in parameters.items():
        try:
            if isinstance(value, str | bytes | bytearray | bool):
                raise TypeError  # which float would take
            parameters[name] = float(value)
        except (TypeError, ValueError, OverflowError):
            raise UnusableInput(f"{effect}: {name} is {value!r:.60}: give a number.") from None
    units = {parameter.name: parameter.unit for parameter in known_effect(effect).parameters}
    stated = {n: EffectParameter(value=v, unit=units.get(n, "1")) for n, v in parameters.items()}
    changed = rig.model_copy(
        update={"effect": (*rig.effect, Effect(name=effect, parameters=stated))}
    )
    require_effects(changed)
    return changed


def default_rig_text() -> str:
    """The default rig file with its comments, to start a file of one's own from."""
    return importlib.resources.files(__package__).joinpath("default_rig.toml").read_text("utf-8")


def _effect_units() -> EffectUnits:
    """The units of the parameters of the library's effects."""
    return {name: {p.name: p.unit for p in shape.parameters} for name, shape in LIBRARY.items()}
