"""The simulations that a sweep runs: of which domain, with which settings of its own."""

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.domain import Setting, Simulated, domain, names_of
from wakedeploy.rig.file import parse_rig, read_rig, read_rig_text


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
    simulated = names_of(Simulated)
    if asked.domain not in simulated:
        raise UnusableInput(
            f"{where('domain')}'{asked.domain}' cannot be simulated; choose {', '.join(simulated)}."
        )
    known = _settings(asked.domain)
    for key, value in asked.settings.items():
        if key not in known:
            has = f"it has {', '.join(known)}" if known else "it has none"
            raise UnusableInput(
                f"{where('settings', key)}{asked.domain} has no setting '{key}'; {has}."
            )
        known[key].require(value, where("settings", key))
    if "rig" not in asked.settings:
        return asked
    path = base / str(asked.settings["rig"])
    try:
        read_rig(path)
        return dataclasses.replace(asked, rig=read_rig_text(path))
    except UnusableInput as error:
        raise UnusableInput(f"{where('settings', 'rig')}{error}") from error


def make(asked: Generate) -> EpisodeSet:
    """Simulate the set, in this process alone."""
    simulate = _simulated(asked.domain).make
    settings = dict(asked.settings)
    if asked.rig is not None:
        settings["rig"] = parse_rig(asked.rig, str(settings["rig"]))
    if "workers" in inspect.signature(simulate).parameters:
        settings["workers"] = 1
    return simulate(minutes=asked.minutes, seed=asked.seed, **settings)


def _settings(name: str) -> dict[str, Setting]:
    """Those that a plan's file can state: packages are flown by hand."""
    return {
        setting.name: setting for setting in _simulated(name).settings if setting.kind != "packages"
    }


def _simulated(name: str) -> Simulated:
    found = domain(name)
    assert isinstance(found, Simulated)
    return found
