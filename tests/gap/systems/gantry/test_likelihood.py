"""The likelihood of flights: calibrated where the rig file is true, and it finds what is not."""

import numpy as np
import pytest
from recorded import RIG, based, flown, with_effects

from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.evidence.starts import scanned_starts
from wakedeploy.gap.systems.gantry.discrepancy import free_terms
from wakedeploy.gap.systems.gantry.flight import DT_S
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.parameters import NOISE
from wakedeploy.gap.systems.gantry.planning.sensors import _carriage_error
from wakedeploy.gap.systems.gantry.search.naming import fitted_base, settled
from wakedeploy.physics.constants import constants_of, spreads_of, with_constants
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.rig.file import parse_rig

SEEDS = (40, 41, 42)


@pytest.fixture(scope="module")
def base() -> tuple[GantryModel, Fit]:
    """Three flights of the rig as its file describes it."""
    return based(*SEEDS)


def test_innovations_have_the_variance_that_is_claimed(base) -> None:
    _, fitted = base
    for score in fitted.slopes.scores:
        white = score.white[:-3]
        assert len(white) > 200
        assert np.mean(white**2) == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / len(white)))
        assert abs(np.mean(white)) < 4 / np.sqrt(len(white))


def test_forecasts_err_by_as_much_as_they_say(base) -> None:
    model, fitted = base
    for episode in range(model.episodes):
        ahead = model.forecasts(fitted, episode, (0.125, 0.25, 0.5))
        assert ahead.measured_m.shape == (3, len(ahead.at_s))
        assert ahead.horizon_s == pytest.approx([0.125, 0.25, 0.5])
        for measured, forecast, variance in zip(
            ahead.measured_m, ahead.forecast_m, ahead.variance_m2, strict=True
        ):
            error = measured - forecast
            known = np.isfinite(error) & (np.abs(error) < 5 * np.sqrt(variance))
            assert 0.8 * len(error) < known.sum() < len(error)  # none beyond the flight's end
            assert np.mean(error[known] ** 2 / variance[known]) == pytest.approx(1.0, abs=0.35)


def test_forecasts_are_for_the_time_that_they_state(base) -> None:
    """Their errors do not follow the speed times the part of a step at which samples were taken."""
    model, fitted = base
    late_m, error_m = [], []
    for episode, flight in enumerate(model.flights):
        ahead = model.forecasts(fitted, episode, (0.25,))
        taken_s = ahead.at_s - fitted.value("range.delay_s")
        into_s = (taken_s - flight.grid_s[0]) % DT_S
        assert ahead.then_s[0] == pytest.approx(taken_s - into_s + 0.25, abs=1e-6)
        late_m.append(into_s * np.interp(taken_s, flight.grid_s, flight.nominal[1]))
        error_m.append((ahead.measured_m - ahead.forecast_m)[0])
    late, error = np.concatenate(late_m), np.concatenate(error_m)
    usual = np.abs(error) < 0.03
    share = float(late[usual] @ error[usual] / (late[usual] @ late[usual]))
    assert share == pytest.approx(0.0, abs=0.25)


def test_differences_stay_within_what_flights_know_of_a_constant(base) -> None:
    """Further away samples become outliers, and a derivative is no longer one.

    Delays have long steps on purpose: servo frames make the likelihood jagged in time.
    """
    _, fitted = base
    known_sd = np.diag(fitted.slopes.fisher().sum(0)) ** -0.5  # the others held
    for free, sd in zip(fitted.free, known_sd, strict=True):
        if free.quantity and not free.name.startswith(("command.", "range.delay")):
            assert free.step < 2.0 * sd, free.name


def test_noise_and_calibration_are_found_within_their_intervals(base) -> None:
    _, fitted = base
    flight = flown(SEEDS[0])
    deviation = np.exp(fitted.value(NOISE[3])) + fitted.value(NOISE[4]) * flight.reading_m.mean()
    assert deviation == pytest.approx(RIG.range_sensor.noise_m, rel=0.15)
    low, high = fitted.interval(NOISE[1], 0.99)
    assert low < np.log(RIG.disturbance.turbulence_fraction) < high
    known = constants_of(RIG)
    for name in spreads_of(RIG):
        low, high = fitted.interval(name, 0.99)
        # What takes on a bound, or is later only by the plant's own step, may miss it by a little.
        margin = 0.004 if name.endswith("delay_s") else 0.0
        assert low - margin <= known[name] <= high + margin, name


def test_truth_is_more_likely_than_what_is_not(base) -> None:
    model, fitted = base
    for name, away in (("thrust.sufferer.scale", 0.03), ("wake.speed_mps", 1.0)):
        for sign in (-1.0, 1.0):
            theta = fitted.theta.copy()
            theta[fitted.names.index(name)] += sign * away
            density = sum(model.score((), theta, e).log_density.sum() for e in range(3))
            assert density < fitted.log_likelihood - 5.0


@pytest.mark.slow
def test_miscalibrated_constants_are_found(base) -> None:
    off = {"thrust.sufferer.scale": 1.04, "wake.strength": 420.0}
    truth = with_constants(RIG, off)
    model = GantryModel(RIG, [flown(seed, truth) for seed in SEEDS])
    fitted = fit(model, (), range(3), model.start(()))
    low, high = fitted.interval("thrust.sufferer.scale", 0.99)
    assert low < 1.04 < high
    assert fitted.value("thrust.sufferer.scale") == pytest.approx(1.04, abs=0.01)
    low, high = fitted.interval("wake.strength", 0.99)
    assert low < 420.0 < high


@pytest.mark.slow
def test_the_play_of_a_belt_is_found() -> None:
    """Its size, and in it the carriage's errors, which an encoder would read."""
    truth = with_effects(belt_backlash={"backlash_m": (0.05, "m")})
    near, base = fitted_base(GantryModel(RIG, [flown(seed, truth) for seed in SEEDS]))
    (candidate,) = rank(near, base, ("belt-backlash",))
    _, found = settled(near, candidate.fit)
    low, high = found.interval("belt-backlash.backlash_m", 0.99)
    assert low < 0.05 < high
    size_m = found.value("belt-backlash.backlash_m")
    assert size_m == pytest.approx(0.05, abs=0.01)
    flight, behind_m = near.flights[0], [0.0]
    for way_m in np.diff(flight.x_m):
        behind_m.append(float(np.clip(behind_m[-1] + way_m, -0.5 * size_m, 0.5 * size_m)))
    assert _carriage_error(near, found, flight) == pytest.approx(behind_m, abs=1e-9)


def test_the_smoothed_motion_is_nearer_to_the_truth_than_the_first_look(base) -> None:
    """Against the one thing that both have seen and neither was told: the readings' own noise."""
    model, _ = base
    for flight, first in zip(model.flights, (flown(s) for s in SEEDS), strict=True):
        for a, b in zip(flight.start, flight.stop, strict=True):
            inner = slice(a + 20, b - 20)
            jerk = [np.diff(f.nominal[1, inner], 2).std() / DT_S**2 for f in (flight, first)]
            assert np.abs(flight.nominal[0, inner] - first.nominal[0, inner]).max() < 0.02
            assert np.isfinite(jerk).all()
        outside = np.ones(len(flight.grid_s), bool)
        for a, b in zip(flight.start, flight.stop, strict=True):
            outside[a:b] = False
        assert (flight.nominal[:, outside] == first.nominal[:, outside]).all()


def test_scoring_twice_gives_the_same_bytes(base) -> None:
    model, fitted = base
    fresh = GantryModel(RIG, model.flights)
    model.score(("ground-effect",), np.append(fitted.theta, [0.1, 0.1]), 1)  # another in between
    one, other = (m.score((), fitted.theta, 1) for m in (model, fresh))
    for field in ("log_density", "innovation", "variance", "weight"):
        assert getattr(one, field).tobytes() == getattr(other, field).tobytes()


def test_some_flights_make_a_model_of_their_own(base) -> None:
    model, fitted = base
    alone = model.only([2])
    assert alone.episodes == 1
    one, other = model.score((), fitted.theta, 2), alone.score((), fitted.theta, 0)
    assert one.log_density.tobytes() == other.log_density.tobytes()


def test_every_hypothesis_has_noise_calibration_and_form_free() -> None:
    model = GantryModel(RIG, [flown(SEEDS[0])])
    names = [f.name for f in model.free(())]
    assert names == [*NOISE, *spreads_of(RIG), *(f.name for f in free_terms(RIG))]
    for effect in LIBRARY.values():
        free = model.free((effect.name,))
        own = {f"{effect.name}.{p.name}" for p in effect.parameters}
        moved = {p.constant for p in effect.parameters}
        found = [f.name for f in free]
        assert len(set(found)) == len(found)
        assert (set(names) - moved) | own <= set(found) <= set(names) | own
        for f in free:
            assert f.low <= f.neutral <= f.high, f.name
            assert all(f.low <= s <= f.high for s in f.starts if f.name in own), f.name


@pytest.mark.whole
def test_the_rigs_own_effects_are_free_within_their_intervals() -> None:
    truth = with_effects(ground_effect={"gain": (0.3, "1"), "height_m": (0.15, "m")})
    entry = truth.effect[0]
    stated = entry.parameters["gain"].model_copy(update={"low": 0.2, "high": 0.4})
    parameters = {**entry.parameters, "gain": stated}
    rig = parse_rig(
        RIG.model_copy(
            update={"effect": (entry.model_copy(update={"parameters": parameters}),)}
        ).text
    )
    model = GantryModel(rig, [flown(SEEDS[0], truth)])
    free = {f.name: f for f in model.free(())}
    assert free["ground-effect.gain"].neutral == 0.3
    assert free["ground-effect.gain"].prior_sd == pytest.approx(0.1 / 1.645, rel=1e-3)
    with_effect = fit(model, (), (0,), model.start(()))
    without = GantryModel(RIG, model.flights)
    assert with_effect.objective > fit(without, (), (0,), without.start(())).objective + 3.0


@pytest.mark.slow
def test_held_readings_are_less_likely_without_the_hold() -> None:
    truth = with_effects(sample_and_hold={"hold_s": (0.06, "s")})
    model = GantryModel(RIG, [flown(SEEDS[0], truth), flown(SEEDS[2], truth)])
    base = fit(model, (), (0, 1), model.start(()))
    (begun_s,) = model.free(("sample-and-hold",))[-1].starts  # told from the repeats
    start = np.append(base.theta, begun_s)
    held = fit(model, ("sample-and-hold",), (0, 1), start)
    assert held.log_likelihood > base.log_likelihood + 50.0
    low, high = held.interval("sample-and-hold.hold_s")
    assert low < 0.06 < high < low + 0.002
    assert all((score.variance > 1e-9).all() for score in held.slopes.scores)


def test_a_hold_is_looked_for_as_closely_as_its_summits_are_narrow() -> None:
    """Its likelihood may stand fifty nats higher within a tenth of a millisecond."""
    free = GantryModel(RIG, [flown(SEEDS[0])]).free(("sample-and-hold",))[-1]
    for begun_s in free.starts:
        near = sorted(size for size in free.scanned if abs(size - begun_s) <= 0.0015)
        assert max(np.diff(near)) < 1e-4
    assert min(free.scanned) == pytest.approx(0.5 * min(free.starts))
    assert max(free.scanned) == pytest.approx(2.0 * max(free.starts))


def test_a_hold_that_the_rig_file_has_is_not_looked_for_again() -> None:
    held = {"sample_and_hold": {"hold_s": (0.06, "s")}}
    rig = with_effects(**held)
    model = GantryModel(rig, [flown(SEEDS[0], rig)])
    found = fit(model, ("viscous-friction",), (0,), model.start(("viscous-friction",)))
    assert found.value("sample-and-hold.hold_s") == pytest.approx(0.06, abs=0.001)
    assert scanned_starts(model, found) == []
    assert found.standard_error("sample-and-hold.hold_s") > 0.0


def test_an_unknown_effect_is_a_key_error() -> None:
    with pytest.raises(KeyError):
        GantryModel(RIG, [flown(SEEDS[0])]).free(("phlogiston",))


@pytest.mark.slow
def test_a_jagged_likelihood_is_looked_at_everywhere_before_a_climb() -> None:
    truth = with_effects(pwm_quantisation={"step_us": (25.3, "us")})
    model = GantryModel(RIG, [flown(seed, truth, seconds=12.0) for seed in SEEDS[:2]])
    base = fit(model, (), range(2), model.start(()))
    (found,) = rank(model, base, ("pwm-quantisation",))
    assert found.gain_nats > 8.0
    assert found.fit.value("pwm-quantisation.step_us") == pytest.approx(25.3, abs=0.05)


@pytest.mark.slow
def test_summits_of_a_dead_band_are_compared_around_their_own_motions() -> None:
    truth = with_effects(pwm_dead_band={"band_us": (9.0, "us")})
    model = GantryModel(RIG, [flown(seed, truth) for seed in SEEDS])
    near, base = fitted_base(model)
    (candidate,) = rank(near, base, ("pwm-dead-band",))
    _, found = settled(near, candidate.fit)
    assert (
        found.objective
        >= fit(
            near.around_own_motion(candidate.fit), found.hypothesis, range(3), candidate.fit.theta
        ).objective
    )
    low, high = found.interval("pwm-dead-band.band_us")
    assert low < 9.0 < high
    assert high - low > 0.05 * 9.0  # summits stand so close that no smaller one can be told


@pytest.mark.whole
def test_a_force_of_time_acts_at_the_same_moment_in_plant_and_likelihood() -> None:
    """At 4 Hz a tenth of a second, from the first tick to half the weight, is 144 degrees."""

    def rig_with(early_s: float):
        values = {"a": (0.4, "N"), "b": (early_s, "s")}
        entry = Effect(
            name="symbolic-force",
            expression="a*sin(25.13*(time_s + b))",
            parameters={n: EffectParameter(value=v, unit=u) for n, (v, u) in values.items()},
        )
        return RIG.model_copy(update={"effect": (entry,)})

    flights = [flown(seed, rig_with(0.0)) for seed in SEEDS]

    def likely(early_s: float) -> float:
        model = GantryModel(rig_with(early_s), flights)
        theta = model.start(())
        return sum(model.score((), theta, e).log_density.sum() for e in range(len(flights)))

    shifts_s = np.arange(-0.12, 0.121, 0.02)
    found = np.array([likely(shift_s) for shift_s in shifts_s])
    bend = np.polyfit(shifts_s[4:9], found[4:9], 2)
    assert abs(shifts_s[np.argmax(found)]) < 0.03
    assert -0.5 * bend[1] / bend[0] == pytest.approx(0.0, abs=0.01)
