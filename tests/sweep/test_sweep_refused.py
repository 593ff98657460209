"""What a sweep refuses: one sentence, and nothing of anybody's is touched."""

import errno
import fcntl
from collections.abc import Callable
from pathlib import Path

import pytest

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.sweep import jobs
from wakedeploy.sweep.plan import Choice


def test_two_sweeps_do_not_share_a_folder_at_once(
    small: Path, tmp_path: Path, wakedeploy: Callable
) -> None:
    out = tmp_path / "out"
    asked = ("sweep", "--data", small, "--arch", "agile-mlp", "--epochs", 1, "--out", out)
    assert wakedeploy(*asked).exit_code == 0
    with (out / ".sweep.lock").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        told = wakedeploy(*asked)
    assert told.exit_code == 2
    assert "Another sweep is at work" in told.output


def test_a_full_disk_says_nothing_about_a_job(make_small, monkeypatch, tmp_path):
    """The sweep ends, and the same command does the job; a row would be its last word."""

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device", "best.safetensors")

    monkeypatch.setattr(jobs, "train", full)
    data = make_small()
    choice = Choice("agile-mlp", seed=0, lead_s=0.0, settings={}, hyper={})
    (job,) = jobs.train_jobs("small", tmp_path, data, [choice], device="cpu")
    with pytest.raises(OSError, match="No space left"):
        jobs.do(job, data, runs=tmp_path / "runs")
    assert jobs.do(job, data).row["state"] == "failed"  # a cluster's worker has a disk of its own


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--arch", "cnn"], "--arch: 'cnn' is no architecture"),
        (["--lead", "soon"], "--lead: 'soon' is not a number"),
        (["--lead", "-1"], "--lead: lead.0 = -1"),
        (["--epochs", "0"], "--epochs: epochs = 0 has to be a whole number"),
        (["--learning-rate", "1000"], "--learning-rate: learning_rate = 1000 has to be a number"),
        (["--learning-rate", "0"], "--learning-rate: learning_rate = 0 has to be a number from"),
        (["--learning-rate", "NaN"], "--learning-rate: learning_rate = nan has to be a number"),
        (["--hyper", "gru.hidden"], "write ARCH.NAME=VALUE"),
        (["--hyper", "gru.hiden=3"], "--hyper gru.hiden: gru has no hyper-parameter"),
        (["--arch", "gru", "--hyper", "gru.hidden=220"], "budget is fewer than 100,000"),
        (["--arch", "gru", "--hyper", "gru.hidden=8,220"], "gru with hidden = 220 would have"),
        (["--arch", "gru", "--hyper", "esn.leak=0.1"], "'esn' is not among the architectures"),
        (["--lead", "5"], "The 'train' split of this toy set has no episode longer"),
        (["--device", "cuda"], "torch sees no CUDA device"),
        (["--scheduler", "tcp://x:1", "--workers", "2"], "--workers is for this machine"),
    ],
)
def test_what_cannot_be_used_is_one_sentence_and_leaves_no_trace(
    arguments: list[str], says: str, small: Path, tmp_path: Path, wakedeploy: Callable,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    told = wakedeploy("sweep", "--data", small, "--out", tmp_path / "out", *arguments)
    assert told.exit_code == 2, told.output
    assert says in told.stderr
    assert len(told.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_set_without_validation_is_refused(
    unvalidated: EpisodeSet, small: Path, tmp_path: Path, wakedeploy: Callable
) -> None:
    unvalidated.write(small)
    told = wakedeploy("sweep", "--data", small, "--out", tmp_path / "out")
    assert told.exit_code == 2
    assert "toy set has no episode in its 'validation' split; assign one" in told.stderr


@pytest.mark.parametrize("mark", [None, "{", '{"wakedeploy_sweep": 99}'])
def test_a_folder_of_something_else_is_left_alone(
    mark: str | None, small: Path, tmp_path: Path, wakedeploy: Callable
) -> None:
    out = tmp_path / "thesis"
    out.mkdir()
    (out / "chapter.txt").write_text("Once")
    if mark:
        (out / "sweep.json").write_text(mark)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    told = wakedeploy("sweep", "--data", small, "--out", out)
    assert told.exit_code == 2
    assert "give" in told.stderr
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
