"""The base package in an arm64 system under emulation: every architecture gives what it should.

Debian's arm64 packages with Python are unpacked into a folder, the wheels for aarch64 installed
beside them, and `wakedeploy check` run there by QEMU; the machine's own packages stay as they are.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")

from test_install import ROOT, run, wheel  # noqa: F401 (a fixture)

from trainers.build import ARCHITECTURES

pytestmark = [pytest.mark.slow]

QEMU = shutil.which("qemu-aarch64-static")
PYTHON = "3.11"  # Debian 12's, and Raspberry Pi OS 12's
GLIBC = 36
SYSTEM = [f"python{PYTHON}", "libstdc++6"]
LIBRARIES = f"usr/lib/python{PYTHON}/dist-packages"
# The emulator needs no registration with the kernel where it is named itself. It gets no /sys: what
# onnxruntime reads there about this machine's processor crashes it. /dev is only null and urandom.
IN_THE_ROOT = """
set -e
mount -t proc proc "$ROOT/proc"
for device in null urandom; do mount --bind "/dev/$device" "$ROOT/dev/$device"; done
exec chroot "$ROOT" /qemu-aarch64-static /usr/bin/python3 "$@"
"""


def why_not():
    """What is missing for an arm64 root here; None where it can be made."""
    if QEMU is None:
        return "no QEMU for arm64 programs here (Debian: qemu-user-static)"
    if not all(map(shutil.which, ("apt-get", "dpkg-deb", "unshare", "chroot"))):
        return "no apt-get here to fetch arm64 packages with"
    tried = subprocess.run(["unshare", "--mount", "chroot", "/", "true"], check=False)
    return "this user may not change roots" if tried.returncode else None


def apt(folder, *words):
    """apt-get for arm64 with a state of its own, in `folder`; whether it did its work."""
    for name in ("state/lists/partial", "cache/archives/partial"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "status").touch()
    options = {
        "Dir::State": folder / "state", "Dir::Cache": folder / "cache",
        "Dir::State::status": folder / "status", "Debug::NoLocking": 1,
        "APT::Architecture": "arm64", "APT::Architectures": "arm64", "APT::Sandbox::User": "root",
    }  # fmt: skip
    settings = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
    line = ["apt-get", "-qq", "-y", "--no-install-recommends", *settings, *words]
    return subprocess.run([str(word) for word in line], check=False).returncode == 0


def unpacked(debs, root):
    """A root of these packages, with the emulator and what a program expects to be there."""
    for deb in sorted(debs):
        subprocess.run(["dpkg-deb", "--extract", deb, root], check=True)
    shutil.copy(QEMU, root / "qemu-aarch64-static")
    (root / "usr/bin/python3").symlink_to(f"python{PYTHON}")
    for folder in ("proc", "dev", "tmp", LIBRARIES):
        (root / folder).mkdir(parents=True, exist_ok=True)
    for device in ("null", "urandom"):
        (root / "dev" / device).touch()


def install_for_the_pi(built, libraries):
    """pip's own install of the wheel with [onnx], as locked, but for aarch64."""
    platforms = ["manylinux2014_aarch64"]
    platforms += [f"manylinux_2_{minor}_aarch64" for minor in range(17, GLIBC + 1)]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    aimed = ["--target", libraries, "--python-version", PYTHON, "--only-binary", ":all:"]
    aimed += [word for name in platforms for word in ("--platform", name)]
    run(
        *pip,
        *aimed,
        "--constraint",
        ROOT / "constraints.txt",
        f"{built}[onnx]",
        cwd=libraries.parent,
    )


@pytest.fixture(scope="module")
def arm64(wheel, tmp_path_factory):  # noqa: F811
    """A function that runs Python in an arm64 root: its arguments → how it ended."""
    why = why_not()
    if why is not None:
        pytest.skip(why)
    folder = tmp_path_factory.mktemp("arm64")
    root, state = folder / "root", folder / "apt"
    if not apt(state, "update") or not apt(state, "install", "--download-only", *SYSTEM):
        pytest.skip("no arm64 packages to be had from here")
    unpacked((state / "cache" / "archives").glob("*.deb"), root)
    install_for_the_pi(wheel, root / LIBRARIES)

    def python(*words):
        line = ["unshare", "--mount", "sh", "-c", IN_THE_ROOT, "sh", *words]
        environment = {"ROOT": str(root), "PATH": os.environ["PATH"], "HOME": "/tmp"}
        return subprocess.run(
            [str(word) for word in line],
            env=environment, capture_output=True, text=True, check=False, timeout=1200,
        )  # fmt: skip

    python.root = root
    yield python
    shutil.rmtree(root)  # half a gigabyte


def test_it_is_an_arm64_system_without_torch(arm64):
    code = (
        "import importlib.util as u, platform, onnxruntime;"
        "print(platform.machine(), onnxruntime.__version__, u.find_spec('torch'))"
    )
    told = arm64("-c", code)
    assert told.returncode == 0, told.stderr
    machine, version, torch = told.stdout.split()
    assert (machine, torch) == ("aarch64", "None")
    assert f"onnxruntime=={version}\n" in (ROOT / "constraints.txt").read_text()


@pytest.mark.parametrize("arch", sorted(ARCHITECTURES))
def test_every_architecture_reproduces_its_reference_outputs_there(arch, arm64, exported_arch):
    shutil.copy(exported_arch(arch).path, arm64.root / "tmp" / f"{arch}.onnx")
    told = arm64("-m", "wakedeploy", "check", f"/tmp/{arch}.onnx", "--json", f"/tmp/{arch}.json")
    assert told.returncode == 0, told.stderr
    result = json.loads((arm64.root / "tmp" / f"{arch}.json").read_text())
    assert result["ok"]
    assert result["arch"] == arch
    assert result["replay"]["steps"] == 512
    print(f"{arch}: {result['replay']['max_rel']:.1e}")


def test_a_package_with_other_reference_outputs_fails_there(arm64, tiny_package):
    path = Path(arm64.root) / "tmp" / "lying.onnx"
    path.write_bytes(tiny_package("state").model_bytes)  # its record says every force is zero
    told = arm64("-m", "wakedeploy", "check", "/tmp/lying.onnx")
    assert told.returncode == 1
    assert "example rollout differs" in told.stderr
