"""The examples of docs/how-to/own-logs.md, on a log with the columns that its file names."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from shell_lines import ROOT, fences

from wakedeploy.cli import main
from wakedeploy.domains.tables.columns import parse_columns

PAGE = ROOT / "docs" / "how-to" / "own-logs.md"


def test_the_page_runs_on_a_log_of_its_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (columns,) = [body for _, file, body, _ in fences(PAGE) if file == "columns.toml"]
    Path("columns.toml").write_text(columns, "utf-8")
    t = np.arange(640) / 32
    table = np.column_stack([t, 0.2 + 0.1 * np.sin(t), 0.1 * np.cos(t), 1500 + t, -np.sin(t)])
    names = "t_s,z_est_m,x_m,source_cmd_us,true_wake_force_n"
    np.savetxt("axis.csv", table, delimiter=",", header=names, comments="")
    words = [
        "data",
        "import",
        "table",
        "axis.csv",
        "--columns",
        "columns.toml",
        "--out",
        "sets/axis",
    ]
    told = CliRunner().invoke(main, words)
    assert told.exit_code == 0, told.output
    (example,) = [body for word, _, body, _ in fences(PAGE) if word == "python"]
    exec(compile(example, str(PAGE), "exec"), {})
    rate_hz, height_mm = capsys.readouterr().out.split()
    assert (float(rate_hz), float(height_mm)) == (pytest.approx(32), pytest.approx(300, abs=1))


def test_the_tables_that_the_page_shows_are_read_and_every_entry_is_in_it() -> None:
    shown = [body for word, file, body, _ in fences(PAGE) if word == "toml"]
    whole, *fragments = shown
    read = parse_columns(whole + "".join(fragments))
    assert read.columns["yaw_rad"].angle == "yaw"
    assert read.resample is not None
    assert read.resample.effective_cutoff_hz == 20.0
    text = PAGE.read_text("utf-8")
    entries = [*type(read.time).model_fields, *type(read.csv).model_fields]
    entries += [*type(next(iter(read.columns.values()))).model_fields]
    assert [e for e in entries if e not in text and e != "delimiter"] == []
