"""`python -m benchmarks.hidden_effects`: what it refuses, and tables from lines that are there."""

import json
from pathlib import Path

import pytest

from benchmarks.hidden_effects.__main__ import main
from benchmarks.hidden_effects.cases import all_cases
from benchmarks.hidden_effects.run import LINES
from wakedeploy.core.errors import UnusableInput


def test_tables_are_made_from_the_lines_that_are_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = next(c for c in all_cases() if c.kind == "none")
    line = {"name": case.name, "kind": "none", "plant": case.plant, "seconds": 20.0, "commit": "c"}
    line |= {"verdict": "none", "named": [], "class": [], "hidden": [], "right": True}
    line |= {"partial": False, "named_intervals": [], "closed": None}
    (tmp_path / LINES).write_text(json.dumps(line) + "\n")
    main(["--table-only", "--out", str(tmp_path)])
    assert "0 % [0, 79]" in capsys.readouterr().out
    page = tmp_path / "benchmark.md"
    assert page.read_text().startswith("# The gap workflow")
    assert page.with_suffix(".png").stat().st_size > 1000
    assert "[cases.jsonl](cases.jsonl)" in page.read_text()
    assert json.loads((tmp_path / "summary.json").read_text())["cases"] == {"none": 1}


def test_impossible_wishes_are_refused(tmp_path: Path) -> None:
    for given in (["--short", "--full"], ["--only", "nonsense"], ["--table-only"]):
        with pytest.raises(UnusableInput):
            main([*given, "--out", str(tmp_path)])
