"""Motion and fit agree before anything is compared or shown: friction needs to know the speed."""

import numpy as np
import pytest
from recorded import RIG, flown, with_effects

from wakedeploy.gap.evidence.fits import Fit, extended
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.before_after import Shown, gaps
from wakedeploy.gap.systems.gantry.search.naming import fitted_base, ranked_by_own_motion
from wakedeploy.gap.systems.gantry.search.refitting import refitted

pytestmark = pytest.mark.whole

FRICTION_N = 0.5
TRUTH = with_effects(coulomb_friction={"coulomb_n": (FRICTION_N, "N")})
FRICTION = ("coulomb-friction",)
NAME = "coulomb-friction.coulomb_n"


@pytest.fixture(scope="module")
def base() -> tuple[GantryModel, Fit]:
    """Two flights with ten times the friction that the rig file states, and the base."""
    return fitted_base(GantryModel(RIG, [flown(seed, TRUTH) for seed in (40, 41)]))


@pytest.fixture(scope="module")
def friction(base) -> tuple[GantryModel, Fit]:
    """Friction fitted around its own motion."""
    model, plain = base
    start = extended(plain, model.free(FRICTION))
    return refitted(model, fit(model, FRICTION, range(2), start))


def moved_mps(model: GantryModel, fitted: Fit) -> float:
    """How much another turn moves the speed, the largest over the flights."""
    again = model.around_own_motion(fitted)
    changes = [
        b.nominal[1] - a.nominal[1] for a, b in zip(model.flights, again.flights, strict=True)
    ]
    return max(float(np.sqrt(np.mean(change**2))) for change in changes)


@pytest.mark.slow
def test_another_turn_neither_moves_nor_gains(base, friction) -> None:
    for model, fitted in (base, friction):
        assert moved_mps(model, fitted) < 1e-3  # a quarter of what the speed is known to
        near = model.around_own_motion(fitted)
        again = fit(near, fitted.hypothesis, range(2), fitted.theta)
        assert again.objective == pytest.approx(fitted.objective, abs=1.5)


@pytest.mark.slow
def test_friction_is_as_large_as_it_is_only_around_its_own_motion(base, friction) -> None:
    model, plain = base
    there = fit(model, FRICTION, range(2), extended(plain, model.free(FRICTION)))
    assert there.value(NAME) < 0.9 * FRICTION_N
    assert friction[1].value(NAME) == pytest.approx(FRICTION_N, abs=0.04)
    low, high = friction[1].interval(NAME)
    assert low < FRICTION_N < high


@pytest.mark.slow
def test_contenders_are_ranked_around_their_own_motion(base) -> None:
    model, plain = base
    _, _, ranked = ranked_by_own_motion(model, plain, [*FRICTION, "ground-effect"], 8.0)
    there = fit(model, FRICTION, range(2), extended(plain, model.free(FRICTION)))
    assert ranked[0].name == FRICTION[0]
    assert ranked[0].fit.objective > there.objective + 20.0


@pytest.mark.slow
def test_friction_that_was_found_mends_the_forecasts_of_other_flights(base, friction) -> None:
    sealed = GantryModel(RIG, [flown(42, TRUTH)])
    before = Shown.of(sealed, base[1])
    after = Shown.of(before.model, friction[1])
    assert moved_mps(after.model, friction[1]) < 1e-3
    told = gaps(before, after)["height 0.25 s ahead"]
    assert told.closed > 0.6
    there = Shown.of(before.model, base[1])
    assert told.after < 0.7 * gaps(before, there)["height 0.25 s ahead"].after


@pytest.mark.slow
def test_a_rig_file_with_friction_begins_where_the_readings_are() -> None:
    known = GantryModel(TRUTH, [flown(seed, TRUTH) for seed in (40, 41)])
    model, fitted = fitted_base(known)
    assert fitted.value(NAME) == pytest.approx(FRICTION_N, abs=0.04)
    assert moved_mps(model, fitted) < 5e-4
