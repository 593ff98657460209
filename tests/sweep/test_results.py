"""Identities and the results file, whatever was asked for and wherever a writer was killed."""

import csv
import json
import random
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from wakedeploy.sweep.jobs import identity_of
from wakedeploy.sweep.results import Results

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)  # fmt: skip
FACTS = st.dictionaries(st.text(max_size=8), VALUES, max_size=6)


@settings(deadline=None, max_examples=60)
@given(FACTS, st.randoms())
def test_an_identity_does_not_depend_on_the_order_of_facts(
    facts: dict, chance: random.Random
) -> None:
    names = list(facts)
    chance.shuffle(names)
    assert identity_of("train", facts) == identity_of(
        "train", {name: facts[name] for name in names}
    )


@settings(deadline=None, max_examples=60)
@given(FACTS, FACTS)
def test_different_facts_have_different_identities(one: dict, other: dict) -> None:
    same = json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
    assert (identity_of("train", one) == identity_of("train", other)) == same
    assert identity_of("train", one) != identity_of("generate", one)


ROWS = st.lists(
    st.tuples(st.sampled_from("abc"), st.sampled_from(["done", "failed"]), st.text(max_size=6)),
    max_size=8,
)

GENERATED = {
    "identity": "a",
    "kind": "generate",
    "data": "x",
    "state": "done",
    "data_sha256": "1",
}


def row(identity: str, state: str, told: str) -> dict:
    return {
        "identity": identity,
        "kind": "train",
        "data": "x",
        "state": state,
        "reason": told,
        "test": {"r2": 1},
    }


@settings(deadline=None, max_examples=60)
@given(ROWS, st.integers(min_value=0), ROWS)
def test_a_file_torn_anywhere_keeps_every_whole_row_and_takes_more(
    before: list, cut: int, after: list
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        results, path = Results(Path(folder)), Path(folder) / "results.jsonl"
        for one in before:
            results.add(row(*one))
        written = path.read_bytes() if path.exists() else b""
        kept = written[: cut % (len(written) + 1)]
        path.write_bytes(kept)
        again = Results(Path(folder))
        # A line that lacks only its line break is whole.
        whole = [json.loads(line) for line in kept.splitlines() if line in written.splitlines()]
        assert set(again.rows) == {one["identity"] for one in whole}
        for one in after:
            again.add(row(*one))
        assert Results(Path(folder)).rows == again.rows


@settings(deadline=None, max_examples=60)
@given(ROWS.filter(bool))
def test_a_job_that_is_done_has_one_row_and_stays_done(rows: list) -> None:
    with tempfile.TemporaryDirectory() as folder:
        results = Results(Path(folder))
        done: dict[str, dict] = {}
        for one in (row(*given) for given in rows):
            assert results.add(one) == (one["identity"] not in done)
            if one["state"] == "done":
                done.setdefault(one["identity"], one)
        for identity, first in done.items():
            assert results.rows[identity] == first
        results.write_table()
        table = list(csv.DictReader((Path(folder) / "results.csv").open(newline="")))
        assert [line["identity"] for line in table] == list(results.rows)
        assert len((Path(folder) / "results.csv").read_text().splitlines()) == len(table) + 1


def test_the_table_has_a_column_for_every_value(tmp_path: Path) -> None:
    results = Results(tmp_path)
    results.add(GENERATED)
    results.add(row("b", "done", "x, y") | {"hyper": {"hidden": 8}})
    results.write_table()
    first, second = csv.DictReader((tmp_path / "results.csv").open(newline=""))
    assert second["test.r2"] == "1"
    assert second["hyper.hidden"] == "8"
    assert second["reason"] == "x, y"
    assert first["hyper.hidden"] == ""


def test_a_set_that_was_made_anew_and_differs_replaces_its_row(tmp_path: Path) -> None:
    results = Results(tmp_path)
    assert results.add(GENERATED)
    assert not results.add(GENERATED)
    assert results.add(GENERATED | {"data_sha256": "2"})
    assert Results(tmp_path).rows["a"]["data_sha256"] == "2"


def test_lines_of_something_else_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "results.jsonl").write_bytes(b'[1]\n{"identity": 3}\n\xff\xfe\n{"x": 1}\n')
    assert Results(tmp_path).rows == {}
