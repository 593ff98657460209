"""What logs can tell, and which input tells more: held against logs that are made and fitted."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import cont2discrete, lfilter, ss2tf

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import extended
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.search.artefacts import VERSION
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.excitation import MENU
from wakedeploy.gap.systems.planning.known import stated_answer, stated_sizes
from wakedeploy.gap.systems.planning.plan import (
    Option,
    Plan,
    _centres,
    _worth_judging,
    plan,
    require_names,
)
from wakedeploy.gap.systems.planning.planned import planned
from wakedeploy.gap.systems.planning.power import _missing, chance, power
from wakedeploy.gap.wording import span

RATE = 50.0
DRAG, LAG, DEAD_TIME = "viscous-friction@speed_mps", "lag@force_n", "dead-time@force_n"


class Mass(System):
    rate_hz = RATE
    inputs = [Input("force_n", "N", low=-20.0, high=20.0)]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", 2.0)]
    ports = [
        Port.input("force_n", kinds=["dead-time", "lag"]),
        Port.force("speed_mps", inertia="mass_kg", position="position_m",
                   kinds=["viscous-friction", "coulomb-friction"]),
    ]  # fmt: skip

    def derivative(self, state, inputs, c):
        force = inputs.force_n - 30.0 * state.position_m - 3.0 * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": force / c.mass_kg}


def recorded(seed: int, drag: float = 0.0) -> Recording:
    """The mass with a little more damping, stepped exactly, with noise on force and sensor."""
    random = np.random.default_rng(seed)
    force = np.repeat(random.standard_normal(40) * 8.0, 20)
    a = np.array([[0.0, 1.0], [-15.0, -(3.0 + drag) / 2.0]])
    b, c, d = np.array([[0.0], [0.5]]), np.eye(2)[:1], np.zeros((1, 1))
    phi, gamma, *_ = cont2discrete((a, b, c, d), 1.0 / RATE)
    above, below = ss2tf(phi, gamma, c, d)
    shown = lfilter(above[0], below, force + 0.3 * random.standard_normal(len(force)))
    shown += 1e-3 * random.standard_normal(len(force))
    return Recording("made", np.arange(len(force)) / RATE, {"force_n": force, "position_m": shown})


@pytest.fixture(scope="module")
def model() -> LogModel:
    return LogModel(Mass(), [recorded(0)])


@pytest.fixture(scope="module")
def base(model: LogModel):
    return fitted_base(model)


@pytest.mark.slow
def test_an_effect_of_the_size_that_is_told_gains_what_was_told(model, base) -> None:
    """Mean gain of fits to logs that have it: the threshold, and what makes it sure beside it."""
    told = power(model, base, (DRAG,))
    size = told.effects[0].detected
    gains = []
    for seed in range(4):
        other = LogModel(Mass(), [recorded(10 + seed, drag=size)])
        start = fit(other, (), base.episodes, extended(base, other.free(())))
        free = other.free((DRAG,))
        with_it = extended(start, free)
        gains.append(fit(other, (DRAG,), base.episodes, with_it).objective - start.objective)
    wanted = told.threshold_nats + 1.0
    assert np.mean(gains) == pytest.approx(wanted + 0.8416 * np.sqrt(2 * wanted), rel=0.5)
    assert told.effects[0].matters < size


def test_logs_that_lack_something_already_say_so(model, base) -> None:
    """Sizes are beside the noise of a model without it; beside what was found, they are smaller."""
    assert power(model, base, (DRAG,)).missing is None
    lacking = LogModel(Mass(), [recorded(0, drag=1.5)])
    begun = fitted_base(lacking)
    without = power(lacking, begun, (DRAG, LAG))
    assert without.missing is not None
    assert without.missing[0] == DRAG
    start = extended(begun, lacking.free((DRAG,)))
    found = fit(lacking, (DRAG,), begun.episodes, start)
    gained = found.objective - begun.objective
    assert 0.3 * gained < without.missing[1] < 1.1 * gained  # by the noise of a model without it
    beside = power(lacking, found, (DRAG, LAG))
    assert [e.name for e in beside.effects] == [LAG]
    assert beside.missing is None
    assert beside.effects[0].detected < without.effects[1].detected


def test_sizes_are_tried_up_to_where_an_effect_is_as_large_as_all_else(model, base) -> None:
    (drag,) = power(model, base, (DRAG,)).effects
    starts = model.effects[DRAG][0].starts
    assert drag.largest >= 3.0 * max(starts)


class Motor(System):
    """Its speed follows a command within a time that is roughly known."""

    rate_hz = RATE
    inputs = [Input("command", "rad/s")]
    states = {"speed": "rad/s"}
    outputs = [Output("speed", "rad/s", noise=0.01)]
    constants = [Constant("lag_s", 0.2, spread=0.1)]
    ports = [
        Port.input("command", kinds=["gain"]),
        Port.force("speed", kinds=["viscous-friction"]),
    ]

    def derivative(self, state, inputs, c):
        return {"speed": (inputs.command - state.speed) / c.lag_s}


def test_a_size_of_either_sign_is_named_only_where_both_are() -> None:
    """With a friction b a motor ends at 1/(1 + b lag) of the command: a gain below one does so.

    Its time is shorter by as much, which a roughly known time may be. No friction looks like a gain
    above one.
    """
    command = np.repeat(np.random.default_rng(0).standard_normal(40) * 8.0, 20)
    share = np.exp(-1.0 / RATE / 0.2)
    speed = lfilter([0.0, 1.0 - share], [1.0, -share], command)
    speed += 1e-2 * np.random.default_rng(1).standard_normal(len(command))
    log = Recording("made", np.arange(len(command)) / RATE, {"command": command, "speed": speed})
    motor = LogModel(Motor(), [log])
    gain, friction = power(motor, fitted_base(motor)).effects
    assert (gain.name, gain.rival) == ("gain@command", "viscous-friction@speed")
    assert friction.named > 10.0 * friction.detected
    assert gain.named == pytest.approx(0.2 * friction.named, rel=0.3)  # 1 - 1/(1 + 0.2 b)


@pytest.mark.whole
def test_fast_jumps_tell_a_lag_from_a_dead_time(model, base) -> None:
    """Their phases part at high frequencies: slow motion looks the same with both."""
    sizes = {LAG: (0.03,), DEAD_TIME: (0.03,)}
    made = plan(model, base, (LAG, DEAD_TIME), sizes)
    nats = {o.excitation.name: o.nats for o in made.options}
    assert made.options[0].excitation.name == "fast-binary"
    assert nats["fast-binary"] > 5.0 * nats["triangle"]
    for option in made.options:
        assert np.abs(option.columns["force_n"]).max() <= 20.0
        seen = np.ptp(model.logs[0].outputs[0])
        assert np.ptp(option.columns["position_m"]) <= 1.5 * seen


def test_options_of_a_rig_and_of_a_system_do_not_mix() -> None:
    told = CliRunner().invoke(main, ["gap", "plan", "--measured", "x.csv", "--class", "lag"])
    assert told.exit_code == 2
    assert "go with '--system'" in told.output


def test_sizes_come_from_a_whole_answer_of_the_same_system(model, tmp_path) -> None:
    """What `gap name` wrote is taken; what another program, or hand, left is refused by name."""
    sizes = {f"{DRAG}.coefficient": {"value": 0.2, "low": 0.1, "high": 0.3, "unit": "N/(m/s)"}}
    ranked = {"name": DRAG, "gain_nats": 9.0, "needed_nats": 3.0, "interval": [8.0, 10.0],
              "parameters": sizes}  # fmt: skip
    told = {
        "version": VERSION, "domain": "Mass", "verdict": "class", "class": [DRAG, LAG],
        "threshold_nats": 3.0, "effects": [], "parameters": {}, "constants": {}, "noise": {},
        "rounds": [{"given": [], "threshold_nats": 3.0, "steady_nats": 3.0, "ranking": [ranked]}],
        "unsettled": [], "sealed_gain_nats": 4.0,
    }  # fmt: skip

    def stated(**changes) -> dict[str, tuple[float, ...]]:
        (tmp_path / "name.json").write_text(json.dumps(told | changes))
        answer = stated_answer(tmp_path)
        return stated_sizes(tmp_path, answer, model, tuple(answer.rivals))

    def with_sizes(**size: object) -> list[object]:
        held = {key: value | size for key, value in sizes.items()} if size else {}
        ranking = [ranked | {"parameters": held}]
        return [{"given": [], "threshold_nats": 3.0, "steady_nats": 3.0, "ranking": ranking}]

    assert stated() == {DRAG: (0.2,)}
    for changes, says in (
        ({"rounds": 3}, "rounds = 3"),
        ({"class": None}, "class"),
        ({"class": ["wake"]}, "'wake' is no effect of Mass"),
        ({"rounds": with_sizes()}, f"{DRAG}.coefficient has no value between"),
        ({"rounds": with_sizes(value=None)}, "has no value between"),
        ({"rounds": with_sizes(value=1e12)}, "has no value between"),
    ):
        with pytest.raises(UnusableInput) as error:
            stated(**changes)
        assert str(error.value).startswith(f"{tmp_path / 'name.json'}: ")
        assert says in str(error.value)
        assert "run `wakedeploy gap name` anew" in str(error.value)


class Driven(Mass):
    """The same from a battery, whose voltage is measured and nobody sets."""

    inputs = [*Mass.inputs, Input("battery_v", "V", is_commanded=False)]


@pytest.mark.whole
def test_of_a_system_that_comes_back_by_itself_nothing_is_said_of_a_level(model, base) -> None:
    made = plan(model, base, (LAG, DEAD_TIME))
    assert not any(option.is_held for option in made.options)
    assert "be ready to stop it" not in planned(made, "Mass").sentence


@pytest.mark.parametrize(("mean", "is_held"), [(0.52, False), (0.7, True)])
def test_a_mean_next_to_the_middle_of_the_limits_is_the_middle(mean, is_held) -> None:
    limits = {"force_n": (0.0, 1.0, mean)}
    centres = _centres(limits, ("force_n",), 0.5)
    assert len(centres) == (2 if is_held else 1)
    assert centres[0] == {"force_n": 0.5}
    assert centres[-1]["force_n"] == pytest.approx(0.7 if is_held else 0.5)
    assert _centres(limits, ("force_n",), 1.0) == [{"force_n": 0.5}]  # has no room for another


def test_an_input_about_the_mean_stands_beside_the_same_about_the_middle_if_it_lasts_longer():
    """Which of both tells more is not decided by how long they last."""
    middle, longer, as_long = (
        Option(MENU[0], ("force_n",), share, seconds, 0.0, {}, {"force_n": 0.5}, is_held)
        for share, seconds, is_held in ((1.0, 8.0, False), (0.03, 60.0, True), (0.03, 8.0, True))
    )
    assert _worth_judging([middle, longer]) == [middle, longer]
    assert _worth_judging([as_long, middle]) == [middle]
    assert _worth_judging([longer]) == [longer]


@pytest.mark.whole
def test_only_inputs_that_can_be_commanded_are_moved() -> None:
    made = recorded(0)
    battery = 12.0 + 0.1 * np.sin(made.time_s)
    log = Recording("made", made.time_s, {**made.columns, "battery_v": battery})
    driven = LogModel(Driven(), [log])
    options = plan(driven, fitted_base(driven), (LAG, DEAD_TIME)).options
    assert {o.moved for o in options} == {("force_n",)}
    for option in options:
        assert np.ptp(option.columns["battery_v"]) == 0.0
        assert option.columns["battery_v"][0] == pytest.approx(battery.mean())


def test_a_system_that_nobody_commands_has_nothing_to_plan(model) -> None:
    held = type("Held", (Mass,), {"inputs": [Input("force_n", "N", is_commanded=False)]})
    with pytest.raises(UnusableInput, match="no input that can be commanded"):
        require_names(LogModel(held(), [recorded(0)]), (LAG,))


@pytest.mark.slow
def test_no_input_tells_a_delay_before_the_only_input_from_one_behind_the_only_output() -> None:
    """Whatever is recorded, both delay all of it; a fast input shows how each is computed."""
    behind = "sensor-dead-time@position_m"
    ports = [*Mass.ports, Port.output("position_m", kinds=["sensor-dead-time"])]
    late = LogModel(type("Late", (Mass,), {"ports": ports})(), [recorded(0)])
    base, sizes = fitted_base(late), {DEAD_TIME: (0.03,), behind: (0.03,), LAG: (0.03,)}
    made = plan(late, base, (DEAD_TIME, behind), sizes)
    assert made.alike == ((DEAD_TIME, behind),)
    assert made.best is None
    assert {option.nats for option in made.options} == {0.0}
    third = plan(late, base, (DEAD_TIME, behind, LAG), sizes)
    assert third.alike == ((DEAD_TIME, behind),)
    assert third.best is not None


@pytest.mark.parametrize(
    ("nats", "logged_nats", "is_worth_it"),
    [
        (8.0, 0.5, True),  # more than the present logs
        (0.02, 0.1, False),  # less, and hundreds of such logs would be needed
        (50.0, 60.0, True),  # less, and one such log decides it
        (0.0, 0.0, False),  # no number of logs is enough
    ],
)
def test_an_input_is_recommended_only_if_it_helps(nats, logged_nats, is_worth_it):
    option = Option(MENU[0], ("force_n",), 1.0, 6.0, nats, {})
    assert (Plan((LAG, DEAD_TIME), (option,), logged_nats).best is option) == is_worth_it
    assert Plan((LAG,), (), logged_nats).best is None


class Sinking(System):
    """A vehicle under water, heavier than that: a thruster holds it at its depth."""

    rate_hz = 10.0
    inputs = [Input("thrust_n", "N", low=-20.0, high=20.0)]
    states = {"depth_m": "m", "sink_mps": "m/s"}
    outputs = [Output("depth_m", "m", noise=5e-3)]
    constants = [Constant("mass_kg", 20.0)]
    ports = [Port.force("sink_mps", inertia="mass_kg", kinds=["viscous-friction"])]

    def derivative(self, state, inputs, c):
        force = 5.0 + inputs.thrust_n - 10.0 * state.sink_mps
        return {"depth_m": state.sink_mps, "sink_mps": force / c.mass_kg}


def test_inputs_go_up_and_down_from_what_holds_a_weight() -> None:
    """About the middle of the limits the weight alone carries it far away, whatever is added."""
    random = np.random.default_rng(0)
    wanted = np.repeat(random.uniform(1.0, 2.0, 10), 40)
    depth, sink, rows = 1.5, 0.0, []
    for goal in wanted:
        thrust = np.clip(30.0 * (goal - depth) - 30.0 * sink - 5.0, -20.0, 20.0)
        rows.append((thrust, depth))
        for _ in range(20):
            sink += (5.0 + thrust - 10.0 * sink) / 20.0 * 5e-3
            depth += sink * 5e-3
    thrusts, depths = np.array(rows).T
    depths += 5e-3 * random.standard_normal(len(depths))
    columns = {"thrust_n": thrusts, "depth_m": depths}
    held = LogModel(Sinking(), [Recording("made", np.arange(len(rows)) / 10.0, columns)])
    made = plan(held, fitted_base(held), ("viscous-friction@sink_mps",))
    assert made.best is not None
    assert made.best.about["thrust_n"] == pytest.approx(thrusts.mean())
    assert made.best.columns["thrust_n"].mean() == pytest.approx(-5.0, abs=0.5)
    told = planned(made, "Sinking").sentence
    assert "be ready to stop it, or add this to what a controller commands" in told
    low, high = (float(f(made.best.columns["thrust_n"])) for f in (np.min, np.max))
    assert f"{made.best.excitation.name} on thrust_n {span(low, high, 'N')} for" in told


def test_the_best_of_many_sizes_that_do_something_else_is_no_evidence() -> None:
    """Steps of a quantised input lie elsewhere at each size; of 288 one fits noise by chance."""
    random = np.random.default_rng(2)
    curves = {"quantisation@valve": 10.0 * random.standard_normal((24, 12, 200))}
    noise = random.standard_normal(200)
    assert _missing(curves, noise, chance(curves)) is None
    there = _missing(curves, noise + curves["quantisation@valve"][3, 5], chance(curves))
    assert there is not None
    assert there[0] == "quantisation@valve"
