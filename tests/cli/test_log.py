"""`wakedeploy log` from the command line, on simulated flights."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest
import scipy.io
from click.testing import CliRunner, Result

from wakedeploy.cli import main
from wakedeploy.core.episodes import read_episode_set
from wakedeploy.core.runlog import read_run_log
from wakedeploy.domains.gantry import record


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("flights")
    paths = [folder / f"flight{n}.mcap" for n in range(3)]
    for seed, path in enumerate(paths):
        record(None, seconds=12, seed=seed).write_mcap(path)
    return paths


@pytest.mark.whole
def test_show_tells_and_draws(flights: list[Path], tmp_path: Path) -> None:
    done = run("log", "show", *flights, "--json", tmp_path / "runs.json")
    assert done.exit_code == 0, done.output
    assert "Tracking RMSE" in done.output
    runs = json.loads((tmp_path / "runs.json").read_text())["runs"]
    assert [Path(row["file"]).name for row in runs] == [path.name for path in flights]
    assert 0.001 < runs[0]["tracking_rmse_m"] < 0.2
    assert runs[0]["seconds_in_mode"] == {"ARMED": 6.0, "RUNNING": 12.0, "LANDING": 0.5}
    for path in flights:
        assert path.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


def test_the_picture_goes_where_it_is_told(flights: list[Path], tmp_path: Path) -> None:
    assert run("log", "show", flights[0], "--png", tmp_path / "a.png").exit_code == 0
    assert (tmp_path / "a.png").stat().st_size > 10_000
    done = run("log", "show", *flights, "--png", tmp_path / "a.png")
    assert done.exit_code == 2
    flights[0].with_suffix(".png").unlink(missing_ok=True)
    assert run("log", "show", flights[0], "--no-picture").exit_code == 0
    assert not flights[0].with_suffix(".png").exists()


@pytest.mark.parametrize(
    ("simulated", "advice"),
    [("true", "on a virtual gantry that is a fault"), ("false", "check the sensor's wires")],
)
def test_a_flight_that_ended_in_a_failsafe_says_when_why_and_what_to_do(
    tmp_path: Path, simulated: str, advice: str
) -> None:
    log = record(None, seconds=7, seed=0, sensor_hook=lambda t, r, n: (r if t < 5 else np.nan, n))
    log.metadata["simulated"] = simulated
    log.write_mcap(tmp_path / "blind.mcap")
    done = run("log", "show", tmp_path / "blind.mcap", "--json", tmp_path / "run.json")
    assert done.exit_code == 0, done.output
    (told,) = json.loads((tmp_path / "run.json").read_text())["runs"]
    assert told["failsafe_cause"] == "sensor_lost"
    assert 5.2 < told["failsafe_s"] < 5.4
    assert f"at {told['failsafe_s']:.2f} s: no new range sample: {advice}" in (
        " ".join(done.output.split())
    )


def test_a_cut_off_recording_is_shown_with_a_note(flights: list[Path], tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(flights[0].read_bytes()[:60_000])
    done = run("log", "show", cut, "--no-picture")
    assert done.exit_code == 0
    assert "cut off" in done.output


def test_export_gives_the_same_log_as_csv(flights: list[Path], tmp_path: Path) -> None:
    done = run("log", "export", flights[0], "--out", tmp_path / "flight.csv")
    assert done.exit_code == 0, done.output
    assert f"{tmp_path / 'flight.csv'}: 592 ticks" in done.output
    given, told = read_run_log(flights[0]), read_run_log(tmp_path / "flight.csv")
    for name in given.columns:
        np.testing.assert_array_equal(given[name], told[name])
    assert given.metadata == told.metadata


def test_export_takes_the_format_from_the_name(flights: list[Path], tmp_path: Path) -> None:
    for name in ("flight.parquet", "flight.MAT"):
        assert run("log", "export", flights[0], "--out", tmp_path / name).exit_code == 0
    given = read_run_log(flights[0])
    table = parquet.read_table(tmp_path / "flight.parquet")
    assert table.column("z_est_m").to_pylist() == given["z_est_m"].tolist()
    assert table.schema.field("z_est_m").metadata == {b"unit": b"m"}
    read = scipy.io.loadmat(tmp_path / "flight.MAT", simplify_cells=True)
    np.testing.assert_array_equal(read["z_est_m"], given["z_est_m"])


def test_gap_export_writes_a_log_as_csv_as_well(flights: list[Path], tmp_path: Path) -> None:
    for name, command in (("a.csv", ("log", "export")), ("b.csv", ("gap", "export", "--log"))):
        assert run(*command, flights[0], "--out", tmp_path / name).exit_code == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


@pytest.mark.whole
def test_smooth_makes_a_set_with_ceiling(flights: list[Path], tmp_path: Path) -> None:
    made, told = tmp_path / "set", tmp_path / "told.json"
    done = run("log", "smooth", *flights, "--out", made, "--json", told)
    assert done.exit_code == 0, done.output
    assert "Label noise leaves an R² of" in done.output
    episodes = read_episode_set(made)
    assert sorted(episodes.split.values()) == ["test", "train", "validation"]
    result = json.loads(told.read_text())
    assert 0.5 < result["r2_ceiling"] < 1.0
    assert result["sha256"] == episodes.sha256


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "{missing}"], "there is no such file in "),
        (["show", "{foreign}"], "not an MCAP run log"),
        (["smooth", "{foreign}", "--out", "{out}"], "not an MCAP run log"),
        (["smooth", "{flight}", "{flight}", "--out", "{out}"], "given twice"),
        (["smooth", "{flight}", "--rig", "{foreign}", "--out", "{out}"], "foreign.mcap"),
        (["export", "{flight}", "--out", "{out}"], "ends in .csv, .parquet or .mat"),
        (["export", "{flight}", "--out", "{out}.xlsx"], "ends in .csv, .parquet or .mat"),
    ],
)
def test_unusable_input_is_one_sentence_and_status_2(
    flights: list[Path], tmp_path: Path, arguments: list[str], message: str
) -> None:
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(b"not a recording")
    places = {
        "missing": tmp_path / "missing.mcap",
        "foreign": foreign,
        "flight": flights[0],
        "out": tmp_path / "out",
    }
    done = run("log", *(argument.format(**places) for argument in arguments))
    assert done.exit_code == 2
    assert message in done.output
    assert len(done.output.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
