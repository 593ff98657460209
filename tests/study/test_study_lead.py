"""How far ahead: errors as an AR(1) series has them, oracles as they must be, and the command."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import lfilter

from wakedeploy.cli.study_horizon import lead
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet, read_episode_set
from wakedeploy.domains.downwash import RATE_HZ, fly
from wakedeploy.domains.gantry_lead import sweep
from wakedeploy.rig.file import default_rig
from wakedeploy.study.closed_loop import FIRST_SEED
from wakedeploy.study.lead import (
    LEADS_S,
    NOTHING,
    SETTLED_S,
    TRUTH,
    Flight,
    Point,
    asked,
    best,
    flown_before,
    force_error,
    measure,
    planned,
    sentence,
    shares,
    track,
    tracking,
)
from wakedeploy.study.lead_figure import headline, parts, summary
from wakedeploy.study.runs import Wanted, obtained

DELAY, KEEP, SAMPLES = 4, 0.8, 400


def delayed_set() -> EpisodeSet:
    """At 20 Hz a force that is the observation of four samples ago, an AR(1) series."""
    rng = np.random.default_rng(0)
    made = []
    for i in range(12):
        kicks = rng.normal(0.0, math.sqrt(1.0 - KEEP**2), SAMPLES + 100)
        driven = lfilter([1.0], [1.0, -KEEP], kicks)[100 - DELAY :, None].astype(np.float32)
        made.append(Episode(f"e{i}", driven[DELAY:], driven[:-DELAY]))
    split = {f"e{i}": "train" if i < 8 else "validation" if i == 8 else "test" for i in range(12)}
    return EpisodeSet("toy", 20.0, (Channel("drive", "N"),), (Channel("force_z_n", "N"),), 0.5,
                      (1.0,), split, tuple(made))  # fmt: skip


@pytest.mark.whole
def test_memory_loses_nothing_up_to_the_delay_and_then_what_an_ar1_series_loses(tmp_path) -> None:
    data = delayed_set()
    for steps in (0, 4, 8):
        lead_s = steps / 20.0
        for arch, told in (
            ("history-mlp", max(0, steps - DELAY)),
            ("agile-mlp", abs(steps - DELAY)),
        ):
            predictor = obtained(data, Wanted(arch, 0, epochs=15, lead_s=lead_s), tmp_path)
            found = force_error(data, "force_z_n", predictor, lead_s)
            rmse, sd = found["rmse"], found["sd"]
            least = math.sqrt(1.0 - KEEP ** (2 * told))
            assert rmse / sd == pytest.approx(least, abs=0.08), (arch, steps)
            assert found["r2"] == pytest.approx(1.0 - (rmse / sd) ** 2)
            assert found["r2_low"] < found["r2"] < found["r2_high"] < 1.0
            assert found["rmse_low"] < rmse < found["rmse_high"]
            # Only what has a target is scored: the warm-up and the lead are missing.
            assert found["scored"] == 3 * (SAMPLES - data.warm_up_steps - steps)


@pytest.mark.whole
def test_the_truth_of_a_flight_flown_before_is_the_truth_and_a_lead_shifts_it() -> None:
    seeds = [FIRST_SEED, FIRST_SEED + 1]
    settled = round(SETTLED_S * RATE_HZ)
    at_once = fly(seeds, seconds=5.0, expect="truth")
    again = flown_before(seeds, 5.0, 0.0)
    assert again.error_m.shape == at_once.error_m.shape
    assert np.abs(again.error_m - at_once.error_m)[settled:].max() < 1e-4
    ahead = flown_before(seeds, 5.0, 0.1)
    assert np.abs(ahead.expected_n[:-10] - ahead.force_n[10:]).max() < 2e-3
    assert np.abs(ahead.expected_n[:-10] - ahead.force_n[:-10]).max() > 0.1
    rms, ended = track(Flight("downwash", 2, 5.0 - SETTLED_S, lead_s=0.0))
    expected = np.sqrt((at_once.error_m[settled:] ** 2).sum(-1).mean(0))
    assert rms == pytest.approx(expected, rel=1e-3)
    assert ended == 0


@pytest.mark.slow
def test_the_gantrys_limits_are_those_of_its_own_sweep(monkeypatch) -> None:
    monkeypatch.setattr("wakedeploy.domains.gantry_lead._FIRST_SEED", FIRST_SEED)
    scores = sweep(default_rig(), [0.0, 0.1], flights=2, seconds=5.0)
    for score in scores:
        rms, _ = track(Flight("gantry", 2, 5.0, lead_s=score.lead_s))
        assert np.mean(rms) == pytest.approx(score.rmse_m, rel=1e-12)
    assert scores[1].rmse_m < 0.8 * scores[0].rmse_m  # motors lag: a lead is worth something
    nothing, _ = track(Flight("gantry", 2, 5.0))
    assert np.mean(nothing) > 2.0 * scores[0].rmse_m


def points(at: dict[float, tuple[float, ...]], name: str = "gru") -> list[Point]:
    return [Point("toy", name, lead_s, 0, flown, rmse=0.1 + lead_s, sd=1.0, scored=5)
            for lead_s, flown in at.items()]  # fmt: skip


def test_the_best_lead_and_what_it_gains_over_paired_flights() -> None:
    rng = np.random.default_rng(0)
    hard = rng.uniform(0.01, 0.04, 12)  # flights differ more than leads do
    leads = {0.0: 1.2, 0.1: 1.0, 0.25: 1.5}
    own = points({lead_s: tuple(factor * hard) for lead_s, factor in leads.items()})
    found = best(own, "gru")
    rms_m = math.sqrt(np.mean(hard**2))
    assert found.lead_s == 0.1
    assert (found.tracking_m, found.at_zero_m) == pytest.approx((rms_m, 1.2 * rms_m))
    # Every draw chooses the same lead, and the flights left out of it gain a fifth of their own.
    assert 0.2 * 0.01 < found.low_m < 0.2 * rms_m < found.high_m < 0.2 * 0.04
    assert headline({"toy": own}) == (
        f"What tracks best: on toy gru 100 ms ahead, {1e3 * rms_m:.1f} mm instead of "
        f"{1.2e3 * rms_m:.1f}. "
    )
    assert shares(own, "gru") == {0.0: [0.1], 0.1: [0.2], 0.25: [0.35]}
    limits = [Point("toy", NOTHING, None, None, (0.05,) * 12),
              Point("toy", TRUTH, 0.0, None, (0.004,) * 12),
              Point("toy", TRUTH, 0.1, None, (0.006,) * 12)]  # fmt: skip
    told = sentence("toy", [*limits, *own])
    assert "gru tracks best with a lead of 100 ms" in told
    assert "the true force tracks best without a lead, 4.0 mm" in told
    assert "no compensation leaves 50.0 mm" in told
    assert "gru from 0.10 to 0.35" in told
    edge = points({0.0: tuple(2.0 * hard), 0.1: tuple(hard)})
    assert not found.longest
    assert "gru tracks best with the longest lead of 100 ms" in sentence("toy", [*limits, *edge])


def test_leads_that_are_alike_gain_nothing_by_being_chosen() -> None:
    """With seven leads of equal flights up to chance, the interval should rarely exclude 0."""
    rng = np.random.default_rng(0)
    excluded = 0
    for _ in range(40):
        hard = rng.uniform(0.01, 0.04, 8)
        alike = {at: tuple(hard * (1.0 + 0.1 * rng.normal(size=8))) for at in LEADS_S}
        found = best(points(alike), "gru")
        excluded += found.lead_s > 0.0 and found.low_m > 0.0
    assert excluded <= 4  # 11 if the lead is chosen once, 20 if it is measured where it is chosen


def test_seeds_that_differ_widen_what_a_lead_gains() -> None:
    rng = np.random.default_rng(0)
    flown = 0.010 * np.exp(0.02 * rng.standard_normal(12))

    def gained(apart: float) -> tuple[float, float]:
        made = [
            Point("toy", "gru", lead_s, seed, tuple(base * (1.0 + apart * (seed - 1)) * flown))
            for lead_s, base in ((0.0, 1.5), (0.1, 1.0))
            for seed in range(3)
        ]
        found = best(made, "gru")
        assert found is not None
        assert found.lead_s == 0.1
        assert found.low_m is not None
        assert found.high_m is not None
        return found.low_m, found.high_m

    alike, differing = gained(0.0), gained(0.2)
    assert alike[0] > 0.004
    assert differing[1] - differing[0] > 3.0 * (alike[1] - alike[0])


def test_a_lead_whose_flight_ended_early_is_never_best() -> None:
    own = points({0.0: (0.02, 0.03), 0.1: (0.015, 0.02), 0.25: (0.001, None)})
    own[2] = replace(own[2], failsafes=1)
    found = best(own, "gru")
    assert (found.lead_s, found.longest) == (0.1, False)
    assert tracking(own[2:]) == pytest.approx(0.001)  # as far as it was flown, without a NaN
    limits = [Point("toy", NOTHING, None, None, (0.05, 0.06)),
              Point("toy", TRUTH, 0.0, None, (0.004, 0.003))]  # fmt: skip
    told = sentence("toy", [*limits, *own])
    assert "gru tracks best with a lead of 100 ms" in told
    assert "Flights ended early: 1 of 2 with gru at 250 ms" in told
    assert "nan" not in told
    assert "ended early" not in sentence("toy", [*limits, *own[:2]])
    assert [row[-2] for row in summary([*limits, *own])[1]][-1] == "1.00"
    page = parts({"toy": [*limits, *own]})
    assert page[-1].rows[-1][-1] is None
    never = [replace(own[2], tracking_m=(None, None), failsafes=2)]
    assert best(never, "gru") is None
    assert tracking(never) is None
    parts({"toy": [*limits, *never]})
    assert "gru has no lead at which every flight" in sentence("toy", [*limits, *never])


def test_without_whole_flights_at_no_lead_nothing_is_gained_over_it() -> None:
    own = points({0.0: (0.001, 0.001), 0.1: (0.01, 0.02)})
    own[0] = replace(own[0], failsafes=2)
    found = best(own, "gru")
    assert (found.lead_s, found.at_zero_m, found.low_m) == (0.1, None, None)
    limits = [Point("toy", NOTHING, None, None, (0.05, 0.06)),
              Point("toy", TRUTH, 0.0, None, (0.004, 0.003))]  # fmt: skip
    assert "15.8 mm (without one, flights ended early)" in sentence("toy", [*limits, *own])


def test_a_flight_that_never_flew_is_none_and_counts_as_ended(monkeypatch) -> None:
    class Log(dict):
        def tracking_rmse_m(self, height: str) -> float:
            return self["rms_m"]

    logs = iter([
        Log(mode=np.array(["RUNNING"]), rms_m=0.02),
        Log(mode=np.array(["READY"]), rms_m=float("nan")),
        Log(mode=np.array(["RUNNING", "FAILSAFE"]), rms_m=0.001),
    ])  # fmt: skip
    monkeypatch.setattr("wakedeploy.domains.gantry.record", lambda *_, **__: next(logs))
    assert track(Flight("gantry", 3, 5.0, lead_s=0.0)) == ((0.02, None, 0.001), 2)


@pytest.fixture(scope="module")
def told(tmp_path_factory, short_episodes):
    """The command on three tiny flights of either simulator."""
    from wakedeploy.study import sets

    tiny = {
        "gantry": sets.Domain("gantry", "force_z_n", 1.7, 1.7, make=sets.DOMAINS["gantry"].make),
        "downwash": sets.Domain(
            "downwash", "force_z_n", 1.0, 1.0, make=sets.DOMAINS["downwash"].make
        ),
    }
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sets, "DOMAINS", tiny)
        patch.setattr("wakedeploy.study.lead.QUICK_LEADS_S", (0.0, 0.1))
        result = CliRunner().invoke(lead, ["--quick", "--arch", "agile-mlp", "--out", str(folder)])
    assert result.exit_code == 0, result.output
    return result.output, folder


@pytest.mark.slow
def test_the_command_writes_figures_tables_and_a_page(told) -> None:
    output, out = told
    folder = out / "lead-quick"
    assert {p.name for p in folder.iterdir()} == {
        "lead.png", "lead.pdf", "lead.csv", "lead-gantry.csv", "lead-downwash.csv",
        "lead-flights.csv", "study.json", "study.html",
    }  # fmt: skip
    result = json.loads((folder / "study.json").read_text())
    rows = list(csv.DictReader((folder / "lead.csv").open()))
    # Per domain: nothing, the truth at two leads, one model at two leads.
    assert len(rows) == len(result["points"]) == 2 * (1 + 2 + 2)
    per_flight = list(csv.DictReader((folder / "lead-flights.csv").open()))
    assert len(per_flight) == 2 * len(rows)
    for row, point in zip(rows, result["points"], strict=True):
        rms_m = math.sqrt(np.mean(np.square(point["tracking_m"])))
        assert float(row["tracking_rms_m"]) == pytest.approx(rms_m)
        assert (row["rmse_n"] == "") == (row["seed"] == "")
    assert "On gantry, agile-mlp tracks best" in (folder / "study.html").read_text()
    assert "On downwash, agile-mlp tracks best" in output


@pytest.mark.slow
def test_runs_are_kept_from_those_of_studies_that_train_longer(told) -> None:
    _, out = told
    data = read_episode_set(out / "sets" / "gantry-quick")
    usual = out / "runs-quick"
    assert list((usual / "lead").rglob("config.json"))
    obtained(data, Wanted("agile-mlp", 0, epochs=1), usual)  # refused beside a run of four epochs


def test_a_reservoir_has_its_scales_tried_at_every_lead() -> None:
    lines = asked(["esn", "gru"], [0.0, 0.1], 1, 4)
    runs = [one for _, one in planned(delayed_set(), lines)]
    for lead_s in (0.0, 0.1):
        own = [one.hyper_text for one in runs if (one.arch, one.lead_s) == ("esn", lead_s)]
        assert len(set(own)) == 3
    assert len(runs) == 2 * (3 + 1)


@pytest.mark.slow
def test_flights_side_by_side_are_those_flown_one_after_the_other(told) -> None:
    _, out = told
    data = read_episode_set(out / "sets" / "gantry-quick")
    runs = out / "runs-quick" / "lead"
    lines = asked(["agile-mlp"], [0.1], 1, 4)
    again = measure(data, "force_z_n", lines, [0.1], runs, flights=2, seconds=6.0, workers=2)
    written = json.loads((out / "lead-quick" / "study.json").read_text())["points"]
    for point in again:
        same = [w for w in written if (w["domain"], w["predictor"], w["lead_s"])
                == ("gantry", point.predictor, point.lead_s)]  # fmt: skip
        assert [list(point.tracking_m)] == [w["tracking_m"] for w in same]
        assert [point.rmse] == [w["rmse"] for w in same]
