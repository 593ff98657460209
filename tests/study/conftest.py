"""What the studies' tests share."""

import functools
from collections.abc import Iterator

import pytest

from wakedeploy.domains import downwash


@pytest.fixture(autouse=True, scope="session")
def one_process() -> Iterator[None]:
    """Trainings and flights in this process: another has torch to import, which takes longer.

    That several processes come to the same is tested where that is the question.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wakedeploy.core.parallel.default_workers", lambda: 1)
        yield


@pytest.fixture(scope="module")
def short_episodes() -> Iterator[None]:
    """Downwash sets of episodes of 5 s, not of 20: enough where no model has to be good."""
    short = functools.partial(downwash.fly, seconds=5.0)  # where nobody says how long
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(downwash, "fly", short)
        yield
