"""Where a fit computes: chosen from what torch sees and from the work, and told afterwards."""

import json
from pathlib import Path

import pytest
import torch

from trainers.build import ARCHITECTURES
from trainers.training.device import CUDA_PAYS_FROM, choose_device, one_thread, work_of_update
from trainers.training.fit import FitSettings
from trainers.training.runs import METRICS, new_predictor, read_metrics
from trainers.training.trainer import configure, train
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput

LARGE = FitSettings(batch=100_000, lanes=512, chunk_steps=512)


@pytest.fixture
def cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)


@pytest.mark.usefixtures("cuda")
@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_the_reference_shapes_stay_on_the_cpu_where_there_is_a_gpu(
    arch: str, echo: EpisodeSet
) -> None:
    predictor = new_predictor(configure(echo, arch, seed=0, lead_s=0.0))
    assert choose_device("auto", predictor, FitSettings()) == "cpu"
    assert choose_device("cuda", predictor, FitSettings()) == "cuda"


@pytest.mark.usefixtures("cuda")
def test_large_work_goes_to_the_gpu(echo: EpisodeSet) -> None:
    for arch in ("gru", "history-mlp"):
        predictor = new_predictor(configure(echo, arch, seed=0, lead_s=0.0))
        assert work_of_update(predictor, LARGE) > CUDA_PAYS_FROM
        assert choose_device("auto", predictor, LARGE) == "cuda"
        assert choose_device("cpu", predictor, LARGE) == "cpu"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no CUDA device here")
@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_on_a_gpu_training_comes_to_what_it_comes_to_on_the_cpu(
    arch: str, echo: EpisodeSet, tmp_path: Path
) -> None:
    config = configure(echo, arch, seed=0, lead_s=0.0, settings=FitSettings(epochs=3))
    here, there = (
        train(config, echo, tmp_path / device, device=device) for device in ("cpu", "cuda")
    )
    assert (here.metrics.device, there.metrics.device) == ("cpu", "cuda")
    assert there.metrics.test.rmse["f_n"] == pytest.approx(here.metrics.test.rmse["f_n"], rel=0.05)


def test_without_a_gpu_everything_is_done_on_the_cpu_and_says_so(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    config = configure(echo, "agile-mlp", seed=0, lead_s=0.0, settings=FitSettings(epochs=1))
    with pytest.raises(UnusableInput, match="torch sees no CUDA device"):
        train(config, echo, tmp_path, device="cuda")
    assert not list(tmp_path.iterdir())
    with pytest.raises(UnusableInput, match="no device 'tpu'; choose auto, cpu, cuda"):
        train(config, echo, tmp_path, device="tpu")
    run = train(config, echo, tmp_path, device="auto")
    assert run.metrics.device == "cpu"


@pytest.mark.parametrize("device", [Path("cpu"), torch.device("cpu"), 3])
def test_a_device_that_is_no_text_is_told_by_its_kind(device: object, echo: EpisodeSet) -> None:
    predictor = new_predictor(configure(echo, "gru", seed=0, lead_s=0.0))
    kind = type(device).__name__
    with pytest.raises(UnusableInput, match=f"^device is a {kind}; give text: auto, cpu, cuda"):
        choose_device(device, predictor, FitSettings())


def test_a_run_of_before_there_was_a_choice_is_read(echo: EpisodeSet, tmp_path: Path) -> None:
    config = configure(echo, "agile-mlp", seed=0, lead_s=0.0, settings=FitSettings(epochs=1))
    path = train(config, echo, tmp_path).folder / METRICS
    told = json.loads(path.read_text())
    assert told.pop("device") == "cpu"
    path.write_text(json.dumps(told))
    assert read_metrics(path.parent).device == "cpu"


def test_one_thread_is_lent_and_given_back() -> None:
    before = torch.get_num_threads()
    with one_thread():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before
