"""Forces along a logged flight against what the plant truly did, without turbulence or noise."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded import QUIET, SECONDS, Probe, probed, with_effects

from wakedeploy.domains.gantry import record
from wakedeploy.gap.systems.gantry.flight import DT_S, flight_from_log
from wakedeploy.gap.systems.gantry.forces import Physics
from wakedeploy.gap.systems.gantry.repeated_readings import likely_periods_s
from wakedeploy.physics.constants import constants_of, with_constants
from wakedeploy.physics.effects import LIBRARY, Effect, Parameter
from wakedeploy.physics.effects.chain import Chain

CONSTANTS = constants_of(QUIET) | {"command.window_s": 0.0}
NONE = Chain({})


@pytest.fixture(scope="module")
def flown():
    """Flight, forces, a function of true columns at the steps' middles, and which steps count."""
    log, probe = probed()
    flight = flight_from_log(log.without_truth(), QUIET, "quiet")
    middle_s = flight.grid_s + 0.5 * DT_S
    # The true motion takes the place of the smoothed one, so that only the forces are compared.
    truth = np.stack([np.interp(middle_s, probe["t_s"], probe[n]) for n in ("z_m", "vz_mps")])
    flight = dataclasses.replace(flight, nominal=truth)
    at = np.concatenate([np.arange(a, b) for a, b in zip(flight.start, flight.stop, strict=True)])
    return flight, Physics(QUIET, flight), log, probe, at


def active(name: str, **values: float):
    """One effect of the library at work."""
    return Chain({name: values})


def of_my_own(name: str, stage: str, **methods):
    """An effect of a stranger, who knows arrays (N,) along a flight and nothing else."""
    share = Parameter("share", "1", scale=0.1, low=-1.0, high=1.0)
    attributes = {"name": name, "physics": "p", "equation": "e", "stage": stage}
    shape = type("MyOwn", (Effect,), attributes | {"parameters": (share,)} | methods)()
    return Chain({name: {"share": 0.2}}, [shape])


def masked(self, p, m, s):
    """A force below half a metre, written into an array of its own."""
    force_n, low = np.zeros_like(m.x_m), m.z_m < 0.5
    force_n[low] = p["share"] * m.sufferer_n[low]
    return force_n


def test_an_effect_may_ask_for_one_motion_at_a_time(flown) -> None:
    """By its height against others of the flight, by places in arrays, or without the air."""
    _, physics, *_ = flown
    plain = of_my_own(
        "plain", "force", force_n=lambda _, p, m, s: p["share"] * m.sufferer_n * (m.z_m < 0.5)
    )
    expected = physics.forces(CONSTANTS, plain).acceleration
    found = physics.forces(CONSTANTS, of_my_own("masked", "force", force_n=masked)).acceleration
    assert np.ptp(expected[0] - physics.forces(CONSTANTS, NONE).acceleration[0]) > 0.5
    assert found == pytest.approx(expected, rel=1e-12)
    air = of_my_own("air", "wake", wake_mps=lambda _, p, m, s: -p["share"] * m.source_n)
    blown = physics.forces(CONSTANTS, air)
    inside = physics._flown
    assert blown.wake_mps[inside] == pytest.approx(-0.2 * blown.source_n[inside], rel=1e-12)
    mean = of_my_own(
        "mean", "force", force_n=lambda _, p, m, s: p["share"] * (m.z_m - np.mean(m.z_m))
    )
    z_m = physics._flight.nominal[0, inside]
    gained = (
        physics.forces(CONSTANTS, mean).acceleration - physics.forces(CONSTANTS, NONE).acceleration
    )
    far = np.abs(physics._flight.nominal[1, inside]) > 0.1  # where friction holds nothing
    expected = 0.2 * (z_m - z_m.mean()) / QUIET.sufferer.mass_kg
    assert gained[0, inside][far] == pytest.approx(expected[far], abs=1e-9)


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("motor", ["source", "sufferer"])
def test_thrusts_are_the_plants(flown, motor: str) -> None:
    flight, physics, _, probe, at = flown
    found = getattr(physics.forces(CONSTANTS, NONE), f"{motor}_n")
    true_n = np.interp(flight.grid_s + 0.5 * DT_S, probe["t_s"], probe[f"{motor}_thrust_n"])
    assert np.ptp(true_n[at]) > 1.0
    assert rms((found - true_n)[at]) < 0.02 * true_n[at].mean()
    assert abs((found - true_n)[at].mean()) < 0.003 * true_n[at].mean()


def test_the_wakes_force_is_the_plants(flown) -> None:
    flight, physics, log, _, at = flown
    found = physics.forces(CONSTANTS, NONE)
    inside = (log["t_s"] > flight.grid_s[at[0]]) & (log["t_s"] < flight.grid_s[at[-1]])
    true_n = log["true_wake_force_n"][inside]
    modelled_n = np.interp(log["t_s"][inside], flight.grid_s + 0.5 * DT_S, found.wake_n)
    assert np.abs(true_n).max() > 0.5
    assert rms(modelled_n - true_n) < 0.03 * rms(true_n)
    assert modelled_n.mean() == pytest.approx(true_n.mean(), rel=0.01)


@pytest.mark.whole
def test_the_wakes_force_under_a_belt_with_play_is_the_plants() -> None:
    entry = with_effects(belt_backlash={"backlash_m": (0.06, "m")}).effect
    probe = Probe()
    log = record(QUIET.model_copy(update={"effect": entry}), seconds=SECONDS, seed=31,
                 force_hook=probe)  # fmt: skip
    flight = flight_from_log(log.without_truth(), QUIET, "play")
    middle_s = flight.grid_s + 0.5 * DT_S
    truth = np.stack([np.interp(middle_s, probe["t_s"], probe[n]) for n in ("z_m", "vz_mps")])
    physics = Physics(QUIET, dataclasses.replace(flight, nominal=truth))
    inside = (log["t_s"] > flight.grid_s[flight.start[0]]) & (
        log["t_s"] < flight.grid_s[flight.stop[-1] - 1]
    )
    true_n = log["true_wake_force_n"][inside]

    def error(effects) -> float:
        wake_n = physics.forces(CONSTANTS, effects).wake_n
        return rms(np.interp(log["t_s"][inside], middle_s, wake_n) - true_n) / rms(true_n)

    assert error(NONE) > 0.1
    assert error(active("belt-backlash", backlash_m=0.06)) < 0.01


def test_accelerations_sum_up_to_the_speed_that_was_gained(flown) -> None:
    flight, physics, _, _, at = flown
    summed = np.cumsum(physics.forces(CONSTANTS, NONE).acceleration[0]) * DT_S
    window = round(0.5 / DT_S)
    first, last = at[: -window : window // 2], at[window :: window // 2]
    count = min(len(first), len(last))
    first, last = first[:count], last[:count]
    gained = flight.nominal[1, last] - flight.nominal[1, first]
    modelled = summed[last] - summed[first]
    assert rms(gained) > 0.05
    # Friction is smooth in the model, and 0.05 N of it would be 0.11 m/s².
    assert rms(gained - modelled) / 0.5 < 0.05


@pytest.mark.parametrize(
    ("effect", "moved_m", "moved_mps"),
    [((), 0.01, 0.0), ((), 0.0, 0.05), (("ground-effect",), 0.01, 0.0)],
)
def test_slopes_are_those_of_a_moved_flight(
    flown, effect, moved_m: float, moved_mps: float
) -> None:
    flight, physics, _, _, at = flown
    effects = active("ground-effect", gain=0.2, height_m=0.2) if effect else NONE
    here = physics.forces(CONSTANTS, effects).acceleration
    moved = flight.nominal + np.array([[moved_m], [moved_mps]])
    there = Physics(QUIET, dataclasses.replace(flight, nominal=moved)).forces(CONSTANTS, effects)
    # Where it moves: near standstill friction is curved.
    fast = at[np.abs(flight.nominal[1, at]) > 0.15]
    expected = here[1] * moved_m + here[2] * moved_mps
    change = there.acceleration[0] - here[0]
    assert len(fast) > 100
    assert rms((change - expected)[fast]) < 0.1 * rms(change[fast])


def test_a_moved_constant_is_the_rig_that_has_it(flown) -> None:
    """Constants moved by a fit give the same forces as a rig file with those constants."""
    flight, physics, *_ = flown
    moved = CONSTANTS | {
        "thrust.sufferer.scale": 1.04,
        "thrust.source.exponent": 1.1,
        "spool.source.up_s": 0.09,
        "wake.speed_mps": 5.0,
        "wake.width_m": 0.11,
        "rail.coulomb_n": 0.08,
    }
    rig = with_constants(QUIET, moved)
    same = Physics(rig, flight).forces(constants_of(rig) | {"command.window_s": 0.0}, NONE)
    found = physics.forces(moved, NONE)
    assert found.acceleration == pytest.approx(same.acceleration, abs=1e-6)
    assert found.source_n == pytest.approx(same.source_n, abs=1e-9)


def test_a_wake_that_hardly_sinks_is_no_longer_than_the_flight(flown) -> None:
    """A way that a fit tries may end there; the puffs would be in reach for hours, and were kept.

    What has sunk a micrometre in the flight lies as what does not sink.
    """
    physics = flown[1]
    tracemalloc.start()
    hardly, never = (
        physics.forces(CONSTANTS | {"wake.speed_mps": speed_mps}, NONE)
        for speed_mps in (1e-8, 1e-12)
    )
    most_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert hardly.wake_n == pytest.approx(never.wake_n, abs=1e-6)
    assert most_bytes < 1e8


def test_what_was_kept_is_what_would_be_computed_again(flown) -> None:
    """A fit moves one parameter at a time, and stages that it does not touch are remembered."""
    flight, physics, *_ = flown
    rng = np.random.default_rng(0)
    names = ["wake.speed_mps", "spool.source.up_s", "thrust.sufferer.scale", "command.delay_s"]
    effects = [NONE, active("tether-spring", stiffness_n_per_m=1.0, slack_m=0.4)]
    for _ in range(8):
        constants = dict(CONSTANTS)
        name = names[rng.integers(len(names))]
        constants[name] += 0.01 * rng.integers(0, 3)
        chosen = effects[rng.integers(2)]
        kept = physics.forces(constants, chosen)
        fresh = Physics(QUIET, flight).forces(constants, chosen)
        for field in ("source_n", "sufferer_n", "wake_n", "acceleration", "expected"):
            assert getattr(kept, field).tobytes() == getattr(fresh, field).tobytes()


@pytest.mark.parametrize("name", LIBRARY)
def test_a_neutral_effect_changes_nothing(flown, name: str) -> None:
    _, physics, *_ = flown
    values = {
        p.name: CONSTANTS[p.constant] if p.constant is not None else p.neutral
        for p in LIBRARY[name].parameters
    }
    with_it, without = (physics.forces(CONSTANTS, e) for e in (active(name, **values), NONE))
    for field in ("acceleration", "expected", "wake_n", "taken_s"):
        assert getattr(with_it, field) == pytest.approx(getattr(without, field), abs=1e-9)


def test_latency_is_a_later_thrust(flown) -> None:
    _, physics, _, _, at = flown
    shift = 5
    now = physics.forces(CONSTANTS, NONE).sufferer_n
    late = physics.forces(CONSTANTS | {"command.delay_s": shift * DT_S}, NONE).sufferer_n
    # The frames stay where they are, so single pulses may come up to a frame apart.
    assert rms(late[at] - now[at - shift]) < 0.4 * rms(late[at] - now[at])


def test_the_expected_reading_is_the_height_as_the_sensor_sees_it(flown) -> None:
    flight, physics, *_ = flown
    constants = CONSTANTS | {"range.bias_m": 0.01, "range.scale": 1.02, "range.delay_s": 0.02}
    found = physics.forces(constants, NONE)
    assert found.taken_s == pytest.approx(flight.sample_s - 0.02)
    z_m = np.interp(flight.sample_s - 0.02, flight.grid_s, flight.nominal[0])
    assert found.expected[0] == pytest.approx(0.01 + 1.02 * z_m)
    assert found.expected[1] == pytest.approx(np.full(len(z_m), 1.02))
    rested = dataclasses.replace(
        flight, rest=np.array([[0.0, 1e-6, 1.0, 0.0], [0.0, 1e-6, 14.0, 0.0]])
    )
    assert Physics(QUIET, rested).at_rest(constants, NONE) == pytest.approx([0.01, 0.01])


def test_a_held_reading_is_as_old_as_its_repeats_say(flown) -> None:
    flight, physics, *_ = flown
    period_s, hold_s = 0.03, 0.08
    sample_s = period_s * np.arange(400.0)
    made = np.floor((sample_s + 0.013) / hold_s)
    truth_s = sample_s + 0.013 - hold_s * made
    reading_m = np.random.default_rng(3).normal(0.5, 0.2, 200)[made.astype(int)]
    held = dataclasses.replace(flight, sample_s=sample_s, reading_m=reading_m)
    found = Physics(QUIET, held).forces({**CONSTANTS, "range.hold_s": hold_s}, NONE)
    told_s = sample_s - found.taken_s
    inner = slice(10, -10)
    assert np.abs(told_s - truth_s)[inner].max() < 0.008
    assert np.sqrt(found.held.age_variance_s2[inner]).max() < 0.012
    repeats = np.append(False, np.diff(made) == 0)
    assert (found.held.probability[repeats][10:] > 0.5).mean() > 0.9
    assert (found.held.probability[~repeats][10:] < 0.5).mean() > 0.9
    assert not physics.forces(CONSTANTS, NONE).held.age_s.any()


def repeats_of(hold_s: float, flights: int, seed: int):
    """Time stamps and repeats of flights under a clock of this period; one in twenty by chance."""
    rng = np.random.default_rng(seed)
    for _ in range(flights):
        sample_s = np.cumsum(rng.choice([0.02, 0.04], 500)) + rng.normal(0.0, 2e-4, 500)
        made = np.floor(sample_s / hold_s + rng.uniform())
        yield sample_s, np.append(False, np.diff(made) == 0) | (rng.random(500) < 0.05)


@pytest.mark.whole
@settings(max_examples=3, deadline=None)
@given(hold_s=st.floats(0.025, 0.1), seed=st.integers(0, 2**31))
def test_the_period_of_repeats_is_among_the_likely_ones(hold_s, seed) -> None:
    found_s = likely_periods_s(list(repeats_of(hold_s, 3, seed)), 0.05)
    assert len(found_s) <= 2
    assert np.abs(np.array(found_s) - hold_s).min() < 0.001


@pytest.mark.whole
def test_a_clock_and_its_mirror_image_are_both_likely() -> None:
    """Samples on a lattice of 20 ms alias 1 / 0.039 Hz to 50 Hz less that, 41 ms."""
    mirrored_s = 1.0 / (50.0 - 1.0 / 0.039)
    found_s = likely_periods_s(list(repeats_of(0.039, 1, 0)), 0.05)
    assert sorted(found_s) == pytest.approx([0.039, mirrored_s], abs=5e-4)
    assert likely_periods_s(list(repeats_of(0.063, 1, 0)), 0.05) == pytest.approx(
        (0.063,), abs=5e-4
    )


def test_added_mass_makes_everything_slower(flown) -> None:
    _, physics, *_ = flown
    mass_kg = QUIET.sufferer.mass_kg
    light, heavy = (physics.forces(CONSTANTS, e) for e in (NONE, active("added-mass", mass_kg=0.1)))
    assert heavy.inertia_kg == pytest.approx(np.full(len(heavy.inertia_kg), mass_kg + 0.1))
    ratio = mass_kg / (mass_kg + 0.1)
    assert heavy.acceleration[0] == pytest.approx(ratio * light.acceleration[0], abs=1e-9)


@settings(max_examples=12, deadline=None)
@given(hold_s=st.floats(0.005, 0.3))
def test_readings_are_in_order_whatever_the_hold(flown, hold_s: float) -> None:
    flight, physics, *_ = flown
    found = physics.forces({**CONSTANTS, "range.hold_s": hold_s}, NONE)
    assert (np.diff(found.taken_s) >= 0.0).all()
    assert (found.taken_s <= flight.sample_s + 1e-9).all()
    assert (found.held.age_variance_s2 >= 0.0).all()
    assert ((found.held.probability >= 0.0) & (found.held.probability < 1.0)).all()
