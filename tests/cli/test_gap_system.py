"""A user's system at the command line: a first file that runs, a log, a correction, bad input."""

import itertools
import json
import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from made_answers import answer_with

from wakedeploy.cli.data import command as data_command
from wakedeploy.cli.gap import command
from wakedeploy.cli.gap_system import _following
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.gap.search.artefacts import Answer
from wakedeploy.gap.systems.answers.next_commands import next_commands
from wakedeploy.gap.systems.answers.words import sentences
from wakedeploy.gap.systems.correction import (
    VERSION,
    Correction,
    Document,
    Named,
    write_correction,
)
from wakedeploy.gap.systems.files import read_plain, read_system
from wakedeploy.gap.systems.likelihood.logs import LogModel


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The template, and a log of it with viscous friction of 0.8 N s/m."""
    path = tmp_path_factory.mktemp("own")
    assert CliRunner().invoke(command, ["init", str(path / "my_robot.py")]).exit_code == 0
    rng = np.random.default_rng(0)
    volts = np.repeat(rng.standard_normal(16), 25)
    x, v, rows = 0.0, 0.0, []
    for k, u in enumerate(volts):
        rows.append((k / 100.0, u, x))
        for _ in range(20):
            v += (1.5 * u - 0.8 * v) / 2.0 * 5e-4
            x += v * 5e-4
    header = "time_s,voltage_v,position_m"
    np.savetxt(path / "log.csv", rows, delimiter=",", header=header, comments="")
    return path


def _corrected(folder, coefficient, unit="N/(m/s)"):
    system = read_system(folder / "my_robot.py")
    model = LogModel(system, [read_plain(folder / "log.csv", system)])
    document = Document(
        version=VERSION,
        system="MyRobot",
        sample_s=model.dt_s,
        span_s=model.span_s,
        sizes=model.sizes,
        effect=(
            Named(
                name="viscous-friction@speed_mps",
                parameters={"coefficient": coefficient},
                units={"coefficient": unit},
            ),
        ),
    )
    write_correction(Correction(document), folder / "correction.toml")
    return type(system)


def test_a_replay_with_the_true_correction_is_exact(folder):
    cls = _corrected(folder, 0.8)
    log = read_plain(folder / "log.csv", cls())
    plain = cls().simulate(log)["position_m"]
    better = cls.corrected(folder / "correction.toml").simulate(log)["position_m"]
    logged = log.columns["position_m"]
    assert np.abs(better - logged).max() < 0.01 * np.abs(plain - logged).max()
    told = CliRunner().invoke(
        command,
        [
            *("simulate", "--system", str(folder / "my_robot.py")),
            *("--measured", str(folder / "log.csv")),
            *("--correction", str(folder / "correction.toml")),
        ],
    )
    assert told.exit_code == 0
    assert "position_m" in told.output


def test_a_replay_without_a_correction_has_one_error_of_each_output(folder):
    words = ["simulate", "--system", str(folder / "my_robot.py")]
    told = CliRunner().invoke(command, [*words, "--measured", str(folder / "log.csv")])
    head = next(line for line in told.output.splitlines() if "output" in line)
    assert re.findall(r"\w+", head) == ["log", "output", "error", "unit"]


def test_init_never_overwrites(folder):
    told = CliRunner().invoke(command, ["init", str(folder / "my_robot.py")])
    assert "is there already" in str(told.exception)


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("my_robot.py", "MyRobot"), ("out tendon.py", "OutTendon"), ("out_r.urdf.py", "OutRUrdf"),
        ("3dof-arm.py", "System3dofArm"), ("größe.py", "Größe"), ("none.py", "SystemNone"),
        ("²(…).py", "Robot"), ("NAME.py", "NAME"), ('a"""b\\N.py', "ABN"),
    ],
)  # fmt: skip
def test_a_file_of_any_name_has_a_class_that_python_reads(tmp_path, file, name):
    path = tmp_path / "my systems" / file
    path.parent.mkdir()
    told = CliRunner().invoke(command, ["init", str(path)], catch_exceptions=False)
    assert read_system(path).name == name
    line = told.output.splitlines()[0]
    words = shlex.split(line[line.index("then: ") + 6 :])  # as a shell reads it
    assert words[:4] == ["wakedeploy", "gap", "check", str(path)]


@pytest.mark.parametrize("file", ["x.txt", "robot", "robot.PY"])
def test_what_is_no_python_file_is_refused_before_it_is_written(tmp_path, file):
    told = CliRunner().invoke(command, ["init", str(tmp_path / file)])
    assert isinstance(told.exception, UnusableInput)
    stem = Path(file).stem
    assert f"give a name that ends in .py, as {stem}.py" in str(told.exception)
    assert list(tmp_path.iterdir()) == []


def test_the_command_that_writes_an_absent_file_may_be_copied(tmp_path):
    with pytest.raises(UnusableInput) as error:
        read_system(tmp_path / "my robot")
    words = shlex.split(str(error.value).split("`")[1])
    assert words == ["wakedeploy", "gap", "init", str(tmp_path / "my robot.py")]


def test_init_warns_of_joints_that_an_equality_holds(tmp_path):
    pytest.importorskip("mujoco")
    joints = "".join(
        f'<body><joint name="{n}" axis="0 1 0"/><geom size="0.1"/></body>' for n in "ab"
    )
    (tmp_path / "arm.xml").write_text(
        f"<mujoco><worldbody>{joints}</worldbody>"
        '<equality><joint joint1="a" joint2="b"/></equality></mujoco>'
    )
    paths = [str(tmp_path / "arm.py"), "--mjcf", str(tmp_path / "arm.xml")]
    told = CliRunner().invoke(command, ["init", *paths], catch_exceptions=False)
    assert "joints a and b are held by an equality" in told.stderr


def test_a_correction_of_another_unit_or_of_a_port_that_is_gone_is_refused(folder):
    """A port that is now like an input has its forces in that input's unit, not in m/s²."""
    cls = _corrected(folder, 0.8, "1/s")
    log = read_plain(folder / "log.csv", cls())
    corrected = cls.corrected(folder / "correction.toml")
    told = (
        r"'coefficient' of 'viscous-friction@speed_mps' in 1/s, and the system has it in N/\(m/s\)"
    )
    with pytest.raises(UnusableInput, match=told):
        corrected.simulate(log)
    cls.ports = [port for port in cls.ports if port.role != "force"]
    with pytest.raises(UnusableInput, match="'viscous-friction@speed_mps', which no port offers"):
        cls.corrected(folder / "correction.toml").simulate(log)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("version = 6\n", "system"),
        ('version = 6\nsystem = "Other"\nsample_s = 1\nspan_s = 1\n[sizes]\n', "not 'MyRobot'"),
        ('version = 1\nsystem = "MyRobot"\nsample_s = 1\nspan_s = 1\n[sizes]\n', "version 1; this"),
        ("version = = 1\n", "correction"),
    ],
)
def test_a_correction_that_cannot_be_used_is_told(folder, tmp_path, text, says):
    (tmp_path / "correction.toml").write_text(text)
    cls = type(read_system(folder / "my_robot.py"))
    with pytest.raises(Exception, match=says):
        cls.corrected(tmp_path / "correction.toml")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "Give one of '--rig' and '--system'"),
        (["--system", "a.py", "--rig", "rig.toml"], "Give one of '--rig' and '--system'"),
        (["--rig", "rig.toml", "--columns", "columns.toml"], "'--columns' goes with '--system'"),
    ],
)
def test_a_rig_and_a_system_exclude_each_other(tmp_path, options, says):
    given = ["find", "--measured", "log.csv", "--out", str(tmp_path / "out"), *options]
    assert says in CliRunner().invoke(command, given).output


@pytest.mark.parametrize("option", [[], ["--system"]])
def test_an_uneven_log_is_refused_with_the_way_out(folder, tmp_path, option):
    (tmp_path / "log.csv").write_text("time_s,voltage_v,position_m\n0,1,1\n1,1,1\n5,1,1\n6,1,1\n")
    log = str(tmp_path / "log.csv")
    given = ["check", *option, str(folder / "my_robot.py"), "--measured", log]
    assert "--columns" in str(CliRunner().invoke(command, given).exception)


@pytest.mark.parametrize("step", ["check", "close", "simulate"])
def test_a_place_for_json_that_cannot_be_written_is_refused_before_any_fit(folder, tmp_path, step):
    (tmp_path / "file").write_text("")
    asked = tmp_path / "file" / "told.json"
    given = [step, "--system", str(folder / "my_robot.py"), "--measured", str(folder / "log.csv")]
    given += ["--out", str(tmp_path / "gap")] if step == "close" else []
    told = CliRunner().invoke(command, [*given, "--json", str(asked)])
    assert told.exit_code == 2
    said = f"'--json': {asked}: {tmp_path / 'file'} cannot be written to (Not a directory)."
    assert said in told.stderr
    assert "fitting" not in told.stderr
    assert not (tmp_path / "gap").exists()


def test_a_log_that_is_absent_is_answered_with_where_and_what(folder, tmp_path, monkeypatch):
    """By its own name a near one, a pattern without a match, and a folder that is not there."""

    def said(log):
        given = ["simulate", "--system", str(folder / "my_robot.py"), "--measured", str(log)]
        return str(CliRunner().invoke(command, given).exception)

    what = "ive a log (.csv, .npz, .mat, .h5, .parquet, .mcap, .db3 or .ulg), or a folder of"
    monkeypatch.chdir(folder)
    assert f"lug.csv: there is no such file in {folder}; did you mean log.csv? G{what}" in (
        said("lug.csv")
    )
    assert f"qqq: there is no such file in {folder}; g{what}" in said("qqq")
    assert f"run*.csv: no file in {folder} is called so; g{what}" in said("run*.csv")
    beyond = tmp_path / "absent" / "log.csv"
    assert f"{beyond}: there is no folder {beyond.parent}; g{what}" in said(beyond)


def test_check_takes_one_system():
    for given in ([], ["a.py", "--system", "b.py"]):
        told = CliRunner().invoke(command, ["check", *given, "--measured", "log.csv"])
        assert "Give one system" in told.output


COLUMNS = """version = 1
[time]
column = "stamp_ms"
unit = "ms"
[columns.{name}]
column = "motor_mV"
role = "input"
unit = "mV"
[columns.position_m]
column = "encoder_mm"
role = "output"
unit = "mm"
"""


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty; give a log"),
        ("time_s,voltage_v,position_m\n", "two rows or more, and has none below the header"),
        ("voltage_v,position_m\n0,0\n0,1\n", "no CSV with a time_s among 2 columns"),
        ("time_s,voltage_v,position_m\n0,0,0\n", "two rows or more"),
        ("time_s,voltage_v,position_m\n0,0,0\n-inf,0,0\ninf,1,1\n", "time_s needs"),
        ("time_s,voltage_v,position_m\n0,0,0\nx,0,0\n0.02,1,1\n", "time_s needs"),
        ("time_s,voltage_v,position_m\n0,0,0\n0.01,0,1e300\n", "column 'position_m' has"),
        ("time_s,voltage_v,voltage_v\n0,0,0\n0.01,0,1\n", "two columns are called 'voltage_v'"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_numbers_that_no_log_has_are_refused_without_a_warning(folder, tmp_path, text, says):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(UnusableInput) as error:
        read_plain(path, read_system(folder / "my_robot.py"))
    assert str(error.value).startswith(f"{path}: ")
    assert says in str(error.value)


@pytest.mark.parametrize("column", ["voltage_v", "position_m"])
@pytest.mark.parametrize("cell", ["err", "0.1 V", "true", "0.1;"])
def test_text_among_the_numbers_of_a_plain_log_is_refused(folder, tmp_path, column, cell):
    """As a reading that is missing it would be passed over, and of an input the last one held."""
    path, place = tmp_path / "log.csv", ["voltage_v", "position_m"].index(column)
    rows = [[f"{k / 100:g}", "0.5", "0.25"] for k in range(300)]
    rows[40][1 + place] = cell
    path.write_text("\n".join(map(",".join, [["time_s", "voltage_v", "position_m"], *rows])))
    with pytest.raises(UnusableInput) as error:
        read_plain(path, read_system(folder / "my_robot.py"))
    assert f"{path}: column {column!r} holds {cell!r} in line 42, which is no number" in str(
        error.value
    )
    assert "--guess" in str(error.value)


def test_what_says_that_there_is_no_number_is_a_reading_that_is_missing(folder, tmp_path):
    """Text in a column that the system does not ask for is nothing to it; nor is a comment."""
    path = tmp_path / "log.csv"
    cells = ["", "nan", "NaN", "N/A", "-", " null ", '""', "1.5"]
    rows = [f"{k / 100:g},0,{cell},idle" for k, cell in enumerate(cells)]
    path.write_text("\n".join(["time_s,voltage_v,position_m,mode", *rows, "# the end"]))
    read = read_plain(path, read_system(folder / "my_robot.py")).columns["position_m"]
    assert np.isnan(read[:-1]).all()
    assert read[-1] == 1.5


def test_a_plain_log_may_begin_with_the_mark_of_a_spreadsheet(folder, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text((folder / "log.csv").read_text(), encoding="utf-8-sig")
    system = read_system(folder / "my_robot.py")
    plain = read_plain(folder / "log.csv", system)
    marked = read_plain(path, system)
    assert np.array_equal(marked.time_s, plain.time_s)
    assert np.array_equal(marked.columns["position_m"], plain.columns["position_m"])


@pytest.fixture(scope="module")
def foreign(folder):
    """The same log as another logger writes it: other names, milliseconds, millivolts, mm."""
    rows = np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1) * 1000.0
    header = "stamp_ms,motor_mV,encoder_mm"
    np.savetxt(folder / "foreign.csv", rows, delimiter=",", header=header, comments="")
    return folder / "foreign.csv"


def _simulated(folder, *words):
    given = ["simulate", "--system", str(folder / "my_robot.py"), *map(str, words)]
    return CliRunner().invoke(command, given)


def test_a_log_in_other_names_and_units_is_the_same_log(folder, foreign, tmp_path):
    (tmp_path / "c.toml").write_text(COLUMNS.format(name="voltage_v"))
    plain = _simulated(folder, "--measured", folder / "log.csv", "--json", tmp_path / "plain.json")
    other = _simulated(
        folder, "--measured", foreign, "--columns", tmp_path / "c.toml",
        "--json", tmp_path / "other.json",
    )  # fmt: skip
    assert (plain.exit_code, other.exit_code) == (0, 0)
    (own,) = json.loads((tmp_path / "plain.json").read_text()).values()
    (converted,) = json.loads((tmp_path / "other.json").read_text()).values()
    assert converted["without"]["position_m"] == pytest.approx(own["without"]["position_m"])


@pytest.mark.parametrize(
    ("role", "other"),
    [("input", "output"), ("output", "input"), ("input", "unused"), ("output", "unused")],
)
def test_a_role_that_is_not_the_system_s_is_refused(role, other, folder, foreign, tmp_path):
    """What drives a system is held where it is not logged; what it shows is not."""
    text = COLUMNS.format(name="voltage_v")
    (tmp_path / "c.toml").write_text(text.replace(f'"{role}"', f'"{other}"'))
    ended = _simulated(folder, "--measured", foreign, "--columns", tmp_path / "c.toml")
    said = str(ended.exception)
    assert f"role is {other!r}, and it is an {role} of" in said
    assert said.endswith(f'give role = "{role}".')


def test_a_slow_sensor_judges_a_correction_as_a_fast_one_does(folder, tmp_path):
    """Positions at 20 Hz, ticks at 100 Hz: a repeat would be off by the way since."""
    _corrected(folder, 0.8)
    rows = np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1)
    slow = rows[::5]
    path = tmp_path / "slow.npz"
    np.savez(path, t=rows[:, 0], u=rows[:, 1], slow_t=slow[:, 0], x=slow[:, 2])
    (tmp_path / "c.toml").write_text(
        'version = 1\n[time]\ncolumn = "t"\n[resample]\nrate_hz = 100\n'
        '[columns.voltage_v]\ncolumn = "u"\nrole = "input"\nunit = "V"\n'
        '[columns.position_m]\ncolumn = "x"\ntime = "slow_t"\nrole = "output"\nunit = "m"\n'
    )
    words = ["--correction", folder / "correction.toml", "--json", tmp_path / "told.json"]
    ended = _simulated(folder, "--measured", path, "--columns", tmp_path / "c.toml", *words)
    assert ended.exit_code == 0, ended.output
    (told,) = json.loads((tmp_path / "told.json").read_text()).values()
    assert told["with"]["position_m"] < 0.05 * told["without"]["position_m"]


def test_a_log_that_needs_a_columns_file_says_how_to_begin_one(folder, foreign, tmp_path):
    told = str(_simulated(folder, "--measured", foreign).exception)
    system = folder / "my_robot.py"
    words = f"data import table {foreign} --guess --system {system} --columns"
    assert f"{words} columns.toml" in told
    guessed = [*words.split()[1:], str(tmp_path / "c.toml")]
    ended = CliRunner().invoke(data_command, guessed)
    assert ended.exit_code == 0, ended.output
    assert (
        f"gap check {system} --measured {foreign} --columns {tmp_path / 'c.toml'}" in ended.output
    )
    assert (
        _simulated(folder, "--measured", foreign, "--columns", tmp_path / "c.toml").exit_code == 0
    )


@pytest.mark.parametrize("is_one", [True, False])
def test_a_folder_that_is_one_log_is_named_in_what_comes_next(is_one, folder, tmp_path):
    """Its files have other columns each; where they are alike, a person says which to look at."""
    time_s = np.arange(300) / 100.0
    (tmp_path / "my dive").mkdir()
    for name, column in (("a", "voltage_v"), ("b", "position_m")):
        columns = [column] if is_one else ["voltage_v", "position_m"]
        rows = np.column_stack([time_s, *(np.sin((k + 1) * time_s) for k in range(len(columns)))])
        header = ",".join(["time_s", *columns])
        path = tmp_path / "my dive" / f"{name}.csv"
        np.savetxt(path, rows, "%.4f", ",", header=header, comments="")
    words = ["import", "table", tmp_path / "my dive", "--guess", "--system"]
    words += [folder / "my_robot.py", "--columns", tmp_path / "c.toml"]
    ended = CliRunner().invoke(data_command, list(map(str, words)))
    assert ended.exit_code == 0, ended.output
    log = f"'{tmp_path / 'my dive'}'" if is_one else "LOG"
    assert f"gap check {folder / 'my_robot.py'} --measured {log} --columns" in ended.output


def test_a_name_that_no_column_is_like_is_said(folder, foreign, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(foreign.read_text().replace("encoder_mm", "encoder_ticks", 1))
    words = ["import", "table", log, "--guess", "--system", folder / "my_robot.py"]
    ended = CliRunner().invoke(data_command, [*map(str, words), "--columns", str(tmp_path / "c")])
    assert ended.exit_code == 0, ended.output
    assert "No column was found for position_m: name them by hand." in ended.output


@pytest.mark.parametrize(
    ("name", "lacking"), [("voltage", "position_m:"), ("a", "voltage_v and position_m:")]
)
def test_a_first_columns_file_that_cannot_be_read_yet_is_begun(folder, tmp_path, name, lacking):
    """No clock, and perhaps no column that is found: what to do is in the file."""
    rows = np.random.default_rng(1).standard_normal((2, 300))
    np.savez(tmp_path / "log.npz", **dict(zip([name, "other"], rows, strict=True)))
    words = ["import", "table", tmp_path / "log.npz", "--guess", "--system", folder / "my_robot.py"]
    columns = tmp_path / "c.toml"
    ended = CliRunner().invoke(data_command, [*map(str, words), "--columns", str(columns)])
    assert ended.exit_code == 0, ended.output
    assert f"No column was found for {lacking}" in ended.output
    assert "rate_hz = 0  # not found in the log" in columns.read_text()


def test_a_system_goes_with_a_guess_alone(folder, foreign):
    words = ["import", "table", foreign, "--system", folder / "my_robot.py", "--columns", "c.toml"]
    ended = CliRunner().invoke(data_command, [str(word) for word in [*words, "--out", "set"]])
    assert ended.exit_code == 2
    assert "Give --system only with --guess." in ended.output


def test_a_folder_is_told_of_its_columns_file(folder, tmp_path):
    words = ["check", str(folder / "my_robot.py"), "--measured", str(tmp_path)]
    told = str(CliRunner().invoke(command, words).exception)
    assert told.startswith(f"{tmp_path} is a folder, not a CSV file; say by --columns what it hold")
    system = folder / "my_robot.py"
    assert f"data import table {tmp_path} --guess --system {system} --columns columns.toml" in told


def test_a_column_without_the_systems_name_says_where_to_name_it(folder, foreign, tmp_path):
    (tmp_path / "c.toml").write_text(COLUMNS.format(name="motor_mv"))
    told = _simulated(folder, "--measured", foreign, "--columns", tmp_path / "c.toml")
    assert "among motor_mv, position_m; call it so, in a columns.toml by [columns.voltage_v]" in (
        str(told.exception)
    )


def test_a_unit_that_does_not_fit_is_refused_by_the_name_of_its_file(folder, foreign, tmp_path):
    text = COLUMNS.format(name="voltage_v").replace('"mV"', '"mA"')
    (tmp_path / "other.toml").write_text(text)
    told = str(
        _simulated(folder, "--measured", foreign, "--columns", tmp_path / "other.toml").exception
    )
    assert told.startswith(f"{tmp_path / 'other.toml'}: columns.voltage_v.unit: 'mA'")


def test_the_first_columns_file_knows_millivolts_by_their_name(foreign):
    text = guess_columns(foreign)
    assert 'column = "motor_mV"\nrole = "unused"\nunit = "mV"' in text
    assert 'to = "mV"' in text


def test_a_share_that_is_not_the_whole_never_reads_as_the_whole():
    size = {"value": 1.0, "low": 0.9, "high": 1.1, "unit": "N"}
    forecast = {"share": 0.9996, "low": 0.994, "high": 0.9999}
    effect = {"name": "friction", "parameters": {"force": size}, "forecast": forecast}
    told = sentences(
        Answer(
            **{"domain": "cart", "verdict": "named", "class": [], "effects": [effect]},
            threshold_nats=3.0,
            parameters={},
            constants={},
            noise={},
            rounds=[],
            unsettled=[],
            sealed_gain_nats=9.0,
        )
    )
    assert "removes over 99 % of" in told[1]
    assert "100 %" not in told[1]


@pytest.mark.parametrize(
    ("verdict", "step", "logs"),
    [
        ("named", "simulate", ["new.csv"]),  # a log that was searched would prove nothing
        ("class", "close", ["a b.csv", "c.csv", "new.csv"]),
        ("unknown", "check", ["a b.csv", "c.csv"]),
        ("none", "power", ["a b.csv", "c.csv"]),
    ],
)
def test_the_command_that_follows_has_the_logs_that_its_sentence_asks_for(verdict, step, logs):
    result = SimpleNamespace(
        verdict=verdict, moved={}, rivals=[], effects=["coulomb-friction@speed_mps"], curved=[],
        unexplained=[],
    )  # fmt: skip
    measured = (Path("a b.csv"), Path("c.csv"))
    told = next_commands(result, Path("robot.py"), measured, Path("columns.toml"), Path("gap"))
    words = shlex.split(told[-1])
    assert words[:3] == ["wakedeploy", "gap", step]
    named = [after for word, after in itertools.pairwise(words) if word == "--measured"]
    assert named == logs
    assert words[words.index("--columns") + 1] == "columns.toml"
    result.curved = ["pulse_us"]  # the law has to be stated first, and the same logs asked again
    (again,) = next_commands(result, Path("robot.py"), measured, None, Path("gap"))
    assert again.startswith("wakedeploy gap close --system robot.py --measured 'a b.csv' ")


@pytest.mark.parametrize(
    ("measured", "further"),
    [
        ("a.csv.gz", "new.csv.gz"),
        ("A.CSV.GZ", "new.CSV.GZ"),
        ("a.v2.npz", "new.npz"),
        ("a.log", "new.log"),
        ("day", "new"),
    ],
)
def test_a_further_log_is_called_as_one_of_its_format(measured, further):
    result = SimpleNamespace(
        verdict="named", moved={}, rivals=[], effects=["coulomb-friction@speed_mps"], curved=[],
        unexplained=[],
    )  # fmt: skip
    (told,) = next_commands(result, Path("robot.py"), [Path(measured)], None, Path("gap"))
    assert f" --measured {further} " in told


@pytest.mark.parametrize(
    ("step", "verdict", "command", "following"),
    [
        ("find", None, "wakedeploy gap find --system a.py --json 'a b.json' --out g",
         "wakedeploy gap name --system a.py --out g"),
        ("find", None, "wakedeploy gap find --json=x.json --system 'my find.py'",
         "wakedeploy gap name --system 'my find.py'"),
        ("name", "named", "wakedeploy gap name --system a.py", "wakedeploy gap add --system a.py"),
        ("name", "class", "wakedeploy gap name --system a.py", None),
        ("name", "none", "wakedeploy gap name --system a.py", None),
        ("add", "named", "wakedeploy gap add --system a.py", None),
    ],
)  # fmt: skip
def test_a_step_says_which_command_follows_where_one_does(
    step: str, verdict: str | None, command: str, following: str | None
) -> None:
    told = None if verdict is None else answer_with(verdict, {}, {})
    assert _following(step, SimpleNamespace(artefact=told), command) == following


def test_a_plan_names_the_system_of_another_answer(folder, tmp_path):
    """That nothing is open there is no news about this one."""
    sizes = {"viscous-friction@speed_mps": {}}
    answer_with("named", sizes, {}).write(tmp_path / "name.json")
    asked = ["--system", str(folder / "my_robot.py"), "--measured", str(folder / "log.csv")]
    told = CliRunner().invoke(command, ["plan", *asked, "--out", str(tmp_path)])
    assert isinstance(told.exception, UnusableInput)
    assert "holds what was found about made, and this is MyRobot" in str(told.exception)
