"""Something breaks in flight, and the sufferer comes down softly: a short form of the campaign.

`python -m benchmarks.faults` flies every fault in every phase; here some of each group begin in two
phases.
"""

import pytest
from made_packages import gantry_package

from benchmarks.injected.catalogue import FAULTS, GROUPS
from benchmarks.injected.flight import Case, Moment, fly
from benchmarks.injected.phases import moments
from benchmarks.injected.table import LOWER_MPS, UPPER_MPS
from wakedeploy.core.package import write_package
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

CALM = 0.0  # without a wake the package, which predicts no force, is right
# By phase, the flight's length [s]: what lies long before the fault is flown for nothing.
PHASES = {"hovering high": 8.0, "10 cm above the stop": 5.2}
CHOSEN = (
    "none",
    "stall 95 ms",
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


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("fault", CHOSEN)
def test_the_sufferer_comes_down_softly_and_the_motors_are_idle(fault, phase, package, when):
    flown = fly(Case(fault, when[phase], package, wake_factor=CALM))
    assert flown.lower_mps <= LOWER_MPS, flown.ended
    assert flown.upper_mps <= UPPER_MPS, flown.ended
    assert flown.is_idle


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
