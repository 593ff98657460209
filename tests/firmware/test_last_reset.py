"""What reset the board reaches the person and the log: the sketch's session behind a real port."""

import needs
import pytest
from decisions_library import Board
from far_end import FarEnd

from runtime.io.board import met_board
from runtime.io.link import Link
from runtime.io.protocol import Fault, encode_frame
from runtime.request import RunRequest
from runtime.run import fly
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import default_rig

pytestmark = needs.compiler

RIG = default_rig().changed(disturbance={"rest_s": 0.2})


@pytest.fixture
def port_of():
    opened = []

    def port(board):
        opened.append(FarEnd(lambda data: b"".join(map(encode_frame, board.hear(data)))))
        return opened[-1].name

    yield port
    for end in opened:
        end.close()


@pytest.mark.parametrize(
    ("faults", "sentence"),
    [
        (Fault.NONE, None),
        (Fault.WATCHDOG, "The board's last reset: watchdog (its program hung)."),
        (Fault.BROWNOUT, "The board's last reset: brownout (its supply sagged)."),
        (
            Fault.WATCHDOG | Fault.BROWNOUT,
            "The board's last reset: watchdog (its program hung) and brownout (its supply sagged).",
        ),
    ],
)
def test_a_reset_is_told_in_one_sentence_until_the_board_is_armed(port_of, faults, sentence):
    with Link(port_of(Board(reset_faults=faults))) as link:
        for _ in range(2):  # asking takes nothing away
            assert met_board(link, may_be_virtual=False).warning == sentence


@pytest.mark.wallclock
def test_a_run_tells_it_and_its_log_keeps_it(port_of, tmp_path):
    said, log = [], tmp_path / "f.mcap"
    port = port_of(Board(reset_faults=Fault.WATCHDOG))
    with VirtualGantryProcess(RIG, seed=0) as plant:  # its sufferer stays on the stop
        request = RunRequest(RIG, 6.0, port=port, range_socket=plant.range_socket, log=log)
        with pytest.raises(CheckFailed, match="failsafe"):
            fly(request, warn=said.append)
    assert said[0] == "The board's last reset: watchdog (its program hung)."
    assert read_run_log(log).metadata["board_faults"] == "watchdog"


class Restarting:
    """A board that starts anew after so many reads, by its watchdog."""

    def __init__(self, reads):
        self._left, self._board = reads, Board()

    def hear(self, data):
        self._left -= 1
        if self._left == 0:
            self._board = Board(reset_faults=Fault.WATCHDOG)
            self._board.place(boot=2)
        return self._board.hear(data)


@pytest.mark.wallclock
def test_a_run_whose_board_restarts_says_so_and_why(port_of, tmp_path):
    ended, log = [], tmp_path / "f.mcap"
    with VirtualGantryProcess(RIG, seed=0) as plant:
        port = port_of(Restarting(20))
        request = RunRequest(RIG, 6.0, port=port, range_socket=plant.range_socket, log=log)
        with pytest.raises(CheckFailed) as told:
            fly(request, tell=lambda tally: ended.append(tally.ended))
    assert str(told.value) == (
        "The flight ended in a failsafe (mcu_reboot): the board restarted in flight: check its "
        "power supply; its last reset: watchdog (its program hung)"
    )
    assert ended == ["failsafe: mcu_reboot"]
    assert read_run_log(log).metadata["board_boot"] == "1"
