"""Something breaks in flight, and the sufferer comes down softly: a short form of the campaign.

`python -m benchmarks.faults` flies every fault in every phase; here some of each group begin in two
phases. A soft landing does not say what noticed the fault: by which name a flight ends, or goes on
with PID alone, is looked at as well, so that no watch is spared by another one.
"""

from functools import partial

import pytest
from made_packages import gantry_package

from benchmarks.injected import computer, link
from benchmarks.injected.catalogue import FAULTS, GROUPS
from benchmarks.injected.flight import Case, Moment, break_it, flown, fly, scene_of
from benchmarks.injected.parting import fly_all
from benchmarks.injected.phases import moments
from benchmarks.injected.table import LOWER_MPS, UPPER_MPS
from runtime.simulated import OracleForecast
from wakedeploy.core.package import write_package
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

CALM = 0.0  # without a wake the package, which predicts no force, is right
# By phase, the flight's length [s]: what lies long before the fault is flown for nothing.
PHASES = {"hovering high": 8.0, "10 cm above the stop": 5.2}
CHOSEN = (
    "none",
    "stall 95 ms",
    "stall 120 ms",  # the board's own descent has just begun, or is about to
    "stall 135 ms",
    "stall 500 ms",
    "every tick 20 ms late",
    "exception in control, once",
    "exception in estimate, for ever",
    "wall clock -1 h",
    "prediction nan",
    "prediction -5 N",
    "prediction +20 N, 1 s",
    "range 8190 mm",
    "range silent",
    "range frozen",
    "range 1e300",
    "range +0.3 m",
    "range strays 70 %",
    "range drifts +0.2 m/s",
    "link cut",
    "link cut, 0.2 s",
    "commands 100 ms late",
    "50 % of answers lost",
    "status says not armed",
    "battery reads 0 V",
    "push -2 N, 0.5 s",
    "operator stop",
    "disk full",
    "stop, then link cut, 0.5 s",
)


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    path = tmp_path_factory.mktemp("fault") / "zero.onnx"
    write_package(gantry_package(default_lead_s(default_rig())), path)
    return path


@pytest.fixture(scope="module")
def when():
    return {
        moment.phase: moment
        for phase, seconds in PHASES.items()
        for moment in moments([phase], seconds, wake_factor=CALM)
    }


@pytest.mark.whole
@pytest.mark.parametrize("phase", PHASES)
def test_the_sufferer_comes_down_softly_and_the_motors_are_idle(phase, package, when):
    """What comes before the faults is flown once for all that have the same rig file."""
    by_rig = {}
    for fault in CHOSEN:
        case = Case(fault, when[phase], package, wake_factor=CALM)
        by_rig.setdefault(repr(FAULTS[fault].rig), []).append(case)
    became = {one.case.fault: one for alike in by_rig.values() for one in fly_all(alike)}
    assert set(became) == set(CHOSEN)
    for fault, one in became.items():
        assert one.lower_mps <= LOWER_MPS, (fault, one.ended)
        assert one.upper_mps <= UPPER_MPS, (fault, one.ended)
        assert one.is_idle, fault


def broken(case, begin, *, knows_the_wake=False):
    """What became of a flight in which `begin` breaks something, and all faults that it named."""
    scene = scene_of(case)
    if knows_the_wake:
        predictor = scene.predictor
        predictor._inner = OracleForecast(scene.world.plant, predictor.lead_s)
    scene.later(0.0, partial(begin, scene))
    became = flown(scene, case)
    named = {name for _, row in scene.rows.rows for name in str(row["faults"]).split("+")}
    assert became.lower_mps <= LOWER_MPS, became.ended
    assert became.upper_mps <= UPPER_MPS, became.ended
    assert became.is_idle
    return became, named


@pytest.fixture
def high(package, when):
    """A calm flight with the package, in which something breaks as it hovers high."""
    return Case("none", when["hovering high"], package, wake_factor=CALM)


@pytest.mark.parametrize(
    ("fault", "cause", "beside"),
    [
        ("commands 100 ms late", "commands_late", "answers_late"),
        ("answers 100 ms late", "commands_late", "answers_late"),
        ("range 200 ms old", "range_late", "range_doubted"),
        ("range stamps +1 s", "sensor_lost", "bad_range"),
        ("range stamps -1 s", "sensor_lost", "bad_range"),
        ("range 8190 mm", "sensor_lost", "bad_range"),
        ("range 1e300", "sensor_lost", "bad_range"),
    ],
)
def test_what_ends_a_flight_is_named(fault, cause, beside, high):
    became, named = broken(high, partial(break_it, name=fault))
    assert became.ended == f"failsafe: {cause}"
    assert {cause, beside} <= named


@pytest.mark.parametrize(
    ("fault", "trouble"),
    [
        ("prediction -2 N", "prediction_doubted"),
        ("prediction is noise", "prediction_doubted"),
        ("prediction alternates", "bad_prediction"),
        ("prediction +1e+30 N", "bad_prediction"),
    ],
)
def test_a_wrong_prediction_is_flown_without_and_named(fault, trouble, high):
    became, named = broken(high, partial(break_it, name=fault))
    assert became.ended == "whole"
    assert became.degraded_s < 0.5
    assert trouble in named


@pytest.mark.parametrize("fault", ["none", "prediction of wrong sign", "prediction x 5"])
def test_predictions_of_a_true_wake_are_doubted_once_they_are_wrong(fault, package):
    """No training bounds them here: only the motion shows that they are wrong."""
    case = Case("none", Moment("", 940_000_011, 4.0, 8.0), package)
    became, named = broken(case, partial(break_it, name=fault), knows_the_wake=True)
    assert became.ended == "whole"
    assert ("prediction_doubted" in named) == (fault != "none")


def test_answers_a_little_late_degrade_and_end_no_flight(high):
    """Commands may act late, too: what is fed forward would come at the wrong moment."""
    became, named = broken(high, partial(link.late, way="to_host", seconds=0.031))
    assert became.ended == "whole"
    assert became.degraded_s < 0.5
    assert named == {"", "answers_late"}


@pytest.mark.parametrize(
    ("ms", "ended"),
    [
        (120, "whole"),
        (140, "failsafe: loop_stalled"),
        (500, "failsafe: loop_stalled"),
    ],
)
def test_a_computer_that_stood_still_has_lost_no_link(ms, ended, high):
    """Nothing was sent meanwhile, and so nothing is unanswered."""
    became, named = broken(high, partial(computer.stall, stage="write", seconds=1e-3 * ms))
    assert became.ended == ended
    assert named.isdisjoint({"link_lost", "answers_missing"})


def test_pid_alone_lands_softly_in_a_wake():
    flown = fly(Case("none", Moment("", 940_000_011, 0.0, 8.0)))
    assert flown.ended == "whole"
    assert flown.lower_mps <= LOWER_MPS


def test_a_thrust_off_its_model_is_not_taken_for_late_readings():
    """Nothing breaks and nothing swings; late readings make the loop swing."""
    factor = 1.445833462465699
    flown = fly(
        Case("none", Moment("", 960_837_723, 0.0), None, is_mismatched=True, wake_factor=factor)
    )
    assert flown.ended == "whole"  # range_late where the swing does not count


def test_a_push_that_stays_does_not_lift_what_has_touched_down():
    """It pushed before the landing began; a sum of pulses that forgot it lifts off again."""
    moment = Moment("10 cm above the stop", 940_000_011, 14.125, 14.0)
    flown = fly(Case("push +1 N", moment, is_mismatched=True))
    assert flown.ended == "whole"
    assert flown.lower_mps <= LOWER_MPS  # 3.9 m/s where the touch-down forgets it


def test_the_chosen_faults_are_of_every_group_that_a_command_can_save():
    groups = {FAULTS[name].group for name in CHOSEN}
    assert groups == set(GROUPS) - {"not survivable"}
    assert all(FAULTS[name].survivable for name in CHOSEN)
