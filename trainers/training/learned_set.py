"""The set that a run was trained on, found again by its hash."""

from pathlib import Path

from trainers.training.runs import TrainedRun
from wakedeploy.core.episodes import DESCRIPTION, EpisodeSet, read_episode_set, stated_sha256
from wakedeploy.core.errors import UnusableInput

_DEPTH = 4  # how many folders down the set of a run is looked for


def episodes_of(run: TrainedRun) -> EpisodeSet:
    """The set that the run knows, or one below this folder with its hash."""
    known, wanted = run.metrics.data_folder, run.config.data_sha256
    places = [] if known is None else [Path(known)]
    for depth in range(1, _DEPTH + 1):
        places += sorted(path.parent for path in Path().glob(f"{'*/' * depth}{DESCRIPTION}"))
    found = next((place for place in places if _hash_of(place) == wanted), None)
    if found is not None:
        return read_episode_set(found)
    where = f"The set that {run.folder} was trained on is not near this folder"
    if known is not None:
        happened = "is no longer there" if _hash_of(Path(known)) is None else "has changed since"
        where = f"The set that {run.folder} was trained on lay in {known} and {happened}"
    raise UnusableInput(f"{where}; say where it is now: --data FOLDER (in Python, data=…).")


def _hash_of(folder: Path) -> str | None:
    """The content hash that a set states; None for what is no set, as many a dataset.json."""
    try:
        return stated_sha256(folder)
    except UnusableInput:
        return None
