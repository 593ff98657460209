"""The comparison over domains: what it says, what it writes, and that it goes on."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import lfilter

from trainers.architectures.esn import EsnHyper
from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import sha256_of
from wakedeploy.study.domains import SOURCE_ONLY, compare, planned
from wakedeploy.study.domains_figure import best_over_kinds
from wakedeploy.study.domains_sentence import sentence
from wakedeploy.study.runs import Wanted, train_all, work
from wakedeploy.study.sets import DOMAINS, Domain, obtain


def delayed_set(episodes: int = 6) -> EpisodeSet:
    """A force that is the observation of six samples ago: the present says little of it."""
    rng = np.random.default_rng(0)
    made = []
    for i in range(episodes):
        driven = lfilter([0.7], [1.0, -0.7], rng.normal(0, 1, 300))[:, None]
        force = np.concatenate([np.zeros((6, 1)), driven[:-6]])
        observer = {"observer_n": (force + 0.05).astype(np.float32)}
        made.append(Episode(f"e{i}", driven.astype(np.float32), force.astype(np.float32), observer))
    split = {f"e{i}": ("train", "train", "train", "validation", "test", "test")[i % 6]
             for i in range(episodes)}  # fmt: skip
    return EpisodeSet("toy", 20.0, (Channel("drive", "N"),), (Channel("force", "N"),), 0.5, (1.0,),
                      split, tuple(made))  # fmt: skip


def test_lines_that_learn_nothing_are_exact(tmp_path) -> None:
    data = delayed_set()
    zero, observer = compare(data, [], 1, tmp_path)
    truth = np.concatenate([e.force[data.warm_up_steps :] for e in data.part("test")])
    assert zero.channels[0]["rmse"] == pytest.approx(np.sqrt(np.mean(truth**2)), rel=1e-6)
    assert zero.channels[0]["sd"] == pytest.approx(truth.std(), rel=1e-6)
    assert observer.predictor == "no-learning observer"
    assert observer.channels[0]["rmse"] == pytest.approx(0.05, rel=1e-4)


def test_memory_wins_where_the_past_decides_and_nothing_is_trained_twice(tmp_path) -> None:
    data = delayed_set()
    calls: list[int] = []
    jobs = [(data, wanted) for wanted in planned(data, ["agile-mlp", "esn"], 1, 3)]
    train_all(jobs, tmp_path, on_run=calls.append)
    trained = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.safetensors")}
    lines = compare(data, ["agile-mlp", "esn"], 1, tmp_path, epochs=3)
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.safetensors")} == trained
    named = {line.predictor: line for line in lines}
    assert named["esn"].normalised < 0.5 * named["agile-mlp"].normalised
    assert len(calls) == len(jobs) == 2 + len(EsnHyper.starts)
    assert sorted(calls) == sorted(work(*job) for job in jobs)
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.safetensors")}
    again = compare(data, ["agile-mlp", "esn"], 1, tmp_path, epochs=3)
    assert [line.as_json() for line in again] == [line.as_json() for line in lines]
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.safetensors")} == before


def test_the_work_of_a_run_grows_with_its_samples_epochs_and_architecture() -> None:
    data = delayed_set()
    twice = replace(data, split={e.name: "train" for e in data.episodes})  # six episodes, not three
    usual = work(data, Wanted("gru", 0))
    assert work(twice, Wanted("gru", 0)) == 2 * usual
    assert work(data, Wanted("gru", 0, 30)) == pytest.approx(usual / 2, rel=1e-3)
    assert work(data, Wanted("esn", 0, 4)) == work(data, Wanted("esn", 0))  # solved in any case
    assert work(data, Wanted("esn", 0)) < 0.2 * usual


def test_the_past_of_own_motion_is_hidden_where_a_set_names_it(tmp_path) -> None:
    """The force is the drive's past; with the drive as own motion nothing is left of memory."""
    data = delayed_set()
    kinds = {e.name: "slow" if e.name == "e4" else "fast" for e in data.episodes}
    data = replace(data, provenance={"own_motion": ["drive"], "manoeuvre": kinds})
    lines = compare(data, ["agile-mlp", "history-mlp"], 1, tmp_path, epochs=8)
    share = {line.predictor: line.normalised for line in lines}
    kept = share["history-mlp" + SOURCE_ONLY]
    assert share["history-mlp"] < 0.6 * share["agile-mlp"]
    assert kept == pytest.approx(share["agile-mlp"], rel=0.1)
    plan = [planned(data, ["history-mlp"], 1, 8, blinded=blinded) for blinded in (True, False)]
    assert [[w.present_only for w in wanted] for wanted in plan] == [[(), ("drive",)], [()]]
    told = sentence("toy", lines)
    assert f"history-mlp is the best on validation and errs by {kept:.2f}" in told
    assert "memory takes" in told.lower()
    zero = lines[0]
    warm = data.warm_up_steps
    for kind, name in (("slow", "e4"), ("fast", "e5")):
        force = next(e for e in data.episodes if e.name == name).force[warm:]
        assert zero.groups[kind][0] == pytest.approx(np.sqrt(np.mean(force**2)), rel=1e-6)
    found = best_over_kinds(lines)
    assert found is not None
    best, mean = found
    assert best == "history-mlp"
    own = next(x for x in lines if x.predictor == "history-mlp")
    assert mean == pytest.approx(np.mean([own.groups[k][0] for k in ("slow", "fast")]))


def test_recordings_that_are_not_there_are_left_out(tmp_path) -> None:
    fish = DOMAINS["fish"]
    assert obtain(fish, tmp_path, tmp_path / "none", quick=True, progress=lambda d, t: None) is None


def test_the_command_writes_figures_tables_and_a_page(tmp_path) -> None:
    data = delayed_set()
    data = EpisodeSet("gantry", *list(vars(data).values())[1:])
    data.write(tmp_path / "sets" / "gantry-quick")
    told = CliRunner().invoke(
        main,
        ["study", "domains", "--quick", "--domains", "gantry", "--arch", "agile-mlp,esn", "--out",
         str(tmp_path)],
    )  # fmt: skip
    assert told.exit_code == 0, told.output
    folder = tmp_path / "domains-gantry-quick"
    assert {p.name for p in folder.iterdir()} == {
        "domains.png", "domains.pdf", "domains.csv", "domains-gantry.csv", "study.json",
        "study.html",
    }  # fmt: skip
    assert (folder / "domains.pdf").read_bytes()[:4] == b"%PDF"
    rows = list(csv.DictReader((folder / "domains.csv").open()))
    lines = json.loads((folder / "study.json").read_text())["lines"]
    assert len(rows) == len(lines) == 4
    assert float(rows[-1]["rmse"]) == lines[-1]["channels"][0]["rmse"]
    page = (folder / "study.html").read_text()
    assert "On gantry, esn is the best on validation" in page
    assert "Only of esn (one of 3) are hyper-parameters chosen" in page
    assert {row["hyper"] for row in rows if row["predictor"] == "agile-mlp"} == {""}
    assert [row["hyper"] for row in rows if row["predictor"] == "esn"] == [
        " ".join(f"{name}={value:g}" for name, value in lines[-1]["hyper"].items())
    ]
    assert "data:image/png;base64" in page


def test_wrong_names_are_refused_in_one_sentence(tmp_path) -> None:
    for options in (["--domains", "moon"], ["--arch", "oracle"], ["--domains", "fish"]):
        told = CliRunner().invoke(main, ["study", "domains", "--out", str(tmp_path), *options],
                                  env={"WAKEDEPLOY_DATA": str(tmp_path)})  # fmt: skip
        assert told.exit_code == 2, told.output
        assert "unexpected" not in told.output


def quiet(done: int, total: int) -> None:
    """No progress to show."""


def test_a_set_that_would_now_be_another_is_refused(tmp_path) -> None:
    made = replace(delayed_set(), provenance={"minutes": 2.0})
    calls: list[float] = []

    def make(minutes: float, progress: object) -> EpisodeSet:
        calls.append(minutes)
        return replace(made, provenance={"minutes": minutes})

    domain = Domain("toy", "force", 2.0, 1.0, make=make)
    obtain(domain, tmp_path, None, quick=False, progress=quiet)
    again = obtain(domain, tmp_path, None, quick=False, progress=quiet)
    assert again is not None
    assert again.sha256 == made.sha256
    assert calls == [2.0]
    with pytest.raises(UnusableInput, match=r"has 2.0 minutes, not 3.0; delete .*toy"):
        obtain(replace(domain, minutes=3.0), tmp_path, None, quick=False, progress=quiet)
    older = replace(made, provenance={"generator": "wakedeploy 0.0.0 toy", "minutes": 2.0})
    older.write(tmp_path / "toy")
    with pytest.raises(UnusableInput, match=r"was made by wakedeploy 0.0.0 toy"):
        obtain(domain, tmp_path, None, quick=False, progress=quiet)


def test_a_set_of_other_recordings_is_refused(tmp_path) -> None:
    record = tmp_path / "data" / "toys" / "one.npz"
    record.parent.mkdir(parents=True)
    record.write_bytes(b"first")

    def read(path: object, progress: object) -> EpisodeSet:
        files = {"one.npz": sha256_of(record.read_bytes())}
        return replace(delayed_set(), provenance={"files": files})

    domain = Domain("toy", "force", recordings="toys", read=read)
    for _ in range(2):
        assert obtain(domain, tmp_path, tmp_path / "data", quick=True, progress=quiet) is not None
    record.write_bytes(b"second")
    assert obtain(domain, tmp_path, None, quick=True, progress=quiet) is not None  # not at hand
    with pytest.raises(UnusableInput, match=r"was imported from another one\.npz"):
        obtain(domain, tmp_path, tmp_path / "data", quick=True, progress=quiet)
