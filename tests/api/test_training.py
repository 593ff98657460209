"""Training, scoring and exporting from Python: on the small set, with the commands' own numbers."""

import dataclasses
import json
import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from made_packages import package_of, tiny_manifest, tiny_model
from needs import c_compiler
from small_tune import small_set
from small_tune import wakedeploy as command

import wakedeploy as wd
from runtime.compiled.folder import read_c_folder
from trainers.trained_run import TrainedRun
from trainers.training.predict import predict
from trainers.training.tape import lay_tape
from wakedeploy.core.package import read_package, write_package


def echo() -> wd.EpisodeSet:
    """The small set, as long as the gate of the export asks for."""
    return small_set(640)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("session")


@pytest.fixture(scope="module")
def runs(session: Path) -> wd.Runs:
    return wd.train(echo(), ["history-mlp", "gru"], epochs=2, out=session / "runs",
                    hyper={"gru.hidden": 5}, pictures=False)  # fmt: skip


def test_a_run_is_the_one_that_the_command_trains(runs: wd.Runs, session: Path) -> None:
    echo().write(session / "set")
    told = session / "told.json"
    done = command("train", "--data", session / "set", "--arch", "history-mlp,gru", "--epochs", 2,
                   "--hyper", "gru.hidden=5", "--out", session / "other", "--json", told,
                   "--no-pictures")  # fmt: skip
    assert done.exit_code == 0, done.output
    rows = json.loads(told.read_text())["rows"]
    assert [row["rmse"] for row in rows] == [row.rmse for row in runs.scores.rows]
    assert [row["hyper"] for row in rows] == [run.config.hyper for run in runs]


def test_runs_are_found_by_place_and_by_architecture(runs: wd.Runs) -> None:
    assert [run.config.arch for run in runs] == ["history-mlp", "gru"]
    assert runs["gru"] is runs[1]
    assert runs["gru"].config.hyper["hidden"] == 5
    with pytest.raises(KeyError, match="'tcn' was not trained; there are history-mlp, gru"):
        runs["tcn"]


def test_scores_are_those_of_the_predictions(runs: wd.Runs) -> None:
    data, run = echo(), runs["gru"]
    scores = wd.evaluate(run, data, split="all")
    tape = lay_tape(data, "all", 0.0, max(data.warm_up_steps, run.config.warm_up_steps))
    error = (predict(run.predictor, tape) - tape.force)[tape.scored].double()
    assert scores.rows[0].rmse["f_n"] == pytest.approx(error.square().mean().sqrt().item())
    assert wd.evaluate(runs, data).rows[1].rmse == runs.scores.rows[1].rmse
    assert [row.rmse for row in wd.evaluate(runs.folder, data).rows] == [
        row.rmse for row in runs.scores.rows
    ]


@pytest.mark.slow
def test_each_episode_has_the_error_of_its_own_predictions(runs: wd.Runs, session: Path) -> None:
    data, run = echo(), runs["history-mlp"]
    package = wd.export(run, session / "episodes.onnx", data=data)
    scores = wd.evaluate(run, data, split="all")
    told = {each.episode: each for each in scores.rows[0].episodes}
    assert list(told) == [episode.name for episode in data.part("all")]
    for episode in data.part("all"):
        late = data.warm_up_steps
        off = (package.predict(episode.observation) - episode.force)[late:].astype(float)
        rmse, zero = (np.sqrt(np.mean(each**2)) for each in (off, episode.force[late:]))
        assert told[episode.name].samples == len(off)
        assert told[episode.name].rmse["f_n"] == pytest.approx(rmse, rel=1e-3)
        assert told[episode.name].relative["f_n"] == pytest.approx(rmse / zero, rel=1e-3)
    assert wd.evaluate(runs, data).rows[1].episodes == runs.scores.rows[1].episodes


def test_a_set_in_another_unit_is_warned_of_and_named(runs: wd.Runs) -> None:
    data = echo()
    tenfold = [dataclasses.replace(e, observation=10 * e.observation) for e in data.episodes]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        wd.evaluate(runs, data)
    told: list[str] = []
    wd.evaluate(runs, dataclasses.replace(data, episodes=tuple(tenfold)), warn=told.append)
    (sentence,) = told
    assert "u is " in sentence
    assert "check the unit" in sentence


@pytest.mark.parametrize("name", ["f n", "θ", "source-command", "0"])
def test_a_channel_that_no_package_can_name_is_told_in_words(tmp_path: Path, name: str) -> None:
    data = echo()
    odd = dataclasses.replace(data, force=(dataclasses.replace(data.force[0], name=name),))
    with pytest.raises(wd.UnusableInput, match="call it by letters, digits and '_'"):
        wd.train(odd, "gru", out=tmp_path / "run")


def test_a_split_without_episodes_is_refused_on_another_set(runs: wd.Runs) -> None:
    data = echo()
    learned = {episode.name: "train" for episode in data.episodes}
    with pytest.raises(wd.UnusableInput, match=r"has no episode in its 'test' split; assign"):
        wd.evaluate(runs, dataclasses.replace(data, split=learned), "test")


def test_no_run_is_kept_outside_of_where_runs_shall_be(tmp_path: Path) -> None:
    for domain in ("../elsewhere", "..", "a/b"):
        with pytest.raises(wd.UnusableInput, match="give it a plain name"):
            wd.train(dataclasses.replace(echo(), domain=domain), "agile-mlp", out=tmp_path / "in")
    assert not list(tmp_path.iterdir())


def test_another_range_is_warned_of_by_its_category_where_it_was_evaluated(runs: wd.Runs) -> None:
    data = echo()
    tenfold = tuple(dataclasses.replace(e, observation=10 * e.observation) for e in data.episodes)
    other = dataclasses.replace(data, episodes=tenfold)
    with pytest.warns(wd.OutOfRange) as told:
        wd.evaluate(runs, other)
    assert [warning.filename for warning in told] == [__file__]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", category=wd.OutOfRange)
        wd.evaluate(runs, other)


def test_scoring_says_on_which_episodes_the_runs_were_trained(runs: wd.Runs) -> None:
    """Of a set made anew, too, and of runs that recorded only which set they learned from."""
    data, told = echo(), []
    others = dataclasses.replace(
        data, episodes=(data.episodes[0], data.episodes[5]), split={"e0": "test", "e5": "test"}
    )
    for split in ("test", "validation", "train"):
        wd.evaluate(runs, data, split, warn=told.append)
    assert told == []
    wd.evaluate(runs, data, "all", warn=told.append)
    wd.evaluate(runs, others, "test", warn=told.append)
    kept = runs[0].metrics.model_copy(update={"learned_from": ()})
    wd.evaluate(dataclasses.replace(runs[0], metrics=kept), data, "all", warn=told.append)
    assert told[0].startswith("4 of the 6 episodes scored, such as e0, were learned from: errors")
    assert told[1].startswith("1 of the 2 episodes scored, such as e0, were learned from")
    assert told[2] == told[0]


def test_episodes_become_a_table(runs: wd.Runs) -> None:
    with pytest.raises(wd.UnusableInput, match='give "runs" or "episodes"'):
        runs.to_pandas("files")
    pytest.importorskip("pandas", reason="the extra notebook is not installed")
    frame = wd.evaluate(runs, echo(), split="train").to_pandas("episodes")
    assert list(frame["arch"]) == ["history-mlp"] * 4 + ["gru"] * 4
    assert list(frame["episode"][:4]) == ["e0", "e1", "e2", "e3"]
    pooled = np.sqrt(np.average(frame["rmse_f_n"][:4] ** 2, weights=frame["samples"][:4]))
    assert pooled == pytest.approx(wd.evaluate(runs, echo(), "train").rows[0].rmse["f_n"])


def test_a_finished_run_without_episodes_is_scored_in_each(session: Path) -> None:
    """Its record is written as before the errors in each episode were kept."""
    asked = {"epochs": 1, "out": session / "before", "pictures": False}
    first = wd.train(echo(), "history-mlp", **asked)
    record = first[0].folder / "metrics.json"
    facts = json.loads(record.read_text())
    del facts["test_episodes"]
    record.write_text(json.dumps(facts))
    again = wd.train(echo(), "history-mlp", **asked)
    assert again.scores.rows[0].episodes == first.scores.rows[0].episodes != ()
    assert again[0].metrics.test_episodes == first[0].metrics.test_episodes


def test_nothing_is_scored_before_a_longer_memory_is_full(session: Path) -> None:
    data = echo()
    long_s = 3 * data.window_s
    reach = round(long_s * data.rate_hz)
    hyper, heard = {"history-mlp.history_s": long_s}, []
    asked = {"epochs": 1, "hyper": hyper, "out": session / "long", "pictures": False}
    runs = wd.train(data, ["history-mlp", "agile-mlp"], **asked, warn=heard.append)
    assert [f"history_s = {long_s:g}" in told and "window_s" in told for told in heard] == [True]
    assert runs["history-mlp"].config.warm_up_steps == reach
    assert runs["agile-mlp"].config.warm_up_steps == data.warm_up_steps
    samples = sum(len(episode) - reach for episode in data.part("test"))
    assert {sum(e.samples for e in row.episodes) for row in runs.scores.rows} == {samples}
    assert runs.scores.baselines[0.0]["zero"].samples == samples
    again = wd.evaluate(runs, data)
    assert [row.rmse for row in again.rows] == [
        row.rmse for row in sorted(runs.scores.rows, key=lambda row: row.arch)
    ]


def test_scores_show_themselves(runs: wd.Runs) -> None:
    assert "RMSE f_n [N]: history-mlp s0" in repr(runs)
    assert "<td>gru</td>" in runs._repr_html_()
    assert "<td>zero</td>" in runs._repr_html_()
    assert "test RMSE f_n" in repr(runs["gru"])
    one = dataclasses.replace(runs.scores, rows=runs.scores.rows[:1])
    assert repr(one).startswith("<Scores of 1 run on test episodes")
    pytest.importorskip("pandas", reason="the extra notebook is not installed")
    assert list(runs.to_pandas()["arch"]) == ["history-mlp", "gru"]


def test_an_exported_run_predicts_what_it_did_in_training(runs: wd.Runs, session: Path) -> None:
    data = echo()
    made = wd.export(runs["history-mlp"], session / "made.onnx", data=data)
    (episode,) = data.part("test")
    tape = lay_tape(data, "test", 0.0, data.warm_up_steps)
    trained = predict(runs["history-mlp"].predictor, tape).numpy()
    np.testing.assert_allclose(made.predict(episode.observation), trained, rtol=1e-4, atol=1e-7)
    assert wd.load(session / "made.onnx").manifest == made.manifest
    _has_the_errors_of_its_run(made, runs["history-mlp"], data)


def _has_the_errors_of_its_run(made: wd.Predictor, run: TrainedRun, data: wd.EpisodeSet) -> None:
    """Both from the first step on that the package says counts."""
    (episode,) = data.part("test")
    counts = slice(made.manifest.warm_up_steps - 1, None)
    off = (made.predict(episode.observation) - episode.force)[counts].astype(float)
    row = wd.evaluate(run, data).rows[0]
    assert row.episodes[0].samples == len(off)
    assert row.rmse["f_n"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-4)


@pytest.mark.whole
def test_a_run_predicts_and_draws_as_its_package_does(runs: wd.Runs, session: Path) -> None:
    data, run = echo(), runs["gru"]
    package = wd.export(run, session / "same.onnx", data=data)
    (episode,) = data.part("test")
    _has_the_errors_of_its_run(package, run, data)
    series = np.stack([episode.observation[:90], episode.observation[100:190]])
    for given in (episode.observation, series, series.tolist()):
        forces = run.predict(given)
        assert forces.dtype == np.float32
        np.testing.assert_allclose(forces, package.predict(given), rtol=1e-4, atol=1e-6)
    assert run.predict(np.empty((0, 1))).shape == (0, 1)
    with pytest.raises(wd.UnusableInput, match=r"shape \(90, 2\); give \(T, 1\) or .*: u\."):
        run.predict(np.zeros((90, 2)))
    with pytest.raises(wd.UnusableInput, match=r"^data is 3: give a path"):
        run.plot(3)
    for other, why in (
        (dataclasses.replace(data, rate_hz=2 * data.rate_hz), "make the set at"),
        (
            dataclasses.replace(data, observation=(wd.Channel("v", "m"),)),
            "its observation channels",
        ),
    ):
        with pytest.raises(wd.UnusableInput, match=f"cannot be drawn on this echo set: .*{why}"):
            run.plot(other)
    lines = {line.get_label(): line for line in run.plot(data).axes[0].lines}
    late = data.warm_up_steps
    np.testing.assert_allclose(
        lines["predicted"].get_ydata(), run.predict(episode.observation)[late:, 0]
    )
    np.testing.assert_allclose(lines["true"].get_ydata(), episode.force[late:, 0])


@pytest.mark.whole
@c_compiler
def test_an_exported_run_becomes_c_beside_its_package(runs: wd.Runs, session: Path) -> None:
    data, file = echo(), session / "beside.onnx"
    made = wd.export(runs["history-mlp"], file, data=data, c=session / "c", name="wake")
    document = read_c_folder(session / "c").document
    assert (document.name, document.reference) == ("wake", "the training-time forward")
    assert document.package_sha256 == read_package(file).sha256
    (episode,) = data.part("test")
    told = wd.load(file).predict(episode.observation)
    np.testing.assert_allclose(made.predict(episode.observation), told, rtol=1e-4, atol=1e-6)
    (row,) = wd.evaluate(session / "c", data).rows
    assert row.rmse["f_n"] == pytest.approx(wd.evaluate(file, data).rows[0].rmse["f_n"], 1e-4)


def test_of_several_runs_one_is_exported(runs: wd.Runs) -> None:
    with pytest.raises(wd.UnusableInput, match=r'2 runs were trained; .* runs\["history-mlp"\]'):
        wd.export(runs, data=echo())


@pytest.mark.filterwarnings("ignore:.*were learned from")
def test_packages_are_scored_as_they_predict(runs: wd.Runs, session: Path) -> None:
    data, folder = echo(), session / "packages"
    made = [wd.export(run, folder / f"{run.config.arch}.onnx", data=data) for run in runs]
    scores = wd.evaluate(folder, data, "all")
    assert scores.to_pandas()["arch"].tolist() == ["history-mlp", "gru"]
    assert wd.evaluate(made, data, "all").rows[1].rmse == scores.rows[1].rmse
    late = max(data.warm_up_steps, *(run.config.warm_up_steps for run in runs))
    for row, package, run in zip(scores.rows, made, runs, strict=True):
        off = [(package.predict(e.observation) - e.force)[late:] for e in data.episodes]
        assert row.rmse["f_n"] == pytest.approx(np.sqrt(np.mean(np.concatenate(off) ** 2)), 1e-5)
        assert [e.samples for e in row.episodes] == [len(part) for part in off]
        assert row.rmse["f_n"] == pytest.approx(wd.evaluate(run, data, "all").rows[0].rmse["f_n"])
        assert (row.run, row.device, row.seed) == (str(package.path), None, run.config.seed)


def test_a_package_says_what_it_learned_from_and_what_it_cannot_read(
    runs: wd.Runs, session: Path
) -> None:
    data = echo()
    package = wd.export(runs["history-mlp"], session / "said.onnx", data=data)
    with pytest.warns(UserWarning, match=r"episodes scored, such as \w+, were learned from"):
        wd.evaluate(package, data, "all")
    slower = dataclasses.replace(data, rate_hz=data.rate_hz / 2)
    with pytest.raises(wd.UnusableInput, match=r"said\.onnx cannot be evaluated on this echo set"):
        wd.evaluate(package.path, slower)
    drifted = dataclasses.replace(data, rate_hz=data.rate_hz * 1.004)
    assert wd.evaluate(package, drifted).rows[0].rmse == pytest.approx(
        wd.evaluate(package, data).rows[0].rmse, rel=0.02
    )


def test_what_in_a_folder_cannot_be_scored_is_told_and_the_rest_is_scored(
    runs: wd.Runs, tmp_path: Path
) -> None:
    data = echo()
    wd.export(runs["gru"], tmp_path / "p" / "fits.onnx", data=data)
    write_package(
        package_of(tiny_model("none"), tiny_manifest("none")), tmp_path / "p" / "other.onnx"
    )
    (tmp_path / "p" / "torn.onnx").write_bytes((tmp_path / "p" / "fits.onnx").read_bytes()[:999])
    told: list[str] = []
    scores = wd.evaluate(tmp_path / "p", data, "test", warn=told.append)
    assert [row.arch for row in scores.rows] == ["gru"]
    assert re.search(
        r"^Left out: \S+other\.onnx cannot be evaluated on this echo set: its", told[0]
    )
    assert re.search(r"^Left out: \S+torn\.onnx: ", told[1])
    (tmp_path / "p" / "fits.onnx").unlink()
    with pytest.raises(wd.UnusableInput, match=r"other\.onnx cannot be evaluated on this echo"):
        wd.evaluate(tmp_path / "p", data)


def test_a_damaged_run_is_told_and_the_rest_is_scored(runs: wd.Runs, tmp_path: Path) -> None:
    shutil.copytree(runs["gru"].folder.parents[1], tmp_path / "runs")
    torn = next(tmp_path.rglob("history-mlp/*/best.safetensors"))
    torn.write_bytes(torn.read_bytes()[:99])
    told: list[str] = []
    assert len(wd.evaluate(tmp_path / "runs", echo(), warn=told.append).rows) == 1
    assert re.search(r"^Left out: \S+best\.safetensors is damaged", told[0])
    with pytest.raises(wd.UnusableInput, match=r"best\.safetensors is damaged"):
        wd.evaluate(torn.parent, echo())


def test_a_damaged_run_counts_and_an_error_of_progress_is_none_of_a_run(
    runs: wd.Runs, tmp_path: Path
) -> None:
    shutil.copytree(runs["gru"].folder.parents[1], tmp_path / "runs")
    torn = max(tmp_path.rglob("best.safetensors"))
    torn.write_bytes(torn.read_bytes()[:99])
    steps: list[tuple[int, int]] = []

    def progress(stage: str, done: int, total: int) -> None:
        if stage == "Reading the runs":
            steps.append((done, total))

    wd.evaluate(tmp_path / "runs", echo(), warn=lambda _: None, progress=progress)
    assert steps == [(1, 2), (2, 2)]

    def raising(*_: object) -> None:
        raise wd.UnusableInput("mine: --seed and --out are kept")

    with pytest.raises(wd.UnusableInput, match=r"^mine: --seed and --out are kept$"):
        wd.evaluate(tmp_path / "runs", echo(), warn=lambda _: None, progress=raising)


def test_a_run_of_other_settings_is_told_before_any_is_trained(
    session: Path, runs: wd.Runs
) -> None:
    with pytest.raises(wd.UnusableInput, match=r"gru/s0 was trained with epochs = 2, not 3"):
        wd.train(echo(), ["agile-mlp", "gru"], epochs=3, out=session / "runs",
                 hyper={"gru.hidden": 5})  # fmt: skip
    assert not any(session.glob("runs/*/agile-mlp"))


def test_what_is_no_run_is_not_evaluated(runs: wd.Runs, session: Path) -> None:
    with pytest.raises(wd.UnusableInput, match=r"gone holds no finished run: there is no such"):
        wd.evaluate(session / "gone", echo())
    for strange in (runs["gru"].predictor, [runs[0], 3]):
        with pytest.raises(wd.UnusableInput, match=r"cannot be evaluated; give what train"):
            wd.evaluate(strange, echo())


def test_several_to_evaluate_are_no_paths(runs: wd.Runs) -> None:
    with pytest.raises(
        wd.UnusableInput, match=r"^'runs' is a path, .* wd\.load, or give one folder"
    ):
        wd.evaluate([runs[0], "runs"], echo())


def test_the_folder_of_a_run_is_no_package_yet(runs: wd.Runs) -> None:
    with pytest.raises(wd.UnusableInput, match=r"folder of a run; .*`wakedeploy export --run"):
        wd.fly(runs["gru"].folder)
    with pytest.raises(wd.UnusableInput, match=r"folder of a run; .*wd\.export"):
        wd.load(runs["gru"].folder)


def test_names_that_are_none_are_answered(session: Path) -> None:
    with pytest.raises(wd.UnusableInput, match="'gruu' is no architecture; did you mean gru"):
        wd.train(echo(), "gruu", out=session)
    with pytest.raises(wd.UnusableInput, match="hyper hidden: name the architecture too"):
        wd.train(echo(), ["gru", "tcn"], hyper={"hidden": 4}, out=session)
    with pytest.raises(wd.UnusableInput, match="'ships' is no domain; did you mean ship"):
        wd.make_set("ships")
    with pytest.raises(wd.UnusableInput, match="The domain fish cannot be simulated"):
        wd.make_set("fish")
    with pytest.raises(wd.UnusableInput, match="ship has no setting 'rig'; it has level"):
        wd.make_set("ship", rig=None)


def test_a_study_reads_its_set_from_a_folder() -> None:
    with pytest.raises(
        wd.UnusableInput, match=r"read the set from a folder, .* data\.write\(FOLDER\)"
    ):
        wd.tune(echo(), "gru", trials=1)


def test_a_number_far_from_all_others_is_told_before_it_is_learned_from(tmp_path: Path) -> None:
    data, told = echo(), list[str]()
    wd.train(data, "agile-mlp", epochs=1, out=tmp_path / "a", pictures=False, warn=told.append)
    assert not any("elsewhere" in sentence for sentence in told)
    force = data.episodes[2].force.copy()
    force[31] = 1e5
    episodes = [*data.episodes]
    episodes[2] = dataclasses.replace(data.episodes[2], force=force)
    spoiled = dataclasses.replace(data, episodes=tuple(episodes))
    wd.train(spoiled, "agile-mlp", epochs=1, out=tmp_path / "b", pictures=False, warn=told.append)
    (sentence,) = [sentence for sentence in told if "elsewhere" in sentence]
    assert sentence.startswith(f"f_n is 1e+05 N at sample 31 of episode {episodes[2].name}, and")
