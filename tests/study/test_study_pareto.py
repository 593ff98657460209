"""What accuracy costs: the fronts by their definition, the sentence, the figure, the command."""

import csv
import json
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from runtime.bench import BenchRow
from trainers.build import ARCHITECTURES
from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.package import read_package
from wakedeploy.study.pareto import ROUNDS, Point, by_parameters, by_step, front, sentence
from wakedeploy.study.pareto_figure import headline, panels, parts, rows, summary


def point(arch: str, errors: tuple[float, ...], trainable: int, *steps_p99_ms: float) -> Point:
    return Point("toy", arch, errors, trainable, 0, steps_p99_ms)


def beaten(one: Point, by: Point, cost) -> bool:
    no_worse = cost(by) <= cost(one) and by.error <= one.error
    return no_worse and (cost(by) < cost(one) or by.error < one.error)


few = st.integers(1, 5)  # small numbers, so that ties are common


@given(st.lists(st.tuples(few, few, few), min_size=1, max_size=12))
def test_the_front_is_who_is_beaten_by_none(drawn: list[tuple[int, int, int]]) -> None:
    points = [point(f"m{i}", (e / 10,), n, t / 7, t / 7) for i, (e, n, t) in enumerate(drawn)]
    for cost in (by_parameters, by_step):
        expected = [p for p in points if not any(beaten(p, other, cost) for other in points)]
        found = front(points, cost)
        assert sorted(p.arch for p in found) == sorted(p.arch for p in expected)
        assert [cost(p) for p in found] == sorted(cost(p) for p in found)


rounds = st.lists(st.integers(1, 9), min_size=2, max_size=4)


@given(st.lists(st.tuples(st.integers(1, 9), rounds), min_size=1, max_size=9))
def test_a_step_that_overlaps_anothers_rounds_is_no_dearer(
    drawn: list[tuple[int, list[int]]],
) -> None:
    points = [point(f"m{i}", (e / 10,), 1, *steps) for i, (e, steps) in enumerate(drawn)]
    found = front(points, by_step)
    assert min(points, key=lambda p: p.error).error == found[-1].error
    for one in points:
        rivals = [p for p in points if p.error < one.error]
        surely = all(min(p.steps_p99_ms) > max(one.steps_p99_ms) for p in rivals)
        equals = [p for p in points if p.error == one.error]
        none = all(max(p.steps_p99_ms) >= min(one.steps_p99_ms) for p in equals)
        assert (one in found) == (surely and none)


def test_a_step_is_told_of_its_quietest_round_with_every_round_kept() -> None:
    one = point("gru", (0.2,), 10, 0.9, 0.4, 0.6)
    assert by_step(one) == (0.4, 0.9)
    assert one.as_json()["step_p99_ms"] == 0.4
    assert json.loads(json.dumps(one.as_json()))["steps_p99_ms"] == [0.9, 0.4, 0.6]


def test_a_points_error_is_the_mean_over_seeds_with_their_spread() -> None:
    three = point("gru", (0.2, 0.3, 0.7), 10, 1.0)
    assert three.error == pytest.approx(0.4)
    assert three.spread == pytest.approx(np.std([0.2, 0.3, 0.7], ddof=1))
    assert point("gru", (0.2,), 10, 1.0).spread is None
    assert json.loads(json.dumps(three.as_json()))["errors"] == [0.2, 0.3, 0.7]


def test_the_sentence_names_the_fronts_and_what_a_tenfold_cheaper_step_costs() -> None:
    points = [
        point("agile-mlp", (0.8,), 10, 0.02),
        point("tcn", (0.5,), 30, 0.1),
        point("gru", (0.2,), 40, 1.0),
        point("mamba", (0.3,), 50, 2.0),
    ]
    told = sentence("toy", points)
    assert "none beats agile-mlp, tcn and gru in both error and step time" in told
    assert "gru errs least, by 0.2 standard deviations at 1 ms a step" in told
    assert "costs a factor of 2.5 in error (tcn, 0.5 at 0.1 ms)" in told
    near = sentence("toy", [point("agile-mlp", (0.8,), 10, 0.5), points[2]])
    assert (
        "no step is 10 times cheaper: agile-mlp's, the cheapest that surely is, takes 0.5 ms"
        in near
    )
    assert "for an error of 0.8" in near
    alone = sentence("toy", [points[2], points[3]])
    assert "On toy, none beats gru in both" in alone
    assert "no step is surely cheaper" in alone
    # One that errs less at an overlapping step beats the cheap one, which is surely cheaper still.
    chain = [point("agile-mlp", (0.8,), 10, 0.5, 0.6), point("gru", (0.3,), 40, 0.6, 0.9)]
    chain.append(point("tcn", (0.2,), 30, 0.7, 0.8))
    assert "agile-mlp's, the cheapest that surely is, takes 0.5 ms, 1.4 times less" in sentence(
        "toy", chain
    )
    wide = [point("agile-mlp", (0.8,), 10, 0.05, 1.1), point("gru", (0.2,), 40, 0.7, 0.9)]
    assert "no step is surely cheaper" in sentence("toy", wide)
    noisy = sentence("toy", [point("agile-mlp", (0.8,), 10, 0.5, 1.1), points[2]])
    assert "On toy, none beats gru in both error and step time" in noisy


def test_the_headline_names_who_is_unbeaten_most_often() -> None:
    fast = point("agile-mlp", (0.5,), 100, 0.1)
    told = {
        "one": [fast, point("gru", (0.2,), 900, 0.3)],
        "two": [fast, point("tcn", (0.6,), 9, 1)],
    }
    assert headline(told) == (
        "In 2 of 2 domains nothing beats agile-mlp in both error and step time. "
    )


@pytest.mark.whole
def test_every_architecture_has_a_point_and_a_name_in_each_panel() -> None:
    rng = np.random.default_rng(0)
    points = [point(a, tuple(rng.uniform(0.1, 0.9, 3)), int(rng.integers(2e3, 9e4)),
                    *rng.uniform(0.1, 0.9, 2).tolist()) for a in ARCHITECTURES]  # fmt: skip
    beside = {"zero": 1.2, "no-learning observer": 0.7}
    told = {"toy": points, "other": points, "third": points}
    drawn = panels(told, {"toy": beside, "other": {"zero": 1.1}, "third": {"zero": 1.1}})
    shown = [axes for axes in drawn.axes if axes.axison]
    assert len(shown) == 6
    for axes in shown:
        names = {text.get_text().removesuffix(" (no memory)") for text in axes.texts}
        seen = "no-learning observer" in axes.get_title(loc="right")
        across = [line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == ":"]
        assert across == ([0.7] if axes in shown[:2] else [])
        assert names == set(ARCHITECTURES)
        assert seen == (axes in shown[:2])
        assert axes.get_xscale() == axes.get_yscale() == "log"
    assert [part.name for part in parts({"toy": points}, {"toy": beside})] == [
        "pareto",
        "pareto-toy",
    ]
    _, lines = summary(points, beside)
    assert [line[:2] for line in lines[:2]] == [["zero", "1.2"], ["no-learning observer", "0.7"]]
    assert [float(line[1].split()[0]) for line in lines[2:]] == sorted(
        float(f"{p.error:.3g}") for p in points
    )
    fronts = [{p.arch for p in front(points, cost)} for cost in (by_parameters, by_step)]
    first, second, *table = rows(points, beside)
    assert (first[1], first[4], second[1], second[4]) == ("zero", 1.2, "no-learning observer", 0.7)
    for row in table:
        assert len(row) == len(first)
        assert row[-2:] == [int(row[1] in best) for best in fronts]
        [own] = [p for p in points if p.arch == row[1]]
        assert row[-4:-2] == [min(own.steps_p99_ms), max(own.steps_p99_ms)]


def driven_set() -> EpisodeSet:
    """A force that is the observation of six samples ago."""
    rng = np.random.default_rng(0)
    made = []
    for i in range(6):
        driven = lfilter([0.7], [1.0, -0.7], rng.normal(0, 1, 306))[:, None].astype(np.float32)
        made.append(Episode(f"e{i}", driven[6:], driven[:-6]))
    split = {f"e{i}": ("train", "train", "train", "validation", "test", "test")[i]
             for i in range(6)}  # fmt: skip
    return EpisodeSet("gantry", 20.0, (Channel("drive", "N"),), (Channel("force_z_n", "N"),), 0.5,
                      (1.0,), split, tuple(made))  # fmt: skip


def flown(packages: list[Path], *, ticks: int, progress, rounds: list[int]) -> list[BenchRow]:
    """What the real loop would be asked; it has tests of its own."""
    archs = [read_package(path).manifest.arch for path in packages]
    assert ticks == 128 // ROUNDS
    progress(ticks, ticks)
    rounds.append(ticks)
    noise = 0.0 if len(rounds) == 3 else 0.4  # one round was quiet
    cost = {"agile-mlp": 0.05 + noise, "history-mlp": 0.06 + noise}
    return [
        BenchRow(arch, ticks, 1.0, 1.2, 1.3, 1.4, 3.0, 140.0, 5.0, 0, False,
                 {"t_predict_s": {"p50": 0.01, "p99": cost[arch], "p999": 1.0, "max": 1.0}})
        for arch in archs
    ]  # fmt: skip


@pytest.mark.slow
def test_the_command_writes_figures_tables_and_a_page(tmp_path, monkeypatch) -> None:
    rounds: list[int] = []
    monkeypatch.setattr("runtime.bench.bench_latency", partial(flown, rounds=rounds))
    driven_set().write(tmp_path / "sets" / "gantry-quick")
    asked = ["--quick", "--domains", "gantry", "--arch", "agile-mlp,history-mlp"]
    for study in ("domains", "pareto"):
        told = CliRunner().invoke(main, ["study", study, *asked, "--out", str(tmp_path)])
        assert told.exit_code == 0, told.output
    folder = tmp_path / "pareto-gantry-quick"
    assert {p.name for p in folder.iterdir()} == {
        "pareto.png", "pareto.pdf", "pareto.csv", "pareto-gantry.csv", "study.json", "study.html",
        "pareto-chip.png", "pareto-chip.pdf", "pareto-chip.csv",
    }  # fmt: skip
    chips = list(csv.DictReader((folder / "pareto-chip.csv").open()))
    trained = json.loads((folder / "study.json").read_text())["points"]
    for row, one in zip(chips, trained, strict=True):
        assert int(row["flash_bytes"]) == one["flash_bytes"] >= 4 * one["trainable"]
        assert int(row["ram_bytes"]) > 500
        assert int(row["instructions"]) > 3 * one["trainable"]
    table = list(csv.DictReader((folder / "pareto.csv").open()))
    written = json.loads((folder / "study.json").read_text())
    points = written["points"]
    lines = json.loads((tmp_path / "domains-gantry-quick" / "study.json").read_text())["lines"]
    shares = {line["predictor"]: line["normalised"] for line in lines}
    assert [row["predictor"] for row in table] == ["zero", "agile-mlp", "history-mlp"]
    assert float(table[0]["error"]) == written["unlearned"]["gantry"]["zero"] == shares["zero"]
    for row, told_point in zip(table[1:], points, strict=True):
        assert float(row["error"]) == told_point["error"] == shares[row["predictor"]]
        assert int(row["trainable"]) == told_point["trainable"] > 0
    assert len(rounds) == ROUNDS
    assert written["sets"] == [{"domain": "gantry", "sha256": driven_set().sha256}]
    assert [p["step_p99_ms"] for p in points] == [0.05, 0.06]
    assert points[0]["steps_p99_ms"] == [0.45, 0.45, 0.05, 0.45]
    best = min(points, key=lambda p: p["error"])["arch"]  # the steps overlap
    assert (
        f"On gantry, none beats {best} in both error and step"
        in (folder / "study.html").read_text()
    )
    assert "On gantry, none beats" in told.output


@pytest.mark.slow
def test_the_study_trains_nothing_that_domains_has_trained(tmp_path, monkeypatch) -> None:
    rounds: list[int] = []
    monkeypatch.setattr("runtime.bench.bench_latency", partial(flown, rounds=rounds))
    driven_set().write(tmp_path / "sets" / "gantry-quick")
    asked = ["--quick", "--domains", "gantry", "--arch", "agile-mlp", "--out", str(tmp_path)]
    assert CliRunner().invoke(main, ["study", "domains", *asked]).exit_code == 0
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "runs-quick").rglob("*.*")}
    assert CliRunner().invoke(main, ["study", "pareto", *asked]).exit_code == 0
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "runs-quick").rglob("*.*")} == before


def test_a_single_point_is_drawn_in_the_middle_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drawn = panels({"toy": [point("gru", (0.5, 0.6), 17_409, 0.4)]}, {"toy": {"zero": 1.1}})
    assert drawn.axes[0].get_xlim() == pytest.approx((17_409 / 3.0, 3.0 * 17_409))


@pytest.mark.parametrize("ratio", [1.02, 1.3, 1.49, 2.0, 8.0, 200.0])
def test_an_axis_of_errors_has_numbers_however_near_they_are(ratio: float) -> None:
    errors = np.geomspace(0.92, 0.92 * ratio, 3)  # around 1, which had been the only number
    points = [point(f"m{i}", (error,), 100 * 10**i, 0.1) for i, error in enumerate(errors)]
    (axes, *_) = panels({"toy": points}, {"toy": {}}).axes
    low, high = axes.get_ylim()
    assert sum(low <= at <= high for at in axes.yaxis.get_majorticklocs()) >= 2


def test_a_name_beside_a_long_bar_is_not_cut_at_the_panels_edge() -> None:
    points = [
        point("agile-mlp", (0.8,), 17_409, 0.54, 0.69),
        point("gru", (1.1,), 70_721, 0.61, 0.75),
    ]
    drawn = panels({"toy": points}, {"toy": {"zero": 1.1}})
    drawn.draw_without_rendering()
    for axes in drawn.axes:
        panel = axes.get_window_extent()
        for text in axes.texts:
            name = text.get_window_extent()
            assert panel.x0 <= name.x0 < name.x1 <= panel.x1, text.get_text()


def test_a_wrong_name_is_refused_in_one_sentence(tmp_path) -> None:
    for options in (["--domains", "moon"], ["--arch", "oracle"], ["--domains", "fish"]):
        told = CliRunner().invoke(main, ["study", "pareto", "--out", str(tmp_path), *options],
                                  env={"WAKEDEPLOY_DATA": str(tmp_path)})  # fmt: skip
        assert told.exit_code == 2, told.output
        assert "unexpected" not in told.output
