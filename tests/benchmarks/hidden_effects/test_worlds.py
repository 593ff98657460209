"""Hidden effects reach both plants, and the workflow's folder tells nothing of them."""

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.hidden_effects import worlds
from benchmarks.hidden_effects.cases import FLIGHTS, Case, all_cases, hidden_effects, values_at
from benchmarks.hidden_effects.measure import Measured
from benchmarks.hidden_effects.outside import OUTSIDE
from benchmarks.hidden_effects.run import Job, do_case
from benchmarks.hidden_effects.second_plant import SecondPlant
from benchmarks.hidden_effects.worlds import flight, second_constants, true_rig, write_world
from wakedeploy.core.runlog import read_run_log
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig, read_rig

NOTHING = Case("nothing", "none", "second", 7)


def differing(one: Any, other: Any) -> set[str]:
    """Fields of nested tuples of numbers that differ."""
    found: set[str] = set()
    for name, a, b in zip(one._fields, one, other, strict=True):
        if a != b:
            found |= differing(a, b) if hasattr(a, "_fields") else {name}
    return found


@pytest.mark.parametrize("name", hidden_effects())
def test_every_hidden_effect_of_the_library_reaches_both_plants(name: str) -> None:
    rig = default_rig()
    hidden = Case(name, "effect", "second", 7, 50, {name: values_at(name, 1.0, rig)})
    without = replace(hidden, effects={name: values_at(name, 0.0, rig)})
    changed = differing(second_constants(hidden), second_constants(without))
    assert 1 <= len(changed) <= 2, changed
    (entry,) = (e for e in true_rig(hidden).effect if e.name == name)
    GantryPlant(true_rig(hidden), seed=0)
    assert entry.parameters[LIBRARY[name].parameters[0].name].value != 0.0 or name == "range-scale"


def test_calibration_reaches_the_second_plant_as_it_reaches_the_first() -> None:
    second, first = second_constants(NOTHING), true_rig(NOTHING)
    assert second.wake.strength == first.wake.strength
    assert second.numbers.sufferer_up_s == first.spool.sufferer.up_s
    for pulse in (1300.0, 1700.0, 1900.0):
        plant = SecondPlant(second, seed=0)
        expected = first.thrust.sufferer.thrust(pulse)
        assert plant._thrust(second.sufferer, pulse) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("name", list(OUTSIDE))
def test_effects_outside_the_library_push_both_plants_alike(name: str) -> None:
    """A second of lift-off in each plant, whose frictions let go at different times."""
    assert name not in LIBRARY
    size = 4.0 * OUTSIDE[name].unit
    moved = []
    for plant in ("first", "second"):
        heights = []
        for chosen in ({name: size}, {}):
            heights.append(response(Case(name, "outside", plant, 7, 50, {}, chosen)))
        moved.append(np.subtract(*heights))
    assert np.abs(moved[0]).max() > 1e-4
    assert np.abs(moved[0] - moved[1]).max() < 0.3 * np.abs(moved[0]).max()


def response(case: Case) -> np.ndarray:
    """Heights while the source steps, the carriage moves, and the thrust lifts the sufferer."""
    quiet = {"turbulence_fraction": 0.0, "esc_frame_s": 0.004}
    bare = replace(case, outside={})
    if case.plant == "second":
        c = second_constants(case)
        numbers = c.numbers._replace(gust_start_s=0.3, gust_end_s=0.9)
        sensing = c.sensing._replace(turbulence_fraction=0.0, frame_s=0.004)
        plant: Any = SecondPlant(c._replace(numbers=numbers, sensing=sensing), seed=1)
    else:
        rig = true_rig(bare).changed(disturbance=quiet)
        hooks = {k: h for n, s in case.outside.items() for k, h in OUTSIDE[n].hooks(s, rig).items()}
        if "gust" in case.outside:
            size = case.outside["gust"]
            hooks = {
                "force_hook": lambda t, _: (
                    size * math.sin(math.pi * (t - 0.3) / 0.6) ** 2 if 0.3 < t < 0.9 else 0.0
                )
            }
        plant = GantryPlant(rig, seed=1, **hooks)
    heights = []
    for k in range(256):
        plant.step(1650.0 if k % 128 > 40 else 1350.0, 1800.0, 0.3)
        heights.append(plant.z_m)
    return np.array(heights)


def test_the_truth_stays_outside_the_workflows_folder(
    tmp_path: Path,
) -> None:
    case = next(c for c in all_cases() if c.name == "tether-spring/50/0")
    with pytest.raises(ValueError, match="could see it"):
        write_world(case, tmp_path / "world", tmp_path / "world" / "truth.json")
    paths = write_world(case, tmp_path / "world", tmp_path / "truth.json", flights=1, seconds=5.0)
    log = read_run_log(paths[0])
    assert not any(name.startswith("true_") for name in log.columns)
    assert read_rig(tmp_path / "world" / "rig.toml").effect == ()
    for path in (tmp_path / "world").iterdir():
        assert b"tether" not in path.read_bytes()
    told = json.loads((tmp_path / "truth.json").read_text())
    assert told["effects"]["tether-spring"]["slack_m"] == 0.5


@pytest.mark.slow
def test_the_judge_measures_what_was_hidden_and_its_size(tmp_path: Path) -> None:
    case = next(c for c in all_cases() if c.name == "crosswind-offset/50/1")

    def workflow(rig: Path, logs: list[Path], out: Path, *, workers: int = 1) -> SimpleNamespace:
        answer = {"verdict": "named", "effects": [{"name": "crosswind-offset"}], "gap": {}}
        return SimpleNamespace(as_json=lambda: answer)

    told = do_case(Job(case, tmp_path, workflow, False, ""))
    assert told.get("error") is None
    assert told["right"]
    assert 20.0 < told["nats"] < 130.0


@pytest.mark.slow
def test_without_any_effect_the_second_plant_gains_nothing() -> None:
    """A neutral second plant is within calibration of the rig: no effect helps by much."""
    case = Case("neutral", "none", "second", 11)
    logs = [flight(case, i).without_truth() for i in range(4)]
    rig = case.model_rig
    flights = [flight_from_log(log, rig, str(i)) for i, log in enumerate(logs)]
    gains = Measured(rig, flights).gains(["wake-strength", "coulomb-friction", "tether-spring"])
    assert max(gains.values()) < 10.0


@pytest.mark.slow
def test_the_truths_fit_is_no_worse_than_the_bases_where_constants_were_bent_to_do_without() -> (
    None
):
    """Two strong effects: with them on top of what the base was bent to, all would be outliers."""
    case = next(c for c in all_cases() if c.name == "spool-lag-sufferer+wake-strength/50/0")
    rig = case.model_rig
    logs = [flight(case, i).without_truth() for i in range(7)]
    flights = [flight_from_log(log, rig, f"flight{i}") for i, log in enumerate(logs)]
    measured = Measured(rig, flights)
    strength = measured.strength(case.effects)
    assert strength.fit.per_episode.sum() > measured.base.per_episode.sum()
    assert 10.0 < strength.nats < 300.0  # 222: it takes two effects of some 100 each
    assert measured.floor(strength.fit, ["flight5", "flight6"]).rms_m < 0.01


def test_a_flight_that_ends_at_take_off_is_flown_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """By another seed each time, a few times; what never flies is handed on as it is."""
    seeds: list[int] = []

    def short(case: Case, seed: int, seconds: float) -> SimpleNamespace:
        seeds.append(seed)
        return SimpleNamespace(flying=np.arange(640) < (600 if seed == flies else 20))

    case = next(case for case in all_cases() if case.kind == "effect")
    monkeypatch.setattr(worlds, "fly", short)
    first = 100 * case.seed + 3
    for flies, tried in ((first, 1), (first + FLIGHTS, 2), (-1, 4)):
        seeds.clear()
        log = worlds.flight(case, 3)
        assert seeds == [first + k * FLIGHTS for k in range(tried)]
        assert log.flying.sum() == (600 if flies >= 0 else 20)
