"""Logs as recordings from Python: warnings say what was handled."""

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
