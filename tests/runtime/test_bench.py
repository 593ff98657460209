"""Latency rows: measured on the real loop, judged by the right figure, told when they cannot be."""

import json
import os

import click.testing
import pytest

from runtime import bench
from runtime.bench import BenchRow, bench_latency, budget_ms
from wakedeploy.cli import bench as command_line
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.package import write_package
from wakedeploy.rig.file import default_rig


@pytest.fixture
def package(tiny_package, tmp_path):
    path = tmp_path / "tiny.onnx"
    write_package(tiny_package("state"), path)
    return path


def row(**changes):
    figures = {
        "arch": "gru", "ticks": 4000, "p50_ms": 1.0, "p99_ms": 2.0, "p999_ms": 3.0, "max_ms": 20.0,
        "cpu_percent": 3.0, "rss_mb": 120.0, "first_call_ms": 1.5, "overruns": 0, "realtime": False,
    }  # fmt: skip
    return BenchRow(**(figures | changes))


def test_the_budget_is_the_period_less_the_round_trip():
    assert budget_ms(default_rig()) == pytest.approx(13.25)


def test_enough_ticks_are_judged_by_p999_and_too_few_by_their_maximum():
    assert row().within(13.25)
    assert not row(p999_ms=14.0).within(13.25)
    assert not row(ticks=2999).within(13.25)
    assert row(ticks=2999, max_ms=13.0).within(13.25)


@pytest.mark.wallclock
def test_a_package_is_measured_in_the_real_loop_whatever_its_channels(package):
    seen = []
    (measured,) = bench_latency(
        [package], ticks=96, progress=lambda done, total: seen.append((done, total))
    )
    assert measured.arch == "gru"
    assert measured.ticks >= 90
    assert 0.0 < measured.p50_ms <= measured.p99_ms <= measured.p999_ms <= measured.max_ms
    assert set(measured.stages_ms) == {
        "t_read_s", "t_estimate_s", "t_predict_s", "t_control_s", "t_write_s", "wake-up",
    }  # fmt: skip
    assert 20.0 < measured.rss_mb < 400.0
    assert measured.first_call_ms > 0.0
    assert measured.is_preliminary
    assert seen[-1] == (96, 96)


def test_a_bad_package_is_told_before_anything_is_measured(package, tmp_path):
    with pytest.raises(UnusableInput, match="cannot be read"):
        bench_latency([package, tmp_path / "none.onnx"], ticks=10_000)


def test_a_rig_that_leaves_no_time_to_predict_is_not_measured(package):
    slow = default_rig().changed(latency={"round_trip_s": 0.03})
    with pytest.raises(UnusableInput, match="leaves no time"):
        bench_latency([package], ticks=96, rig=slow)


def test_what_the_measuring_process_could_not_do_is_told_here():
    with pytest.raises(UnusableInput, match="no real time"):
        bench._row_of('{"unusable": "no real time here"}\n', "a.onnx")
    with pytest.raises(CheckFailed, match="failsafe"):
        bench._row_of('noise\n{"failed": "ended in a failsafe"}\n', "a.onnx")
    with pytest.raises(CheckFailed, match="died"):
        bench._row_of("", "a.onnx")


def test_the_busy_processes_take_the_other_cores_and_end(monkeypatch):
    started = []
    real = bench.subprocess.Popen
    monkeypatch.setattr(bench.subprocess, "Popen", lambda a: started.append(real(a)) or started[-1])
    with bench._busy_cores():
        assert len(started) == len(os.sched_getaffinity(0)) - 1
    assert all(process.poll() is not None for process in started)


@pytest.mark.parametrize(
    ("rows", "status", "words"),
    [
        ([row(), row(arch="esn")], 0, "Verdict: within the budget of 13.25 ms (p99.9)"),
        ([row(), row(arch="esn", p999_ms=15.0)], 1, "Verdict: esn missed"),
        ([row(ticks=100, max_ms=5.0)], 0, "Preliminary verdict: within"),
        ([row(ticks=100)], 1, "Preliminary verdict: gru missed"),
    ],
)
def test_the_command_states_the_verdict_and_its_json(rows, status, words, tmp_path, monkeypatch):
    from wakedeploy.cli import main

    monkeypatch.setattr(bench, "bench_latency", lambda *args, **options: rows)
    told = tmp_path / "told.json"
    run = click.testing.CliRunner().invoke(
        main, ["bench", "latency", "a.onnx", "--json", str(told)]
    )
    assert (run.exit_code, words in run.output) == (status, True), run.output
    result = json.loads(told.read_text())
    assert result["budget_ms"] == pytest.approx(13.25)
    assert set(result["rows"][0]) == {
        "arch", "p50_ms", "p99_ms", "p999_ms", "max_ms", "cpu_percent", "rss_mb", "first_call_ms",
        "realtime", "within_budget",
    }  # fmt: skip
    assert command_line.as_json(rows, 13.25)["rows"] == result["rows"]
