"""The presets that ship, and the books of the benchmark that found them."""

import argparse
import itertools
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import tuned
from benchmarks.tuned import (
    RECORD,
    SEEDS,
    TRIALS,
    confirmed,
    error,
    gain_text,
    obtained,
    page,
    ratio,
    read_rows,
    scored,
    ship,
)
from trainers.preset import SHIPPED, Preset, read_preset, write_preset

PAPER = ("agile-mlp", "history-mlp", "delay-embedding", "gru", "tcn", "mamba", "esn")
PAPER += ("cross-attention",)
SHIPPED_FILES = sorted(SHIPPED.glob("*/*.toml"))


def row(**changed: Any) -> dict[str, Any]:
    told = {"domain": "fish", "arch": "gru", "trials": {"finished": 40, "behind": 60}}
    told |= {"importances": {"hidden": 0.3, "learning_rate": 0.7}, "narrowed": [], "commit": "abc"}
    told |= {"ships": "tuned", "starts": [], "found_reference": False}
    told |= {"reference": {"errors": [0.20, 0.22, 0.21], "trainable": 30_000, "device": "cpu"}}
    return (
        told
        | {"tuned": {"errors": [0.15, 0.16, 0.17], "trainable": 9_000, "device": "cpu"}}
        | changed
    )


def run_of(folder: Path, r2: float, least: float) -> dict[str, Any]:
    """What `train --json` says of a run, and its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "metrics.json").write_text(json.dumps({"history": [1.0, least, 2 * least]}))
    told = {"run": str(folder), "r2": {"f": r2}, "rmse": {"f": 1.0}}
    return told | {"trainable": 5, "device": "cpu"}


def test_an_error_is_that_of_the_channels_that_are_told_of() -> None:
    assert error("gantry", {"force_z_n": 0.96}) == pytest.approx(0.2)
    assert error("ship", {"sway_n": 0.5, "yaw_nm": 0.86}) == pytest.approx(0.32**0.5)
    assert error("ship", {"sway_n": 0.64, "yaw_nm": None}) == pytest.approx(0.6)  # never changes
    assert error("quadrotor", {"force_x_n": 0.0, "force_z_n": 0.75}) == pytest.approx(0.5)


def test_a_run_is_scored_on_test_and_on_validation(tmp_path: Path) -> None:
    runs = [run_of(tmp_path / f"s{i}", r2, 0.09) for i, r2 in enumerate((0.96, 0.99))]
    told = scored("gantry", runs)
    assert told["errors"] == pytest.approx([0.2, 0.1])
    assert told["validation"] == pytest.approx([0.3, 0.3])


def test_a_gain_counts_where_no_seed_contradicts_it() -> None:
    assert ratio(row()) == pytest.approx((0.16 / 0.21, 0.15 / 0.22, 0.17 / 0.20))
    assert "overlap" not in gain_text(row())
    overlapping = row(tuned={"errors": [0.15, 0.16, 0.21], "trainable": 9_000, "device": "cpu"})
    assert "overlap" in gain_text(overlapping)
    worse = row(arch="tcn", tuned={"errors": [0.3, 0.3, 0.3], "trainable": 9_000, "device": "cpu"})
    left = row(arch="esn", ships="reference")
    told = page([row(), overlapping, worse, left])
    assert "The found shape ships for 3 of 4 pairs: " in told
    assert "On test, every tuned seed beats every reference seed in 1 of the 3." in told
    assert "worse for 1 of these:\n\n- tcn on fish: × 1.429\n" in told
    assert told.count("; the paper's shape ships |") == 1
    assert "Trained on: cpu." in told
    assert "| gru | 100, 40 to the end | 0.210 ± 0.010 | 0.160 ± 0.010 |" in told
    assert "| 30,000 → 9,000 | learning_rate 70 %, hidden 30 % |" in told


def test_a_pair_is_shipped_once_it_is_scored_and_goes_on_from_a_better_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The commands' places and words; what they do is tested with them."""
    asked: list[list[str]] = []

    def command(*arguments: object) -> None:
        words = [str(argument) for argument in arguments]
        asked.append(words)
        given = dict(itertools.pairwise(words))
        if words[0] == "tune":
            Path(given["--out"]).mkdir(parents=True, exist_ok=True)
            (Path(given["--out"]) / "best.toml").write_text(best)
            told = {"trials": {"finished": 9}, "data_sha256": "d", "lead_s": 0.0}
            told |= {"best": {"reference": False}}
            Path(given["--json"]).write_text(json.dumps(told | {"importances": {"hidden": 1.0}}))
            return
        if fails:
            sys.exit("no")
        paper = "--preset" not in given
        rows = [
            run_of(
                Path(given["--out"]) / f"s{seed}", 0.84 if paper else 0.91, 0.1 if paper else 0.05
            )
            for seed in range(SEEDS)
        ]
        Path(given["--json"]).write_text(json.dumps({"rows": rows}))

    monkeypatch.setattr(tuned, "wakedeploy", command)
    monkeypatch.setattr(tuned, "SHIPPED", tmp_path / "presets")
    options = argparse.Namespace(sets=tmp_path / "sets", work=tmp_path / "work", trials=None)
    best, fails = "first", True
    with pytest.raises(SystemExit):
        obtained("gantry", "gru", options, "abc")
    assert not (tmp_path / "presets").exists()
    fails = False
    row = obtained("gantry", "gru", options, "abc")
    assert row["reference"]["errors"] == pytest.approx([0.4] * SEEDS)
    assert row["tuned"]["errors"] == pytest.approx([0.3] * SEEDS)
    assert (row["commit"], row["starts"]) == ("abc", [])
    best = "second"
    obtained("gantry", "gru", options, "def")
    assert (tmp_path / "presets/gantry/gru.toml").read_text() == "second"
    outs = [words[words.index("--out") + 1] for words in asked if words[0] == "train"]
    assert len({out for out in outs if "tuned" in out}) == 2
    assert {Path(out).parent.name for out in outs if "reference" in out} == {"abc", "def"}
    begun = [word for words in asked if words[0] == "tune" for word in words if "--start" in word]
    assert begun == [f"--start={tmp_path / 'presets/gantry/gru.toml'}"]  # once there was one
    assert all(str(TRIALS["gantry"]) in words for words in asked if words[0] == "tune")


def test_what_is_no_better_on_validation_with_other_seeds_leaves_the_papers_shape(
    tmp_path: Path,
) -> None:
    for tuned_loss, expected in (([0.2, 0.3, 0.3], "tuned"), ([0.2, 0.4, 0.3], "reference")):
        told = {"tuned": {"validation": tuned_loss}, "reference": {"validation": [0.3, 0.3, 0.3]}}
        assert confirmed({**told, "starts": [], "found_reference": False}) == expected
        assert confirmed({**told, "starts": [], "found_reference": True}) == "reference"
    found = {"data_sha256": "d", "trials": 9, "trial": 3, "validation_error": 0.3, "trainable": 70}
    best, shipped = tmp_path / "best.toml", tmp_path / "gantry" / "agile-mlp.toml"
    write_preset(best, Preset(arch="gru", hyper={"hidden": 8}, settings={}, study=found), "best")
    ship(row(ships="tuned"), best, shipped)
    assert shipped.read_bytes() == best.read_bytes()
    ship(row(ships="reference"), best, shipped)
    kept = read_preset(shipped)
    assert (kept.hyper, kept.settings) == ({}, {})
    assert kept.study == {
        "data_sha256": "d", "trials": 9, "ships": "reference",
        "found_trial": 3, "found_validation_error": 0.3, "found_trainable": 70,
    }  # fmt: skip


def test_of_a_reservoir_the_best_of_all_that_was_trained_with_three_seeds_ships(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    losses = {"reference": 0.4, "tuned": 0.3, "0.03": 0.2, "0.001": 0.25, "before": 0.35}
    asked: list[list[str]] = []

    def command(*arguments: object) -> None:
        words = [str(argument) for argument in arguments]
        given = dict(itertools.pairwise(words))
        if words[0] == "tune":
            study = {"data_sha256": "d", "trial": 3}
            best = Preset(arch="esn", hyper={"neurons": 90}, settings={}, study=study)
            Path(given["--out"]).mkdir(parents=True)
            write_preset(Path(given["--out"]) / "best.toml", best, "best")
            told = {"trials": {"finished": 9}, "data_sha256": "d", "lead_s": 0.0}
            told |= {"importances": {}, "best": {"reference": False}}
            Path(given["--json"]).write_text(json.dumps(told))
            return
        asked.append([word for word in words if word.startswith("--hyper")])
        scale = next((w.split("=")[2] for w in words if "input_scale" in w), "reference")
        preset = {None: scale, "best.toml": "tuned", "esn.toml": "before"}
        loss = losses[preset[Path(given["--preset"]).name if "--preset" in given else None]]
        rows = [run_of(Path(given["--out"]) / f"s{i}", 1.0 - loss, loss) for i in range(SEEDS)]
        Path(given["--json"]).write_text(json.dumps({"rows": rows}))

    monkeypatch.setattr(tuned, "wakedeploy", command)
    monkeypatch.setattr(tuned, "SHIPPED", tmp_path / "presets")
    options = argparse.Namespace(sets=tmp_path / "sets", work=tmp_path / "work", trials=None)
    told = obtained("gantry", "esn", options, "abc")
    assert asked == [
        [], [], ["--hyper=esn.input_scale=0.03"],
        ["--hyper=esn.input_scale=0.001", "--hyper=esn.leak=0.3"],
    ]  # fmt: skip
    assert told["ships"] == "start"
    shipped = tmp_path / "presets/gantry/esn.toml"
    assert read_preset(shipped).hyper == {"input_scale": 0.03}
    # The next study finds nothing better than the paper's shape; what ships keeps its place.
    losses |= {"tuned": 0.5, "0.03": 0.9, "0.001": 0.9}
    options.work = tmp_path / "again"
    kept = obtained("gantry", "esn", options, "abc")
    assert (kept["ships"], kept["starts"][-1]["label"]) == ("start", "as shipped before")
    assert read_preset(shipped).hyper == {"input_scale": 0.03}
    assert "As shipped before: with three seeds" in shipped.read_text()
    assert "found_by" not in read_preset(shipped).study  # no study did: it is one of the scales
    by_a_study = Preset(arch="esn", hyper={"leak": 0.4}, settings={}, study={"trial": 8})
    write_preset(shipped, by_a_study, "tuned")
    for work in ("later", "later still"):
        options.work = tmp_path / work
        assert obtained("gantry", "esn", options, "abc")["ships"] == "start"
        assert read_preset(shipped).study["found_by"] == {"trial": 8}
    losses["before"], options.work = 0.45, tmp_path / "once more"
    assert obtained("gantry", "esn", options, "abc")["ships"] == "reference"
    assert read_preset(shipped).hyper == {}
    shown = page([told])
    assert "| 0.632 ± 0.000; 0.447 ± 0.000 at input_scale=0.03 | 0.548 ± 0.000 |" in shown
    assert "The found shape ships for 0" in shown
    gentle = told | {"starts": [one | {"validation": [0.9] * SEEDS} for one in told["starts"]]}
    assert confirmed(gentle) == "tuned"
    assert "at input_scale" not in page([gentle | {"ships": "tuned"}])


@pytest.mark.parametrize("path", SHIPPED_FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_preset_that_ships_is_that_of_the_record(path: Path) -> None:
    preset, rows = read_preset(path), read_rows(RECORD)
    domain, arch = path.parent.name, path.stem
    assert (preset.study["domain"], preset.arch) == (domain, arch)
    told = rows[domain, arch]
    assert preset.study["data_sha256"] == told["data_sha256"]
    assert preset.study["trials"] == sum(told["trials"].values()) >= TRIALS[domain]
    found = "" if told["ships"] == "tuned" else "found_"
    assert preset.study[f"{found}trainable"] == told["tuned"]["trainable"] < 100_000
    assert preset.study[f"{found}validation_error"] <= preset.study.get("reference_error", 1.0)
    assert preset.study.get("ships", "tuned") == told["ships"] == confirmed(told)
    assert bool(preset.hyper) == (told["ships"] != "reference")


def test_the_papers_eight_have_a_preset_and_a_row_on_every_domain_and_the_page_is_of_them() -> None:
    rows = read_rows(RECORD)
    assert set(rows) >= set(itertools.product(TRIALS, PAPER))
    assert {(path.parent.name, path.stem) for path in SHIPPED_FILES} == set(rows)
    assert page(list(rows.values())).count("| esn | ") == len(TRIALS)
    assert all(len(one[preset]["errors"]) == 3 for one in rows.values()
               for preset in ("reference", "tuned"))  # fmt: skip
    json.dumps(list(rows.values()), allow_nan=False)
