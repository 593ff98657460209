"""Rig files, run logs and sets that somebody forged: one sentence that names the file, at once."""

import io
import math
import struct
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from click.testing import CliRunner
from mcap.writer import CompressionType, Writer

from wakedeploy.cli import main
from wakedeploy.core import runlog_mcap
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import read_run_log
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig_text, read_rig
from wakedeploy.rig.update import Calibrated, update_rig

MAGIC = b"\x89MCAP0\r\n"
CHUNK = 6
EFFECT = "\n[[effect]]\nname = 'ground-effect'\n"
GAIN = "parameters.gain = {{ value = {}, unit = '1' }}\n"
HEIGHT = "parameters.height_m = { value = 0.1, unit = 'm' }\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f"a = {'[' * 100_000}", "not valid TOML: nested too deeply"),
        (f"schema = {'1' * 5000}", "not valid TOML"),
        (f"{default_rig_text()}{EFFECT}{GAIN.format(0.2)}", "lacks its parameter 'height_m'"),
        (f"{default_rig_text()}{EFFECT}{GAIN.format(900)}{HEIGHT}", "must lie within"),
        (f"{default_rig_text()}\n[[effect]]\nname = 'gremlin'\n", "no effect 'gremlin'"),
        (f"{default_rig_text()}{2 * f'{EFFECT}{GAIN.format(0.2)}{HEIGHT}'}", "twice"),
    ],
)
def test_a_rig_file_that_no_plant_could_have_is_refused_where_it_is_read(
    tmp_path: Path, text: str, told: str
) -> None:
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(UnusableInput, match=f"mine.toml: .*{told}"):
        read_rig(tmp_path / "mine.toml")


def test_a_calibration_of_a_foreign_file_names_it_and_leaves_it(tmp_path: Path) -> None:
    path, trip = tmp_path / "mine.toml", {"latency.round_trip_s": Calibrated(0.02, 0.001, "s")}
    path.write_bytes("# Größe\n".encode("latin-1") + default_rig_text().encode())
    before = path.read_bytes()
    with pytest.raises(UnusableInput, match=r"mine\.toml: cannot be read as a rig file"):
        update_rig(path, trip, "2026-01-02")
    assert path.read_bytes() == before
    path.write_text(default_rig_text())
    with pytest.raises(UnusableInput, match=r"mine\.toml: not changed, .*bias_m = 7"):
        update_rig(path, {"range_sensor.bias_m": Calibrated(7.0, 0.1, "m")}, "2026-01-02")


def log_with(tmp_path: Path, records: bytes = b"", schema: str = "1") -> Path:
    """An MCAP run log without a tick, with some records before its end."""
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start()
    writer.add_metadata("wakedeploy.run", {"schema": schema})
    at = file.tell()
    writer.add_metadata("wakedeploy.end", {})
    writer.finish()
    whole = file.getvalue()
    path = tmp_path / "flight.mcap"
    path.write_bytes(whole[:at] + records + whole[at:])
    return path


def chunk(method: str, packed: bytes, stated: int) -> bytes:
    head = struct.pack("<QQQII", 0, 0, stated, 0, len(method)) + method.encode()
    content = head + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", CHUNK, len(content)) + content


def packed(method: str, plain: bytes) -> bytes:
    if method == "zstd":
        return zstandard.ZstdCompressor().compress(plain)
    return lz4.frame.compress(plain) if method == "lz4" else plain


@pytest.mark.parametrize("method", ["zstd", "lz4"])
def test_a_chunk_that_unpacks_to_more_than_a_log_is_not_unpacked(
    tmp_path: Path, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    unpacked = []
    monkeypatch.setattr(runlog_mcap, "_inside", lambda plain: unpacked.append(len(plain)) or ())
    for size in (1 << 26, 100):
        path = log_with(tmp_path, chunk(method, packed(method, bytes(size)), size))
        if size > 100:
            with pytest.raises(UnusableInput, match=r"flight\.mcap: is damaged after 0 ticks"):
                read_run_log(path)
        else:
            assert len(read_run_log(path)) == 0
    assert unpacked == [100]


@pytest.mark.parametrize(
    ("plain", "told"),
    [
        (bytes(9 * 1000), "ends within a record"),  # of no kind and no length, for ever
        (struct.pack("<BQ", 5, 2**63), "ends within a record"),
        (struct.pack("<BQ", 5, 10) + bytes(4), "ends within a record"),
    ],
)
def test_a_chunk_of_records_that_go_nowhere_is_refused(
    tmp_path: Path, plain: bytes, told: str
) -> None:
    with pytest.raises(UnusableInput, match=told):
        read_run_log(log_with(tmp_path, chunk("", plain, len(plain))))


@pytest.mark.parametrize("schema", ["9" * 5000, "٣", "²", ""])
def test_a_schema_that_is_no_number_of_ours_is_refused(tmp_path: Path, schema: str) -> None:
    with pytest.raises(UnusableInput, match=r"flight\.mcap: run log schema"):
        read_run_log(log_with(tmp_path, schema=schema))


def test_metadata_beside_a_log_that_are_nested_too_deeply_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("tick,t_s\n")
    (tmp_path / "a.meta.json").write_text("[" * 100_000)
    with pytest.raises(UnusableInput, match=r"a\.meta\.json: not readable as JSON"):
        read_run_log(tmp_path / "a.csv")


def test_a_set_of_an_array_without_an_axis_is_refused() -> None:
    row = np.zeros((5, 1), np.float32)
    with pytest.raises(ValueError, match="observation has shape"):
        Episode("a", np.array(0, np.float32), row)
    with pytest.raises(ValueError, match="observation has 0 samples"):
        Episode("a", row[:0], row[:0])


@pytest.mark.parametrize(
    "recordings",
    [
        {"train": {"files": 1, "independent": 1}},
        {split: {"files": 1} for split in ("train", "validation", "test")},
        {split: {"files": "x", "independent": None} for split in ("train", "validation", "test")},
        [],
    ],
)
def test_a_set_that_tells_some_of_its_recordings_is_shown_without(
    tmp_path: Path, recordings: object
) -> None:
    row = np.zeros((5, 1), np.float32)
    names = {"a": "train", "b": "validation", "c": "test"}
    episodes = tuple(Episode(name, row, row) for name in names)
    channel = (Channel("u", "N"),)
    told = {"recordings": recordings}
    made = EpisodeSet("toy", 1.0, channel, channel, 1.0, (1.0,), names, episodes, told)
    made.write(tmp_path / "set")
    shown = CliRunner().invoke(main, ["data", "show", str(tmp_path / "set")])
    assert shown.exit_code == 0, shown.output
    assert "independent" not in shown.output


@pytest.mark.parametrize("value", ["1e308", "1" + "0" * 400, "-1e308"])
def test_a_constant_too_large_for_its_own_unit_is_refused(tmp_path: Path, value: str) -> None:
    in_tonnes = f"mass_kg = {{ value = {value}, unit = 'Mg' }}"
    text = default_rig_text().replace("mass_kg = 0.45", in_tonnes)
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(UnusableInput, match=r"mine\.toml: sufferer\.mass_kg = -?inf"):
        read_rig(tmp_path / "mine.toml")


def test_names_in_a_log_do_not_steer_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("click.utils.should_strip_ansi", lambda *_, **__: False)  # as at a terminal
    row = "tick,t_s,range_m,range_age_s,steps,source_cmd_us,sufferer_cmd_us,mode,faults,\x1b[2J{}\n"
    rows = (f"{i},{i / 32},0.1,0.01,0,1000,1000,ARMED,\x1b[2Jlost,\n" for i in range(3))
    (tmp_path / "a.csv").write_text(row.format("x" * 2000) + "".join(rows))
    shown = CliRunner().invoke(main, ["log", "show", str(tmp_path / "a.csv"), "--no-picture"])
    assert shown.exit_code == 0, shown.output
    assert shown.output.count(r"\x1b[2J") == 2
    assert "\x1b" not in shown.output
    assert max(map(len, shown.output.splitlines())) < 1500


def test_a_rig_file_that_has_no_end_is_refused() -> None:
    with pytest.raises(UnusableInput, match=r"/dev/zero: .*larger than 64 MiB"):
        read_rig(Path("/dev/zero"))


def test_no_frame_is_shorter_than_nothing(tmp_path: Path) -> None:
    text = default_rig_text().replace("[disturbance]", "[disturbance]\nesc_frame_s = -0.0")
    (tmp_path / "mine.toml").write_text(text)
    rig = read_rig(tmp_path / "mine.toml")
    assert math.copysign(1.0, rig.disturbance.esc_frame_s) == 1.0
    frame = "\n[[effect]]\nname = 'esc-frame'\nparameters.frame_s = { value = -0.0, unit = 's' }\n"
    (tmp_path / "mine.toml").write_text(default_rig_text() + frame)
    GantryPlant(read_rig(tmp_path / "mine.toml"), seed=0)
