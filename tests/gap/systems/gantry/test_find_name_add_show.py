"""The four steps over files: artefacts agree; foreign and stale ones are refused."""

import json
import shutil
from pathlib import Path

import pytest
from fabricated_artefacts import leave
from recorded import as_it_stands, judged

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import sha256_of
from wakedeploy.core.rig import Effect as RigEffect
from wakedeploy.domains.gantry import record
from wakedeploy.gap.report import page
from wakedeploy.gap.systems.gantry.artefacts import Add, Find, Name, Show
from wakedeploy.gap.systems.gantry.find_name_add_show import Case, add, name, open_case, show_gap
from wakedeploy.gap.systems.gantry.findings import Effect
from wakedeploy.gap.systems.gantry.folder import (
    PICTURES,
    StepArtefacts,
    forget,
    prepare,
    read_plan,
    read_steps,
    required,
    write,
)
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds
from wakedeploy.gap.systems.gantry.workflow import close
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.rig.file import default_rig, read_rig

THRESHOLDS = Thresholds(6.0, 8.0, 8.0, 60.0, 0.03, 0.03, 0.003)
ADDED = "transport-speed"
# What is hidden, what looks like it, and some of each other kind: the whole library takes a minute
# longer.
SEARCHED = (
    "command-latency", "spool-lag-sufferer", "spool-lag-source", ADDED, "coulomb-friction",
)  # fmt: skip
GAP_KEYS = {
    "before", "after", "noise_floor", "unit", "closed", "before_interval", "after_interval",
}  # fmt: skip


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """Four short flights of motors that lag, and a rig file that says they do not."""
    folder = tmp_path_factory.mktemp("world")
    truth = default_rig()
    rig = truth.without("spool")
    rig.write(folder / "rig.toml")
    logs = [folder / f"flight{i}.mcap" for i in range(4)]
    for i, log in enumerate(logs):
        record(truth, seconds=8, seed=40 + i, model_rig=rig).write_mcap(log)
    return folder / "rig.toml", logs


@pytest.fixture(scope="module")
def closed(world, tmp_path_factory):
    out = tmp_path_factory.mktemp("closed")
    rig_path, logs = world
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(
            "wakedeploy.gap.systems.gantry.search.naming.LIBRARY", {n: LIBRARY[n] for n in SEARCHED}
        )
        result = close(rig_path, logs, out, report=False, thresholds=THRESHOLDS)
        return out, result.as_json()


def content(out: Path, step: str):
    return json.loads((out / f"{step}.json").read_text("utf-8"))


@pytest.mark.whole
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


@pytest.mark.whole
def test_the_last_flight_is_sealed_and_the_rig_file_is_new(world, closed):
    (rig_path, logs), (out, told) = world, closed
    assert content(out, "find")["split"] == {
        "fit": [str(log) for log in logs[:3]], "sealed": [str(logs[3])]
    }  # fmt: skip
    corrected = read_rig(out / "rig.toml")
    assert [e.name for e in corrected.effect] == [e["name"] for e in told["effects"]]
    assert corrected.sha256 == content(out, "add")["new_sha256"]
    assert read_rig(rig_path).effect == ()


@pytest.mark.whole
def test_show_alone_goes_on_from_what_name_left(world, closed, tmp_path):
    rig_path, logs = world
    out = shutil.copytree(closed[0], tmp_path / "out")
    (out / "show.json").unlink()
    show_gap(open_case(rig_path, logs, thresholds=THRESHOLDS), out)
    assert content(out, "show") == content(closed[0], "show")


@pytest.mark.parametrize("left", [None, b"", b"PK\x03\x04 cut short"])
@pytest.mark.whole
def test_show_without_the_fits_of_name_says_which_step_to_run(world, closed, tmp_path, left):
    rig_path, logs = world
    out = shutil.copytree(closed[0], tmp_path / "out")
    (out / "name.npz").unlink() if left is None else (out / "name.npz").write_bytes(left)
    with pytest.raises(UnusableInput, match="run `wakedeploy gap name` again"):
        show_gap(open_case(rig_path, logs, thresholds=THRESHOLDS), out)


@pytest.mark.whole
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
        required(closed[0], "find", "another rig", case.recordings)


@pytest.mark.whole
def test_an_unusable_log_leaves_an_earlier_run_as_it_was(world, closed, tmp_path):
    out = closed[0]
    before = {p.name: p.read_bytes() for p in out.iterdir() if p.is_file()}
    (tmp_path / "empty.csv").write_text("", encoding="utf-8")
    with pytest.raises(UnusableInput):
        close(world[0], [tmp_path / "empty.csv"], out, thresholds=THRESHOLDS)
    assert {p.name: p.read_bytes() for p in out.iterdir() if p.is_file()} == before


@pytest.mark.whole
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
        told = {"rig": "rig.toml", "old_sha256": "", "new_sha256": sha256_of(b"by add")}
        leave(tmp_path, "add", told | {"effects": []})
        forget(tmp_path, "name")
        assert rig.exists() is stays
        assert sorted(p.name for p in tmp_path.glob("*.json")) == ["find.json"]


def test_forgetting_leaves_what_is_not_the_steps_own(tmp_path):
    (tmp_path / "figures").mkdir()
    own = [tmp_path / "figures" / f"{name}.png" for name in PICTURES]
    others = [tmp_path / "figures" / name for name in ("power-separation.png", "my_photo.png")]
    for path in (*own, *others):
        path.write_bytes(b"picture")
    (tmp_path / "report.html").write_text("<title>Mine</title>", encoding="utf-8")
    forget(tmp_path, "find")
    assert [path.exists() for path in (*own, *others)] == [False] * len(own) + [True] * 2
    assert (tmp_path / "report.html").exists()
    with pytest.raises(UnusableInput, match=r"report.html: not a report of these steps"):
        prepare(tmp_path, tmp_path / "elsewhere.toml")
    assert [picture.name for picture in page.PICTURES] == list(PICTURES)


def test_a_torn_plan_is_told(tmp_path):
    assert read_plan(tmp_path) is None
    (tmp_path / "plan.json").write_text('{"class": [', encoding="utf-8")
    with pytest.raises(UnusableInput, match="run the step that writes it again"):
        read_plan(tmp_path)


def test_what_can_come_next_follows_from_what_is_there(tmp_path):
    leave(tmp_path, "find", {"sentence": "x"})
    assert (read_steps(tmp_path).missing, read_steps(tmp_path).option) == ("name", "")
    unknown = {"verdict": "unknown", "unknown": {"expression": "c1*x_m"}}
    leave(tmp_path, "name", unknown)
    assert (read_steps(tmp_path).missing, read_steps(tmp_path).option) == (
        "add", " --from-symbolic"
    )  # fmt: skip


@pytest.mark.whole
def test_nothing_of_a_class_is_added_without_a_name(world, closed, tmp_path):
    out = shutil.copytree(closed[0], tmp_path / "out")
    left = read_steps(out).name
    assert left is not None
    unsure = {"verdict": "class", "effects": [], "rivals": [ADDED, "esc-frame"]}
    forget(out, "name")
    write(out, left.model_copy(update=unsure))
    assert read_steps(out).missing == "plan"
    case = open_case(*world, thresholds=THRESHOLDS)
    with pytest.raises(UnusableInput, match="--effect"):
        add(case, out)
    with pytest.raises(UnusableInput, match="ranks no effect 'wind'"):
        add(case, out, only="wind")


@pytest.mark.slow
def test_an_effect_asked_for_has_the_size_that_the_gap_is_shown_with(world, closed, tmp_path):
    """Not the one it was ranked with, before all that is sure was found."""
    out = shutil.copytree(closed[0], tmp_path / "out")
    case = open_case(*world, thresholds=THRESHOLDS)
    add(case, out, only=ADDED)
    rig = as_it_stands(out / "rig.toml")
    assert {e.name for e in rig.effect} == {"spool-lag-sufferer", "spool-lag-source", ADDED}
    true_mps = case.rig.wake.speed_mps  # the flights' own
    (speed,) = (e.parameters["speed_mps"].value for e in rig.effect if e.name == ADDED)
    ranked = [r["ranking"] for r in content(out, "name")["rounds"]]
    alone = [e["parameters"] for entries in ranked for e in entries if e["name"] == ADDED]
    assert abs(speed - true_mps) < 0.3 * abs(alone[-1]["speed_mps"]["value"] - true_mps)
    gap = show_gap(case, out).gap["height 0.25 s ahead"]
    _, error_m = judged(rig, case.flights, case.sealed)
    assert error_m == pytest.approx(gap.after, rel=0.02)


@pytest.mark.whole
def test_an_effect_that_was_named_keeps_its_size_if_it_is_asked_for(world, closed, tmp_path):
    out = shutil.copytree(closed[0], tmp_path / "out")
    add(open_case(*world, thresholds=THRESHOLDS), out, only="spool-lag-sufferer")
    assert read_rig(out / "rig.toml").sha256 == read_rig(closed[0] / "rig.toml").sha256


@pytest.mark.whole
def test_add_runs_again_after_it_was_killed_while_it_wrote(world, closed, tmp_path, monkeypatch):
    out = shutil.copytree(closed[0], tmp_path / "out")
    case = open_case(*world, thresholds=THRESHOLDS)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("wakedeploy.core.rig.Rig.write", killed)
        with pytest.raises(KeyboardInterrupt):
            add(case, out)
    assert not (out / "rig.toml").exists()
    add(case, out)
    assert read_rig(out / "rig.toml").sha256 == read_rig(closed[0] / "rig.toml").sha256


def test_beside_a_sure_effect_the_class_is_still_to_be_settled() -> None:
    named = Name(verdict="class", effects=[Effect(name="spool-lag")], rivals=["a", "b"])

    def left(*added: str, show: Show | None = None) -> tuple[str | None, str]:
        effects = [RigEffect(name=each) for each in added]
        add = Add(rig="rig.toml", old_sha256="", new_sha256="", effects=effects) if added else None
        steps = StepArtefacts(Find(), named, add, show)
        return steps.missing, steps.option

    assert left() == ("add", "")
    assert left("spool-lag") == ("show", "")
    assert left("spool-lag", show=Show()) == ("plan", "")
    assert left("a", show=Show()) == (None, "")
