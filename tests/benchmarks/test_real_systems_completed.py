"""Records of real systems that are completed from earlier ones."""

from benchmarks.real_systems.completed import completed
from benchmarks.results.real_systems import _of_other_commits


def _row(case: str, commit: str, **answers: str) -> dict:
    judged = {"out": "left_out", "in": "left_in", "first": "halves"}
    said = {judged[p]: f"{commit} {p}" for p in answers if p in judged}
    return {"case": case, "answers": {p: {"verdict": v} for p, v in answers.items()}, **said}


def test_parts_that_were_not_asked_again_are_of_the_earlier_commit():
    new = {"commit": "b", "rows": [_row("x", "b", out="named", first="none")]}
    whole = {"out": "unknown", "in": "none", "first": "unknown", "second": "unknown"}
    old = {"commit": "a", "rows": [_row("x", "a", **whole), _row("y", "a", out="none")]}
    (row,) = completed(new, old)["rows"]
    assert row["answers"]["out"] == {"verdict": "named"}
    assert (row["left_out"], row["left_in"], row["halves"]) == ("b out", "a in", "a first")
    # one half alone says nothing of agreement: both are the earlier ones
    assert {p: row["answers"][p].get("commit") for p in ("in", "first", "second")} == {
        "in": "a", "first": "a", "second": "a"
    }  # fmt: skip
    assert "| built in | `a` | 1 |" in _of_other_commits([row])


def test_a_record_that_has_all_parts_stays_as_it_is():
    whole = {"out": "named", "in": "none", "first": "none", "second": "none"}
    new = {"commit": "b", "rows": [_row("x", "b", **whole)]}
    old = {"commit": "a", "rows": [_row("x", "a", **whole)]}
    assert completed(new, old) == new
    assert _of_other_commits(new["rows"]) == ""


def test_parts_of_a_commit_before_the_earlier_one_keep_theirs():
    new = {"commit": "c", "rows": [_row("x", "c", out="named")]}
    kept = {"verdict": "none", "commit": "a"}
    old = {"commit": "b", "rows": [_row("x", "b", out="named", **{"in": "none"})]}
    old["rows"][0]["answers"] |= {"first": kept, "second": kept}
    old["rows"][0]["halves"] = "same"
    (row,) = completed(new, old)["rows"]
    assert [row["answers"][p].get("commit") for p in ("in", "first", "second")] == ["b", "a", "a"]
