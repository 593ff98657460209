"""A flight's own deviations, integrated out, against the Gaussian that they make."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import Score
from wakedeploy.gap.systems.gantry.discrepancy import form_hooks, free_terms
from wakedeploy.gap.systems.gantry.varying import (
    freed,
    of_one_flight,
    own_amounts,
    varying,
)
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects.chain import Chain
from wakedeploy.rig.file import default_rig, parse_rig

RNG = np.random.default_rng(4)
VARIANCE = RNG.uniform(0.5, 2.0, 40)
DIRECTIONS = RNG.standard_normal((40, 3))


def scored(innovation) -> Score:
    density = -0.5 * (innovation**2 / VARIANCE + np.log(2.0 * np.pi * VARIANCE))
    return Score(density, innovation, VARIANCE, np.ones(40), (slice(40),))


@pytest.mark.parametrize("stand", [np.zeros(3), np.array([0.5, -1.0, 2.0])])
def test_the_density_is_that_of_the_sum_of_noise_and_deviations(stand) -> None:
    innovation = RNG.standard_normal(40) + DIRECTIONS @ RNG.standard_normal(3)
    there = scored(innovation + DIRECTIONS @ stand)
    exact = multivariate_normal(cov=np.diag(VARIANCE) + DIRECTIONS @ DIRECTIONS.T)
    told = freed(there, DIRECTIONS, stand)
    assert told.log_density.sum() == pytest.approx(exact.logpdf(innovation))
    assert told.channels == there.channels
    assert len(told.white) == 43


def test_the_deviations_are_those_of_least_squares_with_the_prior() -> None:
    true = np.array([1.0, -0.5, 0.3])
    amounts, precision = own_amounts(scored(-DIRECTIONS @ true), DIRECTIONS, np.zeros(3))
    root = np.vstack([DIRECTIONS / np.sqrt(VARIANCE)[:, None], np.eye(3)])
    wanted = np.concatenate([DIRECTIONS @ true / np.sqrt(VARIANCE), np.zeros(3)])
    assert amounts == pytest.approx(np.linalg.lstsq(root, wanted, rcond=None)[0])
    assert precision == pytest.approx(root.T @ root)


def test_what_varies_is_what_the_rig_file_states() -> None:
    rig = default_rig().changed(repeatability={"thrust": 0.01, "bias_m": 0.002})
    assert parse_rig(rig.text) == rig
    assert [one.name for one in varying(rig)] == ["thrust.sufferer.scale", "range.bias_m"]
    assert varying(default_rig()) == ()
    constants, effects = varying(rig)[0].moved(constants_of(rig), Chain({}), 0.02)
    assert constants["thrust.sufferer.scale"] == pytest.approx(1.02)
    assert effects.parts == ()


def test_a_simulated_flight_has_its_own_thrust_bias_and_battery() -> None:
    stated = {"thrust": 0.01, "sag_per_s": 0.001, "bias_m": 0.002}
    rig = default_rig().changed(repeatability=stated)
    flights = [of_one_flight(rig, rig, np.random.default_rng(i)) for i in range(40)]
    thrust = [f.thrust.sufferer.thrust_n[-1] / rig.thrust.sufferer.thrust_n[-1] for f in flights]
    hidden = [{e.name: e.parameters for e in flight.effect} for flight in flights]
    bias_m = [own["range-bias"]["bias_m"].value for own in hidden]
    sag = [own["battery-sag"]["sag_per_s"].value for own in hidden]
    assert np.std(thrust) == pytest.approx(0.01, rel=0.35)
    assert np.std(bias_m) == pytest.approx(0.002, rel=0.35)
    assert min(sag) == 0.0 < max(sag)
    assert of_one_flight(default_rig(), default_rig(), np.random.default_rng(0)) == default_rig()


def test_a_flights_battery_acts_where_the_library_has_it() -> None:
    rig = default_rig().changed(repeatability={"sag_per_s": 0.001})
    others = {"range-drift": {"drift_mps": 0.001}, "command-latency": {"latency_s": 0.01}}
    for known in (others, others | {"battery-sag": {"sag_per_s": 0.002}}):
        _, effects = varying(rig)[0].moved(constants_of(rig), Chain(known), 0.001)
        sag = known.get("battery-sag", {"sag_per_s": 0.0})["sag_per_s"] + 0.001
        wanted = Chain(others | {"battery-sag": {"sag_per_s": sag}})
        assert [(e.name, dict(v)) for e, v in effects.parts] == [
            (e.name, dict(v)) for e, v in wanted.parts
        ]


def test_a_fitted_form_is_where_the_correction_begins() -> None:
    rig = default_rig().changed(discrepancy={"fitted": {"wake.even1": [0.02, 0.004]}})
    assert parse_rig(rig.text) == rig
    known = {f.name: f for f in free_terms(rig)}["discrepancy.wake.even1"]
    assert (known.neutral, known.prior_sd) == (0.02, 0.004)
    assert form_hooks(default_rig()) == {}
    wake = form_hooks(rig)["wake_hook"](0.0, 4.4, 0.0, 0.5)
    assert wake[0] == 0.0


def test_a_form_that_no_model_has_is_refused() -> None:
    with pytest.raises(UnusableInput, match="discrepancy"):
        default_rig().changed(discrepancy={"fitted": {"wake.even9": [0.02, 0.004]}})
