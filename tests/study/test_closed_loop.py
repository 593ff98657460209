"""What a predictor is worth in flight: limits, shares of the oracle's gain, and the command."""

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.study.closed_loop import Tracked, recovered, sentence, track


def lines(model_m: float) -> list[Tracked]:
    rng = np.random.default_rng(0)
    noise = 1.0 + 0.05 * rng.standard_normal((2, 12))
    return [
        Tracked("no compensation", np.full((1, 12), 0.040)),
        Tracked("oracle", np.full((1, 12), 0.010)),
        Tracked("gru", model_m * noise),
    ]


def test_a_models_share_is_of_what_the_oracle_gains() -> None:
    nothing, oracle, model = lines(0.016)
    told = recovered(model, nothing, oracle)
    assert told.share == pytest.approx(0.8, abs=0.02)
    assert told.low < told.share < told.high
    assert recovered(oracle, nothing, oracle).share == 1.0
    assert recovered(nothing, nothing, oracle).share == 0.0
    assert "gru is the best model with 15.9 mm, which is 80 %" in sentence([nothing, oracle, model])


def test_all_fly_the_same_flights_and_the_oracle_is_ahead() -> None:
    nothing, oracle = track([], 3, 4.0)
    assert nothing.rms_m.shape == oracle.rms_m.shape == (1, 3)
    assert (oracle.rms_m < nothing.rms_m).all()
    assert np.array_equal(track([], 3, 4.0)[0].rms_m, nothing.rms_m)


def test_the_command_flies_what_it_trained(tmp_path, monkeypatch) -> None:
    from wakedeploy.study import sets

    small = {"downwash": sets.Domain("downwash", "force_z_n", 1.0, 1.0, make=sets._downwash)}
    monkeypatch.setattr(sets, "DOMAINS", small)
    told = CliRunner().invoke(
        main, ["study", "closed-loop", "--quick", "--arch", "agile-mlp", "--out", str(tmp_path)]
    )
    assert told.exit_code == 0, told.output
    assert "agile-mlp" in told.output
    assert {p.suffix for p in (tmp_path / "closed-loop").iterdir()} == {
        ".png", ".pdf", ".csv", ".json", ".html",
    }  # fmt: skip
