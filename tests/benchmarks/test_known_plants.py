"""The known plants: their judge, and recordings against what they are made of."""

import numpy as np
import pytest

from benchmarks.known_plants.__main__ import judged
from benchmarks.known_plants.cases import CASES, Case
from benchmarks.known_plants.plants import PLANTS
from benchmarks.known_plants.recording import recorded
from wakedeploy.gap.systems.system import checked


@pytest.mark.parametrize(
    ("named", "rivals", "verdict", "said"),
    [
        (["a"], [], "named", "right"),
        (["a", "z"], [], "named", "partly"),
        (["a"], ["a", "z"], "class", "class"),
        (["z"], [], "named", "wrong"),
        (["a"], ["a", "x", "y", "z"], "unknown", "unknown"),
        ([], [], "unknown", "unknown"),
        ([], [], "none", "none"),
    ],
)
def test_the_judge(named, rivals, verdict, said):
    case = Case("cart", "steps", {"coulomb": 1.0}, ("a",))
    assert judged(case, {"named": named, "class": rivals, "verdict": verdict}) == said


def test_unknown_is_right_where_no_effect_is_what_was_hidden():
    case = Case("cart", "waves", {"magnet": 2.0})
    said = {"named": [], "class": []}
    assert judged(case, {**said, "verdict": "unknown"}) == "right"
    assert judged(case, {**said, "verdict": "none"}) == "none"
    assert judged(case, {**said, "named": ["offset@speed_mps"], "verdict": "named"}) == "wrong"
    nothing = Case("cart", "waves")
    assert judged(nothing, {**said, "verdict": "unknown"}) == "unknown"


def test_a_hidden_delay_moves_a_motor_later():
    plant = PLANTS["motor"]
    early, late = (recorded(plant, hidden, "steps", 3, False) for hidden in ({}, {"delay": 0.05}))
    here, there = (r.columns["speed_radps"] for r in (early, late))
    assert np.array_equal(early.columns["voltage_v"], late.columns["voltage_v"])
    shifts = range(11)
    apart = [np.mean((there[k:] - here[: len(here) - k]) ** 2) for k in shifts]
    assert int(np.argmin(apart)) == 5


def test_cases_are_apart_and_their_ports_exist():
    assert len({case.name for case in CASES}) == len(CASES)
    for case in CASES:
        ports = {p.name for p in checked(PLANTS[case.plant].system()).ports}
        assert {name.partition("@")[2] for name in case.expected} <= ports
