"""Thresholds: their quantiles, the shipped file, and what a set without any effect is made of."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import append_json_line
from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search import threshold
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds
from wakedeploy.gap.systems.gantry.search.threshold import (
    NullSet,
    known_thresholds,
    miscalibrated,
    quantiles,
    searched_with,
    simulate,
)
from wakedeploy.physics.constants import constants_of, spreads_of
from wakedeploy.rig.file import default_rig

PLACES = {"force": 0.01, "control effort": 0.01, "height 0.25 s ahead": 0.001}


def drawn(count: int, seed: int) -> list[NullSet]:
    """Sets whose gains are maxima of many, and whose whiteness is that of noise."""
    rng = np.random.default_rng(seed)
    return [
        NullSet(
            effect_nats=2.5 + 1.3 * rng.gumbel(),
            effect="stiction",
            expression_nats=2.5 + 1.3 * rng.gumbel(),
            wave_nats=4.0 + 1.5 * rng.gumbel(),
            whiteness=float(rng.chisquare(16)),
            places=PLACES,
        )
        for _ in range(count)
    ]


def alarms(limits: Thresholds, sets: list[NullSet]) -> float:
    names = ("effect_nats", "expression_nats", "wave_nats", "whiteness")
    return float(np.mean([any(getattr(s, n) > getattr(limits, n) for n in names) for s in sets]))


def test_other_sets_exceed_the_thresholds_about_as_rarely_as_promised() -> None:
    fresh = drawn(2000, 99)
    rates = [alarms(quantiles(drawn(48, seed)), fresh) for seed in range(30)]
    assert np.mean(rates) == pytest.approx(RULES.false_alarms, abs=0.025)


def test_a_handful_of_sets_is_refused() -> None:
    with pytest.raises(UnusableInput, match="use 10"):
        quantiles(drawn(9, 0))


@pytest.mark.parametrize("rig", [default_rig(), default_rig().without("spool")])
def test_the_default_rigs_thresholds_are_shipped(rig) -> None:
    known = known_thresholds(rig)
    assert known is not None
    assert all(value > 0.0 for value in dataclasses.asdict(known).values())
    # The best of thirty effects, each with half a chi-squared less what leaving out costs.
    assert 3.0 < known.effect_nats < 12.0
    assert 40.0 <= known.whiteness < 100.0


@pytest.mark.parametrize("rig", [default_rig(), default_rig().without("spool")])
def test_shipped_thresholds_are_of_the_form_and_the_library_that_there_are(rig) -> None:
    """Else: another VERSION, and `python -m benchmarks.gap_thresholds`."""
    shipped = json.loads(Path(threshold.__file__).with_name("thresholds.json").read_text())
    assert shipped["rigs"][rig.sha256]["searched_with"] == searched_with(rig)
    wider = rig.changed(discrepancy={"wake": 0.06})
    assert searched_with(wider) != searched_with(rig)


def test_a_corrected_rigs_effects_are_off_as_their_intervals_allow() -> None:
    lag = {"up_s": EffectParameter(value=0.06, unit="s", low=0.05, high=0.07)}
    lag["down_s"] = EffectParameter(value=0.1, unit="s")
    entry = Effect(name="spool-lag-sufferer", parameters=lag)
    rig = default_rig().without("spool").model_copy(update={"effect": (entry,)})
    seeds = range(300)
    truths = [miscalibrated(rig, np.random.default_rng(s)).effect[0].parameters for s in seeds]
    up_s = np.array([truth["up_s"].value for truth in truths])
    assert 0.85 < np.mean((up_s > 0.05) & (up_s < 0.07)) < 0.95
    assert up_s.std() > 0.005
    assert {truth["down_s"].value for truth in truths} == {0.1}


def test_thresholds_of_another_search_are_not_used(monkeypatch) -> None:
    assert known_thresholds(default_rig()) is not None
    monkeypatch.setattr("wakedeploy.gap.systems.gantry.search.threshold.VERSION", 1_000_000)
    assert known_thresholds(default_rig()) is None


def test_what_a_stopped_simulation_has_kept_is_not_flown_again(tmp_path) -> None:
    kept, sets = tmp_path / "sets.jsonl", drawn(3, 1)
    append_json_line(kept, {"seed": 7, "effect_nats": 3.0})  # of another version
    for i, one in enumerate(sets):
        append_json_line(kept, {"seed": 5 + 1000 * i, **dataclasses.asdict(one)})
    kept.write_bytes(kept.read_bytes() + b'{"seed": 30')  # killed while it wrote
    asked = []
    told = simulate(
        default_rig(), sets=3, first_seed=5, kept=kept, progress=lambda *at: asked.append(at)
    )
    assert told == sets
    assert asked == []


@pytest.mark.slow
def test_a_simulated_set_is_kept_when_it_is_done(tmp_path) -> None:
    kept = tmp_path / "sets.jsonl"
    first = simulate(default_rig(), sets=1, first_seed=11, workers=1, kept=kept)
    lines = kept.read_text()
    assert simulate(default_rig(), sets=1, first_seed=11, workers=1, kept=kept) == first
    assert kept.read_text() == lines
    assert 0.0 < first[0].effect_nats < 20.0


def test_a_miscalibrated_truth_scatters_by_what_the_rig_file_states() -> None:
    rig = default_rig()
    value, spread = (of(rig)["rail.viscous_n_per_mps"] for of in (constants_of, spreads_of))
    drawn_values = [
        constants_of(miscalibrated(rig, np.random.default_rng(seed)))["rail.viscous_n_per_mps"]
        for seed in range(200)
    ]
    assert np.mean(drawn_values) == pytest.approx(value, abs=3 * spread / 200**0.5)
    assert np.std(drawn_values) == pytest.approx(spread, rel=0.2)
    biases = []
    for seed in range(200):
        entries = {e.name: e for e in miscalibrated(rig, np.random.default_rng(seed)).effect}
        biases.append(entries["range-bias"].parameters["bias_m"].value)
    assert np.std(biases) == pytest.approx(spreads_of(rig)["range.bias_m"], rel=0.2)
