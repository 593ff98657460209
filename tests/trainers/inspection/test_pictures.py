"""The pictures that a training leaves: what they show, when they are drawn, what they cost."""

import dataclasses
import html
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner, Result

from trainers.inspection import pictures
from trainers.inspection.curves import draw_curves
from trainers.inspection.pictures import write_pictures
from trainers.inspection.prediction import draw_prediction
from trainers.inspection.report import REPORT, still_falling, write_run_report
from trainers.trained_run import TrainedRun, load_run
from trainers.training.baselines import baselines
from trainers.training.fit import Fit, FitSettings
from trainers.training.runs import BEST, METRICS, RidgeErrors, new_predictor
from trainers.training.trainer import configure, new_fit, tapes, train
from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet, read_episode_set
from wakedeploy.core.manifest import Scores

SHORT = FitSettings(epochs=5, lanes=4, chunk_steps=32)
NAMES = ("curves.png", "prediction.png")


def wakedeploy(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def trained(data: EpisodeSet, root: Path, arch: str = "agile-mlp", **asked) -> TrainedRun:
    given = {"seed": 0, "lead_s": 0.0, "settings": SHORT} | asked
    return train(configure(data, arch, **given), data, root)


@pytest.fixture(autouse=True, scope="module")
def pictures_are_drawn_once() -> None:
    """Not here, where they are looked at."""


@pytest.fixture(scope="module")
def data_folder(echo: EpisodeSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    echo.write(folder)
    return folder


def by_label(axes) -> dict[str, object]:
    return {line.get_label(): line for line in axes.lines}


@pytest.mark.slow
def test_training_leaves_both_pictures_with_each_seed(data_folder: Path, tmp_path: Path) -> None:
    done = wakedeploy(
        "train", "--data", data_folder, "--arch", "agile-mlp,esn", "--seeds", 2, "--epochs", 2,
        "--hyper", "esn.neurons=40", "--out", tmp_path,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "report.html in the folder of each run" in done.output
    for arch in ("agile-mlp", "esn"):
        for name in NAMES:
            for seed in (0, 1):
                path = tmp_path / "echo" / arch / f"s{seed}" / name
                assert path.read_bytes().startswith(b"\x89PNG")


def test_a_run_leaves_a_page_that_says_how_well_it_predicts(echo: EpisodeSet, tmp_path) -> None:
    run = trained(echo, tmp_path)
    kept = run.metrics.model_copy(update={"test": Scores(rmse={"f_n": 0.006}, r2={"f_n": 0.91})})
    run = dataclasses.replace(run, metrics=kept)
    beside = baselines(echo, "test", 0.0)
    words = re.sub(r"</?span>", "", write_run_report(run, beside).read_text("utf-8"))
    text = html.unescape(words)
    assert "It predicts f_n to within 0.006 N (RMS): well." in text
    mean = f"{beside['training mean'].rmse['f_n']:.3g}"
    assert f"Always naming the mean force of the training episodes errs by {mean} N." in text
    assert "Judged on episodes that took no part in training." in text
    assert "explains 91 % of the force's variance there" in text
    assert f"wakedeploy export --run {run.folder}" in text
    assert "run-gantry" not in text  # no gantry
    assert "fly it" not in text
    assert "wakedeploy export --package agile-mlp.onnx --c agile_mlp_c" in text
    dots = re.findall(r"<title>validation: ([\d.]+) at epoch (\d+)</title>", text)
    assert [float(error) ** 2 for error, _ in dots] == pytest.approx(run.metrics.history, rel=1e-3)
    (tested,) = run.metrics.test_episodes
    row = ("e0", str(tested.samples), f"{tested.rmse['f_n']:.4g}", f"{tested.relative['f_n']:.3f}")
    assert "<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" in text
    linear = f"{beside['linear, window'].rmse['f_n']:.4g}"
    row = ("linear, window", "test", str(tested.samples), "f_n", linear)
    assert "".join(f"<td>{cell}</td>" for cell in row) in text
    for rmse, is_told in ((0.005, True), (0.007, False)):
        rival = {"linear, one tick": dataclasses.replace(beside["zero"], rmse={"f_n": rmse})}
        (run.folder / REPORT).unlink()
        page = write_run_report(run, rival).read_text("utf-8")
        told = html.unescape(re.sub(r"</?span>", "", page))
        assert (
            "Something simpler does better: linear, one tick errs by 0.005 N." in told
        ) == is_told
    before = write_run_report(run, beside).stat().st_mtime_ns
    assert write_run_report(run, beside).stat().st_mtime_ns == before


def page_of(run: TrainedRun, rmse: float, r2: float | None, beside: dict) -> str:
    """What the page of a run with these errors on test episodes says."""
    kept = run.metrics.model_copy(update={"test": Scores(rmse={"f_n": rmse}, r2={"f_n": r2})})
    (run.folder / REPORT).unlink(missing_ok=True)
    page = write_run_report(dataclasses.replace(run, metrics=kept), beside).read_text("utf-8")
    return html.unescape(re.sub(r"</?(span|code|wbr)>", "", page))


def test_nothing_learned_is_said_by_the_forecast_that_is_named(echo: EpisodeSet, tmp_path) -> None:
    run = trained(echo, tmp_path)
    zero = baselines(echo, "test", 0.0)["zero"]
    beside = {"zero": dataclasses.replace(zero, rmse={"f_n": 0.2}),
              "training mean": dataclasses.replace(zero, rmse={"f_n": 0.1753})}  # fmt: skip
    better = page_of(run, 0.0731, -7.0, beside)
    assert "learned nothing" not in better
    assert "to within 0.0731 N (RMS): poorly." in better
    assert "the mean force of the training episodes errs by 0.175 N" in better
    assert "naming their own mean would err by 0.0258 N" in better  # 0.0258² × 8 = 0.0731²
    assert "make a package of it, prove it, and make C of it" in better
    worse = page_of(run, 0.18, 0.1, beside)
    assert "to within 0.18 N (RMS): it learned nothing." in worse
    assert "Always naming the mean force of the training episodes errs no more" in worse
    assert "fly it" not in worse
    assert "What to try: look whether units and ranges are right." in worse
    assert "--split train" in worse
    calm = page_of(run, 0.05, None, {"zero": dataclasses.replace(zero, rmse={"f_n": 0.02})})
    assert "Always naming a force of zero errs no more: by 0.02 N." in calm


def test_a_page_says_on_how_many_samples_its_errors_rest(echo: EpisodeSet, tmp_path) -> None:
    run = trained(echo, tmp_path)
    (tested,) = run.metrics.test_episodes
    beside = baselines(echo, "test", 0.0)
    assert beside["zero"].samples == tested.samples
    assert "Only" not in page_of(run, 0.01, 0.5, beside)
    few = run.metrics.model_copy(
        update={"test_episodes": (dataclasses.replace(tested, samples=3),)}
    )
    told = page_of(dataclasses.replace(run, metrics=few), 0.01, 0.5, beside)
    assert "Only 3 test samples are scored: an error over fewer than 100 is uncertain" in told


def test_more_epochs_are_advised_only_where_the_error_still_falls() -> None:
    flat = [0.5 * 0.8**epoch + 0.0165 for epoch in range(60)]
    noisy = [0.0165 + 0.0002 * (-1) ** epoch for epoch in range(59)] + [0.016]  # the last is best
    falling = [1.0 * 0.98**epoch for epoch in range(60)]
    assert [still_falling(each) for each in (flat, noisy, falling)] == [False, False, True]
    assert still_falling([1.2, 0.44, 0.3, 0.2, 0.17])
    assert not still_falling([0.9, 0.8, 0.7])  # too few to tell it from noise
    assert not still_falling([0.0] * 60)


def test_curves_are_the_errors_of_each_epoch_with_the_best_marked() -> None:
    held_out, learned = (1.0, 0.25, 0.04, 0.09), (1.21, 0.36, 0.0625, 0.01)
    (axes,) = draw_curves("gru s0", held_out, learned).axes
    lines = by_label(axes)
    training, validation = lines["training, while each epoch ran"], lines["validation, after it"]
    assert list(validation.get_xdata()) == list(training.get_xdata()) == [1, 2, 3, 4]
    assert validation.get_ydata() == pytest.approx([1.0, 0.5, 0.2, 0.3])
    assert training.get_ydata() == pytest.approx([1.1, 0.6, 0.25, 0.1])
    assert (lines["_best"].get_xdata()[0], lines["_best"].get_ydata()[0]) == (3, 0.2)
    assert "best validation error 0.2 in epoch 3" in axes.get_title(loc="left")
    assert axes.get_yscale() == "log"
    (narrow,) = draw_curves("gru s0", (0.25, 0.24), (0.26, 0.2)).axes
    assert narrow.get_yscale() == "linear"


def test_runs_begun_before_training_losses_were_kept_are_drawn_with_those_there_are() -> None:
    (axes,) = draw_curves("gru s0", (1.0, 0.5, 0.3), (0.2,)).axes
    assert list(by_label(axes)["training, while each epoch ran"].get_xdata()) == [3]
    (axes,) = draw_curves("gru s0", (1.0, 0.5, 0.3), ()).axes
    assert list(by_label(axes)["validation, after it"].get_xdata()) == [1, 2, 3]
    assert draw_curves("esn s0", (1.0,), ()) is None  # a single point is no curve


def test_a_reservoirs_curves_run_over_the_strengths_of_its_ridge(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    run = trained(echo, tmp_path, "esn", hyper={"neurons": 80})
    ridge = run.metrics.ridge
    least = min(ridge.validation["f_n"])
    assert least == pytest.approx(run.metrics.history[0], rel=1e-6)  # what was taken
    assert list(ridge.training["f_n"]) == sorted(ridge.training["f_n"])  # damping costs fit
    (axes,) = draw_curves("esn s0", run.metrics.history, (), ridge).axes
    shown, best = by_label(axes)["f_n, validation"], by_label(axes)["_best"]
    assert shown.get_ydata() == pytest.approx(np.sqrt(ridge.validation["f_n"]))
    assert best.get_xdata()[0] == ridge.strengths[ridge.validation["f_n"].index(least)]
    torn = RidgeErrors(strengths=(1.0, 2.0), training={"f": (None, 1.0)},
                       validation={"f": (None, None)})  # fmt: skip
    assert draw_curves("esn s0", (1.0,), (), torn) is not None


def test_the_training_loss_is_that_of_the_weights_that_played(echo: EpisodeSet) -> None:
    """With one update an epoch the first one's loss is that of the untrained weights."""
    settings = dataclasses.replace(SHORT, batch=100_000)
    config = configure(echo, "history-mlp", seed=0, lead_s=0.0, settings=settings)
    fit = new_fit(config, new_predictor(config), *tapes(echo, 0.0))
    with torch.no_grad():
        untrained = fit.predictor.core(fit.seen.at(torch.nonzero(fit.train.scored)[:, 0]))
    expected = np.mean((untrained - fit.target[fit.train.scored]).numpy() ** 2)
    (told,) = fit.run_epoch().training_history
    assert told == pytest.approx(expected, rel=1e-5)


def test_over_lanes_the_training_loss_is_the_mean_over_scored_samples(echo: EpisodeSet) -> None:
    """Weights that do not move lose on the way what they lose over the whole training split."""
    settings = dataclasses.replace(SHORT, learning_rate=1e-7)
    config = configure(
        echo, "gru", seed=0, lead_s=0.0, settings=settings, hyper={"hidden": 8, "dropout": 0.0}
    )
    fit = new_fit(config, new_predictor(config), *tapes(echo, 0.0))
    told = fit.run_epoch().training_history[0]
    fit.validation = fit.train
    assert told == pytest.approx(fit.validate(), rel=0.05)  # lanes leave a few samples out


def test_the_prediction_is_that_of_the_scored_samples_in_si_units(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    run = trained(echo, tmp_path, "gru", lead_s=0.25, hyper={"hidden": 8})
    drawn = draw_prediction("gru", run.config, run.predictor, echo, run.metrics.test)
    forces, residual = drawn.axes
    (episode,) = echo.part("test")
    with torch.no_grad():
        every = run.predictor.rollout(torch.tensor(episode.observation)[None])[0].numpy()
    expected = every[echo.warm_up_steps : -5, 0]  # 0.25 s at 20 Hz
    lines = by_label(forces)
    np.testing.assert_allclose(lines["predicted"].get_ydata(), expected, atol=1e-6)
    true = episode.force[echo.warm_up_steps + 5 :, 0]
    np.testing.assert_allclose(lines["true"].get_ydata(), true, atol=1e-7)
    assert lines["true"].get_xdata()[0] == pytest.approx(echo.warm_up_steps / 20 + 0.25)
    np.testing.assert_allclose(residual.lines[-1].get_ydata(), expected - true, atol=1e-6)
    rmse = np.sqrt(np.mean((expected - true) ** 2))
    assert run.metrics.test.rmse["f_n"] == pytest.approx(rmse, rel=1e-5)
    title = forces.get_title(loc="left")
    assert title.startswith(f"f_n: RMSE {rmse:.3g} N here, {rmse:.3g} N over all test episodes")
    assert f"(R² {run.metrics.test.r2['f_n']:.3f})" in title
    assert "e0, predicted 0.25 s ahead" in drawn.get_suptitle()


def test_of_long_episodes_the_liveliest_stretch_is_shown(
    make_echo: Callable[..., EpisodeSet], tmp_path: Path
) -> None:
    data = make_echo(steps=3000, episodes=4)
    calm = np.full((3000, 1), 0.001, np.float32)
    calm[1700:1800] = np.sin(np.arange(100))[:, None]
    long = Episode("long", data.episodes[0].observation, calm)
    episodes = (*(e for e in data.episodes if e.name != "e0"), long)
    split = {e.name: data.split.get(e.name, "test") for e in episodes} | {"e1": "test"}
    split["e2"] = "validation"
    data = dataclasses.replace(data, episodes=episodes, split=split)
    settings = dataclasses.replace(SHORT, epochs=1)
    run = trained(data, tmp_path, settings=settings)
    drawn = draw_prediction("mlp", run.config, run.predictor, data, run.metrics.test)
    assert "test episode long" in drawn.get_suptitle()
    time_s = by_label(drawn.axes[0])["true"].get_xdata()
    assert len(time_s) == 1000
    assert time_s[0] <= 1700 / 20
    assert time_s[-1] >= 1799 / 20


def test_each_force_has_its_panels(echo: EpisodeSet, tmp_path: Path) -> None:
    episodes = tuple(
        dataclasses.replace(
            e, force=np.hstack([e.force, (echo.split[e.name] == "train") * e.force])
        )
        for e in echo.episodes
    )
    force = (*echo.force, Channel("m_n_m", "N·m"))
    data = dataclasses.replace(echo, force=force, loss_weights=(1.0, 1.0), episodes=episodes)
    run = trained(data, tmp_path, settings=dataclasses.replace(SHORT, epochs=1))
    axes = draw_prediction("mlp", run.config, run.predictor, data, run.metrics.test).axes
    assert len(axes) == 4
    assert axes[2].get_title(loc="left").startswith("m_n_m: RMSE")
    assert "R²" not in axes[2].get_title(loc="left")  # a force that never changes there has none
    assert axes[2].get_ylabel() == "[N·m]"


@pytest.mark.whole
def test_an_interrupted_training_leaves_pictures_so_far_and_the_resumed_one_the_whole(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    titles: list[str] = []
    drawn = pictures.draw_curves
    monkeypatch.setattr(pictures, "draw_curves", lambda t, *a: titles.append(t) or drawn(t, *a))
    asked = ("train", "--data", data_folder, "--arch", "gru", "--epochs", 4, "--out", tmp_path)
    run_epoch = Fit.run_epoch

    def interrupted(self: Fit):
        if self.standing.epoch == 2:
            raise KeyboardInterrupt
        return run_epoch(self)

    with monkeypatch.context() as patch:
        patch.setattr(Fit, "run_epoch", interrupted)
        assert wakedeploy(*asked).exit_code == 130
    folder = tmp_path / "echo" / "gru" / "s0"
    assert titles == ["gru s0 on echo, stopped after epoch 2 of 4"]
    before = {name: (folder / name).read_bytes() for name in NAMES}
    assert wakedeploy(*asked).exit_code == 0
    assert titles[1:] == ["gru s0 on echo"]
    assert all((folder / name).read_bytes() != before[name] for name in NAMES)
    whole = trained(read_episode_set(data_folder), tmp_path / "whole", "gru",
                    settings=FitSettings(epochs=4))  # fmt: skip
    metrics = load_run(folder).metrics
    assert metrics.training_history == whole.metrics.training_history
    assert len(metrics.training_history) == 4


@pytest.mark.whole
def test_a_finished_run_is_drawn_once_and_again_when_it_is_replaced(
    data_folder: Path, tmp_path: Path
) -> None:
    asked = ("train", "--data", data_folder, "--arch", "agile-mlp", "--epochs", 2)
    asked = (*asked, "--out", tmp_path)
    folder = tmp_path / "echo" / "agile-mlp" / "s0"
    done = wakedeploy(*asked, "--no-pictures")
    assert done.exit_code == 0
    assert "Pictures" not in done.output
    assert not any((folder / name).exists() for name in NAMES)
    assert wakedeploy(*asked).exit_code == 0  # trained before
    drawn = {name: (folder / name).stat().st_mtime_ns for name in NAMES}
    assert wakedeploy(*asked).exit_code == 0
    assert drawn == {name: (folder / name).stat().st_mtime_ns for name in NAMES}
    assert wakedeploy(*asked, "--fresh", "--no-pictures").exit_code == 0
    assert not any(
        (folder / name).exists() for name in (*NAMES, "report.html")
    )  # they were of another run


@pytest.mark.whole
def test_a_run_of_before_keeps_what_it_has_and_is_drawn(echo: EpisodeSet, tmp_path: Path) -> None:
    for arch, left in (("agile-mlp", NAMES), ("esn", NAMES[1:])):
        run = trained(echo, tmp_path, arch, hyper={"neurons": 40} if arch == "esn" else None)
        told = json.loads((run.folder / METRICS).read_text())
        for new in ("training_history", "ridge"):
            del told[new]
        (run.folder / METRICS).write_text(json.dumps(told))
        paths = write_pictures(load_run(run.folder), echo)
        assert tuple(path.name for path in paths) == left


@pytest.mark.slow
def test_pictures_change_nothing_of_what_is_trained(data_folder: Path, tmp_path: Path) -> None:
    asked = ("train", "--data", data_folder, "--arch", "gru,agile-mlp", "--epochs", 2)
    assert wakedeploy(*asked, "--out", tmp_path / "with").exit_code == 0
    assert wakedeploy(*asked, "--out", tmp_path / "without", "--no-pictures").exit_code == 0
    for arch in ("gru", "agile-mlp"):
        weights = [(tmp_path / side / "echo" / arch / "s0" / BEST).read_bytes() for side in
                   ("with", "without")]  # fmt: skip
        assert weights[0] == weights[1]
    run = load_run(tmp_path / "without" / "echo" / "gru" / "s0")
    states = [torch.random.get_rng_state(), np.random.get_state()[1].copy()]  # noqa: NPY002
    write_pictures(run, read_episode_set(data_folder))
    assert torch.equal(states[0], torch.random.get_rng_state())
    assert np.array_equal(states[1], np.random.get_state()[1])  # noqa: NPY002


def test_a_picture_that_cannot_be_written_costs_no_result(
    data_folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "echo" / "agile-mlp" / "s0" / "curves.png").mkdir(parents=True)
    done = wakedeploy(
        "train", "--data", data_folder, "--arch", "agile-mlp", "--epochs", 1, "--out", tmp_path
    )
    assert done.exit_code == 0, done.output
    assert "No pictures: " in done.output
    assert "R² f_n" in done.output


@pytest.mark.slow
def test_nothing_that_trains_loads_the_drawing_library(data_folder: Path, tmp_path: Path) -> None:
    program = f"""
import sys
from pathlib import Path
from trainers.training.trainer import configure, train
from wakedeploy.core.episodes import read_episode_set
import trainers.tuning.trial, wakedeploy.sweep.jobs, wakedeploy.study.runs
data = read_episode_set(Path({str(data_folder)!r}))
train(configure(data, "agile-mlp", seed=0, lead_s=0.0), data, Path({str(tmp_path)!r}))
assert not [name for name in sys.modules if name.startswith("matplotlib")]
"""
    subprocess.run([sys.executable, "-c", program], check=True)
    assert (tmp_path / "echo" / "agile-mlp" / "s0" / METRICS).exists()
