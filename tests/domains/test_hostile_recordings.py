"""Recordings that somebody forged: refused with file and reason, at no cost of memory."""

import gzip
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from benchmarks.fuzz.archives import deflated
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains import matfile, motor
from wakedeploy.domains.crazyflie import import_set

HEAD = "Timestamp,RPM,Duty,Batt. Volts\n"
ROW = "2020-01-01 00:00:00:000,{},2,3\n"


@pytest.mark.parametrize("cell", ["inf", "nan", "1e300"])
def test_an_esc_log_holds_measurements(tmp_path: Path, cell: str) -> None:
    (tmp_path / "bad.csv").write_text(HEAD + 5 * ROW.format(cell))
    with pytest.raises(UnusableInput, match=r"bad\.csv: a row is damaged"):
        motor.read_steps(tmp_path)


def test_an_esc_log_without_a_record_is_told(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text(HEAD)
    with pytest.raises(UnusableInput, match=r"empty\.csv: holds no record"):
        motor.read_steps(tmp_path)


@pytest.mark.parametrize(
    "content",
    [
        gzip.compress(HEAD.encode(), mtime=0)[:-12],
        gzip.compress(HEAD.encode(), mtime=0)[:12] + b"\xff" * 30,
        b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\xff" + deflated(b"Timestamp\n", 1 << 30),
        gzip.compress(b'"' + b"a" * 200_000, mtime=0),
    ],
    ids=["cut", "damaged", "endless", "one cell"],
)
def test_a_packed_esc_log_that_is_damaged_or_endless_is_refused(
    tmp_path: Path, content: bytes
) -> None:
    (tmp_path / "bad.csv.gz").write_bytes(content)
    with pytest.raises(UnusableInput, match=r"bad\.csv\.gz: cannot be read"):
        motor.read_steps(tmp_path)


def mat_bomb(zeros: int) -> bytes:
    """A MATLAB file of one packed element that takes so many bytes unpacked."""
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01" + b"IM"
    content = b"\x78\x9c" + deflated(struct.pack("<II", 14, zeros), zeros)
    content += struct.pack(">I", zlib.adler32(b""))
    return header + struct.pack("<II", 15, len(content)) + content


def test_a_matlab_file_is_unpacked_no_further_than_a_recording_goes(tmp_path: Path) -> None:
    (tmp_path / "x.mat").write_bytes(mat_bomb(1 << 30))
    with pytest.raises(ValueError, match="more than 128 MiB unpacked"):
        matfile.read_mat(tmp_path / "x.mat")


def test_all_variables_of_a_matlab_file_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for packed in (False, True):
        savemat(tmp_path / "x.mat", {n: np.zeros((1, 100)) for n in "abc"}, do_compression=packed)
        monkeypatch.setattr(matfile, "MOST_BYTES", 3 * 1000)
        assert len(matfile.read_mat(tmp_path / "x.mat")) == 3
        monkeypatch.setattr(matfile, "MOST_BYTES", 2 * 1000)
        with pytest.raises(ValueError, match="unpacked"):
            matfile.read_mat(tmp_path / "x.mat")
    small = np.zeros((1, 1000), np.int8)  # eight times as large as numbers
    savemat(tmp_path / "x.mat", {"a": small})
    with pytest.raises(ValueError, match="MiB"):
        matfile.read_mat(tmp_path / "x.mat")


def test_an_archive_that_asks_for_more_than_it_holds_is_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "swap_sl_00.npz", t=np.zeros(3))
    whole = (tmp_path / "swap_sl_00.npz").read_bytes()
    changed = whole.replace(b"'shape': (3,), }", b"'shape': (3333333333,), }"[:16])
    assert changed != whole
    (tmp_path / "swap_sl_00.npz").write_bytes(changed)
    with pytest.raises(UnusableInput, match=r"swap_sl_00\.npz: cannot be read"):
        import_set(tmp_path)
