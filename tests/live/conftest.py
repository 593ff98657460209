"""Every test with a browser: the console must stay silent."""

import pytest


@pytest.fixture(autouse=True)
def silent_console(request):
    """No exception, no error and no refused file on any page that a test has opened."""
    yield
    if "browser" in request.fixturenames:
        assert request.getfixturevalue("browser").complaints() == []
