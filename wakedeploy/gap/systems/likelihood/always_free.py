"""What is free in every hypothesis: noise, clocks within a sample, constants, and form.

In: a `System` and how large its quantities usually are. Out: parameters with their priors, of
noise and pushes as logarithms.
"""

from collections.abc import Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import FloatArray, Free
from wakedeploy.gap.systems.kinds.library import rate_unit
from wakedeploy.gap.systems.likelihood.augmented import BUMPS, FORM_EACH, FORM_MOST
from wakedeploy.gap.systems.likelihood.usual_sizes import Sizes
from wakedeploy.gap.systems.system import StateSpace

_LN_SD = 2.0
# ln sd by which a sensor may be better than stated or guessed: a filter that trusts a sensor
# without limit takes the moment within a sample at which a force turned for a force.
_BETTER, _MUCH_BETTER = 1.0, 6.0
_USUAL_PUSH, _SHORTEST_PUSH, _LONGEST_PUSH = 15, 2, 300  # samples that a push on a rate lasts


def sensor_noise(system: StateSpace, sizes: Sizes) -> list[Free]:
    """Logarithms of the noise of sensors."""
    parameters = []
    for output in system.outputs:
        size = sizes[f"y {output.name}"]
        guess = float(np.log(output.noise or 0.01 * size))
        better = _BETTER if output.noise else _MUCH_BETTER
        name, bounds = f"noise.{output.name}", (guess - better, float(np.log(10.0 * size)))
        parameters.append(Free(name, output.unit, guess, _LN_SD, *bounds, 0.01))
    return parameters


def pushes(
    system: StateSpace, sizes: Sizes, driven: Sequence[str], dt_s: float, *, is_pushed: bool
) -> list[Free]:
    """Logarithms of the noise of driven states' rates, and of pushes that last if `is_pushed`."""
    parameters = []
    for name in driven:
        rate = sizes[f"d {name}"]
        guess = float(np.log(system.process_noise.get(name, 0.2 * rate)))
        unit = rate_unit(system.states[name])
        bounds = float(np.log(1e-7 * rate)), float(np.log(100.0 * rate))
        parameters.append(Free(f"force.{name}", unit, guess, _LN_SD, *bounds, 0.01))
        if is_pushed:
            parameters += _lasting(name, unit, rate, dt_s)
    return parameters


def _lasting(name: str, unit: str, rate: float, dt_s: float) -> list[Free]:
    """Logarithms of the sd and the duration of a push that lasts."""
    guess, bounds = float(np.log(0.1 * rate)), np.log([1e-6 * rate, 30.0 * rate])
    shortest, longest = np.log([_SHORTEST_PUSH * dt_s, _LONGEST_PUSH * dt_s])
    usual = float(np.log(_USUAL_PUSH * dt_s))
    return [
        Free(f"push.{name}", unit, guess, _LN_SD, float(bounds[0]), float(bounds[1]), 0.01),
        Free(f"lasting.{name}", "s", usual, 1.0, float(shortest), float(longest), 0.02),
    ]


def clocks(names: Sequence[str], dt_s: float) -> list[Free]:
    """Clocks: an input may act up to half a sample sooner or later than its row says.

    Commands of one row do so alike: one that acts later than another has a delay.
    """
    half = 0.5 * dt_s
    return [
        Free(f"clock.{name}", "s", 0.0, half / 3.0**0.5, -half, half, 0.02 * dt_s) for name in names
    ]


def constants(system: StateSpace) -> list[Free]:
    """Constants that have a spread, each about its stated value."""
    parameters = []
    for c in system.constants:
        if c.spread > 0.0:
            step = 1e-3 * (abs(c.value) or 1.0)
            if np.isfinite(c.spread):
                step = 0.02 * c.spread
                if c.keeps_sign:
                    step = min(step, 0.01 * abs(c.value))
            name, unit = f"constant.{c.name}", system.unit_of_constant(c.name)
            parameters.append(Free(name, unit, c.value, c.spread, *c.bounds, step, quantity=c.name))
    return parameters


def form(system: StateSpace, sizes: Sizes, driven: Sequence[str], states: FloatArray) -> list[Free]:
    """Bumps of the model-form term, in the range of the states (n, N) along all logs."""
    bumps = []
    for name in driven:
        at = states[list(system.states).index(name)] / sizes[name]
        low, high = at.min() - 0.4, at.max() + 0.4
        for k, centre in enumerate(BUMPS):
            if low <= centre <= high:
                bumps.append(
                    Free(f"form.{name}.{k}", "1", 0.0, FORM_EACH, -FORM_MOST, FORM_MOST, 0.002)
                )
    return bumps
