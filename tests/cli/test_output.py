"""Tables are whole in a pipe, JSON holds no NaN, progress is a line a minute without a terminal."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wakedeploy.cli.output import print_table, progress, write_json


def test_a_table_in_a_pipe_is_never_cut(capsys: pytest.CaptureFixture[str]) -> None:
    long = "x" * 300
    print_table("a [title]", ["name", "value"], [[long, "1.0"], ["[red]b[/red]", "-2"]])
    printed = capsys.readouterr().out
    assert long in printed
    assert "a [title]" in printed
    assert "[red]b[/red]" in printed


def test_a_log_is_told_each_minute_how_long_is_left(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr("wakedeploy.cli.output.time.monotonic", lambda: now_s[0])
    with progress("Training", 10, done=2) as bar:
        for done in range(3, 11):
            now_s[0] += 45.0
            bar.update(done, 10)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines()[0] == "Training: 40 %, about 4 min left"  # 6 of 45 s
    assert len(captured.err.splitlines()) == 4


def test_progress_of_less_than_a_minute_is_silent_in_a_pipe(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress("Training", 3) as bar:
        bar.advance()
        bar.update(2, 5)
    captured = capsys.readouterr()
    assert captured.out + captured.err == ""


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text() | st.integers(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
        max_leaves=8,
    )
)
def test_any_result_is_valid_json(result: object) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.json"
        write_json(path, {"result": result})
        text = path.read_text()
    json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


def test_numpy_and_missing_numbers_are_written(tmp_path: Path) -> None:
    result = {"a": np.float32(0.5), "b": np.arange(3), "c": float("nan"), "d": (np.inf, 1)}
    write_json(tmp_path / "x.json", result)
    written = json.loads((tmp_path / "x.json").read_text())
    assert written == {"a": 0.5, "b": [0, 1, 2], "c": None, "d": [None, 1]}
