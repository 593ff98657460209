"""The two terminals of "At a port, without a rig": one serves, the other flies, in real time."""

import contextlib
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from shell_lines import ROOT, lines

from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import read_rig

PAGE = ROOT / "docs" / "how-to" / "fly.md"
HEADING = "## At a port, without a rig"


def command(text: str) -> list[str]:
    """A line of the page as a process has it, its flight as short as it may be."""
    words = shlex.split(text.replace("--seconds 20", "--seconds 6"))[1:]
    return [sys.executable, "-c", "from wakedeploy.cli import main; main()", *words]


@contextlib.contextmanager
def first_terminal(line: str, folder: Path) -> Iterator[str]:
    """What the gantry says once it answers; Ctrl-C at the end."""
    terminal = subprocess.Popen(command(line), cwd=folder, stdout=subprocess.PIPE, text=True)
    with terminal:
        assert terminal.stdout is not None
        try:
            yield terminal.stdout.readline()
        finally:
            terminal.send_signal(signal.SIGINT)
    assert terminal.returncode == 130


@pytest.mark.wallclock
def test_both_terminals_do_as_the_page_says(tmp_path: Path) -> None:
    text = PAGE.read_text("utf-8")
    begin = text[: text.index(HEADING)].count("\n")
    end = begin + text[text.index(HEADING) :].partition("\n## ")[0].count("\n")
    init, serve, *others = [line.text for line in lines(PAGE) if begin < line.number <= end]
    assert len(others) == 3
    subprocess.run(command(init), cwd=tmp_path, check=True)
    with first_terminal(serve, tmp_path) as said:
        assert said.strip().endswith("--port desk/uno --range-socket desk/range.sock")
        for line in others:
            subprocess.run(command(line), cwd=tmp_path, check=True)
    log = read_run_log(tmp_path / "desk.mcap")
    assert log.flying.sum() == 6 * 32
    assert "latency.round_trip_s" in read_rig(tmp_path / "desk.toml").calibration
    assert not (tmp_path / "desk" / "uno").is_symlink()
