"""Sizes as they are told: whether one is an estimate, or where the library's range ends."""

import pytest
from recorded import RIG, flown

from wakedeploy.gap.account import account
from wakedeploy.gap.answered import _sizes
from wakedeploy.gap.close import _entry
from wakedeploy.gap.gantry import GantryModel
from wakedeploy.gap.inference import extended, fit
from wakedeploy.gap.naming import fitted_base
from wakedeploy.physics.effects import LIBRARY

STRONG, WEAK = "axial-inflow-loss", "battery-sag"
LOST_S_PER_M, GROWING_PER_S = 0.9, 0.003


def beyond_the_bounds(t_s, state) -> float:
    """A force [N]: more thrust lost than the library allows, and a battery that gains charge."""
    return state["sufferer_thrust_n"] * (GROWING_PER_S * t_s - LOST_S_PER_M * state["vz_mps"])


@pytest.fixture(scope="module")
def told() -> dict[str, dict]:
    """Both effects' sizes in two flights."""
    model = GantryModel(RIG, [flown(seed, hook=beyond_the_bounds) for seed in (51, 52)])
    model, base = fitted_base(model)
    both = (STRONG, WEAK)
    found = fit(model, both, base.episodes, extended(base, model.free(both)))
    return {name: _sizes(found, name) for name in both}


def test_a_size_at_the_end_of_its_range_is_marked_and_told(told) -> None:
    (loss,) = LIBRARY[STRONG].parameters
    size = told[STRONG]["loss_s_per_m"]
    assert size["value"] == loss.high < LOST_S_PER_M
    assert size["at_bound"] is True
    words = account({"verdict": "named", "effects": [{"name": STRONG, "parameters": told[STRONG]}]})
    assert "The loss of axial-inflow-loss stands at the end of its range" in words
    assert "may have another shape, or be stronger than the library allows" in words
    beside = [{"name": STRONG, "parameters": told[STRONG]}]
    assert "stands at the end of its range" in account({"verdict": "unknown", "beside": beside})


def test_no_effect_at_all_is_an_estimate(told) -> None:
    size = told[WEAK]["sag_per_s"]
    assert size["value"] == 0.0
    assert "at_bound" not in size
    words = account({"verdict": "named", "effects": [{"name": WEAK, "parameters": told[WEAK]}]})
    assert "range" not in words


def test_the_rig_file_has_the_size_without_the_mark(told) -> None:
    written = _entry({"name": STRONG, "parameters": told[STRONG]}, "ab" * 32, "2026-01-01")
    stated = written.parameters["loss_s_per_m"].model_dump()
    assert stated == {k: v for k, v in told[STRONG]["loss_s_per_m"].items() if k != "at_bound"}
