"""Some 10⁴ frames, damaged frames and noise: the program that tries 10⁸ for the results."""

import json
import subprocess
import sys

import needs
import pytest

from benchmarks import frames
from runtime.virtual import firmware_build
from wakedeploy.core.errors import UnusableInput

pytestmark = needs.compiler

COUNT = 60_000


@pytest.mark.whole
def test_no_frame_and_no_noise_makes_the_firmware_do_what_it_must_not() -> None:
    told = frames.tried(COUNT, 7)
    assert told["frames"] == COUNT
    kinds = ("hellos", "arms", "disarms", "commands", "extreme", "stale", "damaged", "cut")
    assert sum(told[kind] for kind in (*kinds, "misshapen", "noise")) == COUNT
    assert min(told[kind] for kind in kinds) > 100
    assert told["answered"] > COUNT / 3
    assert told["dropped"] > COUNT / 4
    assert told["flights"] > told["latched"] > 20


SPOILT = {
    "a frame without its checksum": (
        "frames.cpp",
        "crc16(pending_, body) != Reader(pending_ + body).u16()",
        "crc16(pending_, body) == 0",
    ),
    "a ramp of the wrong motor": ("mcu.cpp", "{BRAKE, RAMP}", "{RAMP, BRAKE}"),
    "a byte beyond the buffer": ("frames.cpp", "length_ == sizeof pending_", "length_ == 64"),
}


@pytest.mark.whole
@pytest.mark.parametrize(
    "name",
    [  # one that memory shows, one that only an answer shows
        pytest.param(name, marks=pytest.mark.slow) if name == "a ramp of the wrong motor" else name
        for name in SPOILT
    ],
)
def test_a_bug_in_the_decisions_is_found(name, monkeypatch, tmp_path) -> None:
    file, sound, spoilt = SPOILT[name]
    sketch = tmp_path / "sketch"
    sketch.mkdir()
    for source in firmware_build.SKETCH.iterdir():
        text = source.read_text()
        assert source.name != file or text.count(sound) == 1
        (sketch / source.name).write_text(
            text.replace(sound, spoilt) if source.name == file else text
        )
    monkeypatch.setattr(firmware_build, "SKETCH", sketch)
    monkeypatch.setattr(firmware_build, "BUILD", tmp_path / "build")
    with pytest.raises(UnusableInput, match=r"frames_fuzz: |runtime error"):
        frames.tried(COUNT, 7)


def test_the_benchmark_writes_what_it_has_tried(tmp_path) -> None:
    record = tmp_path / "frames.json"
    words = ["-m", "benchmarks.frames", "--count", "5000", "--json", str(record)]
    subprocess.run([sys.executable, *words], cwd=frames.records.ROOT, check=True, timeout=300)
    told = json.loads(record.read_text())
    assert told["frames"] == 5000
    assert {"measured", "commit", "seconds", "ticks"} <= set(told)
