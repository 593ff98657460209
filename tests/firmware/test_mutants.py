"""What the mutation run takes for noticed, and what it refuses to judge; not the run itself."""

import json
import sys
from pathlib import Path

import mutants
import needs
import pytest
from mutants import (
    EQUIVALENT,
    LEAST_SHARE,
    ROOT,
    Mutant,
    digest_of_decisions,
    fate,
    judged,
    tried_again,
    unmatched,
)

ALL = list(mutants.mutants())
RECORD = ROOT / "docs" / "records" / "mutants.json"
LISTED = next(m for m in ALL if m.change in EQUIVALENT)
OTHERS = [m for m in ALL if m.change not in EQUIVALENT][:4]


def test_each_change_of_the_list_can_be_made_at_one_place() -> None:
    assert unmatched(ALL) == []
    twice = Mutant(LISTED.file, LISTED.line + 1, LISTED.before, LISTED.after)
    assert unmatched([*ALL, twice]) == [LISTED.change]
    assert unmatched([m for m in ALL if m != LISTED]) == [LISTED.change]


def test_out_of_time_is_noticed_and_told_and_what_is_listed_does_not_count() -> None:
    ends = ["killed", "timed out", "survived", "no program"]
    record = judged([*zip(OTHERS, ends, strict=True), (LISTED, "survived")])
    assert (record["noticed"], record["tried"], record["share"]) == (2, 3, 2 / 3)
    assert record["timed_out"] == [str(OTHERS[1])]
    assert record["survived"] == [str(OTHERS[2])]
    assert record["no_program"] == 1
    assert record["equivalent"] == {str(LISTED): EQUIVALENT[LISTED.change]}
    assert record["wrongly_listed"] == []


@pytest.mark.parametrize("end", ["killed", "timed out"])
def test_a_listed_change_that_is_noticed_is_an_error(end: str) -> None:
    record = judged([(LISTED, end)])
    assert record["wrongly_listed"] == [str(LISTED)]
    assert record["equivalent"] == {}


def test_tests_that_were_added_are_asked_about_the_survivors_alone(monkeypatch) -> None:
    one, other, *_ = OTHERS
    ends = [(m, "killed") for m in ALL if m not in (one, other, LISTED)]
    before = judged([*ends, *((m, "survived") for m in (one, other))])
    before |= {"decisions": digest_of_decisions(), "equivalent": {"what was known then": ""}}
    asked = []

    def tried(wanted, workers):
        asked.extend(wanted)
        return [(m, "survived" if m == one else "killed") for m in wanted]

    monkeypatch.setattr(mutants, "tried", tried)
    after = tried_again(before, ALL, 1)
    assert set(asked) == {one, other}
    assert (after["noticed"], after["tried"]) == (before["noticed"] + 1, before["tried"])
    assert after["survived"] == [str(one)]
    for spoilt in ({"decisions": "others"}, {"tried": before["tried"] - 1}):
        with pytest.raises(SystemExit):
            tried_again(before | spoilt, ALL, 1)


@pytest.fixture
def judge(monkeypatch, tmp_path):
    """Lets these lines be the tests."""

    def write(lines: str) -> Path:
        (tmp_path / "test_judge.py").write_text(lines)
        monkeypatch.setattr(mutants, "TESTS", (str(tmp_path / "test_judge.py"),))
        return tmp_path

    return write


@pytest.mark.whole
@needs.compiler
def test_a_suite_that_fails_anyhow_judges_nothing(judge, monkeypatch, tmp_path, capsys) -> None:
    judge("def test_one(): assert False\n")
    told = tmp_path / "record.json"
    monkeypatch.setattr(sys, "argv", ["mutants.py", "--json", str(told)])
    with pytest.raises(SystemExit) as ended:
        mutants.main()
    assert ended.value.code == 2
    assert "as it is does not pass" in capsys.readouterr().err
    assert not told.exists()


@pytest.mark.whole
@needs.compiler
def test_what_runs_out_of_time_or_not_at_all_is_not_killed(judge, monkeypatch) -> None:
    folder = judge("import time\ndef test_one(): time.sleep(60)\n")
    monkeypatch.setattr(mutants, "LIMIT_S", 1)
    assert fate(None, folder) == "timed out"
    judge("import nothing_of_this_name\n")
    monkeypatch.setattr(mutants, "LIMIT_S", 60)
    with pytest.raises(RuntimeError, match="nothing_of_this_name"):
        fate(None, folder)


def test_the_record_is_of_the_present_decisions_and_of_every_mutant() -> None:
    record = json.loads(RECORD.read_text())
    again = "the decisions have changed: run make mutants"
    assert record["decisions"] == digest_of_decisions(), again
    counted = record["tried"] + record["no_program"] + len(record["equivalent"])
    assert (record["every"], counted) == (1, len(ALL)), again
    assert record["noticed"] == record["tried"] - len(record["survived"])
    assert record["share"] >= LEAST_SHARE
    assert record["wrongly_listed"] == []
