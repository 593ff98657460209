"""The gap of a system of one's own from Python: what the command writes, as the gantry's is."""

import dataclasses
import json
import math
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import wakedeploy as wd
from wakedeploy.api.systems import recordings_of
from wakedeploy.cli import main
from wakedeploy.gap.search.artefacts import Result

SLIDER = """
from wakedeploy import Constant, Input, Output, Port, System


class Slider(System):
    rate_hz = 20.0
    inputs = [Input("force_n", "N")]
    states = {"speed_mps": "m/s"}
    outputs = [Output("speed_mps", "m/s", noise=2e-3)]
    constants = [Constant("mass_kg", 2.0, spread=0.02)]
    ports = [Port.force("speed_mps", inertia="mass_kg", kinds=["viscous-friction", "offset"])]

    def derivative(self, state, inputs, c):
        return {"speed_mps": inputs.force_n / c.mass_kg}
"""
DRAG, NAME, OFFSET = 1.5, "viscous-friction@speed_mps", "offset@speed_mps"


def recorded(seed: int) -> wd.Recording:
    """The slider under jumps of its force, stepped exactly, with a drag that it does not state."""
    random = np.random.default_rng(seed)
    force = np.repeat(random.uniform(-4.0, 4.0, 40), 20)
    keep = math.exp(-DRAG / 2.0 / 20.0)
    speed, shown = 0.0, []
    for newton in force:
        shown.append(speed + 2e-3 * random.standard_normal())
        speed = keep * speed + (1.0 - keep) * newton / DRAG + 1e-3 * random.standard_normal()
    columns = {"force_n": force, "speed_mps": np.array(shown)}
    return wd.Recording(f"made {seed}", np.arange(len(force)) / 20.0, columns)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The slider's file, and a log of it as CSV."""
    path = tmp_path_factory.mktemp("own")
    (path / "slider.py").write_text(SLIDER)
    log = recorded(0)
    rows = np.column_stack([log.time_s, log.columns["force_n"], log.columns["speed_mps"]])
    header = "time_s,force_n,speed_mps"
    np.savetxt(path / "log.csv", rows, "%.9g", ",", header=header, comments="")
    return path


@pytest.fixture(scope="module")
def gap(place: Path) -> wd.Gap:
    return wd.close_gap(str(place / "slider.py"), place / "log.csv", place / "gap")


def _kind(place: Path) -> type[wd.System]:
    from wakedeploy.gap.systems.files import read_system

    return type(read_system(place / "slider.py"))


@pytest.mark.whole
def test_a_system_in_a_file_gets_its_answer(gap: wd.Gap) -> None:
    assert (gap.verdict, gap.effects, gap.classes) == ("named", (NAME,), ())
    assert gap.result.answered == {NAME: 1.0}  # a friction leaves inputs what they do
    assert repr(gap) == f"<Gap in {gap.folder}: named: {NAME}>"
    assert isinstance(gap.result, Result)
    size = gap.result.effects[0].parameters["coefficient"]
    assert size.low <= DRAG <= size.high
    assert gap.report.is_file()
    assert gap.rig is None
    assert len(gap.next) == 1
    assert gap.next[0].startswith("wakedeploy gap simulate --system")


@pytest.mark.whole
def test_what_lies_in_the_folder_is_read_again(gap: wd.Gap) -> None:
    again = wd.Gap.read(str(gap.folder))
    assert again.account == gap.account
    assert again.effects == gap.effects
    assert gap.account.splitlines()[0].startswith("The system lacks friction")
    assert gap.account.splitlines()[0].replace("`", "") in again._repr_html_().replace("`", "")
    assert "<img" in again._repr_html_()
    with pytest.raises(wd.UnusableInput, match="is of a system"):
        _ = again.steps


@pytest.mark.whole
def test_the_correction_is_loaded_by_the_system(place: Path, gap: wd.Gap) -> None:
    kind, other = _kind(place), recorded(1)
    assert gap.corrected == gap.folder / "correction.toml"
    better = kind.corrected(gap.corrected)

    def off(system: wd.System) -> float:
        return float(np.std(system.simulate(other)["speed_mps"] - other.columns["speed_mps"]))

    assert off(better) < 0.2 * off(kind())


@pytest.mark.whole
def test_sizes_and_the_ranking_are_tables(gap: wd.Gap) -> None:
    pytest.importorskip("pandas", reason="the extra notebook is not installed")
    (row,) = gap.to_pandas().to_dict("records")
    assert (row["effect"], row["parameter"]) == (NAME, "coefficient")
    assert row["low"] <= DRAG <= row["high"]
    assert row["unit"] == "N/(m/s)"
    ranked = gap.to_pandas("ranking")
    best = ranked.iloc[0]
    assert best["effect"] == NAME
    assert best["named"]
    assert best["gain_nats"] > best["threshold_nats"]
    assert set(ranked["effect"]) == {NAME, OFFSET}
    with pytest.raises(wd.UnusableInput, match='give "effects" or "ranking"'):
        gap.to_pandas("all")  # type: ignore[arg-type]


@pytest.mark.whole
def test_the_forecast_is_drawn(gap: wd.Gap) -> None:
    axes = gap.plot().axes
    assert axes[0].get_lines()
    assert gap.plot()._repr_png_().startswith(b"\x89PNG")


@pytest.mark.whole
def test_a_class_and_recordings_give_the_same_answer(place: Path, tmp_path: Path) -> None:
    """Nothing of it lies in a file, so that no command can be given."""
    kind = _kind(place)
    seen: list[str] = []
    gap = wd.close_gap(
        kind, recorded(0), tmp_path, report=False, progress=lambda stage, *_: seen.append(stage)
    )
    assert (gap.effects, gap.next) == ((NAME,), ())
    assert "ranking effects" in seen
    assert not gap.report.exists()
    seen.clear()  # of the same object nothing is asked twice
    wd.close_gap(kind(), [recorded(0)], tmp_path, progress=lambda stage, *_: seen.append(stage))
    assert "ranking effects" not in seen


@pytest.mark.whole
def test_the_command_prints_what_the_function_returns(place: Path, gap: wd.Gap) -> None:
    words = ["--system", str(place / "slider.py"), "--measured", str(place / "log.csv")]
    told = CliRunner().invoke(
        main, ["gap", "close", *words, "--out", str(gap.folder), "--json", str(place / "told.json")]
    )
    assert told.exit_code == 0, told.output
    assert gap.account in told.stdout
    assert f"Correction: {gap.corrected}" in told.stdout
    assert f"Report: {gap.report}" in told.stdout
    assert f"Next: {gap.next[0]}" in told.stdout
    assert json.loads((place / "told.json").read_text())["verdict"] == "named"


@pytest.mark.whole
def test_what_is_added_by_name_is_told_with_its_size_and_what_was_fitted_beside_it(
    place: Path, gap: wd.Gap, tmp_path: Path
) -> None:
    """The offset takes the friction's place: it is told what the file has, not the answer again."""
    shutil.copytree(gap.folder, tmp_path / "gap")
    words = ["--system", str(place / "slider.py"), "--measured", str(place / "log.csv")]
    words += ["--out", str(tmp_path / "gap"), "--effect", OFFSET]
    told = CliRunner().invoke(main, ["gap", "add", *words])
    assert told.exit_code == 0, told.output
    correction = tomllib.loads((tmp_path / "gap" / "correction.toml").read_text())
    assert [effect["name"] for effect in correction["effect"]] == [NAME, OFFSET]
    first, *rows = told.stdout.splitlines()
    assert first.startswith(f"Added as you asked: {OFFSET}. The correction has:")
    assert [row.split(":")[0].strip() for row in rows[:2]] == [NAME, OFFSET]
    assert "Does it matter" not in told.stdout
    mass = correction["constants"]["mass_kg"]
    assert f"mass_kg: stated 2 kg, fitted {mass:.3g}" in told.stdout.replace("0 kg", " kg")
    both = CliRunner().invoke(main, ["gap", "add", *words, "--effect", NAME])
    assert both.exit_code == 0, both.output
    assert f"Added as you asked: {OFFSET} and {NAME}. The correction has:" in both.stdout
    twice = CliRunner().invoke(main, ["gap", "add", *words, "--effect", OFFSET])
    assert twice.stdout == told.stdout


def test_a_log_that_is_another_s_copy_counts_once_and_that_is_said(place: Path) -> None:
    heard: list[str] = []
    copy = dataclasses.replace(recorded(1), name="copy")
    logs = [recorded(0), recorded(1), copy]
    system = _kind(place)()
    spare = {**copy.columns, "battery_v": 12.0 + 0.0 * copy.time_s}  # a column that nobody asks for
    logs[2] = dataclasses.replace(copy, columns=spare, time_s=copy.time_s + 60.0)
    rest = {name: 0.0 * values for name, values in copy.columns.items()}
    resting = [dataclasses.replace(copy, name=name, columns=rest) for name in ("rest", "again")]
    assert len(recordings_of(resting, None, system, heard.append)) == 2
    kept = recordings_of(logs, None, system, heard.append)
    assert [recording.name for recording in kept] == ["made 0", "made 1"]
    assert heard == ["copy has the samples of made 1: a copy, which is left out"]
    assert len(recordings_of([logs[0], logs[0]], None, system, heard.append)) == 1
    assert heard[1:] == ["made 0 is given twice; it counts once"]


@pytest.mark.parametrize(
    ("measured", "said"),
    [
        (None, "measured has a NoneType, None: give recordings, as of wd.read_log"),
        ([recorded(0), 3], "measured has a int, 3: give recordings"),
        ({"force_n": [1.0]}, "measured has a dict, {'force_n'.*: give recordings"),
    ],
)
def test_what_is_no_log_is_refused_by_its_kind(
    measured: Any, said: str, place: Path, tmp_path: Path
) -> None:
    with pytest.raises(wd.UnusableInput, match=said):
        wd.close_gap(_kind(place), measured, tmp_path / "gap")


def test_a_table_of_pandas_is_no_list_of_logs(place: Path, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"force_n": [1.0, 2.0]})
    with pytest.raises(wd.UnusableInput, match=r"measured has a DataFrame.*give recordings"):
        wd.close_gap(_kind(place), table, tmp_path / "gap")


def test_columns_and_a_correction_are_given_by_their_paths(place: Path, tmp_path: Path) -> None:
    kind: Any = _kind(place)
    columns: Any = {"force_n": "N"}
    with pytest.raises(wd.UnusableInput, match=r"columns is {'force_n': 'N'}: give a path"):
        wd.close_gap(kind, place / "log.csv", tmp_path / "gap", columns=columns)
    with pytest.raises(wd.UnusableInput, match="path is 3: give a path"):
        kind.corrected(3)


@pytest.mark.whole
def test_power_beside_an_answer_asks_for_the_other_effects_and_says_so(
    place: Path, gap: wd.Gap, tmp_path: Path
) -> None:
    """Without the answer the logs lack something; beside it they do not, and sizes are smaller."""

    def asked(out: Path) -> tuple[str, dict[str, Any]]:
        words = ["--system", str(place / "slider.py"), "--measured", str(place / "log.csv")]
        told = CliRunner().invoke(main, ["gap", "power", *words, "--out", str(out)])
        assert told.exit_code == 0, told.output
        assert f"Written: {out / 'power.json'}" in told.stdout
        return told.stdout, json.loads((out / "power.json").read_text())

    alone, without = asked(tmp_path)
    assert f"These logs lack something already: {NAME} or what looks like it would gain" in alone
    assert "run `gap close`, and give the folder of its answer about these logs as --out." in alone
    assert without["missing"][0] == NAME
    assert without["beside"] == []
    beside, known = asked(gap.folder)
    assert f"All this is beside what the answer in {gap.folder} has: {NAME}." in beside
    assert "lack something already" not in beside
    assert (known["beside"], known["missing"]) == ([NAME], None)
    sizes = {row["name"]: row["detected"] for row in without["effects"]}
    assert {NAME, OFFSET} == set(sizes)
    assert [row["name"] for row in known["effects"]] == [OFFSET]
    assert known["effects"][0]["detected"] < sizes[OFFSET]


@pytest.mark.whole
def test_what_no_size_that_was_tried_shows_is_told_by_the_largest(
    place: Path, tmp_path: Path
) -> None:
    """A fan whose whole push is a thousandth of the sensor's noise may be as late as it likes."""
    other = SLIDER.replace('"N")]', '"N"), Input("fan_n", "N")]', 1)
    other = other.replace("inputs.force_n /", "(inputs.force_n + 1e-6 * inputs.fan_n) /")
    other = other.replace("ports = [", 'ports = [Port.input("fan_n", kinds=["dead-time"]), ')
    (tmp_path / "slider.py").write_text(other)
    rows = np.loadtxt(place / "log.csv", delimiter=",", skiprows=1)
    rows = np.column_stack([rows, np.roll(rows[:, 1], 200)])
    header = "time_s,force_n,speed_mps,fan_n"
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", header=header, comments="")
    words = ["--system", str(tmp_path / "slider.py"), "--measured", str(tmp_path / "log.csv")]
    told = CliRunner().invoke(main, ["gap", "power", *words, "--out", str(tmp_path / "out")])
    assert told.exit_code == 0, told.output
    listed = json.loads((tmp_path / "out" / "power.json").read_text())["effects"]
    late = next(row for row in listed if row["name"] == "dead-time@fan_n")
    assert (late["detected"], late["named"]) == (None, None)  # JSON has no infinity
    shown = next(line for line in told.stdout.splitlines() if "dead-time@fan_n" in line)
    seen, named = (cell.strip() for cell in shown.strip("│ ").split("│")[2:4])
    assert seen == named == f"> {late['largest']:.3g}"
    assert late["largest"] > 0.05  # seconds: a sample and more was tried


@pytest.mark.whole
def test_another_form_of_the_system_leaves_nothing_of_the_answer_before(
    place: Path, tmp_path: Path
) -> None:
    """Each step's file would pass for one of this form; what else lies there is the user's."""
    exported = SLIDER + '\n    exported = ("slider.urdf",)\n'
    (tmp_path / "slider.py").write_text(exported)
    out = tmp_path / "gap"

    def found() -> str:
        words = ["--system", str(tmp_path / "slider.py"), "--measured", str(place / "log.csv")]
        told = CliRunner().invoke(main, ["gap", "find", *words, "--out", str(out)])
        assert told.exit_code == 0, told.output
        return told.stderr

    assert "removed" not in found()
    of_answer = (
        "name.json", "domain.json", "report.html", "correction.toml", "plan.json", "power.json",
        "slider.urdf",
    )  # fmt: skip
    for name in (*of_answer, "notes.txt"):
        (out / name).write_text("{}")
    assert "removed" not in found()  # nothing new is found
    (tmp_path / "slider.py").write_text(exported.replace("2.0, spread=0.02", "2.1, spread=0.02"))
    said = f"removed, as it was of other logs or another form: {', '.join(of_answer)}"
    assert said in found()
    left = sorted(path.name for path in out.iterdir() if path.suffix != ".lock")
    assert left == ["find.json", "notes.txt"]


def test_the_columns_of_a_system_are_found_in_a_log(place: Path) -> None:
    text = wd.guess_columns(place / "log.csv", place / "slider.py")
    assert text == wd.guess_columns(place / "log.csv", _kind(place))
    assert "[columns.force_n]" in text
    assert [text.count(f'role = "{role}"') for role in ("input", "output", "unused")] == [1, 1, 0]


def test_what_a_system_says_of_its_logs_is_said_before_a_search(
    place: Path, tmp_path: Path
) -> None:
    """A model whose bodies touch where logs have been is asked in vain, after minutes."""
    notes = '\n    def log_notes(self, outputs):\n        return ["it hits its stop"]\n'
    (tmp_path / "slider.py").write_text(SLIDER + notes)
    words = ["--system", str(tmp_path / "slider.py"), "--measured", str(place / "log.csv")]
    told = CliRunner().invoke(main, ["gap", "find", *words, "--out", str(tmp_path / "gap")])
    assert told.exit_code == 0, told.output
    assert "it hits its stop" in told.stderr


@pytest.mark.slow
def test_logs_in_other_units_are_read_by_a_columns_file(place: Path, tmp_path: Path) -> None:
    """A folder of a log, too: as `gap check` takes it, every step does."""
    rows = np.loadtxt(place / "log.csv", delimiter=",", skiprows=1) * 1000.0
    (tmp_path / "drive").mkdir()
    header = "stamp_ms,push_mN,read_mmps"
    np.savetxt(tmp_path / "drive" / "a.csv", rows, delimiter=",", header=header, comments="")
    time = '[time]\ncolumn = "stamp_ms"\nunit = "ms"\n'
    (tmp_path / "columns.toml").write_text(
        "version = 1\n" + time + '[columns.force_n]\ncolumn = "push_mN"\nrole = "input"\n'
        'unit = "mN"\nfile = "a.csv"\n[columns.speed_mps]\ncolumn = "read_mmps"\nrole = "output"\n'
        'unit = "mm/s"\nfile = "a.csv"\n'
    )
    found = wd.close_gap(
        _kind(place), tmp_path / "drive", tmp_path / "gap", columns=tmp_path / "columns.toml"
    )
    assert found.effects == (NAME,)
    for step in ("find", "name", "show", "power"):
        told = CliRunner().invoke(
            main,
            [
                *("gap", step, "--system", str(place / "slider.py")),
                *("--measured", str(tmp_path / "drive")),
                *("--columns", str(tmp_path / "columns.toml"), "--out", str(tmp_path / step)),
            ],
        )
        assert told.exit_code == 0, told.output


def test_a_folder_of_a_log_needs_a_columns_file(place: Path, tmp_path: Path) -> None:
    with pytest.raises(wd.UnusableInput, match="is a folder, not a CSV file; say by columns"):
        wd.close_gap(_kind(place), [tmp_path], tmp_path / "gap")
    assert not (tmp_path / "gap").exists()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"retrain_minutes": 10.0}, "retrain_minutes is for a rig"),
        ({"measured": [object.__new__(wd.Flight)]}, "A flight is of a rig"),
        ({"measured": "absent.csv"}, "there is no such file in "),
        ({"columns": "columns.toml"}, "columns go with logs that are read from files"),
        ({"system": "model.xml"}, "gap init my_robot.py --mjcf MODEL.xml"),
        ({"system": wd.default_rig()}, "A rig is given by its file"),
        ({"system": 3}, "3 is no rig file and no system"),
        ({"system": "rig.toml"}, "A recording is of a system"),
        ({"system": "rig.toml", "columns": "columns.toml"}, "columns are for a system"),
        ({"system": "absent.py"}, "no such file; `wakedeploy gap init"),
    ],
)
def test_what_does_not_go_together_is_refused(
    place: Path, tmp_path: Path, given: dict[str, object], says: str
) -> None:
    usual = {"system": _kind(place), "measured": [recorded(0)], "out": tmp_path / "gap"}
    with pytest.raises(wd.UnusableInput, match=says):
        wd.close_gap(**(usual | given))  # type: ignore[arg-type]
    assert not (tmp_path / "gap").exists()


@pytest.mark.parametrize("step", ["find", "close", "power", "plan"])
def test_nothing_is_asked_of_a_system_without_ports(place: Path, tmp_path: Path, step: str) -> None:
    text = SLIDER[: SLIDER.index("    ports")] + SLIDER[SLIDER.index("    def") :]
    (tmp_path / "slider.py").write_text(text)
    system, log = str(tmp_path / "slider.py"), str(place / "log.csv")
    more = ["--class", NAME] if step == "plan" else ["--out", str(tmp_path / "gap")]
    told = CliRunner().invoke(main, ["gap", step, "--system", system, "--measured", log, *more])
    assert told.exit_code == 2
    assert "states no ports, so that there is no effect to ask for" in told.stderr
    for usable in ("check", "simulate"):
        told = CliRunner().invoke(main, ["gap", usable, "--system", system, "--measured", log])
        assert told.exit_code == 0, told.output


def test_a_recording_tells_of_itself_in_a_line() -> None:
    assert repr(recorded(0)) == "<Recording made 0: force_n, speed_mps; 800 at 20 Hz>"
