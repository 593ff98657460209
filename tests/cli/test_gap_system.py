"""A user's system at the command line: a first file that runs, a log, a correction, bad input."""

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli.gap import command
from wakedeploy.gap.systems.correction import Correction, Document, Named, write_correction
from wakedeploy.gap.systems.loading import read_plain, read_system
from wakedeploy.gap.systems.logs import LogModel


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


def _corrected(folder, coefficient):
    system = read_system(folder / "my_robot.py")
    model = LogModel(system, [read_plain(folder / "log.csv", system)])
    document = Document(
        version=1,
        system="MyRobot",
        sample_s=model.dt_s,
        span_s=model.span_s,
        sizes=model.sizes,
        effect=(Named(name="viscous-friction@speed_mps", parameters={"coefficient": coefficient}),),
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


def test_init_never_overwrites(folder):
    told = CliRunner().invoke(command, ["init", str(folder / "my_robot.py")])
    assert "is there already" in str(told.exception)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("version = 2\n", "system"),
        ('version = 1\nsystem = "Other"\nsample_s = 1\nspan_s = 1\n[sizes]\n', "not 'MyRobot'"),
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


def test_an_uneven_log_is_refused_with_the_way_out(folder, tmp_path):
    (tmp_path / "log.csv").write_text("time_s,voltage_v,position_m\n0,1,1\n1,1,1\n5,1,1\n6,1,1\n")
    told = CliRunner().invoke(
        command, ["check", str(folder / "my_robot.py"), "--measured", str(tmp_path / "log.csv")]
    )
    assert "--columns" in str(told.exception)
