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
    """Later ones by the same code and of the same name are copies, written as `save` writes.

    Where a picture has its flight's name, the code alone decides.
    """
    save = figures.save
    drawn: dict[tuple[CodeType, str], bytes] = {}

    def once(figure: object, path: Path) -> None:
        caller = sys._getframe(1)
        named_by_flight = caller.f_globals["__name__"] == "wakedeploy.cli.log"
        picture = caller.f_code, path.suffix if named_by_flight else path.name
        if picture in drawn:
            save(_Copy(drawn[picture]), path)
        else:
            save(figure, path)
            drawn[picture] = path.read_bytes()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "save", once)
        yield
