"""Names of a MuJoCo model's elements, as parts of the names of a system.

In: an element's name. Out: letters, digits and underscores.
"""

import re
from pathlib import Path

from wakedeploy.core.errors import UnusableInput


def word(path: Path, name: str, what: str, number: int) -> str:
    """An element's name as part of a Python name; UnusableInput for an element without one."""
    identifier = re.sub(r"\W+", "_", name).strip("_").lower()
    if not identifier:
        article = "an" if what[0] in "aeiou" else "a"
        raise UnusableInput(
            f"{path}: {article} {what} has no name (number {number + 1} of the model), and logs "
            'refer to it by name; add name="..." to its element.'
        )
    identifier = identifier if identifier[0].isalpha() else f"{what}_{identifier}"
    if not identifier.isidentifier():  # as with ²
        raise UnusableInput(f"{path}: {what} {name!r}: give it a name of letters and digits.")
    return identifier
