"""Tables are whole in a pipe, JSON holds no NaN."""

import json
import tempfile
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner
from every_command import EVERY
from hypothesis import given
from hypothesis import strategies as st

from wakedeploy.cli import main
from wakedeploy.cli.output import Written, print_table, write_json


def test_a_table_in_a_pipe_is_never_cut(capsys: pytest.CaptureFixture[str]) -> None:
    long = "x" * 300
    print_table("a [title]", ["name", "value"], [[long, "1.0"], ["[red]b[/red]", "-2"]])
    printed = capsys.readouterr().out
    assert long in printed
    assert "a [title]" in printed
    assert "[red]b[/red]" in printed


def test_a_name_that_no_terminal_shows_shifts_and_steers_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A file's name heads a column; where the locale is C it may have bytes that are no letters."""
    print_table("of \x1b[2J", ["", "fl\udcc3\udca4.mcap", "\x1b[2J.mcap"], [["Rate", "32", "32"]])
    title, *lines = capsys.readouterr().out.splitlines()
    assert title == r"of \x1b[2J"
    assert len({len(line) for line in lines}) == 1
    assert r" fl\udcc3\udca4.mcap " in lines[1]
    assert r" \x1b[2J.mcap " in lines[1]


@pytest.mark.whole
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


@pytest.mark.parametrize(
    ("name", "told"),
    [("lat.txt", "as lat.html."), ("lat", "as lat.html."), ("page.HTML", ""), (".html", "")],
)
def test_a_page_has_the_name_of_one(name: str, told: str) -> None:
    (report,) = [p for p in EVERY["bench", "latency"].params if "--report" in p.opts]
    if not told:
        assert report.type.convert(name, report, None) == Path(name)
        return
    with pytest.raises(click.BadParameter, match=r"give a name that ends in \.html, as") as refused:
        report.type.convert(name, report, None)
    assert refused.value.message.endswith(told)


@pytest.mark.parametrize("named", ["--json", "--report", "--write-reference", "--write-input"])
def test_where_a_command_writes_at_its_end_is_looked_at_before_it_begins(named: str) -> None:
    """A flight or a fit of minutes does not end at a folder that nobody may write to."""
    options = [
        (" ".join(path), option)
        for path, command in EVERY.items()
        for option in command.params
        if named in option.opts
    ]
    if named == "--json":
        written = ("export", "--out"), ("calibrate latency", "--out")
        options += [
            (f"{name} {path}", option)
            for path, name in written
            for option in EVERY[tuple(path.split())].params
            if name in option.opts
        ]
    assert options
    assert [name for name, option in options if not isinstance(option.type, Written)] == []


@pytest.mark.parametrize(
    ("words", "read"),
    [
        ("gap simulate --system s.py --measured log.csv --json log.csv", "'--measured'"),
        ("gap simulate --system s.py --measured a.csv log.csv --json ./log.csv", "'--measured'"),
        ("gap check s.py --measured log.csv --json s.py", "'[SYSTEM_FILE]'"),
        (
            "gap plan --system s.py --measured log.csv --class x --write-input log.csv",
            "'--measured'",
        ),
        ("gap plan --rig rig.toml --write-reference rig.toml", "'--rig'"),
        ("check gru.onnx --json gru.onnx", "'FILE'"),
        ("log show flight.mcap --json link.mcap", "'FILES...'"),
    ],
)
def test_no_command_writes_over_what_it_reads(
    words: str, read: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one log of an hour's flight became a table of the next input."""
    monkeypatch.chdir(tmp_path)
    names = ("a.csv", "log.csv", "s.py", "rig.toml", "gru.onnx", "flight.mcap")
    for name in names:
        Path(name).write_text(f"what {name} holds")
    Path("link.mcap").symlink_to("flight.mcap")
    told = CliRunner().invoke(main, words.split())
    assert told.exit_code == 2
    assert f"{read} reads this file" in " ".join(told.output.split())
    assert [Path(name).read_text() for name in names] == [f"what {name} holds" for name in names]


def test_a_rig_file_may_be_written_in_its_place() -> None:
    (out,) = [p for p in EVERY["calibrate", "latency"].params if "--out" in p.opts]
    assert isinstance(out.type, Written)
    assert out.type.may_replace
