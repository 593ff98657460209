"""What comes after an answer: commands that exist, with the files that the answer wrote."""

import shlex

from fabricated_artefacts import fabricate

from wakedeploy.cli import main
from wakedeploy.gap.report.advice import advice
from wakedeploy.gap.systems.gantry.folder import read_steps
from wakedeploy.rig.file import default_rig


def test_after_names_were_added_the_next_step_simulates_and_trains(tmp_path) -> None:
    fabricate(tmp_path, "named")
    assert advice(read_steps(tmp_path), tmp_path) is None  # no rig file was written here
    default_rig().write(tmp_path / "rig.toml")
    told = advice(read_steps(tmp_path), tmp_path)
    make, train = (shlex.split(command) for command in told.commands)
    assert make[:4] == ["wakedeploy", "data", "make", "gantry"]
    assert make[make.index("--rig") + 1] == str(tmp_path / "rig.toml")
    assert train[train.index("--data") + 1] == make[make.index("--out") + 1]
    data = main.get_command(None, "data").get_command(None, "make").get_command(None, "gantry")
    for words, command in ((make, data), (train, main.get_command(None, "train"))):
        known = {name for p in command.params for name in p.opts}
        assert {word for word in words if word.startswith("--")} <= known


def test_nothing_comes_after_a_rig_that_lacks_nothing(tmp_path) -> None:
    fabricate(tmp_path, "none")
    default_rig().write(tmp_path / "rig.toml")
    told = advice(read_steps(tmp_path), tmp_path)
    assert told is None or not any("data make" in command for command in told.commands)
