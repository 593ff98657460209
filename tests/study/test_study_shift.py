"""Models in another physics: orders compared, flights that differ in nothing else, the command."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.domains.downwash import fly, shifted
from wakedeploy.study.closed_loop import FIRST_SEED, Always, Tracked
from wakedeploy.study.shift import Crew, Shifted, agreement, fly_shifted, sentence


def told(spread: float, **errors_mm: float) -> Shifted:
    lines = {"no compensation": 30.0, "oracle": 10.0, "mean force": 24.0, **errors_mm}
    return Shifted(
        spread,
        tuple(Tracked(n.replace("_", "-"), np.full((1, 4), 1e-3 * v)) for n, v in lines.items()),
    )


def test_orders_agree_as_pairs_do() -> None:
    first = told(0.1, agile_mlp=25.0, gru=12.0, tcn=13.0, esn=14.0)
    same = told(0.5, agile_mlp=28.0, gru=15.0, tcn=16.0, esn=17.0)
    turned = told(0.75, agile_mlp=20.0, gru=24.0, tcn=23.0, esn=22.0)
    swapped = told(0.75, agile_mlp=28.0, gru=16.0, tcn=15.0, esn=17.0)
    assert agreement(first, same) == pytest.approx(1.0)
    assert agreement(first, turned) == pytest.approx(-1.0)
    assert agreement(first, swapped) == pytest.approx(1.0 - 2.0 * 1.0 / 6.0)  # one pair of six
    nominal = told(0.0, agile_mlp=24.0, gru=11.0, tcn=12.0, esn=13.0)
    text = sentence(nominal, [first, same, swapped], "gru")
    assert "gru, the best on validation, reaches 90 % of the oracle's gain there" in text
    assert "(95 % where it learned and flies the nominal physics)" in text
    assert "at ±50 % it is number 1 of 4 with 75 %" in text
    assert "at ±75 % it is number 2 of 4 with 70 %" in text
    assert "85 % against 25 % at ±10 %" in text
    assert "In the paper the order stays; here it does not." in text  # τ = 2/3
    assert "so it does here" in sentence(nominal, [first, same], "gru")


def test_only_the_physics_differs_between_spreads() -> None:
    crew = Crew([], Always((0.0, -0.5)))
    narrow, wide = fly_shifted({0.0: crew, 0.5: crew}, 2, 2.0)
    assert narrow.lines[0].rms_m.shape == (1, 2)
    assert not np.allclose(narrow.lines[0].rms_m, wide.lines[0].rms_m)
    again = fly_shifted({0.5: crew}, 2, 2.0)[0]
    assert np.array_equal(again.lines[1].rms_m, wide.lines[1].rms_m)
    # Also beside a wider spread, whose wake takes longer to arrive, the references' stretch is one.
    seeds = [FIRST_SEED, FIRST_SEED + 1]
    worlds = [shifted(seeds, s) for s in (0.1, 0.5)]
    late_s = worlds[1].settling_s
    assert late_s > worlds[0].settling_s
    ways = [fly(seeds, world=w, seconds=1.0, settling_s=late_s) for w in worlds]
    assert len(ways[0].force_n) == len(ways[1].force_n) == 100
    both = fly_shifted({0.1: crew, 0.5: crew}, 2, 1.0)
    for one, flown in zip(both, ways, strict=True):
        assert one.lines[0].rms_m[0] == pytest.approx(flown.tracking_m)
    worlds = [shifted(seeds, s) for s in (0.5, 0.75)]
    moved = [(w.speed_mps / 6.0 - 1.0) / s for w, s in zip(worlds, (0.5, 0.75), strict=True)]
    assert moved[0] == pytest.approx(moved[1])  # the same draw, farther
    assert np.abs(moved[0]).max() <= 1.0


def test_the_command_flies_what_it_trained(tmp_path, monkeypatch) -> None:
    from wakedeploy.study import sets, shift

    small = {"downwash": sets.Domain("downwash", "force_z_n", 1.0, 1.0, make=sets._downwash)}
    monkeypatch.setattr(shift, "DOMAINS", small)
    monkeypatch.setattr(sets, "DOMAINS", small)
    monkeypatch.setattr(shift, "FLOWN", (0.1, 0.3))
    run = CliRunner().invoke(
        main, ["study", "shift", "--quick", "--arch", "agile-mlp,esn", "--out", str(tmp_path)]
    )
    assert run.exit_code == 0, run.output
    assert "Kendall's τ" in run.output
    flown = json.loads((tmp_path / "shift-quick" / "study.json").read_text())["rms_m"]
    assert set(flown) == {"0", "0.1", "0.3"}
    for own in flown.values():
        assert set(own) == {"no compensation", "oracle", "mean force", "agile-mlp", "esn"}
    assert {p.suffix for p in (tmp_path / "shift-quick").iterdir()} == {
        ".png", ".pdf", ".csv", ".json", ".html",
    }  # fmt: skip
