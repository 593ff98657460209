"""A sparse search finds the terms of an unknown force, and none where there is none."""

import math

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.expected_gains import promises
from wakedeploy.gap.evidence.fits import Free, Score
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.gantry.findings import Expression as Told
from wakedeploy.gap.systems.gantry.findings import Size
from wakedeploy.gap.systems.gantry.search.expression_terms import TERMS, neighbours, wave_in_time
from wakedeploy.gap.systems.gantry.search.expressions import SEARCHED, search, to_effect
from wakedeploy.physics.effects.base import Motion, Setting
from wakedeploy.physics.effects.symbolic import symbolic_effect
from wakedeploy.rig.file import default_rig

SETTING = Setting(
    source_height_m=2.0, mass_kg=0.45, weight_n=4.41, rotor_radius_m=0.127, travel_m=1.2
)
NUMBERS = vars(SETTING)
NOISE_N = 0.15


def smooth(rng, count, time_s=0.8, rate_hz=32.0):
    """A random wander of unit variance (count,), correlated over `time_s`."""
    keep = math.exp(-1.0 / (time_s * rate_hz))
    steps = rng.normal(size=count) * math.sqrt(1.0 - keep * keep)
    steps[0] = rng.normal()
    for i in range(1, count):
        steps[i] += keep * steps[i - 1]
    return steps


def motion(rng, count=450):
    """A flight-like motion; every coordinate wanders on its own."""
    carriage = 0.2 * smooth(rng, count)
    columns = {
        "time_s": np.arange(count) / 32.0,
        "x_m": 0.3 * smooth(rng, count),
        "vx_mps": carriage,
        "z_m": 0.5 + 0.2 * smooth(rng, count),
        "vz_mps": 0.15 * smooth(rng, count, 0.3),
        "source_n": 3.0 + 1.0 * smooth(rng, count),
        "source_rate_nps": 5.0 * smooth(rng, count, 0.2),
        "sufferer_n": 4.4 + 0.4 * smooth(rng, count),
        "wake_mps": -3.0 + smooth(rng, count),
        "wake_n": -0.6 + 0.2 * smooth(rng, count),
        "travelled_m": np.cumsum(np.abs(carriage)) / 32.0,
        "direction": np.sign(smooth(rng, count)),
    }
    return Motion(**columns)


class MeasuredForce:
    """A force measured directly, with white noise: the simplest model that effects can act in."""

    def __init__(self, truth, episodes=4, seed=0):
        rng = np.random.default_rng(seed)
        self.motions = [motion(rng) for _ in range(episodes)]
        noise = [NOISE_N * rng.normal(size=len(m.time_s)) for m in self.motions]
        self.measured = [0.1 + truth(m) + n for m, n in zip(self.motions, noise, strict=True)]

    @property
    def episodes(self):
        return len(self.motions)

    def free(self, hypothesis):
        own = [
            Free(f"{n}.{p.name}", p.unit, 0.0, 3 * p.scale, p.low, p.high, 0.1 * p.scale)
            for n in hypothesis
            for p in TERMS[n].parameters
        ]
        return (Free("offset", "N", 0.0, 1.0, -5.0, 5.0, 0.01), *own)

    def score(self, hypothesis, theta, episode):
        values = dict(zip([f.name for f in self.free(hypothesis)], theta, strict=True))
        expected = values["offset"]
        for name in hypothesis:
            own = {p.name: values[f"{name}.{p.name}"] for p in TERMS[name].parameters}
            expected = expected + TERMS[name].force_n(own, self.motions[episode], SETTING)
        rest = self.measured[episode] - expected
        variance = np.full(len(rest), NOISE_N**2)
        density = -0.5 * (rest**2 / variance + np.log(2 * math.pi * variance))
        return Score(density, rest, variance, np.ones(len(rest)))


def found_in(truth, seed=0, **options):
    model = MeasuredForce(truth, seed=seed)
    base = fit(model, (), range(model.episodes))
    return model, search(model, base, setting=NUMBERS, **options)


def test_two_terms_are_found_with_their_numbers():
    _, found = found_in(
        lambda m: 0.12 * np.sin(2 * math.pi * 1.53 * m.time_s + 0.4) - 0.3 * (m.z_m - 0.48)
    )
    assert set(found.terms) == {"wave-in-time-1530mhz", "height"}
    assert set(found.coordinates) == {"time_s", "z_m"}
    values = {term: [] for term in found.terms}
    names = [term for term in found.terms for _ in TERMS[term].parameters]
    for term, coefficient in zip(names, found.coefficients, strict=True):
        values[term].append(coefficient.value)
        assert coefficient.low < coefficient.value < coefficient.high
    sine, cosine = values["wave-in-time-1530mhz"]
    assert math.hypot(sine, cosine) == pytest.approx(0.12, abs=0.03)
    assert math.atan2(cosine, sine) == pytest.approx(0.4, abs=0.3)
    assert values["height"][0] == pytest.approx(-0.3, abs=0.08)
    assert found.gain_nats > 100


def test_its_text_tells_numbers_and_units():
    _, found = found_in(lambda m: 0.2 * np.sin(3 * math.pi * m.time_s + 0.4) - 0.4 * m.vz_mps)
    assert "N * sin(2π*1.5*time_s" in found.text
    assert found.text.endswith("N s/m * vz_mps")


@pytest.mark.parametrize(
    ("truth", "term"),
    [
        (lambda m: 3.0 * m.vz_mps * np.abs(m.vz_mps), "speed-squared"),
        (lambda m: 0.6 * m.wake_n * m.vx_mps, "wake-carriage"),
        (lambda m: 0.02 * m.source_rate_nps, "source-rate"),
        (lambda m: 0.1 * np.cos(2 * math.pi * m.z_m / 0.125 + 1.0), "wave-in-height-125mm"),
        (lambda m: 0.2 * np.abs(m.x_m), "place-size"),
    ],
)
def test_single_terms_are_found(truth, term):
    _, found = found_in(truth)
    assert found.terms == (term,)


@pytest.mark.parametrize("length_mm", [40, 45.5, 78, 95, 122, 230])
def test_a_ripple_of_the_belt_is_found_at_any_length(length_mm):
    """Listed or between two that are, to a fraction of a period over the passes."""
    _, found = found_in(lambda m: 0.25 * np.sin(2e3 * math.pi * m.x_m / length_mm))
    assert found.terms[0].startswith("wave-in-place-")
    assert 1e3 / float(found.terms[0][14:-2]) == pytest.approx(1e3 / length_mm, abs=0.35)


@pytest.mark.whole
def test_nothing_is_found_in_noise():
    assert all(found_in(lambda m: 0.0 * m.z_m, seed=seed)[1] is None for seed in range(1, 5))


def test_a_proxy_that_was_found_first_is_dropped_when_two_others_explain_it():
    model = MeasuredForce(lambda m: 0.0 * m.z_m, seed=11)
    rng = np.random.default_rng(12)
    for m, measured in zip(model.motions, model.measured, strict=True):
        m.source_rate_nps = 25.0 * m.vx_mps + 33.0 * m.vz_mps + 2.0 * rng.normal(size=450)
        measured += 0.5 * m.vx_mps + 0.66 * m.vz_mps
    base = fit(model, (), range(model.episodes))
    names = ("carriage", "speed", "source-rate")
    first = search(model, base, setting=NUMBERS, names=names, most_terms=1)
    assert first.terms == ("source-rate",)
    found = search(model, base, setting=NUMBERS, names=names)
    assert sorted(found.terms) == ["carriage", "speed"]


def test_a_parabola_is_one_parabola_and_not_two_bends():
    _, found = found_in(lambda m: 2.5 * (m.z_m - 0.48) ** 2)
    assert found.terms == ("height-squared",)


def test_a_promise_is_what_a_full_fit_gains():
    model = MeasuredForce(lambda m: 0.1 * m.vz_mps, seed=3)
    base = fit(model, (), range(model.episodes))
    promised = promises(model, base, ["speed", "place", "wave-in-time-2000mhz"])
    for name, nats in zip(["speed", "place", "wave-in-time-2000mhz"], promised, strict=True):
        fitted = fit(model, (name,), range(model.episodes))
        assert fitted.objective - base.objective == pytest.approx(nats, abs=0.05)


def test_the_rig_file_s_force_is_the_one_that_was_fitted():
    model, found = found_in(lambda m: 0.2 * np.sin(9.0 * m.time_s) + 0.9 * (m.z_m - 0.4) ** 2)
    entry = to_effect(found, data_sha256="ab", date="2026-11-21")
    assert to_effect(found.as_artefact).parameters == entry.parameters
    written = default_rig().model_copy(update={"effect": (entry,)}).text
    effect = symbolic_effect(entry)
    values = {name: p.value for name, p in entry.parameters.items()}
    m = model.motions[1]
    fitted = sum(
        TERMS[n].force_n(
            {p.name: found.fit.value(f"{n}.{p.name}") for p in TERMS[n].parameters}, m, SETTING
        )
        for n in found.terms
    )
    np.testing.assert_allclose(effect.force_n(values, m, SETTING), fitted, atol=1e-4)
    assert "symbolic-force" in written
    assert isinstance(default_rig(), Rig)


def unknown(expression, **values):
    sizes = {n: Size(value=v, low=math.nan, high=math.nan, unit="N") for n, v in values.items()}
    return Told(expression=expression, parameters=sizes)


@pytest.mark.parametrize(
    ("result", "told"),
    [
        (unknown("c1*exit[0]", c1=1.0), "is not arithmetic"),
        (unknown("c1*z_m + c2", c1=1.0), "'c2' is not known"),
        (unknown("c1*z_m", c1=None), "cannot be read"),
    ],
)
def test_an_expression_from_an_artefact_is_read_not_run(result, told):
    with pytest.raises(UnusableInput, match=told):
        to_effect(result)


def test_a_second_expression_is_added_to_the_first():
    first = to_effect(unknown("c1*z_m - c2", c1=1.0, c2=0.25))
    both = to_effect(unknown("c1*x_m - c2*vx_mps", c1=3.0, c2=4.0), onto=first)
    assert both.expression == "c1*z_m - c2 + (c3*x_m - c4*vx_mps)"
    assert [p.value for p in both.parameters.values()] == [1.0, 0.25, 3.0, 4.0]
    values = {name: p.value for name, p in both.parameters.items()}
    m = Motion(z_m=0.5, x_m=0.1, vx_mps=0.2)
    assert symbolic_effect(both).force_n(values, m, SETTING) == pytest.approx(-0.25)


def test_the_dictionary_has_terms_of_about_the_same_size_that_are_not_each_other():
    rng = np.random.default_rng(5)
    flights = [vars(motion(rng)) for _ in range(10)]
    m = Motion(**{n: np.concatenate([f[n] + np.zeros(450) for f in flights]) for n in flights[0]})
    columns, names = [], []
    flown_s = 12
    for name in TERMS:
        if name.startswith("stretch-") and int(name[8:-1]) > flown_s:
            continue  # these flights are over by then
        for p in TERMS[name].parameters:
            own = {q.name: p.scale * (q.name == p.name) for q in TERMS[name].parameters}
            columns.append(np.broadcast_to(TERMS[name].force_n(own, m, SETTING), 4500))
            names.append(name)
    sizes = np.array([np.sqrt(np.mean(c**2)) for c in columns])
    assert 50 <= len(TERMS) <= 90
    assert {n: s for n, s in zip(names, sizes, strict=True) if not 0.05 < s < 0.5} == {}
    moving = [c - c.mean() for c, n in zip(columns, names, strict=True) if n != "constant"]
    alike = np.abs(np.corrcoef(moving)) - np.eye(len(moving))
    assert alike.max() < 0.99


def test_waves_may_be_asked_for_by_name():
    assert wave_in_time(1.53) == "wave-in-time-1530mhz"
    assert "wave-in-time-1530mhz" in TERMS
    assert "wave-in-time-1.5hz" not in TERMS
    assert neighbours("wave-in-time-1500mhz")[0] == "wave-in-time-1480mhz"
    assert all(name in TERMS for n in SEARCHED for name in neighbours(n))
    assert neighbours("height") == ()
    with pytest.raises(KeyError):
        TERMS["gravity"]
