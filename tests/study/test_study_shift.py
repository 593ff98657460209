"""Models in another physics: orders compared, flights that differ in nothing else, the command."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.stats import kendalltau

from wakedeploy.cli import main
from wakedeploy.domains.downwash import fly, shifted
from wakedeploy.study.closed_loop import FIRST_SEED, Always, Tracked
from wakedeploy.study.shift import Crew, Shifted, agreement, fly_shifted, sentence


def told(spread: float, noise: float = 0.0, **errors_mm: float) -> Shifted:
    """Twelve flights of each, hard alike for all, and `noise` (a share) of a flight's own."""
    lines = {"no compensation": 30.0, "oracle": 10.0, "mean force": 24.0, **errors_mm}
    rng = np.random.default_rng(round(100 * spread))
    return Shifted(
        spread,
        tuple(
            Tracked(n.replace("_", "-"), 1e-3 * v * np.exp(noise * rng.standard_normal((3, 12))))
            for n, v in lines.items()
        ),
    )


def test_orders_agree_as_pairs_do() -> None:
    first = told(0.1, agile_mlp=25.0, gru=12.0, tcn=13.0, esn=14.0)
    same = told(0.5, agile_mlp=28.0, gru=15.0, tcn=16.0, esn=17.0)
    turned = told(0.75, agile_mlp=20.0, gru=24.0, tcn=23.0, esn=22.0)
    swapped = told(0.75, agile_mlp=28.0, gru=16.0, tcn=15.0, esn=17.0)
    for other in (same, turned, swapped):
        rank = [[line.mean_m for line in one.models] for one in (first, other)]
        assert agreement(first, other).tau == pytest.approx(kendalltau(*rank).statistic)
    assert agreement(first, same).kept is True
    assert agreement(first, turned).kept is False
    nominal = told(0.0, agile_mlp=24.0, gru=11.0, tcn=12.0, esn=13.0)
    text = sentence(nominal, [first, same, swapped], "gru")
    assert "gru, the best on validation, reaches 90 % [90, 90] of the oracle's gain there" in text
    assert "flies the nominal physics, it reaches 95 % [95, 95]" in text
    assert "at ±50 % it is number 1 of 4 and reaches 75 %" in text
    assert "at ±75 % it is number 2 of 4 and reaches 70 %" in text
    assert "at ±50 % it stays (Kendall's τ = 1.00 [1.00, 1.00]; of the 6 of 6 pairs" in text
    assert "at ±75 % it does not stay (Kendall's τ = 0.67 [0.67, 0.67]; of the 6 of 6 pairs that" \
        " the flights separate at both, 1 change places)" in text  # fmt: skip
    assert text.count("3 of 3 models with memory track clearly better") == 3
    worse = sentence(nominal, [first, turned], "gru")
    assert "at ±75 % 0 of 3 models with memory track clearly better than agile-mlp and 3" in worse


def test_an_order_within_the_noise_is_left_open() -> None:
    close = {"agile_mlp": 25.0, "gru": 12.0, "tcn": 12.05, "esn": 12.1, "mamba": 12.02}
    first, other = told(0.1, 0.1, **close), told(0.5, 0.1, **close)
    found = agreement(first, other)
    assert found.kept is None
    assert found.turned == 0
    assert found.low < found.tau < found.high
    text = sentence(told(0.0, **close), [first, other], "gru")
    assert "at ±50 % it is not clear" in text
    assert "4 of 4 models with memory track clearly better" in text  # of that they are sure
    few = [Shifted(one.spread, tuple(Tracked(x.name, x.rms_m[:, :4]) for x in one.lines))
           for one in (first, other)]  # fmt: skip
    assert agreement(*few).kept is None


def test_of_models_that_fly_alike_no_order_is_ever_said_to_turn() -> None:
    alike = {f"model_{i}": 12.0 for i in range(7)}
    rng = np.random.default_rng(0)
    verdicts = []
    for _ in range(20):
        noisy = [
            Shifted(0.1, tuple(Tracked(n, 1e-3 * v * np.exp(0.1 * rng.standard_normal((3, 12))))
                               for n, v in {"a": 3.0, "b": 1.0, "c": 2.0, **alike}.items()))
            for _ in range(2)
        ]  # fmt: skip
        verdicts.append(agreement(*noisy).kept)
    assert verdicts.count(None) >= 19


@pytest.mark.slow
def test_only_the_physics_differs_between_spreads() -> None:
    crew = Crew([], Always((0.0, -0.5)))
    both = fly_shifted({0.1: crew, 0.5: crew}, 2, 1.0)
    narrow, wide = both
    assert narrow.lines[0].rms_m.shape == (1, 2)
    assert not np.allclose(narrow.lines[0].rms_m, wide.lines[0].rms_m)
    again = fly_shifted({0.5: crew}, 2, 1.0)[0]
    assert np.array_equal(again.lines[1].rms_m, wide.lines[1].rms_m)
    # Also beside a wider spread, whose wake takes longer to arrive, the references' stretch is one.
    seeds = [FIRST_SEED, FIRST_SEED + 1]
    worlds = [shifted(seeds, s) for s in (0.1, 0.5)]
    late_s = worlds[1].settling_s
    assert late_s > worlds[0].settling_s
    ways = [fly(seeds, world=w, seconds=1.0, settling_s=late_s) for w in worlds]
    assert len(ways[0].force_n) == len(ways[1].force_n) == 100
    for one, flown in zip(both, ways, strict=True):
        assert one.lines[0].rms_m[0] == pytest.approx(flown.tracking_m)
    worlds = [shifted(seeds, s) for s in (0.5, 0.75)]
    moved = [(w.speed_mps / 6.0 - 1.0) / s for w, s in zip(worlds, (0.5, 0.75), strict=True)]
    assert moved[0] == pytest.approx(moved[1])  # the same draw, farther
    assert np.abs(moved[0]).max() <= 1.0


@pytest.mark.slow
@pytest.mark.usefixtures("short_episodes")
def test_the_command_flies_what_it_trained(tmp_path, monkeypatch) -> None:
    from wakedeploy.study import sets, shift

    small = {
        "downwash": sets.Domain(
            "downwash", "force_z_n", 1.0, 1.0, make=sets.DOMAINS["downwash"].make
        )
    }
    monkeypatch.setattr(shift, "DOMAINS", small)
    monkeypatch.setattr(sets, "DOMAINS", small)
    monkeypatch.setattr(shift, "FLOWN", (0.1, 0.2))

    def briefly(crews, episodes, seconds, **others):
        return fly_shifted(crews, episodes, 0.25 * seconds, **others)

    monkeypatch.setattr(shift, "fly_shifted", briefly)
    run = CliRunner().invoke(
        main,
        ["study", "shift", "--quick", "--arch", "agile-mlp,history-mlp", "--out", str(tmp_path)],
    )
    assert run.exit_code == 0, run.output
    assert "Kendall's τ" in run.output
    flown = json.loads((tmp_path / "shift-quick" / "study.json").read_text())["rms_m"]
    assert set(flown) == {"0", "0.1", "0.2"}
    for own in flown.values():
        assert set(own) == {"no compensation", "oracle", "mean force", "agile-mlp", "history-mlp"}
    assert {p.suffix for p in (tmp_path / "shift-quick").iterdir()} == {
        ".png", ".pdf", ".csv", ".json", ".html",
    }  # fmt: skip
