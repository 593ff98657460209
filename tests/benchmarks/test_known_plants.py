"""The known plants: their judge, and recordings against what they are made of."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.known_plants.__main__ import answered, judged
from benchmarks.known_plants.cases import CASES, Case
from benchmarks.known_plants.controlled import CONTROLLED
from benchmarks.known_plants.plants import PLANTS
from benchmarks.known_plants.recording import Path, Sensors, controlled, recorded
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.plan import plan
from wakedeploy.gap.systems.ports import Point


@pytest.mark.parametrize(
    ("named", "rivals", "verdict", "said"),
    [
        (["a"], [], "named", "right"),
        (["a", "z"], [], "named", "partly"),
        (["a"], ["a", "z"], "class", "class"),
        (["a", "b"], ["b", "z"], "class", "class"),
        (["z", "a"], ["a", "y"], "class", "partly"),
        (["a", "y"], ["y", "z"], "class", "partly"),
        (["z"], [], "named", "wrong"),
        (["a"], ["a", "x", "y", "z"], "unknown", "unknown"),
        ([], [], "unknown", "unknown"),
        ([], [], "none", "none"),
    ],
)
def test_the_judge(named, rivals, verdict, said):
    case = Case("cart", "steps", {"coulomb": 1.0}, ("a",), ("b",))
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


@pytest.mark.slow
@pytest.mark.parametrize("drive", ["steps", pytest.param("closed", marks=pytest.mark.slow)])
def test_a_sensor_that_is_cut_is_named(drive):
    case = next(c for c in CASES if c.plant == "motor" and "clip" in c.hidden)
    case = replace(case, drive=drive)
    told = answered(case)
    assert told["named"] == ["sensor-saturation@speed_radps"]


@pytest.mark.slow
def test_a_delay_is_named_that_the_input_s_clock_hides():
    """Alone, the clock goes as far as it may, and a delay promises nothing more there."""
    case = next(c for c in CASES if c.name == "servo, waves, delay, coloured")
    told = answered(case)
    assert "dead-time@command_rad" in (*told["named"], *told["class"])


@pytest.mark.slow
def test_an_imagined_log_can_lack_what_a_cut_sensor_has():
    """No reading comes three times in it, and yet the cut is what it has to tell apart."""
    case = next(c for c in CASES if c.plant == "tank" and "clip" in c.hidden)
    recording = recorded(PLANTS["tank"], case.hidden, "sweep", 1, False)
    model = LogModel(checked(PLANTS["tank"].system()), [recording])
    class_ = ["sensor-saturation@level_m", "upper-stop@level_m"]
    assert plan(model, fitted_base(model), class_).options


@pytest.mark.parametrize(("ratio", "rings"), [(0.3, True), (1.2, False)])
def test_a_hidden_oscillator_rings_as_its_damping_says(ratio, rings):
    path = Path({"rings_radps": 20.0, "damping": ratio}, 1e-3, 0.0)
    shown = np.array([path(1.0) for _ in range(2000)])
    over = math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2)) if rings else 0.0
    assert shown.max() - 1.0 == pytest.approx(over, abs=0.02)
    assert shown[-1] == pytest.approx(1.0, abs=1e-3)


def test_what_is_held_slewed_rounded_and_uneven():
    held = Path({"hold_s": 0.03}, 0.01, 0.0)
    assert [held(float(k)) for k in range(7)] == [0.0, 0.0, 0.0, 3.0, 3.0, 3.0, 6.0]
    slewed = Path({"slew_per_s": 50.0}, 0.01, 0.0)
    assert [slewed(1.2) for _ in range(4)] == pytest.approx([0.5, 1.0, 1.2, 1.2])
    assert Path({"grain": 4.0}, 0.01, 0.0)(5.0) == 4.0
    assert [Path({"uneven": 0.1}, 0.01, 0.0)(u) for u in (10.0, -10.0)] == [11.0, -9.0]


def test_cases_are_apart_and_their_ports_exist():
    assert len({case.name for case in CASES}) == len(CASES)
    for case in CASES:
        plant = CONTROLLED.get(case.plant) or PLANTS[case.plant]
        ports = {p.name for p in checked(plant.system()).ports}
        assert {name.partition("@")[2] for name in case.expected} <= ports


TRUE = {
    "cart and pole": {"cart_kg": 1.03, "pole_kg": 0.195, "half_m": 0.302, "damping": 0.53},
    "ship": {"time_s": 21.0, "gain": 0.155},
    "car": {"mass_kg": 1520.0, "inertia_kgm2": 2440.0, "front": 5.8e4, "rear": 7.2e4},
    "roll": {"inertia_kgm2": 0.0097},
    "oven": {"power": 0.51, "passes": 0.0102, "loses": 0.0041},
    "diver": {"mass_kg": 20.6, "drag": 14.2},
    "arm": {"first_kg": 1.03, "second_kg": 0.585, "first_damping": 0.11, "second_damping": 0.048},
}


@pytest.mark.parametrize("name", CONTROLLED)
def test_the_truth_is_the_system_with_its_own_constants_where_nothing_is_hidden(name):
    """Two ways of writing it: what sensors see, too."""
    plant, rng = CONTROLLED[name], np.random.default_rng(6)
    system = checked(plant.system())
    c = system.values(TRUE[name])
    for _ in range(20):
        x = [float(v) for v in rng.uniform(0.1, 1.0, len(plant.start))]
        u = [float(v) for v in rng.uniform(4.0, 9.0, len(system.inputs))]
        state = Point("state", dict(zip(system.states, x, strict=False)))
        inputs = Point("input", dict(zip([i.name for i in system.inputs], u, strict=True)))
        rates = list(system.rates(state, inputs, c).values())
        assert plant.rates(x, u, {}, 0.0)[: len(rates)] == pytest.approx(rates)
        shown = list(system.readings(state, inputs, c).values())
        assert plant.shown(x, u, {}) == pytest.approx(shown)


def test_sensors_lag_are_late_and_tell_less():
    late = Sensors({"sensor": 1, "sensor late": 0.03}, 0.01, [0.0, 0.0])
    lagging = Sensors({"sensor": 0, "sensor lag": 0.05}, 0.01, [0.0, 0.0])
    for k in range(1, 6):
        late.see([10.0 * k, float(k)])
        lagging.see([1.0, 5.0])
    assert late.read([50.0, 5.0]) == [50.0, 2.0]
    assert lagging.read([1.0, 5.0]) == pytest.approx([1.0 - 0.8**5, 5.0])
    wrong = Sensors({"sensor": 1, "sensor gain": 1.1, "sensor bias": 0.5}, 0.01, [0.0, 0.0])
    assert wrong.read([3.0, 2.0]) == pytest.approx([3.0, 2.7])


def test_a_controlled_plant_does_what_its_controller_wants():
    """The pole stays up, and every recording is of the system's own columns."""
    recording = controlled(CONTROLLED["cart and pole"], {}, 3)
    assert np.abs(recording.columns["pole_rad"]).max() < 0.2
    assert np.ptp(recording.columns["cart_m"]) > 0.2
    assert [*recording.columns] == ["force_n", "cart_m", "pole_rad"]
