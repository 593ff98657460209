"""What `gap check` says of a system and its logs, before any fit."""

import re
import warnings

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Origin, Recording
from wakedeploy.gap.search.artefacts import Quantity
from wakedeploy.gap.search.comparison import mean_squares
from wakedeploy.gap.search.weighing import weight_of
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.kinds.kind import Parameter, Scales
from wakedeploy.gap.systems.late_readings import in_time
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.power import power
from wakedeploy.gap.systems.sensitivity import (
    checked_base,
    column_notes,
    cut_outputs,
    hung_outputs,
    rows,
)


class Rail(System):
    """A carriage far from where its sensor counts from, so precise that any cut is seen."""

    rate_hz = 100.0
    inputs = [Input("force_n", "N")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-6)]
    constants = [Constant("mass_kg", 2.0, spread=0.1)]
    ports = [Port.output("position_m", kinds=["sensor-saturation", "sensor-bias"])]

    def derivative(self, state, inputs, c):
        return {"position_m": state.speed_mps, "speed_mps": inputs.force_n / c.mass_kg}


@pytest.fixture(scope="module")
def model():
    time_s = np.arange(400) / 100.0
    force = 8.0 * np.cos(4.0 * time_s)
    position = np.minimum(10.0 + 0.25 * (1.0 - np.cos(4.0 * time_s)), 10.45)
    return LogModel(Rail(), [Recording("made", time_s, {"force_n": force, "position_m": position})])


def test_a_sensor_s_limit_is_looked_for_at_its_largest_reading(model):
    (limit,) = model.effects["sensor-saturation@position_m"]
    assert limit.starts[0] == limit.low == 10.45 < limit.neutral
    assert limit.unit == "m"


@pytest.mark.whole
def test_no_effect_moves_outputs_by_more_than_they_could_move(model):
    """All samples off by the whole range are 400 times 0.5 m over the noise, together."""
    told = {row.name: row for row in rows(model, checked_base(model))}
    assert told["sensor-saturation@position_m"].moved < 1e9


@pytest.mark.whole
def test_a_limit_has_no_size_from_which_it_would_be_named(model):
    base = checked_base(model)
    assert [e.name for e in power(model, base).effects] == ["sensor-bias@position_m"]
    with pytest.raises(UnusableInput, match="sensor-saturation@position_m has no size"):
        power(model, base, ["sensor-saturation@position_m"])


def test_a_reading_is_cut_after_all_else_that_is_wrong_with_it(model):
    names = ["sensor-saturation@position_m", "sensor-bias@position_m"]
    values = {f"{names[0]}.limit": np.array([10.45]), f"{names[1]}.bias": np.array([0.2])}
    told = []
    for order in (names, names[::-1]):
        acting = Acting(model.system, [model.library[n] for n in order], model.sizes)
        told.append(model.filter.free_run(acting, values)[1][0])
    assert told[0].max() == told[1].max() == 10.45


@pytest.mark.parametrize(
    ("of", "unit"),
    [
        ({"force": 1}, "N"),
        ({"force": 1, "speed": -1}, "N/(m/s)"),
        ({"force": 1, "speed": -2}, "N/(m/s)²"),
        ({"force": 1, "position": -3}, "N/m³"),
        ({"force": 1, "speed": -2, "position": -1}, "N/((m/s)² m)"),
        ({"time": 1, "input": -1}, "s/V"),
        ({"span": -1}, "1/s"),
        ({}, "1"),
    ],
)
def test_a_unit_says_what_is_divided_by_what(of, unit):
    units = {"force": "N", "speed": "m/s", "position": "m", "time": "s", "span": "s", "input": "V"}
    assert Parameter("one", of).unit(Scales({}, units)) == unit


class Valve(System):
    """A valve that follows its command, and what it lets through; nobody measures the valve."""

    rate_hz = 100.0
    inputs = [Input("command_pct", "1", low=-0.9, high=0.9)]
    states = {"opening": "1", "flow": "1"}
    outputs = [Output("flow", "1", noise=1e-3)]
    constants = [
        Constant("valve_s", 0.05),
        Constant("flow_s", 0.3, spread=0.1),
        Constant("leak", 0.1, spread=0.2, unit="1"),
    ]

    def derivative(self, state, inputs, c):
        opening = (inputs.command_pct - state.opening) / c.valve_s
        return {"opening": opening, "flow": (state.opening + c.leak - state.flow) / c.flow_s}


def _notes(begins: float, **changes: object) -> str:
    """What is said of logs whose command is a share, or begins and goes on in percent."""
    return "\n".join(column_notes(LogModel(_valve(**changes), [_swung(begins)])))


def _valve(**changes: object) -> Valve:
    return type("Valve", (Valve,), changes)()


def _swung(begins: float) -> Recording:
    time_s = np.arange(400) / 100.0
    columns = {"command_pct": begins + 0.5 * np.sin(time_s), "flow": 0.2 + 0.1 * np.sin(time_s)}
    return Recording("made", time_s, columns)


class Integrating(Valve):
    """The same with a valve that a motor turns as long as it has a command."""

    def derivative(self, state, inputs, c):
        return {**Valve.derivative(self, state, inputs, c), "opening": inputs.command_pct}


class Lifting(Valve):
    """The same, whose valve is also lifted by what flows."""

    def derivative(self, state, inputs, c):
        return {**Valve.derivative(self, state, inputs, c), "lift_mm": state.flow - state.lift_mm}


def test_a_state_that_nobody_tells_and_that_does_not_rest_is_told() -> None:
    assert "state opening: no output shows it" in _notes(0.4, derivative=Integrating.derivative)
    assert "no output shows it" not in _notes(0.4)  # it begins where the command holds it
    spread = {"start_spread": {"opening": 0.5}}
    assert "no output shows it" not in _notes(0.4, derivative=Integrating.derivative, **spread)
    given = {"start": lambda system, measured: {"opening": measured.flow}}
    assert "no output shows it" not in _notes(0.4, derivative=Integrating.derivative, **given)


def test_an_input_far_beyond_its_limits_is_told_and_a_little_beyond_is_not() -> None:
    assert "from 39.62 to 40.5, far beyond the limits that it states, −0.9 to 0.9" in _notes(40.0)
    assert "far beyond" not in _notes(0.5)


def test_a_name_that_says_another_unit_is_told() -> None:
    assert "input command_pct is taken without a unit, and its name says %" in _notes(0.0)
    right = {"inputs": [Input("command_pct", "%")]}
    assert "its name says" not in _notes(0.0, **right)


def test_a_constant_or_a_state_whose_name_says_another_unit_is_told() -> None:
    """A mass of 2 kg that is stated in g is fitted, and a force told, in what nobody meant."""
    constants = [Constant("bore_mm", 2.0, spread=0.1, unit="m")]
    assert "constant bore_mm is taken in m, and its name says mm" in _notes(
        0.0, constants=[*Valve.constants, *constants]
    )
    lifted = {"states": {**Valve.states, "lift_mm": "m"}, "derivative": Lifting.derivative}
    assert "state lift_mm is taken in m, and its name says mm" in _notes(0.0, **lifted)
    right = {"constants": [*Valve.constants, Constant("bore_mm", 2.0, spread=0.1)]}
    assert "bore_mm" not in _notes(0.0, **right)


def test_an_output_in_another_unit_than_the_state_that_it_is_is_refused() -> None:
    class Rule(Rail):
        outputs = [Output("position_m", "mm", noise=1e-3)]

    says = "output 'position_m' is the state of that name, which is in m, and not in mm"
    with pytest.raises(UnusableInput, match=says):
        checked(Rule())

    class Converted(Rule):
        def measure(self, state, inputs, c):
            return {"position_m": 1e3 * state.position_m}

    assert checked(Converted()).outputs[0].unit == "mm"


def test_an_input_that_is_never_near_zero_may_have_another_rest() -> None:
    """As a servo's pulses do; of a command that crosses 0, or comes near it, nothing is said.

    Nor of one at which no effect may act, as a battery's voltage.
    """
    pulses = {"inputs": [Input("command_pct", "%", low=1000.0, high=2000.0)]}
    assert "never near 0" not in _notes(1500.0, **pulses)
    told = _notes(1500.0, **pulses, ports=[Port.input("command_pct")])
    assert "input command_pct is never near 0: from 1500 to 1500 %" in told
    assert "by offset in [columns.command_pct] of columns.toml" in told
    for begins in (0.0, 0.6):
        assert "never near 0" not in _notes(begins)


@pytest.mark.parametrize(("begins_s", "lasts_s", "at", "said"), [
    (2.0, 1.5, 0.3, True),
    (2.0, 0.1, 0.3, False),
    (2.0, 1.5, 0.0, False),
    (2.0, 1.5, 0.9, False),  # where it is cut, perhaps
    (0.0, 1.5, 0.3, False),  # before its first command
])  # fmt: skip
def test_a_command_that_stands_still_amidst_the_others_is_told(begins_s, lasts_s, at, said) -> None:
    log = _swung(0.4)
    columns = {name: np.array(values) for name, values in log.columns.items()}
    time_s = log.time_s - log.time_s[0]
    columns["command_pct"][(time_s >= begins_s) & (time_s < begins_s + lasts_s)] = at
    notes = "\n".join(column_notes(LogModel(_valve(), [Recording("swung", log.time_s, columns)])))
    told = (
        "input command_pct stands at 0.3 in swung for 1.5 s, from 2 s after its start, and seldom"
    )
    assert (told in notes) == said
    assert ("stands at" in notes) == said


def test_what_holds_of_several_logs_is_said_once() -> None:
    """Five episodes of one task, with a rest in each: it was said five times."""
    log = _swung(0.4)
    columns = {name: np.array(values) for name, values in log.columns.items()}
    columns["command_pct"][200:350] = 0.3
    columns["flow"][7] = np.nan
    logs = [Recording(f"episode {k}", log.time_s, columns) for k in range(5)]
    notes = column_notes(LogModel(_valve(), logs))
    (told,) = [note for note in notes if "stands at" in note]
    assert told.endswith("The same holds of 4 more logs.")
    (missing,) = [note for note in notes if "are not measured" in note]
    assert missing == "output flow: 0.2% of the samples are not measured."  # 1 of 400
    columns = {name: np.tile(values, 10) for name, values in log.columns.items()}
    columns["flow"][7] = np.nan
    rarely = column_notes(LogModel(_valve(), [Recording("long", np.arange(4000) / 100, columns)]))
    assert "output flow: under 0.1% of the samples are not measured." in rarely


def test_constants_that_no_fit_moves_are_listed_and_those_that_keep_their_sign() -> None:
    told = _notes(0.0)
    assert "taken as exact, for want of a spread: valve_s." in told
    assert "constant leak keeps its sign" in told
    assert "may be on either side of 0, from" not in told
    wide = checked(_valve(constants=[*Valve.constants[:2], Constant("leak", 0.01, spread=0.1)]))
    told = "\n".join(column_notes(LogModel(wide, [_swung(0.0)])))
    assert "constant leak may be on either side of 0, from \u22120.39 to 0.41." in told
    assert "constant flow_s keeps" not in told


def test_a_column_without_a_unit_has_no_1_behind_its_range() -> None:
    told = _notes(0.0).splitlines()
    assert "input command_pct: −0.3751 to 0.5" in told
    in_percent = {"inputs": [Input("command_pct", "%")]}
    assert "input command_pct: −0.3751 to 0.5 %" in _notes(0.0, **in_percent).splitlines()


def test_degrees_that_are_taken_for_radians_are_turns() -> None:
    angle = {"inputs": [Input("command_pct", "rad")]}
    columns = {"command_pct": np.linspace(-90.0, 90.0, 400), "flow": np.sin(np.arange(400) / 9.0)}
    log = Recording("made", np.arange(400) / 100.0, columns)
    told = column_notes(LogModel(_valve(**angle), [log]))
    assert (
        "input command_pct: −90 to 90 rad, 29 turns; if the log counts degrees, its unit is deg"
        in told
    )
    assert "turns" not in _notes(0.0, **angle)
    in_degrees = Recording("read", log.time_s, columns, {"command_pct": Origin("deg", False)})
    assert "turns" not in "\n".join(column_notes(LogModel(_valve(**angle), [in_degrees])))


def test_a_constant_that_nothing_reads_is_not_fitted() -> None:
    """With a spread without end a flat likelihood took it to its bound, to three digits."""
    spare = [Constant("wall_m", 3.0, spread=float("inf")), Constant("dial_s", 2.0, spread=0.1)]
    system = checked(_valve(constants=[*Valve.constants, *spare]))
    model = LogModel(system, [_swung(0.0)])
    told = column_notes(model)
    assert "shown by no output of these logs, and not fitted: wall_m." in told
    fitted = {free.name for free in model._nuisances}
    assert {"constant.wall_m", "constant.dial_s"} & fitted == {"constant.dial_s"}
    ported = [*Valve.ports, Port.constant("wall_m")]
    other = LogModel(checked(_valve(constants=system.constants, ports=ported)), [_swung(0.0)])
    assert not other.unshown


def test_a_constant_that_no_output_shows_is_not_fitted() -> None:
    """The equations read it; rounding took it to its bound, and the correction had that."""
    loose = {"spread": float("inf")}
    spare = [Constant("wall_m", 3.0, **loose), Constant("flow_s", 0.3, **loose)]

    def derivative(self, state, inputs, c):
        moved = Valve.derivative(self, state, inputs, c)
        return {**moved, "flow": moved["flow"] + 0.0 * c.wall_m}

    constants = [Valve.constants[0], *spare, Valve.constants[2]]
    model = LogModel(checked(_valve(constants=constants, derivative=derivative)), [_swung(0.0)])
    assert "shown by no output of these logs, and not fitted: wall_m." in column_notes(model)
    fitted = {free.name for free in model._nuisances}
    assert {"constant.wall_m", "constant.flow_s"} & fitted == {"constant.flow_s"}
    assert model.unknown_constants() == {"wall_m": Quantity(value=3.0, unit="m")}


class Stopped(System):
    """A valve with a spring beyond an end, whose constant is read where the valve gets there."""

    rate_hz = 100.0
    inputs = [Input("command_pct", "%")]
    states = {"flow": "m3/s"}
    outputs = [Output("flow", "m3/s")]
    end = 0.94
    constants = [
        Constant("flow_s", 0.3, spread=float("inf")),
        Constant("stop_per_s", 20.0, spread=float("inf"), low=0.01, high=1e4),
    ]

    def derivative(self, state, inputs, c):
        beyond = state.flow - self.end
        moved = (inputs.command_pct - state.flow) / c.flow_s
        if np.any(beyond > 0.0):
            moved = moved - c.stop_per_s * np.maximum(beyond, 0.0)
        return {"flow": moved}


def _late_stop(samples: int, late: int) -> Recording:
    """A valve that swings wider in its last samples, with the noise of its sensor."""
    swing = np.where(np.arange(samples) < samples - late, 0.8, 1.2)
    command = swing * np.sin(np.arange(samples) / 40.0)
    flow = 0.8 * swing * np.sin(np.arange(samples) / 40.0 - 0.6)
    flow = flow + 1e-3 * np.random.default_rng(0).standard_normal(samples)
    return Recording("made", np.arange(samples) / 100.0, {"command_pct": command, "flow": flow})


@pytest.mark.parametrize("costs_by_point", [False, True])
def test_a_stop_that_few_samples_meet_keeps_its_constant_free(costs_by_point: bool) -> None:
    """No sample but the last ones are beyond the end: tried elsewhere, no function reads it."""
    log = _late_stop(3000, 300)
    beyond = (log.columns["flow"] > 0.94).mean()
    assert 0.0 < beyond < 0.02
    kind = type("Stop", (Stopped,), {"costs_by_point": costs_by_point})
    model = LogModel(checked(kind()), [log])
    assert "constant.stop_per_s" in {free.name for free in model.free(())}
    assert not [note for note in column_notes(model) if "not fitted" in note]
    away = LogModel(checked(type("Away", (kind,), {"end": 2.0})()), [log])
    assert away.unshown == {"stop_per_s"}


def test_what_is_free_in_a_part_of_long_logs_is_free_in_all_of_them() -> None:
    """A search looks at the first samples, its sizes come from all: of one set of parameters."""
    log = _late_stop(60_000, 300)
    model = LogModel(checked(Stopped()), [log])
    part = model.thinned()
    assert part is not model
    free = [free.name for free in part.free(())]
    assert "constant.stop_per_s" in free
    assert free == [free.name for free in model.free(())]


def test_a_constant_that_takes_the_model_out_of_its_range_leaves_the_others_unshown() -> None:
    """A tenth of what it is gives no number; that nothing reads another is shown all the same."""

    def derivative(self, state, inputs, c):
        return {"flow": (inputs.command_pct - state.flow) / (0.3 * np.sqrt(2.0 * c.lift_m - 1.0))}

    loose = [Constant(name, 1.0, spread=float("inf")) for name in ("lift_m", "wall_m")]
    rooted = type("Rooted", (Stopped,), {"constants": loose, "derivative": derivative})
    assert LogModel(checked(rooted()), [_late_stop(3000, 300)]).unshown == {"wall_m"}


def test_an_input_that_is_held_over_a_silence_is_said() -> None:
    """What drove the system meanwhile is a guess, and a search would blame an effect for it."""
    flow = np.sin(np.arange(400) / 9.0)
    command = np.where((np.arange(400) > 99) & (np.arange(400) < 115), np.nan, flow)
    told = column_notes(
        LogModel(
            _valve(),
            [Recording("a", np.arange(400) / 100.0, {"command_pct": command, "flow": flow})],
        )
    )
    (note,) = [note for note in told if "without a number" in note]
    assert note.startswith("input command_pct: 15 samples without a number, up to 0.15 s at once")
    assert "without a number" not in _notes(0.0)


def test_one_reading_at_an_end_is_no_limit() -> None:
    short = np.sin(np.arange(50) / 7.0)
    columns = {"command_pct": short, "flow": short}
    told = column_notes(LogModel(_valve(), [Recording("made", np.arange(50) / 100.0, columns)]))
    assert not any("is at its" in note for note in told)


def test_all_numbers_have_the_same_sign_for_minus() -> None:
    held = np.clip(np.sin(np.arange(400) / 10.0), -0.45, 0.9)
    columns = {"command_pct": held, "flow": held}
    told = column_notes(LogModel(_valve(), [Recording("made", np.arange(400) / 100.0, columns)]))
    assert any("is at its least, −0.45, in" in note for note in told)
    assert not any(re.search(r"-\d", note) for note in told)


def test_a_search_is_warned_of_an_output_that_is_cut_in_many_samples() -> None:
    """A command may stand at its limit, a sensor touch its own, and a step's answer settle."""
    time_s, wave = np.arange(400) / 100.0, np.sin(np.arange(400) / 10.0)
    for lowest, told in ((-0.45, ["output flow is at its least, −0.45, in 33.0% of the samples. "]),
                         (-0.99, [])):  # fmt: skip
        columns = {"command_pct": np.maximum(wave, -0.2), "flow": np.maximum(wave, lowest)}
        notes = cut_outputs(LogModel(_valve(), [Recording("made", time_s, columns)]))
        assert [note.partition("If")[0] for note in notes] == told
        settled = columns | {"flow": np.round(1.0 - np.exp(-time_s / 0.1), 3)}
        assert cut_outputs(LogModel(_valve(), [Recording("made", time_s, settled)])) == []


def test_a_sensor_whose_end_the_system_states_is_no_warning_and_check_says_what_a_search_does():
    class Ends(Valve):
        def measure(self, state, inputs, c):
            return {"flow": np.maximum(state.flow, -0.45)}

    time_s, wave = np.arange(400) / 100.0, np.sin(np.arange(400) / 10.0)
    columns = {"command_pct": wave, "flow": np.maximum(wave, -0.45)}
    log = Recording("made", time_s, columns)
    assert cut_outputs(LogModel(Ends(), [log])) == []
    (warned,) = cut_outputs(LogModel(_valve(), [log]))
    told = column_notes(LogModel(_valve(), [log]))
    assert [note for note in told if "is at its least" in note] == [warned]


def _noisy(samples: int = 400) -> np.ndarray:
    noise = np.random.default_rng(3).standard_normal(samples)
    return np.asarray(np.sin(np.arange(samples) / 10.0) + 0.01 * noise)


def _hung(flow: np.ndarray, first: int = 150, last: int = 250) -> np.ndarray:
    flow = flow.copy()
    flow[first:last] = flow[first]
    return flow


def _hangs(*flows: np.ndarray) -> list[str]:
    logs = [
        Recording(f"log {k}", np.arange(400) / 100.0, {"command_pct": _noisy(), "flow": flow})
        for k, flow in enumerate(flows)
    ]
    return hung_outputs(LogModel(_valve(), logs))


def test_a_sensor_that_hung_is_told_with_place_and_number() -> None:
    """In the log where it did, also at its least reading and between readings that are missing."""
    (note,) = _hangs(_noisy(), _hung(_noisy()))
    assert note.startswith(f"output flow is exactly {_noisy()[150]:.9g} in log 1 for 1 s, from 1.5")
    dropped = _noisy()
    dropped[150:250] = -2.0
    (note,) = _hangs(dropped)
    assert "is exactly −2 in log 0 for 1 s" in note
    holey = _hung(_noisy())
    holey[100:300:3] = np.nan
    assert len(_hangs(holey)) == 1
    (twice,) = _hangs(_hung(_hung(_noisy()), 300, 360))
    assert "for 1 s, from 1.5 s after its start (and 1 other time)," in twice


@pytest.mark.parametrize(
    "flow",
    [
        np.round(_hung(_noisy()) / 0.05) * 0.05,
        np.repeat(_noisy(20), 20),
        np.where(np.arange(400) % 200 < 60, 0.0, _noisy()),
        _hung(_noisy(), 0, 100),
        _hung(_noisy(), 300, 400),
        _hung(np.sin(np.arange(400) / 10.0)),
    ],
    ids=["an encoder", "5 Hz at 100 Hz", "at rest", "before", "behind", "no noise"],
)
def test_equal_readings_that_need_no_sensor_that_hung_are_not_told(flow: np.ndarray) -> None:
    assert _hangs(flow) == []


def test_a_constant_that_nobody_gave_a_unit_is_said_to_count_as_1() -> None:
    half = Constant("half_track", 0.162, spread=0.01)
    constants = [*Valve.constants, half, Constant("arm", 0.2)]
    said = "without a unit, and count as 1: half_track, arm."
    assert said in _notes(0.0, constants=constants)
    assert "count as 1" not in _notes(0.0)  # it states unit="1"
    assert "without a unit, and counts as 1: half_track." in _notes(
        0.0, constants=[*Valve.constants, half]
    )
    divided = [*Valve.constants, Constant("torque_per_a", 0.05, spread=0.01)]
    assert "counts as 1: torque_per_a." in _notes(0.0, constants=divided)


def test_a_state_that_runs_away_is_named() -> None:
    """Nothing is left of a forecast then, and numpy's warnings stood in the answer."""

    class Stepped(System):
        rate_hz, inputs, outputs = Valve.rate_hz, Valve.inputs, Valve.outputs
        states, constants, ports = Valve.states, Valve.constants, Valve.ports

        def step(self, state, inputs, c):
            return {"opening": inputs.command_pct, "flow": state.flow * 40.0}

    model = LogModel(Stepped(), [_swung(0.4)])
    told = "\n".join(column_notes(model))
    assert "state flow runs away" in told
    assert "within 2 samples" in told
    assert "runs away" not in _notes(0.4)
    assert "runs away" not in _notes(0.4, derivative=Integrating.derivative)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        nothing = np.full((2, 5), np.nan)
        assert np.isnan(mean_squares(nothing)).all()
        assert not weight_of(np.zeros((4, 1)), np.ones((4, 1))).share > 0.0


@pytest.mark.parametrize(("late", "said"), [(0, ""), (1, "2 ms late"), (4, "8 ms late")])
def test_readings_between_the_samples_of_a_system_are_said_to_count_late(late, said):
    """A sensor that is read each 10 ms, in a log of 500 Hz, so much before a sample of 100 Hz."""
    time_s = np.arange(2000) / 500.0
    flow = np.full(2000, np.nan)
    flow[5 - late :: 5] = 0.2 + 0.1 * np.sin(time_s[5 - late :: 5])
    log = Recording("made", time_s, {"command_pct": 0.5 * np.sin(time_s), "flow": flow})
    told = [note for note in column_notes(LogModel(_valve(), [log])) if " late on average" in note]
    assert [said in note for note in told] == ([True] if said else [])


def test_readings_at_each_row_of_a_finer_log_are_in_time():
    time_s = np.arange(2000) / 500.0
    columns = {"command_pct": 0.5 * np.sin(time_s), "flow": 0.2 + 0.1 * np.sin(time_s)}
    log = Recording("made", time_s, columns)
    assert "late on average" not in "\n".join(column_notes(LogModel(_valve(), [log])))


@pytest.mark.parametrize("phase", range(5))
def test_a_log_begins_where_its_readings_count_in_time(phase):
    """A speed at each row of 500 Hz, and a sensor each fifth row, for a system of 100 Hz."""
    rows = np.arange(2000)
    flow = np.where(rows % 5 == phase, rows, np.nan)
    log = Recording("made", rows / 500.0, {"command_pct": 0.1 * rows, "flow": flow})
    begun = in_time(_valve(), log)
    assert len(begun.time_s) == 2000 - phase
    model = LogModel(_valve(), [begun])
    shown = model.logs[0].outputs[0]
    np.testing.assert_array_equal(shown, rows[phase::5][: len(shown)])
    assert "late on average" not in "\n".join(column_notes(model))


def test_a_log_that_is_read_at_each_row_or_is_as_coarse_as_the_system_begins_where_it_does():
    rows = np.arange(2000)
    for rate_hz, is_read in ((500.0, rows >= 0), (100.0, rows % 5 == 3), (500.0, rows < 0)):
        flow = np.where(is_read, rows, np.nan)
        log = Recording("made", rows / rate_hz, {"command_pct": 0.1 * rows, "flow": flow})
        assert in_time(_valve(), log) is log
