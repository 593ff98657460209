"""Plans: what they stand for, and what is told of one that cannot be used."""

import dataclasses
import math
from pathlib import Path

import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.rig.file import default_rig_text
from wakedeploy.sweep.jobs import generate_job
from wakedeploy.sweep.plan import line_of, read_plan

WHOLE = """\
data = ["short", "small"]
arch = ["gru", "tcn"]
seeds = 3
lead = [0.0, 0.1]

[settings]
epochs = [2, 4]

[hyper.gru]
hidden = [8, 16]

[[generate]]
name = "other"
domain = "downwash"
minutes = 1
settings = { spread = 0.1 }

[[generate]]
name = "short"
domain = "ship"
minutes = 3
seed = 5
settings = { level = "slender" }
"""


def plan_file(folder: Path, text: str) -> Path:
    path = folder / "plan.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_list_means_each_of_its_values(tmp_path: Path, small: Path) -> None:
    plan = read_plan(plan_file(tmp_path, WHOLE))
    assert plan.data == {"short": None, "small": small}
    assert len(plan.choices) == 2 * 2 * 3 * (2 + 1)  # leads, epochs, seeds, two GRUs and a TCN
    assert plan.jobs == 2 + 2 * len(plan.choices)
    assert {c.arch for c in plan.choices} == {"gru", "tcn"}
    assert all(c.hyper == {} for c in plan.choices if c.arch == "tcn")
    assert [g.name for g in plan.generate] == ["other", "short"]


def test_a_value_alone_stands_for_a_list_of_one(tmp_path: Path, small: Path) -> None:
    plan = read_plan(plan_file(tmp_path, 'data = "small"\narch = "esn"\nsettings.epochs = 3'))
    (choice,) = plan.choices
    assert (choice.arch, choice.seed, choice.lead_s) == ("esn", 0, None)
    assert choice.settings == {"epochs": 3}


def test_a_plan_may_only_generate(tmp_path: Path) -> None:
    text = '[[generate]]\nname = "a"\ndomain = "ship"\nminutes = 2'
    assert read_plan(plan_file(tmp_path, text)).jobs == 1


def test_options_come_before_the_file_and_their_folders_are_where_we_are(
    tmp_path: Path, small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = plan_file(tmp_path, WHOLE)
    monkeypatch.chdir(small)
    options = {
        "data": ["."],
        "seeds": 1,
        "settings": {"epochs": [1]},
        "hyper": {"gru": {"head": [4]}},
    }
    plan = read_plan(path, options)
    assert plan.data == {".": Path()}
    assert len(plan.choices) == 2 * 1 * 1 * (2 + 1)
    assert {c.hyper["hidden"] for c in plan.choices if c.arch == "gru"} == {8, 16}
    assert {c.hyper["head"] for c in plan.choices if c.arch == "gru"} == {4}


@pytest.mark.parametrize(
    ("change", "line", "says"),
    [
        (('"tcn"]', '"cnn"]'), 2, "'cnn' is no architecture; choose all or agile-mlp"),
        (("seeds = 3", "seeds = 0"), 3, "it has to be at least 1"),
        (("seeds = 3", "sseeds = 3"), 3, "sseeds is not known; known are data, arch, seeds"),
        (("[0.0, 0.1]", "[0.0, -0.1]"), 4, "it has to be at least 0"),
        (("epochs = [", "epoch = ["), 7, "There is no fit setting 'epoch'; there are epochs"),
        (("[2, 4]", "[2, 0]"), 7, "epochs = 0 has to be a whole number from 1"),
        (("[2, 4]", "[2.5]"), 7, "epochs = 2.5 has to be a whole number"),
        (("[2, 4]", '"20"'), 7, "epochs = '20' has to be a whole number"),
        (
            ("[2, 4]", "[4]\nlearning_rate = 2"),
            8,
            "learning_rate = 2 has to be a number from 1e-07",
        ),
        (
            ("[2, 4]", "[4]\ngradient_clip = 0"),
            8,
            "gradient_clip = 0 has to be a number from 1e-06",
        ),
        (("hyper.gru", "hyper.esn"), 9, "'esn' is not among the architectures of this sweep"),
        (("hidden = [8", "hiden = [8"), 10, "gru has no hyper-parameter 'hiden'; it has"),
        (("[8, 16]", "[8, -16]"), 10, "hidden = -16 has to be a whole number"),
        (('"downwash"', '"air"'), 14, "'air' cannot be simulated; choose ship, downwash, gantry"),
        (("spread", "width"), 16, "downwash has no setting 'width'; it has spread"),
        (("0.1 }", "7 }"), 16, "spread = 7 has to be a number from 0 to 0.75"),
        (("minutes = 1\n", ""), 12, "generate.0.minutes is missing"),
        (("minutes = 3", "minutes = 0"), 21, "it has to be at least 0.1"),
        (('"slender"', '"deep"'), 23, "level = 'deep' has to be slender or vortex"),
        (('name = "other"', 'name = "short"'), 19, "two sets are named 'short'"),
        (('name = "other"', 'name = "a/b"'), 13, "should match pattern"),
        (('"small"]', '"smal"]'), 1, "'smal' is no folder with an episode set and none of its"),
    ],
)
def test_what_is_wrong_is_told_with_file_line_and_reason(
    change: tuple[str, str], line: int, says: str, tmp_path: Path, small: Path
) -> None:
    assert change[0] in WHOLE
    path = plan_file(tmp_path, WHOLE.replace(*change, 1))
    with pytest.raises(UnusableInput) as told:
        read_plan(path)
    assert str(told.value).startswith(f"{path}, line {line}: ")
    assert says in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("seeds = 1\ndata = [}", "not valid TOML: .*line 2"),
        ("", "asks for nothing; name sets to train on"),
        ('arch = "gru"', "has arch but no data"),
        ("data = [ ]", "at least 1 item"),
        ("data = 3", "line 1: "),
    ],
)
def test_a_plan_that_is_none(text: str, says: str, tmp_path: Path, small: Path) -> None:
    path = plan_file(tmp_path, text)
    with pytest.raises(UnusableInput, match=says):
        read_plan(path)


def test_a_missing_or_foreign_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"none\.toml: cannot be read as a plan"):
        read_plan(tmp_path / "none.toml")
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UnusableInput, match=r"x\.toml: cannot be read as a plan"):
        read_plan(tmp_path / "x.toml")


def test_a_rig_file_is_part_of_the_plan(tmp_path: Path) -> None:
    text = '[[generate]]\nname = "a"\ndomain = "gantry"\nminutes = 1\nsettings.rig = "rig.toml"'
    with pytest.raises(
        UnusableInput, match=r"plan.*, line 5: .*rig\.toml: cannot be read as a rig file"
    ):
        read_plan(plan_file(tmp_path, text))
    (tmp_path / "rig.toml").write_text(default_rig_text(), encoding="utf-8")
    (made,) = read_plan(plan_file(tmp_path, text)).generate
    assert made.rig == default_rig_text()
    job = generate_job(made)
    moved = dataclasses.replace(made, settings={"rig": "elsewhere/rig.toml"})
    assert generate_job(moved).identity == job.identity
    changed = dataclasses.replace(made, rig=default_rig_text() + "\n")
    assert generate_job(changed).identity != job.identity
    assert job.request["settings"] == {"rig": "rig.toml"}


def test_a_plan_that_is_not_there_is_named_with_the_systems_word(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"nope\.toml: cannot be read as a plan \(No such file"):
        read_plan(tmp_path / "nope.toml")


def test_an_option_is_named_as_such() -> None:
    for options, says in (
        ({"data": ["none"]}, "--data: 'none' is no folder"),
        ({"data": ["none"], "seeds": math.inf}, "--seeds: "),
    ):
        with pytest.raises(UnusableInput, match=f"^{says}"):
            read_plan(None, options)


def test_the_line_of_a_value_that_is_written_in_place_or_dotted() -> None:
    text = "hyper.gru.hidden = 3\nhyper = { gru = { head = 2 } }\n[hyper.esn]\nleak = 1"
    assert line_of(text, ("hyper", "gru", "hidden")) == 1
    assert line_of(text, ("hyper", "esn", "leak")) == 4
    text = "[[generate]]\nname = 1\n[generate.settings]\nx = 1\n[[generate]]\nname = 2\n"
    assert line_of(text, ("generate", 1, "name")) == 6
    assert line_of(text, ("generate", 0, "settings", "x")) == 4


@pytest.mark.parametrize(
    ("place", "line"),
    [
        (("data",), 1),
        (("hyper", "gru", "hidden"), 10),
        (("generate", 1, "minutes"), 21),
        (("generate", 0, "settings", "spread"), 16),
        (("settings",), 6),
        (("nothing",), None),
        ((), None),
    ],
)
def test_the_line_of_a_value(place: tuple, line: int | None) -> None:
    assert line_of(WHOLE, place) == line
