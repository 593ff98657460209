"""After a class: what is open, what is flown for it, and which logs are asked about."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from tests.gap.fabricated_artefacts import NAMES, fabricate, leave
from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import read_run_log
from wakedeploy.domains.gantry import record
from wakedeploy.gap.systems.gantry import follow_up
from wakedeploy.gap.systems.gantry.planning.manoeuvres import menu
from wakedeploy.gap.systems.gantry.planning.plan import Option, Plan
from wakedeploy.rig.file import default_rig

SHORT = min(menu(), key=lambda one: len(one.plan(default_rig()).z_m))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A class in a folder, a plan of one short manoeuvre, and a `close` that says a name."""
    out = tmp_path / "gap"
    fabricate(out, "class")
    rig_path = tmp_path / "rig.toml"
    default_rig().write(rig_path)
    found = json.loads((out / "find.json").read_text())
    found["rig"] = str(rig_path)
    for i, log in enumerate(found["logs"]):
        log |= {"path": str(tmp_path / f"flight{i}.mcap"), "simulated": True}
        (tmp_path / f"flight{i}.mcap").touch()
    (out / "find.json").write_text(json.dumps(found))

    def planned(rig, names, **_):
        loss = 10.0 * (1.0 - np.eye(2))
        option = Option(SHORT, 12.0, loss, 1)
        return Plan(tuple(names), (option,), option)

    def closed(rig_path, logs, out, **_):
        asked.append((rig_path, list(logs)))
        told = {"verdict": "named", "effects": [{"name": NAMES[0]}], "headline": "It lags."}
        return leave(out, "result", told)

    asked: list = []
    monkeypatch.setattr(follow_up, "make_plan", planned)
    monkeypatch.setattr(follow_up, "close", closed)
    return out, asked


@pytest.mark.whole
def test_a_virtual_class_is_flown_and_answered_in_one_command(folder, tmp_path) -> None:
    """The manoeuvre is flown with a seed of its own; its log comes before the earlier ones."""
    out, asked = folder
    done = CliRunner().invoke(main, ["gap", "follow", "--out", str(out)])
    assert done.exit_code == 0, done.output
    ((rig_path, logs),) = asked
    assert rig_path == tmp_path / "rig.toml"
    new, old = logs[:1], logs[1:]
    assert [p.name for p in old] == [f"flight{i}.mcap" for i in range(7)]
    flown = [read_run_log(path) for path in new]
    assert [log.metadata["seed"] for log in flown] == ["7"]
    reference_m = flown[0].columns["z_ref_m"]
    wanted_m = SHORT.plan(default_rig()).z_m
    assert np.nanmax(reference_m) == pytest.approx(np.nanmax(wanted_m), abs=0.01)
    told = json.loads((out / "follow.json").read_text())
    assert (told["before"]["verdict"], told["after"]["verdict"]) == ("class", "named")
    assert told["split"] == NAMES[:2]
    assert "still open" not in done.output


def test_a_rigs_class_is_told_what_to_fly_and_takes_its_logs(folder, tmp_path) -> None:
    out, asked = folder
    found = json.loads((out / "find.json").read_text())
    for log in found["logs"]:
        log["simulated"] = False
    (out / "find.json").write_text(json.dumps(found))
    said = CliRunner().invoke(main, ["gap", "follow", "--out", str(out)]).output
    assert said.count("run-gantry --baseline") == 1
    assert "--reference" in said
    assert (out / "manoeuvre.csv").is_file()
    assert not asked
    log, failed = tmp_path / "new.mcap", tmp_path / "failed.mcap"
    for path, seconds in ((log, 8.0), (failed, 5.0)):
        record(default_rig(), seconds=seconds, seed=9).without_truth().write_mcap(path)
    given = ["gap", "follow", "--out", str(out), "--measured", str(failed)]
    done = CliRunner().invoke(main, given)
    assert done.exit_code == 2
    assert "s in the air" in done.stderr
    assert not asked  # nothing new was flown: the same search would say the same
    done = CliRunner().invoke(main, [*given, str(log)])
    assert done.exit_code == 0, done.output
    assert "Left out: failed.mcap" in done.stderr
    assert [path.name for path in asked[0][1]] == [
        "new.mcap",
        *(f"flight{i}.mcap" for i in range(7)),
    ]
    assert json.loads((out / "follow.json").read_text())["new_logs"] == [str(log)]


def test_of_an_unknown_the_leading_effects_are_told_apart(tmp_path) -> None:
    fabricate(tmp_path, "unknown")
    found = json.loads((tmp_path / "find.json").read_text())
    for i, log in enumerate(found["logs"]):
        log["path"] = str(tmp_path / f"{i}.mcap")
        (tmp_path / f"{i}.mcap").touch()
    (tmp_path / "find.json").write_text(json.dumps(found))
    assert follow_up.what_is_open(tmp_path).names == tuple(NAMES[:2])


@pytest.mark.parametrize(("verdict", "why"), [("named", "nothing is left"), ("none", "nothing is")])
def test_where_nothing_is_open_nothing_is_flown(tmp_path, verdict, why) -> None:
    fabricate(tmp_path, verdict)
    if verdict == "none":
        leave(tmp_path, "result", {"verdict": "none"})
    with pytest.raises(UnusableInput, match=why):
        follow_up.what_is_open(tmp_path)


def test_a_log_that_is_gone_is_asked_for(tmp_path) -> None:
    fabricate(tmp_path, "class")
    with pytest.raises(UnusableInput, match=r"flight0\.mcap"):
        follow_up.what_is_open(tmp_path)


def test_a_folder_of_a_users_system_is_told_what_to_do_instead(tmp_path) -> None:
    (tmp_path / "domain.json").write_text("{}")
    with pytest.raises(UnusableInput, match="ask `wakedeploy gap plan --system`"):
        follow_up.what_is_open(tmp_path)
