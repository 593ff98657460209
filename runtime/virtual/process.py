"""Starts the plant process and stops it."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from runtime.virtual.mcu_port import BOOT_S
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig

STOP_LIMIT_S = 2.0


class VirtualGantryProcess:
    """A running plant process: `port` and `range_socket` are where to connect. A context manager.

    `rig` is the plant's truth; `hooks` names a function as MODULE:FUNCTION (see
    `runtime.virtual.hooks`); with `firmware` the compiled sketch answers, on a simulated UNO;
    `spacer_m` is the height of what lies between sufferer and stop. `boot_s` is how long the
    board takes from the port's opening to its first answer; the sketch boots as an UNO does.
    Raises UnusableInput when the process cannot use one of them.
    """

    boot_s = BOOT_S

    def __init__(
        self,
        rig: Rig,
        *,
        seed: int,
        hooks: str | None = None,
        firmware: bool = False,
        spacer_m: float = 0.0,
    ) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="wakedeploy-")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "runtime.virtual"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
        )
        where = self._ask(
            {
                "rig": rig.text,
                "seed": seed,
                "hooks": hooks,
                "firmware": firmware,
                "spacer_m": spacer_m,
                "boot_s": self.boot_s,
                "folder": self._folder.name,
            }
        )
        self.port: str = where["port"]
        self.range_socket = Path(where["range_socket"])

    def __enter__(self) -> "VirtualGantryProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def wait(self) -> None:
        """Return when it has ended by itself, as after an error."""
        self._process.wait()

    def kill(self) -> None:
        """End it at once, as pulling the cable would."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """Let it end by itself, or make it."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.kill()
        self._folder.cleanup()

    def _ask(self, request: dict[str, str | float | None]) -> dict[str, str]:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            stdin.write(json.dumps(request) + "\n")
            stdin.flush()
            answer: dict[str, str] = json.loads(stdout.readline())
        except (OSError, ValueError) as error:
            self.close()
            raise UnusableInput(
                "The virtual gantry's process did not start; see its message above."
            ) from error
        if "unusable" in answer:
            self.close()
            raise UnusableInput(answer["unusable"])
        return answer
