"""What the studies' tests share."""

import functools
from collections.abc import Iterator

import drawing
import pytest

from trainers.architectures.esn import EsnHyper
from wakedeploy.domains import downwash


@pytest.fixture(autouse=True, scope="session")
def one_process() -> Iterator[None]:
    """Trainings and flights in this process: another has torch to import, which takes longer.

    That several processes come to the same is tested where that is the question.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wakedeploy.core.parallel.default_workers", lambda: 1)
        yield


@pytest.fixture(autouse=True, scope="module")
def pictures_are_drawn_once() -> Iterator[None]:
    with drawing.each_drawn_once():
        yield


@pytest.fixture(autouse=True, scope="module")
def reservoirs_are_small() -> Iterator[None]:
    """Of 300 neurons where nobody says how many: a thousand take ten times as long."""
    _, *others = EsnHyper.__init__.__defaults__
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EsnHyper.__init__, "__defaults__", (300, *others))
        yield


@pytest.fixture(scope="module")
def short_episodes() -> Iterator[None]:
    """Downwash sets of episodes of 5 s, not of 20: enough where no model has to be good."""
    short = functools.partial(downwash.fly, seconds=5.0)  # where nobody says how long
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(downwash, "fly", short)
        yield
