"""Episode sets by their domain's name: simulated, or imported from recordings."""

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.api.arguments import LEAST_MINUTES, MOST_MINUTES, in_python, real, whole
from wakedeploy.api.inputs import PathLike, rig_of
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import path_from
from wakedeploy.core.names import domains, meant, unknown
from wakedeploy.gap.progress import Progress, quiet

if TYPE_CHECKING:
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.domains.domain import Setting


@in_python
def make_set(
    domain: str,
    *,
    minutes: float = 30.0,
    seed: int = 0,
    progress: Progress = quiet,
    **settings: Any,
) -> "EpisodeSet":
    """Simulate a domain, for training.

    Args:
        domain: "gantry", "downwash" or "ship".
        minutes: Of flight or voyage, in all episodes together [min].
        seed: Every set of the same seed is the same.
        progress: Called with a stage, the episodes done and their number.
        **settings: What the domain takes beside that: for the gantry a `rig` (or its file) and
            `packages` (the path of a predictor to fly, or several), for the downwash the `spread`
            of its constants (0 to 0.75), for ships the `level`, "slender" or "vortex".

    Returns:
        Episodes of observations (T, d) and forces (T, o) in the units of the set's channels.
        `made.write(folder)` keeps it.

    Raises:
        UnusableInput: The domain cannot be simulated, or has no such setting.
    """
    from wakedeploy.domains.domain import Simulated
    from wakedeploy.domains.domain import domain as domain_of

    name = _meant(domain)
    known = domain_of(name)
    if not isinstance(known, Simulated):
        raise UnusableInput(f"The domain {name} cannot be simulated.")
    possible = _possible(name, known.settings, settings)
    _require_settings(name, known.settings, settings)
    minutes, seed = (
        real("minutes", minutes, LEAST_MINUTES, MOST_MINUTES),
        whole("seed", seed, 0, 2**63 - 1),
    )
    if "rig" in possible:
        settings["rig"] = rig_of(settings.get("rig"))
    if "packages" in settings:
        settings["packages"] = _paths(settings["packages"], "packages")
    progress("Simulating", 0, 1)
    steps = _steps(progress, "Simulating")
    return known.make(minutes=minutes, seed=seed, progress=steps, **settings)


@in_python
def import_set(
    domain: str, path: PathLike, *, progress: Progress = quiet, **settings: Any
) -> "EpisodeSet":
    """Import public recordings in their original layout.

    Args:
        domain: "fish", "quadrotor" (FlareDW) or "crazyflie".
        path: The recordings' folder.
        progress: Called with a stage, the files done and their number.
        **settings: What the domain takes beside that: for quadrotors the `label`, "authors" or
            "corrected".

    Returns:
        Episodes of observations (T, d) and forces (T, o) in the units of the set's channels.

    Raises:
        UnusableInput: The domain has no recordings or no such setting, or the folder holds no
            recording that can be read.
    """
    from wakedeploy.domains.domain import Recorded
    from wakedeploy.domains.domain import domain as domain_of

    name = _meant(domain)
    known = domain_of(name)
    if not isinstance(known, Recorded):
        raise UnusableInput(f"The domain {name} cannot be imported.")
    _possible(name, known.settings, settings)
    _require_settings(name, known.settings, settings)
    progress("Importing", 0, 1)
    return known.read(path_from(path, "path"), _steps(progress, "Importing"), **settings)


def _possible(name: str, known: "tuple[Setting, ...]", settings: dict[str, Any]) -> list[str]:
    """Names of a domain's settings; UnusableInput for one that it does not have."""
    possible = [setting.name for setting in known]
    for setting in settings:
        if setting not in possible:
            has = f"it has {', '.join(possible)}" if possible else "it has none"
            raise UnusableInput(f"{name} has no setting '{setting}'; {has}.")
    return possible


def _require_settings(name: str, known: "tuple[Setting, ...]", settings: dict[str, Any]) -> None:
    """UnusableInput for a value that a setting of a domain cannot have."""
    for setting in known:
        if setting.name in settings:
            setting.require(settings[setting.name], f"{name}: ")


def _paths(given: object, name: str) -> tuple[Path, ...]:
    """One path, several, or None for none of them; UnusableInput for what is no path."""
    if given is None:
        return ()
    if isinstance(given, str | bytes | os.PathLike) or not isinstance(given, Iterable):
        given = (given,)
    return tuple(path_from(each, name) for each in given)


def _steps(progress: Progress, stage: str) -> Callable[[int, int], None]:
    return lambda done, total: progress(stage, done, total)


def _meant(domain: str) -> str:
    """The domain that is meant; UnusableInput without one."""
    name = meant(domain, domains())
    if name is None:
        raise UnusableInput(f"{unknown(domain, 'domain', domains())}.")
    return name
