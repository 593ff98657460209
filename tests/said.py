"""What commands say on stderr, but for how far they are, which hangs on the machine's speed."""

import re

_HOW_FAR = re.compile(r"( …|: \d+ %(, .*)?|: \d+ of \d+, .*|: .* so far|: done in .*)$")


def sentences(stderr: str) -> list[str]:
    """The lines that do not tell how far a command is."""
    return [line for line in stderr.strip().splitlines() if not _HOW_FAR.search(line)]
