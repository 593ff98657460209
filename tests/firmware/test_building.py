"""What cannot be built is told in a sentence that names what to install."""

import hashlib
import re
import shutil
from pathlib import Path

import needs
import pytest

from runtime.io.protocol import FIRMWARE
from runtime.virtual import firmware_build
from runtime.virtual.firmware_build import firmware, host_library, simulator_library
from wakedeploy.core.errors import UnusableInput


def test_missing_compilers_are_named_with_their_packages(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda tool: None)
    with pytest.raises(UnusableInput, match=r"avr-gcc and .* not installed .*gcc-avr"):
        firmware()
    with pytest.raises(UnusableInput, match="cannot be simulated: avr-gcc"):
        simulator_library()


@pytest.mark.parametrize(
    ("place", "words"), [("CORE", "arduino-core-avr"), ("SIMAVR", "libsimavr-dev")]
)
def test_missing_libraries_are_named_with_their_packages(place, words, monkeypatch, tmp_path):
    monkeypatch.setattr(shutil, "which", lambda tool: f"/usr/bin/{tool}")
    for other in ("CORE", "SIMAVR"):
        monkeypatch.setattr(firmware_build, other, tmp_path)
    (tmp_path / "sim_avr.h").touch()
    monkeypatch.setattr(firmware_build, place, tmp_path / "none")
    with pytest.raises(UnusableInput, match=words):
        simulator_library()


def test_an_installation_without_the_sketch_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(firmware_build, "SKETCH", tmp_path / "none")
    with pytest.raises(UnusableInput, match="use a checkout"):
        firmware()


@needs.compiler
def test_what_the_compiler_refuses_is_told(tmp_path):
    wrong = Path(tmp_path / "wrong.cpp")
    wrong.write_text("int main( {\n")
    with pytest.raises(UnusableInput, match=r"refuses the firmware: .*wrong.cpp:1"):
        host_library(wrong)


def test_the_firmwares_number_changes_with_what_the_sketch_does():
    """A board with another sketch is refused by this number, so that it must tell them apart."""
    sources = sorted(path for path in firmware_build.SKETCH.iterdir() if path.suffix != ".md")
    said = "".join(path.name + path.read_text("utf-8") for path in sources)
    code = re.sub(r"\s+", " ", re.sub(r"//[^\n]*", "", said))
    digest = hashlib.sha256(code.encode()).hexdigest()[:16]
    assert {FIRMWARE: digest} == {4: "80c0527261ef1157"}, (
        "another sketch: raise FIRMWARE here and in session.h"
    )
