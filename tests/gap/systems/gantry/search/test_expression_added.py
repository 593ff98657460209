"""An expression joins the effects found: what is needed beside it, and the rig file written.

Hidden is a cable that pulls at the sufferer as the carriage moves. The library has none; a
crosswind that shifts the wake looks like it, until the expression is there.
"""

import time
from pathlib import Path

import pytest
from fabricated_artefacts import leave
from recorded import RIG, as_it_stands, flown, judged, with_effects

from wakedeploy.core.rig import Rig
from wakedeploy.gap.report.summary import account
from wakedeploy.gap.systems.gantry.find_name_add_show import Case, add, show_gap, write_answer
from wakedeploy.gap.systems.gantry.folder import read_steps
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.naming import name_effects
from wakedeploy.gap.systems.gantry.search.outcome import Answer, Thresholds
from wakedeploy.gap.systems.gantry.workflow import result
from wakedeploy.physics.effects.symbolic import SYMBOLIC
from wakedeploy.rig.file import read_rig

pytestmark = pytest.mark.slow  # of the workflow after "unknown", from flights to a rig file

LIMITS = Thresholds(6.0, 8.0, 8.0, 36.0, 0.02, 0.02, 0.003)
SEEDS, SEALED = (51, 52, 53), 54
STIFFNESS_N_PER_M = 1.2  # beside a ground effect the wake's form may hold two thirds of it
GROUND = {"gain": (0.3, "1"), "height_m": (0.15, "m")}
SPURIOUS = "crosswind-offset"


def cable(t_s, state) -> float:
    """The force [N] on the sufferer."""
    return STIFFNESS_N_PER_M * state["x_m"]


def answered(truth: Rig, *candidates: str) -> Answer:
    model = GantryModel(RIG, [flown(seed, truth, cable, 12.0) for seed in SEEDS])
    return name_effects(RIG, model, LIMITS, candidates=candidates)


def told_of(answer: Answer, out: Path, *sealed: int, truth: Rig = RIG) -> Case:
    """The case, and in a folder what was found, its expression added to the rig file."""
    flights = [flown(seed, truth, cable, 12.0) for seed in (*SEEDS, *sealed)]
    case = Case(RIG, tuple(flights[: len(SEEDS)]), tuple(flights[len(SEEDS) :]), LIMITS)
    logs = [{"path": "", "sha256": sha256} for sha256 in case.recordings]
    leave(out, "find", {"rig_sha256": RIG.sha256, "logs": logs})
    write_answer(answer, out, time.monotonic())
    add(case, out, from_symbolic=True)
    return case


@pytest.fixture(scope="module")
def answer() -> Answer:
    return answered(RIG, SPURIOUS)


@pytest.fixture(scope="module")
def shown(answer, tmp_path_factory):
    """The case, its folder, and the gap shown on a sealed flight."""
    out = tmp_path_factory.mktemp("added")
    case = told_of(answer, out, SEALED)
    return case, out, show_gap(case, out)


def test_an_effect_that_only_stood_for_the_expression_is_dropped(answer) -> None:
    """With it, the expression has a wave besides, which nothing in the flights does."""
    assert answer.rounds[0].found == SPURIOUS
    assert answer.verdict == "unknown"
    assert answer.unknown is not None
    assert answer.unknown.terms == answer.fit.hypothesis == ("place",)
    (stiffness,) = answer.unknown.coefficients
    assert stiffness.low < STIFFNESS_N_PER_M < stiffness.high
    assert answer.white.passes(LIMITS.whiteness)  # of what the expression leaves


def test_the_rig_file_written_errs_as_was_shown(answer, shown) -> None:
    """Noise and calibration are fitted again; equally likely ones err by a few per cent more."""
    case, out, told = shown
    fitted, error_m = judged(as_it_stands(out / "rig.toml"), case.flights, case.sealed)
    gap = told.gap["height 0.25 s ahead"]
    assert error_m == pytest.approx(gap.after, rel=0.06)
    assert gap.after < 0.8 * gap.before
    assert fitted.log_likelihood == pytest.approx(answer.fit.log_likelihood, abs=2.0)


def test_what_is_told_is_what_the_file_has(shown) -> None:
    case, out, gap = shown
    told = result(case, out)
    (written,) = read_rig(out / "rig.toml").effect
    assert written.name == SYMBOLIC
    stated = {n: p.model_dump(exclude_none=True) for n, p in written.parameters.items()}
    kept = {"value", "low", "high", "unit"}
    said = {n: size.model_dump(include=kept) for n, size in told.unknown.parameters.items()}
    assert said == stated
    assert told.beside == gap.as_if == []
    words = account(read_steps(out).summary)
    near = "The known effect that comes nearest explains too little of it: "
    assert near in words
    assert f"(`{told.closest}`)" in words.partition(near)[2].partition(".")[0]


def test_an_effect_that_is_needed_beside_the_expression_stays_as_refitted_with_it(
    tmp_path,
) -> None:
    truth = with_effects(ground_effect=GROUND)
    both = answered(truth, SPURIOUS, "ground-effect")
    assert [one.found for one in both.rounds] == ["ground-effect", SPURIOUS]
    assert both.unknown is not None
    assert both.fit.hypothesis == ("ground-effect", *both.unknown.terms)
    told = result(told_of(both, tmp_path, truth=truth), tmp_path)
    ground, cable_and_more = read_rig(tmp_path / "rig.toml").effect
    assert (ground.name, cable_and_more.name) == ("ground-effect", SYMBOLIC)
    (beside,) = told.beside  # how sure it was without the expression is gone
    for parameter, (size, _) in GROUND.items():
        assert ground.parameters[parameter].value == beside.parameters[parameter].value
        assert ground.parameters[parameter].value == pytest.approx(size, rel=0.05)
    assert "A part of it looks like ground-effect, which" in account(read_steps(tmp_path).summary)
