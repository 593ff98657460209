"""A folder that steps work in: one of them at a time."""

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from wakedeploy.core.errors import UnusableInput, why
from wakedeploy.core.files import absent, remove_unfinished
from wakedeploy.core.locks import alone

RUN_LOG = "a run log, .mcap or .csv"
LOG = (
    "a log (.csv, .npz, .mat, .h5, .parquet, .mcap, .db3 or .ulg), or a folder of files that "
    "belong together"
)


@contextlib.contextmanager
def at_work(folder: Path) -> Iterator[None]:
    """Nobody else takes steps in this folder meanwhile; what a killed one was writing is removed.

    UnusableInput where somebody does: artefacts of two would be of different flights.
    """
    with alone(folder, "Another gap command", "gap"):
        for place in (folder, folder / "figures"):
            remove_unfinished(place)
        yield


def made(folder: Path) -> Path:
    """The folder, made where it was not there; UnusableInput where nothing can be written to it.

    Minutes of fitting should not end at a full or foreign disk.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise UnusableInput(
            f"{folder}: cannot be written to ({why(error)}); choose another --out."
        ) from error
    return folder


def require_logs(measured: Sequence[Path], accepted: str) -> None:
    """UnusableInput for a log that is not there, before a folder is made for what it would give.

    `accepted` is what the sentence asks for: `RUN_LOG` of a rig, `LOG` of a system.
    """
    for path in measured:
        if not path.exists():
            raise UnusableInput(absent(path, accepted))
