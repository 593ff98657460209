"""Another machine, reached with the system's own ssh: one shell line at a time, nothing ever asked.

In: what ssh takes as a destination. Out: how a line of `sh` ended there, or UnusableInput that says
in one sentence why ssh did not get that far.
"""

import os
import re
import shlex
import subprocess
from dataclasses import dataclass
from pathlib import Path

from wakedeploy.core.errors import UnusableInput

CONNECT_LIMIT_S = 10
ANSWER_LIMIT_S = 60.0  # a line of shell that takes longer hangs, on a disk most likely
_SLOWEST_BYTES_PER_S = 20_000  # at which a package is still worth waiting for
_OWN_FAILURE = 255  # ssh's exit status where it failed itself, rather than what it ran
_OPTIONS = {
    "BatchMode": "yes",  # a question would wait for ever where nobody sits
    "ConnectTimeout": str(CONNECT_LIMIT_S),
    "ServerAliveInterval": "5",
    "ServerAliveCountMax": "3",
    "ClearAllForwardings": "yes",
    "LogLevel": "ERROR",  # no banner of the host among the errors
}
_REASONS = (
    (
        "Can't open user config file",
        "ssh cannot open the file of -F; give one that is there.",
    ),
    (
        "IDENTIFICATION HAS CHANGED",
        "its host key is another than the known one; if it was installed anew, forget the old key "
        "with ssh-keygen -R, otherwise do not trust this network.",
    ),
    (
        "Host key verification failed|host key is known",
        "its host key is not known here; connect once by hand with ssh and accept it.",
    ),
    (
        "Permission denied|Too many authentication failures",
        "it refused the key; copy yours there with ssh-copy-id, or unlock it with ssh-add.",
    ),
    (
        "hostname contains invalid characters",
        "is no name of a host; give what ssh takes, such as pi@rig.",
    ),
    ("Could not resolve", "there is no host of this name; check its spelling and the network."),
    ("Connection refused", "no ssh server answers there; switch ssh on, or check the port."),
    (
        "timed out|No route to host|unreachable|not responding",
        "it does not answer; check its power and the network.",
    ),
)


@dataclass(frozen=True)
class Ended:
    """How a line of shell ended: its exit status, and what it wrote."""

    status: int
    stdout: str
    stderr: str

    @property
    def last_words(self) -> str:
        """The last line that it wrote to stderr; empty when there is none."""
        lines = [line.strip() for line in self.stderr.splitlines() if line.strip()]
        return lines[-1].removeprefix("Error: ") if lines else ""


@dataclass(frozen=True)
class Remote:
    """A machine as ssh names it (pi@host, a Host of the config, ssh://pi@host:2222)."""

    target: str
    ssh_config: Path | None = None

    def run(self, script: str, data: bytes = b"", limit_s: float = ANSWER_LIMIT_S) -> Ended:
        """Run a line of POSIX shell in the home folder there, with `data` as its input.

        Raises UnusableInput when there is no ssh here, no way there, or no way back, and when the
        line has not ended after `limit_s` and what a slow connection needs for the data.
        """
        limit_s += len(data) / _SLOWEST_BYTES_PER_S
        config = [] if self.ssh_config is None else ["-F", str(self.ssh_config)]
        options = [f"-o{name}={value}" for name, value in _OPTIONS.items()]
        # The login shell there may be any; what it has to understand is one quoted word.
        line = f"sh -c {shlex.quote(script)}"
        try:
            ended = subprocess.run(  # noqa: S603
                ["ssh", "-T", *config, *options, "--", self.target, line],  # noqa: S607
                input=data,
                capture_output=True,
                check=False,
                timeout=limit_s,
                env=os.environ | {"LC_ALL": "C"},  # reasons are recognised by their words
            )
        except FileNotFoundError as error:
            raise UnusableInput(
                "There is no ssh on this computer; install it (Debian: openssh-client)."
            ) from error
        except subprocess.TimeoutExpired as error:
            raise UnusableInput(
                f"{self.target}: it lets ssh in, but had done nothing after {limit_s:.0f} s; see"
                " there what hangs, its disk most likely, and start again."
            ) from error
        answer = Ended(
            ended.returncode,
            ended.stdout.decode(errors="replace"),
            ended.stderr.decode(errors="replace"),
        )
        if ended.returncode == _OWN_FAILURE or ended.returncode < 0:
            raise UnusableInput(f"{self.target}: {_reason(answer)}")
        return answer


def _reason(ended: Ended) -> str:
    for pattern, reason in _REASONS:
        if re.search(pattern, ended.stderr):
            return reason
    said = f" ({ended.last_words})" if ended.last_words else ""
    return f"the connection was lost{said}; check it, and start again."
