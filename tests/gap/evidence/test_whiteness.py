"""The portmanteau test and the spectrum on noise that is white, and on noise that is not."""

import json

import numpy as np
import pytest
from scipy.stats import chi2

from wakedeploy.gap.evidence.fits import Fit, Score, Slopes
from wakedeploy.gap.evidence.whiteness import LAGS, REFERENCE_SAMPLES, samples, spectrum, whiteness
from wakedeploy.gap.search.artefacts import White


def fit_that_leaves(series, variance: float = 4.0) -> Fit:
    """A fit with these whitened innovations, one array per flight, and wild pseudo-samples."""
    scores = []
    for white in series:
        e = np.append(np.sqrt(variance) * white, [50.0, -50.0, 50.0])
        v = np.full(len(e), variance)
        density = -0.5 * (e**2 / v + np.log(2.0 * np.pi * v))
        scores.append(Score(density, e, v, np.ones(len(e)), (slice(0, len(white)),)))
    theta, count = np.zeros(0), len(scores)
    return Fit((), (), tuple(range(count)), theta, Slopes(tuple(scores), (), ()), np.zeros(count))


def white_noise(seed: int, flights: int = 3, count: int = 350) -> list[np.ndarray]:
    return list(np.random.default_rng([9, seed]).standard_normal((flights, count)))


def coloured(seed: int, keep: float) -> list[np.ndarray]:
    """First-order autoregressive noise of unit variance."""
    series = white_noise(seed)
    for w in series:
        for i in range(1, len(w)):
            w[i] = keep * w[i - 1] + np.sqrt(1.0 - keep**2) * w[i]
    return series


def test_the_statistic_of_white_noise_is_chi_squared() -> None:
    found = [whiteness(fit_that_leaves(white_noise(seed))) for seed in range(300)]
    statistic = np.array([w.statistic for w in found])
    assert statistic.mean() == pytest.approx(LAGS, rel=0.1)
    assert statistic.var() == pytest.approx(2 * LAGS, rel=0.3)
    rejected = np.mean([w.p_value < 0.05 for w in found])
    assert 0.01 < rejected < 0.09
    assert found[0].p_value == pytest.approx(chi2.sf(found[0].statistic, LAGS))


@pytest.mark.parametrize("keep", [-0.25, 0.25, 0.5])
def test_coloured_noise_is_rejected(keep: float) -> None:
    for seed in range(10):
        found = whiteness(fit_that_leaves(coloured(seed, keep)))
        assert found.p_value < 1e-3
        assert found.autocorrelation[0] == pytest.approx(keep, abs=0.12)
        assert found.autocorrelation[1] == pytest.approx(keep**2, abs=0.15)


@pytest.mark.parametrize("keep", [0.0, 0.3, -0.5, 0.8])
def test_the_past_foretells_the_share_that_a_first_order_process_keeps(keep: float) -> None:
    """Of x' = φ x + √(1 − φ²) e the next value's variance is φ² by the last one's."""
    series = [w for seed in range(4) for w in coloured(seed, keep)]
    (share,) = White(**whiteness(fit_that_leaves(series)).as_json()).foretold()
    assert share == pytest.approx(keep**2, abs=0.03)


def test_of_an_output_that_is_seldom_read_white_noise_foretells_nothing() -> None:
    """Its few readings correlate by chance, by as much as so few do."""
    rng = np.random.default_rng(5)
    rows = [rng.standard_normal(LAGS) / n**0.5 for n in (4000, 60) * 20]
    found = np.array([
        White(p_value=0.0, statistic=0.0, limit=0.0, passes=False, lags=[], autocorrelation=[],
              by_channel=[list(often), list(seldom)], counts=[4000, 60], samples=60).foretold()
        for often, seldom in zip(rows[::2], rows[1::2], strict=True)
    ])  # fmt: skip
    assert found.mean(0) == pytest.approx([0.0, 0.0], abs=0.06)
    assert found[:, 0].max() < 0.01


def test_correlations_do_not_reach_from_one_flight_into_the_next() -> None:
    """By hand, over the pairs within each flight."""
    series = white_noise(4, flights=2, count=60)
    found = whiteness(fit_that_leaves(series))
    for lag in (1, 7, LAGS):
        pairs = sum((w[lag:] * w[:-lag]).sum() for w in series)
        expected = pairs / sum((w**2).sum() for w in series)
        assert found.autocorrelation[lag - 1] == pytest.approx(expected)


def test_pseudo_samples_and_outliers_say_nothing() -> None:
    series = white_noise(1)
    clean = whiteness(fit_that_leaves(series)).statistic
    fitted = fit_that_leaves(series)
    score = fitted.slopes.scores[0]
    assert samples(score)[0] == pytest.approx(series[0])
    score.innovation[100:103] += 1000.0
    score.weight[100:103] = 0.0
    assert whiteness(fitted).statistic == pytest.approx(clean, abs=3.0)


def test_the_artefact_says_what_was_tested() -> None:
    found = whiteness(fit_that_leaves(white_noise(0)))
    told = json.loads(json.dumps(found.as_json(60.0)))
    assert told["limit"] == found.limit(60.0)
    assert told["passes"] is (found.statistic <= told["limit"])
    assert told["lags"] == list(range(1, LAGS + 1))
    assert len(told["autocorrelation"]) == LAGS


def test_the_limit_grows_with_the_samples_as_a_little_colour_does() -> None:
    """Pure noise keeps its statistic at any length, an AR(1) process has it in proportion."""
    rng = np.random.default_rng(3)
    for count in (REFERENCE_SAMPLES // 4, 4 * REFERENCE_SAMPLES):
        noise = rng.standard_normal(count)
        coloured = np.array(noise)
        for k in range(1, count):
            coloured[k] += 0.1 * coloured[k - 1]
        white = whiteness(fit_that_leaves([noise]))
        assert white.samples == count
        assert white.passes(40.0)
        grown = whiteness(fit_that_leaves([coloured]))
        # ρ_k = 0.1^k: the reference's statistic is expected at 16 + n·Σρ².
        expected = LAGS + REFERENCE_SAMPLES * 0.0101
        assert grown.at_reference == pytest.approx(expected, rel=0.6)
        assert grown.passes(2.0 * expected)
        assert grown.passes(0.6 * expected) is (count < REFERENCE_SAMPLES)


def test_the_spectrum_of_white_noise_is_flat_within_its_band() -> None:
    inside, densities = [], []
    for seed in range(20):
        found = spectrum(white_noise(seed), 32.0)
        density = np.array(found["density"])
        inside.append(np.mean((density > found["low"]) & (density < found["high"])))
        densities.append(density)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
    assert np.mean(densities, axis=0) == pytest.approx(np.ones(len(density)), abs=0.3)
    assert found["low"] < 1.0 < found["high"]


def test_a_vibration_stands_out_where_it_is() -> None:
    t_s = np.arange(350) / 32.0
    series = [w + np.sin(2 * np.pi * 5.1 * t_s) for w in white_noise(2)]
    found = spectrum(series, 32.0)
    peak = int(np.argmax(found["density"]))
    width = found["frequency_hz"][1] - found["frequency_hz"][0]
    assert found["frequency_hz"][peak] == pytest.approx(5.1, abs=width)
    assert found["density"][peak] > 2 * found["high"]
