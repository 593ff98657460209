"""Commands that stand in one row of a log act late or soon together; other inputs do not."""

from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, Recording, System
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.reading import read_recordings
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.answers.folder import OwnFolder
from wakedeploy.gap.systems.correction import Correction, correction_of
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE_HZ, FINE = 50.0, 10


class Raft(System):
    """Two thrusters on a raft, one of them heavier; wind is measured, and a law sums both."""

    rate_hz = RATE_HZ
    inputs: ClassVar = [
        Input("left_n", "N"),
        Input("wind_n", "N", is_commanded=False),
        Input("right_n", "N"),
        Input("both_n", "N", law=lambda inputs: inputs.left_n + 2.0 * inputs.right_n),
    ]
    states: ClassVar = {"speed_mps": "m/s"}
    outputs: ClassVar = [Output("speed_mps", "m/s", noise=2e-3)]
    constants: ClassVar = [Constant("mass_kg", 0.5, 0.02), Constant("drag", 4.0, 0.2, "N s/m")]
    ports: ClassVar = [
        Port.force("speed_mps", inertia="mass_kg"),
        Port.input("both_n"),
        Port.input("left_n"),
    ]

    def derivative(self, state, inputs, c):
        force = inputs.both_n + inputs.wind_n - c.drag * state.speed_mps
        return {"speed_mps": force / c.mass_kg}


def raft(late, clocks=None, samples=600, left_later=0.0):
    """It, with commands that act by a part of a sample after their rows, the left one by more."""
    rng = np.random.default_rng(3)
    left, right, wind = (np.repeat(rng.standard_normal(samples // 3), 3) for _ in range(3))
    finely = [np.repeat(row, FINE) for row in (left, right, wind)]
    shifts = round(FINE * (late + left_later)), round(FINE * late)
    acting = [
        np.concatenate([np.full(shift, row[0]), row])[: len(row)]
        for shift, row in zip(shifts, finely, strict=False)
    ]
    speed, shown = 0.0, np.zeros(samples)
    kept = np.exp(-4.0 / 0.5 / RATE_HZ / FINE)
    for k in range(samples * FINE):
        if k % FINE == 0:
            shown[k // FINE] = speed
        force = acting[0][k] + 2.0 * acting[1][k] + finely[2][k]
        speed = kept * speed + (1.0 - kept) * force / 4.0
    columns = {"left_n": left, "right_n": right, "wind_n": wind}
    columns["speed_mps"] = shown + 2e-3 * rng.standard_normal(samples)
    return Recording("raft", np.arange(samples) / RATE_HZ, columns, clocks=clocks or {})


def clocks_of(model):
    return [f.name for f in model.free(()) if f.name.startswith("clock.")]


def test_one_row_has_one_clock_and_what_is_measured_another() -> None:
    model = LogModel(Raft(), [raft(0.0)])
    assert clocks_of(model) == ["clock.left_n", "clock.wind_n"]
    assert model.clocked("right_n") == "left_n"
    assert model.clocked("both_n") == "left_n"  # made of two that share one


def test_columns_of_two_clocks_have_two() -> None:
    apart = {"left_n": "a.csv:t", "right_n": "b.csv:t", "wind_n": "a.csv:t"}
    model = LogModel(Raft(), [raft(0.0, apart)])
    assert clocks_of(model) == ["clock.left_n", "clock.wind_n", "clock.right_n"]
    assert model.clocked("both_n") == ""
    together = {"left_n": "a.csv:t", "right_n": "a.csv:t", "wind_n": "b.csv:t"}
    one_of_two = LogModel(Raft(), [raft(0.0, together), raft(0.0, apart)])
    assert len(clocks_of(one_of_two)) == 3


def test_the_shift_of_a_row_is_found_and_stands_beside_each_of_its_commands() -> None:
    late = 0.4
    model = LogModel(Raft(), [raft(late)])
    found = fit(model, ("offset@speed_mps",), range(model.episodes))
    assert found.value("clock.left_n") == pytest.approx(late / RATE_HZ, abs=0.05 / RATE_HZ)
    shifted = model.shifted_inputs(found)
    assert set(shifted) == {"left_n", "right_n"}
    clocks_s = correction_of(model, found).document.clocks_s
    assert clocks_s["left_n"] == clocks_s["right_n"] == found.value("clock.left_n")
    assert abs(clocks_s["wind_n"]) < 0.05 / RATE_HZ


def test_a_correction_shifts_each_input_by_its_own_number_whatever_log_is_replayed() -> None:
    """Also one from logs with two clocks, along a recording that has one."""
    model = LogModel(Raft(), [raft(0.0)])
    fitted = fit(model, ("offset@speed_mps",), range(model.episodes))
    kept = correction_of(model, fitted).document
    shifts = {"left_n": -0.009, "right_n": 0.009, "wind_n": 0.0}
    apart = {"left_n": "a", "right_n": "b", "wind_n": "a"}
    shown = []
    for clocks_s in (shifts, {**shifts, "right_n": -0.009}):
        system = Raft()
        system.correction = Correction(kept.model_copy(update={"clocks_s": clocks_s}))
        one, two = (system.simulate(raft(0.0, clocks))["speed_mps"] for clocks in ({}, apart))
        np.testing.assert_array_equal(one, two)
        shown.append(one)
    assert np.abs(shown[0] - shown[1]).max() > 0.05


def test_a_named_delay_is_not_told_once_more_as_the_shift_of_its_row() -> None:
    model = LogModel(Raft(), [raft(0.4, left_later=2.0)])
    found = fit(model, ("dead-time@left_n",), range(model.episodes))
    late = found.value("dead-time@left_n.delay_s") + found.value("clock.left_n")
    assert late == pytest.approx(2.4 / RATE_HZ, abs=0.05 / RATE_HZ)
    assert set(model.shifted_inputs(found)) == {"right_n"}


def test_a_folder_of_logs_with_other_clocks_is_another_one_s(tmp_path: Path) -> None:
    apart = {"left_n": "a", "right_n": "b", "wind_n": "a"}
    one, two = (LogModel(Raft(), [raft(0.0, clocks)]) for clocks in ({}, apart))
    assert OwnFolder(one, tmp_path).key != OwnFolder(two, tmp_path).key
    assert OwnFolder(one, tmp_path).key == OwnFolder(LogModel(Raft(), [raft(0.0)]), tmp_path).key


def test_a_table_s_rows_say_which_columns_share_a_clock(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    t = np.arange(100) / RATE_HZ
    for name, columns in (("cmd", "left,right"), ("imu", "wind,speed")):
        np.savetxt(run / f"{name}.csv", np.column_stack([t, np.sin(t), np.cos(t)]), "%.6f", ",",
                   header=f"t,{columns}", comments="")  # fmt: skip
    text = 'version = 1\n[time]\ncolumn = "t"\n'
    for file, name, role in (("cmd", "left", "input"), ("cmd", "right", "input"),
                             ("imu", "wind", "input"), ("imu", "speed", "output")):  # fmt: skip
        text += f'[columns.{name}]\nfile = "{file}.csv"\ncolumn = "{name}"\nrole = "{role}"\n'
        text += 'unit = "1"\n'
    (recording,) = read_recordings([run], parse_columns(text)).recordings
    clocks = recording.clocks
    assert clocks["left"] == clocks["right"] != clocks["wind"] == clocks["speed"]
