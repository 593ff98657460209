"""Clocks that are wrong, apart, late or set back: refused with what helps, shifted, or split."""

import re
from pathlib import Path

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.reading import Reading, read_recordings

TIME = 'version = 1\n[time]\ncolumn = "t"\n'
U = '[columns.u]\ncolumn = "u"\nrole = "input"\nunit = "V"\n'
Q = '[columns.q]\ncolumn = "q"\nrole = "output"\nunit = "rad"\n'
RATE = "[resample]\nrate_hz = 100\n"
GAP = "[split]\ngap_s = 0.5\n"


def read(path: Path, text: str) -> Reading:
    return read_recordings([path], parse_columns(text))


def two_clocks(folder: Path, start_s: float) -> Path:
    """A command from 0 s on, and a sensor whose clock shows `start_s` then; 5 s at 100 Hz."""
    run = folder / "run"
    run.mkdir()
    t = np.arange(500) / 100
    for name, stamps, column in (("cmd", t, "u"), ("arm", start_s + t, "q")):
        table = np.column_stack([stamps, np.sin(t)])
        np.savetxt(run / f"{name}.csv", table, "%.6f", ",", header=f"t,{column}", comments="")
    return run


FILES = U + 'file = "cmd.csv"\n' + Q + 'file = "arm.csv"\n'


@pytest.mark.parametrize("more", [RATE, RATE + GAP, GAP, GAP + "shortest_s = 1\n"])
@pytest.mark.parametrize("unit", ["ms", "ns"])
def test_a_unit_of_time_that_is_wrong_is_said_whatever_else_is_asked_for(
    unit: str, more: str, tmp_path: Path
) -> None:
    """Microseconds read as milliseconds tear each sample from the next; as nanoseconds, too few."""
    if (unit, more) == ("ns", GAP):
        return  # a log of 10 ms at 100 kHz: the system's rate refuses it
    path = tmp_path / "log.csv"
    k = np.arange(1000)
    np.savetxt(path, np.column_stack([10_000 * k, np.sin(k)]), "%d", ",", header="t,u", comments="")
    lasts_s = {"ms": "9990", "ns": "0.00999"}[unit]
    said = f"column 't' .* lasts {lasts_s} s, and .*; if it did not last {lasts_s} s, the time's"
    with pytest.raises(UnusableInput, match=f"{said} unit is wrong: it is '{unit}'; correct unit"):
        read(path, TIME + f'unit = "{unit}"\n' + more + U)
    (one,) = read(path, TIME + 'unit = "us"\n' + more + U).recordings
    assert one.rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize("start_s", [37_000.0, -37_000.0, 1.7e9])
@pytest.mark.parametrize("more", [RATE, RATE + GAP])
def test_clocks_apart_are_named_and_shifted_as_advised(
    start_s: float, more: str, tmp_path: Path
) -> None:
    folder = two_clocks(tmp_path, start_s)
    with pytest.raises(UnusableInput) as told:
        read(folder, TIME + more + FILES)
    late, early = ("q", "u") if start_s > 0 else ("u", "q")
    assert f"column '{late}' begins at" in str(told.value)
    assert f"when '{early}' has ended" in str(told.value)
    (shift,) = re.findall(rf"\[columns.{late}\]: (shift_s = -?[\d.e+]+)", str(told.value))
    entry = FILES.replace(f'column = "{late}"', f'column = "{late}"\n{shift}')
    (one,) = read(folder, TIME + more + entry).recordings
    np.testing.assert_array_equal(one.columns["u"], one.columns["q"])


def test_two_clocks_in_one_table_are_apart_and_not_silent(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k / 100},{k}," for k in range(500)] + [f"{37000 + k / 100},,{k}" for k in range(500)]
    path.write_text("\n".join(["t,u,q", *rows]) + "\n", "utf-8")
    for missing in ('missing = "hold"\n', 'missing = "split"\n'):
        with pytest.raises(
            UnusableInput, match=r"'q' begins at 37000 s, when 'u' has ended at 4.99 s"
        ):
            read(path, TIME + RATE + U + missing + Q + missing)
    held = 'missing = "hold"\n'
    text = TIME + RATE + U + held + Q + held + "shift_s = -37000\n"
    (one,) = read(path, text).recordings
    np.testing.assert_array_equal(one.columns["u"], one.columns["q"])


def test_columns_that_have_little_in_common_are_remarked_on(tmp_path: Path) -> None:
    folder = two_clocks(tmp_path, 4.0)
    (note,) = read(folder, TIME + RATE + FILES).notes
    assert "'q': begins 4 s after 'u', and both cover only 0.99 s" in note
    assert note.endswith("if their clocks differ, give shift_s in [columns.q]")


def test_a_sensor_that_is_known_to_be_late_is_shifted_to_its_time(tmp_path: Path) -> None:
    t = np.arange(500) / 100
    path = tmp_path / "log.npz"
    np.savez(path, t=t, u=np.sin(t), q=np.sin(t - 0.08))
    (one,) = read(path, TIME + RATE + U + Q + "shift_s = -0.08\n").recordings
    np.testing.assert_allclose(one.columns["q"], one.columns["u"], atol=1e-12)
    with pytest.raises(UnusableInput, match=r"'q' has another clock than 'u'; give \[resample\]"):
        read(path, TIME + U + Q + "shift_s = -0.08\n")
    for bad in ("1e11", "nan", '"late"'):
        with pytest.raises(UnusableInput, match=r"columns\.q\.shift_s"):
            read(path, TIME + RATE + U + Q + f"shift_s = {bad}\n")
