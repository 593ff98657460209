"""The plant behind the compiled sketch: it gets what the pins do."""

from contextlib import ExitStack

import needs
import pytest
from click.testing import CliRunner
from simulated import the_uno

from runtime.calibration.session import Site, resting
from runtime.io import protocol
from runtime.io.board import met_board
from runtime.io.link import Link
from runtime.io.protocol import Arm, Command, Fault, Frame, FrameDecoder, Hello, encode_frame
from runtime.place import opened_place
from runtime.request import RunRequest
from runtime.virtual.firmware_port import FirmwarePort
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.cli import main
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig

LIMITS = Arm(1000, 2000, 20_000, 250, 1000, 2100, 8400, 0, 0, 0)


class Rig:
    """FirmwarePort and plant without a process; time moves when the test says so."""

    def __init__(self):
        self.rig = default_rig().changed(disturbance={"esc_frame_s": 0.0})
        self.plant = GantryPlant(self.rig, seed=0)
        self.port = FirmwarePort(self.rig, the_uno())
        self.decoder = FrameDecoder()
        self.sequence = 0
        self.port.opened(0.0)
        self.run(1.8)

    def run(self, seconds):
        heard, end_s = [], self.plant.t_s + seconds
        while self.plant.t_s < end_s:
            heard += self.decoder.feed(self.port.answer(self.plant.t_s, self.plant))
            out = self.port.advance(self.plant.t_s, self.plant.dt_s)
            self.plant.step(out.source_us, out.sufferer_us, out.carriage_mps)
        return heard

    def send(self, message, seconds=1.0 / 32.0):
        self.sequence += 1
        data = encode_frame(Frame(self.sequence, 0, message))
        self.port.receive(self.plant.t_s, data)
        heard = self.run(seconds)
        return heard[-1].message if heard else None

    def hover(self, aim_m, seconds, brake=0.0, sink=0.0):
        """Under a controller without an integral: heights [m], and the last status.

        Should no other command come, thrust is to be these shares of the weight.
        """
        hover_n, heights_m, status = 9.81 * self.rig.sufferer.mass_kg, [], None
        pulse = self.rig.thrust.sufferer.pulse
        blind = pulse(brake * hover_n), pulse(sink * hover_n)
        for _ in range(round(32 * seconds)):
            error_m, speed_mps = aim_m - self.plant.z_m, self.plant.vz_mps
            asked_n = hover_n + 8.0 * error_m - 3.2 * speed_mps
            status = self.send(Command(1000, pulse(asked_n), 0, *blind))
            heights_m.append(self.plant.z_m)
        return heights_m, status

    def flying(self, limits=LIMITS):
        assert self.send(Hello()).board == protocol.Board.UNO
        assert self.send(limits).armed
        return self


@needs.simulator
def test_thrust_comes_from_the_pulses_and_position_from_the_steps():
    rig = Rig().flying()
    for _ in range(48):
        status = rig.send(Command(1400, 1600, 1050, 1000, 1000))
    assert rig.plant.source_applied_us == pytest.approx(1400, abs=0.2)
    assert rig.plant.sufferer_applied_us == pytest.approx(1600, abs=0.2)
    assert rig.plant.source_thrust_n == pytest.approx(1.44, abs=0.01)
    for _ in range(16):  # the carriage stops
        status = rig.send(Command(1400, 1600, 0, 1000, 1000))
    assert status.steps == rig.plant.steps == round(rig.plant.x_m * rig.rig.stepper.steps_per_m)
    assert status.steps > 1000
    assert status.applied_time_us > 0
    assert not status.homed


@needs.simulator
def test_silence_brings_the_sufferer_down_and_latches():
    rig = Rig().flying()
    for _ in range(40):
        status = rig.send(Command(1000, 1800, 0, 1000, 1000))
    assert status.homed
    assert rig.plant.z_m > 0.1
    rig.run(0.5)
    assert 1000 < rig.plant.sufferer_applied_us < 1800  # on its bounded ramp
    rig.run(1.5)
    assert rig.plant.sufferer_applied_us == pytest.approx(1000, abs=0.2)
    assert rig.send(Command(1800, 1800, 0, 1000, 1000)).faults == Fault.DEADMAN


@needs.simulator
def test_a_reboot_takes_the_pulses_away_and_starts_idle():
    rig = Rig().flying()
    for _ in range(16):
        rig.send(Command(1500, 1500, 0, 1000, 1000))
    rig.port.opened(rig.plant.t_s)
    rig.run(1.0)
    assert (rig.plant.source_applied_us, rig.plant.sufferer_applied_us) == (0, 0)
    assert rig.plant.sufferer_thrust_n == pytest.approx(0.0, abs=1e-3)
    rig.run(1.0)
    assert rig.plant.source_applied_us == pytest.approx(1000, abs=0.2)
    assert rig.send(Command(1500, 1500, 0, 1000, 1000)) is None


@pytest.mark.whole
@needs.simulator
def test_the_sketch_answers_over_a_real_pseudo_terminal():
    with (
        VirtualGantryProcess(default_rig(), seed=0, firmware=True) as gantry,
        Link(gantry.port) as link,
    ):
        assert link.handshake().board == protocol.Board.UNO
        assert link.arm(LIMITS).homed
        answer = link.wait_for(link.send(Command(1234.5, 1000, 420, 1000, 1000)), 2.0)
        assert answer.status.armed
        link.disarm()
        assert link.malformed == 0


@needs.simulator
def test_behind_the_sketch_the_sufferer_hovers():
    rig, aim_m = Rig().flying(), 0.6
    heights_m, status = rig.hover(aim_m, 5.0)
    assert heights_m[-32:] == pytest.approx([aim_m] * 32, abs=0.05)
    assert (status.missed, status.malformed) == (0, 0)


def landing_speed(rig):
    """How fast the sufferer is before it stands on the stop [m/s]."""
    fastest_mps = 0.0
    while rig.plant.z_m > 0.0:
        rig.run(rig.plant.dt_s)
        fastest_mps = max(fastest_mps, -rig.plant.vz_mps)
    return fastest_mps


@pytest.mark.slow
@needs.simulator
def test_how_hard_a_pulled_cable_lets_the_sufferer_land():
    """From 0.7 m, as docs/how-to/rig.md has it: a board on USB power, one with its own supply."""
    switched_off = Rig().flying()
    switched_off.hover(0.7, 4.0)
    the_uno().switch_off()
    assert landing_speed(switched_off) == pytest.approx(3.6, abs=0.05)
    assert switched_off.plant.sufferer_applied_us == 0.0
    assert switched_off.send(Hello()) is None
    for descent_ms, sinking, sink, speed_mps in (
        (1000, (0, 0, 0), 0.0, 3.2),
        (3000, (0, 0, 0), 0.0, 2.5),
        (1000, (300, 4000, 6), 0.98, 0.7),
    ):
        limits = Arm(1000, 2000, 20_000, 250, descent_ms, 2100, 8400, *sinking)
        alone = Rig().flying(limits)
        alone.hover(0.7, 4.0, brake=1.0, sink=sink)
        assert landing_speed(alone) == pytest.approx(speed_mps, abs=0.05)
        alone.run(0.125 + (limits.brake_ms + limits.sink_ms + descent_ms) / 1000)
        assert alone.plant.sufferer_applied_us == pytest.approx(1000, abs=0.2)


def test_a_real_board_has_its_own_firmware():
    told = CliRunner().invoke(main, ["run-gantry", "--baseline", "--port", "/x", "--firmware"])
    assert told.exit_code != 0
    assert "--firmware belongs to --virtual" in told.output


@needs.simulator
@pytest.mark.parametrize(("firmware", "board"), [(True, "uno"), (False, "virtual")])
def test_a_run_that_asks_for_the_sketch_gets_it(firmware, board):
    """The handshake alone: a busy computer may be too slow to fly a chip in real time."""
    with ExitStack() as opened:
        request = RunRequest(default_rig(), 6.0, wall_clock=True, realtime=False, firmware=firmware)
        place = opened_place(request, opened)
        assert met_board(place.link, may_be_virtual=True).metadata["board"] == board


def test_a_calibration_that_asks_for_the_sketch_asks_its_runs_for_it(monkeypatch, tmp_path):
    asked = []

    def flown(request, **_):
        asked.append(request.firmware)
        raise KeyboardInterrupt

    monkeypatch.setattr("runtime.calibration.session.fly", flown)
    for firmware in (True, False):
        with pytest.raises(KeyboardInterrupt):
            Site(tmp_path, firmware=firmware).flown("rest", *resting(default_rig(), 1.0))
    assert asked == [True, False]
