"""As the real rig will be used: fly, smooth the logs, train on measured forces, fly the result."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.domains.gantry import record
from wakedeploy.rig.file import default_rig

FLIGHTS = 6


def run(*arguments: object) -> str:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.slow
def test_a_predictor_trained_on_measured_forces_improves_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for seed in range(FLIGHTS):
        record(None, seconds=18.5, seed=seed).without_truth().write_mcap(f"f{seed}.mcap")
    default_rig().write(Path("rig.toml"))
    logs = [f"f{seed}.mcap" for seed in range(FLIGHTS)]
    told = run("log", "smooth", *logs, "--rig", "rig.toml", "--out", "sets/measured")
    assert "Label noise leaves an R²" in told
    run("train", "--data", "sets/measured", "--arch", "history-mlp", "--epochs", 10)
    run("export", "--arch", "history-mlp", "--data", "sets/measured")
    rmse_m = {
        package: record(None, seconds=15.0, seed=901, package=package).tracking_rmse_m("true_z_m")
        for package in (None, "history-mlp.onnx")
    }
    assert rmse_m["history-mlp.onnx"] < 0.5 * rmse_m[None]
