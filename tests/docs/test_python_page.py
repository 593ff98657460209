"""The Python of two how-tos runs in its order, small; each block in the names of the last."""

import re
from pathlib import Path

import pytest
from shell_lines import ROOT

HOW_TO = ROOT / "docs" / "how-to"
BLOCK = re.compile(
    r"(?P<slow><!-- slow -->\n)?^```python\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL
)
# What the small run changes: sizes only.
SMALLER = (
    (r"minutes=\d+", "minutes=2"),
    (r"epochs=\d+", "epochs=1"),
    (r"seconds=\d+", "seconds=6"),
    (r"flights=24", "flights=2, seconds=6"),
)


def small(body: str) -> str:
    for what, instead in SMALLER:
        body = re.sub(what, instead, body)
    return body


def executed(page: Path, *, slow: bool) -> dict[str, object]:
    """The names that a page's blocks leave; the slow ones run where they are asked for."""
    names: dict[str, object] = {}
    text = page.read_text("utf-8")
    for block in BLOCK.finditer(text):
        if block["slow"] and not slow:
            continue
        line = text[: block.start("body")].count("\n")
        code = compile("\n" * line + small(block["body"]), str(page), "exec")
        exec(code, names)
    return names


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.whole
def test_the_examples_run_in_their_order(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pandas", reason="the extra notebook is not installed")
    names = executed(HOW_TO / "python.md", slow=False)
    assert names["forces"].shape == (len(names["episode"]), 1)
    assert names["frame"].index.name == "t_s"
    assert "no-such.onnx" in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_arrays_of_ones_own_become_a_set_that_trains(here: Path) -> None:
    names = executed(HOW_TO / "own-data.md", slow=False)
    assert names["own"].domain == "bench"
    assert (here / "sets" / "own" / "dataset.json").is_file()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_slow_examples_run_after_the_others(here: Path) -> None:
    pytest.importorskip("pandas", reason="the extra notebook is not installed")
    gap = executed(HOW_TO / "python.md", slow=True)["gap"]
    assert gap.verdict in ("named", "class", "unknown", "none")
