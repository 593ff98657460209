"""The episode sets that studies stand on: made or imported once, then read.

In: a folder, and where the public recordings lie. Out: one set per domain.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import JsonValue

import wakedeploy
from wakedeploy.core.discovery import DOMAIN, offers
from wakedeploy.core.episodes import DESCRIPTION, EpisodeSet, read_episode_set
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import sha256_of
from wakedeploy.core.names import domains
from wakedeploy.domains.domain import OnStep, Recorded, domain
from wakedeploy.rig.file import default_rig
from wakedeploy.study.code import code_sha256

Make = Callable[[float, OnStep], EpisodeSet]
Import = Callable[[Path, OnStep], EpisodeSet]

SEED = 0
_MADE_BY = "made_by"  # in the provenance


@dataclass(frozen=True)
class Domain:
    """Where a domain's episodes come from: a simulation of some minutes, or a recording's folder.

    `main` is the force channel that figures show. `module` makes or reads the set; `settings` is
    what `make` hands it beside minutes and seed. `pattern` finds one file of each recording.
    """

    name: str
    main: str
    minutes: float = 0.0
    quick_minutes: float = 0.0
    make: Make | None = None
    recordings: str = ""
    pattern: str = ""
    read: Import | None = None
    module: str = ""
    settings: str = ""


def _studied(name: str) -> Domain:
    """A domain as its own file describes it."""
    known, module = domain(name), offers(DOMAIN)[name].module
    if isinstance(known, Recorded):
        return Domain(
            name,
            known.main,
            recordings=name,
            pattern=known.pattern,
            read=known.read,
            module=module,
        )
    make = known.make

    def simulate(minutes: float, progress: OnStep) -> EpisodeSet:
        return make(minutes=minutes, seed=SEED, progress=progress)

    return Domain(
        name, known.main, known.study_minutes, known.quick_minutes, simulate, module=module
    )


class _Domains(Mapping[str, Domain]):
    """All that are found; each is imported when it is asked for."""

    def __getitem__(self, name: str) -> Domain:
        return _studied(name)

    def __iter__(self) -> Iterator[str]:
        return iter(domains())

    def __len__(self) -> int:
        return len(domains())


DOMAINS: Mapping[str, Domain] = _Domains()


def obtain(
    domain: Domain, folder: Path, recordings: Path | None, *, quick: bool, progress: OnStep
) -> EpisodeSet | None:
    """The domain's set from `folder`, where it is made or imported on the first call.

    None for recordings that are not below `recordings`. The simulated sets of a quick look lie
    apart from the full ones. Raises UnusableInput for a set that was made of other recordings, by
    other code, of other constants or for another time.
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
    made = replace(made, provenance={**made.provenance, _MADE_BY: _made_by(domain, made)})
    made.write(place)
    return replace(made, folder=place.absolute())


def _made_by(domain: Domain, made: EpisodeSet) -> str:
    """A hash over what determines the set beside minutes and recordings: code and constants."""
    if not domain.module:
        return ""
    parts = [code_sha256(domain.module), str(SEED), domain.settings]
    if "rig_sha256" in made.provenance:
        parts.append(default_rig().sha256)
    return sha256_of("\n".join(parts).encode())


def _require_same(
    place: Path, found: EpisodeSet, domain: Domain, minutes: float, path: Path | None
) -> None:
    """What lies there has to be what would be made or imported now.

    A set that does not say what generated it was put there by hand, and is taken as it is.
    """
    stated = found.provenance
    advice = f"delete {place}, or choose another --out"
    version = wakedeploy.__version__
    if str(stated.get("generator", version)).split()[1:2] not in ([], [version]):
        raise UnusableInput(
            f"{place} was made by {stated['generator']}, this is {version}; {advice}."
        )
    if domain.make is not None and stated.get("minutes", minutes) != minutes:
        raise UnusableInput(f"{place} has {stated['minutes']} minutes, not {minutes}; {advice}.")
    if "generator" in stated and stated.get(_MADE_BY) != _made_by(domain, found):
        raise UnusableInput(
            f"{place} was made by other code or of other constants than are here now; {advice}."
        )
    files = stated.get("files")
    if path is not None and path.is_dir() and isinstance(files, dict):
        _require_recordings(place, files, path, domain.pattern, advice)


def _require_recordings(
    place: Path, files: Mapping[str, JsonValue], path: Path, pattern: str, advice: str
) -> None:
    """The recordings below `path` have to be those that were imported, no more and no fewer."""
    for name, sha256 in files.items():
        there = next((p for p in path.rglob(Path(name).name) if str(p).endswith(name)), None)
        if there is None or sha256_of(there.read_bytes()) != sha256:
            raise UnusableInput(f"{place} was imported from another {name}; {advice}.")
    for new in sorted(path.rglob(pattern)) if pattern else ():
        known = any(str(new).endswith(name) for name in files)
        if not known and not new.name.startswith("."):
            raise UnusableInput(f"{place} was imported without {new.name}; {advice}.")
