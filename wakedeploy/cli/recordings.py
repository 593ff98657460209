"""Where public recordings are looked for: where the user says, or in `WAKEDEPLOY_DATA`."""

import os
from pathlib import Path

from wakedeploy.core.errors import UnusableInput

VARIABLE = "WAKEDEPLOY_DATA"


def recordings_folder(given: Path | None) -> Path | None:
    """The folder with a subfolder for each domain: `given`, or the variable's, or None.

    Raises UnusableInput for one that is not there.
    """
    chosen = given if given is not None else os.environ.get(VARIABLE) or None
    if chosen is None:
        return None
    folder = Path(chosen)
    if not folder.is_dir():
        source = "--recordings" if given is not None else VARIABLE
        raise UnusableInput(f"{folder} is no folder; give {source} one that is there.")
    return folder
