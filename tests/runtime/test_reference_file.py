"""Reference files: written and read back, refused with one sentence, and flown."""

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.reference import FlightPlan, hold_plan
from runtime.reference_file import read_reference, write_reference
from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.2})


def smooth(t_s, start_s, length_s):
    s = np.clip((t_s - start_s) / length_s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def table(rate_hz=32.0, seconds=8.0):
    """Columns of a flight that the rig can fly: up, across the jet and back, down."""
    t_s = np.arange(0.0, seconds + 0.5 / rate_hz, 1.0 / rate_hz)
    z_m = 0.5 * (smooth(t_s, 0.2, 2.0) - smooth(t_s, seconds - 2.2, 2.0))
    x_m = 0.2 * (smooth(t_s, 2.0, 1.5) - smooth(t_s, 4.0, 1.5))
    source_us = 1000.0 + 500.0 * (smooth(t_s, 0.5, 0.5) - smooth(t_s, seconds - 1.0, 0.5))
    return t_s, z_m, x_m, source_us


def write(path, columns, names=("t_s", "z_m", "x_m", "source_us")):
    rows = [",".join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(["# a comment", ",".join(names), *rows]) + "\n")
    return path


def test_a_plan_comes_back_as_it_was_written(tmp_path) -> None:
    plan = hold_plan(RIG, 12.0, 0.6, 1400.0)
    padded = FlightPlan(*(np.append(c, c[0]) for c in (plan.z_m, plan.x_m, plan.source_us)))
    path = tmp_path / "hold.csv"
    write_reference(path, padded, RIG, "hold")
    back = read_reference(path, RIG)
    for name in ("z_m", "x_m", "source_us"):
        np.testing.assert_allclose(getattr(back, name), getattr(padded, name), atol=1e-3)
    assert f"rig_sha256 = {RIG.sha256}" in path.read_text()
    assert path.read_text().startswith("# wakedeploy reference: hold\n")


@settings(max_examples=8, deadline=None)
@given(rate_hz=st.floats(8.0, 200.0))
def test_another_rate_is_brought_to_the_loops(tmp_path_factory, rate_hz: float) -> None:
    path = write(tmp_path_factory.mktemp("rate") / "a.csv", table(rate_hz))
    plan, at_32 = read_reference(path, RIG), table()
    ticks = min(len(plan), len(at_32[0]))
    assert ticks >= 8 * 32 - 4
    np.testing.assert_allclose(plan.z_m[:ticks], at_32[1][:ticks], atol=5e-3)
    np.testing.assert_allclose(plan.x_m[:ticks], at_32[2][:ticks], atol=5e-3)


def spoilt(column, value, where=slice(100, 104)):
    columns = [np.array(c) for c in table()]
    columns[column][where] = value
    return columns


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (spoilt(1, 1.3), "z_m is 1.3 m"),
        (spoilt(1, 0.9), "the sufferer's thrust"),
        (spoilt(2, 0.8), "limits.x_m allows -0.6 to 0.6 m"),
        (spoilt(2, 0.3), "stepper.max_speed_mps"),
        ([*table()[:2], 2.4 * table()[2], table()[3]], "the carriage's speed"),
        (spoilt(3, 2100.0), "source_us is 2100 µs"),
        (spoilt(3, 500.0), "limits.pulse_us"),
        (spoilt(0, 1.0, 5), "line 9: t_s = 0.1875 comes after 1"),
        (spoilt(0, 0.125, 5), "time must rise"),
        (spoilt(0, np.nextafter(0.125, 1.0), 5), "by 0.0001 s or more"),
        (spoilt(1, 1e308), "line 103: 4 finite numbers are needed in every row, none beyond 1e+06"),
        (spoilt(2, np.inf), "none beyond"),
        (spoilt(1, 0.2, slice(0, 3)), "must begin at rest"),
        (spoilt(1, 0.2, slice(-3, None)), "must end at rest"),
        (spoilt(3, 1300.0, -1), "source_us ends at 1300 instead of 1000"),
        ([c[:1] for c in table()], "holds a single row; a reference needs at least two"),
        ([c[:5] for c in table()], "lasts 0.125 s"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_one_sentence(tmp_path, columns, said) -> None:
    path = write(tmp_path / "reference.csv", columns)
    with pytest.raises(UnusableInput) as refused:
        read_reference(path, RIG)
    sentence = str(refused.value)
    assert sentence.startswith(str(path))
    assert said in sentence
    assert sentence.count("\n") == 0


def test_a_carriage_that_starts_too_hard_is_refused(tmp_path) -> None:
    t_s, z_m, x_m, source_us = table()
    x_m = 0.14 * (smooth(t_s, 2.0, 0.6) - smooth(t_s, 4.0, 0.6))  # 0.44 m/s, 2.2 m/s²
    path = write(tmp_path / "reference.csv", (t_s, z_m, x_m, source_us))
    with pytest.raises(UnusableInput, match="acceleration is 2"):
        read_reference(path, RIG)


def test_a_step_of_the_source_faster_than_the_slew_is_refused(tmp_path) -> None:
    slow = RIG.changed(limits={"slew_us_per_s": 3000.0})
    path = write(tmp_path / "reference.csv", spoilt(3, 1700.0))
    with pytest.raises(UnusableInput, match="slew_us_per_s"):
        read_reference(path, slow)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "none"),
        ("t_s,z_m,x_m\n0,0,0\n1,0,0\n", "the columns of a reference are t_s, z_m, x_m, source_us"),
        ("t_s,z_m,x_m,source_us\n0,0,0,1000\n1,0,zero,1000\n", "line 3"),
        ("t_s,z_m,x_m,source_us\n0,0,0,1000\n1,0,nan,1000\n", "four|4 finite"),
        ("t_s,z_m,x_m,source_us\n0,0,0,1000\n1,0,0\n", "4 finite"),
    ],
)
def test_what_is_no_reference_is_refused(tmp_path, text, said) -> None:
    path = tmp_path / "reference.csv"
    path.write_text(text)
    with pytest.raises(UnusableInput, match=said):
        read_reference(path, RIG)


def test_a_file_that_is_not_there_is_one_sentence(tmp_path) -> None:
    with pytest.raises(UnusableInput, match="cannot be read as a reference"):
        read_reference(tmp_path / "missing.csv", RIG)


def test_the_virtual_gantry_flies_a_reference(tmp_path) -> None:
    rig_file, reference, log = (tmp_path / n for n in ("rig.toml", "up.csv", "flight.mcap"))
    RIG.write(rig_file)
    columns = table(seconds=6.0)
    write(reference, columns)
    asked = ("--baseline", "--virtual", "--rig", rig_file, "--reference", reference, "--log", log)
    flown = CliRunner().invoke(main, ["run-gantry", *map(str, asked)])
    assert flown.exit_code == 0, flown.output
    recorded = read_run_log(log)
    flying = np.flatnonzero(recorded.flying)  # and touches down where the reference ends
    assert len(flying) >= len(columns[0])
    flying = flying[: len(columns[0])]
    np.testing.assert_allclose(recorded["z_ref_m"][flying], columns[1], atol=1e-4)
    np.testing.assert_allclose(recorded["source_cmd_us"][flying], columns[3], atol=0.1)
    assert np.std(recorded["true_z_m"][flying] - columns[1]) < 0.05
    assert len(recorded.metadata["reference_sha256"]) == 64


def test_seconds_beside_a_reference_are_refused(tmp_path) -> None:
    write(tmp_path / "up.csv", table())
    asked = ["--baseline", "--virtual", "--seconds", "20", "--reference", str(tmp_path / "up.csv")]
    told = CliRunner().invoke(main, ["run-gantry", *asked])
    assert told.exit_code == 2
    assert "--seconds belongs to the random plan" in told.stderr
