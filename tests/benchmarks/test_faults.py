"""The instrument of the fault campaign: what it injects, what it measures, how it sums up."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from made_packages import gantry_package

from benchmarks.faults import MOST_OF_A_BUNDLE, bundles
from benchmarks.injected import descents, healthy, plant, table
from benchmarks.injected.catalogue import FAULTS, GROUPS
from benchmarks.injected.flight import (
    REST_S,
    Case,
    Flown,
    Moment,
    break_it,
    flown,
    flown_rows,
    fly,
    scene_of,
)
from benchmarks.injected.parting import fly_all
from benchmarks.injected.phases import PHASES, moments
from benchmarks.results import faults
from benchmarks.results.section import Records
from wakedeploy.core.package import write_package
from wakedeploy.domains.gantry import record
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

SECONDS = 6.0
MOMENT = Moment("in the air", 5, 4.0, SECONDS)
RESULT = Flown(
    Case("link cut", MOMENT), "whole", 0.3, 0.0, True, True, 0.1, 0.2, None, 0.0, 0.5, 0.1
)


def test_a_flight_without_a_fault_is_the_simulation_s_own():
    rows = [row for _, row in flown_rows(Case("none", MOMENT))]
    log = record(
        default_rig().changed(disturbance={"rest_s": REST_S}), seconds=SECONDS, seed=MOMENT.seed
    )
    assert len(rows) == len(log)
    for name in ("z_est_m", "x_m", "sufferer_cmd_us", "true_z_m", "true_wake_force_n"):
        assert [row[name] for row in rows] == log[name].tolist(), name


@pytest.mark.whole
def test_a_copy_of_a_flight_flies_as_the_flight_does_by_itself():
    cases = [Case(name, MOMENT) for name in ("none", "range noise 5 cm", "link cut, 0.5 s")]
    assert fly_all(cases) == [fly(case) for case in cases]


def test_a_copy_that_dies_is_not_passed_over(monkeypatch):
    monkeypatch.setitem(FAULTS, "dies", replace(FAULTS["none"], name="dies", begin=lambda _: 1 / 0))
    monkeypatch.setattr("traceback.print_exc", lambda: None)
    with pytest.raises(RuntimeError, match="not flown to its end"):
        fly_all([Case("none", replace(MOMENT, begins_s=99.0))])


@pytest.mark.parametrize("group", GROUPS)
def test_every_fault_says_what_it_is_and_can_begin_and_end(group, tiny):
    for name, fault in FAULTS.items():
        if fault.group == group:
            assert fault.sentence.endswith("."), name
            scene = scene_of(Case(name, MOMENT, tiny))
            break_it(scene, name)
            scene.restore()
            assert (scene.world.before, scene.world.sense, scene.predictor.alter) == (
                {},
                None,
                None,
            )


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    path = tmp_path_factory.mktemp("tiny") / "tiny.onnx"
    write_package(gantry_package(default_lead_s(default_rig()), gain=-0.04), path)
    return path


@pytest.mark.slow
def test_every_fault_changes_the_flight_but_those_that_must_not_matter(tiny):
    flights = [
        one
        for cases in bundles(list(FAULTS), [MOMENT], tiny)
        if cases[0].package is not None
        for one in fly_all(cases)
    ]
    (whole,) = (one for one in flights if one.case.fault == "none")
    same = {one.case.fault for one in flights if replace(one, case=whole.case) == whole}
    wall_clocks = {name for name in FAULTS if name.startswith("wall clock")}
    assert same == {"none", "frames doubled", *wall_clocks}


def test_the_wall_clock_does_not_matter():
    usual, late = (flown_rows_of(name) for name in ("none", "wall clock -1 h"))
    assert usual == late


def flown_rows_of(name):
    scene = scene_of(Case(name, MOMENT))
    scene.later(0.0, lambda: break_it(scene, name))
    flown(scene, Case(name, MOMENT))
    return scene.rows.rows


def test_a_stall_is_a_gap_between_two_ticks():
    times_s = np.array([t_s for t_s, _ in flown_rows_of("stall 500 ms")])
    assert np.max(np.diff(times_s)) == pytest.approx(0.5, abs=0.05)


def test_what_falls_freely_meets_the_stop_at_the_speed_of_a_fall():
    dead = fly(Case("sufferer dead", MOMENT))
    fall_mps = math.sqrt(2.0 * 9.81 * dead.height_m)
    assert 0.7 * fall_mps < dead.lower_mps < 1.05 * fall_mps
    assert dead.height_m > 0.2


def test_what_is_pushed_upwards_meets_the_upper_stop():
    assert fly(Case("sufferer at full", MOMENT)).upper_mps > 1.0


def test_phases_lie_in_the_flight_in_which_they_were_found():
    found = {moment.phase: moment for moment in moments(("at rest", "hovering high"), SECONDS)}
    assert found["at rest"].begins_s < REST_S
    assert REST_S + 2.5 < found["hovering high"].begins_s < REST_S + SECONDS - 2.5
    high = scene_of(Case("none", found["hovering high"]))
    high.later(0.0, lambda: break_it(high, "none"))
    assert flown(high, Case("none", found["hovering high"])).height_m > 0.2
    assert len(PHASES) >= 12


def test_a_push_is_survivable_within_the_thrust_reserve():
    low_n, high_n = plant.RESERVE_N
    assert (low_n, high_n) == pytest.approx((-4.59, 4.36), abs=0.01)
    assert plant.push(-4.0).survivable
    assert not plant.push(-5.0).survivable
    assert not plant.push(4.5).survivable


def test_a_bundle_flies_one_flight_and_predictions_only_with_a_package(tmp_path):
    package = tmp_path / "any.onnx"
    found = bundles(list(FAULTS), [MOMENT, replace(MOMENT, seed=6)], package)
    assert max(map(len, found)) <= MOST_OF_A_BUNDLE
    for cases in found:
        assert (
            len({(case.moment, case.package, repr(FAULTS[case.fault].rig)) for case in cases}) == 1
        )
    alone = [case for cases in found for case in cases if case.package is None]
    with_package = [case for cases in found for case in cases if case.package is not None]
    assert len(with_package) == 2 * len(FAULTS)
    assert not any(FAULTS[case.fault].needs_predictor for case in alone)


@pytest.mark.parametrize(
    ("changes", "is_unsafe"),
    [
        ({}, False),
        ({"lower_mps": 1.2}, True),
        ({"upper_mps": 0.6}, True),
        ({"is_idle": False}, True),
        ({"lower_mps": 0.9, "upper_mps": 0.4}, False),
    ],
)
def test_hard_contacts_and_motors_that_turn_are_unsafe(changes, is_unsafe):
    assert table.is_unsafe(replace(RESULT, **changes)) is is_unsafe


def test_a_fault_is_summed_up_over_its_flights():
    hard = replace(RESULT, lower_mps=1.25, detected_s=0.3, ended="failsafe: link_lost")
    unnoticed = replace(RESULT, detected_s=None)
    (row,) = table.by_fault([RESULT, hard, unnoticed])
    assert (row["unsafe"], row["unsafe_above_1_5_mps"], row["flights"]) == (1, 0, 3)
    assert row["unsafe_by_pilot"] == {"PID": 1}
    assert (row["worst_lower_mps"], row["detected"], row["median_detection_s"]) == (1.25, 2, 0.2)
    assert next(iter(row["endings"].items())) == ("whole", 2)
    (told,) = table.unsafe_rows([RESULT, hard, unnoticed])["link cut"]
    assert told == "in the air, PID, 1.25, 0.00, 0.30, -, 0.20, failsafe: link_lost"
    assert len(told.split(", ")) == len(table.COLUMNS.split(", "))
    assert "link cut" in table.printed([row])


def test_flights_that_no_command_saves_are_counted_and_not_listed():
    lost = replace(RESULT, case=Case("battery pulled", MOMENT), lower_mps=3.0)
    assert table.unsafe_rows([lost]) == {}
    assert table.by_fault([lost])[0]["unsafe"] == 1


def test_healthy_flights_vary_the_wake_and_take_pilots_in_turn(tmp_path):
    cases = healthy.healthy_cases("0.5 to 2", 20, tmp_path / "any.onnx")
    assert {case.pilot for case in cases[::2]} == {"PID"}
    assert {case.pilot for case in cases[1::2]} == {"package"}
    assert 0.5 <= min(case.wake_factor for case in cases) < 0.9
    assert 1.1 < max(case.wake_factor for case in cases) <= 2.0
    assert all(case.is_mismatched for case in cases)


def test_healthy_flights_are_summed_up_by_pilot():
    ended = replace(RESULT, ended="failsafe: thrust_lost", degraded_for_s=0.6)
    (row,) = healthy.summed_up("0.5 to 2", [RESULT, ended])
    assert (row["flights"], row["ended_early"], row["unsafe"]) == (2, 1, 0)
    assert row["degraded_share"] == pytest.approx(0.6 / (2 * SECONDS), abs=1e-6)
    assert len(row["early"]) == 1
    assert "1 of 2 ended early" in healthy.printed([row])


def test_blind_descents_begin_anywhere_in_the_air_and_are_summed_up_by_wake(tmp_path):
    cases = descents.cases(20, tmp_path / "any.onnx")
    assert len(cases) == 20 * len(descents.FAULTS) * len(descents.WAKE_FACTORS)
    begun_s = [case.moment.begins_s for case in cases]
    assert min(begun_s) > REST_S + 1.0
    assert max(begun_s) - min(begun_s) > 9.0
    assert len({case.moment.seed for case in cases}) == len(cases)
    flown_ones = [replace(RESULT, case=case, lower_mps=0.01 * n) for n, case in enumerate(cases)]
    rows = descents.summed_up(flown_ones)
    assert [row["flights"] for row in rows] == [20] * 8
    assert sum(row["unsafe"] for row in rows) == sum(one.lower_mps > 1.0 for one in flown_ones)
    assert rows[0]["median_lower_mps"] == pytest.approx(0.095)
    assert "link cut, wake x 0.5: 0 of 20 unsafe" in descents.printed(rows)


def test_the_section_sets_an_earlier_loop_beside_the_present_one(tmp_path):
    hard = replace(RESULT, lower_mps=2.0)
    lost = replace(RESULT, case=Case("battery pulled", MOMENT), lower_mps=3.0)
    for name, flights in (("faults-earlier", [hard, hard, lost]), ("faults", [hard, RESULT, lost])):
        told = {"faults": table.by_fault(flights), "unsafe_flights": table.unsafe_rows(flights)}
        record_of = {
            "commit": "4bc",
            "seconds": 14.0,
            "phases": ["in the air"],
            "exact": told,
        }
        (tmp_path / f"{name}.json").write_text(json.dumps(record_of))
    both = faults.faults(Records(tmp_path)).body
    assert "| link | 1 | 2 of 2 | 2 | 1 of 2 | 1 |" in both
    assert "*earlier* loop is that of commit `4bc`" in both
    assert "| not survivable | 1 | 1 of 1 | 1 | 1 of 1 | 1 |" in both
    assert "| link cut | 1 of 2 | 2.00 | 0.00 | 0.10 | 0.10 (2 of 2) | whole (2) |" in faults.page(
        Records(tmp_path)
    )
    unsafe = faults.page(Records(tmp_path)).partition("## Unsafe flights")[2]
    assert "| link cut | exact plant | in the air | PID | 2.00 | 0.00 | whole |" in unsafe
    assert "battery pulled" not in unsafe  # no command could have saved it
    (tmp_path / "faults.json").unlink()
    assert "| link | 1 | 2 of 2 | 2 |\n" in faults.faults(Records(tmp_path)).body


def test_the_page_says_why_flights_are_unsafe(tmp_path):
    cases = [Case(name, MOMENT) for name in ("push -3 N, 0.5 s", "range 200 ms old")]
    flights = [replace(RESULT, case=case, lower_mps=2.0) for case in cases]
    told = {"faults": table.by_fault(flights), "unsafe_flights": table.unsafe_rows(flights)}
    record_of = {"seconds": 14.0, "phases": ["in the air"], "exact": told}
    (tmp_path / "faults.json").write_text(json.dumps(record_of))
    page = faults.page(Records(tmp_path))
    assert "- *push -3 N*: " in page
    assert "- *range 200 ms old*: " in page
    assert "- *wake x 3*: " not in page
    assert set(faults.REASONS) <= {name.partition(",")[0] for name in FAULTS}
