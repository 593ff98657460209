"""All kinds of files that a person can hand over, by their names."""

from collections.abc import Callable, Iterable

from benchmarks.fuzz import gantry, gap, learning, logs, recordings, systems, tuning
from benchmarks.fuzz.kind import Kind

MAKE: dict[str, Callable[[], Kind]] = {
    **gantry.kinds(),
    **learning.kinds(),
    **tuning.kinds(),
    **gap.kinds(),
    **recordings.kinds(),
    **logs.kinds(),
    **systems.kinds(),
}


def made(names: Iterable[str] = tuple(MAKE)) -> dict[str, Kind]:
    """The kinds of these names; some fly or train for what they begin with, which takes seconds."""
    return {name: MAKE[name]() for name in names}
