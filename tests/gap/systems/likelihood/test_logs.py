"""The engine: likelihoods of an independent Kalman filter, and effects whose truth is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm

from wakedeploy import Constant, Input, Output, Port, System, UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import extended, neutral
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import verdict_of
from wakedeploy.gap.search.rivalry import is_nothing
from wakedeploy.gap.systems.likelihood import logs
from wakedeploy.gap.systems.likelihood.blocks import logs_of
from wakedeploy.gap.systems.likelihood.filter import Inputs
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.sensitivity import column_notes

RATE = 100.0
ALL = [Port.input("force_n"), Port.force("speed_mps", inertia="mass_kg")]


class Mass(System):
    rate_hz = RATE
    inputs = [Input("force_n", "N")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-3)]
    constants = [
        Constant("mass_kg", 2.0, spread=0.05),
        Constant("spring_n_per_m", 30.0, spread=1.0),
        Constant("damping_n_per_mps", 3.0, spread=0.1),
    ]
    ports = [
        Port.input("force_n", kinds=["dead-time", "lag", "dead-band", "gain", "bias"]),
        Port.force(
            "speed_mps",
            inertia="mass_kg",
            position="position_m",
            kinds=["coulomb-friction", "quadratic-drag", "cubic-stiffness", "offset"],
        ),
        Port.output("position_m", kinds=["sensor-bias", "sensor-lag"]),
    ]

    def derivative(self, state, inputs, c):
        force = (
            inputs.force_n
            - c.spring_n_per_m * state.position_m
            - c.damping_n_per_mps * state.speed_mps
        )
        return {"position_m": state.speed_mps, "speed_mps": force / c.mass_kg}


def recorded(seed, delay_s=0.0, friction_n=0.0, seconds=40.0, driven=1.0):
    """The mass, integrated here in fine steps, with force noise and a noisy sensor.

    It is driven for a share of the time, then left alone.
    """
    rng = np.random.default_rng(seed)
    n, fine = int(seconds * RATE), 10
    held = np.repeat(rng.standard_normal(n // 25 + 1) * 15.0, 25)[:n]
    held[int(driven * n) :] = 0.0
    late = np.repeat(held, fine)
    shift = round(delay_s * RATE * fine)
    late = np.concatenate([np.full(shift, late[0]), late[: len(late) - shift]])
    x, v, shown = 0.0, 0.0, np.empty(n)
    dt = 1.0 / RATE / fine
    for k in range(n * fine):
        if k % fine == 0:
            shown[k // fine] = x
            push = rng.standard_normal() * 0.3 * (k < driven * n * fine)
        a = (late[k] + push - 30.0 * x - 3.0 * v - friction_n * np.tanh(v / 0.005)) / 2.0
        v += a * dt
        x += v * dt
    shown = shown + 1e-3 * rng.standard_normal(n)
    return Recording(f"made {seed}", np.arange(n) / RATE, {"force_n": held, "position_m": shown})


def test_what_confirms_an_answer_moves():
    """A log that goes on after the motion would be judged by blocks in which nothing happens."""

    class Plain(Mass):
        ports = [
            Port.input("force_n", kinds=["dead-time", "dead-band"]),
            Port.force("speed_mps", inertia="mass_kg", kinds=["coulomb-friction"]),
        ]

    model = LogModel(Plain(), [recorded(1, friction_n=2.0, driven=0.5)])
    assert model.sealed() == (7, 8)
    base = fitted_base(model)
    found = named(model, base).found
    assert found.hypothesis == ("coulomb-friction@speed_mps",)
    assert found.value("coulomb-friction@speed_mps.force") == pytest.approx(2.0, rel=0.2)


def test_a_pause_between_motions_confirms_nothing():
    """Nor does one stray reading in a log that stands still."""
    moved = recorded(1, driven=0.4)
    at_end = recorded(2, seconds=4.0).columns["position_m"]
    parked = moved.columns["position_m"].copy()
    parked[-100:] += at_end[:100]
    parked[2500] += 5.0
    columns = {**moved.columns, "position_m": parked}
    model = LogModel(Mass(), [Recording("parked", moved.time_s, columns)])
    assert model.sealed() == (8, 15)


def test_what_inputs_do_with_an_effect_is_what_its_size_says():
    model = LogModel(Mass(), [recorded(1, seconds=4.0)])
    wider = LogModel(type("Wider", (Mass,), {"ports": ALL})(), [recorded(1, seconds=4.0)])
    model.offer(wider.library)
    for name, size, share in (("gain@force_n", -0.6, 0.4), ("added-inertia@speed_mps", 1.5, 0.4)):
        values = neutral(model.free((name,)))
        values[-1] = size
        fitted = SimpleNamespace(value=model.values((name,), values).get)
        assert model.inputs_answered(fitted, name) == pytest.approx(share)


@pytest.mark.parametrize(
    ("more", "also", "share"),
    [
        ({"speed_mps": "m/s"}, (), 1.0),  # the speed answers: no force holds the mass
        ({"speed_mps": "m/s"}, ("sensor-gain@speed_mps",), 0.1),  # it answers by less, too
        ({"doubled_m": "m"}, (), 1.0),
        ({"force_shown_n": "N"}, (), 0.1),
        ({}, (), 0.1),
    ],
)
def test_a_sensor_s_gain_looks_like_a_held_force_only_where_no_other_shows_the_motion(
    more, also, share
):
    class Shown(Mass):
        outputs = [*Mass.outputs, *(Output(name, unit) for name, unit in more.items())]
        ports = [Port.output(output.name) for output in outputs]

        def measure(self, state, inputs, c):
            known = {"doubled_m": 2.0 * state.position_m, "force_shown_n": inputs.force_n}
            return {name: known[name] for name in more if name in known}

    made = recorded(1, seconds=4.0)
    columns = {**made.columns, **dict.fromkeys(more, made.columns["position_m"])}
    model = LogModel(Shown(), [Recording("made", made.time_s, columns)])
    name = "sensor-gain@position_m"
    values = {f"{each}.error": -0.9 for each in (name, *also)}
    fitted = SimpleNamespace(value=values.get, hypothesis=(name, *also))
    assert model.inputs_answered(fitted, name) == pytest.approx(share)


@pytest.mark.parametrize("driven", [1.0, 0.9, 0.1])
def test_the_last_quarter_confirms_where_it_moves_and_where_hardly_anything_does(driven):
    model = LogModel(Mass(), [recorded(1, friction_n=2.0, driven=driven)])
    assert model.sealed() == (12, 13, 14, 15)


def test_a_system_that_costs_by_point_is_asked_for_nothing_ahead():
    class Slow(Mass):
        costs_by_point = True

    asked = []
    for system in (Mass(), Slow()):
        model = LogModel(system, [recorded(3, seconds=5.0)])
        sets, scores = [], model.scores

        def counted(hypothesis, thetas, episodes, scores=scores, sets=sets):
            sets.append(len(thetas))
            return scores(hypothesis, thetas, episodes)

        model.scores = counted
        asked.append((fit(model, (), range(3)).theta, sets))
    (there, ahead), (here, alone) = asked
    assert len(ahead) < len(alone)
    assert sum(ahead) > sum(alone)
    assert there == pytest.approx(here, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("begins", [None, np.array([0, 300])])
@pytest.mark.parametrize("steps", [1, 3, 100])
def test_inputs_gathered_along_the_way_are_those_of_each_step(steps, begins):
    rng = np.random.default_rng(0)
    alike = np.broadcast_to(rng.standard_normal((2, 600 * steps)), (2, 2, 600 * steps))
    columns = {"u": rng.standard_normal((2, 2, 600 * steps)), "v": alike}
    inputs = Inputs(columns, None if begins is None else steps * begins)
    at = np.arange(150)[:, None] + np.array([0, 300, 420])
    gathered = inputs.along(at, steps)
    for here in at:
        for j in range(steps):
            alone, one = inputs.at(np.arange(2)[:, None], steps * here + j), next(gathered)
            for part, same in ((alone.mean, one.mean), (alone.early, one.early),
                               (alone.before, one.before)):  # fmt: skip
                assert {n: v.tolist() for n, v in part.items()} == {
                    n: v.tolist() for n, v in same.items()
                }
    assert next(gathered, None) is None


def test_a_constant_is_moved_by_little_of_itself_where_its_spread_is_wide():
    """Slopes over a step as large as the constant send the climb nowhere."""

    class Loose(Mass):
        constants = [Constant("mass_kg", 2.0, spread=5.0), *Mass.constants[1:]]

    (mass,) = [f for f in LogModel(Loose(), [recorded(0)]).free(()) if f.quantity == "mass_kg"]
    assert (mass.prior_sd, mass.step) == (5.0, pytest.approx(0.02))


def test_a_reading_between_a_system_s_samples_counts_at_the_next():
    """A sensor whose ticks are not the system's: none of its readings is lost, or used twice."""
    rows = np.arange(400)
    y = np.where(rows % 10 == 3, np.sin(rows / 50.0), np.nan)
    columns = {"force_n": np.cos(rows), "position_m": y}
    system = type("Thinned", (Mass,), {"rate_hz": 25.0})()
    (log,) = logs_of(system, [Recording("log", rows / 100.0, columns)])
    assert np.array_equal(log.outputs[0][np.isfinite(log.outputs[0])], y[np.isfinite(y)])


@pytest.mark.parametrize("name", ["force_n", "position_m"])
@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_an_infinite_value_is_refused_by_column_and_sample(name, value):
    """It was held like one that was not measured; a column that nobody asks for may have it."""
    made = recorded(0)
    logs_of(
        Mass(),
        [
            Recording(
                "made", made.time_s, {**made.columns, "note": np.full(len(made.time_s), value)}
            )
        ],
    )
    column = made.columns[name].copy()
    column[7] = value
    with pytest.raises(
        UnusableInput, match=rf"made: column '{name}' is infinite at sample 7, 0.07 s; "
    ):
        logs_of(Mass(), [Recording("made", made.time_s, {**made.columns, name: column})])


def test_a_sensor_that_hangs_is_no_log_to_search_in():
    rows = np.arange(400)
    hung = {"force_n": np.cos(rows), "position_m": np.where(rows % 3, 3.21, np.nan)}
    log = Recording("hung", rows / RATE, hung)
    with pytest.raises(
        UnusableInput, match=r"no output moves in these logs \('position_m'\); mend"
    ):
        LogModel(Mass(), [log]).require_effects()
    moving = Recording("moving", rows / RATE, hung | {"position_m": np.sin(rows / 50.0)})
    LogModel(Mass(), [log, moving]).require_effects()


def test_an_axis_that_rests_is_replayed_and_asked_for_what_makes_sense_there():
    class Both(Mass):
        states = {**Mass.states, "turn_rad": "rad"}
        outputs = [*Mass.outputs, Output("turn_rad", "rad")]
        ports = [*Mass.ports, Port.output("turn_rad")]

        def derivative(self, state, inputs, c):
            return {**super().derivative(state, inputs, c), "turn_rad": 0.0 * state.turn_rad}

    recording = recorded(1, seconds=20.0)
    columns = {**recording.columns, "turn_rad": np.zeros(len(recording.time_s))}
    model = LogModel(Both(), [replace(recording, columns=columns)])
    model.require_effects()
    assert "coulomb-friction@speed_mps" in model.effects
    assert np.isfinite(fit(model, (), range(model.episodes)).objective)
    assert np.all(Both().simulate(replace(recording, columns=columns))["turn_rad"] == 0.0)


def test_first_guesses_and_forecasts_are_without_far_strays():
    recording, rng = recorded(1, seconds=20.0), np.random.default_rng(3)
    strays = rng.random(len(recording.time_s)) < 0.01
    y = recording.columns["position_m"].copy()
    y[strays] += rng.choice([-1.0, 1.0], strays.sum()) * rng.uniform(3.0, 9.0, strays.sum())
    strayed = replace(recording, columns={**recording.columns, "position_m": y})
    robust = type("Robust", (Mass,), {"outlier_share": 0.02})
    clean, model = LogModel(Mass(), [recording]), LogModel(robust(), [strayed])
    left_out = np.isnan(model.logs[0].outputs[0])
    assert np.array_equal(left_out, strays)
    for name, size in clean.sizes.items():
        assert model.sizes[name] == pytest.approx(size, rel=0.1, abs=1e-3), name
    assert np.isfinite(LogModel(robust(), [recording]).logs[0].outputs).all()
    (note,) = [n for n in column_notes(model) if "outlier_share" in n]
    assert f"output position_m: {strays.sum()} readings that stood alone, far from" in note


class Servo(Mass):
    """A joint that its spring holds at a command."""

    inputs = [Input("command_m", "m")]
    ports = [Port.input("command_m"), Port.force("speed_mps")]

    def derivative(self, state, inputs, c):
        pull = 400.0 * (inputs.command_m - state.position_m) - 40.0 * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": pull}


def test_parts_of_a_rate_are_those_that_hold_against_each_other():
    """Of a joint that follows a slow sine, 400 (0.5² + 0.5²)^½, although its rate is near 0."""
    time_s = np.arange(2000) / 100.0
    command_m = np.sin(2.0 * np.pi * 0.1 * time_s) / np.sqrt(2.0)
    columns = {"command_m": command_m, "position_m": command_m}
    sizes = LogModel(Servo(), [Recording("slow", time_s, columns)]).sizes
    assert sizes["d speed_mps"] < 15.0
    assert sizes["parts speed_mps"] == pytest.approx(400.0 * np.sqrt(0.5), rel=0.05)
    assert sizes["parts position_m"] == pytest.approx(sizes["d position_m"])


def test_a_fast_event_is_no_stray_and_no_more_are_left_out_than_stated():
    """A ring-down of half a metre at 12 Hz, amid rest: 77 of its readings were once left out."""
    rng, rows = np.random.default_rng(0), np.arange(4000)
    since = (rows % 1000) / RATE
    ringing = 0.5 * np.exp(-since / 0.15) * np.sin(2.0 * np.pi * 12.0 * since)
    y = ringing + 1e-3 * rng.standard_normal(len(rows))
    columns = {"force_n": np.cos(rows), "position_m": y}
    log = Recording("tapped", rows / RATE, columns)
    robust = type("Robust", (Mass,), {"outlier_share": 0.001})
    assert LogModel(robust(), [log]).strays == {"position_m": 0}
    jumping = np.where(rows % 50 == 7, 9.0, y)
    model = LogModel(robust(), [replace(log, columns=columns | {"position_m": jumping})])
    assert model.strays == {"position_m": 4}


@pytest.mark.whole
def test_strays_however_far_say_nothing_of_the_others():
    """A tracker that jumps by metres: noise, constants and what follows stay those of the rest."""
    recording, rng = recorded(1, seconds=20.0), np.random.default_rng(3)
    strays = rng.random(len(recording.time_s)) < 0.01
    y = recording.columns["position_m"].copy()
    y[strays] += rng.uniform(-5.0, 5.0, strays.sum())
    columns = {**recording.columns, "position_m": y}
    strayed = Recording("strayed", recording.time_s, columns)
    robust = type("Robust", (Mass,), {"outlier_share": 0.02})
    clean, fitted = (
        fit(model, (), range(model.episodes))
        for model in (LogModel(Mass(), [recording]), LogModel(robust(), [strayed]))
    )
    for name in ("constant.mass_kg", "constant.spring_n_per_m", "constant.damping_n_per_mps"):
        assert abs(fitted.value(name) - clean.value(name)) < clean.standard_error(name)
    assert fitted.value("noise.position_m") == pytest.approx(
        clean.value("noise.position_m"), abs=0.15
    )


def test_the_last_reading_of_a_slow_sensor_is_the_newest_that_was_measured():
    """Without a model a forecast is the last reading, which seldom lies where a forecast begins."""
    rows = np.arange(800)
    y = np.where(rows % 10 == 3, np.sin(rows / 50.0), np.nan)
    columns = {"force_n": np.cos(rows), "position_m": y}
    model = LogModel(Mass(), [Recording("log", rows / RATE, columns)])
    last, mean = model.held(range(model.episodes))
    for block, forecast, flat in zip(model.blocks, last, mean, strict=True):
        for k, error in enumerate(forecast[0]):
            begin = block.start + k // model.horizon * model.horizon
            known = [v for v in y[: begin + 1] if np.isfinite(v)]
            newest = known[-1] if known else np.nanmean(y)
            assert error == pytest.approx(y[block.start + k] - newest, nan_ok=True)
        assert np.array_equal(np.isfinite(forecast), np.isfinite(flat))


def test_a_linear_system_has_the_likelihood_of_a_kalman_filter():
    recording = recorded(0, seconds=3.0)
    model = LogModel(Mass(), [recording])
    theta = neutral(model.free(()))
    values = model.values((), theta)
    run = model.run((), theta[None], range(model.episodes))
    a = np.array([[0.0, 1.0], [-15.0, -1.5]])
    big = np.zeros((3, 3))
    big[:2] = np.column_stack([a, [0.0, 0.5]])
    step = expm(big / RATE)
    lain = np.zeros((4, 4))
    lain[:2, :2], lain[2:, 2:] = -a, a.T
    lain[1, 3] = np.exp(2 * values["force.speed_mps"]) / RATE
    whole = expm(lain / RATE)
    f = KalmanFilter(dim_x=3, dim_z=1, dim_u=1)
    push = np.exp(values["push.speed_mps"])
    keep = np.exp(-1.0 / RATE / np.exp(values["lasting.speed_mps"]))
    held = step[:2, 2:] * 2.0  # what is held of an acceleration, from what is held of a force
    f.F = np.block([[step[:2, :2], held], [np.zeros((1, 2)), np.array([[keep]])]])
    f.B, f.H = np.vstack([step[:2, 2:], [[0.0]]]), np.array([[1.0, 0.0, 0.0]])
    f.Q = np.zeros((3, 3))
    f.Q[:2, :2], f.Q[2, 2] = whole[2:, 2:].T @ whole[:2, 2:], push**2 * (1.0 - keep**2)
    f.R = np.array([[np.exp(2 * values["noise.position_m"])]])
    f.x = np.vstack([model._starts[0].states[:, :1], [[0.0]]])
    f.P = np.diag([*model._starts[0].spread ** 2, push**2])
    first = run.statistics[:, :, 0, 0, 0]
    for k in range(model.blocks[0].stop):
        f.update(recording.columns["position_m"][k])
        assert first[0, k] == pytest.approx(f.y[0, 0], abs=1e-9, rel=1e-6)
        assert first[1, k] == pytest.approx(f.S[0, 0], rel=1e-6)
        assert first[2, k] == pytest.approx(f.log_likelihood, rel=1e-6, abs=1e-6)
        f.predict(recording.columns["force_n"][k])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "name", "parameter", "truth"),
    [
        ({"delay_s": 0.02}, "dead-time@force_n", "delay_s", 0.02),
        ({"friction_n": 2.0}, "coulomb-friction@speed_mps", "force", 2.0),
    ],
)
def test_a_hidden_effect_is_named_with_its_size(hidden, name, parameter, truth):
    model = LogModel(Mass(), [recorded(1, **hidden)])
    told = named(model, fitted_base(model))
    assert told.found.hypothesis == (name,)
    low, high = told.found.interval(f"{name}.{parameter}")
    clock = model.dt_s / 2 if parameter == "delay_s" else 0.0
    assert low - clock <= truth <= high + clock
    assert told.weights[name].low > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_where_nothing_is_hidden_nothing_is_named(seed):
    model = LogModel(Mass(), [recorded(seed, seconds=20.0)])
    assert verdict_of(named(model, fitted_base(model))) == "none"


@pytest.mark.slow
@pytest.mark.parametrize(("friction_n", "nothing"), [(0.0, True), (2.0, False)])
def test_a_size_that_may_be_zero_is_no_effect(friction_n, nothing):
    model, name = (
        LogModel(Mass(), [recorded(3, friction_n=friction_n)]),
        "coulomb-friction@speed_mps",
    )
    base = fitted_base(model)
    start = extended(base, model.free((name,)))
    assert is_nothing(fit(model, (name,), base.episodes, start), name) == nothing


@pytest.mark.slow
def test_a_long_log_is_searched_in_part_and_told_from_all_of_it(monkeypatch):
    recording = recorded(3, delay_s=0.03)
    whole = LogModel(Mass(), [recording])
    assert whole.thinned() is whole
    monkeypatch.setattr(logs, "_SEARCHED", 3000)
    part = whole.thinned()
    theta = neutral(whole.free(()))
    for episode in (0, 5):
        every, some = (model.score((), theta, episode) for model in (whole, part))
        count = len(some.innovation)
        assert 0 < count < 0.6 * len(every.innovation)
        assert np.allclose(some.innovation, every.innovation[:count], rtol=1e-9)
    told = named(whole, fitted_base(whole))
    assert told.found.hypothesis == ("dead-time@force_n",)
    low, high = told.found.interval("dead-time@force_n.delay_s")
    assert low < 0.03 < high
    looked = [np.count_nonzero(s.log_density) for s in told.found.slopes.scores]
    assert min(looked[1:]) == len(recording.time_s) // 16


class Remembering(System):
    """A second-order difference equation: what it remembers of the sample before is exact."""

    rate_hz = 10.0
    inputs = [Input("valve", "1")]
    states = {"level": "1", "level_before": "1", "valve_before": "1", "worn": "1"}
    outputs = [Output("level", "1", noise=0.05)]
    constants = [Constant("keep", 1.2, spread=1.0), Constant("lose", 0.4, spread=1.0)]
    ports = [Port.input("valve"), Port.force("level")]

    def step(self, state, inputs, c):
        level = c.keep * state.level - c.lose * state.level_before
        return {
            "level": level + 0.3 * inputs.valve + 0.1 * state.valve_before - 0.01 * state.worn,
            "level_before": state.level,
            "valve_before": inputs.valve,
            "worn": 0.999 * state.worn,
        }


def test_what_a_discrete_system_remembers_is_disturbed_by_nothing():
    rng = np.random.default_rng(4)
    columns = {"valve": np.repeat(rng.normal(size=60), 5), "level": rng.normal(size=300)}
    model = LogModel(Remembering(), [Recording("log", np.arange(300) / 10.0, columns)])
    assert Remembering().remembered() == {"level_before": "level", "valve_before": "valve"}
    assert model.driven == ("level", "worn")
    disturbed = {f.name.rpartition(".")[2] for f in model.free(()) if f.name.startswith("force.")}
    assert disturbed == {"level", "worn"}
    assert Mass().remembered() == {}  # of rates, kinematic states are the same


class Gained(Remembering):
    """Three states that seem to be remembered, and are not; and one that is, and errs."""

    constants = [*Remembering.constants, Constant("gain", 1.0, spread=0.2)]

    def step(self, state, inputs, c):
        told = super().step(state, inputs, c)
        cut = np.clip(inputs.valve, -5.0, 5.0)
        return {**told, "valve_before": c.gain * inputs.valve, "worn": cut}


def test_a_gain_of_one_and_a_limit_remember_nothing():
    assert Gained().remembered() == {"level_before": "level"}


class Stated(Remembering):
    """A memory that the user says is noisy."""

    process_noise = {"valve_before": 0.3}
    ports = [Port.input("valve"), Port.force("level"), Port.force("level_before")]


class Copies(System):
    """A speed that follows its command at once: nothing but memory."""

    rate_hz = 10.0
    inputs = [Input("command_mps", "m/s")]
    states = {"speed_mps": "m/s"}
    outputs = [Output("speed_mps", "m/s", noise=0.01)]
    ports = [Port.input("command_mps"), Port.force("speed_mps")]

    def step(self, state, inputs, c):
        return {"speed_mps": inputs.command_mps}


def test_a_memory_has_noise_where_it_is_stated_where_forces_act_and_where_nothing_else_has_any():
    rng = np.random.default_rng(4)
    columns = {"valve": rng.normal(size=300), "level": rng.normal(size=300)}
    recording = Recording("log", np.arange(300) / 10.0, columns)
    driven = LogModel(Stated(), [recording]).driven
    assert driven == ("level", "level_before", "valve_before", "worn")
    columns = {"command_mps": rng.normal(size=300), "speed_mps": rng.normal(size=300)}
    recording = Recording("log", np.arange(300) / 10.0, columns)
    assert LogModel(Copies(), [recording]).driven == ("speed_mps",)
