"""The flag's scatter: the best memory is chosen on validation, numbers are those of the test."""

import csv
import json
from pathlib import Path

import needs
import numpy as np
import pytest
from click.testing import CliRunner

from trainers.architectures.esn import EsnHyper
from wakedeploy.cli.study_delay import fish_scatter
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.fish import import_set
from wakedeploy.study.domains import Line, compare, held_out
from wakedeploy.study.fish_scatter import Shown, best_memory, shown
from wakedeploy.study.fish_scatter_figure import draw, sentence
from wakedeploy.study.runs import Wanted, obtained_run
from wakedeploy.study.uncertainty import R2


@pytest.fixture(scope="module")
def recordings() -> Path:
    needs.recordings_of("fish")
    return needs.DATA


def test_the_memoryless_is_never_the_best_memory() -> None:
    losses = {"agile-mlp": 0.1, "gru": 0.3, "esn": 0.2}
    lines = [Line("fish", name, 0, (), validation=loss) for name, loss in losses.items()]
    assert best_memory(lines) == "esn"


def model(arch: str, noise_mm: float, r2: R2) -> Shown:
    rng = np.random.default_rng(0)
    true_m = 0.007 * np.sin(np.arange(600) * 0.7)
    return Shown(arch, true_m, true_m + 1e-3 * noise_mm * rng.normal(size=600), r2)


def test_the_sentence_says_whether_the_intervals_lie_apart() -> None:
    plain, best = R2(0.55, 0.45, 0.65), R2(0.95, 0.94, 0.96)
    told = sentence([model("agile-mlp", 4.0, plain), model("gru", 1.0, best)])
    assert "agile-mlp explains R² 0.550 [0.450, 0.650]" in told
    assert "gru, the best memory on the validation block, 0.950 [0.940, 0.960]" in told
    assert "its 90 % interval lies wholly above" in told
    worse = sentence([model("agile-mlp", 1.0, best), model("gru", 4.0, plain)])
    assert "its 90 % interval lies wholly below: memory harms" in worse
    assert "too short for intervals" in sentence(
        [model("agile-mlp", 4.0, plain), model("gru", 1.0, R2(0.95, None, None))]
    )
    unclear = sentence([model("agile-mlp", 4.0, plain), model("gru", 4.0, R2(0.6, 0.5, 0.7))])
    assert "their 90 % intervals overlap" in unclear


def test_both_panels_are_square_and_share_one_scale() -> None:
    models = [model("agile-mlp", 4.0, R2(0.5, None, None)), model("gru", 1.0, R2(0.9, None, None))]
    drawn = draw(models, 30.0)
    plain, best, time = drawn.axes
    assert plain.get_xlim() == plain.get_ylim() == best.get_xlim() == best.get_ylim()
    assert plain.get_aspect() == best.get_aspect() == 1.0
    largest_mm = 1e3 * max(np.abs(one.predicted_m).max() for one in models)
    assert plain.get_xlim()[1] > largest_mm
    assert time.get_xlim() == (0.0, 5.0)
    assert [line.get_label() for line in time.lines] == ["truth", "agile-mlp", "gru"]


@pytest.mark.slow
def test_what_is_shown_has_the_r2_that_is_told(tmp_path: Path, recordings: Path) -> None:
    data = import_set(recordings / "fish")
    names = ["agile-mlp", "esn"]
    lines = compare(data, names, 1, tmp_path, epochs=2)
    plain, best = shown(data, lines, tmp_path)
    assert (plain.arch, best.arch) == ("agile-mlp", "esn")
    for one in (plain, best):
        error = one.predicted_m - one.true_m
        assert one.r2.value == pytest.approx(1.0 - np.mean(error**2) / one.true_m.var())
    true_m = np.concatenate([e.force[data.warm_up_steps :, 0] for e in data.part("test")])
    assert np.array_equal(plain.true_m, true_m)
    losses = held_out(lines)
    assert 0.0 < losses["esn"] < 0.15 < losses["agile-mlp"]
    gentle = [Wanted("esn", 0, 2), *(Wanted("esn", 0, 2, hyper=hyper) for hyper in EsnHyper.starts)]
    tried = [min(obtained_run(data, one, tmp_path).metrics.history) for one in gentle]
    assert losses["esn"] == min(tried)  # the best of the scales that are tried


@pytest.mark.slow
def test_the_command_draws_the_scatter(tmp_path: Path, recordings: Path, monkeypatch) -> None:
    from trainers import build

    few = {name: build.ARCHITECTURES[name] for name in ("agile-mlp", "history-mlp", "esn")}
    monkeypatch.setattr(build, "ARCHITECTURES", few)
    told = CliRunner().invoke(
        fish_scatter, ["--quick", "--recordings", str(recordings), "--out", str(tmp_path)]
    )
    assert told.exit_code == 0, told.output
    folder = tmp_path / "fish-scatter-quick"
    assert {p.name for p in folder.iterdir()} == {
        "fish-scatter.png", "fish-scatter.pdf", "fish-scatter.csv", "fish-scatter-scores.csv",
        "study.json", "study.html",
    }  # fmt: skip
    scores = csv.DictReader((folder / "fish-scatter-scores.csv").open())
    rows = {row["predictor"]: row for row in scores}
    result = json.loads((folder / "study.json").read_text())
    assert set(rows) == set(few)
    losses = {name: float(row["validation_loss"]) for name, row in rows.items()}
    assert result["best"] == min(("history-mlp", "esn"), key=lambda name: losses[name])
    assert float(rows["agile-mlp"]["r2"]) < 0.65 < float(rows["esn"]["r2"])
    page = (folder / "study.html").read_text()
    assert result["best"] in page
    assert "the paper has R² 0.57 without memory and" in page.replace("The", "the")
    drawn = list(csv.DictReader((folder / "fish-scatter.csv").open()))
    for arch in ("agile-mlp", result["best"]):  # the points themselves say the R² that is told
        own = [row for row in drawn if row["predictor"] == arch]
        true_mm, told_mm = (
            np.array([float(r[k]) for r in own]) for k in ("true_mm", "predicted_mm")
        )
        r2 = 1.0 - np.mean((told_mm - true_mm) ** 2) / true_mm.var()
        assert r2 == pytest.approx(float(rows[arch]["r2"]), abs=1e-6)
    assert float(rows["agile-mlp"]["r2_low"]) < float(rows["agile-mlp"]["r2"])


def test_without_recordings_the_command_says_so(tmp_path: Path) -> None:
    told = CliRunner().invoke(
        fish_scatter, ["--quick", "--recordings", str(tmp_path / "none"), "--out", str(tmp_path)]
    )
    assert told.exit_code != 0
    assert isinstance(told.exception, UnusableInput)
