"""The four steps over files: artefacts agree; foreign and stale ones are refused."""

import json
import shutil
from pathlib import Path

import pytest

from wakedeploy.domains.gantry import record
from wakedeploy.errors import UnusableInput
from wakedeploy.files import sha256_of
from wakedeploy.gap.close import Case, add, close, name, open_case, show_gap
from wakedeploy.gap.naming import Thresholds
from wakedeploy.gap.steps import forget, prepare, read_steps, require, write_step
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.rig import default_rig, read_rig
from wakedeploy.runlog_mcap import write_mcap

THRESHOLDS = Thresholds(6.0, 8.0, 8.0, 60.0, 0.03, 0.03, 0.003)
GAP_KEYS = {"before", "after", "noise_floor", "unit", "closed"}


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """Four short flights of motors that lag, and a rig file that says they do not."""
    folder = tmp_path_factory.mktemp("world")
    truth = default_rig()
    rig = truth.without("spool")
    rig.write(folder / "rig.toml")
    logs = [folder / f"flight{i}.mcap" for i in range(4)]
    for i, log in enumerate(logs):
        write_mcap(record(truth, seconds=12, seed=40 + i, model_rig=rig), log)
    return folder / "rig.toml", logs


@pytest.fixture(scope="module")
def closed(world, tmp_path_factory):
    out = tmp_path_factory.mktemp("closed")
    rig_path, logs = world
    return out, close(rig_path, logs, out, report=False, thresholds=THRESHOLDS)


def content(out: Path, step: str):
    return json.loads((out / f"{step}.json").read_text("utf-8"))


def test_the_result_has_the_promised_shape_and_the_librarys_names(closed):
    out, told = closed
    assert told == content(out, "result")
    assert told["verdict"] in ("named", "class")
    assert {"where", "gap", "placebo", "plan"} <= set(told)
    for effect in told["effects"]:
        units = {p.name: p.unit for p in LIBRARY[effect["name"]].parameters}
        assert {n: p["unit"] for n, p in effect["parameters"].items()} == units
        assert 0.0 <= effect["confidence"] <= 1.0
        for p in effect["parameters"].values():
            assert p["low"] <= p["value"] <= p["high"]
    for place in told["where"]:
        assert {"channel", "coordinate", "low", "high", "residual", "unit", "q_value"} <= set(place)
    for gap in told["gap"].values():
        assert set(gap) == GAP_KEYS
        assert gap["after"] < gap["before"]


def test_the_last_flight_is_sealed_and_the_rig_file_is_new(world, closed):
    (rig_path, logs), (out, told) = world, closed
    assert content(out, "find")["split"] == {
        "fit": [str(log) for log in logs[:3]], "sealed": [str(logs[3])]
    }  # fmt: skip
    corrected = read_rig(out / "rig.toml")
    assert [e.name for e in corrected.effect] == [e["name"] for e in told["effects"]]
    assert corrected.sha256 == content(out, "add")["new_sha256"]
    assert read_rig(rig_path).effect == ()


def test_show_alone_goes_on_from_what_name_left(world, closed, tmp_path):
    rig_path, logs = world
    out = shutil.copytree(closed[0], tmp_path / "out")
    (out / "show.json").unlink()
    show_gap(open_case(rig_path, logs, thresholds=THRESHOLDS), out)
    assert content(out, "show") == content(closed[0], "show")


@pytest.mark.parametrize("left", [None, b"", b"PK\x03\x04 cut short"])
def test_show_without_the_fits_of_name_says_which_step_to_run(world, closed, tmp_path, left):
    rig_path, logs = world
    out = shutil.copytree(closed[0], tmp_path / "out")
    (out / "name.npz").unlink() if left is None else (out / "name.npz").write_bytes(left)
    with pytest.raises(UnusableInput, match="run `wakedeploy gap name` again"):
        show_gap(open_case(rig_path, logs, thresholds=THRESHOLDS), out)


def test_no_step_goes_on_from_other_logs_or_before_its_turn(world, closed, tmp_path):
    rig_path, logs = world
    case = open_case(rig_path, logs, thresholds=THRESHOLDS)
    with pytest.raises(UnusableInput, match="run `wakedeploy gap find`"):
        name(case, tmp_path)
    for step in (add, show_gap):
        with pytest.raises(UnusableInput, match="run `wakedeploy gap name`"):
            step(case, tmp_path)
    other = Case(case.rig, case.flights, (), THRESHOLDS)
    for step in (name, add, show_gap):
        with pytest.raises(UnusableInput, match="other logs"):
            step(other, closed[0])
    with pytest.raises(UnusableInput, match="other logs"):
        require(closed[0], "find", "another rig", case.recordings)


def test_an_unusable_log_leaves_an_earlier_run_as_it_was(world, closed, tmp_path):
    out = closed[0]
    before = {p.name: p.read_bytes() for p in out.iterdir() if p.is_file()}
    (tmp_path / "empty.csv").write_text("", encoding="utf-8")
    with pytest.raises(UnusableInput):
        close(world[0], [tmp_path / "empty.csv"], out, thresholds=THRESHOLDS)
    assert {p.name: p.read_bytes() for p in out.iterdir() if p.is_file()} == before


def test_the_rig_file_given_is_never_written_over(world, tmp_path):
    rig_path, logs = world
    with pytest.raises(UnusableInput, match="would overwrite"):
        close(rig_path, logs, rig_path.parent, thresholds=THRESHOLDS)
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(UnusableInput, match="cannot be written"):
        prepare(tmp_path / "file" / "below", rig_path)


def test_forgetting_takes_the_workflows_own_rig_file_and_no_other(tmp_path):
    rig = tmp_path / "rig.toml"
    for written, stays in ((b"by add", False), (b"by hand", True)):
        rig.write_bytes(written)
        for step in ("find", "name", "show"):
            (tmp_path / f"{step}.json").write_text("{}", encoding="utf-8")
        told = {"new_sha256": sha256_of(b"by add")}
        (tmp_path / "add.json").write_text(json.dumps(told), encoding="utf-8")
        forget(tmp_path, "name")
        assert rig.exists() is stays
        assert sorted(p.name for p in tmp_path.glob("*.json")) == ["find.json"]


def test_what_can_come_next_follows_from_what_is_there(tmp_path):
    (tmp_path / "find.json").write_text('{"sentence": "x"}', encoding="utf-8")
    assert (read_steps(tmp_path).missing, read_steps(tmp_path).option) == ("name", "")
    unknown = {"verdict": "unknown", "unknown": {"expression": "c1*x_m"}}
    (tmp_path / "name.json").write_text(json.dumps(unknown), encoding="utf-8")
    assert (read_steps(tmp_path).missing, read_steps(tmp_path).option) == (
        "add", " --from-symbolic"
    )  # fmt: skip


def test_a_class_is_added_by_name_with_what_is_sure_beside_it(world, tmp_path):
    """As the last search fitted it; without a name nothing of it is added."""
    rig_path, logs = world
    case = open_case(rig_path, logs, thresholds=THRESHOLDS)

    def entry(name: str, value: float):
        (p,) = LIBRARY[name].parameters
        stated = {"value": value, "low": 0.9 * value, "high": 1.1 * value, "unit": p.unit}
        return {"name": name, "parameters": {p.name: stated}}

    rounds = [
        {"given": [], "ranking": [entry("battery-sag", 1e-4), entry("range-drift", 1e-3)]},
        {"given": ["battery-sag"], "ranking": [entry("range-drift", 2e-3)]},
    ]
    named = {
        "verdict": "class",
        "effects": [entry("battery-sag", 1e-4)],
        "class": ["range-drift", "belt-backlash"],
        "rounds": rounds,
    }
    find_step = {"rig_sha256": case.rig.sha256, "logs": [{"sha256": s} for s in case.recordings]}
    write_step(tmp_path, "find", find_step)
    write_step(tmp_path, "name", named | {"effects": []})
    assert read_steps(tmp_path).option == " --effect range-drift"
    with pytest.raises(UnusableInput, match="--effect"):
        add(case, tmp_path)
    write_step(tmp_path, "name", named)
    add(case, tmp_path, only="range-drift")
    added = {e.name: e for e in read_rig(tmp_path / "rig.toml").effect}
    assert set(added) == {"battery-sag", "range-drift"}
    assert added["range-drift"].parameters["drift_mps"].value == 2e-3
