"""What sealed flights make of an answer: it matters, it is too small, or it is withdrawn."""

import numpy as np
import pytest
from recorded import RIG, flown

from wakedeploy.gap.evidence.fits import Fit, Slopes
from wakedeploy.gap.report.summary import account, verdict_sentence
from wakedeploy.gap.systems.gantry.artefacts import Name
from wakedeploy.gap.systems.gantry.effect_force import Cost, force_of, tracking_error
from wakedeploy.gap.systems.gantry.findings import Effect
from wakedeploy.gap.systems.gantry.folder import StepArtefacts
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.importance import Mattering, Removed, removed
from wakedeploy.gap.systems.gantry.search.judgement import judged, parts_of, unexplained
from wakedeploy.gap.systems.gantry.search.naming import with_terms
from wakedeploy.physics.effects.chain import default_lead_s

NAMED = Name(verdict="named", effects=[Effect(name="crosswind-offset")])


def worth(
    near: float,
    far: float,
    nats: float,
    reach: float = 0.01,
    placebo: float = 0.0,
    far_placebo: float = 0.0,
):
    return Mattering(
        {
            0.25: Removed(near, near - reach, near + reach),
            1.0: Removed(far, far - reach, far + reach),
        },
        nats,
        Cost(0.02, 0.001, 0.0008, 0.0012),
        {0.25: placebo, 1.0: far_placebo},
        1.0,
    )


def test_paired_blocks_tell_a_share_that_unpaired_ones_could_not() -> None:
    """Errors of very different blocks, of which a tenth of the square is taken away in each."""
    rng = np.random.default_rng(1)
    before = [scale * rng.standard_normal(60) for scale in (1.0, 5.0, 2.0, 4.0, 3.0, 1.5)]
    after = [np.sqrt(0.9) * block for block in before]
    told = removed(before, after)
    assert told.share == pytest.approx(0.1)
    assert 0.0 < told.low < 0.1 < told.high < 0.2


def test_errors_without_a_difference_leave_zero_in_the_interval() -> None:
    rng = np.random.default_rng(2)
    before = [rng.standard_normal(60) for _ in range(20)]
    after = [block + 0.3 * rng.standard_normal(60) for block in before]
    told = removed(before, after)
    assert told.share < 0.0
    assert not told.clearly


def test_missing_forecasts_and_strays_do_not_count() -> None:
    before = [np.array([1.0, np.nan, 1.0, 1.0]), np.array([1.0, 1.0, 900.0, 1.0])]
    after = [np.array([0.5, 0.1, np.nan, 0.5]), np.array([0.5, 0.5, 900.0, 0.5])]
    assert removed(before, after).share == pytest.approx(0.75)


def test_what_helps_and_counts_is_added() -> None:
    one = judged(NAMED, [("crosswind-offset",)], [worth(0.3, 0.5, 60.0)])
    assert one.verdict == "named"
    assert [e.name for e in one.to_add] == ["crosswind-offset"]
    told = verdict_sentence(StepArtefacts(name=one).summary)
    assert told.startswith("Missing from the model: a steady draught")
    assert told.endswith("(`crosswind-offset`).")


def test_what_is_certain_and_small_keeps_its_name_and_is_not_added() -> None:
    one = judged(NAMED, [("crosswind-offset",)], [worth(0.019, 0.01, 25.0)])
    assert one.verdict == "named"
    assert one.to_add == []
    told = account(StepArtefacts(name=one).summary)
    assert told.startswith("Nothing that matters is missing from the model. There, but too small")
    assert "(`crosswind-offset`), 1.9 %." in told


def test_what_makes_the_sealed_forecast_worse_is_withdrawn_with_a_sentence() -> None:
    one = judged(NAMED, [("crosswind-offset",)], [worth(-0.08, -0.02, 1.0)])
    assert one.verdict == "none"
    assert one.effects == []
    told = account(StepArtefacts(name=one).summary)
    assert told.startswith("Nothing that matters is missing from the model.")
    assert "Withdrawn: crosswind-offset" in told
    assert "−8.0 %" in told


def test_what_helps_no_more_than_a_wrong_effect_is_withdrawn() -> None:
    one = worth(0.03, 0.02, 2.0, placebo=0.04, far_placebo=0.03)
    assert not one.is_confirmed
    # A horizon at which a wrong effect can do as well does not speak against the other.
    assert worth(0.03, 0.1, 2.0, placebo=0.04, far_placebo=0.03).is_confirmed
    assert worth(0.03, 0.02, 2.0, placebo=0.01).is_confirmed


def test_what_spoils_the_forecast_is_never_added_however_evident() -> None:
    one = worth(-0.01, 0.2, 80.0)
    assert one.is_confirmed
    assert not one.matters
    assert not worth(0.2, -0.2, 80.0).matters


def test_of_two_effects_one_may_be_withdrawn() -> None:
    both = Name(verdict="named", effects=[Effect(name=n) for n in ("added-mass", "range-drift")])
    parts = parts_of(both, ("added-mass", "range-drift"))
    one = judged(both, parts, [worth(0.2, 0.2, 40.0), worth(-0.02, 0.0, 1.0)])
    assert [e.name for e in one.effects] == ["added-mass"]
    assert [e.name for e in one.withdrawn] == ["range-drift"]


def test_an_expression_that_does_not_matter_is_no_unknown() -> None:
    wave = {"text": "0.01 N * sin(3.3*x_m)", "gain_nats": 15.0}
    unknown = Name.model_validate({"verdict": "unknown", "unknown": wave})
    one = judged(unknown, [("wave",)], [worth(0.02, 0.01, 12.0)])
    assert one.verdict == "none"
    assert one.unknown is None
    assert "0.01 N * sin(3.3*x_m)" in account(StepArtefacts(name=one).summary)
    kept = judged(unknown, [("wave",)], [worth(0.3, 0.2, 80.0)])
    assert kept.verdict == "unknown"


def test_a_class_stands_and_falls_with_its_best_member() -> None:
    told = Name(verdict="class", rivals=["wake-width", "wake-spreading"])
    assert judged(told, [("wake-width",)], [worth(0.2, 0.2, 20.0)]).verdict == "class"
    small = judged(told, [("wake-width",)], [worth(0.01, 0.02, 1.0)])
    assert (small.verdict, small.rivals) == ("none", [])
    assert "does not matter, and is not added: wake-width or wake-spreading." in account(
        StepArtefacts(name=small).summary
    )
    gone = judged(told, [("wake-width",)], [worth(-0.1, 0.0, 0.0)])
    assert gone.verdict == "none"
    assert gone.rivals == []


@pytest.mark.parametrize(("share", "verdict"), [(0.2, "unknown"), (0.01, "none")])
def test_a_disagreement_without_a_cause_is_unknown_only_if_a_cause_would_help(share, verdict):
    told = unexplained(Name(verdict="unknown"), Removed(share, share - 0.005, 1.0))
    assert told.verdict == verdict
    assert "beyond noise" in account(StepArtefacts(name=told).summary)


def test_the_force_of_an_effect_is_told_in_newtons() -> None:
    """A constant force of 50 mN, an expression's term, changes the force by 50 mN everywhere."""
    model = with_terms(GantryModel(RIG, [flown(51), flown(52)]))
    free = model.free(("constant",))
    theta = np.array([0.05 if f.name == "constant.c" else f.neutral for f in free])
    sized = Fit(("constant",), free, (0, 1), theta, Slopes((), (), ()), np.zeros(2))
    assert force_of(model, sized, ("constant",)) == pytest.approx(0.05, rel=0.15)
    assert force_of(model, sized, ()) == 0.0


def test_a_constant_force_is_integrated_away_and_a_slow_one_is_not() -> None:
    """In the steady state of the loop a sine of angular frequency w leaves F/|M(iw)^2 + PID|."""
    steps = 128 * 60
    assert abs(tracking_error(RIG, np.full(steps, 0.1))[-1]) < 1e-4
    w, c = 2.0, RIG.control
    late = np.exp(-1j * w * default_lead_s(RIG))
    loop = RIG.sufferer.mass_kg * (1j * w) ** 2
    loop += (c.kp_n_per_m + c.ki_n_per_ms / (1j * w) + c.kd_ns_per_m * 1j * w) * late
    error = tracking_error(RIG, 0.1 * np.sin(w * np.arange(steps) / 128.0))
    amplitude = np.sqrt(2.0) * error[steps // 2 :].std()
    assert amplitude == pytest.approx(0.1 / abs(loop), rel=0.03)
