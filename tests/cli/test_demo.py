"""The demo does the main job with real commands, twice over in the same folder."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from wakedeploy.cli import main


@pytest.mark.slow
def test_the_demo_flies_better_with_feedforward_and_can_be_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["demo", "--seconds", "10", "--json", "result.json"]
    for minutes in ("3", "4"):
        told = CliRunner().invoke(main, [*arguments, "--minutes", minutes])
        assert told.exit_code == 0, told.output
        result = json.loads(Path("result.json").read_text())
        assert result["feedforward_rmse_mm"] < 0.5 * result["pid_rmse_mm"]
        assert 0.0 < result["latency"]["p99_ms"] <= result["latency"]["max_ms"]
        assert Path("demo/demo.png").read_bytes().startswith(b"\x89PNG")
