"""The library of effects: named pieces of physics that a rig's simulation may be missing.

In: a rig file's `[[effect]]` entries, or values that a fit tries. Out: what they change, for the
plant step by step and for the gap workflow over whole flights. Effects act in one fixed order:
command, actuator, wake, force, body, sensor.
"""

import functools
from collections.abc import Iterator, Mapping

from wakedeploy.core.discovery import EFFECTS, offers
from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.effects.base import (
    STAGES,
    Effect,
    Motion,
    Number,
    Parameter,
    Setting,
    Values,
)

__all__ = (
    "LIBRARY",
    "STAGES",
    "Effect",
    "Motion",
    "Number",
    "Parameter",
    "Setting",
    "Values",
    "effect",
    "found_effects",
    "replacing",
)


@functools.cache
def found_effects() -> Mapping[str, Effect]:
    """All effects in the order in which they act; those of other packages last in their stage.

    Raises UnusableInput where another package's cannot be used.
    """
    found: dict[str, Effect] = {}
    for offer in offers(EFFECTS).values():
        for shape in offer.load(tuple):
            if not isinstance(shape, Effect) or shape.name in found:
                why = "there is one of this name" if isinstance(shape, Effect) else "it is none"
                raise UnusableInput(
                    f"The effect {shape!r} of {offer.module} cannot be used ({why}); mend the"
                    f" package {offer.by}, or uninstall it."
                )
            found[shape.name] = shape
    return dict(sorted(found.items(), key=lambda entry: STAGES.index(entry[1].stage)))


class _Library(Mapping[str, Effect]):
    """The effects that are found, which are looked for when the first of them is asked for."""

    def __getitem__(self, name: str) -> Effect:
        return found_effects()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(found_effects())

    def __len__(self) -> int:
        return len(found_effects())


LIBRARY: Mapping[str, Effect] = _Library()


def replacing(constant: str) -> tuple[str, ...]:
    """The parameters that replace this constant of the rig, each as EFFECT.PARAMETER."""
    return tuple(
        f"{name}.{p.name}"
        for name, shape in LIBRARY.items()
        for p in shape.parameters
        if p.constant == constant
    )


def effect(name: str) -> Effect:
    """The effect of this name; UnusableInput lists the known ones."""
    if name not in LIBRARY:
        known = ", ".join(LIBRARY)
        raise UnusableInput(f"There is no effect {name!r} in the library; it knows {known}.")
    return LIBRARY[name]
