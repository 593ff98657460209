"""The judge's rules on made-up answers, the tables' arithmetic, and runs that are interrupted."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.hidden_effects import run
from benchmarks.hidden_effects.cases import PAIRS, Case, all_cases, hidden_effects, short_cases
from benchmarks.hidden_effects.flown import TRACKED
from benchmarks.hidden_effects.judge import (
    FAILED,
    beliefs,
    decided,
    named_intervals,
    sealed,
    share_by_own_floor,
    share_closed,
)
from benchmarks.hidden_effects.lines import LINES, read_lines
from benchmarks.hidden_effects.measure import Floor
from benchmarks.hidden_effects.page import draw, markdown_of
from benchmarks.hidden_effects.run import run_cases
from benchmarks.hidden_effects.table import belief, coverage, summary, wilson
from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.effects import LIBRARY


def truth(kind: str, *names: str) -> dict[str, Any]:
    hidden = {name: {"size": 1.0} for name in names}
    inside, outside = (hidden, {}) if kind != "outside" else ({}, dict.fromkeys(names, 1.0))
    return {"kind": kind, "effects": inside, "outside": outside}


def answer(verdict: str, *names: str, members: tuple[str, ...] = ()) -> dict[str, Any]:
    return {"verdict": verdict, "effects": [{"name": n} for n in names], "class": list(members)}


def right(hidden: dict[str, Any], given: dict[str, Any], **gains: float) -> bool:
    return decided(hidden, given, gains)["right"]


def test_a_name_is_right_if_it_is_the_hidden_one_and_alone() -> None:
    assert right(truth("effect", "a"), answer("named", "a"))
    assert not right(truth("effect", "a"), answer("named", "b"))
    assert not right(truth("effect", "a"), answer("named", "a", "b"))
    for other in ("none", "unknown"):
        assert not right(truth("effect", "a"), answer(other))


def test_a_class_is_right_only_if_every_member_explains_the_data_as_well() -> None:
    both = answer("class", "a", "b", members=("a", "b"))
    assert right(truth("effect", "a"), both, a=50.0, b=47.5)
    assert not right(truth("effect", "a"), both, a=50.0, b=46.5)
    assert not right(truth("effect", "c"), both, a=50.0, b=50.0, c=50.0)
    extra = answer("class", "d", "a", "b", members=("a", "b"))
    assert not right(truth("effect", "a"), extra, a=50.0, b=50.0)


def test_unknown_is_for_what_the_library_lacks_and_none_for_nothing() -> None:
    assert right(truth("outside", "x"), answer("unknown"))
    assert not right(truth("outside", "x"), answer("named", "a"))
    assert right(truth("none"), answer("none"))
    assert not right(truth("none"), answer("unknown"))


@pytest.mark.parametrize(
    ("verdict", "shows", "strict", "at_all"),
    [
        ("unknown", True, 1, 1),
        ("unknown", False, 1, 1),
        ("none", False, 0, 1),  # nothing that matters, and the judge's own fit says so too
        ("none", True, 0, 0),
        ("none", None, 0, 0),  # not measured
        ("named", False, 0, 0),
        (FAILED, False, 0, 0),
    ],
)
def test_nothing_that_matters_is_true_of_what_the_judge_cannot_see_either(
    verdict: str, shows: bool | None, strict: int, at_all: int
) -> None:
    case = next(c for c in all_cases() if c.kind == "outside")
    told = summary([line(case, verdict=verdict, shows=shows, right=verdict == "unknown")])
    assert told["unknown_outside"]["count"] == strict
    assert told["outside_or_unseen"]["count"] == at_all


def test_of_a_pair_both_must_be_found_and_one_counts_apart() -> None:
    pair = truth("pair", "a", "b")
    assert decided(pair, answer("named", "b", "a"), {}) == {"right": True, "partial": False}
    half = answer("unknown") | {"beside": [{"name": "a"}]}
    assert decided(pair, half, {}) == {"right": False, "partial": True}
    assert decided(pair, answer("named", "a"), {}) == {"right": False, "partial": False}
    assert decided(pair, answer("named", "a", "c"), {}) == {"right": False, "partial": False}
    half = answer("class", "a", "b", "c", members=("b", "c"))
    assert right(pair, half, b=30.0, c=29.0)
    assert not right(pair, half, b=30.0, c=20.0)


def test_named_intervals_are_held_against_the_truth() -> None:
    given = {"effects": [{"name": "a", "parameters": {"size": {"low": 0.5, "high": 0.9}}}]}
    (row,) = named_intervals(truth("effect", "a"), given)
    assert not row["held"]
    assert named_intervals(truth("effect", "b"), given) == []


def test_a_confidence_is_held_against_how_often_it_was_right() -> None:
    given = {"effects": [{"name": n, "confidence": c} for n, c in (("a", 0.6), ("b", 0.4))]}
    told = beliefs(truth("effect", "a"), given)
    assert [(row["effect"], row["hidden"]) for row in told] == [("a", True), ("b", False)]
    assert beliefs(truth("none"), {"verdict": FAILED}) == []
    sure = [{"effect": "a", "confidence": c, "hidden": h} for c, h in ((1.0, True), (0.992, False))]
    first, second, third = belief([*told, *sure])
    assert (first["held"], first["share"], first["of"]) == (0.4, 0.0, 1)
    assert (second["held"], second["share"]) == (0.6, 1.0)
    assert (third["held"], third["share"], third["to"]) == (pytest.approx(0.996), 0.5, 1.0)
    case = next(c for c in all_cases() if c.kind == "none")
    page = markdown_of(summary([line(case, beliefs=[*told, *sure])]))
    assert "| 99 to 100 % | 99.6 % | 50 % [9, 91] | 1 of 2 |" in page
    assert "How sure" not in markdown_of(summary([line(case)]))


def test_answers_of_two_commits_are_also_counted_apart():
    cases = [c for c in all_cases() if c.kind == "none"][:3]
    old = [line(c, verdict="none", commit="a", seconds=70.0) for c in cases[:2]]
    new = line(cases[2], verdict="named", commit="b", seconds=20.0)
    page = markdown_of(summary([*old, new]))
    assert "| a | 2 | 0 of 0 | 0 of 0 | 0 of 2 | 0 of 0 | 70 | 70 |" in page
    assert "| b | 1 | 0 of 0 | 0 of 0 | 1 of 1 | 0 of 0 | 20 | 20 |" in page
    assert "## Commits" not in markdown_of(summary(old))


def test_the_share_closed_is_of_squares_above_the_floor() -> None:
    channel = {"before": 5.0, "after": 4.0, "noise_floor": 3.0}
    given = answer("named", "a") | {"gap": {"height 0.25 s ahead": channel}}
    assert share_by_own_floor(given) == pytest.approx(9.0 / 16.0)
    assert share_closed(given, Floor(1.0, 24.0, 10.0)) == pytest.approx(9.0 / 24.0)
    for nothing in ({"verdict": "none"}, answer("none") | {"gap": {}}):
        assert share_by_own_floor(nothing) is None
        assert share_closed(nothing, Floor(1.0, 24.0, 10.0)) is None


def test_where_the_effect_does_not_show_there_is_no_share_to_close() -> None:
    channel = {"before": 5.0, "after": 4.0, "noise_floor": 3.0}
    given = answer("named", "a") | {"gap": {"height 0.25 s ahead": channel}}
    assert share_closed(given, None) is None
    assert share_closed(given, Floor(4.9, 1.0, 1.5)) is None
    assert share_closed({"verdict": FAILED}, Floor(4.9, 1.0, 1.5)) is None
    assert share_closed({"verdict": FAILED}, Floor(1.0, 24.0, 10.0)) == 0.0


def test_the_sealed_flights_are_those_that_the_workflow_tells(tmp_path: Path) -> None:
    flights = [f"flight{i}" for i in range(7)]
    assert sealed(tmp_path, flights) == flights[5:]
    assert sealed(tmp_path, flights[:4]) == flights[3:4]
    assert sealed(tmp_path, flights[:3]) == flights[:3]
    assert sealed(tmp_path, flights[:2]) == flights[:2]  # none sealed: it shows what it fitted
    (tmp_path / "answer").mkdir()
    (tmp_path / "answer" / "show.json").write_text('{"sealed": ["flight3"]}')
    assert sealed(tmp_path, flights) == ["flight3"]
    (tmp_path / "answer" / "show.json").write_text('{"sealed": []}')
    assert sealed(tmp_path, flights[:2]) == flights[:2]


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(0, 10, 0.0, 0.2775), (5, 100, 0.0215, 0.1118), (81, 263, 0.2553, 0.3662), (7, 7, 0.6457, 1)],
)
def test_wilsons_interval(successes: int, trials: int, low: float, high: float) -> None:
    """81 of 263 is Newcombe's example (Statistics in Medicine 17, 1998, table I)."""
    assert wilson(successes, trials) == pytest.approx((low, high), abs=5e-5)


def test_coverage_is_told_per_effect_and_for_all() -> None:
    rows = [{"effect": e, "held": h} for e, h in (("a", True), ("a", False), ("b", True))]
    told = coverage(rows)
    assert (told["a"]["count"], told["a"]["of"], told["all"]["count"]) == (1, 2, 2)


def test_the_list_has_what_was_promised() -> None:
    cases = all_cases()
    assert len({c.name for c in cases}) == len({c.seed for c in cases}) == len(cases)
    by_kind = {k: [c for c in cases if c.kind == k] for k in ("effect", "pair", "none", "outside")}
    assert len(by_kind["none"]) >= 100
    assert len(by_kind["pair"]) == len(PAIRS) == 10
    assert len({c.truth_names for c in by_kind["outside"]}) >= 6
    assert len(hidden_effects()) >= 34
    for name in hidden_effects():
        own = [c for c in by_kind["effect"] if name in c.effects]
        assert {15, 50} <= {c.nats for c in own}
        assert {c.plant for c in own} == {"first", "second"}
    for kind, some in by_kind.items():
        share = sum(c.plant == "second" for c in some) / len(some)
        assert 0.4 <= share <= 0.6, kind
    assert {c.kind for c in short_cases()} == {"effect", "outside", "none"}
    tracked = [c for c in cases if c.name in TRACKED]
    assert len(tracked) == len(TRACKED)
    assert {c.kind for c in tracked} == {"effect", "pair"}
    assert {c.plant for c in tracked} == {"first", "second"}
    assert any(c.instant for c in tracked)
    assert all(c.nats >= 50 for c in tracked)


def test_hidden_values_lie_within_the_librarys_bounds() -> None:
    for case in all_cases():
        for name, values in case.effects.items():
            for p in LIBRARY[name].parameters:
                assert p.low <= values[p.name] <= p.high, case.name


def test_calibration_is_off_in_every_case_but_for_what_is_hidden() -> None:
    cases = all_cases()[::40]
    for case in cases:
        assert case.truth_constants() == case.truth_constants()
        assert case.truth_constants()["wake.diffusivity_m2ps"] != 0.06 or "wake" in case.name
    (hidden,) = (c for c in all_cases() if c.name == "wake-strength/50/0")
    assert hidden.truth_constants()["wake.strength"] == 380.0


def fake(job: run.Job) -> dict[str, Any]:
    if (job.out / "stop").exists() and job.case.name == "none/0/2":
        raise KeyboardInterrupt
    return line(job.case, commit=job.frozen_at)


def line(case: Case, **more: Any) -> dict[str, Any]:
    told = {"name": case.name, "kind": case.kind, "plant": case.plant, "seconds": 1.0}
    told |= {"verdict": "none", "named": [], "class": [], "hidden": list(case.truth_names)}
    told |= {"right": case.kind == "none", "partial": False, "named_intervals": [], "closed": None}
    return told | more


def test_an_interrupted_run_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = [f"none/0/{i}" for i in range(4)]
    cases = sorted((c for c in all_cases() if c.name in wanted), key=lambda c: c.name)
    monkeypatch.setattr(run, "do_case", fake)
    monkeypatch.setattr(run, "frozen_at", lambda: "0123456789ab")
    (tmp_path / "stop").touch()
    with pytest.raises(KeyboardInterrupt):
        run_cases(cases, tmp_path, close=dict)
    assert [told["name"] for told in read_lines(tmp_path)] == ["none/0/0", "none/0/1"]
    with (tmp_path / LINES).open("a") as file:
        file.write('{"name": "none/0/2", "ki')  # killed while writing
    (tmp_path / "stop").unlink()
    seen: list[tuple[int, int]] = []
    lines = run_cases(cases, tmp_path, close=dict, progress=lambda *done: seen.append(done))
    assert [told["name"] for told in lines] == [c.name for c in cases]
    assert seen == [(2, 4), (3, 4), (4, 4)]  # two were done by the run before
    before = (tmp_path / LINES).read_bytes()
    assert run_cases(cases, tmp_path, close=dict) == lines
    assert (tmp_path / LINES).read_bytes() == before


@pytest.mark.parametrize(
    ("made", "now"), [("0123", "4567"), ("0123", "0123-dirty"), ("01-dirty", "01-dirty"), ("", "0")]
)
def test_no_run_is_continued_by_other_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made: str, now: str
) -> None:
    cases = [c for c in all_cases() if c.kind == "none"][:2]
    monkeypatch.setattr(run, "do_case", fake)
    monkeypatch.setattr(run, "frozen_at", lambda: made)
    run_cases(cases[:1], tmp_path, close=dict)
    monkeypatch.setattr(run, "frozen_at", lambda: now)
    before = (tmp_path / LINES).read_bytes()
    with pytest.raises(UnusableInput, match="another --out folder"):
        run_cases(cases, tmp_path, close=dict)
    assert (tmp_path / LINES).read_bytes() == before
    assert len(run_cases(cases[:1], tmp_path, close=dict)) == 1  # nothing to add to them
    assert len(run_cases(cases, tmp_path / "other", close=dict)) == 2


def broken(*_: Any, **__: Any) -> dict[str, Any]:
    raise ValueError("no\nway")


def test_a_case_that_fails_is_told_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = next(c for c in all_cases() if c.kind == "none")
    monkeypatch.setattr(run, "frozen_at", lambda: "0123456789ab")
    monkeypatch.setattr(run, "write_world", world_of(case))
    for _ in range(2):
        run_cases([case], tmp_path, close=broken)
    first, second = read_lines(tmp_path)
    assert first["error"] == second["error"] == "ValueError: no way"
    assert len(list((tmp_path / "errors").iterdir())) == 1


def world_of(case: Case) -> Any:
    """A world without flights, which the judge needs for no-effect cases only."""

    def write(_: Case, folder: Path, truth_path: Path) -> list[Path]:
        told = {"name": case.name, "kind": case.kind, "plant": case.plant, "nats": case.nats}
        told |= {"effects": dict(case.effects), "outside": dict(case.outside)}
        truth_path.parent.mkdir(parents=True, exist_ok=True)
        truth_path.write_text(json.dumps(told))
        return []

    return write


@pytest.mark.parametrize("name", ["none/0/2", "tether-spring/50/0", "gust/50/0"])
def test_a_failure_counts_as_wrong_in_every_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (case,) = (c for c in all_cases() if c.name == name)
    monkeypatch.setattr(run, "write_world", world_of(case))
    told = summary([run.do_case(run.Job(case, tmp_path, broken, False, ""))])
    assert list(told["errors"]) == [name]
    rate = {
        "none": told["false_alarms"],
        "effect": told["right_from_50_nats"],
        "outside": told["unknown_outside"],
    }[case.kind]
    assert (rate["count"], rate["of"]) == (int(case.kind == "none"), 1)
    assert told["cases"] == {case.kind: 1}
    assert told["confusion"] == {(case.truth_names or ("none",))[0]: {FAILED: 1}}
    assert f"| {name} | ValueError: no way" in markdown_of(told)
    draw(told)


def test_the_page_tells_what_was_flown_and_what_was_not() -> None:
    cases = [c for c in all_cases() if c.name in TRACKED][:4]
    row = {"rmse": 8.0, "low": 6.0, "high": 10.0}
    ratios = {"ratio_interval": [0.4, 0.6], "retrain": {"old_rmse": 0.2, "new_rmse": 0.1}}
    flown = [
        {"tracking": {"before": row, "after": row, "ratio": 0.5} | ratios},
        {"tracking": {"before": row, "after": {"rmse": None}, "ratio": None} | ratios},
        {"tracking": None},
        {"tracking": None, "tracking_error": "UnusableInput: too short"},
    ]
    told = summary([line(c, **f) for c, f in zip(cases, flown, strict=True)])
    page = markdown_of(told)
    assert told["tracking"]["mean_ratio"] == pytest.approx(0.5)
    assert "| 8.0 [6.0, 10.0] | 8.0 [6.0, 10.0] | 0.50 [0.40, 0.60] | 0.200 → 0.100 |" in page
    for words in ("failsafe", "nothing was corrected", "UnusableInput: too short", "over 1 "):
        assert words in page
    assert "flown" not in markdown_of(summary([line(cases[0])]))


def test_the_page_says_the_rates_and_draws_them(tmp_path: Path) -> None:
    cases = all_cases()
    lines = [
        line(c, nats=float(c.nats), verdict="named", named=list(c.truth_names), right=True)
        if c.kind in ("effect", "pair")
        else line(c)
        for c in cases
    ]
    told = summary(json.loads(json.dumps(lines)))
    page = markdown_of(told, "picture.png")
    assert told["right_from_50_nats"]["share"] == 1.0
    assert told["false_alarms"]["count"] == 0
    assert "| false alarms without an effect | 0 % [0, 4] | 0 of 100 | ≤ 5 % |" in page
    draw(told).savefig(tmp_path / "page.png")
