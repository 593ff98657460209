"""What these tests share."""

from collections.abc import Iterator

import drawing
import pytest


@pytest.fixture(autouse=True, scope="module")
def pictures_are_drawn_once() -> Iterator[None]:
    with drawing.each_drawn_once():
        yield
