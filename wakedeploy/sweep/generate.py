"""The simulations that a sweep can run: which domains, with which settings of their own."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.rig.file import parse_rig, read_rig, read_rig_text

LEVELS = ("slender", "vortex")
WIDEST_SPREAD = 0.75


@dataclass(frozen=True)
class Generate:
    """A set to simulate: `minutes` of a domain; `rig` is the rig file's text where one is named."""

    name: str
    domain: str
    minutes: float
    seed: int
    settings: Mapping[str, Any]
    rig: str | None = None


def checked(asked: Generate, base: Path, where: Callable[..., str]) -> Generate:
    """A set that can be simulated, its rig file read relative to `base`.

    Raises UnusableInput, which begins with what `where(field, …)` says, for an unknown domain or
    setting and for an impossible value.
    """
    if asked.domain not in _MAKE:
        raise UnusableInput(
            f"{where('domain')}'{asked.domain}' cannot be simulated; choose {', '.join(_MAKE)}."
        )
    known = _SETTING[asked.domain]
    for key, value in asked.settings.items():
        if key != known:
            raise UnusableInput(
                f"{where('settings', key)}{asked.domain} has no setting '{key}'; it has {known}."
            )
        if key == "level" and value not in LEVELS:
            raise UnusableInput(
                f"{where('settings', key)}level = {value!r} has to be {' or '.join(LEVELS)}."
            )
        if key == "spread" and not (isinstance(value, int | float) and 0 <= value <= WIDEST_SPREAD):
            raise UnusableInput(
                f"{where('settings', key)}spread = {value!r} has to be a number from 0 to"
                f" {WIDEST_SPREAD}."
            )
    if "rig" not in asked.settings:
        return asked
    path = base / str(asked.settings["rig"])
    read_rig(path)
    return dataclasses.replace(asked, rig=read_rig_text(path))


def make(asked: Generate) -> EpisodeSet:
    """Simulate the set, in this process alone."""
    return _MAKE[asked.domain](asked)


def _gantry(asked: Generate) -> EpisodeSet:
    from wakedeploy.domains.gantry import make_set

    rig = None if asked.rig is None else parse_rig(asked.rig, str(asked.settings["rig"]))
    return make_set(rig, minutes=asked.minutes, seed=asked.seed, workers=1)


def _downwash(asked: Generate) -> EpisodeSet:
    from wakedeploy.domains.downwash import make_set

    return make_set(minutes=asked.minutes, seed=asked.seed, **asked.settings)


def _ship(asked: Generate) -> EpisodeSet:
    from wakedeploy.domains.ship import make_set

    return make_set(minutes=asked.minutes, seed=asked.seed, workers=1, **asked.settings)


_MAKE: dict[str, Callable[[Generate], EpisodeSet]] = {
    "gantry": _gantry,
    "downwash": _downwash,
    "ship": _ship,
}
_SETTING = {"gantry": "rig", "downwash": "spread", "ship": "level"}
