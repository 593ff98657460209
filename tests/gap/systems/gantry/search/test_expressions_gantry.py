"""A force hidden in the virtual gantry is found as an expression, written, and flown again."""

import numpy as np
import pytest

from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.expression_terms import TERMS
from wakedeploy.gap.systems.gantry.search.expressions import search, to_effect
from wakedeploy.physics.effects.chain import setting_of
from wakedeploy.rig.file import default_rig, parse_rig

RIG = default_rig()
NAMES = ("constant", "height", "speed", "carriage", "source-rate", "place", "source-place")


def hidden(t_s, state):
    """A force [N] that the rig file does not know."""
    return 0.12 * state["source_thrust_n"] * state["x_m"]


def flown(seed, rig=RIG, hook=None):
    log = record(rig, seconds=12, seed=seed, force_hook=hook, model_rig=RIG)
    return flight_from_log(log.without_truth(), RIG, f"flight {seed}")


@pytest.fixture(scope="module")
def found():
    """The expression found on two flights with the hidden force."""
    terms = {name: TERMS[name] for name in NAMES}
    model = GantryModel(RIG, [flown(seed, hook=hidden) for seed in (1, 2)], terms)
    first = fit(model, (), (0, 1), model.start(()))
    model = model.around_own_motion(first)
    base = fit(model, (), (0, 1), first.theta)
    return search(model, base, setting=vars(setting_of(RIG)), names=NAMES)


@pytest.mark.slow
def test_the_hidden_force_is_found_with_its_size(found):
    assert found.terms == ("source-place",)
    assert found.coordinates == ("source_n", "x_m")
    size = found.coefficients[0]
    assert size.low < 0.12 < size.high
    assert size.value == pytest.approx(0.12, rel=0.2)
    assert found.gain_nats > 30


@pytest.mark.slow
def test_a_rig_with_the_expression_flies_as_the_hidden_force_does(found):
    corrected = parse_rig(RIG.model_copy(update={"effect": (to_effect(found),)}).text)
    with_hook, with_file = (
        record(rig, seconds=6, seed=5, force_hook=hook, model_rig=RIG)
        for rig, hook in ((RIG, hidden), (corrected, None))
    )
    without = record(RIG, seconds=6, seed=5, model_rig=RIG)
    truth, again, old = (np.asarray(log["true_z_m"]) for log in (with_hook, with_file, without))
    count = min(len(truth), len(again), len(old))
    away = np.abs(truth[:count] - old[:count]).mean()
    assert np.abs(truth[:count] - again[:count]).mean() < 0.2 * away
