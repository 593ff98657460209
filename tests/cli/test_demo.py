"""The demo does the main job with real commands, twice over in the same folder."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.cli.demo import _compared, _latency_sentence


@pytest.mark.slow
def test_the_demo_flies_better_with_feedforward_and_again_the_same_to_the_digit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["demo", "--seconds", "10", "--flights", "3", "--json", "result.json"]
    results = []
    for minutes in ("3", "4", "3"):
        demo = CliRunner().invoke(main, [*arguments, "--minutes", minutes])
        assert demo.exit_code == 0, demo.output
        results.append(json.loads(Path("result.json").read_text()))
        assert Path("demo/demo.png").read_bytes().startswith(b"\x89PNG")
    assert results[0]["rmse_mm"] == results[2]["rmse_mm"] != results[1]["rmse_mm"]
    rmse_mm = results[0]["rmse_mm"]
    assert rmse_mm["feedforward"]["mean"] < 0.5 * rmse_mm["pid"]["mean"]
    assert rmse_mm["pid"]["flights"] == 3


def test_a_busy_computer_is_information_and_no_failure() -> None:
    figures = {"budget_ms": 13.25, "ticks": 193, "p99_ms": 20.1, "max_ms": 71.0}
    over = _latency_sentence(figures | {"within_budget": False})
    assert "this computer was busy: p99 20.10 ms" in over
    assert "wakedeploy bench latency" in over
    failed = _latency_sentence({"budget_ms": 13.25, "within_budget": False, "failed": "It died."})
    assert "not measured: It died; run" in failed
    assert "within the budget" in _latency_sentence(figures | {"within_budget": True})


def test_the_demo_fails_where_the_predictor_does_not_help_beyond_its_error() -> None:
    rmse = {"pid": {}, "feedforward": {}}
    for mean, error, ok in ((10.0, 1.0, True), (1.0, 1.0, False), (-5.0, 1.0, False)):
        flown = {"rmse_mm": rmse, "gain_mm": {"mean": mean, "standard_error": error}}
        assert _compared(flown)["ok"] is ok
