"""The flag: a delay that is put in comes out, and the recorded one is not its alias."""

import numpy as np
import pytest

from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.systems.domains.fish import FishModel, delay_profile, open_model


def made(delay_s: float, seconds: float = 42.0) -> FishModel:
    """A foil that flaps at 3.27 Hz and startles now and then; the tip follows late."""
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, seconds, 1.0 / 30.0)
    startles = sum(
        np.sign(rng.normal()) * np.exp(-(((time_s - at) / 0.15) ** 2))
        for at in np.arange(3.0, seconds, 4.3)
    )
    angle = 0.19 * np.sin(2 * np.pi * 3.27 * time_s + rng.normal(0, 0.02, len(time_s)).cumsum())
    angle = angle + 0.5 * startles
    flow = 0.36 + 0.02 * rng.normal(size=len(time_s))
    late = np.interp(time_s - delay_s, time_s, angle)
    tip_m = 0.035 * late + 0.001 * rng.normal(size=len(time_s))
    return FishModel(np.column_stack([angle, flow, np.zeros_like(flow)]), tip_m)


def test_a_delay_that_was_put_in_is_named():
    model = made(0.25)
    base = fit(model, (), range(model.episodes))
    best = rank(model, base, ("lag", "transport-delay", "flow-delay", "saturation"))[0]
    assert best.name == "transport-delay"
    assert best.fit.value("transport-delay.delay_s") == pytest.approx(0.25, abs=0.005)


@pytest.mark.whole
def test_the_recorded_delay_is_a_third_of_a_second_and_not_its_alias(recordings):
    whole = open_model(recordings("fish"))
    model = whole.first(6)
    delays_s = np.array([0.15, 0.183, 0.333, 0.483])
    profile = delay_profile(model, delays_s)
    assert profile[2] > np.delete(profile, 2).max() + 100


def test_the_phase_delay_of_a_pure_delay_is_that_delay_at_every_frequency():
    told = made(0.25, seconds=240.0).phase_delay(near_s=0.25)
    assert len(told["delay_s"]) > 5
    assert told["delay_s"] == pytest.approx([0.25] * len(told["delay_s"]), abs=0.02)
