"""Recordings are not part of the project: tests that need them are skipped without them."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

DATA = Path(os.environ.get("WAKEDEPLOY_DATA", Path(__file__).parents[4] / "shared" / "data"))


@pytest.fixture
def recordings() -> Callable[[str], Path]:
    """The folder of a domain's recordings; skips the test where it is absent."""

    def folder(domain: str) -> Path:
        if not (DATA / domain).is_dir():
            pytest.skip(f"no recordings at {DATA / domain}; set WAKEDEPLOY_DATA")
        return DATA / domain

    return folder
