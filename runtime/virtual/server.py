"""The plant process: steps the plant in real time, serves a pseudo-terminal and a socket.

It ends when its standard input is closed, so it never outlives the run that started it.
"""

import contextlib
import json
import os
import select
import shutil
import socket
import sys
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from runtime.io.protocol import TIME_WRAP_US, FrameDecoder
from runtime.io.range_source import PLANT_HANGS_S, STATUS_NO_TARGET, RangeReading
from runtime.virtual.firmware_port import FirmwarePort
from runtime.virtual.hooks import load_hooks
from runtime.virtual.mcu_port import BOOT_S, McuPort
from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.physics.range_sensor import NO_SAMPLE
from wakedeploy.rig.file import parse_rig

LATE_S = 0.1  # the deadman holds after 62 ms of silence and takes thrust away after 125 ms


class PtyPort:
    """A pseudo-terminal seen from the board: bytes in and out, and when the host opens it."""

    def __init__(self) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        os.set_blocking(self._master, False)
        os.close(slave)  # from now on the kernel shows whether anyone has it open
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)
        self.is_open = False

    def fileno(self) -> int:
        """For select; only while open, a closed one would be ready at all times."""
        return self._master

    def just_opened(self) -> bool:
        """Whether the host opened the port since the last call."""
        if self.is_open or any(event & select.POLLHUP for _, event in self._poll.poll(0)):
            return False
        self.is_open = True
        return True

    def read(self) -> bytes:
        """What has arrived; nothing when the host closed the port."""
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""
        except OSError:
            self.is_open = False
            return b""

    def write(self, data: bytes) -> None:
        """Send; what the host does not fetch is lost, as on a real wire."""
        if data and self.is_open:
            with contextlib.suppress(OSError):
                os.write(self._master, data)


class FrameStamps:
    """When the host sent what is read now: its frames say so, by the clock that both share.

    A plant that the computer has not let run reads them late; they act when they were sent.
    """

    def __init__(self) -> None:
        self._decoder = FrameDecoder()

    def of(self, data: bytes, now_s: float) -> Iterator[tuple[float, bytes]]:
        """Bytes frame by frame, each with its time [s, monotonic]; `now_s` where none is known."""
        *whole, rest = data.split(b"\0")
        for piece in (*(piece + b"\0" for piece in whole), rest):
            if piece:
                frames = list(self._decoder.feed(piece))
                yield (_sent_s(frames[0].time_us, now_s) if frames else now_s), piece


def _sent_s(time_us: int, now_s: float) -> float:
    """The last time before now at which a clock in µs that wraps said `time_us` [s]."""
    ago_s = 1e-6 * ((int(1e6 * now_s) - time_us) % TIME_WRAP_US)
    return now_s - ago_s if ago_s < PLANT_HANGS_S else now_s


class RangeServer:
    """Sends readings to whoever is connected."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "range.sock"
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(str(self.path))
        self._listener.listen(4)
        self._listener.setblocking(False)
        self._clients: list[socket.socket] = []

    def send(self, reading: RangeReading) -> None:
        """Send a reading; a client that does not read loses it, one that is gone is forgotten."""
        with contextlib.suppress(BlockingIOError):
            client, _ = self._listener.accept()
            client.setblocking(False)
            self._clients.append(client)
        for client in list(self._clients):
            try:
                client.send(reading.pack())
            except BlockingIOError:
                continue
            except OSError:
                self._clients.remove(client)


class VirtualGantry:
    """Plant, MCU and the two connections, advanced together in real time."""

    def __init__(self, request: dict[str, Any], folder: Path) -> None:
        rig = parse_rig(request["rig"], "plant rig")
        hooks = load_hooks(request["hooks"]) if request["hooks"] else {}
        self._mcu: McuPort | FirmwarePort = McuPort(rig, boot_s=request.get("boot_s", BOOT_S))
        if request.get("firmware"):
            self._mcu = FirmwarePort(rig)
            # The sketch makes servo frames of its own; the plant must not wait for others.
            rig = rig.changed(disturbance={"esc_frame_s": 0.0})
        spacer_m = request.get("spacer_m", 0.0)
        self._plant = GantryPlant(rig, seed=request["seed"], spacer_m=spacer_m, **hooks)
        self.port = PtyPort()
        self.ranges = RangeServer(folder)
        self._sample = NO_SAMPLE
        self._stamps = FrameStamps()
        self._origin_s = time.monotonic()

    def run(self) -> None:
        """Step until standard input is closed; a step that is late is made up for, time is time."""
        self._origin_s, latest_s = time.monotonic(), 0.0
        while self._serve_until(self._origin_s + self._plant.t_s):
            latest_s = max(latest_s, time.monotonic() - self._origin_s - self._plant.t_s)
            self._step()
        if latest_s > LATE_S:
            sys.stderr.write(
                f"The virtual gantry was up to {latest_s:.2f} s late: this computer is too slow or "
                "too busy to fly it in real time; `run-gantry --virtual` alone flies it in "
                "simulated time.\n"
            )

    def _serve_until(self, deadline_s: float) -> bool:
        """Answer the host until the next step is due; False when the run has ended."""
        while True:
            now_s = time.monotonic()
            if self.port.just_opened():
                self._mcu.opened(now_s - self._origin_s)
            watched: list[Any] = [sys.stdin, *([self.port] if self.port.is_open else [])]
            ready, _, _ = select.select(watched, [], [], max(0.0, deadline_s - now_s))
            if sys.stdin in ready:
                return False
            if self.port in ready:
                for sent_s, data in self._stamps.of(self.port.read(), time.monotonic()):
                    self._mcu.receive(sent_s - self._origin_s, data)
            if not ready or time.monotonic() >= deadline_s:
                return True

    def _step(self) -> None:
        plant = self._plant
        self.port.write(self._mcu.answer(plant.t_s, plant))
        outputs = self._mcu.advance(plant.t_s, plant.dt_s)
        plant.step(outputs.source_us, outputs.sufferer_us, outputs.carriage_mps)
        self._send_reading()

    def _send_reading(self) -> None:
        """The newest range sample, repeated until the next one, with the truth of this step."""
        plant, sample = self._plant, self._plant.range_sample()
        if sample.sensor_time_s > self._sample.sensor_time_s:
            self._sample = sample
        if self._sample is NO_SAMPLE:
            return
        sample = self._sample
        missing = sample.status != 0 or sample.range_m != sample.range_m
        self.ranges.send(
            RangeReading(
                sample.range_m * 1000.0,
                int((self._origin_s + sample.sensor_time_s) * 1e6),
                STATUS_NO_TARGET if missing else 0,
                plant.wake_force_n,
                plant.hook_force_n,
                plant.z_m,
                int((self._origin_s + plant.t_s) * 1e6),
            )
        )


def main() -> None:
    """Read the request from standard input, say where to connect, run."""
    line = "" if sys.stdin.isatty() else sys.stdin.readline()
    if not line:
        sys.exit("Programs start this one; `wakedeploy rig virtual` serves the gantry at a port.")
    request = json.loads(line)
    answers, sys.stdout = sys.stdout, sys.stderr  # what hooks print is no answer
    gantry, answer = _made(request)
    answers.write(json.dumps(answer) + "\n")
    answers.flush()
    if gantry is not None:
        gantry.run()
        shutil.rmtree(request["folder"], ignore_errors=True)  # whose owner may have been killed


def _made(request: dict[str, Any]) -> tuple[VirtualGantry | None, dict[str, str]]:
    """The gantry and where to connect, or nothing and why not."""
    try:
        gantry = VirtualGantry(request, Path(request["folder"]))
    except UnusableInput as error:
        return None, {"unusable": str(error)}
    return gantry, {"port": gantry.port.name, "range_socket": str(gantry.ranges.path)}
