"""The tutorials as their readers have them: every line as it stands, and as a notebook."""

import importlib.util
import os
import re
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest
from shell_lines import ROOT

from benchmarks.tutorials import FOLDER, obeyed

PAGES = sorted(FOLDER.glob("*.md"))
MADE = {"first-predictor": "gru.onnx", "own-system": "gap/correction.toml"}  # by the notebooks


def notebooks() -> ModuleType:
    """The site's own extension, which is no module of a package."""
    path = ROOT / "docs" / "site" / "notebooks.py"
    spec = importlib.util.spec_from_file_location("notebooks", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def words(printed: str) -> list[str]:
    """What a reader compares: the words, without numbers, days and the lines of tables."""
    return re.sub(r"[\d.,:+-]+(?:e[+-]?\d+)?(?:T[\d:.+]+)?|[^\w\s]", " ", printed).split()


@pytest.mark.slow  # each trains, flies in real time or searches for minutes
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_line_works_as_it_stands_and_prints_what_the_page_shows(
    page: Path, tmp_path: Path
) -> None:
    shown = re.findall(r"<!-- output -->\n```text\n(.*?)^```$", page.read_text(), re.M | re.S)
    printed = [block["printed"] for block in obeyed(page, tmp_path) if "printed" in block]
    assert [words(one) for one in printed] == [words(one) for one in shown]
    goals = {"own-system": named_the_friction, "mujoco-arm": corrected_the_delay}
    goals.get(page.stem, flew_better)("".join(printed))


def flew_better(printed: str) -> None:
    """The predictor gains more than half of the error."""
    both = re.findall(r"Tracking RMSE  .*?([\d.]+) mm.*?([\d.]+) mm", printed)
    alone, fed_forward = both[-1]
    assert float(fed_forward) < 0.4 * float(alone)


def named_the_friction(printed: str) -> None:
    """The friction that the log was made with is in the interval, and a new log agrees."""
    low, high = map(float, re.findall(r"force [\d.]+ N \(([\d.]+) to ([\d.]+)\)", printed)[0])
    assert low < 1.2 < high
    assert high - low < 0.5 * 1.2  # and says something of it
    without, corrected = map(float, re.findall(r"second │.*?│ +([\d.]+) │ +([\d.]+)", printed)[0])
    assert corrected < 0.1 * without


def corrected_the_delay(printed: str) -> None:
    """The delay that the log was made with is in the interval; MuJoCo replays a new log with it."""
    low, high = map(float, re.findall(r"delay [\d.]+ ms \(([\d.]+) to ([\d.]+)\)", printed)[0])
    assert low < 30.0 < high
    assert high - low < 0.9 * 30.0  # and says something of it
    before, after = map(float, re.findall(r"rms error ([\d.]+) mrad", printed))
    assert after < 0.2 * before


@pytest.mark.slow
@pytest.mark.parametrize("name", notebooks().TUTORIALS)
def test_the_notebook_runs_as_it_is(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nbformat = pytest.importorskip("nbformat", reason="the extra docs is not installed")
    client = pytest.importorskip("nbclient", reason="nbclient is not installed")
    book = nbformat.reads(notebooks().notebook(FOLDER / f"{name}.md"), as_version=4)
    assert all(not cell.get("outputs") for cell in book.cells)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    client.NotebookClient(book, timeout=300, kernel_name="python3").execute()
    drawn = [out for cell in book.cells for out in cell.get("outputs", ()) if "data" in out]
    assert any("image/png" in out["data"] for out in drawn)
    assert (tmp_path / MADE[name]).is_file()
    shutil.rmtree(tmp_path / "sets", ignore_errors=True)
