"""Places of disagreement: none in noise, planted ones where they are, false discoveries rare."""

import itertools

import numpy as np
import pytest
from recorded import RIG, based, flown
from scipy.stats import false_discovery_control

from wakedeploy.gap.search import places as finding
from wakedeploy.gap.search.artefacts import Place
from wakedeploy.gap.search.places import Residuals, forbids_none, q_values
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.residuals import CHANNELS, COORDINATES, residuals
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search import places as gantry_places
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.gap.systems.gantry.search.places import (
    AXES,
    HORIZONS_S,
    find_places,
    places_sentence,
)

SEEDS = (40, 41, 42)
LIMIT = 40.0
FLOOR = {"force": 0.02, "control effort": 0.02, "height 0.25 s ahead": 0.003}


def push(t_s, state) -> float:
    """A force [N] that the rig file does not know, right of the jet's axis only."""
    return 0.4 if state["x_m"] > 0.1 else 0.0


@pytest.fixture(scope="module")
def base():
    """Flights of the rig as its file describes it."""
    return based(*SEEDS)


@pytest.fixture(scope="module")
def pushed():
    return fitted_base(GantryModel(RIG, [flown(seed, hook=push, seconds=12.0) for seed in SEEDS]))


def place(channel: str, q_value: float) -> Place:
    """A place of height, of which only channel and q-value matter."""
    return Place(
        channel=channel, coordinate="height", exogenous=True, low=0.1, high=0.2, residual=0.1,
        unit="N", coordinate_unit="m", q_value=q_value, clarity=1.0, words="",
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(5))
def test_q_values_are_benjamini_and_hochbergs(seed: int) -> None:
    p = np.random.default_rng(seed).random(25) ** (1 + seed)
    assert q_values(p) == pytest.approx(false_discovery_control(p, method="bh"))


def test_q_values_by_hand() -> None:
    assert q_values([0.04, 0.01, 0.03]) == pytest.approx([0.04, 0.03, 0.04])
    assert q_values([0.9, 0.6]) == pytest.approx([0.9, 0.9])
    assert q_values([]) == []


@pytest.mark.whole
def test_nothing_is_found_where_nothing_is_missing(base) -> None:
    found = find_places(*base, LIMIT, FLOOR)
    assert found.places == []
    assert found.sentence == "No place stands out from noise."
    assert found.white.passes
    assert {m.channel for m in found.maps} == set(CHANNELS)
    assert set(found.least_residual) == set(FLOOR)
    for channel, floor in found.noise_floor.items():
        means = [v for m in found.maps if m.channel == channel for v in m.mean]
        # Nothing is missing: of the bins' means nine in ten lie within what noise alone puts there.
        assert 0.75 < np.mean(np.abs(means) < floor.value) <= 1.0
        assert floor.unit == CHANNELS[channel]
    for replay, horizon in zip(found.replay, HORIZONS_S, strict=True):
        assert replay.horizon_s == horizon
        assert replay.rmse_m == pytest.approx(replay.expected_m, rel=0.3)


@pytest.mark.whole
def test_a_force_is_found_where_it_acts(pushed) -> None:
    found = find_places(*pushed, LIMIT, FLOOR)
    places = [
        p for p in found.places if p.coordinate == "carriage position" and p.channel == "force"
    ]
    assert places
    right = max(places, key=lambda p: p.low)
    assert right.low > -0.05
    assert right.residual > 0.1
    assert right.exogenous
    assert right.q_value <= RULES.false_discoveries
    assert "carriage position above" in right.words
    assert "disagree" in found.sentence
    assert found.places[0].channel != "innovation"
    felt = [p for p in found.places if p.channel == "innovation"]
    assert felt
    assert felt[0].unit == "sd"
    assert "sd (innovation)" in felt[0].words


def test_the_sentence_counts_the_places_of_the_table() -> None:
    told = {"channel": "force", "coordinate": "height", "exogenous": False, "low": 0.0,
            "high": 1.0, "residual": 0.1, "unit": "N", "coordinate_unit": "m", "clarity": 3.0,
            "words": "height below 1 m: +0.1 N (force), q = 0.048"}  # fmt: skip
    faint, clear = (Place(**told, q_value=q) for q in (0.048, 0.001))
    for places, alone in (([faint, faint], True), ([clear, faint], False)):
        sentence = places_sentence(places, is_white=True, flights=7)
        unclear = "In 2 places (q ≤ 0.05) they may disagree, in none so clearly"
        clear = "They disagree beyond noise in 2 places (q ≤ 0.05)"
        assert sentence.startswith(unclear if alone else clear)


@pytest.mark.whole
def test_the_force_channel_weighs_the_missing_force(base, pushed) -> None:
    """With constants that are right; a fit without the force bends them to hide a part of it."""
    model, fitted = pushed[0], base[1]
    series = [residuals(model, fitted, "force", i) for i in range(model.episodes)]
    x_m = np.concatenate([s.coordinates["carriage position"] for s in series])
    value = np.concatenate([s.value for s in series])
    step = value[x_m > 0.18].mean() - value[x_m < 0.02].mean()
    assert step == pytest.approx(0.4, abs=0.1)


@pytest.mark.whole
def test_residuals_know_every_coordinate(base) -> None:
    model, fitted = base
    flight = model.flights[1]
    for channel in CHANNELS:
        one = residuals(model, fitted, channel, 1)
        assert set(one.coordinates) == set(COORDINATES)
        assert all(len(c) == len(one.at_s) == len(one.value) for c in one.coordinates.values())
        assert one.at_s.min() >= flight.grid_s[flight.start[0]]
        assert one.at_s.max() <= flight.grid_s[flight.stop[-1] - 1]
        began_s = one.at_s - {"force": 0.125, "control effort": 0.5, "innovation": 0.0}.get(
            channel, 0.125
        )
        height = np.interp(began_s, flight.grid_s, flight.nominal[0])
        known = np.isfinite(one.coordinates["height"])
        assert known.mean() > 0.9
        # what the filter knew then is less sure than the smoothed motion
        assert one.coordinates["height"][known] == pytest.approx(height[known], abs=0.03)
        assert np.isfinite(one.coordinates["source command"]).all()


@pytest.mark.whole
def test_innovations_are_white_against_what_was_known_before(base) -> None:
    """Heights smoothed with the reading itself would follow its innovation."""
    model, fitted = base
    series = [residuals(model, fitted, "innovation", i) for i in range(model.episodes)]
    value = np.concatenate([s.value for s in series])
    assert np.std(value) == pytest.approx(1.0, abs=0.1)
    for name in ("height", "vertical speed", "sufferer command"):
        known = np.concatenate([s.coordinates[name] for s in series])
        there = np.isfinite(known)
        correlation = np.corrcoef(known[there], value[there])[0, 1]
        assert abs(correlation) < 3.0 / np.sqrt(len(value))
    speed = np.concatenate([s.coordinates["vertical speed"] for s in series])
    smoothed = np.concatenate(
        [
            np.interp(s.at_s, f.grid_s, f.nominal[1])
            for s, f in zip(series, model.flights, strict=True)
        ]
    )
    there = np.isfinite(speed)
    assert np.corrcoef(speed[there], smoothed[there])[0, 1] > 0.9


@pytest.mark.whole
def test_a_channel_that_does_not_exist_is_refused(base) -> None:
    with pytest.raises(KeyError, match="none of force"):
        residuals(*base, "torque", 0)


def planted(rng, shape, keep: float = 0.0) -> list[Residuals]:
    """Made-up residuals of three flights: noise, perhaps coloured, and a shape over height."""
    series = []
    for _ in range(3):
        at_s = np.arange(0.0, 15.0, 0.125)
        noise = rng.standard_normal(len(at_s))
        for i in range(1, len(noise)):
            noise[i] = keep * noise[i - 1] + np.sqrt(1.0 - keep**2) * noise[i]
        wander = np.cumsum(rng.standard_normal((len(COORDINATES), len(at_s))), axis=1) * 0.1
        coordinates = dict(zip(COORDINATES, wander, strict=True))
        coordinates["height"] = 0.6 + 0.5 * np.sin(at_s * rng.uniform(0.5, 1.5))
        value = 0.1 * noise + shape(coordinates["height"])
        series.append(Residuals("force", at_s, value, coordinates))
    return series


def places_of(monkeypatch, base, seed: int, shape, keep: float = 0.0, seen=CHANNELS):
    """Places that are found in made-up residuals of the force; the other channels are silent."""
    rng = np.random.default_rng([5, seed])
    made = {channel: planted(rng, shape, keep) for channel in seen}
    monkeypatch.setattr(gantry_places, "residuals", lambda _m, _b, channel, i: made[channel][i])
    monkeypatch.setattr(finding, "_PERMUTATIONS", 399)
    return find_places(*base, LIMIT)


@pytest.mark.whole
@pytest.mark.parametrize("keep", [pytest.param(0.0, marks=pytest.mark.slow), 0.6])
def test_false_discoveries_are_rare_in_white_and_in_coloured_noise(
    monkeypatch, base, keep: float
) -> None:
    """A block outlasts the noise's memory, so its colour is not taken for a pattern."""
    count = 5
    wrong = sum(
        bool(places_of(monkeypatch, base, seed, np.zeros_like, keep).places)
        for seed in range(count)
    )
    assert wrong <= 1


def null_series(rng, keep: float, apart: float) -> list[Residuals]:
    """Residuals that depend on nothing; flights differ in their means and in where they flew."""
    series = planted(rng, np.zeros_like, keep)
    made = []
    for s in series:
        coordinates = {n: c + apart * rng.standard_normal() for n, c in s.coordinates.items()}
        value = s.value + 0.1 * apart * rng.standard_normal()
        made.append(Residuals(s.channel, s.at_s, value, coordinates))
    return made


@pytest.mark.whole
@pytest.mark.parametrize(
    ("keep", "apart"),
    [
        pytest.param(0.0, 0.0, marks=pytest.mark.slow),  # none, each by itself; both together below
        pytest.param(0.0, 1.0, marks=pytest.mark.slow),
        pytest.param(0.6, 0.0, marks=pytest.mark.slow),
        (0.6, 1.0),
    ],
)
def test_one_p_value_in_twenty_is_below_five_per_cent(monkeypatch, keep, apart) -> None:
    """White or coloured, and whatever sets one flight as a whole apart from another."""
    monkeypatch.setattr(finding, "_PERMUTATIONS", 199)
    p = []
    for seed in range(60):
        maps = finding._maps(null_series(np.random.default_rng([9, seed]), keep, apart), AXES)
        p += [m.p_value for m in maps if m.coordinate != "everywhere"]
    assert 0.03 < np.mean(np.array(p) <= 0.05) < 0.085
    assert 0.4 < np.mean(p) < 0.6


def test_the_mean_of_all_flights_has_a_true_p_value(monkeypatch) -> None:
    monkeypatch.setattr(finding, "_PERMUTATIONS", 199)
    p = [
        finding._everywhere(
            null_series(np.random.default_rng([9, seed]), 0.6, 0.0), 24, AXES
        ).p_value
        for seed in range(200)
    ]
    assert 0.02 < np.mean(np.array(p) <= 0.05) < 0.09


@pytest.mark.whole
def test_the_clearest_map_comes_first(monkeypatch, base) -> None:
    """Several are beyond what shuffles reach, and of one p value."""
    found = places_of(monkeypatch, base, 4, lambda height: 0.5 * (height - 0.6))
    clarity = [p.clarity for p in found.places if p.q_value == found.maps[0].q_value]
    assert len(clarity) > 2
    assert clarity == sorted(clarity, reverse=True)
    assert found.places[0].coordinate == "height"


@pytest.mark.parametrize("counts", [[5], [40, 1, 23], [16, 16]])
def test_a_shuffle_keeps_every_residual_in_its_flight(counts) -> None:
    orders = finding._orders(counts, 8, np.random.default_rng(1))
    bounds = np.cumsum([0, *counts])
    for order in orders[:50]:
        for first, last in itertools.pairwise(bounds):
            assert sorted(order[first:last]) == list(range(first, last))


@pytest.mark.whole
def test_a_planted_bump_is_found_at_its_bins(monkeypatch, base) -> None:
    def bump(height):
        return np.where((height > 0.55) & (height < 0.8), 0.15, 0.0)

    found = places_of(monkeypatch, base, 1, bump)
    best = found.places[0]
    assert best.coordinate == "height"
    assert best.low < 0.75
    assert best.high > 0.6
    assert 0.07 < best.residual < 0.2  # bins at its edges are only half in it
    assert best.words.startswith("height 0.")
    for m in found.maps:
        if m.coordinate == "height":
            highest = int(np.argmax(m.mean))
            assert 0.5 < 0.5 * (m.edges[highest] + m.edges[highest + 1]) < 0.85


@pytest.mark.parametrize(
    ("channel", "q", "forbids"),
    [("force", 0.02, True), ("force", 0.03, False), ("innovation", 0.001, False)],
)
def test_a_place_that_chance_makes_often_does_not_forbid_that_nothing_is_missing(
    channel: str, q: float, forbids: bool
) -> None:
    assert forbids_none([place("force", 0.05), place(channel, q)]) is forbids
    assert not forbids_none([])


@pytest.mark.whole
def test_an_offset_is_everywhere(monkeypatch, base) -> None:
    found = places_of(monkeypatch, base, 2, lambda height: np.full_like(height, 0.1))
    everywhere = [p for p in found.places if p.coordinate == "everywhere"]
    assert everywhere
    for p in everywhere:
        assert p.residual == pytest.approx(0.1, abs=0.03)
        assert p.words.startswith("everywhere: +")


@pytest.mark.whole
def test_a_place_that_is_smaller_than_the_models_own_error_is_none(monkeypatch, base) -> None:
    places_of(monkeypatch, base, 2, lambda height: np.full_like(height, 0.1))
    floor = dict.fromkeys(CHANNELS, 0.5)
    found = find_places(*base, LIMIT, floor)
    assert found.places == []
    least = found.least_residual["force"]
    assert (least.value, least.unit) == (0.5, "N")


@pytest.mark.whole
def test_maps_hold_means_and_intervals_of_their_bins(monkeypatch, base) -> None:
    rng = np.random.default_rng([5, 3])
    made = planted(rng, lambda height: 0.3 * height)
    monkeypatch.setattr(gantry_places, "residuals", lambda _m, _b, channel, i: made[i])
    found = find_places(*base, LIMIT)
    told = next(m for m in found.maps if m.coordinate == "height")
    height = np.concatenate([s.coordinates["height"] for s in made])
    value = np.concatenate([s.value for s in made])
    edges = np.array(told.edges)
    assert edges == pytest.approx(np.quantile(height, np.linspace(0, 1, len(edges))))
    bins = np.clip(np.searchsorted(edges, height, side="right") - 1, 0, len(edges) - 2)
    length = finding.block_length(made, AXES)
    blocks = finding.blocks_of(made, length)
    for k in range(len(edges) - 1):
        assert told.blocks[k] == sum((bins[block] == k).any() for block in blocks)
        assert told.count[k] == (bins == k).sum()
        assert told.mean[k] == pytest.approx(value[bins == k].mean())
        assert told.low[k] < 0.3 * height[bins == k].mean() + 0.1
        assert told.low[k] < told.mean[k] < told.high[k]
    assert [m.q_value for m in found.maps] == sorted(m.q_value for m in found.maps)
