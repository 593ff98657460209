"""The one simulated UNO of a test process."""

import functools

from runtime.virtual.simulated_uno import SimulatedUno

the_uno = functools.cache(SimulatedUno)
