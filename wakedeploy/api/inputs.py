"""What every function takes: a thing, or the path of the file or folder that holds it."""

import os
from pathlib import Path

from wakedeploy.core.episodes import EpisodeSet, read_episode_set
from wakedeploy.core.files import path_from
from wakedeploy.core.rig import Rig
from wakedeploy.rig.file import default_rig, read_rig

PathLike = str | os.PathLike[str]


def episode_set(data: EpisodeSet | PathLike) -> EpisodeSet:
    """The set, read from its folder where a path is given."""
    return data if isinstance(data, EpisodeSet) else read_episode_set(path_from(data, "data"))


def rig_of(rig: Rig | PathLike | None, name: str = "rig") -> Rig:
    """The rig, read from its file where a path is given; the default rig for None."""
    if rig is None:
        return default_rig()
    return rig if isinstance(rig, Rig) else read_rig(path_from(rig, name))


def path_of(place: PathLike | None, name: str) -> Path | None:
    """The path that an argument of this name gives, or None."""
    return None if place is None else path_from(place, name)
