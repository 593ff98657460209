"""What a predictor is worth in flight: limits, shares of the oracle's gain, and the command."""

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.episodes import Channel, Episode, EpisodeSet
from wakedeploy.study.closed_loop import Always, Tracked, mean_force, recovered, sentence, track


def lines(model_m: float) -> list[Tracked]:
    rng = np.random.default_rng(0)
    noise = 1.0 + 0.05 * rng.standard_normal((2, 12))
    return [
        Tracked("no compensation", np.full((1, 12), 0.040)),
        Tracked("oracle", np.full((1, 12), 0.010)),
        Tracked("mean force", np.full((1, 12), 0.022)),
        Tracked("gru", model_m * noise),
    ]


def test_a_models_share_is_of_what_the_oracle_gains() -> None:
    nothing, oracle, constant, model = lines(0.016)
    told = recovered(model, nothing, oracle)
    assert told.share == pytest.approx(0.8, abs=0.02)
    assert told.low < told.share < told.high
    assert recovered(oracle, nothing, oracle).share == 1.0
    assert recovered(nothing, nothing, oracle).share == 0.0
    told = sentence([nothing, oracle, constant, model], "gru")
    assert "a constant, already reaches 60 % [60, 60] of that gain" in told
    assert "gru, the best on validation, tracks to 15.9 mm, which is 80 %" in told
    assert "passes the oracle" not in told
    plain = Tracked("agile-mlp", np.full((1, 12), 0.020))
    told = sentence([nothing, oracle, constant, plain, model], "gru")
    assert "agile-mlp tracks to 20.0 mm, 67 % [67, 67]; 1 of 1 models with memory do better" in told
    lucky = Tracked("esn", np.full((1, 12), 0.009))
    assert "passes the oracle" in sentence([nothing, oracle, constant, lucky], "esn")


def test_all_fly_the_same_flights_and_the_oracle_is_ahead() -> None:
    always = Always((0.0, -0.5))
    nothing, oracle, constant = track([], 3, 4.0, constant=always)
    assert nothing.rms_m.shape == oracle.rms_m.shape == (1, 3)
    assert (oracle.rms_m < nothing.rms_m).all()
    assert (constant.rms_m < nothing.rms_m).all()  # the wake's mean pushes down
    again = track([], 3, 4.0, constant=always, workers=1)
    assert np.array_equal(again[0].rms_m, nothing.rms_m)


def test_the_constant_is_the_training_flights_mean() -> None:
    force = np.array([[1.0, -2.0], [3.0, -4.0]], np.float32)
    episodes = tuple(
        Episode(n, np.zeros((2, 1), np.float32), f * force) for n, f in (("a", 1), ("b", 9))
    )
    channels = (Channel("x", "N"), Channel("z", "N"))
    data = EpisodeSet("toy", 10.0, (Channel("o", "1"),), channels, 0.5, (1.0, 1.0),
                      {"a": "train", "b": "test"}, episodes)  # fmt: skip
    assert mean_force(data).force_n == (2.0, -3.0)
    assert mean_force(data)(np.zeros((4, 1))).tolist() == [[2.0, -3.0]] * 4


def test_the_command_flies_what_it_trained(tmp_path, monkeypatch) -> None:
    from wakedeploy.study import sets

    small = {"downwash": sets.Domain("downwash", "force_z_n", 1.0, 1.0, make=sets._downwash)}
    monkeypatch.setattr(sets, "DOMAINS", small)
    told = CliRunner().invoke(
        main, ["study", "closed-loop", "--quick", "--arch", "agile-mlp", "--out", str(tmp_path)]
    )
    assert told.exit_code == 0, told.output
    assert "agile-mlp" in told.output
    assert {p.suffix for p in (tmp_path / "closed-loop-quick").iterdir()} == {
        ".png", ".pdf", ".csv", ".json", ".html",
    }  # fmt: skip
