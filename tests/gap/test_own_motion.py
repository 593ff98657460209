"""Motion and fit agree before anything is compared or shown: friction needs to know the speed."""

import pytest
from recorded import RIG, flown, with_effects

from wakedeploy.gap.gantry import GantryModel
from wakedeploy.gap.inference import Fit, extended, fit
from wakedeploy.gap.naming import fitted_base, refitted
from wakedeploy.gap.showing import Shown, gaps

TRUTH = with_effects(coulomb_friction={"coulomb_n": (0.25, "N")})
FRICTION = ("coulomb-friction",)


@pytest.fixture(scope="module")
def fits() -> tuple[GantryModel, Fit, Fit]:
    """Two flights with more friction than the rig file says: the base, and friction fitted."""
    model, base = fitted_base(GantryModel(RIG, [flown(seed, TRUTH) for seed in (40, 41)]))
    start = extended(base, model.free(FRICTION))
    return model, base, refitted(model, fit(model, FRICTION, range(2), start))[1]


def test_another_motion_makes_a_base_hardly_more_likely(fits) -> None:
    model, base, _ = fits
    for _ in range(3):
        model = model.relinearised(base)
        again = fit(model, (), range(2), base.theta)
        assert again.objective < base.objective + 1.0
        base = again


def test_friction_is_found_as_large_as_it_is(fits) -> None:
    name = "coulomb-friction.coulomb_n"
    assert fits[2].value(name) == pytest.approx(0.25, abs=0.01)
    low, high = fits[2].interval(name)
    assert low < 0.25 < high


def test_friction_that_was_found_mends_the_forecasts_of_other_flights(fits) -> None:
    _, base, found = fits
    sealed = GantryModel(RIG, [flown(42, TRUTH)])
    before = Shown.of(sealed, base)
    after = Shown.of(before.model, found)
    told = gaps(before, after)["height 0.25 s ahead"]
    assert told["closed"] > 0.8
    assert told["after"] < 0.6 * told["before"]
