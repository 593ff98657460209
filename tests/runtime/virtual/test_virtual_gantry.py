"""The virtual gantry over a real pseudo-terminal and socket, in a process of its own."""

import itertools
import re
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest

from runtime.io import protocol
from runtime.io.link import Link
from runtime.io.protocol import (
    Arm,
    Command,
    Disarm,
    Fault,
    Frame,
    FrameDecoder,
    Hello,
    encode_frame,
)
from runtime.io.range_source import RangeReading, SocketRangeSource, wait_for_first
from runtime.virtual.hooks import load_hooks
from runtime.virtual.mcu_port import BOOT_S, McuPort
from runtime.virtual.process import VirtualGantryProcess
from runtime.virtual.server import VirtualGantry
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig, default_rig_text, parse_rig

LIMITS = Arm(1000, 2000, 20_000, 250, 1000, 2100, 8400, 0, 0, 0)


class Uno(VirtualGantryProcess):
    boot_s = BOOT_S  # a bootloader that takes its time


@pytest.fixture(scope="module")
def gantry():
    with Uno(default_rig(), seed=3) as running:
        yield running


@pytest.mark.whole
def test_opening_the_port_reboots_the_board_and_a_command_is_answered(gantry):
    before_s = time.monotonic()
    with Link(gantry.port) as link:
        first = link.handshake()
        assert time.monotonic() - before_s > 1.5
        assert first.board == protocol.Board.VIRTUAL
        assert link.arm(LIMITS).armed
        sequence = link.send(Command(1234.5, 1000.0, 420, 1000, 1000))
        answer = link.wait_for(sequence, 1.0)
        assert answer.status.sequence == sequence
        assert 0.009 <= answer.round_trip_s < 1.0  # half of the rig's 18 ms is the command's way
        link.disarm()
    time.sleep(0.1)  # the plant looks every 4 ms whether anyone has the port open
    with Link(gantry.port) as link:
        assert link.handshake().boot == first.boot + 1


def test_range_samples_come_with_a_time_that_both_processes_share(gantry):
    source = SocketRangeSource(gantry.range_socket)
    try:
        first = wait_for_first(source)
        assert 0.0 <= time.monotonic() - first.sensor_time_s < 1.0
        assert first.range_m == pytest.approx(0.0, abs=0.05)
        assert first.true_z_m == 0.0
        time.sleep(0.1)
        assert source.newest.sensor_time_us > first.sensor_time_us
    finally:
        source.close()


def test_a_killed_plant_is_told_as_one_sentence_by_both_ends():
    with VirtualGantryProcess(default_rig(), seed=3) as gantry, Link(gantry.port) as link:
        source = SocketRangeSource(gantry.range_socket)
        gantry.kill()
        source._thread.join(2.0)
        link._reader.join(2.0)
        assert "connection to the board was lost" in link.failure
        assert "stopped sending" in source.failure
        assert link.send(Command(1000, 1000, 0, 1000, 1000)) > 0  # and nothing raises
        source.close()


def test_a_plant_whose_owner_was_killed_leaves_no_folder():
    gantry = VirtualGantryProcess(default_rig(), seed=3)
    folder = gantry.range_socket.parent
    assert folder.is_dir()
    gantry._process.stdin.close()  # as the kernel does for one that is gone
    gantry._process.wait(60)
    assert not folder.exists()
    gantry.close()


def test_a_socket_that_is_not_there_is_unusable(tmp_path):
    with pytest.raises(UnusableInput, match="no range samples"):
        SocketRangeSource(tmp_path / "none.sock")


class Board:
    """McuPort and plant without a process; time moves when the test says so."""

    def __init__(self):
        self.rig = default_rig()
        self.plant = GantryPlant(self.rig, seed=0)
        self.port = McuPort(self.rig, boot_s=0.0)
        self.decoder = FrameDecoder()
        self.heard = []
        self.port.opened(0.0)

    def send(self, sequence, message, seconds=0.03):
        return self.send_bytes(encode_frame(Frame(sequence, 0, message)), seconds)

    def send_bytes(self, data, seconds=0.03):
        self.port.receive(self.plant.t_s, data)
        self.heard = []
        end_s = self.plant.t_s + seconds
        while self.plant.t_s < end_s:
            answers = self.port.answer(self.plant.t_s, self.plant)
            self.heard += self.decoder.feed(answers)
            out = self.port.advance(self.plant.t_s, self.plant.dt_s)
            self.plant.step(out.source_us, out.sufferer_us, out.carriage_mps)
        return self.heard[-1].message if self.heard else None

    def flying(self):
        self.send(1, Hello())
        self.send(2, LIMITS)
        return self


def test_nothing_moves_before_the_handshake_and_arming():
    board = Board()
    assert board.send(1, Command(1500, 1500, 0, 1000, 1000)) is None
    assert board.send(2, LIMITS) is None
    board.send(3, Hello())
    status = board.send(4, Command(1500, 1500, 100, 1000, 1000))
    assert not status.armed
    assert (status.source_us, status.sufferer_us) == (1000, 1000)


def test_arming_needs_a_new_handshake_each_time():
    board = Board().flying()
    assert board.send(3, Command(1200, 1200, 0, 1000, 1000)).armed
    assert not board.send(4, Disarm()).armed
    assert not board.send(5, LIMITS).armed
    board.send(6, Hello())
    assert board.send(7, LIMITS).armed


def test_silence_ramps_down_latches_and_only_a_handshake_helps():
    board = Board().flying()
    board.send(3, Command(1300, 1600, 0, 1000, 1000), seconds=2.0)
    status = board.send(4, Command(1300, 1600, 0, 1000, 1000))
    assert status.faults == Fault.DEADMAN
    assert not status.armed
    assert (status.source_us, status.sufferer_us) == (1000, 1000)
    assert status.missed > 20
    board.send(5, Hello())
    assert board.send(6, LIMITS).faults == Fault.NONE


def test_duplicated_reordered_and_corrupted_frames_are_dropped_and_counted():
    board = Board().flying()
    good = encode_frame(Frame(10, 0, Command(1300, 1300, 0, 1000, 1000)))
    assert board.send_bytes(good).sequence == 10
    assert board.send_bytes(good) is None
    assert board.send(9, Command(1900, 1900, 0, 1000, 1000)) is None
    assert board.send_bytes(good[:4] + b"\x55" + good[5:]) is None
    status = board.send(11, Command(1300, 1300, 0, 1000, 1000), seconds=0.06)
    assert status.malformed == 3
    assert status.source_us == 1300


def test_a_hello_in_flight_is_counted_and_disarms_nothing():
    board = Board().flying()
    board.send(3, Command(1300, 1300, 0, 1000, 1000))
    assert board.send(1, Hello()) is None
    status = board.send(4, Command(1300, 1300, 0, 1000, 1000))
    assert (status.armed, status.malformed, status.source_us) == (True, 1, 1300)


def test_a_reboot_forgets_everything_but_counts_itself():
    board = Board().flying()
    board.send(3, Command(1500, 1500, 0, 1000, 1000))
    board.port.opened(board.plant.t_s)
    assert board.send(4, Command(1500, 1500, 0, 1000, 1000)) is None
    assert board.send(5, Hello()).boot == 2


def test_a_foreign_version_is_told_that_none_fits():
    assert Board().send(1, Hello(7, 9)).version == 0


def test_the_carriage_counts_its_steps_in_the_truth_of_the_plant():
    board = Board().flying()
    for sequence in range(3, 35):
        status = board.send(sequence, Command(1000, 1000, 420, 1000, 1000), seconds=1.0 / 32.0)
    assert status.steps == pytest.approx(420 * 31 / 32, abs=35)
    assert not status.homed


def test_limits_that_are_none_are_refused_by_the_board():
    for senseless in (
        Arm(1000, 1000, 20_000, 250, 1000, 2100, 8400, 0, 0, 0),
        Arm(1000, 2000, 20_000, 0, 1000, 2100, 8400, 0, 0, 0),
    ):
        board = Board()
        board.send(1, Hello())
        assert not board.send(2, senseless).armed
        assert board.send(3, LIMITS).armed


def test_a_board_with_another_stepper_takes_the_hosts_limits_too():
    board = Board()
    # 2100 steps/s are 52 m/s there, far more than a rig file may say.
    stepper = {"steps_per_m": 40, "max_accel_mps2": 40.0}
    board.port = McuPort(board.rig.changed(stepper=stepper), boot_s=0.0)
    board.port.opened(0.0)
    board.send(1, Hello())
    assert board.send(2, LIMITS).armed


def test_hooks_are_named_and_a_wrong_name_is_refused():
    (hook,) = load_hooks(f"{__name__}:some_hooks").values()
    assert hook(1.0, {}) == _no_force(1.0, {})
    for wrong in ("nowhere:f", f"{__name__}:missing", f"{__name__}:wrong_hooks", "plain"):
        with pytest.raises(UnusableInput, match="--hooks"):
            load_hooks(wrong)


def test_a_hook_that_fails_in_flight_is_one_sentence_with_its_name_and_time():
    force = load_hooks(f"{__name__}:broken_hooks")["force_hook"]
    assert force(0.5, {}) == 0.0
    with pytest.raises(CheckFailed, match=r"force_hook fails at 1\.500 s: ZeroDivisionError"):
        force(1.5, {})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def hooks(:\n", r"fails: SyntaxError: .*line 1"),
        ("1 / 0\n", "broken fails: ZeroDivisionError"),
        ("raise SystemExit(0)\n", "broken fails: SystemExit"),
        ("def hooks():\n    return 1 / 0\n", "hooks fails: ZeroDivisionError"),
        ("def hooks():\n    return None\n", "returns a NoneType"),
        ("def hooks():\n    return ['force_hook']\n", "returns a list"),
        ("def hooks():\n    return {3: print}\n", "3 is none of command_hook"),
        ("def hooks():\n    return {'force_hook': 0.5}\n", "force_hook is no function"),
        ("hooks = 3\n", "hooks fails: TypeError"),
    ],
)
def test_whatever_a_hooks_module_does_wrong_is_one_sentence(text, words, tmp_path, monkeypatch):
    (tmp_path / "broken.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "broken", raising=False)
    with pytest.raises(UnusableInput, match=words) as caught:
        load_hooks("broken:hooks")
    assert "\n" not in str(caught.value)


def test_what_the_plant_process_cannot_use_is_told_by_the_one_that_asked():
    with pytest.raises(UnusableInput, match="--hooks nowhere:hooks: no such function"):
        VirtualGantryProcess(default_rig(), seed=0, hooks="nowhere:hooks")
    listed = default_rig_text() + '\n[[effect]]\nname = "ground"\n'
    with pytest.raises(UnusableInput, match="effect 'ground'"):
        VirtualGantryProcess(parse_rig(listed), seed=0)


def _no_force(t_s, state):
    return 0.0


def some_hooks():
    return {"force_hook": _no_force}


def broken_hooks():
    return {"force_hook": lambda t_s, state: 0.0 if t_s < 1.0 else 1.0 / 0.0}


def wrong_hooks():
    return {"gravity_hook": _no_force}


def test_the_truth_is_that_of_now_and_a_sample_stays_what_it_was():
    rig = default_rig()
    with tempfile.TemporaryDirectory(prefix="wd-") as folder:  # a socket's path must be short
        gantry = VirtualGantry({"rig": rig.text, "seed": 0, "hooks": None}, Path(folder))
        sent, plant = [], gantry._plant
        gantry.ranges.send = lambda reading: sent.append((plant.t_s, plant.z_m, reading))
        plant._body.z_m, plant._body.vz_mps = 0.8, -0.1  # falling, hence another truth each step
        gantry._origin_s = 0.0
        while plant.t_s < 0.2:
            gantry._step()
    assert max(after[0] - before[0] for before, after in itertools.pairwise(sent)) < 0.0045
    assert all(reading.true_z_m == z_m for _, z_m, reading in sent)
    assert len({reading.true_z_m for *_, reading in sent}) == len(sent)
    ranges = {}
    for *_, reading in sent:
        assert ranges.setdefault(reading.sensor_time_us, reading.range_mm) == reading.range_mm
    assert 8 <= len(ranges) <= 10  # one each 20 ms


def test_a_reading_without_a_target_has_no_range():
    assert RangeReading(120.0, 5).range_m == pytest.approx(0.12)
    missing = RangeReading(8190.0, 5, status=4)
    assert missing.range_m != missing.range_m


def test_no_thread_is_left_behind(gantry):
    before = threading.active_count()
    link, source = Link(gantry.port), SocketRangeSource(gantry.range_socket)
    link.close()
    source.close()
    assert threading.active_count() == before


def test_a_plant_that_falls_behind_says_that_the_computer_is_to_blame(tmp_path, monkeypatch, capfd):
    (tmp_path / "stalls.py").write_text(
        "import time\nat_s = [0.3]\n"
        "def force(t_s, state):\n"
        "    if at_s and t_s > at_s[0]:\n"
        "        at_s.clear()\n"
        "        time.sleep(0.25)\n"
        "    return 0.0\n"
        "def hooks():\n    return {'force_hook': force}\n"
    )
    monkeypatch.chdir(tmp_path)
    with VirtualGantryProcess(default_rig(), seed=0, hooks="stalls:hooks"):
        time.sleep(1.0)
    said = capfd.readouterr().err
    late = re.search(r"up to (\d+\.\d\d) s late: this computer is too slow or too busy", said)
    assert late is not None
    assert 0.2 < float(late[1]) < 5.0
