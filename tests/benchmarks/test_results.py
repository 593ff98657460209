"""The generated pages of results against the records, and what a record has to state."""

import json
import re
from pathlib import Path

import pytest

from benchmarks import keep, records, tuned
from benchmarks.results import compiled, faults, first_minutes, flight, readme
from benchmarks.results.pages import CHAPTERS, Pages
from benchmarks.results.section import ARCHITECTURES, Records
from wakedeploy.study.pareto import Point, by_flash, by_instructions, by_ram, front

KINDS = {".json", ".csv", ".jsonl"}
DAY, COMMIT = r"20\d\d-\d\d-\d\d", "`[0-9a-f]{7,12}`"


@pytest.fixture(scope="module")
def pages() -> Pages:
    return Pages()


def test_every_generated_page_is_what_the_records_give(pages: Pages) -> None:
    for path, text in pages.texts.items():
        assert (records.ROOT / path).read_text("utf-8") == text, f"{path}: run make results"


def test_no_record_is_unused_and_there_is_nothing_but_records(pages: Pages) -> None:
    present = {path.name for path in records.FOLDER.iterdir()}
    assert present == pages.used
    assert {Path(name).suffix for name in present} <= KINDS
    manuals = {path.suffix for path in (records.ROOT / "docs").iterdir() if path.is_file()}
    assert manuals == {".md"}
    assert {path.suffix for path in records.FIGURES.iterdir()} == {".png", ".svg"}


def test_every_section_states_when_and_at_which_commit_its_record_was_made(pages: Pages) -> None:
    texts = [pages.texts[f"docs/results/{name}.md"] for name in CHAPTERS]
    sections = [section for text in texts for section in text.split("\n## ")[1:]]
    assert len(sections) == sum(len(chapter.sections) for chapter in CHAPTERS.values())
    for section in sections:
        (line,) = re.findall(r"^Records (measured .*)$", section, re.MULTILINE)
        for told in line.split("; "):
            form = rf"measured {DAY}(, {DAY})* at {COMMIT}(, {COMMIT})*( on [^:]+)?: "
            assert re.match(form, told), told
        assert "```\n" in section


def test_the_first_page_is_short_and_leads_to_every_section(pages: Pages) -> None:
    first = pages.texts["docs/results.md"]
    assert len(first.splitlines()) < 50
    for name in CHAPTERS:
        titles = re.findall(r"^## (.*)$", pages.texts[f"docs/results/{name}.md"], re.MULTILINE)
        assert len(titles) == len(re.findall(rf"\(results/{name}\.md#[\w-]+\)", first))


def test_every_picture_and_page_that_the_results_show_is_there(pages: Pages) -> None:
    for path, text in pages.texts.items():
        folder = (records.ROOT / path).parent
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
            assert (folder / target).exists(), f"{path}: {target}"


def test_the_readme_has_the_demo_and_the_table_of_the_records() -> None:
    marked = "<!-- {0}: made by `make results` -->\nold\n<!-- end of {0} -->\n"
    text = "before\n" + marked.format("demo") + marked.format("results") + "after\n"
    filled = readme.filled(text, Records(records.FOLDER))
    rows = json.loads((records.FOLDER / "tracking.json").read_text())["rows"]
    (alone,) = [row["rmse_mm"] for row in rows if row["name"] == "PID alone"]
    assert f"PID alone | {alone:.1f} mm |" in filled
    demo = json.loads((records.FOLDER / "demo.json").read_text())["rmse_mm"]["pid"]
    assert re.search(rf"PID alone .* {demo['mean']:.1f} ± {demo['standard_error']:.1f} ", filled)
    assert "old" not in filled
    assert filled.startswith("before\n")
    assert filled.endswith("-->\nafter\n")
    with pytest.raises(ValueError, match="marks"):
        readme.filled("no marks", Records(records.FOLDER))


def test_a_record_keeps_its_day_and_commit_or_gets_those_of_now(tmp_path: Path) -> None:
    path = tmp_path / "one.json"
    records.write(path, {"rows": [1]})
    told = json.loads(path.read_text())
    assert re.fullmatch(r"20\d\d-\d\d-\d\d", told["measured"])
    assert told["commit"] == records.COMMIT
    assert re.fullmatch(r"\d+ cores, \S.*", told["machine"])
    records.write(path, {"measured": "2020-01-02", "commit": "abc", "rows": [1]})
    assert json.loads(path.read_text()) == {"measured": "2020-01-02", "commit": "abc", "rows": [1]}


def test_a_table_that_is_kept_names_runs_and_no_folder_of_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "FOLDER", tmp_path)
    rows = [{"run": f"{tmp_path}/runs/gantry/gru/s0"}, {"run": "runs/gantry/tcn/s0"}]
    (tmp_path / "runs.json").write_text(json.dumps({"commit": "abc", "rows": rows}))
    keep.table(tmp_path / "runs.json", "training")
    kept = json.loads((tmp_path / "training.json").read_text())["rows"]
    assert [row["run"] for row in kept] == ["runs/gantry/gru/s0", "runs/gantry/tcn/s0"]


def test_no_record_has_a_path_of_a_machine() -> None:
    at_home = re.compile(r'"/(?:home|root|tmp|work|Users|mnt|var)/')
    files = [path for path in records.FOLDER.iterdir() if path.suffix != ".png"]
    assert len(files) > 40
    assert [path.name for path in files if at_home.search(path.read_text("utf-8"))] == []


def test_a_study_s_folder_replaces_its_record_and_the_tables_that_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept, pictures, study = (tmp_path / name for name in ("records", "figures", "lead"))
    for folder in (kept, pictures, study):
        folder.mkdir()
    monkeypatch.setattr(records, "FOLDER", kept)
    monkeypatch.setattr(records, "FIGURES", pictures)
    (study / "study.json").write_text('{"commit": "abc", "flights": 8}')
    (kept / "study-lead.csv").write_text("old")
    for name in ("lead.csv", "lead-flights.csv"):
        (study / name).write_text("new")
    keep.study(study)
    told = json.loads((kept / "study-lead.json").read_text())
    assert (told["commit"], told["flights"]) == ("abc", 8)
    assert (kept / "study-lead.csv").read_text() == "new"
    assert not (kept / "study-lead-flights.csv").exists()
    reader = Records(kept)
    reader.rows("study-lead.csv")
    assert list(reader.stamps()) == [(told["measured"], "abc", records.machine())]


def test_the_demo_s_record_and_its_picture_are_kept_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept, pictures, made = (tmp_path / name for name in ("records", "figures", "demo"))
    for folder in (kept, pictures, made):
        folder.mkdir()
    monkeypatch.setattr(records, "FOLDER", kept)
    monkeypatch.setattr(records, "FIGURES", pictures)
    result = json.loads((records.ROOT / "docs" / "records" / "demo.json").read_text())
    (made / "result.json").write_text(json.dumps(result | {"minutes": 3.0}))
    (made / "demo.png").write_bytes(b"picture")
    keep.demo(made)
    assert (pictures / "demo.png").read_bytes() == b"picture"
    assert "learned from 3 minutes" in flight.demo(Records(kept)).measured


def test_of_an_earlier_campaign_the_counts_are_kept_with_their_own_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "FOLDER", tmp_path)
    campaign = json.loads((records.ROOT / "docs" / "records" / "faults.json").read_text())
    source = tmp_path / "faults.json"
    source.write_text(json.dumps(campaign))
    keep.faults(source, "faults-earlier")
    kept = json.loads((tmp_path / "faults-earlier.json").read_text())
    assert (kept["measured"], kept["commit"]) == (campaign["measured"], campaign["commit"])
    assert "machine" not in kept  # the campaign does not state it
    assert set(kept["exact"]["faults"][0]) == set(keep.COUNTS)
    counts = [row["unsafe"] for row in campaign["exact"]["faults"]]
    assert [row["unsafe"] for row in kept["exact"]["faults"]] == counts


def test_what_a_recording_contains_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "FOLDER", tmp_path)
    result = {"domain": "motor", "shown": [1.0], "far": {"shown": [2.0], "gap": {}}, "gap": {}}
    (tmp_path / "domain.json").write_text(json.dumps(result))
    keep.gap_domain(tmp_path)
    told = json.loads((tmp_path / "gap-domain-motor.json").read_text())
    assert {key: told[key] for key in ("domain", "far", "gap")} == {
        "domain": "motor",
        "far": {"gap": {}},
        "gap": {},
    }
    assert "shown" not in told


def test_parity_is_told_of_the_package_that_comes_nearest_its_limit(tmp_path: Path) -> None:
    record = json.loads((records.FOLDER / "tracking.json").read_text())
    for row in record["rows"]:
        if "parity" in row:
            largest = {"gru": 9e-6, "esn": 17e-6}.get(row["name"], 1e-7)
            limit = 2e-5 if row["name"] == "esn" else 1e-5
            row["parity"] = {"max_rel": largest, "limit": limit, "steps": 3200}
    (tmp_path / "tracking.json").write_text(json.dumps(record))
    body = flight.tracking(Records(tmp_path)).body
    assert "of the 16 packages, one of gru comes nearest its limit" in body
    assert "by 90 % of that limit, over 3,200 carried steps" in body


def test_the_aims_of_the_c_export_are_beside_what_was_measured(tmp_path: Path) -> None:
    record = json.loads((records.FOLDER / "compiled.json").read_text())
    parts = record["parts"]
    parts["tick"]["gru"] |= {"p999_ms": 0.99, "rss_mb": 40.2}
    parts["sizes"]["gru"]["int8"]["ms"] = 2.5
    parts["sizes"]["esn"]["int8"]["parity"]["Cortex-M33"] = 2.01e-6
    for arch, one in parts["paced"].items():
        one["c"]["p50_ms"] = one["onnxruntime"]["p50_ms"] + (0.1 if arch == "esn" else -0.1)
    (tmp_path / "compiled.json").write_text(json.dumps(record))
    chip, flown = (of(Records(tmp_path)).body for of in (compiled.on_a_chip, compiled.paced))
    assert "| estimated step, float32 | 2.9 ms | 3 ms |" in chip
    assert "| estimated step, int8 | 2.5 ms | 3 ms |" in chip
    assert "differs by more than 2.1e-06" in chip, "rounded up"
    assert "| p99.9 | 0.99 ms | 1 ms |" in flown
    assert "| memory of the process | 40 MB | 40 MB, missed |" in flown
    assert "In 1 of 8 rows the median tick takes longer in C than in onnxruntime: esn." in flown


def test_who_is_beaten_by_none_in_error_and_cost_is_the_same_in_the_table_and_the_picture() -> None:
    measured = json.loads((records.FOLDER / "compiled.json").read_text())["parts"]["costs"]
    body = compiled.against_error(Records(records.FOLDER)).body
    for what, cost in (("flash", by_flash), ("RAM", by_ram), ("instructions", by_instructions)):
        best = []
        for domain in ("gantry", "fish"):
            points = [
                Point(
                    domain, arch, tuple(one[domain]["errors"]), one[domain]["trainable"], 0, (), (),
                    one[domain]["flash_bytes"], one[domain]["ram_bytes"],
                    one[domain]["instructions"],
                )
                for arch, one in measured.items()
            ]  # fmt: skip
            unbeaten = {point.arch for point in front(points, cost)}
            best.append(", ".join(arch for arch in ARCHITECTURES if arch in unbeaten))
        assert f"| {what} | {best[0]} | {best[1]} |" in body


def test_pictures_of_tuning_show_what_was_tuned_and_no_empty_panels() -> None:
    rows = Records(records.FOLDER).json("tuned.json")["rows"]
    some = [row for row in rows if row["arch"] in ("gru", "tcn", "esn")]
    drawn = tuned.importances(some)
    titles = [axes.get_title(loc="left") for axes in drawn.axes if axes.axison]
    labels = [label.get_text() for label in tuned.gains(some).axes[0].get_yticklabels()]
    assert titles == labels == ["gru", "tcn", "esn"]


def test_a_command_over_its_bound_is_named(tmp_path: Path) -> None:
    record = json.loads((records.FOLDER / "first-minutes.json").read_text())
    path = tmp_path / "first-minutes.json"
    for processor_s, verdict in (
        (0.1, "within its bound"),
        (9.0, "Over the bound: `wakedeploy --h"),
    ):
        record["rows"][0]["processor_s"] = [0.1, processor_s, processor_s]
        path.write_text(json.dumps(record))
        assert verdict in first_minutes.first_minutes(Records(tmp_path)).body


def test_counts_of_unsafe_and_ended_flights_stand_beside_their_aims(tmp_path: Path) -> None:
    fault = {"fault": "x", "group": "link", "survivable": True, "flights": 30, "unsafe": 0,
             "unsafe_above_1_5_mps": 0}  # fmt: skip
    campaign = {"seconds": 14, "phases": ["at rest"], "exact": {"faults": [fault]}}
    healthy = {"pilot": "PID", "flights": 50, "degraded_share": 0.0, "unsafe": 0}
    ended = [healthy | {"wake": "0.5 to 2", "ended_early": 1} for _ in range(2)]
    ended += [healthy | {"wake": "2 to 3", "ended_early": count} for count in (1, 0)]
    blind = {"fault": "link cut", "wake_factor": 2.0, "flights": 100, "unsafe": 4,
             **{f"{name}_mps": 0.5 for name in faults._LANDINGS}}  # fmt: skip
    for name, content in (
        ("faults.json", campaign),
        ("faults-healthy.json", {"rows": ended}),
        ("faults-blind.json", {"rows": [blind]}),
    ):
        records.write(tmp_path / name, content)
    body = faults.faults(Records(tmp_path)).body
    for row in (
        "| unsafe though it could be saved, exact plant | 0 of 30 | 0 |",
        "| healthy, ended early, wake × 0.5 to 2 | 2 of 100 | 0, missed |",
        "| healthy, ended early, wake × 2 to 3 | 1 of 100 | at most 1 |",
        "| blind descents, unsafe at a stop | 4 of 100 | 0, missed |",
    ):
        assert row in body


def test_a_median_says_of_how_many_flights_it_is() -> None:
    row = {"fault": "x", "survivable": True, "unsafe": 0, "flights": 30, "worst_lower_mps": 0.4,
           "worst_upper_mps": 0.0, "worst_reach_m": 0.3, "endings": {"whole": 28},
           "detected": 7, "median_detection_s": 0.25}  # fmt: skip
    assert "0.25 (7 of 30)" in faults._line(row)
    assert "–" in faults._line(row | {"detected": 0, "median_detection_s": None})
