"""Plans and results that somebody forged: one sentence that names the file."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.sweep.plan import read_plan
from wakedeploy.sweep.results import Results

DONE = {
    "identity": "a" * 64, "kind": "train", "state": "done", "data": "x", "reason": None,
    "seconds": 1.0, "arch": "gru", "preset": "reference", "lead_s": 0.0, "settings": {},
    "hyper": {}, "trainable": 9, "device": "cpu", "commit": "",
    "test": {"rmse": {"f_n": 0.1}, "r2": {"f_n": None}},
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f"data = '{'x' * 5000}'", "is no folder with an episode set"),
        ("data = 'x\\u0000'".replace("'", '"'), "is no folder with an episode set"),
        (f"data = {'[' * 100_000}", "not valid TOML: nested too deeply"),
        (f"seeds = {'1' * 5000}", "not valid TOML"),
    ],
)
def test_a_plan_that_no_disk_can_hold_is_refused(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(UnusableInput, match=f"plan.toml.*{told}"):
        read_plan(tmp_path / "plan.toml")


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"seconds": "long"}, "seconds = 'long'"),
        ({"kind": "fly"}, "kind = 'fly'"),
        ({"test": {"rmse": {"f_n": 0.1}}}, "test.r2 is missing"),
        ({"hyper": [1]}, "hyper"),
        ({"data": None}, "data"),
        ({"kind": "generate"}, "data_sha256 is missing"),
        ({"state": "failed", "reason": 7}, "reason = 7"),
    ],
)
def test_a_row_that_no_job_has_left_is_named(tmp_path: Path, changed: dict, told: str) -> None:
    lines = [json.dumps(DONE | {"identity": "b" * 64}), json.dumps(DONE | changed)]
    (tmp_path / "results.jsonl").write_text("\n".join(lines) + "\n")
    with pytest.raises(UnusableInput, match=rf"results\.jsonl: in the row of job a{{16}} .*{told}"):
        Results(tmp_path).require_sound()


def test_rows_are_told_with_letters_that_a_file_can_hold(tmp_path: Path) -> None:
    (tmp_path / "results.jsonl").write_text(json.dumps(DONE | {"host": "\ud800", "\x1b": 1}) + "\n")
    results = Results(tmp_path)
    results.require_sound()
    results.write_table()
    assert r"\ud800" in (tmp_path / "results.csv").read_text("utf-8")


def test_a_sweep_goes_on_with_no_row_of_another_make(
    small: Path, tmp_path: Path, wakedeploy: Callable
) -> None:
    out = tmp_path / "out"
    asked = ("sweep", "--data", small, "--arch", "agile-mlp", "--epochs", 1, "--out", out)
    assert wakedeploy(*asked).exit_code == 0
    row = json.loads((out / "results.jsonl").read_text())
    (out / "results.jsonl").write_text(json.dumps(row | {"test": {"rmse": {}}}) + "\n")
    told = wakedeploy(*asked)
    assert told.exit_code == 2, told.output
    assert "results.jsonl: in the row of job" in told.stderr
