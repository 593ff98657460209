"""An input that was moving before its log began: what was on its way then is nobody's effect."""

from typing import ClassVar

import numpy as np
import pytest
import scipy.signal

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import extended
from wakedeploy.gap.evidence.inference import applied, fit
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import verdict_of
from wakedeploy.gap.systems.kinds.inputs import DeadTime, Lag, SecondOrderLag
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE = 4.0
GAIN, LEAK, TAU_S = 0.004, 0.02, 6.0


class Tank(System):
    """A pump fills it, and it leaks by Torricelli's law."""

    rate_hz = RATE
    inputs: ClassVar = [Input("pump_v", "V")]
    states: ClassVar = {"level_m": "m"}
    outputs: ClassVar = [Output("level_m", "m", noise=5e-4)]
    constants: ClassVar = [Constant("gain", GAIN, spread=4e-4), Constant("leak", LEAK, spread=2e-3)]
    ports: ClassVar = [
        Port.input("pump_v", kinds=["lag", "second-order-lag", "dead-time"]),
        Port.output("level_m", kinds=["sensor-lag", "sensor-dead-time"]),
    ]

    def derivative(self, state, inputs, c):
        out = c.leak * np.sqrt(np.maximum(state.level_m, 1e-6))
        return {"level_m": c.gain * np.asarray(inputs.pump_v) - out}


def _log(seed: int, lags: int, cut_s: float, minutes: float = 6.0) -> Recording:
    """The tank, its pump behind so many lags, by small Euler steps; the log begins at `cut_s`."""
    rng = np.random.default_rng(seed)
    n, fine = int((60.0 * minutes + cut_s) * RATE), 20
    command = np.repeat(rng.uniform(0.5, 5.0, n // 24 + 1), 24)[:n]
    pump, level, shown = np.full(lags, command[0]), 0.4, np.empty(n)
    dt = 1.0 / RATE / fine
    for k in range(n):
        shown[k] = level
        for _ in range(fine):
            before = np.concatenate([[command[k]], pump[:-1]])
            pump += dt / TAU_S * (before - pump)
            level += dt * (GAIN * pump[-1] - LEAK * np.sqrt(max(level, 0.0)))
    shown += 5e-4 * rng.standard_normal(n)
    cut = int(cut_s * RATE)
    columns = {"pump_v": command[cut:], "level_m": shown[cut:]}
    return Recording("tank", np.arange(n - cut) / RATE, columns)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lags", "effect"),
    [
        (1, "lag@pump_v"),
        pytest.param(2, "second-order-lag@pump_v", marks=pytest.mark.slow),
    ],
)
def test_a_log_that_begins_in_motion_is_no_less_likely_than_later_parts(lags, effect):
    model = LogModel(Tank(), [_log(3, lags, cut_s=120.0)])
    base = fitted_base(model)
    start = extended(base, model.free((effect,)))
    start[-1] = TAU_S
    fitted = fit(model, (effect,), base.episodes, start)
    low, high = fitted.interval(f"{effect}.tau_s")
    assert low < TAU_S < high
    assert high - low < 0.5 * TAU_S
    first, *others = applied(model, fitted, base.episodes).slopes.scores
    loudest = max(float(np.sqrt(np.mean(s.white**2))) for s in others)
    assert float(np.sqrt(np.mean(first.white**2))) < loudest


def _late_log(seed: int, delay_s: float, minutes: float = 4.0) -> Recording:
    """The tank at rest, until a script begins with a step; its commands act late."""
    rng = np.random.default_rng(seed)
    n, fine = int(60.0 * minutes * RATE), 20
    command = np.repeat(rng.uniform(0.5, 5.0, n // 24 + 1), 24)[:n]
    command[0] = 5.0
    before, late = 0.5, round(delay_s * RATE * fine)
    acting = np.concatenate([np.full(late, before), np.repeat(command, fine)])
    level, shown = (GAIN * before / LEAK) ** 2, np.empty(n)
    for k in range(n):
        shown[k] = level
        for pump in acting[k * fine : (k + 1) * fine]:
            level += (GAIN * pump - LEAK * np.sqrt(level)) / (RATE * fine)
    shown += 5e-4 * rng.standard_normal(n)
    return Recording("late tank", np.arange(n) / RATE, {"pump_v": command, "level_m": shown})


@pytest.mark.whole
@pytest.mark.parametrize("delay_s", [pytest.param(2.0, marks=pytest.mark.slow), 3.6])
def test_a_script_that_begins_with_a_step_does_not_hide_that_its_commands_act_late(delay_s):
    """What the pump did before the log says no column, and until the delay is over it acts."""
    model = LogModel(Tank(), [_late_log(5, delay_s)])
    base, effect = fitted_base(model), "dead-time@pump_v"
    start = extended(base, model.free((effect,)))
    start[-1] = delay_s
    fitted = fit(model, (effect,), base.episodes, start)
    assert fitted.value(f"{effect}.delay_s") == pytest.approx(delay_s, abs=0.25 / RATE)
    assert fitted.value("constant.gain") == pytest.approx(GAIN, rel=0.03)
    first, *others = applied(model, fitted, base.episodes).slopes.scores
    loudest = max(float(np.sqrt(np.mean(s.white**2))) for s in others)
    assert float(np.sqrt(np.mean(first.white**2))) < 1.2 * loudest


@pytest.mark.parametrize("clock_s", [-0.02, 0.0, 0.02])
@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.05, 0.13])
def test_a_dead_time_knows_what_was_on_its_way(late_s, clock_s):
    """Its column and its state together, against a column that began long before."""
    dt_s, p, kind = 0.05, {"delay_s": late_s}, DeadTime()
    whole = np.concatenate([np.full(9, 2.0), [5.0, 4.0, 7.0, 1.0, 3.0]])
    both = {"delay_s": late_s + clock_s}  # a clock makes the column later, as a dead time does
    known = kind.filtered(whole, both, dt_s)[9:]
    since_s = dt_s * np.arange(5) - clock_s
    before = kind.from_before((np.full(5, 2.0 - 5.0),), since_s, p, dt_s)
    if late_s + clock_s >= 0.0:
        np.testing.assert_allclose(kind.filtered(whole[9:], both, dt_s) + before, known, atol=1e-12)
    assert (kind.remaining(since_s, p, dt_s) > 0.0).tolist() == (before != 0.0).tolist()
    assert kind.unsettled(whole[9:], p, dt_s) > 1.0  # as far as commands go at all
    assert kind.unsettled(np.full(5, 3.0), p, dt_s) == 0.0


@pytest.mark.slow
def test_a_slow_pump_is_not_blamed_on_the_sensor():
    model = LogModel(Tank(), [_log(0, 1, cut_s=120.0)])
    told = named(model, fitted_base(model))
    assert verdict_of(told) in ("named", "class")
    assert "lag@pump_v" in (*told.found.hypothesis, *told.rivals)


DAMPED = [(Lag(), 1.0), *((SecondOrderLag(), damping) for damping in (0.2, 1.0, 1.6))]


@pytest.mark.parametrize(("kind", "damping"), DAMPED)
def test_how_far_a_lag_may_have_been_is_smooth_and_sees_beyond_a_plateau(kind, damping):
    column = np.repeat([1.0, 4.0, 2.0], 24)  # it stands still for six seconds first
    slower = max(damping, 1.0 / damping)  # it looks so much farther ahead
    taus, p = np.linspace(0.0, 10.0, round(400 * slower)), {"damping": damping}
    told = np.array([kind.unsettled(column, p | {"tau_s": tau}, 1.0 / RATE) for tau in taus])
    assert told[0] == 0.0
    assert np.abs(np.diff(told)).max() < 0.1
    assert kind.unsettled(column, p | {"tau_s": 2.5}, 1.0 / RATE) > 0.5


@pytest.mark.parametrize("damping", [0.15, 0.7, 1.0, 1.8])
@pytest.mark.parametrize("tau_s", [0.004, 0.05, 0.6])
def test_a_lag_of_second_order_is_that_oscillator(tau_s, damping):
    """Means over each sample against SciPy's integration of the same equation in fine steps."""
    dt_s, fine = 0.05, 400
    column = np.random.default_rng(2).normal(1.0, 1.0, 60)
    ring = scipy.signal.StateSpace(
        [[0.0, 1.0], [-1.0 / tau_s**2, -2.0 * damping / tau_s]], [[0.0], [1.0 / tau_s**2]],
        [[1.0, 0.0]], [[0.0]],
    )  # fmt: skip
    held = np.append(np.repeat(column, fine), column[-1])
    time_s = np.arange(len(held)) * dt_s / fine
    _, shown, _ = scipy.signal.lsim(ring, held, time_s, X0=[column[0], 0.0], interp=False)
    means = (0.5 * (shown[:-1] + shown[1:])).reshape(60, fine).mean(1)
    told = SecondOrderLag().filtered(column, {"tau_s": tau_s, "damping": damping}, dt_s)
    np.testing.assert_allclose(told, means, atol=2e-3)


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize(("kind", "damping"), DAMPED)
def test_what_was_on_its_way_fades_as_the_column_itself_does(kind, damping, discrete):
    """Its states against the column of a command that has just stepped to 0."""
    dt_s, tau, count = 0.02, {"tau_s": 0.3, "damping": damping}, kind.own_states
    after = kind.filtered(np.concatenate([[1.0], np.zeros(80)]), tau, dt_s)[1:]
    own, fine = [np.ones(1)] * count, 1 if discrete else 500
    shown = []
    for _ in range(80):
        shown.append(float(own[-1][0]))
        for _ in range(fine):
            rates = kind.own_rates(tuple(own), tau, dt_s, discrete)
            own = [x + dt_s / fine * rate for x, rate in zip(own, rates, strict=True)]
    np.testing.assert_allclose(shown, after, atol=0.06)  # starts and means of samples
    left = kind.remaining(dt_s * np.arange(80), tau, dt_s)
    if damping >= 1.0:
        np.testing.assert_allclose(left, shown, atol=0.03)
    else:  # it swings within that
        assert np.all(np.abs(shown) < left + 0.03)
        assert left[-1] < 0.5
