"""Sizes as they are told: whether one is an estimate, or where the library's range ends."""

import pytest
from fabricated_artefacts import summary
from recorded import RIG, based, flown

from wakedeploy.gap.evidence.fits import extended
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.report.summary import account
from wakedeploy.gap.systems.gantry.findings import Sized, Sizes
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.answer import bent, sizes_of
from wakedeploy.gap.systems.gantry.search.correction import entry_of
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.physics.constants import with_constants
from wakedeploy.physics.effects import LIBRARY

STRONG, WEAK = "axial-inflow-loss", "battery-sag"
LOST_S_PER_M, GROWING_PER_S = 0.9, 0.003


def beyond_the_bounds(t_s, state) -> float:
    """A force [N]: more thrust lost than the library allows, and a battery that gains charge."""
    return state["sufferer_thrust_n"] * (GROWING_PER_S * t_s - LOST_S_PER_M * state["vz_mps"])


@pytest.fixture(scope="module")
def told() -> dict[str, Sizes]:
    """Both effects' sizes in two flights."""
    model = GantryModel(RIG, [flown(seed, hook=beyond_the_bounds) for seed in (51, 52)])
    model, base = fitted_base(model)
    both = (STRONG, WEAK)
    found = fit(model, both, base.episodes, extended(base, model.free(both)))
    return {name: sizes_of(found, name) for name in both}


@pytest.mark.slow
def test_a_size_at_the_end_of_its_range_is_marked_and_told(told) -> None:
    (loss,) = LIBRARY[STRONG].parameters
    size = told[STRONG]["loss_s_per_m"]
    assert size.value == loss.high < LOST_S_PER_M
    assert size.at_bound
    words = account(
        summary({"verdict": "named", "effects": [{"name": STRONG, "parameters": told[STRONG]}]})
    )
    assert "The loss of axial-inflow-loss stands at the end of its range" in words
    assert "may have another shape, or be stronger than the library allows" in words
    beside = [{"name": STRONG, "parameters": told[STRONG]}]
    assert "stands at the end of its range" in account(
        summary({"verdict": "unknown", "beside": beside})
    )


@pytest.mark.slow
def test_no_effect_at_all_is_an_estimate(told) -> None:
    size = told[WEAK]["sag_per_s"]
    assert size.value == 0.0
    assert not size.at_bound
    words = account(
        summary({"verdict": "named", "effects": [{"name": WEAK, "parameters": told[WEAK]}]})
    )
    assert "range" not in words


@pytest.mark.slow
def test_an_effect_whose_interval_holds_nothing_is_doubted(told) -> None:
    assert told[WEAK]["sag_per_s"].holds_neutral
    assert not told[STRONG]["loss_s_per_m"].holds_neutral
    for name, doubted in ((WEAK, True), (STRONG, False)):
        words = account(
            summary({"verdict": "named", "effects": [{"name": name, "parameters": told[name]}]})
        )
        assert (f"Doubt {name}: its interval reaches" in words) is doubted


@pytest.mark.slow
def test_the_rig_file_has_the_size_without_the_mark(told) -> None:
    written = entry_of(Sized(name=STRONG, parameters=told[STRONG]), "ab" * 32, "2026-01-01")
    stated = written.parameters["loss_s_per_m"].model_dump()
    assert stated == told[STRONG]["loss_s_per_m"].model_dump(
        include={"value", "low", "high", "unit"}
    )


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "names"), [(1.0, []), (0.87, ["thrust.sufferer.scale"])])
def test_a_constant_that_had_to_be_bent_is_told(scale, names) -> None:
    """Whatever the verdict: what is shown is of the rig file with it, and not as it is."""
    if scale == 1.0:
        _, base = based(51, 52, 53)
    else:
        truth = with_constants(RIG, {"thrust.sufferer.scale": scale})
        _, base = fitted_base(GantryModel(RIG, [flown(seed, truth) for seed in (51, 52)]))
    told = bent(base)
    assert [one.name for one in told] == names
    words = account(summary({"verdict": "none", "calibration": told}))
    assert ("Calibrate it again" in words) is bool(names)
    for one in told:
        assert one.fitted == pytest.approx(scale, abs=0.01)
        assert one.away_sd == pytest.approx(abs(one.fitted - 1.0) / 0.03)
        assert f"at {one.fitted:.3g}, where the rig file has 1 ± 0.03" in words


def test_what_is_noise_is_not_told_while_something_is_missing() -> None:
    gap = {
        "height 0.25 s ahead": {"before": 0.014, "after": 0.014, "noise_floor": 0.013, "unit": "m"}
    }
    words = {
        v: account(summary({"verdict": v, "gap": gap, "flights": 4})) for v in ("none", "unknown")
    }
    assert "noise alone: 13.0 mm" in words["none"]
    assert "noise alone" not in words["unknown"]
    assert "not known while something is missing" in words["unknown"]
