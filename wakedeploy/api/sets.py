"""Episode sets by their domain's name: simulated, or imported from recordings."""

import importlib
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.api.inputs import PathLike, rig_of
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.names import DOMAINS, meant, unknown
from wakedeploy.gap.progress import Progress, quiet

if TYPE_CHECKING:
    from wakedeploy.core.episodes import EpisodeSet

_OURS = {"minutes", "seed", "progress", "workers"}  # what every simulation takes


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
            `packages` (paths of predictors to fly), for the downwash the `spread` of its constants
            (0 to 0.75), for ships the `level`, "slender" or "vortex".

    Returns:
        Episodes of observations (T, d) and forces (T, o) in the units of the set's channels.
        `made.write(folder)` keeps it.

    Raises:
        UnusableInput: The domain cannot be simulated, or has no such setting.
    """
    name, make = _found(domain, "make_set", "simulated")
    possible = [p for p in inspect.signature(make).parameters if p not in _OURS]
    for setting in settings:
        if setting not in possible:
            has = f"it has {', '.join(possible)}" if possible else "it has none"
            raise UnusableInput(f"{name} has no setting '{setting}'; {has}.")
    if "rig" in possible:
        settings["rig"] = rig_of(settings.get("rig"))
    progress("Simulating", 0, 1)
    steps = _steps(progress, "Simulating")
    made: EpisodeSet = make(minutes=minutes, seed=seed, progress=steps, **settings)
    return made


def import_set(domain: str, path: PathLike, *, progress: Progress = quiet) -> "EpisodeSet":
    """Import public recordings in their original layout.

    Args:
        domain: "fish", "quadrotor" (FlareDW) or "crazyflie".
        path: The recordings' folder.
        progress: Called with a stage, the files done and their number.

    Returns:
        Episodes of observations (T, d) and forces (T, o) in the units of the set's channels.

    Raises:
        UnusableInput: The domain has no recordings, or the folder holds none that can be read.
    """
    _, read = _found(domain, "import_set", "imported")
    progress("Importing", 0, 1)
    made: EpisodeSet = read(Path(path), _steps(progress, "Importing"))
    return made


def _steps(progress: Progress, stage: str) -> Callable[[int, int], None]:
    return lambda done, total: progress(stage, done, total)


def _found(domain: str, function: str, how: str) -> tuple[str, Callable[..., Any]]:
    """The domain that is meant, and this function of its module; UnusableInput without one."""
    name = meant(domain, DOMAINS)
    if name is None:
        raise UnusableInput(f"{unknown(domain, 'domain', DOMAINS)}.")
    found = getattr(importlib.import_module(f"wakedeploy.domains.{name}"), function, None)
    if found is None:
        raise UnusableInput(f"The domain {name} cannot be {how}.")
    return name, found
