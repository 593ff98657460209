"""Logs as recordings from Python: warnings say what was handled."""

from typing import ClassVar

import numpy as np
import pytest

import wakedeploy as wd

COLUMNS = """version = 1
[time]
column = "t"
[resample]
rate_hz = 100
[columns.angle_rad]
column = "a"
role = "output"
unit = "rad"
"""


def test_a_caller_is_warned_of_a_sensor_that_fell_silent(tmp_path) -> None:
    stamps = [k / 100 for k in range(400) if not 200 < k < 250]
    log, columns = tmp_path / "log.csv", tmp_path / "columns.toml"
    log.write_text("t,a\n" + "\n".join(f"{t},{t}" for t in stamps) + "\n")
    columns.write_text(COLUMNS)
    with pytest.warns(UserWarning, match=r"silent for 0\.5 s and less; .* not measured") as told:
        (recording,) = wd.read_log(log, columns)
    assert told[0].filename == __file__
    assert np.isnan(recording.columns["angle_rad"][210:240]).all()


def test_a_log_that_is_not_there_is_a_wrong_path(tmp_path) -> None:
    columns = tmp_path / "columns.toml"
    columns.write_text(COLUMNS)
    for read in (wd.import_table, wd.read_log):
        with pytest.raises(wd.UnusableInput, match=r"lgo\.csv: is not there; correct the path"):
            read(tmp_path / "lgo.csv", columns)


def test_a_pattern_for_a_path_is_told_as_one(tmp_path) -> None:
    with pytest.raises(wd.UnusableInput, match=r"run\*\.csv: is not there.* give sorted\(Path\(\)"):
        wd.read_log(tmp_path / "run*.csv", columns=tmp_path / "columns.toml")


def test_a_unit_for_a_column_that_is_not_there_is_never_ignored(tmp_path) -> None:
    log, columns = tmp_path / "log.csv", tmp_path / "columns.toml"
    log.write_text("t,a\n" + "\n".join(f"{k / 100},{k}" for k in range(99)) + "\n")
    columns.write_text(COLUMNS)
    for units, says in (
        ({"angel_rad": "deg"}, r"'angel_rad' is no column of a role; did you mean angle_rad\?"),
        ({"angle_rad": 3}, r"^units has 3 for angle_rad: give text\.$"),
        ("deg", r"^units is 'deg': give {NAME: unit}\.$"),
    ):
        with pytest.raises(wd.UnusableInput, match=says):
            wd.read_log(log, columns, units=units)
    (recording,) = wd.read_log(log, columns, units={"angle_rad": "deg"})
    assert recording.columns["angle_rad"][-1] == pytest.approx(np.rad2deg(98.0))


@pytest.mark.parametrize(
    ("stamps", "says"),
    [
        (
            [0.0, 0.1, 0.2, 0.1, 0.2, 0.3],
            "from sample 2 to 3 it goes by -0.1 s, and 0.1 s is usual",
        ),
        ([0.0, 0.1, 0.2, 5.0, 5.1, 5.2], "from sample 2 to 3 it goes by 4.8 s, and 0.1 s is usual"),
        ([0.5, 0.4, 0.3, 0.2, 0.1, 0.0], "from sample 0 to 1 it goes by -0.1 s; cut"),
        ([0.0] * 6, "from sample 0 to 1 it goes by 0 s; cut"),
        ([0.0, 0.1, np.nan, 0.3, 0.4, 0.5], "time_s holds what is no number"),
        (["a"] * 6, "time_s is not an array (T,) of numbers"),
        (np.arange(6).astype("datetime64[s]"), "time_s is not an array (T,) of numbers"),
        (["0", "1", "2", "3", "4", "5"], "time_s is not an array (T,) of numbers"),
        (np.array(["0", "1", "2", "3", "4", "5"], dtype=object), "is not an array (T,) of numbers"),
        (np.arange(6.0)[:, None], "time_s is not an array (T,) of numbers"),
    ],
)
def test_a_recording_whose_time_does_not_rise_evenly_is_refused(stamps, says) -> None:
    """It was replayed and searched as if its samples were a step apart."""
    with pytest.raises(wd.UnusableInput) as error:
        wd.Recording("dive", stamps, {"depth_m": np.arange(6.0)})
    assert str(error.value).startswith("dive: ")
    assert says in str(error.value)


@pytest.mark.parametrize("values", [["a"] * 6, np.ones(6) + 1j, [None, {}, 0, 0, 0, 0]])
def test_a_recording_whose_column_holds_no_numbers_is_refused(values) -> None:
    told = r"dive: column 'depth_m' is not an array \(T,\) of numbers"
    with pytest.raises(wd.UnusableInput, match=told):
        wd.Recording("dive", np.arange(6.0), {"depth_m": values})


def test_a_recording_takes_lists_and_columns_of_a_table() -> None:
    """A jitter is no other step; what was not measured is NaN."""
    pandas = pytest.importorskip("pandas", reason="the extra notebook is not installed")
    table = pandas.DataFrame({"t": [0.0, 0.1, 0.22, 0.3, 0.41, 0.5], "z": [1, 2, None, 4, 5, 6]})
    made = wd.Recording("dive", table["t"], {"z": table["z"], "u": [0, 1, 2, 3, 4, 5]})
    assert made.rate_hz == pytest.approx(10.0)
    masked = np.ma.masked_equal([1, 2, 3, 4], 3)
    read = wd.Recording("dive", [0.0, 2.0, 4.0, 7.0], {"z": masked}).columns["z"]
    assert np.array_equal(read, [1.0, 2.0, np.nan, 4.0], equal_nan=True)
    assert made.columns["u"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert np.flatnonzero(np.isnan(made.columns["z"])).tolist() == [2]


@pytest.mark.parametrize("given", ["log.csv", {"x": np.zeros(3)}, (), None])
def test_a_replay_of_what_is_no_recording_is_refused(given) -> None:
    class Slider(wd.System):
        rate_hz = 10.0
        inputs: ClassVar = [wd.Input("force_n", "N")]
        states: ClassVar = {"speed_mps": "m/s"}
        outputs: ClassVar = [wd.Output("speed_mps", "m/s")]

        def derivative(self, state, inputs, c):
            return {"speed_mps": inputs.force_n}

    with pytest.raises(
        wd.UnusableInput, match=r"Slider\.simulate takes one Recording, not .*read_"
    ):
        Slider().simulate(given)


@pytest.mark.parametrize("given", [[np.arange(6.0)], np.arange(6.0), None, {3: np.arange(6.0)}])
def test_columns_without_names_are_refused_in_words(given):
    with pytest.raises(wd.UnusableInput, match=r"^dive: columns (is a|has the name 3, which is)"):
        wd.Recording("dive", np.arange(6.0), given)
    with pytest.raises(wd.UnusableInput, match=r"^dive: clocks is a list; give a dict"):
        wd.Recording("dive", np.arange(6.0), {"z": np.arange(6.0)}, clocks=["z"])


@pytest.mark.parametrize(("every", "first"), [(1, 0), (5, 0), (5, 3)])
def test_a_replay_says_when_its_samples_are_and_what_was_measured_then(every, first) -> None:
    """Of a log that is finer than the system, too: a tank that drains with a time constant."""

    class Tank(wd.System):
        rate_hz = 20.0
        inputs: ClassVar = [wd.Input("pump_mps", "m/s")]
        states: ClassVar = {"level_m": "m"}
        outputs: ClassVar = [wd.Output("level_m", "m")]
        constants: ClassVar = [wd.Constant("drains_s", 0.7)]

        def derivative(self, state, inputs, c):
            return {"level_m": inputs.pump_mps - state.level_m / c.drains_s}

    time_s = 3.0 + np.arange(203 * every) / (20.0 * every)
    level = 2.0 * np.exp(-(time_s - 3.0) / 0.7)
    level[1:first] = np.nan
    log = wd.Recording("tank", time_s, {"pump_mps": np.zeros(len(time_s)), "level_m": level})
    replay = Tank().simulate(log)
    assert len(replay["level_m"]) == len(replay.time_s) == len(replay.measured["level_m"]) == 203
    np.testing.assert_allclose(replay.time_s, 3.0 + np.arange(203) / 20.0)
    truth = 2.0 * np.exp(-(replay.time_s - 3.0) / 0.7)
    np.testing.assert_allclose(replay["level_m"], truth, rtol=0.01)  # a sample is seven times that
    np.testing.assert_allclose(replay.measured["level_m"], truth)
