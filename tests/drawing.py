"""Pictures of tests that look at something else: each is drawn once in a file, then copied.

Drawing takes longer than what is drawn, a fifth of the time of all that trains, tunes or studies.
"""

import contextlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType

import pytest

from wakedeploy.core import figures


@dataclass(frozen=True)
class _Copy:
    """In the place of a figure: a picture of the same name that the same code drew before."""

    picture: bytes

    def savefig(self, path: Path, **_: object) -> None:
        path.write_bytes(self.picture)


@contextlib.contextmanager
def each_drawn_once() -> Iterator[None]:
    """Later ones by the same code and of the same name are copies, written as `save` writes."""
    save = figures.save
    drawn: dict[tuple[CodeType, str], bytes] = {}

    def once(figure: object, path: Path) -> None:
        picture = sys._getframe(1).f_code, path.name
        if picture in drawn:
            save(_Copy(drawn[picture]), path)
        else:
            save(figure, path)
            drawn[picture] = path.read_bytes()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "save", once)
        yield
