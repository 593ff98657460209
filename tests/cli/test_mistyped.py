"""What is mistyped, or spelled as elsewhere, is understood, or answered with what exists."""

from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result
from every_command import EVERY

from trainers.build import ARCHITECTURES as BUILT
from wakedeploy.cli import main
from wakedeploy.cli.groups import ELSEWHERE, MEANT_COMMANDS, OPTIONS
from wakedeploy.cli.names import SOME_ARCHITECTURES
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.names import architectures, domains, meant, near, unknown
from wakedeploy.study.sets import DOMAINS as STUDIED


def typed(line: str) -> Result:
    return CliRunner().invoke(main, line.split(), prog_name="wakedeploy")


def test_a_tilde_that_the_shell_left_is_the_home_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bash keeps it behind `=`; a word that is no local path keeps it for the other machine."""
    home, here = tmp_path / "home", tmp_path / "here"
    for folder in (home, here):
        folder.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(here)
    assert typed("data make gantry --minutes 1 --out=~/sets/a").exit_code == 0
    assert (home / "sets" / "a" / "dataset.json").is_file()
    assert list(here.iterdir()) == []
    told = typed("deploy nowhere.invalid --rollback --directory=~/rig")
    assert str(home) not in told.output
    assert typed("data make gantry --minutes 1 --out=~here").exit_code == 0
    assert [path.name for path in here.iterdir()] == ["~here"]


def test_the_names_are_those_that_there_are() -> None:
    assert tuple(BUILT) == architectures()
    assert tuple(STUDIED) == domains()


@pytest.mark.parametrize(
    "line",
    ["run-gantry --baseline --virtual --seconds nan", "demo --minutes nan",
     "calibrate range --rig rig.toml --virtual --height-m nan"],
)  # fmt: skip
def test_what_is_no_number_is_refused_like_one_out_of_range(line: str) -> None:
    done = typed(line)
    assert done.exit_code == 2
    assert "'nan' is no number." in done.stderr


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("trian", "Did you mean 'wakedeploy train'?"),
        ("fit --data x", "Did you mean 'wakedeploy train'?"),
        ("data maek gantry", "Did you mean 'wakedeploy data make'?"),
        ("data make gantri", "Did you mean 'wakedeploy data make gantry'?"),
        ("gap clsoe", "Did you mean 'wakedeploy gap close'?"),
        ("log sho", "Did you mean 'wakedeploy log show'?"),
        ("study closed_lop", "Did you mean 'wakedeploy study closed-loop'?"),
        ("calibrate nois", "Did you mean 'wakedeploy calibrate noise'?"),
        ("bench latncy", "Did you mean 'wakedeploy bench latency'?"),
        ("rig shwo", "Did you mean 'wakedeploy rig show'?"),
        ("rig check", "'wakedeploy check' or 'wakedeploy gap check'? 'wakedeploy rig' has "),
        ("rig check", " show"),
        ("rig frobnicate", "No such command 'frobnicate'. 'wakedeploy rig' has "),
        ("smooth flight.mcap", "Did you mean 'wakedeploy log smooth'?"),
        ("frobnicate", "No such command 'frobnicate'."),
    ],
)
def test_a_mistyped_command_is_answered_with_the_one_that_is_meant(line: str, told: str) -> None:
    answer = typed(line)
    assert answer.exit_code == 2
    assert told in answer.stderr


@pytest.mark.parametrize("path", EVERY, ids=" ".join)
def test_every_command_is_found_with_two_letters_exchanged(path: tuple[str, ...]) -> None:
    *groups, name = path
    wrong = name[:-2] + name[-1] + name[-2] if name[-1] != name[-2] else name[:-1]
    answer = typed(" ".join([*groups, wrong]))
    assert answer.exit_code == 2
    assert f"'wakedeploy {' '.join(path)}'" in answer.stderr


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("train --lr 0.1", "Did you mean '--learning-rate'?"),
        ("train --learning_rat 0.1", "'--learning-rate'"),
        ("train --epoch 3", "'--epochs'"),
        ("train --model gru", "Did you mean '--arch'?"),
        ("train --dataset x", "Did you mean '--data'?"),
        ("train --batch-size 32", "--preset FILE"),
        ("train --resume", "goes on by itself"),
        ("train -o runs", "Did you mean '--out'?"),
        ("tune --n-trials 5", "Did you mean '--trials'?"),
        ("tune --batch_size 32", "--dimension batch=VALUE"),
        ("sweep --n-jobs 2", "Did you mean '--workers'?"),
        ("data make gantry --output x", "Did you mean '--out'?"),
        ("log export a.mcap --csv a.csv", "Did you mean '--out'?"),
        ("export --model gru", "Did you mean '--arch'?"),
        ("export --output-file a.onnx", "Did you mean '--out'?"),
        ("run-gantry --model a.onnx", "Did you mean '--package'?"),
        ("run-gantry --tty /dev/ttyACM0", "Did you mean '--port'?"),
        ("gap close --logs a.mcap", "Did you mean '--measured'?"),
        ("evaluate --run runs", "wakedeploy evaluate runs --data"),
        ("doctor --frobnicate", "No such option '--frobnicate'."),
    ],
)
def test_an_option_as_it_is_called_elsewhere_is_answered_with_ours(line: str, told: str) -> None:
    answer = typed(line)
    assert answer.exit_code == 2
    assert told in answer.stderr


def test_all_that_is_suggested_exists() -> None:
    there = {name for command in EVERY.values() for p in command.params for name in p.opts}
    for asked, suggested in OPTIONS.items():
        assert set(suggested) <= there, asked
        assert asked not in suggested
    assert {command for command, _ in ELSEWHERE} <= {path[-1] for path in EVERY}
    assert {tuple(path.split()) for path in MEANT_COMMANDS.values()} <= set(EVERY)
    assert not {(name,) for name in MEANT_COMMANDS} & set(EVERY)


@pytest.mark.parametrize("given", ["GRU", " gru", "Gru"])
def test_a_name_is_meant_in_any_case(given: str) -> None:
    assert meant(given, architectures()) == "gru"
    assert meant("History_MLP", architectures()) == meant("history mlp", architectures())
    assert meant("grue", architectures()) is None


def test_what_is_near_is_told() -> None:
    assert near("attention", architectures()) == ["cross-attention"]
    assert near("hist", architectures()) == ["history-mlp"]
    assert near("x", architectures()) == []
    assert unknown("grru", "architecture", ("gru", "tcn")) == (
        "'grru' is no architecture; did you mean gru? Choose gru, tcn"
    )
    assert unknown("cnn", "network", ("gru", "esn")) == "'cnn' is no network; choose gru, esn"


def test_several_names_are_taken_once_each() -> None:
    assert SOME_ARCHITECTURES.convert("GRU, history_mlp,gru", None, None) == ("gru", "history-mlp")
    assert SOME_ARCHITECTURES.convert("ALL", None, None) == architectures()
    with pytest.raises(UnusableInput, match="'grru' is no architecture; did you mean gru"):
        SOME_ARCHITECTURES.convert("tcn,grru", None, None)


@pytest.mark.parametrize(
    ("given", "names"),
    [
        (["--arch", "gru"], ("gru",)),
        (["--arch", "gru", "--arch", "TCN"], ("gru", "tcn")),
        (["--arch", "gru,tcn", "--arch=esn", "--arch", "gru"], ("gru", "tcn", "esn")),
        ([], None),
    ],
)
def test_an_option_of_names_that_is_repeated_has_them_all(
    given: list[str], names: tuple[str, ...] | None, tmp_path: Path
) -> None:
    """The last one alone was trained, and the others were dropped without a word."""
    train = main.get_command(click.Context(main), "train")
    assert train is not None
    context = train.make_context("train", ["--data", str(tmp_path), *given])
    assert context.params["arch"] == names


def test_a_name_in_a_repeated_option_that_there_is_not_is_refused() -> None:
    answer = typed("train --data x --arch grru --arch gru")
    assert answer.exit_code == 2
    assert "'grru' is no architecture; did you mean gru" in answer.stderr


@pytest.mark.parametrize(
    "line",
    ["train --data x --arch GRU", "train --data x --arch History_MLP,gru", "TRAIN --data x",
     "tune --data x --arch Mamba", "sweep --data x --arch GRU --hyper GRU.hidden=8",
     "train --data x --device CPU", "evaluate x --data x --split Test",
     "train --data x --preset Tuned", "tune --data x --arch gru --pruner Median"],
)  # fmt: skip
def test_names_in_another_case_get_as_far_as_the_missing_set(line: str) -> None:
    answer = typed(line)
    assert answer.exit_code == 2
    assert "episode set" in answer.stderr


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("train --data x --arch gruu", "did you mean gru?"),
        ("tune --data x --arch gruu", "did you mean gru?"),
        ("sweep --data x --arch gruu", "did you mean gru?"),
        ("study domains --domains gantri", "did you mean gantry?"),
        ("study lead --arch esm", "did you mean esn?"),
        ("gap plan --class stikction --class stiction", "did you mean stiction?"),
    ],
)
def test_an_unknown_name_is_answered_with_a_near_one(line: str, told: str) -> None:
    answer = typed(line)
    assert answer.exit_code == 2
    assert told in answer.stderr


@pytest.mark.parametrize(
    "path", [(), *(path for path, one in EVERY.items() if isinstance(one, click.Group))]
)
def test_help_cuts_no_summary(path: tuple[str, ...]) -> None:
    shown = typed(" ".join([*path, "--help"])).output
    listed = shown.partition("\nCommands:\n")[2]
    assert listed
    assert "..." not in listed
    for below, command in EVERY.items():
        if below[:-1] == path:
            summary = command.get_short_help_str(10_000)
            assert summary in " ".join(listed.split()), below
            assert summary.endswith("."), below


def test_recordings_are_called_by_their_authors_name_too() -> None:
    ended = CliRunner().invoke(main, ["data", "import", "FlareDW", "--help"])
    assert ended.exit_code == 0
    assert "data import quadrotor [OPTIONS] PATH" in ended.output


@pytest.mark.parametrize("step", ["close", "find", "name", "check", "plan"])
@pytest.mark.parametrize("option", ["--mjcf", "--model"])
def test_a_mujoco_model_in_the_place_of_a_system_is_answered_with_what_makes_one(
    step: str, option: str
) -> None:
    told = typed(f"gap {step} {option} arm.xml").stderr
    assert "`wakedeploy gap init my_robot.py --mjcf MODEL.xml`" in told
    assert "Did you mean" not in told


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("gap close my_robot.py --measured log.csv --out g", "'--system my_robot.py'"),
        ("gap find arms.py:Left --measured log.csv --out g", "'--system arms.py:Left'"),
        ("gap close log.csv --system my_robot.py --out g", "'--measured log.csv'"),
        ("gap check my_robot.py flight.mcap", "'--measured flight.mcap'"),
        ("gap find rig.toml --measured f.mcap --out g", "'--rig rig.toml'"),
        ("gap find c.toml --system a.py --measured l.npz --out g", "'--columns c.toml'"),
        ("gap add lag@motor_v --system a.py --measured l.csv --out g", "'--effect lag@motor_v'"),
        ("gap plan lag@motor_v --system a.py --measured l.csv", "'--class lag@motor_v'"),
    ],
)
def test_a_value_without_an_option_is_answered_with_its_option(line: str, told: str) -> None:
    answer = typed(line)
    assert answer.exit_code == 2
    assert f"stands without an option; give it as {told}." in answer.stderr


def test_a_value_that_no_option_has_is_told_alone_and_help_is_help() -> None:
    assert "'all' stands without an option.\n" in typed("gap close all --out g").stderr
    assert "'0.5' stands without an option.\n" in typed("gap power 0.5 --out g").stderr
    assert "'arm.xml' stands without an option.\n" in typed("gap close arm.xml --out g").stderr
    assert "Find, name, add and show" in typed("gap close my_robot.py --help").output


@pytest.mark.parametrize("second", ["--out b", "--out=b"])
def test_an_option_that_is_given_twice_is_no_matter_of_taking_the_last(second: str) -> None:
    answer = typed(f"gap close --system a.py --measured l.csv --out a {second}")
    assert answer.exit_code == 2
    assert "'--out' is given 2 times; give it once." in answer.stderr
    several = "gap check absent.py --measured a.csv --measured b.csv"
    assert "times" not in typed(several).stderr


@pytest.mark.parametrize("option", ["--rig", "--system"])
def test_a_mujoco_model_as_rig_or_system_is_answered_so_too(option: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s\n")
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    words = f"gap find {option} {tmp_path}/arm.xml --measured {tmp_path}/log.csv --out {tmp_path}/g"
    told = typed(words).stderr
    assert "is a MuJoCo model; `wakedeploy gap init my_robot.py --mjcf MODEL.xml`" in told


def test_an_option_is_not_taken_for_one_that_is_hardly_alike() -> None:
    """Of short names, both hyphens counted as likeness."""
    assert "Did you mean" not in typed("gap power --jsn x").stderr
    assert "power.json" in typed("gap power --json x").stderr
    for given, meant_here in (("--secnds", "--seconds"), ("--col", "--columns")):
        assert f"'{meant_here}'" in typed(f"gap power {given} 3").stderr
