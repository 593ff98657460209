"""Flying from Python: the same numbers as the command's, the log at hand, pictures that show."""

import dataclasses
import json
import math
import multiprocessing
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import wakedeploy as wd
from wakedeploy.cli import main

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def flight() -> wd.Flight:
    return wd.fly(seconds=6, seed=4)


@pytest.fixture(scope="module")
def flights() -> wd.Flights:
    return wd.fly(flights=2, seconds=6, seed=4, workers=1)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"seconds": math.nan}, "seconds is nan: give a number from 1 to 3600"),
        ({"seconds": "20"}, "seconds is '20': give a number"),
        ({"seconds": -1}, "seconds is -1"),
        ({"seed": -1}, "seed is -1: give a whole number from 0 on"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"package": ["a run"]}, r"\['a run'\] is no path of a package; wd.export makes one"),
    ],
)
def test_a_plan_that_no_gantry_flies_is_refused_in_a_sentence(asked, said: str) -> None:
    with pytest.raises(wd.UnusableInput, match=said):
        wd.fly(**asked)


def test_a_thread_beside_the_main_one_flies_the_same_and_no_rig(flight: wd.Flight) -> None:
    """Ctrl-C, which lands a rig's sufferer, is heard by the main thread alone."""
    with ThreadPoolExecutor(1) as beside:
        again = beside.submit(wd.fly, seconds=6, seed=4).result()
        at_rig = beside.submit(wd.fly, port="/dev/ttyACM0", seconds=6)
        with pytest.raises(wd.UnusableInput, match=r"^port is for a rig, and this is"):
            at_rig.result()
    np.testing.assert_array_equal(again["true_z_m"], flight["true_z_m"])


def test_a_worker_of_a_pool_flies_several(flights: wd.Flights) -> None:
    with multiprocessing.get_context("fork").Pool(1) as workers:
        flown = workers.apply(_rmse_mm, (2,))
    assert flown == flights.rmse_mm


def _rmse_mm(several: int) -> float:
    return wd.fly(flights=several, seconds=6, seed=4).rmse_mm


def test_a_flight_is_the_one_that_the_command_flies(flight: wd.Flight, tmp_path: Path) -> None:
    told = tmp_path / "told.json"
    words = ["run-gantry", "--baseline", "--virtual", "--seconds", "6", "--seed", "4"]
    assert CliRunner().invoke(main, [*words, "--json", str(told)]).exit_code == 0
    result = json.loads(told.read_text())
    assert flight.rmse_mm == pytest.approx(result["true_rmse_mm"], rel=1e-9)
    assert len(flight) == result["ticks"]
    assert flight.ended == result["ended"] == "whole"


def test_the_error_of_a_flight_is_that_of_its_columns(flight: wd.Flight) -> None:
    flying = np.isin(flight["mode"].astype(str), ("RUNNING", "DEGRADED"))
    error_m = (flight["z_ref_m"] - flight["true_z_m"])[flying]
    assert flight.rmse_mm == pytest.approx(1e3 * np.sqrt(np.mean(error_m**2)))


def test_a_flight_that_is_read_knows_how_it_ended(tmp_path: Path) -> None:
    mcap, csv = tmp_path / "a.mcap", tmp_path / "a.csv"
    flown = wd.fly(seconds=6, log=mcap)
    assert CliRunner().invoke(main, ["log", "export", str(mcap), "--out", str(csv)]).exit_code == 0
    for path in (mcap, csv):
        assert wd.Flight.read(path).ended == flown.ended == "whole"
    assert repr(wd.Flight.read(mcap)) == repr(flown)


def test_a_column_that_is_not_there_is_answered_with_the_one_that_is_near(flight) -> None:
    with pytest.raises(KeyError, match=r"'z_est' is no column .*did you mean z_est_m"):
        flight["z_est"]


def test_several_flights_are_single_ones_and_their_mean(
    flight: wd.Flight, flights: wd.Flights
) -> None:
    assert [one.seed for one in flights.flown] == [4, 5]
    assert flights[0].rmse_mm == pytest.approx(flight.rmse_mm, rel=1e-9)
    errors = [one.rmse_mm for one in flights]
    assert flights.rmse_mm == pytest.approx(np.mean(errors))
    assert flights.rmse_se_mm == pytest.approx(abs(errors[0] - errors[1]) / 2)
    assert flights.baseline is None
    assert math.isnan(flights.gain_mm)
    assert flights.ended_early == ()


@pytest.mark.whole
def test_flights_show_themselves(flight: wd.Flight, flights: wd.Flights) -> None:
    assert flight._repr_png_().startswith(PNG)
    assert flights._repr_png_().startswith(PNG)
    assert flight.plot()._repr_png_().startswith(PNG)
    assert repr(flight) == (
        f"<Flight: {len(flight)} ticks, 6.0 s under control, RMSE {flight.rmse_mm:.1f} mm,"
        " ended whole>"
    )
    assert f"RMSE {flights.rmse_mm:.1f} ± {flights.rmse_se_mm:.1f} mm" in repr(flights)


def test_a_flight_is_a_table(flight: wd.Flight, flights: wd.Flights) -> None:
    pytest.importorskip("pandas", reason="the extra notebook is not installed")
    frame = flight.to_pandas()
    assert frame.index.name == "t_s"
    assert frame.shape == (len(flight), len(flight.log.columns) - 1)
    np.testing.assert_array_equal(frame["z_est_m"], flight["z_est_m"])
    assert list(flights.to_pandas()["rmse_mm"]) == pytest.approx([f.rmse_mm for f in flights])


def test_without_pandas_the_sentence_says_how_to_get_it(
    flight: wd.Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(wd.UnusableInput, match=r"pandas is not installed; .*\[notebook\]"):
        flight.to_pandas()


@pytest.mark.whole
def test_what_was_recorded_is_read_again(tmp_path: Path) -> None:
    flown = wd.fly(seconds=6, log=tmp_path / "flight.mcap")
    read = wd.Flight.read(tmp_path / "flight.mcap")
    assert flown.path == read.path == tmp_path / "flight.mcap"
    assert flown.rmse_mm == read.rmse_mm
    several = wd.fly(seconds=6, flights=2, workers=1, log=tmp_path / "flights")
    assert [one.path.name for one in several] == ["pid-0000.mcap", "pid-0001.mcap"]
    assert several[0].rmse_mm == flown.rmse_mm


@pytest.mark.whole
def test_what_was_not_recorded_has_its_error_alone(flight: wd.Flight) -> None:
    bare = wd.fly(seconds=6, seed=4, record=False)
    assert (len(bare), bare.rmse_mm) == (0, pytest.approx(flight.rmse_mm, rel=1e-9))
    assert repr(bare) == f"<Flight: not recorded, RMSE {bare.rmse_mm:.1f} mm, ended whole>"
    several = wd.fly(seconds=6, flights=2, workers=1, record=False)
    with pytest.raises(wd.UnusableInput, match="seed 1 was not recorded; fly it again"):
        several[1]


def test_of_what_was_not_recorded_nothing_is_drawn() -> None:
    bare = wd.fly(seconds=1, record=False)
    with pytest.raises(wd.UnusableInput, match="nothing to draw; fly it again with record=True"):
        bare.plot()
    assert bare._repr_png_() is None


def test_one_is_not_several() -> None:
    assert repr(wd.fly(seconds=1, flights=1, workers=1, record=False)).startswith("<1 Flight, PID")


def test_a_plant_of_another_mass_is_another_flight(flight: wd.Flight) -> None:
    heavier = wd.default_rig().changed(sufferer={"mass_kg": 0.5})
    assert wd.fly(seconds=6, seed=4, plant_rig=heavier).rmse_mm != flight.rmse_mm


def test_an_effect_is_added_in_the_librarys_units(tmp_path: Path) -> None:
    truth = wd.with_effect(wd.default_rig(), "ground-effect", gain=0.3, height_m=0.2)
    truth.write(tmp_path / "truth.toml")
    assert wd.read_rig(tmp_path / "truth.toml") == truth
    assert truth.effect[0].parameters["height_m"].unit == "m"
    assert "effects: ground-effect" in repr(truth)
    with pytest.raises(wd.UnusableInput, match="no effect 'ground'"):
        wd.with_effect(wd.default_rig(), "ground", gain=0.3)
    with pytest.raises(wd.UnusableInput, match="height"):
        wd.with_effect(wd.default_rig(), "ground-effect", gain=0.3)


def test_many_flights_are_not_flown_at_a_port() -> None:
    with pytest.raises(wd.UnusableInput, match="leave port"):
        wd.fly(flights=2, port="/dev/nowhere")


def test_a_log_without_a_flight_has_no_error_and_one_that_is_cut_says_so(
    flight: wd.Flight, tmp_path: Path
) -> None:
    log = flight.log
    few = dataclasses.replace(log, columns={name: c[:5] for name, c in log.columns.items()})
    cut = dataclasses.replace(few, metadata={**log.metadata, "unfinished": "it was cut off"})
    assert "0.0 s under control" in repr(dataclasses.replace(flight, log=few, ended=""))
    assert "RMSE" not in repr(dataclasses.replace(flight, log=few, ended=""))
    assert repr(dataclasses.replace(flight, log=cut, ended="")).endswith("control, cut off>")
