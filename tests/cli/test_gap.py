"""`wakedeploy gap` as a person meets it: wrong input in one sentence, Ctrl-C without loss."""

import csv
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from wakedeploy.cli import main
from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import record
from wakedeploy.gap.folder import at_work
from wakedeploy.gap.systems.gantry.artefacts import Add, Artefact, Find, Name, Show
from wakedeploy.gap.systems.gantry.artefacts import Result as Told
from wakedeploy.gap.systems.gantry.findings import Effect
from wakedeploy.gap.systems.gantry.folder import write
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds
from wakedeploy.gap.systems.gantry.search.threshold import _cache_path
from wakedeploy.rig.file import default_rig

STEPS = ("close", "find", "name", "add", "show")


@pytest.fixture(scope="module")
def log() -> RunLog:
    return record(default_rig(), seconds=12, seed=7)


@pytest.fixture
def folder(tmp_path: Path, log: RunLog, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rig file with its thresholds known, one flight, and nothing else."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    rig = default_rig()
    rig.write(tmp_path / "rig.toml")
    cached = _cache_path(rig)
    cached.parent.mkdir(parents=True)
    cached.write_text(json.dumps(asdict(Thresholds(6.0, 8.0, 8.0, 60.0, 0.03, 0.03, 0.003))))
    log.write_csv(tmp_path / "flight.csv")
    return tmp_path


def gap(
    folder: Path, step: str, *logs: str, out: str = "out", more: tuple[str, ...] = ()
) -> Result:
    measured = [str(folder / name) for name in logs]
    given = ["--rig", str(folder / "rig.toml"), "--measured", *measured, "--out", str(folder / out)]
    return CliRunner().invoke(main, ["gap", step, *given, *more])


def refused(told: Result, words: str) -> None:
    """Exit 2 and one sentence that says it, no traceback."""
    assert told.exit_code == 2, told.output
    assert words in told.stderr
    assert "Traceback" not in told.output
    assert "unexpected" not in told.stderr


def test_every_command_explains_itself() -> None:
    listed = CliRunner().invoke(main, ["gap", "--help"]).output
    for step in (*STEPS, "plan", "power", "demo", "export", "domain"):
        assert f"  {step} " in listed
        told = CliRunner().invoke(main, ["gap", step, "--help"])
        assert told.exit_code == 0
        assert f"wakedeploy gap {step} " in told.output  # an example to copy


def without(log: RunLog, folder: Path, column: str) -> None:
    log.write_csv(folder / "bad.csv")
    rows = list(csv.reader((folder / "bad.csv").read_text("utf-8").splitlines()))
    at = rows[0].index(column)
    lines = [",".join(row[:at] + row[at + 1 :]) for row in rows]
    (folder / "bad.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def changed(log: RunLog, folder: Path, column: str, values: object) -> None:
    RunLog({**log.columns, column: values}, dict(log.metadata)).write_csv(folder / "bad.csv")


@pytest.mark.parametrize("column", ["t_s", "mode", "range_m", "steps"])
def test_a_log_that_lacks_a_column_is_refused_by_its_name(
    folder: Path, log: RunLog, column: str
) -> None:
    without(log, folder, column)
    refused(gap(folder, "find", "bad.csv"), f"lacks the column(s) {column}")


def test_broken_flights_are_refused_with_the_reason(folder: Path, log: RunLog) -> None:
    count = len(log["t_s"])
    later = log["t_s"] + 2.0 * (np.arange(count) > count // 2)
    for column, values, words in (
        ("t_s", later, "the clock jumps by 2.03 s"),
        ("t_s", 2 * log["t_s"][count // 2] - later, "does not rise"),
        ("range_m", np.full(count, 0.3), "range_m is constant"),
        ("range_m", np.full(count, np.nan), "only 0 fresh range samples"),
        ("sufferer_cmd_us", np.full(count, 1500.0), "sufferer_cmd_us is constant"),
    ):
        changed(log, folder, column, values)
        refused(gap(folder, "find", "bad.csv"), words)
    for ticks, words in ((20, "only 20 ticks"), (90, "never flew"), (200, "s in the air")):
        log.select(slice(0, ticks)).write_csv(folder / "bad.csv")
        refused(gap(folder, "find", "bad.csv"), words)


def test_wrong_files_and_arguments_are_refused(folder: Path) -> None:
    (folder / "empty.csv").write_text("", encoding="utf-8")
    refused(gap(folder, "close", "empty.csv"), "is empty")
    for step in STEPS:
        refused(gap(folder, step, "missing.mcap", out="none"), "there is no such file in ")
    assert not (folder / "none").exists()
    refused(gap(folder, "close", "flight.csv", "flight.csv"), "the same recording more than once")
    refused(gap(folder, "close"), "Missing option '--measured'")
    refused(gap(folder, "close", "flight.csv", out="."), "would overwrite the rig file")
    refused(gap(folder, "close", "flight.csv", out="rig.toml/below"), "cannot be written to")
    both = ("--effect", "stiction", "--from-symbolic")
    refused(gap(folder, "add", "flight.csv", more=both), "exclude each other")
    default_rig().changed(limits={"slew_us_per_s": 900.0}).write(folder / "rig.toml")
    refused(gap(folder, "find", "flight.csv", out="o"), "[limits] in its metadata differs")


def test_steps_out_of_order_say_which_one_comes_first(folder: Path) -> None:
    refused(gap(folder, "name", "flight.csv"), "run `wakedeploy gap find` first")
    refused(gap(folder, "add", "flight.csv"), "run `wakedeploy gap name` first")
    refused(gap(folder, "show", "flight.csv"), "run `wakedeploy gap name` first")


@pytest.mark.whole
def test_ctrl_c_in_training_leaves_the_result_and_the_report(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def stands_in(told: Artefact) -> Callable[..., Artefact]:
        def run(_: object, out: Path, *__: object) -> Artefact:
            done.append(type(told).__name__.lower())
            return write(out, told)

        return run

    found = {"verdict": "named", "effects": [Effect(name="spool-lag-source")]}
    added = Add(rig="rig.toml", old_sha256="", new_sha256="", effects=[])
    for function, told in {
        "find": Find(), "name": Name(**found), "add": added, "show_gap": Show(),
        "_concluded": Told(**found),
    }.items():  # fmt: skip
        monkeypatch.setattr(f"wakedeploy.gap.systems.gantry.workflow.{function}", stands_in(told))

    def interrupted(*_: object) -> None:
        done.append("training")
        raise KeyboardInterrupt

    monkeypatch.setattr("wakedeploy.gap.systems.gantry.workflow.retrain_shown", interrupted)
    for i in range(3):
        record(default_rig(), seconds=12, seed=8 + i).write_csv(folder / f"flight{i}.csv")
    flights = ["flight.csv", *(f"flight{i}.csv" for i in range(3))]
    told = gap(folder, "close", *flights, more=("--retrain",))
    assert told.exit_code == 130, told.output
    assert done == ["find", "name", "add", "show", "result", "training"]
    trains = next(line for line in told.stderr.splitlines() if line.startswith("wakedeploy gap"))
    assert trains.startswith(f"wakedeploy gap show --rig {folder}/rig.toml --measured {folder}/")
    assert trains.endswith(f"--out {folder}/out --retrain")


@pytest.mark.parametrize("step", STEPS)
def test_two_at_once_in_one_folder_would_mix_their_steps(folder: Path, step: str) -> None:
    with at_work(folder / "out"):
        refused(gap(folder, step, "flight.csv"), "Another gap command is at work in")
    shown = [p for p in (folder / "out").iterdir() if not p.name.startswith(".")]
    assert shown == []


@pytest.mark.whole
def test_ctrl_c_keeps_what_is_finished_and_says_how_to_go_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("wakedeploy.gap.systems.gantry.workflow.name", interrupted)
    told = gap(folder, "close", "flight.csv")
    assert told.exit_code == 130
    go_on = f"--rig {folder}/rig.toml --measured {folder}/flight.csv --out {folder}/out"
    assert f"finished steps are kept; go on with:\nwakedeploy gap name {go_on}\n" in told.stderr
    assert json.loads((folder / "out" / "find.json").read_text("utf-8"))["maps"]


@pytest.mark.parametrize("step", ["close", "find"])
def test_ctrl_c_before_a_step_is_finished_gives_the_command_back(
    folder: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    module = "workflow" if step == "close" else "find_name_add_show"
    monkeypatch.setattr(f"wakedeploy.gap.systems.gantry.{module}.open_case", interrupted)
    monkeypatch.setattr("sys.argv", ["/x/wakedeploy", "gap", step, "--rig", "my rig.toml"])
    told = gap(folder, step, "flight.csv")
    assert told.exit_code == 130
    assert f"wakedeploy gap {step} --rig 'my rig.toml'\n" in told.stderr


def test_ctrl_c_with_a_system_of_ones_own_gives_the_command_back(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("wakedeploy.api.systems.log_model", interrupted)
    monkeypatch.setattr("sys.argv", ["wakedeploy", "gap", "close", "--system", "my robot.py"])
    own = ["--system", "my robot.py", "--measured", str(folder / "flight.csv")]
    told = CliRunner().invoke(main, ["gap", "close", *own, "--out", str(folder / "own")])
    assert told.exit_code == 130
    assert "wakedeploy gap close --system 'my robot.py'\n" in told.stderr


def test_a_folder_in_the_place_of_flights_says_what_to_give(folder: Path) -> None:
    words = ["--rig", str(folder / "rig.toml"), "--measured", str(folder)]
    told = CliRunner().invoke(main, ["gap", "find", *words, "--out", str(folder / "out")])
    assert told.exit_code == 2
    assert f"{folder} is a folder; of a rig give the run logs" in told.stderr
