"""As the real rig will be used: fly, smooth the logs, train on measured forces, fly the result."""

from pathlib import Path

import numpy as np
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


def test_a_predictor_trained_on_measured_forces_improves_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for seed in range(FLIGHTS):
        record(None, seconds=20.0, seed=seed).without_truth().write_mcap(f"f{seed}.mcap")
    default_rig().write(Path("rig.toml"))
    logs = [f"f{seed}.mcap" for seed in range(FLIGHTS)]
    told = run("log", "smooth", *logs, "--rig", "rig.toml", "--out", "sets/measured")
    assert "Label noise leaves an R²" in told
    run("train", "--data", "sets/measured", "--arch", "history-mlp", "--epochs", 15)
    run("export", "--arch", "history-mlp", "--data", "sets/measured")
    rmse_mm = {
        package: np.mean(
            [
                1e3 * flight.tracking_rmse_m("true_z_m")
                for s in (901, 902)
                for flight in [record(None, seconds=20.0, seed=s, package=package)]
            ]
        )
        for package in (None, "history-mlp.onnx")
    }
    assert rmse_mm["history-mlp.onnx"] < 0.5 * rmse_mm[None]
