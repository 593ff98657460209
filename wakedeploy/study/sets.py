"""The episode sets that studies stand on: made or imported once, then read.

In: a folder, and where the public recordings lie. Out: one set per domain.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import wakedeploy
from wakedeploy.episodes import DESCRIPTION, EpisodeSet, read_episode_set
from wakedeploy.errors import UnusableInput
from wakedeploy.files import sha256_of

OnStep = Callable[[int, int], None]
Make = Callable[[float, OnStep], EpisodeSet]
Import = Callable[[Path, OnStep], EpisodeSet]

SEED = 0


@dataclass(frozen=True)
class Domain:
    """Where a domain's episodes come from: a simulation of some minutes, or a recording's folder.

    `main` is the force channel that figures show.
    """

    name: str
    main: str
    minutes: float = 0.0
    quick_minutes: float = 0.0
    make: Make | None = None
    recordings: str = ""
    read: Import | None = None


def _gantry(minutes: float, progress: OnStep) -> EpisodeSet:
    from wakedeploy.domains.gantry import make_set

    return make_set(None, minutes=minutes, seed=SEED, progress=progress)


def _downwash(minutes: float, progress: OnStep) -> EpisodeSet:
    from wakedeploy.domains.downwash import make_set

    return make_set(minutes=minutes, seed=SEED, progress=progress)


def _ship(minutes: float, progress: OnStep) -> EpisodeSet:
    from wakedeploy.domains.ship import make_set

    return make_set(minutes=minutes, seed=SEED, progress=progress)


def _fish(path: Path, progress: OnStep) -> EpisodeSet:
    from wakedeploy.domains.fish import import_set

    return import_set(path, progress)


def _quadrotor(path: Path, progress: OnStep) -> EpisodeSet:
    from wakedeploy.domains.quadrotor import import_set

    return import_set(path, progress)


def _crazyflie(path: Path, progress: OnStep) -> EpisodeSet:
    from wakedeploy.domains.crazyflie import import_set

    return import_set(path, progress)


DOMAINS = {
    domain.name: domain
    for domain in (
        Domain("quadrotor", "force_z_n", recordings="quadrotor", read=_quadrotor),
        Domain("ship", "sway_n", 120.0, 20.0, make=_ship),
        Domain("fish", "flag_tip_m", recordings="fish", read=_fish),
        Domain("downwash", "force_z_n", 20.0, 2.0, make=_downwash),
        Domain("gantry", "force_z_n", 30.0, 2.0, make=_gantry),
        Domain("crazyflie", "force_z_n", recordings="crazyflie", read=_crazyflie),
    )
}


def obtain(
    domain: Domain, folder: Path, recordings: Path | None, *, quick: bool, progress: OnStep
) -> EpisodeSet | None:
    """The domain's set from `folder`, where it is made or imported on the first call.

    None for recordings that are not below `recordings`. The simulated sets of a quick look lie
    apart from the full ones. Raises UnusableInput for a set that was made of other recordings, by
    another version or for another time.
    """
    place = folder / (f"{domain.name}-quick" if quick and domain.make else domain.name)
    minutes = domain.quick_minutes if quick else domain.minutes
    path = None if recordings is None else recordings / domain.recordings
    if (place / DESCRIPTION).exists():
        found = read_episode_set(place)
        _require_same(place, found, domain, minutes, path)
        return found
    if domain.make is not None:
        made = domain.make(minutes, progress)
    else:
        if path is None or not path.is_dir() or domain.read is None:
            return None
        made = domain.read(path, progress)
    made.write(place)
    return made


def _require_same(
    place: Path, found: EpisodeSet, domain: Domain, minutes: float, path: Path | None
) -> None:
    """What lies there has to be what would be made or imported now."""
    told = found.provenance
    advice = f"delete {place}, or choose another --out"
    version = wakedeploy.__version__
    if str(told.get("generator", version)).split()[1:2] not in ([], [version]):
        raise UnusableInput(
            f"{place} was made by {told['generator']}, this is {version}; {advice}."
        )
    if domain.make is not None:
        if told.get("minutes", minutes) != minutes:
            raise UnusableInput(f"{place} has {told['minutes']} minutes, not {minutes}; {advice}.")
        return
    files = told.get("files")
    if path is None or not path.is_dir() or not isinstance(files, dict):
        return  # the recordings are not at hand: what was imported has to do
    for name, sha256 in files.items():
        there = next((p for p in path.rglob(Path(name).name) if str(p).endswith(name)), None)
        if there is None or sha256_of(there.read_bytes()) != sha256:
            raise UnusableInput(f"{place} was imported from another {name}; {advice}.")


def chosen(names: str) -> list[Domain]:
    """The domains of a comma-separated list, or all. Raises UnusableInput for an unknown one."""
    asked = list(DOMAINS) if names == "all" else [name.strip() for name in names.split(",")]
    for name in asked:
        if name not in DOMAINS:
            raise UnusableInput(f"{name!r} is no domain; choose all or {', '.join(DOMAINS)}.")
    return [DOMAINS[name] for name in dict.fromkeys(asked)]
