"""The model's own form: how large its correction is, and what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import RIG, flown

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.separation import gain_nats, gather, lost_to_form
from wakedeploy.gap.systems.gantry.discrepancy import (
    FormedWorld,
    drawn,
    free_terms,
    friction_basis,
    friction_n,
    places_of,
    wake_basis,
    wake_factor,
)
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.physics.constants import constants_of
from wakedeploy.rig.file import default_rig, parse_rig

PLACES = np.linspace(-3.5, 3.5, 701)
AXIS = np.exp(-0.5 * PLACES**2)  # the air's speed across a Gaussian jet, over that on its axis
LEVEL = np.zeros_like(PLACES)


def force_shares(rig, count: int = 400) -> np.ndarray:
    """What drawn corrections change in the force, over the force on the axis (count, places)."""
    rng = np.random.default_rng(3)
    basis = wake_basis(PLACES, LEVEL)
    factors = [wake_factor(drawn(rig, rng), basis) for _ in range(count)]
    return np.array([AXIS**2 * (factor**2 - 1.0) for factor in factors])


def test_the_correction_is_as_large_as_the_rig_file_states() -> None:
    """5 % of the force on the axis; the odd pairs vanish there, beside it they add to it."""
    shares = force_shares(default_rig())
    spread = shares.std(axis=0)
    assert spread[350] == pytest.approx(0.05, rel=0.25)
    assert spread.max() < 0.085
    assert spread[np.abs(PLACES) > 3.4].max() < 0.01


def test_a_rig_file_may_state_another_size_or_none() -> None:
    twice = default_rig().changed(discrepancy={"wake": 0.1})
    assert force_shares(twice).std() == pytest.approx(2.0 * force_shares(RIG).std(), rel=0.05)
    exact = default_rig().changed(discrepancy={"wake": 0.0, "friction": 0.0})
    assert free_terms(exact) == ()
    with pytest.raises(UnusableInput, match=r"discrepancy\.wake"):
        default_rig().changed(discrepancy={"wake": 0.6})


def test_a_rig_without_the_section_keeps_its_hash_and_one_with_it_reads_back() -> None:
    assert "discrepancy" not in default_rig().text
    stated = default_rig().changed(discrepancy={"wake": 0.08})
    assert parse_rig(stated.text).discrepancy.wake == 0.08


@pytest.mark.parametrize("row", [6, 7, 8])
def test_a_skew_jet_is_no_shifted_axis(row) -> None:
    """The force that an odd pair adds is orthogonal to that of a small shift, as flights see both.

    The wake's unrest grows with its force, so that a flank tells somewhat more than the axis.
    """
    flown = np.abs(PLACES) <= 3.0
    sd = np.sqrt(AXIS**4 + 1.0)
    odd = AXIS * wake_basis(PLACES, np.zeros_like(PLACES))[row]
    pair = (2.0 * AXIS * odd / sd)[flown]
    shifted = ((np.exp(-0.5 * (PLACES - 1e-4) ** 2) ** 2 - AXIS**2) / sd)[flown]
    cosine = pair @ shifted / np.linalg.norm(pair) / np.linalg.norm(shifted)
    assert abs(cosine) < 0.01


def test_places_are_counted_in_widths_of_the_jet_there() -> None:
    """On the axis of the closed form's steady jet, one width aside 60.7 % of the speed is left."""
    constants = constants_of(RIG)
    below, ages = 1.4, np.arange(0.0005, 1.0, 0.001)
    width2 = constants["wake.width_m"] ** 2 + 2.0 * constants["wake.diffusivity_m2ps"] * ages
    along = below - constants["wake.speed_mps"] * ages
    puffs = np.exp(-0.5 * along**2 / width2 - constants["wake.decay_per_s"] * ages) / width2
    x = 0.1
    profile = float((puffs * np.exp(-0.5 * x**2 / width2)).sum() / puffs.sum())
    (place,) = places_of(constants, 2.0, np.array([x]), np.array([2.0 - below]))
    assert np.exp(-0.5 * place**2) == pytest.approx(profile, rel=0.02)


def test_friction_bends_against_the_motion() -> None:
    sizes = {"discrepancy.friction.speed1": 0.5}
    speeds = np.array([-0.1, 0.0, 0.1, 1.0])
    basis = friction_basis(speeds, np.zeros(4))
    bent = friction_n(RIG, sizes, basis)
    assert bent == pytest.approx([-0.025, 0.0, 0.025, 0.0], abs=1e-6)  # half of 0.05 N
    assert not friction_n(RIG, {}, basis).any()


def test_every_hypothesis_has_the_correction_and_it_is_no_bent_constant() -> None:
    model = GantryModel(RIG, [flown(51)])
    for hypothesis in ((), ("ground-effect",)):
        names = [f.name for f in model.free(hypothesis) if f.name.startswith("discrepancy.")]
        assert names == [f.name for f in free_terms(RIG)]
    theta = model.start(())
    moved = np.array([f.prior_sd if f.is_form else 0.0 for f in model.free(())])
    before, after = (model.score((), t, 0).innovation for t in (theta, theta + moved))
    assert np.abs(after - before).max() > 1e-4


@pytest.mark.whole
def test_a_world_of_the_model_s_own_form_is_the_plain_plant() -> None:
    """Two implementations: hooks around the closed form, and the plant without any."""
    world = FormedWorld(
        RIG, dict.fromkeys((f.name for f in free_terms(RIG)), 0.0), constants_of(RIG)
    )
    plain, formed = (record(RIG, seconds=2.0, seed=4, **h) for h in ({}, world.hooks()))
    assert formed["range_m"] == pytest.approx(plain["range_m"], abs=1e-9, nan_ok=True)


def test_what_the_form_takes_of_an_effect_is_what_an_exact_model_would_not_lose() -> None:
    """Against evidence from which the form's rows and columns were taken."""
    names, model = ("viscous-friction", "range-drift"), GantryModel(RIG, [flown(51), flown(52)])
    base = fit(model, (), range(2), model.start(()))
    evidence = gather(model, base, names)
    exact = [i for i, f in enumerate(base.free) if not f.is_form]
    kept = [*exact, *range(len(base.free), evidence.gram.shape[1])]
    gram = evidence.gram[:, kept][:, :, kept]
    alone = gain_nats(replace(evidence, precision=evidence.precision[exact], gram=gram))
    lost = lost_to_form(evidence, base.free)
    assert lost == pytest.approx(1.0 - gain_nats(evidence) / alone, abs=1e-3)
    assert lost[0] > 0.1 > 0.05 > lost[1]  # friction has a form, a sensor's drift none
