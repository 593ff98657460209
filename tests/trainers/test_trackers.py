"""What TensorBoard and MLflow were told of a training, read back by their own readers."""

import importlib.util
import json
import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from trainers.trackers import following
from trainers.trackers.values import epochs, named, parameters
from trainers.trained_run import load_run
from trainers.training.fit import Fit, FitSettings, Standing, learning_rate
from trainers.training.runs import BEST, finished_runs
from trainers.training.trainer import configure
from wakedeploy.cli import main
from wakedeploy.core.episodes import EpisodeSet

needs_tensorboard = pytest.mark.skipif(
    importlib.util.find_spec("tensorboard") is None,
    reason="without tensorboard; to run them: pip install '.[tensorboard]'",
)
needs_mlflow = pytest.mark.skipif(
    importlib.util.find_spec("mlflow") is None,
    reason="without mlflow; to run them: pip install '.[mlflow]'",
)
EPOCH_FIELDS = {"loss/training", "loss/validation", "learning_rate"}
FINAL_FIELDS = {
    "validation/rmse/f_n", "validation/r2/f_n", "test/rmse/f_n", "test/r2/f_n",
    "best_epoch", "seconds", "trainable", "frozen",
}  # fmt: skip
PARAMETERS = {
    "arch", "domain", "seed", "lead_s", "rate_hz", "window_s", "data_sha256", "present_only",
    "hyper.hidden", "hyper.head", "hyper.projection", "hyper.dropout",
    "fit.epochs", "fit.patience", "fit.learning_rate", "fit.weight_decay", "fit.gradient_clip",
    "fit.lanes", "fit.chunk_steps",
}  # fmt: skip
GRU = ("--arch", "gru", "--hyper", "gru.hidden=6", "--epochs", 4)


@pytest.fixture(scope="module")
def data_folder(echo: EpisodeSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    echo.write(folder)
    return folder


def train(data_folder: Path, out: Path, *asked: object) -> Result:
    words = ("train", "--data", data_folder, "--out", out, *asked)
    return CliRunner().invoke(main, [str(word) for word in words])


def interrupted_at(epoch: int, patch: pytest.MonkeyPatch) -> None:
    run_epoch = Fit.run_epoch

    def run(self: Fit) -> Standing:
        if self.standing.epoch == epoch:
            raise KeyboardInterrupt
        return run_epoch(self)

    patch.setattr(Fit, "run_epoch", run)


def expected(folder: Path) -> dict[str, list[float]]:
    """What every epoch has to be told as, from the run's own files."""
    run = load_run(folder)
    settings = FitSettings(**run.config.settings)
    return {
        "loss/training": list(run.metrics.training_history),
        "loss/validation": list(run.metrics.history),
        "learning_rate": [learning_rate(settings, e) for e in range(run.metrics.epochs)],
    }


# --- what is told -------------------------------------------------------------------------------


def test_epochs_are_told_once_and_those_without_a_training_loss_without(echo: EpisodeSet) -> None:
    config = configure(echo, "gru", seed=0, lead_s=0.0)
    standing = Standing((0.9, 0.5, 0.4), (0.6, math.nan))
    told = dict(epochs(config, standing, after=1))
    assert set(told) == {2, 3}
    assert told[2]["loss/training"] == 0.6
    assert "loss/training" not in told[3]  # an epoch without an update has none
    assert "loss/training" not in dict(epochs(config, standing, after=0))[1]
    solved = configure(echo, "esn", seed=0, lead_s=0.0)
    assert list(epochs(solved, Standing((0.1,)), 0)) == [(1, {"loss/validation": 0.1})]


def test_parameters_are_what_decides_a_run_and_names_are_ones_that_all_take(
    echo: EpisodeSet,
) -> None:
    config = configure(echo, "gru", seed=3, lead_s=0.1, hyper={"hidden": 6}, present_only=("idle",))
    told = parameters(config)
    assert set(told) == PARAMETERS
    assert (told["seed"], told["lead_s"], told["hyper.hidden"]) == (3, 0.1, 6)
    assert told["present_only"] == '["idle"]'
    solved = parameters(configure(echo, "esn", seed=0, lead_s=0.0))
    assert not [name for name in solved if name.startswith("fit.")]  # nothing is descended
    assert named("test", "rmse", "F z [µN/m]") == "test/rmse/F_z___N_m_"


def test_a_tracker_that_fails_is_told_once_and_costs_no_training(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    class Full:
        told, failures = "", (OSError,)
        calls = 0

        def track(self, *asked):
            return self

        def why(self, failure):
            return str(failure)

        def stands(self, standing):
            self.calls += 1
            raise OSError("no space left")

        finished = close = stands

    full, said = Full(), []
    config = configure(echo, "gru", seed=0, lead_s=0.0)
    with following(full, config, tmp_path, fresh=False, warn=said.append) as run:
        run.stands(Standing((0.5,), (0.6,)))
        run.stands(Standing((0.5, 0.4), (0.6, 0.5)))
    assert full.calls == 1
    (sentence,) = said
    assert "no space left" in sentence
    assert "goes on without it" in sentence


@pytest.mark.parametrize("name", ["tensorboard", "mlflow"])
def test_a_library_that_is_missing_is_one_sentence_with_what_installs_it(
    name: str, data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda asked, *a: None if asked == name else find(asked, *a)
    )
    done = train(data_folder, tmp_path / "runs", *GRU, "--tracker", name)
    assert done.exit_code == 2
    said = " ".join(done.output.split())
    assert f"{name} is not installed; install it: " in said
    assert f"'.[{name}]'" in said
    assert not (tmp_path / "runs").exists()


def test_a_library_that_does_not_work_with_another_is_told_before_anything_is_trained(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mlflow.py").write_text("raise ImportError('no Pool in sqlalchemy.pool')")
    for name in [name for name in sys.modules if "mlflow" in name]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    done = train(data_folder, tmp_path / "runs", *GRU, "--tracker", "mlflow")
    assert done.exit_code == 2
    said = " ".join(done.output.split())
    assert "does not work as it is installed (no Pool in sqlalchemy.pool); install it anew" in said
    assert not (tmp_path / "runs").exists()


# --- TensorBoard --------------------------------------------------------------------------------


def events(folder: Path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    return EventAccumulator(str(folder), {"scalars": 0, "tensors": 0, "images": 0}).Reload()


def assert_tensorboard_was_told(folder: Path) -> None:
    read = events(folder)
    assert set(read.Tags()["scalars"]) == EPOCH_FIELDS | FINAL_FIELDS
    for name, values in expected(folder).items():
        told = read.Scalars(name)
        assert [event.step for event in told] == [1, 2, 3, 4]
        assert [event.value for event in told] == pytest.approx(values, rel=1e-6)
    metrics = load_run(folder).metrics
    (rmse,) = read.Scalars("test/rmse/f_n")
    assert (rmse.step, rmse.value) == (metrics.best_epoch, pytest.approx(metrics.test.rmse["f_n"]))


@pytest.mark.whole
@needs_tensorboard
def test_tensorboard_reads_back_every_field(data_folder: Path, tmp_path: Path) -> None:
    from tensorboard.plugins.hparams import metadata

    done = train(data_folder, tmp_path, *GRU, "--tracker", "tensorboard")
    assert done.exit_code == 0, done.output
    assert f"tensorboard --logdir {tmp_path}" in done.output
    folder = tmp_path / "echo" / "gru" / "s0"
    assert_tensorboard_was_told(folder)
    read = events(folder)
    (shown,) = read.Images("prediction")
    (drawn,) = read.Images("curves")
    assert shown.encoded_image_string.startswith(b"\x89PNG")
    assert min(drawn.width, drawn.height) > 300
    (text,) = read.Tensors("config/text_summary")
    config = text.tensor_proto.string_val[0].decode()
    assert json.loads(config.removeprefix("```json\n").removesuffix("```"))["arch"] == "gru"
    kept = read.PluginTagToContent("hparams")
    began = metadata.parse_session_start_info_plugin_data(kept[metadata.SESSION_START_INFO_TAG])
    assert set(began.hparams) == PARAMETERS
    assert began.hparams["hyper.hidden"].number_value == 6
    assert began.hparams["arch"].string_value == "gru"
    # Without a list of columns TensorBoard shows those of all runs, of whatever architecture.
    assert set(kept) == {metadata.SESSION_START_INFO_TAG, metadata.SESSION_END_INFO_TAG}


@needs_tensorboard
def test_tensorboard_is_told_a_resumed_run_whole_and_a_finished_one_again(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = (*GRU, "--tracker", "tensorboard", "--no-pictures")
    folder = tmp_path / "echo" / "gru" / "s0"
    with monkeypatch.context() as patch:
        interrupted_at(2, patch)
        assert train(data_folder, tmp_path, *asked).exit_code == 130
    assert [event.step for event in events(folder).Scalars("loss/validation")] == [1, 2]
    assert train(data_folder, tmp_path, *asked).exit_code == 0
    assert_tensorboard_was_told(folder)
    assert train(data_folder, tmp_path, *asked).exit_code == 0  # nothing is trained
    assert_tensorboard_was_told(folder)
    assert len(list(folder.glob("events.out.tfevents.*"))) == 1


@needs_tensorboard
def test_a_tracker_changes_nothing_of_what_is_trained(data_folder: Path, tmp_path: Path) -> None:
    assert train(data_folder, tmp_path / "told", *GRU, "--tracker", "tensorboard").exit_code == 0
    assert train(data_folder, tmp_path / "plain", *GRU).exit_code == 0
    weights = [(tmp_path / side / "echo/gru/s0" / BEST).read_bytes() for side in ("told", "plain")]
    assert weights[0] == weights[1]


# --- MLflow -------------------------------------------------------------------------------------


@pytest.fixture
def fresh_mlflow(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """MLflow as a new process finds it, whatever the test before has set."""
    import mlflow

    for name in [name for name in os.environ if name.startswith("MLFLOW_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("MLFLOW_DISABLE_TELEMETRY", "true")
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    yield
    mlflow.set_tracking_uri(None)


def told_to_mlflow(out: Path, *asked: object, store: str | None = None) -> Result:
    import mlflow

    mlflow.set_tracking_uri(None)
    if store:
        os.environ["MLFLOW_TRACKING_URI"] = store
    return train(*asked[:1], out, *asked[1:], "--tracker", "mlflow")


@needs_mlflow
def test_mlflow_reads_back_every_field_and_a_resumed_run_is_one_run(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh_mlflow: None
) -> None:
    from mlflow import MlflowClient

    folder = tmp_path / "echo" / "gru" / "s0"
    client = MlflowClient(f"sqlite:///{tmp_path / 'mlflow.db'}")

    def the_run():
        experiment = client.get_experiment_by_name("wakedeploy")
        (run,) = client.search_runs([experiment.experiment_id])
        return run

    with monkeypatch.context() as patch:
        interrupted_at(2, patch)
        assert told_to_mlflow(tmp_path, data_folder, *GRU).exit_code == 130
    assert the_run().info.status == "KILLED"
    for _ in range(2):  # resumed; then finished before
        done = told_to_mlflow(tmp_path, data_folder, *GRU)
        assert done.exit_code == 0, done.output
        run = the_run()
        assert run.info.status == "FINISHED"
        assert set(run.data.params) == PARAMETERS
        assert run.data.params["hyper.hidden"] == "6"
        assert set(run.data.metrics) == EPOCH_FIELDS | FINAL_FIELDS
        for name, values in expected(folder).items():
            told = client.get_metric_history(run.info.run_id, name)
            assert [metric.step for metric in told] == [1, 2, 3, 4]
            assert [metric.value for metric in told] == pytest.approx(values)
        (rmse,) = client.get_metric_history(run.info.run_id, "test/rmse/f_n")
        metrics = load_run(folder).metrics
        assert (rmse.step, rmse.value) == (metrics.best_epoch, metrics.test.rmse["f_n"])
        kept = {file.path for file in client.list_artifacts(run.info.run_id)}
        assert kept == {"config.json", "curves.png", "prediction.png"}
    assert "look with `mlflow ui --backend-store-uri sqlite:///" in done.output
    assert run.info.run_name == "gru s0 on echo"
    assert (tmp_path / "mlflow-artifacts" / run.info.run_id).is_dir()
    assert finished_runs(tmp_path) == [folder]  # what MLflow keeps is no run of ours
    assert told_to_mlflow(tmp_path, data_folder, *GRU, "--fresh").exit_code == 0
    assert len(client.search_runs([run.info.experiment_id])) == 2


@needs_mlflow
def test_mlflow_goes_where_its_environment_says(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh_mlflow: None
) -> None:
    from mlflow import MlflowClient

    store = f"sqlite:///{tmp_path / 'shared.db'}"
    monkeypatch.chdir(tmp_path)  # MLflow's own place for artefacts
    monkeypatch.setenv("MLFLOW_EXPERIMENT_NAME", "thesis")
    asked = ("--arch", "agile-mlp", "--epochs", 1, "--no-pictures")
    done = told_to_mlflow(tmp_path / "runs", data_folder, *asked, store=store)
    assert done.exit_code == 0, done.output
    assert f"MLflow: runs go into {store}, experiment thesis." in done.output
    client = MlflowClient(store)
    (run,) = client.search_runs([client.get_experiment_by_name("thesis").experiment_id])
    assert run.data.metrics["test/rmse/f_n"] > 0
    assert not (tmp_path / "runs" / "mlflow.db").exists()


@needs_mlflow
def test_a_store_that_cannot_be_used_is_one_sentence_without_its_password(
    data_folder: Path, tmp_path: Path, fresh_mlflow: None
) -> None:
    store = "http://me:secret@127.0.0.1:9"
    done = told_to_mlflow(tmp_path / "runs", data_folder, *GRU, store=store)
    assert done.exit_code == 2
    assert "the store http://127.0.0.1:9 cannot be used" in done.output
    assert "secret" not in done.output
    assert not (tmp_path / "runs").exists()
