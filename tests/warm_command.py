"""`wakedeploy` as a program that begins warm: a small script has it forked from a process that has
imported what takes seconds.

For tests that start the command many times and ask something else than how it begins.
"""

import contextlib
import json
import os
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

# What the script does: it hands its three streams over and ends as the command ended.
_ASK = """
import json, os, socket, sys
there = socket.socket(socket.AF_UNIX)
there.connect(sys.argv[1])
asked = json.dumps([os.getcwd(), sys.argv[2:]]).encode()
socket.send_fds(there, [len(asked).to_bytes(4, "big") + asked], [0, 1, 2])
sys.exit(int(there.recv(16)))
"""


@contextlib.contextmanager
def warm_command(script: Path, *first: str) -> Iterator[str]:
    """The text of a shell script that is the command, as long as this lasts.

    `first` is code that runs before anything is imported. The socket lies beside `script`.
    """
    place = script.with_suffix(".socket")
    code = "\n".join([*first, f"import sys; sys.path[:0] = {[str(ROOT), str(ROOT / 'tests')]!r}",
                      f"import warm_command; warm_command.serve({str(place)!r})"])  # fmt: skip
    server = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    try:
        assert server.stdout is not None
        assert server.stdout.readline() == b"warm\n"
        asking = shlex.join([sys.executable, "-I", "-S", "-c", _ASK, str(place)])
        yield f'#!/bin/sh\nexec {asking} "$@"\n'
    finally:
        server.kill()
        server.wait()


def serve(place: str) -> None:
    """Fork a command for everyone who asks, until this process is killed."""
    import wakedeploy.cli.check
    import wakedeploy.cli.deploy  # noqa: F401

    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for who waited for a command
    with socket.socket(socket.AF_UNIX) as door:
        door.bind(place)
        door.listen()
        print("warm", flush=True)
        while True:
            asking, _ = door.accept()
            if os.fork() == 0:
                door.close()
                _answer(asking)
            asking.close()


def _answer(asking: socket.socket) -> None:
    """Run one command in a process of its own and tell its exit status."""
    begun, streams, *_ = socket.recv_fds(asking, 1 << 20, 3)
    size = int.from_bytes(begun[:4], "big")
    while len(begun) < 4 + size:
        begun += asking.recv(1 << 20)
    folder, words = json.loads(begun[4:])
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    command = os.fork()
    if command == 0:
        for stream, given in enumerate(streams):
            os.dup2(given, stream)
        os.chdir(folder)
        sys.argv = ["wakedeploy", *words]
        from wakedeploy.cli import main

        main()
    for given in streams:
        os.close(given)
    status = os.waitstatus_to_exitcode(os.waitpid(command, 0)[1])
    asking.sendall(b"%d" % (status if status >= 0 else 128 - status))
    os._exit(0)
