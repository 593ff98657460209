"""`train` after Ctrl-C: whether the same command goes on or begins anew."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from trainers.training.runs import LAST, METRICS, run_folder
from wakedeploy.cli import main


def interrupted(monkeypatch: pytest.MonkeyPatch, out: Path, *more: str) -> str:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("wakedeploy.api.training.train", stop)
    line = ["train", "--data", "set", "--arch", "gru", "--out", str(out), *more]
    told = CliRunner().invoke(main, line)
    assert told.exit_code == 130
    assert told.stderr.endswith("Interrupted.\n")
    return told.stderr


def leave(out: Path, arch: str, name: str) -> None:
    run = run_folder(out, SimpleNamespace(domain="gantry", arch=arch, seed=0))
    run.mkdir(parents=True)
    (run / name).write_text("")


def test_before_the_first_epoch_it_begins_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave(tmp_path / "runs", "mamba", LAST)  # of another architecture
    assert "the same command begins anew" in interrupted(monkeypatch, tmp_path / "runs")


@pytest.mark.parametrize("name", [LAST, METRICS])
def test_what_is_finished_is_kept_and_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    leave(tmp_path / "runs", "gru", name)
    assert "the same command goes on from there" in interrupted(monkeypatch, tmp_path / "runs")
    said = interrupted(monkeypatch, tmp_path / "runs", "--fresh")
    assert "the same command goes on without --fresh" in said
