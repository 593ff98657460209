"""Models in another physics: orders compared, flights that differ in nothing else, the command."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.domains.downwash import shifted
from wakedeploy.study.closed_loop import FIRST_SEED, Tracked
from wakedeploy.study.shift import Shifted, agreement, fly_shifted, sentence


def told(spread: float, **errors_mm: float) -> Shifted:
    lines = {"no compensation": 30.0, "oracle": 10.0, **errors_mm}
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
    text = sentence([first, same, swapped])
    assert "gru tracks best with 90 % of the oracle's gain" in text
    assert "at ±50 % gru is still the best" in text
    assert "at ±75 % gru gives way to tcn" in text
    assert "85 % against 25 % at ±10 %" in text


def test_only_the_physics_differs_between_spreads() -> None:
    narrow, wide = fly_shifted([], 2, 2.0, spreads=(0.0, 0.5))
    assert narrow.lines[0].rms_m.shape == (1, 2)
    assert not np.allclose(narrow.lines[0].rms_m, wide.lines[0].rms_m)
    again = fly_shifted([], 2, 2.0, spreads=(0.5,))[0]
    assert np.array_equal(again.lines[1].rms_m, wide.lines[1].rms_m)
    worlds = [shifted([FIRST_SEED, FIRST_SEED + 1], s) for s in (0.5, 0.75)]
    moved = [(w.speed_mps / 6.0 - 1.0) / s for w, s in zip(worlds, (0.5, 0.75), strict=True)]
    assert moved[0] == pytest.approx(moved[1])  # the same draw, farther
    assert np.abs(moved[0]).max() <= 1.0


def test_the_command_flies_what_it_trained(tmp_path, monkeypatch) -> None:
    from wakedeploy.study import sets, shift

    small = {"downwash": sets.Domain("downwash", "force_z_n", 1.0, 1.0, make=sets._downwash)}
    monkeypatch.setattr(shift, "DOMAINS", small)
    monkeypatch.setattr(shift, "FLOWN", (0.1, 0.3))
    run = CliRunner().invoke(
        main, ["study", "shift", "--quick", "--arch", "agile-mlp,esn", "--out", str(tmp_path)]
    )
    assert run.exit_code == 0, run.output
    assert "Kendall's τ" in run.output
    flown = json.loads((tmp_path / "shift" / "study.json").read_text())["rms_m"]
    assert set(flown) == {"0.1", "0.3"}
    assert set(flown["0.1"]) == {"no compensation", "oracle", "agile-mlp", "esn"}
    assert {p.suffix for p in (tmp_path / "shift").iterdir()} == {
        ".png", ".pdf", ".csv", ".json", ".html",
    }  # fmt: skip
