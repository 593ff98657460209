"""A computer at the rig, as far as ssh can tell: a real sshd on this machine's loopback."""

import contextlib
import os
import shlex
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import needs

ROOT = Path(__file__).parents[2]
SSHD = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")


needs_sshd = needs.packages(
    SSHD is not None and shutil.which("ssh") is not None, "openssh-client", "openssh-server"
)


@dataclass(frozen=True)
class Rig:
    """A running sshd: its ssh config with the host `rig`, a folder there, and a wakedeploy."""

    port: int
    config: Path
    site: Path
    command: Path

    def links(self) -> dict[str, str]:
        """Where the links in the folder lead."""
        return {link.stem: os.readlink(link) for link in self.site.glob("*.onnx")}

    def configured(self, name: str, *lines: str) -> Path:
        """Another ssh config, in which these lines come before those of `config`."""
        path = self.config.with_name(name)
        path.write_text("\n".join(lines) + "\n" + self.config.read_text())
        return path


@contextlib.contextmanager
def running_rig(folder: Path) -> Iterator[Rig]:
    """An sshd of this user with keys of its own, which lets one key in."""
    for key in ("host_key", "user_key", "other_key"):
        subprocess.run(["ssh-keygen", "-qN", "", "-t", "ed25519", "-f", folder / key], check=True)
    port = _free_port()
    (folder / "sshd_config").write_text(
        f"Port {port}\nListenAddress 127.0.0.1\nHostKey {folder}/host_key\n"
        "Subsystem sftp internal-sftp\n"  # what scp speaks
        f"AuthorizedKeysFile {folder}/user_key.pub\nPidFile none\nStrictModes no\nUsePAM no\n"
        "PasswordAuthentication no\nKbdInteractiveAuthentication no\nPermitRootLogin yes\n"
        # What this user's own .bashrc does at each login is none of the tests' business; nor is the
        # newest exchange of keys, which takes eight times as long.
        f"SetEnv HOME={folder}\nKexAlgorithms curve25519-sha256\n"
    )
    host = (folder / "host_key.pub").read_text().split()
    (folder / "known_hosts").write_text(f"[127.0.0.1]:{port} {host[0]} {host[1]}\n")
    config = folder / "ssh_config"
    config.write_text(
        f"Host rig\n  HostName 127.0.0.1\n  Port {port}\n  IdentityFile {folder}/user_key\n"
        f"  UserKnownHostsFile {folder}/known_hosts\n  GlobalKnownHostsFile none\n"
        "  IdentitiesOnly yes\n  IdentityAgent none\n  StrictHostKeyChecking yes\n"
    )
    if os.getuid() == 0:
        Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)  # where sshd locks itself in
    log = folder / "sshd.log"
    with log.open("w") as written:
        sshd = subprocess.Popen([SSHD, "-D", "-e", "-f", folder / "sshd_config"], stderr=written)
    try:
        _wait_for(port, log)
        yield Rig(port, config, folder / "my site", _wakedeploy(folder / "wake deploy"))
    finally:
        sshd.terminate()
        sshd.wait(10)


# Absent, not None in sys.modules: scipy takes what is in there for a library.
WITHOUT_TORCH = """
import sys
class Absent:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "onnx"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent)
"""
_MAIN = "from wakedeploy.cli import main; main()"


def _wakedeploy(path: Path) -> Path:
    """This project's command, as it would be installed there; torch is not."""
    line = shlex.join([sys.executable, "-c", WITHOUT_TORCH + _MAIN])
    path.write_text(f'#!/bin/sh\nPYTHONPATH={shlex.quote(str(ROOT))} exec {line} "$@"\n')
    path.chmod(0o755)
    return path


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _wait_for(port: int, log: Path) -> None:
    end_s = time.monotonic() + 20.0
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            return
        assert time.monotonic() < end_s, f"sshd does not answer: {log.read_text()}"
        time.sleep(0.05)
