"""The one simulated UNO of a test process, and whether there can be one."""

import functools

import pytest

from runtime.virtual.firmware_build import missing_for_the_simulator
from runtime.virtual.simulated_uno import SimulatedUno

MISSING = missing_for_the_simulator()
needs_simulator = pytest.mark.skipif(MISSING is not None, reason=str(MISSING))

the_uno = functools.cache(SimulatedUno)
