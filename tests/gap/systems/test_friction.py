"""A system with dry friction, replayed sample by sample, against its motion in small steps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import Fit, Slopes, scores_of
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import REFINES
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.imagined import imagined

MASS_KG, SPRING_N_PER_M, FRICTION_N, RATE_HZ, FINE = 2.0, 30.0, 4.0, 50, 200


class Sled(System):
    """A mass on a spring, which a force pulls."""

    rate_hz = float(RATE_HZ)
    inputs = [Input("force_n", "N")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", MASS_KG), Constant("spring_n_per_m", SPRING_N_PER_M)]
    ports = [
        Port.force(
            "speed_mps", inertia="mass_kg", position="position_m", kinds=["coulomb-friction"]
        )
    ]

    def derivative(self, state, inputs, c):
        pull = inputs.force_n - c.spring_n_per_m * state.position_m
        return {"position_m": state.speed_mps, "speed_mps": pull / c.mass_kg}


class SteppedSled(Sled):
    """The same, as a step of its own."""

    derivative = None

    def step(self, state, inputs, c):
        """By the matrix exponential."""
        w, dt = math.sqrt(c.spring_n_per_m / c.mass_kg), 1.0 / RATE_HZ
        rest = inputs.force_n / c.spring_n_per_m
        away = state.position_m - rest
        return {
            "position_m": rest + away * math.cos(w * dt) + state.speed_mps * math.sin(w * dt) / w,
            "speed_mps": state.speed_mps * math.cos(w * dt) - away * w * math.sin(w * dt),
        }


def in_small_steps(force_n: np.ndarray) -> np.ndarray:
    """Positions (n,) of a sled that stops where it would turn, and stays while it can."""
    x, v, dt, shown = 0.0, 0.0, 1.0 / RATE_HZ / FINE, []
    for force in force_n:
        shown.append(x)
        for _ in range(FINE):
            pull = force - SPRING_N_PER_M * x
            if v == 0.0 and abs(pull) <= FRICTION_N:
                break
            against = math.copysign(FRICTION_N, v if v != 0.0 else pull)
            further = v + (pull - against) / MASS_KG * dt
            v = 0.0 if further * v < 0.0 else further
            x += v * dt
    return np.array(shown)


def replayed(system: System, force_n: np.ndarray, position_m: np.ndarray) -> np.ndarray:
    """Positions (n,) as the filter's own steps have them, from where a log begins."""
    time_s = np.arange(len(force_n)) / RATE_HZ
    columns = {"force_n": force_n, "position_m": position_m}
    model = LogModel(system, [Recording("sled", time_s, columns)])
    acting = Acting(model.system, [model.library["coulomb-friction@speed_mps"]], model.sizes)
    name = "coulomb-friction@speed_mps"
    values = {f"{name}.force": FRICTION_N, f"{name}.turning": 1e-4}
    states, _ = model.filter.free_run(acting, {n: np.array([v]) for n, v in values.items()})
    return states[0]


@pytest.mark.whole
@pytest.mark.parametrize(
    ("sled", "off"), [(Sled, 0.01), pytest.param(SteppedSled, 0.01, marks=pytest.mark.slow)]
)
@given(seed=st.integers(0, 2**31))
@settings(max_examples=20)
def test_a_sled_slides_sticks_and_is_let_go_as_in_small_steps(sled, off, seed):
    force_n = np.repeat(np.random.default_rng(seed).normal(0.0, 8.0, 16), 25)
    position_m = in_small_steps(force_n)
    most = off * max(np.ptp(position_m), 0.1)
    assert replayed(sled(), force_n, position_m) == pytest.approx(position_m, abs=most)


def knowing(sled, friction_n=FRICTION_N, spread=0.0):
    """The same sled, whose own model has the friction."""
    port = Port.force(
        "speed_mps", inertia="mass_kg", position="position_m", friction="friction_n",
        kinds=["coulomb-friction", "offset", "viscous-friction"],
    )  # fmt: skip
    constants = [*Sled.constants, Constant("friction_n", friction_n, spread=spread)]
    return type(sled.__name__, (sled,), {"constants": constants, "ports": [port]})()


@pytest.mark.whole
@pytest.mark.parametrize("sled", [Sled, SteppedSled])
@given(seed=st.integers(0, 2**31))
@settings(max_examples=10)
def test_friction_that_a_model_knows_of_acts_as_in_small_steps(sled, seed):
    force_n = np.repeat(np.random.default_rng(seed).normal(0.0, 8.0, 16), 25)
    position_m = in_small_steps(force_n)
    columns = {"force_n": force_n, "position_m": position_m}
    recording = Recording("sled", np.arange(len(force_n)) / RATE_HZ, columns)
    most = 0.02 * max(np.ptp(position_m), 0.1)
    replay = knowing(sled).simulate(recording)["position_m"]
    assert replay == pytest.approx(position_m, abs=most)


@pytest.mark.slow
def test_the_size_of_a_known_friction_is_fitted_and_no_other_is_named():
    random = np.random.default_rng(5)
    force_n = np.repeat(random.normal(0.0, 8.0, 80), 12)
    position_m = in_small_steps(force_n) + 1e-3 * random.standard_normal(len(force_n))
    columns = {"force_n": force_n, "position_m": position_m}
    recording = Recording("sled", np.arange(len(force_n)) / RATE_HZ, columns)
    model = LogModel(knowing(Sled, friction_n=2.5, spread=2.0), [recording])
    base = fitted_base(model)
    assert base.value("constant.friction_n") == pytest.approx(FRICTION_N, rel=0.05)
    assert named(model, base).found.hypothesis == ()


class Pair(System):
    """Two masses, each of which what pushes the other pushes back, by 0.8."""

    rate_hz = float(RATE_HZ)
    inputs = [Input("first_n", "N"), Input("second_n", "N")]
    states = {"first_mps": "m/s", "second_mps": "m/s"}
    outputs = [Output("first_mps", "m/s", noise=1e-3), Output("second_mps", "m/s", noise=1e-3)]
    ports = [Port.force(name, kinds=["coulomb-friction"]) for name in ("first_mps", "second_mps")]

    def derivative(self, state, inputs, c):
        return self.derivative_under(state, inputs, c, {})

    def derivative_under(self, state, inputs, c, forces):
        first = inputs.first_n + forces.get("first_mps", 0.0)
        second = inputs.second_n + forces.get("second_mps", 0.0)
        return {
            "first_mps": first - 0.8 * second + 0.0 * state.first_mps,
            "second_mps": second - 0.8 * first + 0.0 * state.first_mps,
        }


def test_known_frictions_of_two_that_push_each_other_hold_both():
    """As strong as needed, stated at the ports; of no strength, neither stands."""
    ports = [Port.force(name, friction="rub_n") for name in ("first_mps", "second_mps")]
    time_s = np.arange(200) / RATE_HZ
    columns = dict.fromkeys(("first_n", "second_n"), np.ones(200))
    columns |= dict.fromkeys(("first_mps", "second_mps"), np.zeros(200))
    recording = Recording("pair", time_s, columns)
    for strength, stands in ((2.0, True), (0.0, False)):
        stated = {"ports": ports, "constants": [Constant("rub_n", strength, low=0.0, high=9.0)]}
        shown = type("Pair", (Pair,), stated)().simulate(recording)
        farthest = max(float(np.abs(shown[n]).max()) for n in Pair.states)
        assert (farthest < 1e-6) == stands


@pytest.mark.parametrize("order", [1, -1])
def test_two_that_push_each_other_both_stand_whichever_is_asked_first(order):
    time_s = np.arange(200) / RATE_HZ
    columns = dict.fromkeys(("first_n", "second_n"), np.ones(200))
    columns |= dict.fromkeys(("first_mps", "second_mps"), np.zeros(200))
    model = LogModel(Pair(), [Recording("pair", time_s, columns)])
    names = [f"coulomb-friction@{speed}" for speed in ("first_mps", "second_mps")][::order]
    acting = Acting(model.system, [model.library[n] for n in names], model.sizes)
    values = {f"{n}.force": np.array([2.0]) for n in names}
    values |= {f"{n}.turning": np.array([1e-3]) for n in names}
    states, _ = model.filter.free_run(acting, values)
    assert np.abs(states).max() < 1e-6


def test_friction_of_no_strength_is_no_friction():
    force_n = np.repeat(np.random.default_rng(1).normal(0.0, 8.0, 40), 25)
    position_m = in_small_steps(force_n)
    time_s = np.arange(len(force_n)) / RATE_HZ
    columns = {"force_n": force_n, "position_m": position_m}
    model = LogModel(Sled(), [Recording("sled", time_s, columns)])
    free = model.free(("coulomb-friction@speed_mps",))
    theta = np.array([f.neutral for f in free])
    used = list(range(model.episodes))
    with_none = scores_of(model, ("coulomb-friction@speed_mps",), theta[None], used)[0]
    shared = [i for i, f in enumerate(free) if "coulomb" not in f.name]
    without = scores_of(model, (), theta[None, shared], used)[0]
    for a, b in zip(with_none, without, strict=True):
        assert a.log_density == pytest.approx(b.log_density, abs=1e-9)


@pytest.mark.parametrize("sled", [Sled, SteppedSled])
def test_an_imagined_log_stands_where_the_filter_s_does(sled):
    time_s = np.arange(400) / RATE_HZ
    random = np.random.default_rng(0)
    force_n = np.repeat(random.normal(0.0, 8.0, 16), 25)
    columns = {"force_n": force_n, "position_m": in_small_steps(force_n)}
    model = LogModel(sled(), [Recording("sled", time_s, columns)])
    name = "coulomb-friction@speed_mps"
    free = model.free((name,))
    told = {f.name: -20.0 for f in free if f.name.startswith(("noise.", "force.", "push."))}
    told |= {f"{name}.force": FRICTION_N, f"{name}.turning": 1e-3}
    theta = np.array([told.get(f.name, f.neutral) for f in free])
    fitted = Fit((name,), free, (0,), theta, Slopes((), (), ()), np.zeros(1))
    pull_n = np.concatenate([np.full(200, 0.9 * FRICTION_N), np.full(200, 2.0 * FRICTION_N)])
    shown = imagined(model, fitted, {"force_n": pull_n[None]})["position_m"][0]
    assert np.ptp(shown[:200]) < 1e-4
    assert np.ptp(shown[200:]) > 0.1


class Rubbed(System):
    """A mass that a force pushes to and fro, of exactly known weight."""

    rate_hz = float(RATE_HZ)
    inputs = [Input("force_n", "N")]
    states = {"speed_mps": "m/s"}
    outputs = [Output("speed_mps", "m/s", noise=2e-3)]
    constants = [Constant("mass_kg", MASS_KG)]
    ports = [
        Port.force("speed_mps", inertia="mass_kg", kinds=["coulomb-friction", "stribeck-friction"])
    ]

    def derivative(self, state, inputs, c):
        return {"speed_mps": inputs.force_n / c.mass_kg}


def rubbed(more_n: float) -> LogModel:
    """Its log, pushed a little, with 3 N of dry friction and so much more below about 0.2 m/s."""
    random = np.random.default_rng(4)
    force_n = np.repeat(random.uniform(-8.0, 8.0, 100), 16)
    v, dt, shown = 0.0, 1.0 / RATE_HZ / 50, []
    for force in force_n:
        shown.append(v)
        force += 0.1 * random.standard_normal()
        for _ in range(50):
            most = 3.0 + more_n * math.exp(-((v / 0.2) ** 2))
            if v == 0.0 and abs(force) <= most:
                break
            further = v + (force - math.copysign(most, v if v != 0.0 else force)) / MASS_KG * dt
            v = 0.0 if further * v < 0.0 else further
    columns = {"force_n": force_n, "speed_mps": shown + 2e-3 * random.standard_normal(len(shown))}
    return LogModel(Rubbed(), [Recording("made", np.arange(len(shown)) / RATE_HZ, columns)])


@pytest.mark.slow
def test_friction_that_falls_is_found_beside_the_friction_that_stays():
    model = rubbed(1.5)
    found = named(model, fitted_base(model)).found
    assert set(found.hypothesis) == {"coulomb-friction@speed_mps", "stribeck-friction@speed_mps"}
    assert found.value("coulomb-friction@speed_mps.force") == pytest.approx(3.0, rel=0.05)
    assert found.value("stribeck-friction@speed_mps.force") == pytest.approx(1.5, rel=0.15)
    assert found.value("stribeck-friction@speed_mps.speed") == pytest.approx(0.2, rel=0.1)


@pytest.mark.slow
def test_a_finer_friction_that_hardly_matters_to_the_gap_is_told_and_not_named():
    """Two tenths of a newton are evident, after three have removed all but a thousandth."""
    model = rubbed(0.2)
    told = named(model, fitted_base(model))
    assert told.found.hypothesis == ("coulomb-friction@speed_mps",)
    assert [e.judged for e in told.rounds[-1].ranking] == [REFINES]
