"""Recordings are not part of the project: tests that need them are skipped without them."""

from collections.abc import Callable
from pathlib import Path

import needs
import pytest


@pytest.fixture
def recordings() -> Callable[[str], Path]:
    """The folder of a domain's recordings; skips the test where it is absent."""
    return needs.recordings_of
