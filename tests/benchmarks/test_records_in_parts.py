"""Records that one run cannot make anew as a whole: what it has not done yet stays as it was."""

import json

from benchmarks import keep, records
from benchmarks.form_error import __main__ as form_error
from benchmarks.hidden_effects.cases import all_cases
from benchmarks.results.gap import _earlier


def _write_lines(path, lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_lines_of_hidden_effects_that_a_run_has_not_done_keep_their_day_and_commit(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(records, "FOLDER", tmp_path)
    kept, run = tmp_path / "gap-benchmark.jsonl", tmp_path / "run"
    again, later = (case.name for case in all_cases(repeats=1)[:2])
    earlier = [
        {"measured": "2000-01-01", "name": name, "right": False, "commit": "a"}
        for name in (again, later, "a case of an earlier plan")
    ]
    _write_lines(kept, earlier)
    _write_lines(run / "cases.jsonl", [{"name": again, "right": True, "commit": "b"}])
    keep.gap_benchmark(run)
    newer, older = (json.loads(line) for line in kept.read_text().splitlines())
    assert (newer["name"], newer["right"], newer["commit"]) == (again, True, "b")
    assert newer["measured"] > "2000-01-01"
    assert older == earlier[1]


def test_a_dose_curve_goes_on_from_its_record(tmp_path, monkeypatch):
    record, out = tmp_path / "form-error.json", tmp_path / "out"
    rows = [
        {"digest": d, "commit": "a", "worth": {}, "answer": "right", "hidden": ""} for d in "xy"
    ]
    record.write_text(json.dumps({"commit": "b", "rows": rows}))
    monkeypatch.setattr(form_error, "RECORD", record)
    again = {"digest": "x", "commit": "c", "worth": {}, "answer": "false alarm", "hidden": ""}
    _write_lines(out / "rows.jsonl", [again])
    form_error.go_on(out)
    form_error.go_on(out)  # nothing twice
    assert form_error.rows_of(out) == {"x": again, "y": rows[1]}
    assert len((out / "rows.jsonl").read_text().splitlines()) == 2
    assert "1 are of `a`" in _earlier({"commit": "c", "rows": [again, rows[1]]})
