"""A robot that turns on: in its logs the angle goes on, and a model that stops it is named."""

from pathlib import Path

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.api.systems import recordings_of
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.simulation import replay_error
from wakedeploy.gap.systems.wrapped_angles import own_wraps

TIME_S = np.arange(600) / 20.0
RATE = 1.0 + 0.5 * np.sin(0.7 * TIME_S)
HEADING = np.concatenate([[0.0], np.cumsum(RATE[:-1]) / 20.0])


class Turning(System):
    """A base that turns as it is told."""

    rate_hz = 20.0
    inputs = [Input("rate_radps", "rad/s")]
    states = {"yaw_rad": "rad"}
    outputs = [Output("yaw_rad", "rad", noise=0.01)]
    constants = [Constant("gain", 1.0, spread=0.1)]
    ports = [Port.input("rate_radps")]

    def derivative(self, state, inputs, c):
        return {"yaw_rad": c.gain * inputs.rate_radps}


class Compass(Turning):
    """It shows degrees, from the north on and only once."""

    outputs = [Output("compass", "deg", noise=0.5)]

    def measure(self, state, inputs, c):
        return {"compass": np.rad2deg(np.mod(state.yaw_rad, 2.0 * np.pi))}

    def start(self, measured):
        return {"yaw_rad": np.deg2rad(measured.compass)}


class Onward(Compass):
    """The same, which goes on."""

    def measure(self, state, inputs, c):
        return {"compass": np.rad2deg(state.yaw_rad)}


class Near(Onward):
    """It knows no angle far away, and takes arrays together."""

    def measure(self, state, inputs, c):
        both = np.stack([state.yaw_rad, inputs.rate_radps])
        if np.any(np.abs(both) > 5.0):
            raise ValueError("far away")
        return {"compass": np.rad2deg(both[0])}


class Stepping(System):
    """It keeps its state within a turn."""

    rate_hz = 20.0
    inputs, states, outputs = Turning.inputs, Turning.states, Turning.outputs
    constants, ports = Turning.constants, Turning.ports

    def step(self, state, inputs, c):
        angle = state.yaw_rad + c.gain * inputs.rate_radps / 20.0
        return {"yaw_rad": np.arctan2(np.sin(angle), np.cos(angle))}


def begun_again(angle: np.ndarray) -> np.ndarray:
    return np.arctan2(np.sin(angle), np.cos(angle))


def recording(**columns: np.ndarray) -> Recording:
    return Recording("turns", TIME_S, {"rate_radps": RATE, **columns})


def refuse(sentence: str) -> None:
    raise AssertionError(sentence)


def test_a_plain_log_goes_on_and_the_replay_with_it(tmp_path: Path) -> None:
    path = tmp_path / "turns.csv"
    rows = np.column_stack([TIME_S, RATE, begun_again(HEADING)])
    np.savetxt(path, rows, delimiter=",", header="time_s,rate_radps,yaw_rad", comments="")
    told: list[str] = []
    (read,) = recordings_of([path], None, Turning(), told.append)
    np.testing.assert_allclose(read.columns["yaw_rad"], HEADING, atol=1e-9)
    assert told == [
        "turns: yaw_rad unwrapped at 5 places; a columns.toml with wraps = false keeps it as it is"
    ]
    assert replay_error(Turning(), read)["yaw_rad"] < 1e-3  # from a smoothed start


def test_of_a_recording_the_jump_is_said_and_nothing_is_changed() -> None:
    given = recording(yaw_rad=begun_again(HEADING))
    told: list[str] = []
    (read,) = recordings_of([given], None, Turning(), told.append)
    assert read is given
    assert told == [
        "turns: yaw_rad jumps by a turn at 5 places, which counts as motion; let it go on"
        " (np.unwrap)"
    ]
    recordings_of([recording(yaw_rad=HEADING)], None, Turning(), refuse)


def test_a_log_by_its_columns_goes_on(tmp_path: Path) -> None:
    path, columns = tmp_path / "log.csv", tmp_path / "columns.toml"
    rows = np.column_stack([TIME_S, RATE, np.rad2deg(np.mod(HEADING, 2 * np.pi))])
    np.savetxt(path, rows, delimiter=",", header="t,rate,heading", comments="")
    text = 'version = 1\n[time]\ncolumn = "t"\n[columns.rate_radps]\ncolumn = "rate"\n'
    text += 'role = "input"\nunit = "rad/s"\n[columns.yaw_rad]\ncolumn = "heading"\n'
    columns.write_text(text + 'role = "output"\nunit = "deg"\n')
    told: list[str] = []
    (read,) = recordings_of([path], columns, Turning(), told.append)
    np.testing.assert_allclose(read.columns["yaw_rad"], HEADING, atol=1e-9)
    assert len(told) == 1
    assert "unwrapped at" in told[0]
    columns.write_text(columns.read_text() + "wraps = false\n")
    (kept,) = recordings_of([path], columns, Turning(), refuse)
    np.testing.assert_allclose(kept.columns["yaw_rad"], np.mod(HEADING, 2 * np.pi), atol=1e-9)


@pytest.mark.parametrize(
    ("system", "column", "values", "says"),
    [
        (Turning(), "yaw_rad", HEADING, ""),
        (Onward(), "compass", np.rad2deg(HEADING), ""),
        (Near(), "compass", np.rad2deg(np.sin(TIME_S)), ""),
        (Compass(), "compass", np.rad2deg(HEADING), "Compass.measure begins compass again"),
        (Compass(), "compass", np.rad2deg(np.mod(HEADING, 2 * np.pi)), "Compass.measure begins"),
        (Compass(), "compass", 100.0 + 90.0 * np.sin(TIME_S), ""),  # the log does not go so far
        (Stepping(), "yaw_rad", HEADING, "Stepping.step begins yaw_rad again"),
        (Stepping(), "yaw_rad", np.sin(TIME_S), ""),
    ],
)
def test_a_system_that_begins_its_angle_again_is_named(system, column, values, says) -> None:
    notes = own_wraps(LogModel(system, [recording(**{column: values})]))
    assert [says in note for note in notes] == ([True] if says else [])
    if says:
        assert "to 360 deg, and" in notes[0] or "3.14 to 3.14 rad, and" in notes[0]
