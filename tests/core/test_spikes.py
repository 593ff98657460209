"""Single numbers far from all others of a column, and events that are none."""

import numpy as np
import pytest

from wakedeploy.core.spikes import spikes_in

RNG = np.random.default_rng(7)
NOISE = 1e-3 * RNG.standard_normal(2000)


@pytest.mark.parametrize("places", [[700], [0, 1999], [3, 400, 1500]])
def test_glitches_are_found_where_they_are(places: list[int]) -> None:
    values = NOISE.copy()
    values[places] = 1.0
    assert spikes_in(values).tolist() == places


@pytest.mark.parametrize("event", [slice(1996, 2000), slice(700, 703), slice(700, 702)])
def test_a_pulse_or_a_step_at_the_end_is_an_event(event: slice) -> None:
    values = NOISE.copy()
    values[event] = 0.5
    assert not len(spikes_in(values))
