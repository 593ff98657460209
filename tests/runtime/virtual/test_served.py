"""A virtual gantry at paths that stay: it is opened there, alone there, and gone afterwards."""

import subprocess
import sys
from pathlib import Path

import pytest

from runtime.io.link import Link
from runtime.io.protocol import Board
from runtime.io.range_source import SocketRangeSource, wait_for_first
from runtime.virtual.served import served
from wakedeploy.core.errors import UnusableInput
from wakedeploy.rig.file import default_rig


@pytest.mark.whole
def test_port_and_sensor_answer_at_their_paths_again_and_again(tmp_path: Path) -> None:
    deep = tmp_path / ("deep" * 30)  # the path of a socket itself would be too long there
    with served(default_rig(), deep):
        for _ in range(2):
            with Link(str(deep / "uno")) as link:
                assert link.handshake().board == Board.VIRTUAL
            ranges = SocketRangeSource(deep / "range.sock")
            assert abs(wait_for_first(ranges).range_m) < 0.05
            ranges.close()
    assert [path.name for path in deep.iterdir()] == [".virtual-gantry.lock"]


@pytest.mark.whole
def test_links_of_a_killed_process_are_replaced_and_nothing_else_is(tmp_path: Path) -> None:
    (tmp_path / "uno").symlink_to("/dev/pts/no-more")
    with served(default_rig(), tmp_path), Link(str(tmp_path / "uno")) as link:
        assert link.handshake().board == Board.VIRTUAL
        with (
            pytest.raises(UnusableInput, match="Another virtual gantry is at work"),
            served(default_rig(), tmp_path),
        ):
            pass
    (tmp_path / "range.sock").write_text("mine")
    with pytest.raises(UnusableInput, match="is no link"), served(default_rig(), tmp_path):
        pass
    assert (tmp_path / "range.sock").read_text() == "mine"
    assert not (tmp_path / "uno").exists()


def test_who_starts_the_plants_process_by_hand_is_told_what_serves_it() -> None:
    """Without a line that asks for something there is no traceback either."""
    started = subprocess.run(
        [sys.executable, "-m", "runtime.virtual"], stdin=subprocess.DEVNULL,
        capture_output=True, text=True,
    )  # fmt: skip
    assert started.returncode != 0
    assert "`wakedeploy rig virtual`" in started.stderr
    assert "Traceback" not in started.stderr
