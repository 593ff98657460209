"""The referee's gantries: their equations, against what is known of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.flown_again import flown_again
from benchmarks.form_error.cases import Case, build_of, flights_of, fly, jet_of_case
from benchmarks.form_error.equations import (
    COULOMB,
    LUGRE,
    ROTOR,
    SOURCE,
    SPEED,
    STATES,
    STRIBECK,
    Numbers,
    Z,
    advance,
)
from benchmarks.form_error.judge import answer_of, row
from benchmarks.form_error.plan import DOSES, hidden_names, no_effect, trivial, with_effect
from benchmarks.form_error.plant import FormPlant
from benchmarks.form_error.profiles import DISTANCE_M, FAMILIES, LATERAL_M, Jet
from benchmarks.form_error.table import curve
from benchmarks.form_error.worth import worth_of
from wakedeploy.core.rig import LOOP_RATE_HZ
from wakedeploy.gap.systems.gantry.search.importance import Removed
from wakedeploy.gap.systems.gantry.workflow import close
from wakedeploy.physics.jet import VerticalJet
from wakedeploy.rig.file import default_rig

RIG = default_rig()
DT_S = 1.0 / 256.0
STILL = Jet(np.zeros((91, 181)), np.full(91, 0.2), np.full(91, 0.02), 0.0, 0.0)


def pushed(numbers: Numbers, thrust_n: float, seconds: float, z_m: float = 0.6) -> np.ndarray:
    """The state after a constant thrust in still air."""
    y, ring = np.zeros(STATES), np.zeros(1024)
    y[Z], y[ROTOR] = z_m, np.sqrt(thrust_n)
    targets = np.array([0.0, np.sqrt(thrust_n)])
    for k in range(round(seconds / DT_S)):
        advance(
            y, DT_S, numbers, targets, 0.0, 0.0, 0.0, ring, k,
            STILL.speed_mps, STILL.delay_s, STILL.mixing_s,
        )  # fmt: skip
    return y


@pytest.mark.slow
def test_a_body_without_friction_falls() -> None:
    free = Numbers(coulomb_n=0.0, stiction_n=0.0, viscous_n_per_mps=0.0)
    y = pushed(free, 0.0, 0.25)
    assert y[SPEED] == pytest.approx(-9.81 * 0.25, rel=1e-3)
    assert y[Z] == pytest.approx(0.6 - 0.5 * 9.81 * 0.25**2, rel=2e-2)


@pytest.mark.parametrize("friction", [COULOMB, STRIBECK, LUGRE])
def test_every_friction_slides_at_the_force_that_coulomb_has(friction) -> None:
    """Far above Stribeck's speed and without viscosity, 50 mN are left of all of them."""
    numbers = Numbers(friction=friction, viscous_n_per_mps=0.0)
    weight = numbers.mass_kg * 9.81
    early, late = (pushed(numbers, weight + 0.3, s)[SPEED] for s in (0.5, 0.75))
    assert numbers.mass_kg * (late - early) / 0.25 == pytest.approx(0.25, rel=0.02)


@pytest.mark.parametrize("friction", [COULOMB, STRIBECK, LUGRE])
def test_what_is_less_than_stiction_hardly_moves_it(friction) -> None:
    numbers = Numbers(friction=friction)
    y = pushed(numbers, numbers.mass_kg * 9.81 + 0.03, 0.5)
    assert abs(y[Z] - 0.6) < 2e-4


def test_the_jet_of_the_model_s_own_form_is_the_paper_s() -> None:
    """Its steady speed against the project's sum over puffs, which this plant does not import."""
    jet = jet_of_case(Case(1, is_calibrated=False), RIG)
    own = VerticalJet(RIG.wake, RIG.source.height_m, DT_S)
    for _ in range(400):
        own.inject(RIG.wake.reference_thrust_n)
    row = int(np.argmin(np.abs(DISTANCE_M - 1.4)))
    for x in (0.0, 0.1, 0.25):
        column = int(np.argmin(np.abs(LATERAL_M - x)))
        assert -jet.speed_mps[row, column] == pytest.approx(own.velocity(x, 0.6), rel=5e-3)


@pytest.mark.parametrize("family", [f for f in FAMILIES if f != "same"])
def test_a_misfit_is_what_was_asked_for(family) -> None:
    jet = jet_of_case(Case(1, jet=family, misfit=0.04, is_calibrated=False), RIG)
    assert jet.misfit_share == pytest.approx(0.04, rel=0.05)
    assert 0.01 < jet.misfit_n < 0.08
    axis = jet.speed_mps[:, len(LATERAL_M) // 2]
    assert (axis > 0.0).all()


@pytest.mark.whole
def test_a_flight_is_whole_and_the_same_again() -> None:
    case = Case(3, jet="round", misfit=0.03, friction="lugre", sensor="window", noise="bursts")
    log, again = (fly(case, RIG, 9, seconds=4.0) for _ in range(2))
    assert "FAILSAFE" not in set(log["mode"])
    assert np.array_equal(log["range_m"], again["range_m"], equal_nan=True)
    assert np.nanmin(log["true_wake_force_n"]) < -0.1


def test_the_source_s_change_arrives_after_the_air_s_way() -> None:
    """A step of the source reaches 1.4 m below after 1.4 m at 6 m/s."""
    plant = FormPlant(build_of(Case(1, is_calibrated=False), RIG), seed=1)
    forces = []
    for _ in range(256):
        plant.step(1700.0, 1000.0, 0.0)
        forces.append(-plant.wake_force_n)
    half = int(np.argmax(np.array(forces) > 0.25 * max(forces)))
    risen = int(np.argmax(np.array([f > 0 for f in forces])))
    assert plant.source_thrust_n > 4.0
    assert 0.1 < risen * DT_S < half * DT_S
    assert half * DT_S == pytest.approx(2.0 / 6.0 + 0.06 + 0.02, abs=0.06)
    assert plant._y[SOURCE] > 0.0


def test_the_plan_takes_every_family_at_every_misfit() -> None:
    cases = no_effect(4)
    assert {case.misfit for case in cases} == set(DOSES)
    assert {case.jet for case in cases if case.misfit} == set(FAMILIES) - {"same"}
    assert len({case.seed for case in (*cases, *with_effect(2))}) == len(cases) + 24
    assert all(len(hidden_names(case)) == 1 for case in with_effect(1))
    assert all(len(hidden_names(case)) == 2 for case in trivial(1))
    pairs = {(case.jet, case.friction) for case in no_effect(20) if case.misfit}
    assert len(pairs) == 16
    for plan, few, many in ((no_effect, 4, 20), (with_effect, 2, 4)):
        assert {c.name for c in plan(few)} < {c.name for c in plan(many)}
    assert len([case for case in no_effect(20) if case.misfit <= 0.04]) == 100
    of_one = [c for c in with_effect(4) if "ground-effect.gain" in c.effects]
    assert len({c.jet for c in of_one}) == len({c.misfit for c in of_one}) == 4


def test_a_useless_answer_is_no_right_one() -> None:
    nothing = {"class": []}
    assert answer_of("", "none", [], [], nothing) == "right"
    assert answer_of("", "named", [], ["added-mass"], nothing) == "right"
    assert answer_of("", "unknown", [], [], nothing) == "false alarm"
    assert answer_of("added-mass", "unknown", [], [], nothing) == "useless"
    assert answer_of("added-mass", "named", ["added-mass"], [], nothing) == "right"
    assert answer_of("added-mass", "named", ["range-drift"], [], nothing) == "wrong"
    assert answer_of("added-mass", "class", [], [], {"class": ["added-mass"]}) == "right"
    assert answer_of("added-mass", "none", [], [], nothing) == "missed"
    assert answer_of("added-mass", "none", [], [], nothing, matters=False) == "right"
    assert answer_of("added-mass", "named", ["gust"], [], nothing, matters=False) == "wrong"
    assert answer_of("added-mass", "unknown", [], [], nothing, matters=False) == "useless"


def test_a_row_says_whether_the_hidden_effect_is_worth_anything() -> None:
    """Known by name, it would remove so much of the sealed error, at any of the horizons."""
    case = with_effect(1)[0]
    gap = {"height 0.25 s ahead": {"before": 0.010, "after": 0.011}}
    nothing = {"effects": [], "verdict": "none", "class": [], "gap": gap}
    little, much = Removed(0.03, 0.0, 0.06), Removed(0.3, 0.1, 0.5)
    missed = row(case, nothing, RIG, 9.0, {0.25: little, 1.0: much})
    assert (missed["matters"], missed["answer"]) == (True, "missed")
    assert missed["worth"] == {"0.25": 0.03, "1": 0.3}
    rightly = row(case, nothing, RIG, 9.0, {0.25: little, 1.0: little})
    assert (rightly["matters"], rightly["answer"]) == (False, "right")
    effects = [{"name": missed["hidden"], "worth": {"matters": True}}]
    named = {**nothing, "verdict": "named", "effects": effects}
    added = row(case, named, RIG, 9.0, {0.25: much})
    assert (added["answer"], added["added_worse"]) == ("right", True)
    none_hidden = row(no_effect(1)[0], nothing, RIG, 9.0, {})
    (line,) = curve([{**r, "dose": 0.02} for r in (missed, rightly, added, none_hidden)])
    counts = {k: (line[k]["count"], line[k]["of"]) for k in ("right", "too_small", "false_alarms")}
    assert counts == {"right": (1, 2), "too_small": (1, 1), "false_alarms": (0, 1)}
    assert line["added_worse"] == 1


@pytest.mark.parametrize(
    ("ends_s", "flown"), [([9.0, 1.0], [0]), ([1.0, 9.0], [0, 1]), ([1.0, 2.0], [0, 1])]
)
def test_a_flight_that_ended_soon_is_flown_again(ends_s, flown) -> None:
    """The last is kept where none is long enough."""
    seeds = []

    def fly(seed):
        seeds.append(seed)
        return SimpleNamespace(flying=np.arange(320) < LOOP_RATE_HZ * ends_s[seed])

    log = flown_again(fly, range(2))
    assert seeds == flown
    assert log.flying.sum() == LOOP_RATE_HZ * ends_s[flown[-1]]


@pytest.mark.slow
def test_what_an_effect_is_worth_is_what_the_answer_says_of_it(tmp_path) -> None:
    """Known by name beforehand, and found: one share of the sealed error."""
    case = Case(4600, effects={"crosswind-offset.offset_m": 0.04})
    logs = flights_of(case, tmp_path / "flights")
    result = close(logs[0].parent / "rig.toml", logs, tmp_path / "answer", workers=1, report=False)
    (effect,) = result.effects
    assert effect.name == "crosswind-offset"
    worth = worth_of(("crosswind-offset",), logs, tmp_path / "answer")
    assert set(worth) == {0.25, 1.0}
    for horizon_s, removed in worth.items():
        told = effect.worth.removed[f"{horizon_s:g} s ahead"]
        assert removed.share == pytest.approx(told.share, abs=0.02)
        assert removed.share > 0.2
