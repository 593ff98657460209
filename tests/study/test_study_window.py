"""How much past is needed: shorter windows fail where the delay is longer, all on equal samples."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from scipy.signal import lfilter

from trainers.build import ARCHITECTURES
from trainers.inspection.cold_start import predict_from_cold
from trainers.training.predict import predict
from trainers.training.tape import lay_tape
from wakedeploy.cli import main
from wakedeploy.cli.study_horizon import window
from wakedeploy.core import figures
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.rig.file import default_rig
from wakedeploy.study.colours import looks
from wakedeploy.study.runs import Wanted, candidates, obtained, obtained_run
from wakedeploy.study.window import (
    WHOLE,
    Seen,
    architectures_of,
    measure,
    need,
    planned,
    reach,
    sentence,
    transport_delay_s,
    windows,
)
from wakedeploy.study.window_figure import curves, headline, needed

DELAY = 6  # samples
KEEP = 0.7  # from one sample to the next


def delayed_set(window_s: float = 0.8) -> EpisodeSet:
    """At 20 Hz a force that is the observation of six samples ago, an AR(1) series."""
    rng = np.random.default_rng(0)
    made = []
    for i in range(12):
        kicks = rng.normal(0.0, math.sqrt(1.0 - KEEP**2), 500)
        driven = lfilter([1.0], [1.0, -KEEP], kicks)[200 - DELAY :, None].astype(np.float32)
        made.append(Episode(f"e{i}", driven[DELAY:], driven[:-DELAY]))
    split = {f"e{i}": "train" if i < 8 else "validation" if i == 8 else "test" for i in range(12)}
    return EpisodeSet("toy", 20.0, (Channel("drive", "N"),), (Channel("force", "N"),), window_s,
                      (1.0,), split, tuple(made))  # fmt: skip


@pytest.fixture(scope="module")
def measured(tmp_path_factory) -> tuple[EpisodeSet, list[Seen]]:
    data = delayed_set()
    folder = tmp_path_factory.mktemp("runs")
    return data, measure(data, "force", ["history-mlp", "gru"], 1, folder, epochs=25)


@pytest.mark.slow
def test_a_past_shorter_than_the_delay_is_worth_what_an_ar1_series_says(measured) -> None:
    _, points = measured
    for point in points:
        if point.arch == "gru" or point.past_s == WHOLE:
            continue
        missing = max(0, DELAY - round(20.0 * point.past_s))
        # From a past that ends `missing` samples too early: the rest is innovation.
        least = math.sqrt(1.0 - KEEP ** (2 * missing))
        assert least * 0.93 - 0.01 < point.share < least * 1.07 + 0.15, point
        assert point.r2 == pytest.approx(1.0 - point.share**2)
        assert point.r2_low < point.r2 < point.r2_high


@pytest.mark.slow
def test_the_shortest_that_suffices_is_the_delay(measured) -> None:
    data, points = measured
    steps = sorted({p.samples - 1 for p in points if p.samples is not None})
    expected = min(step for step in steps if step >= DELAY)
    for arch in ("history-mlp", "gru"):
        found = need([p for p in points if p.arch in ("agile-mlp", arch)], arch)
        assert found.enough is not None
        assert found.enough.samples == expected + 1
        assert found.memoryless > 0.9
    cut = {p.past_s: p.share for p in points if p.arch == "gru"}
    assert min(share for past_s, share in cut.items() if 20.0 * past_s < DELAY) > 0.8
    assert cut[WHOLE] < 0.6
    assert cut[0.8] == pytest.approx(cut[WHOLE], abs=0.02)
    assert "The wake is under way" not in sentence("toy", points, data.rate_hz)


@pytest.mark.slow
def test_every_past_is_scored_on_the_same_samples(measured) -> None:
    data, points = measured
    longest = max(seen.warm_up_steps for seen in windows(data))
    tests = data.part("test")
    assert {p.scored for p in points} == {sum(len(e) - longest for e in tests)}
    truth = np.concatenate([e.force[longest:] for e in tests])
    assert all(p.sd == pytest.approx(truth.std(), rel=1e-6) for p in points)
    assert longest == 24
    assert [reach(seen) for seen in windows(data)] == [1, 2, 4, 8, 12, 16, 24]


def test_beside_the_models_stand_what_learned_nothing_and_those_kept_from_own_motion(
    tmp_path,
) -> None:
    """Here the sufferer's motion is the force itself, and the source tells it six samples ago."""
    data = delayed_set()
    episodes = []
    for i, e in enumerate(data.episodes):
        cut = slice(i % 2, 22 if i == 9 else None)  # not all alike long, one too short to score
        both = np.concatenate([e.observation, e.force], axis=1)[cut]
        half = {"observer_n": 0.5 * e.force[cut]}
        episodes.append(Episode(e.name, both, e.force[cut], half))
    channels = (Channel("drive", "N"), Channel("own", "N"))
    data = replace(data, episodes=tuple(episodes), observation=channels,
                   provenance={"own_motion": ["own"]})  # fmt: skip
    told = measure(data, "force", ["history-mlp"], 1, tmp_path, epochs=1)
    assert len({p.scored for p in told}) == 1
    share = {p.arch: p.share for p in told if p.memory == "none"}
    assert share["zero"] == pytest.approx(1.0, abs=0.05)
    assert share["no-learning observer"] == pytest.approx(0.5 * share["zero"], rel=1e-5)
    blinded = "history-mlp, source's past only"
    assert architectures_of(told) == ["history-mlp", blinded]
    assert {w.present_only for _, w in planned(data, ["gru"], 1)} == {(), ("own",)}
    axes = curves({"toy": told}, {}).axes[0]
    assert {"no-learning observer", blinded} <= set(axes.get_legend_handles_labels()[1])


def test_the_usual_window_is_the_set_itself_so_that_its_run_is_shared() -> None:
    data = delayed_set()
    assert sum(seen is data for seen in windows(data)) == 1
    jobs = planned(data, ["agile-mlp", "history-mlp", "gru"], 2)
    assert [w.arch for _, w in jobs].count("agile-mlp") == 2
    assert [w.arch for _, w in jobs].count("history-mlp") == 14
    assert [made for made, w in jobs if w.arch == "gru"] == [data, data]
    short = delayed_set(0.1)  # two samples: several shares of it are one and the same
    assert [reach(seen) for seen in windows(short)] == [1, 2, 3]


def test_a_cut_past_is_cut_and_a_window_model_does_not_mind(tmp_path) -> None:
    data = delayed_set()
    tape = lay_tape(data, "test", 0.0, 24)
    at = np.flatnonzero(tape.scored.numpy())[::37]
    gru = obtained(data, Wanted("gru", 0, epochs=1), tmp_path)
    first = int(tape.first[at[5]])
    alone = gru.rollout(tape.observation[at[5] - 9 : at[5] + 1].unsqueeze(0))[0, -1]
    assert torch.allclose(predict_from_cold(gru, tape, at, 9)[5], alone, atol=1e-6)
    whole = predict_from_cold(gru, tape, at[5:6], int(at[5]) - first)
    assert torch.allclose(whole, predict(gru, tape)[at[5:6]], atol=1e-5)
    assert not torch.allclose(whole[0], predict_from_cold(gru, tape, at, 1)[5], atol=1e-4)
    mlp = obtained(data, Wanted("history-mlp", 0, epochs=1), tmp_path)
    assert torch.allclose(predict_from_cold(mlp, tape, at, 16), predict(mlp, tape)[at], atol=1e-6)
    with pytest.raises(ValueError, match="fewer samples"):
        predict_from_cold(mlp, tape, np.array([first + 3]), 4)


def seen(arch: str, past_s: float, share: float, seed: int = 0) -> Seen:
    samples = None if past_s == WHOLE else round(100 * past_s) + 1
    memory = {"agile-mlp": "none", "gru": "state"}.get(arch, "window")
    kept = 512 if memory == "state" else 4 * (samples or 0)
    r2 = 1 - share**2
    return Seen("toy", arch, seed, past_s, memory, samples, kept, share, 1.0, r2, r2 - 0.02,
                r2 + 0.01, 10)  # fmt: skip


def test_seeds_are_averaged_and_five_per_cent_above_the_least_suffice() -> None:
    points = [
        seen("agile-mlp", 0.0, 0.9),
        *(seen("gru", 0.1, share, s) for s, share in enumerate((0.40, 0.44))),  # mean 0.42
        *(seen("gru", 0.2, share, s) for s, share in enumerate((0.43, 0.40))),  # 0.415
        *(seen("gru", WHOLE, share, s) for s, share in enumerate((0.39, 0.41))),  # 0.40
    ]
    found = need(points, "gru")
    assert found.enough is not None
    assert (found.enough.past_s, found.error, found.least) == (0.1, pytest.approx(0.42), 0.4)
    told = sentence("toy", points, 100.0)
    assert "gru needs no more than 0.1 s of the past, kept in a state of 512" in told
    assert "needs 0.1 s" not in told  # its past was cut, it was not trained with so little
    assert "samples" not in told
    told = sentence("toy", [points[0], seen("history-mlp", 0.1, 0.4)], 100.0)
    assert "needs 0.1 s of the past, a history of 11 samples or 44 bytes at 100 Hz, for" in told
    slow = [*points[:1], seen("gru", 0.1, 0.8), seen("gru", WHOLE, 0.3)]
    assert need(slow, "gru").enough is None
    told = sentence("toy", slow, 100.0)
    assert "gru, as it was trained, comes within 5 % of its least error" in told
    assert "with all of the past and not with 0.1 s, which bounds nothing" in told
    assert "needs" not in told
    useless = [*points[:1], seen("gru", 0.1, 0.88)]
    assert need(useless, "gru").enough is points[0]
    assert "no more than 5 % by the past" in sentence("toy", useless, 100.0)


def test_the_headline_is_of_the_predictor_that_errs_least() -> None:
    good = [seen("agile-mlp", 0.0, 0.8), seen("history-mlp", 0.2, 0.4),
            seen("history-mlp", 0.4, 0.3), seen("gru", 0.2, 0.25),
            seen("gru", 0.4, 0.2)]  # fmt: skip
    bad = [seen("agile-mlp", 0.0, 0.2), seen("gru", 0.2, 0.3)]
    assert headline({"toy": good, "other": bad}) == (
        "The past that suffices to err least: at most 0.4 s on toy (gru); none on other, where "
        "nothing beats the present alone. "
    )


def test_a_model_that_loses_to_the_present_alone_is_told_so() -> None:
    points = [seen("agile-mlp", 0.0, 0.8), seen("history-mlp", 0.1, 0.95)]
    points.append(seen("history-mlp", 0.2, 0.9))
    found = need(points, "history-mlp")
    assert (found.least, found.memoryless, found.loses) == (0.9, 0.8, True)
    told = sentence("toy", points, 100.0)
    assert "loses to the memoryless model: 0.90 of the standard deviation at best, 0.80" in told
    assert "gains" not in told
    better = [points[0], seen("history-mlp", 0.1, 0.79)]
    told = sentence("toy", better, 100.0)
    assert "by the past: 0.79 of the standard deviation with it, 0.80 without" in told


@pytest.mark.slow
def test_states_and_histories_have_the_bytes_that_are_kept(measured) -> None:
    data, points = measured
    assert {p.bytes for p in points if p.arch == "gru"} == {4 * 128}  # float32, hidden units
    for point in points:
        if point.memory == "window":
            assert point.bytes == 4 * point.samples * len(data.observation)
    _, lines = needed({"toy": points})
    assert [line[2].startswith("at most ") for line in lines] == [False, True]
    assert [line[1:2] + line[4:6] for line in lines] == [
        ["history-mlp", "history", f"{4 * 9}"], ["gru", "state", "512"],
    ]  # fmt: skip


def test_every_architecture_looks_like_itself_and_unlike_the_limits() -> None:
    names = [*ARCHITECTURES, *(f"model-{i}" for i in range(10))]
    told = looks(names)
    assert len(set(told.values())) == len(names)
    assert len({colour for colour, _ in list(told.values())[:8]}) == 8
    assert told["gru"] == looks(["gru"])["gru"]  # whoever else is drawn
    assert not {figures.TRUE, figures.REFERENCE} & {colour for colour, _ in told.values()}
    points = [seen("agile-mlp", 0.0, 0.9), *(seen(name, 0.1, 0.5) for name in names[1:8])]
    labels = curves({"toy": points}, {"toy": 0.1}).axes[0].get_legend_handles_labels()[1]
    assert {*names[1:8], "transport delay"} <= set(labels)


def test_what_learned_nothing_is_a_line_unless_it_lies_far_off() -> None:
    points = [seen("agile-mlp", 0.0, 0.5), seen("gru", 0.1, 0.3)]
    near = replace(seen("no-learning observer", 0.0, 0.55), memory="none")
    far = replace(seen("zero", 0.0, 2.0), memory="none")
    axes = curves({"toy": [far, near, *points]}, {"toy": None}).axes[0]
    labels = axes.get_legend_handles_labels()[1]
    assert ("no-learning observer" in labels, "zero" in labels) == (True, False)
    assert "zero: 2.00 ↑" in [text.get_text() for text in axes.texts]
    assert axes.get_ylim()[1] < 1.0


@pytest.mark.parametrize("domains", [["toy"], ["toy", "another"]])
def test_the_legend_is_not_cut_and_what_is_said_in_words_lies_on_no_curve(domains) -> None:
    points = [seen("agile-mlp", 0.0, 0.9), replace(seen("zero", 0.0, 2.0), memory="none")]
    for name in ("history-mlp", "gru"):
        points += [seen(name, past_s, 0.5) for past_s in (0.1, 0.2, 0.3, WHOLE)]
    drawn = curves(dict.fromkeys(domains, points), dict.fromkeys(domains, 0.1))
    drawn.draw_without_rendering()
    (legend,) = drawn.legends
    told = legend.get_window_extent()
    assert told.x0 >= 0.0
    assert told.x1 <= drawn.bbox.width
    for axes in drawn.axes[: len(domains)]:
        (words,) = [text for text in axes.texts if "zero" in text.get_text()]
        assert not words.get_window_extent().overlaps(axes.get_window_extent())


def test_the_transport_delay_comes_from_the_set() -> None:
    data = delayed_set()
    swing = np.sin(2.0 * np.pi * np.arange(300)[:, None] / 16.0).astype(np.float32)  # 0.8 s
    made = [Episode(e.name, swing[DELAY:], swing[:-DELAY]) for e in data.episodes]
    fish = replace(data, domain="fish", episodes=tuple(made))
    assert transport_delay_s(fish) == pytest.approx(DELAY / 20.0, abs=0.01)
    assert transport_delay_s(data) is None
    low = [Episode(e.name, np.full_like(e.observation, 1.2), e.force) for e in data.episodes]
    gantry = replace(
        data, domain="gantry", observation=(Channel("dz_m", "m"),), episodes=tuple(low)
    )
    assert transport_delay_s(gantry) == pytest.approx(1.2 / default_rig().wake.speed_mps)


def test_the_memoryless_alone_is_refused(tmp_path) -> None:
    told = CliRunner().invoke(main, ["study", "window", "--arch", "agile-mlp", "--quick", "--out",
                                     str(tmp_path)])  # fmt: skip
    assert told.exit_code == 2, told.output
    assert "give --arch a model with memory" in told.output
    assert not list(tmp_path.iterdir())


@pytest.mark.whole
def test_a_reservoir_is_chosen_on_validation_as_in_every_study(tmp_path) -> None:
    data = delayed_set()
    points = measure(data, "force", ["esn"], 1, tmp_path, epochs=2)
    tried = [obtained_run(data, one, tmp_path) for one in candidates(Wanted("esn", 0, 2))]
    best = min(tried, key=lambda run: min(run.metrics.history))
    assert len(tried) == 3
    assert {p.hyper for p in points if p.arch == "esn"} == {
        next(w.hyper_text for w in candidates(Wanted("esn", 0, 2))
             if obtained_run(data, w, tmp_path).folder == best.folder)
    }  # fmt: skip


@pytest.mark.whole
def test_the_command_writes_figures_tables_and_a_page(tmp_path) -> None:
    data = delayed_set()
    data = EpisodeSet("gantry", *list(vars(data).values())[1:])
    data = EpisodeSet(**{**vars(data), "force": (Channel("force_z_n", "N"),)})
    data.write(tmp_path / "sets" / "gantry-quick")
    told = CliRunner().invoke(window, ["--quick", "--domains", "gantry", "--out", str(tmp_path)])
    assert told.exit_code == 0, told.output
    folder = tmp_path / "window-gantry-quick"
    assert {p.name for p in folder.iterdir()} == {
        "window.png", "window.pdf", "window.csv", "window-gantry.csv", "study.json", "study.html",
    }  # fmt: skip
    rows = list(csv.DictReader((folder / "window.csv").open()))
    points = json.loads((folder / "study.json").read_text())["points"]
    assert len(rows) == len(points) == 1 + 1 + 7 + 8
    assert [row["past_s"] for row in rows].count("") == 1  # the whole past of the recurrent model
    assert float(rows[3]["rmse"]) == points[3]["rmse"]
    assert "On gantry, history-mlp" in (folder / "study.html").read_text()
    assert "On gantry, history-mlp" in told.output
