"""What the committed tables have to show: the aims that the domains were built for."""

import csv
import json
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

RECORDS = Path(__file__).parents[2] / "docs" / "records"
MEMORYLESS = "agile-mlp"
ARCHITECTURES = {MEMORYLESS, "history-mlp", "delay-embedding", "gru", "tcn", "mamba", "esn"}
ARCHITECTURES |= {"cross-attention"}


def means(table: str, value: str, **only: str) -> dict[str, float]:
    """The mean of a column over the rows of each predictor."""
    with (RECORDS / table).open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if only.items() <= row.items()]
    found = defaultdict(list)
    for row in rows:
        found[row["predictor"]].append(float(row[value]))
    return {name: float(np.mean(values)) for name, values in found.items()}


def test_the_flags_memory_explains_what_the_paper_says() -> None:
    r2 = means("study-domains.csv", "r2", domain="fish", channel="flag_tip_m")
    assert r2.keys() >= ARCHITECTURES
    assert r2[MEMORYLESS] == pytest.approx(0.57, abs=0.03)
    assert max(r2[name] for name in ARCHITECTURES) >= 0.955


def test_quadrotors_are_predicted_to_1_6_newtons_beside_an_observer() -> None:
    with (RECORDS / "study-domains-quadrotor-kinds.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["channel"] == "force_z_n"]
    assert len({row["kind"] for row in rows}) >= 3
    newtons = means("study-domains-quadrotor-kinds.csv", "rmse", channel="force_z_n")
    assert newtons.keys() >= ARCHITECTURES | {"zero", "no-learning observer"}
    assert any("source" in name for name in newtons)
    assert min(newtons[name] for name in ARCHITECTURES - {MEMORYLESS}) <= 1.6


def test_on_the_downwash_memory_predicts_and_flies_better() -> None:
    errors = means("study-domains.csv", "rmse", domain="downwash", channel="force_z_n")
    flown = means("study-closed-loop.csv", "tracking_rms_m")
    memories = ARCHITECTURES - {MEMORYLESS}
    for told in (errors, flown):
        assert max(told[name] for name in memories) < told[MEMORYLESS]
    nothing, oracle = flown["no compensation"], flown["oracle"]
    gains = [(nothing - flown[name]) / (nothing - oracle) for name in memories]
    assert max(gains) >= 0.7


def test_the_compiled_field_is_eight_times_its_twin() -> None:
    assert json.loads((RECORDS / "field.json").read_text())["ratio_worst_turn"] >= 8.0


def test_on_the_gantry_a_window_suffices_that_reaches_as_far_back_as_the_wake_takes() -> None:
    with (RECORDS / "study-window.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["domain"] == "gantry"]
    errors = defaultdict(list)
    for row in rows:
        if row["arch"] == "history-mlp":
            errors[float(row["past_s"])].append(float(row["rmse"]))
    mean = {past_s: float(np.mean(own)) for past_s, own in errors.items()}
    enough_s = min(past_s for past_s, error in mean.items() if error <= 1.05 * min(mean.values()))
    assert (
        0.343 <= enough_s <= 0.5
    )  # transport and the source's lag, from docs/records/study-delay-embedding.csv
    memoryless = np.mean([float(row["rmse"]) for row in rows if row["arch"] == MEMORYLESS])
    assert mean[enough_s] < 0.2 * memoryless


OWN_PASSES = ("delay-embedding", "cross-attention")  # take most of their time, in any loop


@pytest.mark.parametrize(
    ("record", "least", "least_of_own_passes"),
    [("training-speed.json", 3.0, 2.2), ("training-speed-slower-core.json", 2.4, 2.0)],
)
def test_recurrent_models_train_ten_times_as_fast_as_in_a_plain_loop_and_end_no_worse(
    record: str, least: float, least_of_own_passes: float
) -> None:
    rows = json.loads((RECORDS / record).read_text())["rows"]
    told = {row["arch"]: row for row in rows}
    error = {
        arch: {who: float(np.mean(own)) for who, own in row["errors"].items()}
        for arch, row in told.items()
    }
    for arch in ("gru", "mamba"):
        assert told[arch]["ratio"]["median"] >= 10.0
        assert error[arch]["ours, twice as long"] < error[arch]["plain"]
    for arch in (MEMORYLESS, "history-mlp", "delay-embedding", "cross-attention"):
        own = arch in OWN_PASSES
        assert told[arch]["ratio"]["median"] >= (least_of_own_passes if own else least)
        assert error[arch]["ours"] == pytest.approx(error[arch]["plain"], rel=0.05)
    for row in rows:
        assert row["targets"]["ours"] == row["targets"]["plain"]
        assert row["initial_sha256"]["ours"] == row["initial_sha256"]["plain"]


def test_flights_in_lockstep_are_forty_times_as_fast_as_real_time_with_any_model() -> None:
    told = json.loads((RECORDS / "downwash-speed.json").read_text())["times_real_time"]
    flown = {name: row["worst"] for name, row in told.items() if name.startswith("closed loop")}
    assert len(flown) == len(ARCHITECTURES)
    assert min(flown.values()) >= 40.0


def test_forces_are_recorded_a_hundred_times_as_fast_as_real_time() -> None:
    told = json.loads((RECORDS / "downwash-speed.json").read_text())["times_real_time"]
    assert told["recording"]["worst"] >= 100.0
