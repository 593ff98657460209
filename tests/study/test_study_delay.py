"""Where models look back to: on a set whose delay is known, and the command with its figures."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from trainers.build import build
from trainers.inspection.lookback import attention, kernels
from trainers.model import Predictor
from trainers.training.tape import lay_tape
from wakedeploy.cli.study_delay import delay
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.domains.downwash import World, make_set
from wakedeploy.rig.file import default_rig
from wakedeploy.study import delay as study
from wakedeploy.study.delay import (
    Attended,
    Case,
    Learned,
    Transport,
    attended,
    best,
    learned,
    trend,
)
from wakedeploy.study.delay_figure import (
    attention_sentence,
    attention_summary,
    delay_sentence,
    delay_summary,
    draw,
)
from wakedeploy.study.sets import Domain

RATE_HZ, SPEED_MPS = 20.0, 5.0


def late_set(steps: int, domain: str = "toy") -> EpisodeSet:
    """A force that is the drive of `steps` samples ago, as far below as a wake sinks meanwhile."""
    rng = np.random.default_rng(steps)
    distance_m = SPEED_MPS * steps / RATE_HZ
    made = []
    for i in range(6):
        drive = np.convolve(rng.normal(size=453), [0.3, 0.5, 0.7], "valid")
        below_m = distance_m + 0.01 * rng.normal(size=451)
        force = np.r_[np.zeros(steps), drive[:-steps]]
        observation = np.stack([drive, below_m], 1).astype(np.float32)
        made.append(Episode(f"e{i}", observation, force.astype(np.float32)[:, None]))
    split = {f"e{i}": ("test", "validation", *["train"] * 4)[i] for i in range(6)}
    channels = (Channel("drive", "N"), Channel("dz_m", "m"))
    return EpisodeSet(domain, RATE_HZ, channels, (Channel("force_z_n", "N"),), 0.5, (1.0,), split,
                      tuple(made))  # fmt: skip


CASE = Case(Domain("toy", "force_z_n"), "toy", SPEED_MPS)


@pytest.mark.whole
def test_the_learned_delay_is_the_one_that_the_force_has(tmp_path: Path) -> None:
    every = [
        line for steps in (3, 7) for line in learned(CASE, late_set(steps), 1, tmp_path, epochs=25)
    ]
    assert [line.start_s for line in every] == [0.067, 0.433] * 2  # not where the delays are
    lines = [min(every[:2], key=lambda x: x.validation), min(every[2:], key=lambda x: x.validation)]
    every = [replace(x, setting=f"{x.transport.mean_s:.2f}") for x in every]
    assert [x.start_s for x in best(every)] == [x.start_s for x in lines]
    for line, true_s in zip(lines, (0.15, 0.35), strict=True):
        assert line.transport.mean_s == pytest.approx(true_s, abs=0.001)
        assert line.delay_s == pytest.approx(true_s, abs=1.5 / RATE_HZ)
        assert line.mean_age_s == pytest.approx(true_s, abs=1.0 / RATE_HZ)
        assert line.r2 > 0.9
        assert line.r2_low < line.r2 < line.r2_high < 1.0
        assert line.outside == 0.0
    found = trend(lines)
    assert found.slope == pytest.approx((lines[1].delay_s - lines[0].delay_s) / 0.2, rel=0.01)
    assert found.off_s == pytest.approx(np.mean([x.delay_s for x in lines]) - 0.25, abs=0.001)


@pytest.mark.whole
def test_attention_peaks_where_the_force_comes_from(tmp_path: Path) -> None:
    look = attended(CASE, late_set(6), 1, tmp_path, epochs=25)
    assert look.ages_s[0] == pytest.approx(0.5)
    assert look.ages_s[-1] == 0.0
    assert look.weights.sum(1) == pytest.approx([1.0], abs=1e-5)
    assert look.peak_s == pytest.approx(0.3)
    assert look.mean_weights.max() > 3.0 * look.present


def test_untrained_models_look_where_they_are_told_to_begin() -> None:
    data = late_set(4)
    tape = lay_tape(data, "test", 0.0, data.warm_up_steps)

    def fresh(arch: str, **hyper: float) -> Predictor:
        core = build(arch, inputs=2, outputs=1, window_s=0.5, rate_hz=RATE_HZ, hyper=hyper)
        return Predictor(arch, core, 2, 1)

    # A narrow kernel weighs the snapshot nearest to its centre; beyond the window, its end.
    for start_s, nearest_s in ((0.2, 0.2), (2.0, 0.5)):
        predictor = fresh("delay-embedding", initial_delay_s=start_s, initial_spread_s=0.001)
        told = kernels(predictor, tape)
        assert told.delay_s == pytest.approx(np.full(int(tape.scored.sum()), start_s), rel=1e-5)
        assert told.mean_age_s == pytest.approx(np.full(len(told.delay_s), nearest_s), abs=0.005)
    weights = attention(fresh("cross-attention"), tape)
    assert weights.shape == (11, 4)
    assert weights.sum(0) == pytest.approx(np.ones(4))
    with pytest.raises(TypeError, match="gru"):
        kernels(fresh("gru"), tape)


@pytest.mark.whole
def test_a_set_flies_in_the_world_that_it_is_given() -> None:
    near = make_set(minutes=0.1, seed=3, world=World(separation_m=1.5))
    assert near.provenance["world"]["separation_m"] == 1.5
    flown = study.transport(near, 6.0)
    assert flown.mean_s == pytest.approx(1.5 / 6.0, abs=0.02)
    assert flown.low_s < flown.mean_s < flown.high_s


def test_cases_state_the_delays_that_their_rigs_have() -> None:
    named = {case.domain.name: case for case in study.cases(quick=False)}
    assert len(named) == 10
    assert named["gantry-9mps"].speed_mps == 9.0
    assert named["downwash-1.7m"].speed_mps == 6.0
    assert named["downwash-1.7m"].source_lag_s == 0.0
    late = default_rig().changed(spool={"source": {"up_s": 0.2, "down_s": 0.4}},
                                 latency={"round_trip_s": 0.04},
                                 disturbance={"esc_frame_s": 0.02})  # fmt: skip
    assert study.source_lag_s(late) == pytest.approx(0.3 + 0.02 + 0.01)


def line(
    domain: str,
    true_s: float,
    delay_s: float,
    lag_s: float = 0.0,
    *,
    start_s: float = 0.05,
    validation: float = 0.1,
) -> Learned:
    true = Transport(true_s, true_s - 0.01, true_s + 0.01)
    begun = (f"{true_s:g}", 0, start_s, validation)
    return Learned(domain, *begun, true, lag_s, delay_s, 0.01, 0.1, 0.3, 0.25, 0.9, 0.88, 0.92)


def test_the_sentences_say_slope_and_distance_as_they_are() -> None:
    lines = [line("downwash", t, 0.5 * t + 0.3) for t in (0.2, 0.4)]
    lines += [line("gantry", t, t - 0.05, 0.1) for t in (0.2, 0.3)]
    told = delay_sentence(lines)
    assert "On downwash Delay Embedding's delay μ grows by 0.50 s" in told
    assert "is 0.150 s longer on average" in told
    assert "On gantry Delay Embedding's delay μ grows by 1.00 s" in told
    assert "is 0.050 s shorter on average (the source's lag is 0.100 s)" in told
    ages_s = np.array([0.3, 0.2, 0.1, 0.0])
    look = Attended("gantry", ages_s, np.array([[0.1, 0.5, 0.2, 0.2]]),
                    Transport(0.15, 0.1, 0.2), 0.05)  # fmt: skip
    seen = attention_sentence([look])
    assert "takes 0.150 s [0.100, 0.200], 0.200 s with the source's lag" in seen
    assert "20 % of its weight" in seen
    assert "0.200 s ago" in seen
    assert "looks 0.150 s back" in seen


@pytest.mark.parametrize(
    ("delay_s", "slope", "said"),
    [(0.10, 1.0, ("agrees", "agrees")), (0.02, 0.5, ("does not agree", "does not agree"))],
)
def test_the_papers_shift_stands_beside_the_learned_one(
    delay_s: float, slope: float, said: tuple[str, str]
) -> None:
    lines = [line("downwash", t, delay_s + 0.3 + slope * (t - 0.3)) for t in (0.2, 0.3, 0.4)]
    told = delay_sentence(lines).partition("In the paper")[2]
    assert "0.12 s longer" in told
    alike = 3 if said[0] == "agrees" else 1
    assert f"within 0.05 s of that at {alike} of 3, which {said[0]}" in told
    assert f"slope of {slope:.2f}, which {said[1]} within 0.25" in told
    assert "In the paper" not in delay_sentence([line("gantry", t, t, 0.1) for t in (0.2, 0.3)])


def test_shifts_that_cancel_do_not_agree() -> None:
    lines = [line("downwash", t, t + off) for t, off in ((0.2, -0.18), (0.3, 0.12), (0.4, 0.42))]
    told = delay_sentence(lines).partition("In the paper")[2]
    assert "here it is longer by −0.18, +0.12, +0.42 s" in told
    assert "within 0.05 s of that at 1 of 3, which does not agree" in told


@pytest.mark.parametrize(
    ("ends_s", "alike", "verdict"),
    [
        ((0.40, 0.42), "2 of 2 cases, 0.020 s apart on average", "agrees"),
        ((0.40, 0.10), "0 of 2 cases, 0.300 s apart on average", "does not agree"),
        ((0.70, 0.70), "2 of 2 cases, 0.000 s apart on average", "does not agree"),
    ],
)
def test_what_counts_is_the_start_that_validates_better_and_all_ends_are_told(
    ends_s: tuple[float, float], alike: str, verdict: str
) -> None:
    lines = []
    for true_s in (0.35, 0.40):
        late = {"start_s": 0.70, "validation": 0.2 if true_s < 0.38 else 0.05}
        lines += [line("downwash", true_s, ends_s[0]), line("downwash", true_s, ends_s[1], **late)]
    told = delay_sentence(lines)
    assert "began at μ₀ = 0.050 and 0.700 s whatever the transport delay" in told
    assert "(1 from 0.050 s, 1 from 0.700 s)" in told
    assert f"ends within 0.05 s in {alike}; in the paper it ends at the physical delay" in told
    assert f"wherever it starts, which {verdict}." in told
    ends = [f"{abs(e - 0.375):.3f} s {'longer' if e > 0.375 else 'shorter'}" for e in ends_s]
    for start, end in zip(("0.050", "0.700"), ends, strict=True):
        assert f"from {start} s alone {end} (slopes of μ" in told
    slope = (ends_s[1] - ends_s[0]) / 0.05  # of the better two alone
    assert f"grows by {slope:.2f} s" in told
    columns, rows = delay_summary(lines)
    assert rows[0][-1] == f"0.050 → {ends_s[0]:.3f}, 0.700 → {ends_s[1]:.3f}"
    assert len(columns) == len(rows[0])
    axes = draw([], lines).axes[-1]
    marked = [tuple(x.get_ydata()) for x in axes.lines if x.get_marker() == ">"]
    assert ((0.05,) in marked, (0.70,) in marked) == (True, True)


def test_the_papers_peak_stands_beside_the_attention() -> None:
    ages_s = np.array([0.6, 0.5, 0.4, 0.2, 0.0])
    true = Transport(0.38, 0.35, 0.41)

    def told(domain: str, *weights: float) -> str:
        return attention_sentence([Attended(domain, ages_s, np.array([weights]), true, 0.0)])

    alike = told("downwash", 0.2, 0.6, 0.18, 0.01, 0.01)
    assert "the weights peak 0.5 s ago, 0.12 s longer than" in alike
    assert "here they peak 0.500 s ago, 0.120 s longer" in alike
    assert alike.count("which agrees") == 2
    other = told("downwash", 0.1, 0.1, 0.2, 0.1, 0.5)
    assert "here they peak at the present, 0.380 s shorter" in other
    assert other.count("which does not agree") == 2
    assert "2.5 times the uniform weight" in other
    assert "paper" not in told("gantry", 0.2, 0.6, 0.18, 0.01, 0.01)


def test_how_far_the_seeds_peaks_lie_apart_is_told() -> None:
    ages_s = np.array([0.4, 0.3, 0.2, 0.1, 0.0])
    weights = np.array(
        [[0.1, 0.5, 0.2, 0.1, 0.1], [0.5, 0.1, 0.1, 0.2, 0.1], [0.0, 0.4, 0.1, 0.1, 0.4]]
    )
    look = Attended("gantry", ages_s, weights, Transport(0.24, 0.2, 0.3), 0.0)
    assert look.peaks_s == (0.3, 0.3, 0.4)  # the present is left out
    assert look.as_json()["peaks_s"] == [0.3, 0.3, 0.4]
    assert "0.300 s (0.300 to 0.400 s over 3 seeds) ago" in attention_sentence([look])
    columns, rows = attention_summary([look])
    assert rows[0][columns.index("over the seeds [s]")] == "0.300 to 0.400"


@pytest.mark.slow
def test_the_command_writes_figures_tables_and_a_page(tmp_path: Path) -> None:
    sets = tmp_path / "sets"
    for name in ("downwash", "gantry"):
        late_set(6, name).write(sets / f"{name}-quick")
    for case, steps in zip(study.cases(quick=True), (3, 7, 7, 3), strict=True):
        domain = case.domain.name.partition("-")[0]
        late_set(steps, domain).write(sets / f"{case.domain.name}-quick")
    told = CliRunner().invoke(delay, ["--quick", "--out", str(tmp_path)])
    assert told.exit_code == 0, told.output
    folder = tmp_path / "delay-quick"
    assert {p.name for p in folder.iterdir()} == {
        "delay.png", "delay.pdf", "delay.csv", "delay-embedding.csv", "study.json", "study.html",
    }  # fmt: skip
    weights = list(csv.DictReader((folder / "delay.csv").open()))
    for domain in ("downwash", "gantry"):
        own = [float(row["weight"]) for row in weights if row["domain"] == domain]
        assert len(own) == 11
        assert sum(own) == pytest.approx(1.0, abs=1e-5)
    rows = list(csv.DictReader((folder / "delay-embedding.csv").open()))
    result = json.loads((folder / "study.json").read_text())
    assert [float(row["delay_s"]) for row in rows] == [x["delay_s"] for x in result["delays"]]
    assert len(rows) == 8  # two starts each
    assert [sum(int(r["best_start"]) for r in rows[i : i + 2]) for i in (0, 2, 4, 6)] == [1] * 4
    assert "delay μ grows by" in (folder / "study.html").read_text()
