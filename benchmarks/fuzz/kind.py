"""A kind of file: sound ones, what reads them, and how they are damaged, again and again alike.

A file is made again from its kind, the seed of the run and its number. What a person hands over is
at times a folder, so every sound example is one: names with their contents.
"""

import contextlib
import fnmatch
import io
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.fuzz.text import Mutator, any_text

SLOWEST_S = 2.0  # of processor time, to read one file
Files = Mapping[str, bytes]
Mend = Callable[[random.Random, dict[str, bytes]], None]

_BOTH = 0.1  # of the folders with several files, two are damaged


def unmended(draw: random.Random, files: dict[str, bytes]) -> None:
    """Hashes and sums stay as they are."""


@dataclass(frozen=True)
class Kind:
    """`sound` folders of one kind, each of which `read` takes without a word.

    `ways`: how a file is damaged, by a pattern of its name; what no pattern fits is damaged as
    text. `mend` puts hashes right in some of the damaged folders, or nothing behind them would ever
    be looked at. A refusal has to name a damaged file, the folder, or one of `names`. `writes` says
    that the reader changes the folder. `slowest_s` is more than usual where the reader draws.
    """

    name: str
    what: str
    sound: tuple[Files, ...]
    read: Callable[[Path], object]
    ways: Mapping[str, Mutator] = field(default_factory=dict)
    mend: Mend = unmended
    names: tuple[str, ...] = ()
    writes: bool = False
    slowest_s: float = SLOWEST_S

    def damaged(self, seed: int, number: int) -> tuple[Files, dict[str, bytes]]:
        """A sound folder, and the files of it that are damaged in the folder of this number."""
        draw = random.Random(f"{self.name}/{seed}/{number}")
        sound = draw.choice(self.sound)
        there = dict(sound)
        names = draw.sample(list(sound), 2 if len(sound) > 1 and draw.random() < _BOTH else 1)
        for name in names:
            other = draw.choice(self.sound).get(name, sound[name])
            there[name] = self._way(name)(draw, sound[name], other)
        self.mend(draw, there)
        return sound, {n: content for n, content in there.items() if content != sound.get(n)}

    def _way(self, name: str) -> Mutator:
        fitting = (way for pattern, way in self.ways.items() if fnmatch.fnmatch(name, pattern))
        return next(fitting, any_text)


def put(folder: Path, files: Files) -> None:
    """Write files below a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        path = folder / name
        if "/" in name:
            path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def taken(folder: Path) -> dict[str, bytes]:
    """All files below a folder, by their path in it."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@contextlib.contextmanager
def spoken() -> Iterator[None]:
    """What commands print goes nowhere, but has to be what a terminal takes."""
    with io.TextIOWrapper(io.BytesIO(), "utf-8") as away:
        with contextlib.redirect_stdout(away), contextlib.redirect_stderr(away):
            yield
        away.flush()
