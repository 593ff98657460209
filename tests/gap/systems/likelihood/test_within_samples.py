"""What happens within a sample, and before the first: against exact solutions of a linear cart."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from scipy.linalg import expm

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import neutral
from wakedeploy.gap.evidence.inference import applied, fit
from wakedeploy.gap.search.climbing import begun, fresh
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import verdict_of
from wakedeploy.gap.search.sizes import parameters
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE, FINE = 20.0, 200  # a log as coarse as many robots', and parts of a sample here
MASS_KG, DAMPING, GAIN_N = 2.0, 8.0, 42.0


class Cart(System):
    rate_hz = RATE
    inputs: ClassVar = [Input("command", "1")]
    states: ClassVar = {"x_m": "m", "v_mps": "m/s"}
    outputs: ClassVar = [Output("x_m", "m", noise=5e-4)]
    constants: ClassVar = [
        Constant("mass_kg", MASS_KG, spread=0.1),
        Constant("damping", DAMPING, spread=2.0, unit="N/(m/s)"),
        Constant("gain_n", GAIN_N, spread=4.0),
    ]
    ports: ClassVar = [
        Port.input("command", kinds=["dead-time", "lag", "saturation"]),
        Port.force("v_mps", inertia="mass_kg", position="x_m", kinds=["coulomb-friction"]),
        Port.output("x_m", kinds=["sensor-dead-time", "sensor-lag"]),
    ]

    def derivative(self, state, inputs, c):
        force = c.gain_n * inputs.command - c.damping * state.v_mps
        return {"x_m": state.v_mps, "v_mps": force / c.mass_kg}


class Driven(Cart):
    """The cart behind an actuator that lags; no output shows its force."""

    states: ClassVar = {**Cart.states, "force_n": "N"}
    constants: ClassVar = [*Cart.constants, Constant("tau_s", 0.1, spread=0.02)]
    ports: ClassVar = [Port.input("command")]

    def derivative(self, state, inputs, c):
        return {
            "x_m": state.v_mps,
            "v_mps": (state.force_n - c.damping * state.v_mps) / c.mass_kg,
            "force_n": (c.gain_n * inputs.command - state.force_n) / c.tau_s,
        }


def _held(seed: int, samples: int) -> np.ndarray:
    """Commands that are held for a while, from 0 on."""
    rng = np.random.default_rng(seed)
    held = np.repeat(rng.uniform(-1.0, 1.0, samples // 12 + 1), 12)[:samples]
    held[:12] = 0.0
    return held


def _moved(command: np.ndarray, delay_s: float, tau_s: float = 0.0) -> np.ndarray:
    """Positions (n,) and forces (n,) at the samples: exact for commands that change as `FINE` has.

    The command acts `delay_s` after the sample that gives it, behind an actuator of `tau_s`.
    """
    a = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, -DAMPING / MASS_KG, 1.0 / MASS_KG, 0.0],
                  [0.0, 0.0, -1.0 / max(tau_s, 1e-6), GAIN_N / max(tau_s, 1e-6)],
                  [0.0, 0.0, 0.0, 0.0]])  # fmt: skip
    step = expm(a / RATE / FINE)
    late = round(delay_s * RATE * FINE)
    acting = np.concatenate([np.zeros(late), np.repeat(command, FINE)])
    state, shown = np.zeros(4), np.empty((2, len(command)))
    for k in range(len(command) * FINE):
        if k % FINE == 0:
            shown[:, k // FINE] = state[[0, 2]]
        state[3] = acting[k]
        state = step @ state
    return shown


def _log(seed: int, samples: int, delay_s: float, noise_m: float = 5e-4) -> Recording:
    command = _held(seed, samples)
    x = _moved(command, delay_s)[0] + noise_m * np.random.default_rng(seed).standard_normal(samples)
    return Recording(f"run {seed}", np.arange(samples) / RATE, {"command": command, "x_m": x})


@pytest.mark.parametrize("delay_s", [0.0, 0.0125, 0.025, 0.03, 0.07])
def test_a_command_that_arrives_within_a_sample_acts_from_there_on(delay_s):
    """Its mean over the sample brings the right speed, and places that are off by millimetres."""
    log = _log(1, 200, delay_s, noise_m=0.0)
    model = LogModel(Cart(), [log])
    model.filter.guesses[:, 0] = 0.0  # as it began: a first guess of a speed is none of this
    hypothesis = ("dead-time@command",)
    free = model.free(hypothesis)
    theta = neutral(free)
    theta[[f.name for f in free].index("dead-time@command.delay_s")] = delay_s
    values = model.values(hypothesis, theta)
    _, shown = model.filter.free_run(
        model.acting(hypothesis), {n: np.array([v]) for n, v in values.items()}
    )
    assert np.abs(shown[0] - log.columns["x_m"]).max() < 2e-4  # by the mean it is 3.5 mm
    assert np.ptp(log.columns["x_m"]) > 1.0

    stated = [Input("command", "1", delay_s=delay_s)]
    late = LogModel(type("Late", (Cart,), {"inputs": stated})(), [log])
    late.filter.guesses[:, 0] = 0.0
    plain = late.values((), neutral(late.free(())))
    _, known = late.filter.free_run(late.acting(()), {n: np.array([v]) for n, v in plain.items()})
    np.testing.assert_allclose(known, shown, atol=1e-9)


@pytest.mark.slow
def test_a_delay_of_a_coarse_log_is_named_where_it_is():
    """The sensor's delay was named instead, with hundreds of nats more."""
    model = LogModel(Cart(), [_log(seed, 400, 0.07) for seed in (1, 2)])
    naming = named(model, fitted_base(model))
    assert verdict_of(naming) == "named"
    found = naming.found
    assert found.hypothesis == ("dead-time@command",)
    late = found.value("dead-time@command.delay_s") + found.value("clock.command")
    assert late == pytest.approx(0.07, abs=0.003)


@pytest.mark.parametrize("clock_s", [0.0, 0.006, -0.004])
def test_a_named_delay_has_what_the_input_s_clock_took_of_it(clock_s):
    """A fit may give a part of either to the other: all that is printed is their sum."""
    model = LogModel(Cart(), [_log(1, 200, 0.07)])
    hypothesis = ("dead-time@command",)
    free = model.free(hypothesis)
    theta = neutral(free)
    names = [f.name for f in free]
    theta[names.index("clock.command")] = clock_s
    theta[names.index("dead-time@command.delay_s")] = 0.07 - clock_s
    start = begun(model, hypothesis, applied(model, fit(model, (), (0,)), (0,)), theta)
    here = fresh(model, start, theta)
    size = parameters(model, here, hypothesis)["dead-time@command.delay_s"]
    assert size.value == pytest.approx(0.07, abs=1e-12)
    low, high = here.interval("dead-time@command.delay_s")
    assert (size.low, size.high) == (pytest.approx(low + clock_s), pytest.approx(high + clock_s))


def test_a_state_that_nothing_shows_goes_along_as_the_model_has_it():
    """From where the first command, held, had brought it: at 0 again it would look like a lag."""
    command = _held(3, 300)
    command[:12] = 0.6
    before = np.full(100, 0.6)
    x, force = _moved(np.concatenate([before, command]), 0.0, tau_s=0.1)[:, 100:]
    log = Recording("run", np.arange(300) / RATE, {"command": command, "x_m": x})
    model = LogModel(Driven(), [log])
    assert model.hidden == ("force_n",)
    assert model._starts[0].states[2] == pytest.approx(force, abs=1e-6)
    assert model.sizes["force_n"] == pytest.approx(np.quantile(np.abs(force), 0.98))


class Odometer(Driven):
    """A state that only goes on stands beside the actuator."""

    states: ClassVar = {**Driven.states, "way_m": "m"}

    def derivative(self, state, inputs, c):
        return {**super().derivative(state, inputs, c), "way_m": np.abs(state.v_mps)}


@pytest.mark.parametrize("system", [Driven, Odometer])
@pytest.mark.parametrize("tau_s", [0.002, 0.1, 20.0])
def test_an_actuator_begins_where_its_command_had_brought_it(system, tau_s):
    """However fast or slow it is, and whatever has no rest beside it."""

    class Timed(system):
        constants: ClassVar = [*Cart.constants, Constant("tau_s", tau_s, spread=0.1 * tau_s)]

    command = np.full(100, 0.6) + 0.1 * np.sin(np.arange(100.0) / 3.0)
    log = Recording("run", np.arange(100) / RATE, {"command": command, "x_m": _wave(100)})
    model = LogModel(Timed(), [log])
    assert model._starts[0].states[2, 0] == pytest.approx(GAIN_N * command[0])
    assert model._starts[0].states[3:, 0] == pytest.approx(0.0)


@pytest.mark.slow
def test_a_long_log_is_followed_in_parts_that_agree():
    command = _held(4, 14_000)
    x, force = _moved(command, 0.0, tau_s=0.1)
    log = Recording("run", np.arange(14_000) / RATE, {"command": command, "x_m": x})
    guessed = LogModel(Driven(), [log, log])._starts
    for each in guessed:
        assert each.states[2] == pytest.approx(force, abs=1e-6)


def test_a_state_that_would_run_away_without_readings_is_not_followed():
    """A pole under feedback: alone it falls, and its usual size would be that of a fall."""

    class Pole(Driven):
        def derivative(self, state, inputs, c):
            falls = {"force_n": 6.0 * state.force_n + c.gain_n * inputs.command}
            return {**super().derivative(state, inputs, c), **falls}

    log = Recording("run", np.arange(400) / RATE, {"command": _wave(400), "x_m": _wave(400)})
    model = LogModel(Pole(), [log])
    assert not model._starts[0].states[2].any()
    assert model.sizes["force_n"] == pytest.approx(model.sizes["y x_m"])


def test_a_beginning_that_is_stated_as_a_number_is_one_of_the_first_sample():
    class Begun(Driven):
        def start(self, measured):
            return {"force_n": 5.0}

    log = Recording("run", np.arange(100) / RATE, {"command": np.zeros(100), "x_m": _wave(100)})
    guessed = LogModel(Begun(), [log])._starts[0].states[2]
    assert guessed == pytest.approx(5.0 * np.exp(-np.arange(100) / RATE / 0.1))


def _wave(samples: int) -> np.ndarray:
    return np.sin(np.arange(samples) / 7.0)


def test_a_limit_to_a_command_is_the_same_in_every_log():
    small, large = _log(1, 200, 0.0), _log(2, 200, 0.0)
    weak = Recording(
        "weak", small.time_s, {**small.columns, "command": 0.5 * large.columns["command"]}
    )
    model = LogModel(Cart(), [large, weak])
    name = "saturation@command"
    (limit,) = model.effects[name]
    largest = np.abs(large.columns["command"]).max()
    assert (limit.neutral, limit.high) == pytest.approx((largest, largest))
    acting = model.acting((name,))
    cut = [acting.column("command", log.driving, {f"{name}.limit": 0.3})[0] for log in model.logs]
    for row, log in zip(cut, (large, weak), strict=True):
        assert row == pytest.approx(np.clip(log.columns["command"], -0.3, 0.3))


class Car(System):
    """Its rate gyro shows at once what the steering does."""

    rate_hz = 50.0
    inputs: ClassVar = [Input("steer_rad", "rad"), Input("throttle", "1")]
    states: ClassVar = {"speed_mps": "m/s"}
    outputs: ClassVar = [
        Output("speed_mps", "m/s", noise=0.01),
        Output("gyro_radps", "rad/s", noise=0.01),
    ]
    constants: ClassVar = [Constant("tau_s", 0.45, spread=0.05)]
    ports: ClassVar = [Port.input("steer_rad"), Port.output("gyro_radps")]

    def derivative(self, state, inputs, c):
        return {"speed_mps": (4.0 * inputs.throttle - state.speed_mps) / c.tau_s}

    def measure(self, state, inputs, c):
        return {"gyro_radps": state.speed_mps / 0.32 * np.tan(inputs.steer_rad)}


def _gyro(effect: str, time: str, late_s: float) -> np.ndarray:
    """What the gyro of a car that is steered at once after 1 s shows, as a share of its step."""
    at_s = np.arange(100) / 50.0
    steer = np.where(at_s < 0.99, 0.0, 0.3)
    columns = {"steer_rad": steer, "throttle": np.full(100, 0.4), "speed_mps": np.full(100, 1.6)}
    columns["gyro_radps"] = 5.0 * np.tan(steer)
    model = LogModel(Car(), [Recording("turn", at_s, columns)])
    values = model.values((effect,), neutral(model.free((effect,)))) | {f"{effect}.{time}": late_s}
    _, shown = model.filter.free_run(
        model.acting((effect,)), {n: np.array([v]) for n, v in values.items()}
    )
    return shown[1] / (5.0 * np.tan(0.3))


@pytest.mark.parametrize(("kind", "time"), [("lag", "tau_s"), ("dead-time", "delay_s")])
def test_a_sensor_that_is_late_by_nothing_shows_what_an_input_does_at_once(kind, time):
    """It was late by a whole sample, or answered the other way first, however short its time."""
    effect = f"sensor-{kind}@gyro_radps"
    step = np.where(np.arange(100) < 50, 0.0, 1.0)
    assert _gyro(effect, time, 1e-6) == pytest.approx(step, abs=1e-3)
    late = _gyro(effect, time, 0.01)
    assert late[50] == pytest.approx(0.5 if kind == "dead-time" else 1 - 0.5 * (1 - np.exp(-2.0)))
    assert late[:50] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff(late) >= -1e-9)


@pytest.mark.whole
def test_a_delay_of_one_row_is_said_to_be_perhaps_the_log_s() -> None:
    """Readings, and the command that follows them, in one row; in the next row it is seen."""
    rng = np.random.default_rng(5)
    steer = np.repeat(rng.uniform(-0.3, 0.3, 60), 10)
    seen = np.concatenate([steer[:1], steer[:-1]])
    columns = {"steer_rad": steer, "throttle": np.full(600, 0.4), "speed_mps": np.full(600, 1.6)}
    columns["gyro_radps"] = 5.0 * np.tan(seen)
    for name in ("speed_mps", "gyro_radps"):
        columns[name] = columns[name] + 0.01 * rng.standard_normal(600)
    model = LogModel(Car(), [Recording("drive", np.arange(600) / 50.0, columns)])
    effect = ("dead-time@steer_rad",)
    free = model.free(effect)
    start = neutral(free)
    start[[f.name for f in free].index("dead-time@steer_rad.delay_s")] = 0.015
    found = fit(model, effect, range(model.episodes), start)
    assert model.late_by_a_row(found) == ["dead-time@steer_rad"]
    longer = [
        0.06 if f.name.endswith("delay_s") else v for f, v in zip(free, found.theta, strict=True)
    ]
    assert not model.late_by_a_row(applied(model, replace(found, theta=np.array(longer))))


def test_a_state_that_has_no_number_on_the_way_to_rest_begins_as_it_did() -> None:
    """A reservoir that nobody measures, under a pump that draws from it at first."""

    class Reservoir(Driven):
        def derivative(self, state, inputs, c):
            flows = {"force_n": c.gain_n * inputs.command - 5.0 * np.sqrt(state.force_n)}
            return {**super().derivative(state, inputs, c), **flows}

    command = np.where(np.arange(100) < 5, -0.5, 0.5)
    log = Recording("run", np.arange(100) / RATE, {"command": command, "x_m": _wave(100)})
    model = LogModel(Reservoir(), [log])
    assert np.isfinite(model._starts[0].states).all()
    assert model._starts[0].states[2, 0] == 0.0
