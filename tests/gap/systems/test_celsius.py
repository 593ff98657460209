"""Degrees Celsius all the way: no factor leads from them to kelvin, and none is asked for."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import wakedeploy as wd
from wakedeploy.cli import main

ROOM = """
from wakedeploy import Constant, Input, Output, Port, System


class Room(System):
    rate_hz = 1.0
    inputs = [Input("heater_w", "W"), Input("outside_degc", "°C", is_commanded=False)]
    states = {"room_degc": "°C"}
    outputs = [Output("room_degc", "°C", noise=0.02)]
    constants = [Constant("lost_w_per_k", 5.0, spread=0.01, unit="W/K"),
                 Constant("stored_j_per_k", 200.0, spread=0.5, unit="J/K")]
    ports = [Port.output("room_degc", kinds=["sensor-bias", "sensor-gain"]),
             Port.input("heater_w", kinds=["lag"])]

    def derivative(self, state, inputs, c):
        lost = c.lost_w_per_k * (state.room_degc - inputs.outside_degc)
        return {"room_degc": (inputs.heater_w - lost) / c.stored_j_per_k}
"""
COLUMNS = """version = 1
[time]
column = "t"
unit = "s"
[columns.heater_w]
column = "heater [W]"
role = "input"
unit = "W"
[columns.outside_degc]
column = "outside [°C]"
role = "input"
unit = "degC"
[columns.room_degc]
column = "room [°C]"
role = "output"
unit = "°C"
"""
BIAS = 1.5  # degrees by which the sensor shows too much
NAME = "sensor-bias@room_degc"


def logged(seed: int) -> np.ndarray:
    """Seconds, watts and degrees of a room that is heated in jumps, stepped exactly."""
    random = np.random.default_rng(seed)
    heater = np.repeat(random.uniform(0.0, 100.0, 16), 50)
    outside = 5.0 + np.cumsum(0.05 * random.standard_normal(len(heater)))
    keep, room, rows = math.exp(-5.0 / 200.0), 12.0, []
    for k, (watts, cold) in enumerate(zip(heater, outside, strict=True)):
        rows.append((k, watts, cold, room + BIAS + 0.02 * random.standard_normal()))
        room = keep * room + (1.0 - keep) * (cold + watts / 5.0)
        room += 0.005 * random.standard_normal()
    return np.array(rows)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("room")
    (path / "room.py").write_text(ROOM, "utf-8")
    (path / "columns.toml").write_text(COLUMNS, "utf-8")
    for seed in (0, 1):
        with (path / f"{seed}.csv").open("w", encoding="utf-8") as file:
            np.savetxt(file, logged(seed), "%.9g", ",",
                       header="t,heater [W],outside [°C],room [°C]", comments="")  # fmt: skip
    return path


@pytest.mark.whole
def test_a_thermometer_s_bias_is_named_in_degrees_and_taken_off(place: Path) -> None:
    out = place / "gap"
    given = ["--system", str(place / "room.py"), "--columns", str(place / "columns.toml")]

    def told(step: str, log: int, *words: str) -> str:
        command = ["gap", step, *given, "--measured", str(place / f"{log}.csv"), *words]
        ended = CliRunner().invoke(main, command, catch_exceptions=False)
        assert ended.exit_code == 0, ended.output
        assert "check `unit`" not in ended.stderr
        return ended.stdout

    seen = told("check", 0)
    assert "output room_degc: " in seen
    assert "is its unit right" not in seen
    said = told("close", 0, "--out", str(out))
    gap = wd.Gap.read(out)
    assert gap.effects == (NAME,)
    (size,) = gap.result.effects[0].parameters.values()
    assert size.unit == "°C"
    assert size.low <= BIAS <= size.high
    assert size.high - size.low < 0.3 * BIAS
    assert f"{size.value:.3g} °C" in said
    (effect,) = tomllib.loads((out / "correction.toml").read_text("utf-8"))["effect"]
    assert effect["name"] == NAME
    replay = told("simulate", 1, "--correction", str(out / "correction.toml"))
    row = next(line for line in replay.splitlines() if "room_degc" in line)
    without, after, unit = (cell.strip() for cell in row.strip("│ ").split("│")[2:5])
    assert unit == "°C"
    assert float(after) < 0.3 * float(without)
