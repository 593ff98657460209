"""Artefacts of the gap workflow that somebody forged: one sentence that names the file."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fabricated_artefacts import PLACE, fabricate, summary
from recorded import flown

from benchmarks.hidden_effects.lines import LINES, read_lines
from wakedeploy.cli.gap_plan import _class_in
from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.report.summary import account
from wakedeploy.gap.search.artefacts import VERSION, Place
from wakedeploy.gap.search.places import forbids_none
from wakedeploy.gap.systems.gantry import find_name_add_show as close
from wakedeploy.gap.systems.gantry.artefacts import Name
from wakedeploy.gap.systems.gantry.folder import read_steps
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.planning.plan import stated_sizes
from wakedeploy.gap.systems.gantry.search.expression_terms import TERMS
from wakedeploy.gap.systems.gantry.search.saved_fits import FITS, Found
from wakedeploy.gap.wording import number
from wakedeploy.rig.file import default_rig

RIG = default_rig()
LOGS = ["cd" * 32] * 7


def changed(folder: Path, step: str, **changes: object) -> Path:
    path = folder / f"{step}.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    fabricate(tmp_path)
    return changed(tmp_path, "find", rig_sha256=RIG.sha256)


@pytest.mark.parametrize(
    ("step", "changes", "told"),
    [
        ("find", {"logs": 7}, "logs = 7"),
        ("find", {"places": [PLACE | {"q_value": "low"}]}, "places.0.q_value = 'low'"),
        ("name", {"effects": [{"name": 3}]}, "effects.0.name = 3"),
        ("name", {"effects": [{"name": "x", "parameters": [1]}]}, "effects.0.parameters"),
        (
            "name",
            {"rounds": [{"given": [], "ranking": [{}]}]},
            "rounds.0.ranking.0.name is missing",
        ),
        ("name", {"class": "both"}, "class = 'both'"),
        ("name", {"verdict": "perhaps"}, "verdict = 'perhaps'"),
        ("name", {"gremlin": 1}, "gremlin is not known"),
        ("name", {"version": 0}, f"version 0; this program reads {VERSION}"),
        (
            "name",
            {"unknown": {"parameters": {"c1": {"value": 1e300}}}},
            r"unknown\.parameters\.c1\.value = 1e\+300",
        ),
        ("add", {"effects": {}}, "effects"),
        ("show", {"gap": {"force": 1}}, "gap.force = 1"),
        ("result", {"class": [None]}, "class.0"),
    ],
)
def test_what_no_step_has_written_is_refused_with_its_place(
    folder: Path, step: str, changes: dict, told: str
) -> None:
    with pytest.raises(UnusableInput, match=rf"{step}\.json: {told}.*run the step that writes it"):
        read_steps(changed(folder, step, **changes))


def test_an_artefact_that_is_nested_too_deeply_is_refused(folder: Path) -> None:
    (folder / "find.json").write_text("[" * 100_000)
    with pytest.raises(UnusableInput, match=r"find\.json: cannot be read \(nested too deeply\)"):
        read_steps(folder)


def a_case() -> SimpleNamespace:
    """As much of a case as adding an effect to a rig file takes."""
    flights = tuple(SimpleNamespace(sha256=sha256) for sha256 in LOGS)
    return SimpleNamespace(rig=RIG, flights=flights, sealed=(), recordings=LOGS)


@pytest.mark.parametrize(
    ("size", "told"),
    [
        ({"value": None, "unit": "s"}, "parameters.up_s|value"),
        ({"value": 9.0, "unit": "s"}, "must lie within"),
        ({"value": 0.05, "unit": "kg"}, "its unit says 'kg'"),
    ],
)
def test_a_size_that_no_rig_file_may_have_is_not_added(folder: Path, size: dict, told: str) -> None:
    ends = {"low": None, "high": None}
    parameters = {"up_s": size | ends, "down_s": {"value": 0.1, "unit": "s"} | ends}
    changed(folder, "name", effects=[{"name": "spool-lag-sufferer", "parameters": parameters}])
    with pytest.raises(UnusableInput, match=rf"name\.json: .*({told})"):
        close.add(a_case(), folder)
    assert not (folder / "rig.toml").exists()


def test_an_expression_that_is_none_is_not_added(folder: Path) -> None:
    changed(folder, "name", unknown={"expression": "import os", "parameters": {}})
    with pytest.raises(UnusableInput, match=r"name\.json: The expression, character 1"):
        close.add(a_case(), folder, from_symbolic=True)


def test_a_class_of_what_the_library_lacks_is_not_planned_for(folder: Path) -> None:
    changed(folder, "result", **{"class": ["stiction", "gremlin"]})
    with pytest.raises(UnusableInput, match=r"result\.json: 'gremlin' of its class is no effect"):
        _class_in(folder)


def test_sizes_that_are_none_leave_the_plan_to_the_usual_ones() -> None:
    def of(value: float | None) -> dict:
        size = {"value": value, "low": None, "high": None, "unit": "s"}
        ranked = {"name": "command-latency", "parameters": {"latency_s": size},
                  "gain_nats": 1.0, "interval": [0.0, 2.0]}  # fmt: skip
        named = Name.model_validate({"rounds": [{"given": [], "ranking": [ranked]}]})
        return stated_sizes(named, ("command-latency",))

    assert of(0.02) == {"command-latency": (0.02,)}
    assert of(None) == of(math.nan) == stated_sizes(None, ("command-latency",)) == {}


def test_numbers_that_nobody_measured_are_told_as_unknown() -> None:
    for value in (10**400, -(10**400), 1e300, math.inf, None, True, "1"):
        assert math.isnan(number(value))
    white = {"passes": False, "statistic": math.inf}
    assert "inf" not in account(summary({"verdict": "unknown", "white": white}))
    assert not forbids_none([Place(**PLACE | {"q_value": q}) for q in (None, 0.9)])


@pytest.mark.parametrize(
    "arrays",
    [
        {"motion_0": np.array(["a"])},
        {"motion_0": np.array(1.0)},
        {"motion_0": np.full((2, 4), np.nan)},
        {"tried": np.array(3)},
        {"effects": np.array(["gremlin"])},
        {"fit": np.array(0.0)},
    ],
)
def test_fits_that_are_none_are_named(tmp_path: Path, arrays: dict) -> None:
    flight = flown(31)
    nominal = flight.nominal
    held = {"motion_0": nominal, "base_motion_0": nominal, "fitted_gain": np.zeros(0)}
    held |= {"tried": np.zeros(0, "U1"), "effects": np.zeros(0, "U1")}
    model = GantryModel(RIG, [flight], TERMS)
    held |= {name: model.start(()) for name in ("base", "fit")}
    np.savez(tmp_path / FITS, **held)
    assert Found.read(tmp_path, RIG, [flight]).tried == ()
    np.savez(tmp_path / FITS, **(held | arrays))
    with pytest.raises(UnusableInput, match=r"name\.npz: missing or not readable"):
        Found.read(tmp_path, RIG, [flight])


LINE = {
    "name": "stiction/15/1", "kind": "effect", "plant": "first", "nats": 52.9, "hidden": [],
    "verdict": "named", "right": True, "partial": False, "named": [], "class": [],
    "named_intervals": [], "closed": 0.4, "seconds": 50.7,
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"kind": "?"}, r"kind = '\?'"),
        ({"hidden": None}, "hidden"),
        ({"tracking": {"ratio": -1.0}}, "tracking"),
        ({"beliefs": [{"confidence": 7.0, "hidden": True}]}, "beliefs.0.confidence = 7.0"),
        ({"named_intervals": [{"held": True}]}, "named_intervals.0.effect is missing"),
    ],
)
def test_a_line_that_no_benchmark_has_written_is_named(
    tmp_path: Path, changes: dict, told: str
) -> None:
    (tmp_path / LINES).write_text(json.dumps(LINE) + "\n")
    assert read_lines(tmp_path) == [LINE]
    (tmp_path / LINES).write_text(f"{json.dumps(LINE)}\n{json.dumps(LINE | changes)}\n")
    with pytest.raises(UnusableInput, match=rf"cases\.jsonl: whole line 2: {told}"):
        read_lines(tmp_path)
