"""What tests of pages share: clients of a server, rows to feed it with, flights slowed down."""

import asyncio
import contextlib
import http.client
import json
import socket
import subprocess
import sys
import threading
import time
from urllib.parse import urlsplit

import tornado.httpclient
import tornado.websocket

from runtime.live_view import rig_view
from runtime.loop.loop import Loop
from runtime.reference import random_plan
from runtime.simulated import SimulatedGantry
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.2})


def row(tick, **changes):
    """A tick in flight; the height is the tick's number in mm, so that rows tell themselves."""
    made = {"tick": tick, "t_s": tick / 32, "z_est_m": 1e-3 * (tick % 1000), "z_ref_m": 0.4}
    made |= {"x_m": 0.1, "force_pred_n": -0.5, "force_now_n": -0.6, "source_applied_us": 1500.0}
    made |= {f"t_{stage}_s": 2e-4 for stage in ("read", "estimate", "predict", "control", "write")}
    return made | {"mode": "RUNNING", "faults": ""} | changes


def begin(feed):
    """What a run tells before its first row."""
    feed.tell({"phase": "flying", "rig": rig_view(RIG), "title": "a test", "log": "f.mcap"})


def fed(feed, ticks, pause_s=0.0005):
    """Put rows, each again until the queue takes it: a busy computer may not empty it at once."""
    for tick in ticks:
        dropped = -1
        while dropped != feed.dropped:
            dropped = feed.dropped
            feed.put(row(tick))
            time.sleep(pause_s)


@contextlib.contextmanager
def flowing(feed, **values):
    """Rows with these values, as from a loop that flies; a test changes what is yielded."""
    over = threading.Event()

    def flow():
        tick = 0
        while not over.wait(0.05):
            feed.put(row(tick, **values))
            tick += 1

    loop = threading.Thread(target=flow)
    loop.start()
    try:
        yield values
    finally:
        over.set()
        loop.join()


class Client:
    """Talks to a page's server as a browser would, or not quite."""

    def __init__(self, url):
        parts = urlsplit(url)
        self.host, self.token = parts.netloc, parts.fragment

    def ask(self, method, path, **headers):
        """Status, headers and body; `Host` and others as given."""
        connection = http.client.HTTPConnection(self.host, timeout=10)
        with contextlib.closing(connection):
            connection.request(method, path, headers=headers)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read().decode()

    async def page(self, token=None, origin=None, **said):
        """A page's websocket that has said its token."""
        request = tornado.httpclient.HTTPRequest(
            f"ws://{self.host}/live", headers={"Origin": origin or f"http://{self.host}"}
        )
        socket = await tornado.websocket.websocket_connect(request)
        await socket.write_message(json.dumps({"token": token or self.token} | said))
        return socket


@contextlib.contextmanager
def serving(*words):
    """The address of a command that serves a page until the block is left."""
    line = [sys.executable, "-c", "from wakedeploy.cli import main; main()", *map(str, words)]
    line += ["--listen", "127.0.0.1:0"]
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True) as command:
        try:
            told = command.stderr.readline()
            while " …" in told or "done in" in told:  # what a busy computer takes its time for
                told = command.stderr.readline()
            assert "Live page: http://" in told, told + command.stderr.read()
            yield told.split()[-1]
        finally:
            command.terminate()


def sent_at(path):
    """What a socket in the file system answers who asks for its page."""
    with socket.socket(socket.AF_UNIX) as asking:
        asking.settimeout(10.0)
        asking.connect(str(path))
        asking.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        return b"".join(iter(lambda: asking.recv(65536), b"")).decode()


class Slow:
    """A page that reads when it is told to, and has little room for what it does not read."""

    def __init__(self, client):
        host, _, port = client.host.partition(":")
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self._socket.settimeout(10.0)
        self._socket.connect((host, int(port)))
        ask = ("GET /live HTTP/1.1", f"Host: {client.host}", f"Origin: http://{client.host}",
               "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
               "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "", "")  # fmt: skip
        self._socket.sendall("\r\n".join(ask).encode())
        self._file = self._socket.makefile("rb")
        while self._file.readline() != b"\r\n":
            pass
        said = json.dumps({"token": client.token}).encode()
        # A masked text frame, its mask all zeros.
        self._socket.sendall(bytes([0x81, 0x80 | len(said), 0, 0, 0, 0]) + said)

    def read(self):
        """The next frame with rows or state, RFC 6455; pings are passed over."""
        while True:
            kind, length = self._file.read(2)
            if length >= 126:
                length = int.from_bytes(self._file.read(2 if length == 126 else 8), "big")
            content = self._file.read(length)
            if kind == 0x81:
                return json.loads(content)


async def rows_until(socket, tick, limit_s=60.0):
    """The frames of a page up to the row of a tick."""
    frames = []
    async with asyncio.timeout(limit_s):
        while True:
            message = await socket.read_message()
            assert message is not None, f"closed: {socket.close_code} {socket.close_reason}"
            frames.append(json.loads(message))
            rows = frames[-1].get("rows")
            if rows and rows[-1][0] >= round(tick / 32, 4):
                return frames


def slow_flight(onlooker, seconds=60.0, pause_s=0.004):
    """A flight in simulated time that lets an onlooker look on; its tally, and vz [m/s] each tick.

    Eight times faster than real time.
    """
    world = SimulatedGantry(GantryPlant(RIG, seed=1), truth=RIG, seed=1)
    speeds_mps = []

    def beat():
        speeds_mps.append(world.plant.vz_mps)
        time.sleep(pause_s)

    plan = random_plan(RIG, seconds, 1)
    loop = Loop(RIG, world, world, plan, None, None, world, None, beat, onlooker=onlooker)
    return loop.run(), speeds_mps, world.plant.z_m
