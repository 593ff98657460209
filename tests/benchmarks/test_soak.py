"""The long flight in lockstep: a short form of it, and that it would see what it looks for."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.soak import Growth, read_back, soak_plan, soaked
from runtime.loop.loop import PERIOD_S
from wakedeploy.core.runlog_mcap import RunLogWriter
from wakedeploy.rig.file import default_rig

RIG = default_rig()


@pytest.mark.slow
def test_in_ten_minutes_of_flight_nothing_grows_drifts_leaks_or_gets_lost(tmp_path: Path) -> None:
    told = soaked(20_000, None, tmp_path)
    assert told["ticks"] >= 20_000
    assert told["ended"] == ["whole"]
    assert told["lost"] == told["unanswered"] == told["faults"] == 0
    longest = told["longest"]
    assert longest["skipped"] == 0
    held = longest["growth"]
    assert held["descriptors"][-1] <= held["descriptors"][1]
    assert held["resident_mb"][-1] - held["resident_mb"][len(held["resident_mb"]) // 2] < 10.0
    log = longest["log"]
    assert abs(log["drift_us"]) < 100.0  # a tick wakes up 0.3 ms late, more or less
    assert 1.0 < log["latest_ms"] < 3.5
    assert log["oldest_pulse_ms"] < 60.0  # a period, a servo frame and the way
    assert 10.0 < log["mb_per_h"] < 100.0
    assert list(tmp_path.iterdir()) == []


def test_what_is_lost_late_or_unanswered_is_seen_in_a_log(tmp_path: Path) -> None:
    writer = RunLogWriter(tmp_path / "log.mcap", {})
    sequence = 65_530
    for tick in (n for n in range(100) if n not in (40, 41)):
        sequence += 0 if tick == 60 else 1
        late_s = 0.002 if tick == 70 else 1e-6 * tick
        row = {"tick": tick, "t_s": tick * PERIOD_S + late_s, "faults": "late" if tick == 9 else ""}
        row |= {"applied_time_s": row["t_s"] - 0.02, "seq_echo": sequence % 65_536, "mode": "ARMED"}
        writer.write(row, round(1e9 * row["t_s"]))
    writer.close()
    told = read_back(tmp_path / "log.mcap")
    assert (told.rows, told.lost, told.unanswered, told.faults) == (98, 2, 1, 1)
    assert told.latest_ms == pytest.approx(2.0)
    assert told.drift_us == pytest.approx(91.0, abs=1.0)
    assert told.oldest_pulse_ms == pytest.approx(20.0)


def test_memory_that_grows_has_a_slope() -> None:
    growth = Growth(list(range(0, 115_201, 1152)), [], [])  # an hour
    growth.resident_mb = [100.0 + 50.0 * min(tick / 57_600, 1.0) for tick in growth.ticks]
    assert growth.mb_per_h() == pytest.approx(0.0, abs=0.1)
    growth.resident_mb = [100.0 + 7.0 * tick / 115_200 for tick in growth.ticks]
    assert growth.mb_per_h() == pytest.approx(7.0)


def test_the_plan_of_a_soak_begins_every_minute_on_the_stop() -> None:
    plan = soak_plan(RIG, 5000, 3)
    assert len(plan) == 5000
    for tick in (0, 1919, 1920, 3839, 3840):
        assert abs(plan.z_m[tick]) < 0.01
    assert plan.z_m.max() > 0.3
    assert np.abs(plan.x_m).max() > 0.1
