"""What tests need that a machine may lack: without it they are skipped, and a run says so once."""

import os
import shutil
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest

from runtime.virtual import firmware_build

NOT_INSTALLED = "not installed: "
SKETCH = ("gcc-avr", "binutils-avr", "avr-libc", "arduino-core-avr")
SIMULATOR = (*SKETCH, "g++", "libsimavr-dev", "libelf-dev")
DATA = Path(os.environ.get("WAKEDEPLOY_DATA") or Path(__file__).parents[2] / "shared" / "data")


def packages(present: bool, *names: str) -> pytest.MarkDecorator:
    """A mark that skips a test on a machine without these Debian packages."""
    return pytest.mark.skipif(not present, reason=NOT_INSTALLED + " ".join(names))


compiler = packages(firmware_build.missing_tools("g++") is None, "g++")
coverage = packages(firmware_build.missing_tools("g++", "gcov") is None, "g++")
avr_compiler = packages(firmware_build.missing_for_the_uno() is None, *SKETCH)
simulator = packages(firmware_build.missing_for_the_simulator() is None, *SIMULATOR)
systemd = packages(shutil.which("systemd-analyze") is not None, "systemd")
c_compiler = packages(any(map(shutil.which, ("cc", "gcc", "clang"))), "gcc")
clang = packages(shutil.which("clang") is not None, "clang")
arm = packages(
    all(map(shutil.which, ("arm-none-eabi-gcc", "qemu-system-arm"))),
    *("gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "qemu-system-arm"),
)
chromium = packages(
    all(map(shutil.which, ("chromium", "chromedriver"))), "chromium", "chromium-driver"
)
octave = packages(shutil.which("octave-cli") is not None, "octave")


def recordings(domain: str) -> pytest.MarkDecorator:
    """A mark that skips a test on a machine without the public recordings of a domain."""
    return pytest.mark.skipif(not (DATA / domain).is_dir(), reason=no_recordings(domain))


def recordings_of(domain: str) -> Path:
    """The folder of a domain's public recordings; skips the test where it is absent."""
    if not (DATA / domain).is_dir():
        pytest.skip(no_recordings(domain))
    return DATA / domain


def no_recordings(domain: str) -> str:
    return f"no recordings of {domain}: set WAKEDEPLOY_DATA to the folder that has {domain}/"


def skipped_lines(reasons: Iterable[str]) -> list[str]:
    """One line for everything that apt would install, and one for each other reason."""
    apart = Counter[str]()
    wanted: dict[str, None] = {}
    uninstalled = 0
    for reason in reasons:
        names = reason.partition(NOT_INSTALLED)[2]
        if names:
            uninstalled += 1
            wanted.update(dict.fromkeys(names.split()))
        else:
            apart[reason.removeprefix("Skipped: ")] += 1
    lines = [f"SKIPPED [{count}] {reason}" for reason, count in sorted(apart.items())]
    if uninstalled:
        lines.append(f"SKIPPED [{uninstalled}] to run them: sudo apt install {' '.join(wanted)}")
    return lines
