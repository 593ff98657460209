"""The numbers of `log show`, against ones counted by hand."""

import math

import numpy as np
import pytest

from runtime.loop.tally import Tally
from wakedeploy.core.run_figure import draw_run
from wakedeploy.core.run_summary import summarise
from wakedeploy.core.runlog import RunLog

TICKS = 320


def rows() -> list[dict[str, object]]:
    """1 s at rest, 8 s flown 3 mm too high with one degraded second, 1 s at rest."""
    made = []
    for tick in range(TICKS):
        flying = 32 <= tick < 288
        mode = "ARMED" if not flying else "DEGRADED" if tick < 64 else "RUNNING"
        made.append(
            {
                "tick": tick,
                "t_s": tick / 32,
                "range_m": 0.5,
                "range_repeats": int(tick % 10 == 0),
                "z_ref_m": 0.5,
                "z_est_m": 0.503 if flying else 0.7,
                "round_trip_s": 0.011,
                "t_read_s": 0.001,
                "t_estimate_s": 0.001,
                "t_predict_s": 0.002,
                "t_control_s": 0.0005,
                "t_write_s": 0.0005,
                "mode": mode,
                "faults": "late+outlier" if tick == 40 else "late" if tick == 41 else "",
            }
        )
    return made


def ended_by(faults: str) -> list[dict[str, object]]:
    """The same flight, which a failsafe ends at tick 250."""
    down = {"mode": "FAILSAFE", "faults": faults}
    return [row | down if 250 <= row["tick"] < 288 else row for row in rows()]


def summary_of(made: list[dict[str, object]], **metadata: str):
    return summarise(RunLog.from_rows(made, {"rate_hz": "32"} | metadata))


def test_how_a_run_ended_is_in_its_own_words() -> None:
    assert summary_of(rows(), ended="stopped by hand").ended == "stopped by hand"
    assert summary_of(rows()).ended == ""


def test_tracking_is_scored_while_flying() -> None:
    told = summary_of(rows())
    assert told.tracking_rmse_m == pytest.approx(0.003)
    assert told.tracking_max_m == pytest.approx(0.003)
    assert math.isnan(told.true_tracking_rmse_m)
    assert told.flying_s == pytest.approx(8.0)


def test_time_in_modes_and_faults_are_counted() -> None:
    told = summary_of(rows())
    assert told.seconds_in_mode == {"ARMED": 2.0, "RUNNING": 7.0, "DEGRADED": 1.0}
    assert told.faults == {"late": 2, "outlier": 1}
    assert (told.duration_s, told.rate_hz) == pytest.approx((10.0, 32.0))
    assert told.range_repeated == 32


def test_computing_is_the_sum_of_the_stages() -> None:
    made = rows()
    made[100]["t_predict_s"] = 0.012
    told = summary_of(made)
    assert told.computing_s.p50 == pytest.approx(0.005)
    assert told.computing_s.max == pytest.approx(0.015)
    assert told.stages_s["t_predict_s"].max == pytest.approx(0.012)
    assert told.round_trip_s.p99 == pytest.approx(0.011)


def test_slow_and_skipped_ticks_are_overruns_and_dropped_rows_are_not() -> None:
    made = rows()
    made[100]["t_write_s"] = 0.04
    made[101]["faults"] = "overrun"
    del made[200:203]
    assert summary_of(made).overruns == 2 + 3
    told = summary_of(made, dropped="3")
    assert (told.overruns, told.dropped) == (2, 3)


def test_a_tick_that_began_late_hides_and_feigns_no_skipped_one() -> None:
    made = rows()
    made[90]["t_s"] = 90.55 / 32  # 1.55 periods after the tick before
    assert summary_of(made).overruns == 0
    made[50]["t_s"] = 50.45 / 32
    made[52]["t_s"] = 51.9 / 32
    del made[51]  # the gap in time is 1.45 periods
    assert summary_of(made).overruns == 1


def test_the_log_and_the_run_itself_count_the_same_overruns() -> None:
    made, tally, next_tick = rows(), Tally(period_s=1 / 32), 0
    made[100]["faults"] = "overrun"
    del made[200:203]
    for row in made:
        skipped, next_tick = row["tick"] - next_tick, row["tick"] + 1
        tally.add(row, 0.0, skipped, overran="overrun" in row["faults"])
    assert summary_of(made).overruns == tally.overruns == 4
    assert summary_of(made).tracking_rmse_m == pytest.approx(tally.rmse_m)


def test_a_clock_that_jumps_is_told_with_its_place() -> None:
    made = rows()
    for row in made[200:]:
        row["t_s"] += 3600.0
    (note,) = summary_of(made).notes
    assert "t_s jumps by 3600 s after tick 199 (6.21875 s, then 3606.25 s), so" in note
    for row in made[300:]:
        row["t_s"] += 20.0
    (note,) = summarise(RunLog.from_rows(made)).notes
    assert "after tick 199" in note
    assert "the first of 2 jumps" in note


def test_ticks_that_were_not_recorded_are_no_jump_of_the_clock() -> None:
    made = rows()
    del made[100:180]
    assert summary_of(made).notes == ()


def test_a_failsafe_is_told_with_its_time_and_the_fault_that_explains_the_others() -> None:
    made = ended_by("sensor_lost+late_prediction")
    told = summary_of(made)
    assert (told.failsafe_s, told.failsafe_cause) == (250 / 32, "sensor_lost")
    assert math.isnan(summary_of(rows()).failsafe_s)
    made[250]["faults"] = None
    assert summary_of(made).failsafe_cause == "sensor_lost"  # the tick after says it, too
    assert summary_of(ended_by("")).failsafe_cause == ""


def test_simulated_runs_are_scored_against_the_truth_too() -> None:
    told = summary_of([row | {"true_z_m": 0.504} for row in rows()])
    assert told.true_tracking_rmse_m == pytest.approx(0.004)


@pytest.mark.parametrize("ticks", [0, 1, 2])
def test_a_run_that_hardly_happened_can_be_shown(ticks: int) -> None:
    log = RunLog.from_rows(rows()[:ticks], {})
    told = summarise(log)
    assert told.ticks == ticks
    assert len(draw_run(log, told, "short").axes) >= 5


def test_the_picture_shows_what_was_recorded() -> None:
    log = RunLog.from_rows(rows(), {"rate_hz": "32"})
    drawn = draw_run(log, summarise(log), "flight")
    drawn_lines = {line.get_label(): line for panel in drawn.axes for line in panel.lines}
    height = np.asarray(drawn_lines["estimate"].get_ydata())
    np.testing.assert_array_equal(height, log["z_est_m"])
    said = [text.get_text() for panel in drawn.axes for text in panel.texts]
    assert "not recorded" in said  # no force in this log
    assert "DEGRADED" in said
