"""The watch: quiet where the rig file explains a flight, loud where it lacks something."""

import subprocess
import sys

import numpy as np
import pytest

from runtime.loop.watch import GapWatch
from runtime.loop.watch_filter import WatchFilter
from runtime.loop.watch_forecast import STEP_S, Model, PulsePath
from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.core.runlog import read_run_log
from wakedeploy.domains.gantry import record
from wakedeploy.rig.file import default_rig

RIG = default_rig()
CLI = [sys.executable, "-c", "from wakedeploy.cli import main; main()", "run-gantry"]


@pytest.fixture(scope="module")
def flight():
    return list(record(RIG, seconds=20, seed=3).rows())


def watched(rows, rig=RIG, tell=None):
    watch = GapWatch(rig, tell)
    return watch, [watch.step(row) for row in rows]


def test_innovations_of_the_rig_s_own_flight_are_white_and_of_unit_size(flight):
    watching = WatchFilter(RIG)
    seen = [watching.step(row) for row in flight]
    whitened = np.array([one.whitened for one in seen if one is not None])
    assert len(whitened) > 400
    inner = whitened[np.abs(whitened) < 5.0]  # readings that missed the reflector
    assert np.mean(inner**2) == pytest.approx(1.0, abs=0.2)
    assert abs(np.mean(inner[1:] * inner[:-1])) < 0.2
    assert np.max(np.abs(watching.departures())) < 3.5


def test_no_sentence_for_the_rig_s_own_flight_and_a_score_only_in_the_air(flight):
    said = []
    watch, scores = watched(flight, tell=said.append)
    assert said == []
    assert 0.0 < watch.report.worst < 1.0
    told = [row for row, score in zip(flight, scores, strict=True) if score is not None]
    assert {row["mode"] for row in told} == {"RUNNING"}
    assert len(told) > 250


def test_a_rig_file_without_spool_lag_is_left_within_seconds(flight):
    said = []
    watch, _ = watched(flight, RIG.without("spool"), said.append)
    assert watch.report.worst > 1.0
    assert watch.report.first_left_s < 3.0 + 10.0  # at rest for the first three
    assert "not explained by the rig file from" in watch.report.sentence()


def test_a_calibration_error_of_the_stated_size_is_no_gap():
    heavier = [1.03 * thrust for thrust in RIG.thrust.sufferer.thrust_n]
    truth = RIG.changed(
        thrust={"sufferer": {"thrust_n": heavier}}, wake={"strength": 1.1 * RIG.wake.strength}
    )
    rows = list(record(truth, seconds=14, seed=5, model_rig=RIG).rows())
    watch, _ = watched(rows)
    assert watch.report.worst < 1.0


@pytest.mark.whole
def test_an_effect_in_the_rig_file_is_part_of_what_it_explains():
    def above_the_base(t_s, state):
        return 0.3 * state["sufferer_thrust_n"] / (1.0 + (state["z_m"] / 0.15) ** 2)

    rows = list(record(RIG, seconds=14, seed=6, force_hook=above_the_base).rows())
    without, _ = watched(rows)
    effect = {
        "name": "ground-effect",
        "parameters": {
            "gain": {"value": 0.3, "unit": "1"},
            "height_m": {"value": 0.15, "unit": "m"},
        },
    }
    raw = RIG.model_dump(by_alias=True, exclude_none=True) | {"effect": (effect,)}
    with_effect, _ = watched(rows, type(RIG).model_validate(raw))
    assert without.report.worst > 1.5
    assert with_effect.report.worst < 1.0


@pytest.mark.whole
def test_a_belt_s_play_in_the_rig_file_is_part_of_what_it_explains():
    play = Effect(name="belt-backlash",
                  parameters={"backlash_m": EffectParameter(value=0.15, unit="m")})  # fmt: skip
    rig = RIG.model_copy(update={"effect": (play,)})
    rows = list(record(rig, seconds=20, seed=6, model_rig=RIG).rows())
    without, _ = watched(rows)
    with_effect, _ = watched(rows, rig)
    assert without.report.worst > 1.0
    assert with_effect.report.worst < 0.8


@pytest.mark.whole
@pytest.mark.parametrize("hold_s", [0.04, 0.07])
def test_a_sensor_that_repeats_itself_as_the_rig_file_says_is_no_gap(hold_s: float) -> None:
    held = Effect(name="sample-and-hold",
                  parameters={"hold_s": EffectParameter(value=hold_s, unit="s")})  # fmt: skip
    rig = RIG.model_copy(update={"effect": (held,)})
    rows = list(record(rig, seconds=20, seed=5, model_rig=RIG).rows())
    watch, scores = watched(rows, rig)
    assert 0.0 < watch.report.worst < 1.0
    assert sum(score is not None for score in scores) > 50


def test_samples_that_stop_and_come_back_do_not_alarm(flight):
    rows = []
    for row in flight:
        if 8.0 < row["t_s"] < 9.5:
            row = row | {"range_m": None}
        elif 12.0 < row["t_s"] < 12.4:
            row = row | {"range_repeats": 3}
        rows.append(row)
    watch, scores = watched(rows)
    assert watch.report.worst < 1.0
    gap = [s for row, s in zip(rows, scores, strict=True) if 8.0 < row["t_s"] < 9.5]
    assert set(gap) == {None}


def test_a_clock_that_jumps_by_a_day_is_caught_up_at_once(flight):
    day_s = 86_400.0
    times = ("t_s", "applied_time_s")
    late = [row | {name: row[name] + day_s for name in times} for row in flight[320:]]
    watching = WatchFilter(RIG)
    for row in flight[:320]:
        watching.step(row)
    before_s = flight[319]["t_s"]
    seen = [one for one in map(watching.step, late) if one is not None]
    assert seen[0].sample_s > before_s + day_s
    assert np.mean(np.square([np.clip(one.whitened, -3, 3) for one in seen])) < 1.5


def test_a_rest_without_flight_is_not_judged(flight):
    watch, scores = watched([row | {"mode": "ARMED"} for row in flight])
    assert set(scores) == {None}
    assert watch.report.sentence() == "too little flight to judge"


def test_an_excursion_is_told_once_and_so_is_the_way_back(flight, monkeypatch):
    from runtime.loop import watch as module

    said = []
    monkeypatch.setattr(GapWatch, "_say", lambda self, sentence: said.append(sentence))
    watch = module.GapWatch(RIG)
    for at, score in enumerate((0.2, 1.1, 1.4, 0.9, 1.2, 0.7, 0.3)):
        watch._note(score, "a reason", float(at))
    assert [("no longer" in one, "again" in one) for one in said] == [(True, False), (False, True)]
    assert watch.report.worst == 1.4


def test_pulses_wait_for_their_way_the_slew_and_the_frame():
    rig = RIG.changed(latency={"round_trip_s": 0.02}, limits={"slew_us_per_s": 20_000})
    path = PulsePath(*Model.of(rig))
    path.frame_seen(0.005)
    path.sent(0.0, 1400.0, 1100.0)
    held = []
    for step in range(8):
        t_s = step * STEP_S
        for one in path.advance(t_s, t_s + STEP_S):
            held.append((t_s, one.span_s, one.source_us, one.sufferer_us))
            t_s += one.span_s
    starts = {round(source, 3): t_s for t_s, _, source, _ in reversed(held)}
    # Sent at 0, there at 10 ms, at 20 µs per millisecond; frames at 5, 25, 45 ms.
    assert sum(span_s for _, span_s, *_ in held) == pytest.approx(8 * STEP_S)
    assert starts[1000.0] == 0.0
    assert starts[1300.0] == pytest.approx(0.025)
    assert starts[1400.0] == pytest.approx(0.045)
    assert {s for t_s, _, _, s in held if t_s >= 0.0249} == {1100.0}


def flown(tmp_path, name, *arguments):
    log = tmp_path / f"{name}.mcap"
    done = subprocess.run(
        [*CLI, "--baseline", "--virtual", "--watch-gap", "--log", str(log), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done, read_run_log(log)


@pytest.mark.slow
def test_the_virtual_gantry_warns_of_a_missing_spool_lag_and_of_nothing_else(tmp_path):
    truth, model = tmp_path / "truth.toml", tmp_path / "model.toml"
    RIG.write(truth)
    RIG.without("spool").write(model)
    lacking, log = flown(tmp_path, "lacking", "--rig", model, "--plant-rig", truth, "--seconds", 20)
    assert lacking.stderr.count("no longer explains this flight") == 1
    assert "not explained by the rig file" in lacking.stdout
    assert np.nanmax(log["gap_score"]) > 1.0
    whole, log = flown(tmp_path, "whole", "--rig", truth, "--seconds", 20)
    assert whole.stderr == ""
    assert "explained by the rig file" in whole.stdout
    assert np.nanmax(log["gap_score"]) < 1.0
    assert np.isnan(log["gap_score"][log["mode"] == "ARMED"]).all()
