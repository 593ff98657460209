"""A user's system: what does not fit together is said by name, in one sentence."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.files import read_plain, read_system
from wakedeploy.gap.systems.likelihood.always_free import constants
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.imagined import imagined
from wakedeploy.gap.systems.ports import Point
from wakedeploy.gap.systems.sensitivity import column_notes
from wakedeploy.gap.systems.trial_points import random_points

EXAMPLES = Path(__file__).parents[3] / "examples" / "systems"


class Axis(System):
    rate_hz = 100.0
    inputs = [Input("force_n", "N")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m")]
    constants = [Constant("mass_kg", 2.0, spread=0.1)]
    ports = [Port.input("force_n"), Port.force("speed_mps", inertia="mass_kg")]

    def derivative(self, state, inputs, c):
        return {"position_m": state.speed_mps, "speed_mps": inputs.force_n / c.mass_kg}


def _with(**changes):
    return type("Axis", (Axis,), changes)()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda p: p.stem)
def test_examples_load(path):
    assert read_system(path).outputs


def test_a_sound_system_passes():
    assert checked(Axis()).constant("mass_kg").value == 2.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"derivative": lambda s, state, u, c: {"position_m": state.speed_mps}}, "'speed_mps'"),
        ({"derivative": lambda s, state, u, c: state.speed}, "state 'speed' is not there"),
        ({"derivative": lambda s, state, u, c: 3.0}, "return a dict"),
        (
            {
                "derivative": lambda s, state, u, c: {
                    "position_m": np.sqrt(state.position_m - 9.0),
                    "speed_mps": 0.0,
                }
            },
            "gives nan for 'position_m' at",
        ),
        (
            {
                "derivative": lambda s, state, u, c: {
                    "position_m": np.zeros(7),
                    "speed_mps": 0.0,
                }
            },
            r"the shape \(7,\)",
        ),
        (
            {
                "derivative": lambda s, state, u, c: {
                    "position_m": [state.speed_mps, 0.0],
                    "speed_mps": 0.0,
                }
            },
            "gives 'position_m' parts of several shapes",
        ),
        (
            {
                "derivative": lambda s, state, u, c: {
                    "position_m": max(state.speed_mps, 0.0),
                    "speed_mps": 0.0,
                }
            },
            r"derivative: it is called with arrays.* np\.maximum for max",
        ),
        (
            {
                "derivative": lambda s, state, u, c: {
                    "position_m": np.sum(state.speed_mps),
                    "speed_mps": 0.0,
                }
            },
            "another 'position_m' for one point",
        ),
        (
            {
                "derivative": lambda s, state, u, c: {
                    "position_m": state.speed_mps + np.zeros(7),
                    "speed_mps": 0.0,
                }
            },
            r"do not fit each other .*\(3,5\) \(7,\)\).* leave each as it is",
        ),
        ({"derivative": lambda s, state, u, c: sys.exit(3)}, "derivative: it ends the program"),
        ({"outputs": [Output("force_v", "V")]}, "nothing for the output 'force_v'"),
        ({"ports": [Port.force("speed")]}, "the state 'speed', which is not there"),
        ({"ports": [Port.force("speed_mps", friction="rub_n")]}, "the constant 'rub_n', which is"),
        (
            {"ports": [Port.force("speed_mps", friction="mass_kg")] * 2},
            "two ports state a friction of 'speed_mps'",
        ),
        ({"constants": [Constant("mass_kg", 2.0, spread=-1.0)]}, "spread"),
        (
            {"constants": [Constant("mass_kg", 2e-4, spread=0.1)]},
            r"spread of 0\.1, 500 times its value.*inertia of the port 'speed_mps'.*Bound "
            r"it with low and high, or .*spread=2e-05",
        ),
        (
            {"constants": [Constant("mass_kg", 50.0, spread=200.0)], "ports": []},
            r"spread of 200, 4 times.*derivative gives no number where it is 0\..*spread=5 is 10",
        ),
        (
            {
                "constants": [Constant("mass_kg", 2.0), Constant("grip", 0.1, spread=1.0)],
                "derivative": lambda s, state, u, c: {
                    "position_m": state.speed_mps * np.sqrt(c.grip),
                    "speed_mps": 0.0,
                },
            },
            r"gives no number where it is -3\.9",
        ),
        ({"constants": [Constant("mass_kg", 0.12, low=1.0)]}, r"in \[1, 120\]; give a finite"),
        ({"constants": [Constant("mass_kg", 2.0, unit="kilo")]}, "the unit 'kilo', which is not"),
        ({"inputs": [Input("force_n", "newt")]}, "input 'force_n' has the unit 'newt'"),
        (
            {"derivative": lambda s, state, u, c: {"position_m": 1j, "speed_mps": 0.0}},
            r"Axis.derivative gives 1j for 'position_m', which is no real number",
        ),
        (
            {"measure": lambda s, state, u, c: {"position_m": state.position_m + 0j}},
            r"Axis.measure gives an array of complex128 for 'position_m'",
        ),
        ({"measure": lambda s, state, u, c: {"position_m": "far"}}, "gives 'far' for 'position_m'"),
        ({"rate_hz": 0.0}, "rate_hz"),
        ({"exported": "arm.urdf"}, "exported is 'arm.urdf'; give a list of file names"),
        (
            {"exported": ["../arm.urdf"]},
            r"exported is \['../arm.urdf'\]; give a list of file names",
        ),
        ({"steps": 0}, "steps is 0; give a whole number from 1 to 64"),
        ({"inputs": [Input("force_n", "N", hold="cubic")]}, "holds 'cubic', not"),
        ({"inputs": [Input("force_n", "N", delay_s=-0.1)]}, "has the delay_s -0.1; give seconds"),
        ({"inputs": [Input("force_n", "N", delay_s="0.1")]}, "has the delay_s '0.1'; give seconds"),
        ({"constants": [Constant("mass_kg", "2.0")]}, r"value of Constant\('mass_kg'\) is '2.0'"),
        ({"constants": [Constant("mass_kg", 2.0, low=True)]}, "low of Constant.* give a number"),
        ({"outputs": [Output("position_m", "m", noise=[1e-3])]}, r"noise of Output.* is \[0.001\]"),
        ({"step": lambda s, state, u, c: {}}, "both of `derivative` and `step`"),
        ({"inputs": [Input("speed_mps", "m/s")]}, "an input and a state"),
    ],
)
def test_what_does_not_fit_is_said_by_name(changes, said):
    with pytest.raises(UnusableInput, match=said):
        checked(_with(**changes))


def test_a_file_that_is_a_script_too_is_told_where_to_put_that(tmp_path):
    """It ended the command without a word, and with the status of a success."""
    path = tmp_path / "script.py"
    path.write_text("import sys\n\nsys.exit(0)\n")
    with pytest.raises(UnusableInput, match=r"ends the program while it is read; .*__main__"):
        read_system(path)


def test_an_input_that_is_known_to_act_later_does():
    """As if its column had been logged later."""
    random, time_s = np.random.default_rng(1), np.arange(300) / 100.0
    force = np.repeat(random.uniform(-1.0, 1.0, 30), 10)
    later = np.concatenate([np.full(5, force[0]), force[:-5]])
    late = _with(inputs=[Input("force_n", "N", delay_s=0.05)])
    columns = {"force_n": force, "position_m": random.standard_normal(300)}
    replayed = late.simulate(Recording("log", time_s, columns))
    known = Axis().simulate(Recording("log", time_s, columns | {"force_n": later}))
    np.testing.assert_allclose(replayed["position_m"], known["position_m"], atol=1e-12)

    model, plain = (LogModel(s, [Recording("log", time_s, columns)]) for s in (late, Axis()))
    fitted = fit(plain, (), range(1))
    waiting, shifted = (
        imagined(m, fitted, {"force_n": f[None]})["position_m"]
        for m, f in ((model, force), (plain, later))
    )
    np.testing.assert_allclose(waiting, shifted, atol=1e-12)
    # What acts first came before the log: nobody is to blame for what it did.
    scored = [np.count_nonzero(m.score((), fitted.theta, 0).log_density) for m in (model, plain)]
    assert scored[0] == scored[1] - 5
    with pytest.raises(UnusableInput, match="nothing of it acts; give seconds"):
        LogModel(_with(inputs=[Input("force_n", "N", delay_s=50.0)]),
                 [Recording("log", time_s, columns)])  # fmt: skip


@pytest.mark.parametrize(
    ("position", "unit", "more", "is_told"),
    [
        ("z_m", "m", {}, True),
        ("height", "cm", {}, True),
        ("z_m", "m", {"height": "z_m"}, False),
        ("z_m", "m", {"kinds": ["offset"]}, False),
        ("zone_m", "m", {}, False),
        ("z_rad", "rad", {}, False),
    ],
)
def test_a_port_over_a_height_is_told_how_to_ask_for_ground_effect(position, unit, more, is_told):
    def derivative(self, state, inputs, c):
        return {position: state.speed_mps, "speed_mps": inputs.force_n / c.mass_kg}

    port = Port.force("speed_mps", inertia="mass_kg", position=position, **more)
    system = _with(
        states={position: unit, "speed_mps": f"{unit}/s"},
        outputs=[Output(position, unit)],
        ports=[port],
        derivative=derivative,
    )
    columns = {"force_n": np.zeros(300), position: np.random.default_rng(1).random(300)}
    notes = column_notes(
        LogModel(checked(system), [Recording("log", np.arange(300) / 100, columns)])
    )
    assert any("ground-effect" in note for note in notes) == is_told
    assert not is_told or any(f'height="{position}")' in note for note in notes)


@pytest.mark.parametrize("name", ["rates", "values", "name", "_probed"])
def test_a_name_that_the_library_uses_is_not_hidden(name):
    """Also where a class between has it: the library would call the user's own."""
    hiding = type("Helper", (Axis,), {name: lambda self, *others: {}})
    said = f"Helper.{name}: the library has `{name}` .* as `my_{name.lstrip('_')}`"
    with pytest.raises(UnusableInput, match=said):
        checked(type("Axis", (hiding,), {})())


def test_nor_by_what_a_system_keeps():
    def begin(self):
        self.values, self.gain = [1.0], 2.0

    with pytest.raises(UnusableInput, match=r"Axis\.values: the library has `values`"):
        checked(_with(__init__=begin))


def test_names_that_are_the_user_s_own_are(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(
        "from wakedeploy import Output, System\n\n\nclass Own(System):\n    rate_hz = 10.0\n"
        "    inputs = []\n    states = {'x_m': 'm'}\n    outputs = [Output('x_m', 'm')]\n"
        "    gain = 2.0\n\n    def _rate(self, state):\n        return -self.gain * state.x_m\n\n"
        "    def derivative(self, state, inputs, c):\n        return {'x_m': self._rate(state)}\n"
    )
    assert read_system(path).name == "Own"


@pytest.mark.parametrize(
    ("returned", "said"),
    [(None, "returned None; return a list of sentences"), ([1], "return a list of sentences")],
)
def test_a_system_s_own_notes_are_sentences(returned, said):
    columns = {"force_n": np.zeros(300), "position_m": np.random.default_rng(1).random(300)}
    system = _with(log_notes=lambda s, outputs: returned)
    model = LogModel(system, [Recording("log", np.arange(300) / 100.0, columns)])
    with pytest.raises(UnusableInput, match=f"Axis.log_notes: .*{said}"):
        column_notes(model)


def _under(returned):
    """An axis that distributes forces itself, and returns such a speed's rate."""
    return _with(
        derivative_under=lambda s, state, u, c, forces: {
            "position_m": state.speed_mps,
            "speed_mps": returned(u, c, forces),
        }
    )


@pytest.mark.parametrize(
    "force",
    [
        lambda forces: forces.speed_mps,
        lambda forces: forces["speed_mps"],
        lambda forces: forces.get("speed_mps", 0.0),
    ],
)
def test_forces_are_read_as_attributes_or_by_name_and_are_0_where_nothing_acts(force):
    axis = checked(_under(lambda u, c, forces: (u.force_n + force(forces)) / c.mass_kg))
    state = Point("state", {"position_m": 0.0, "speed_mps": 0.0})
    inputs = Point("input", {"force_n": 1.0})
    for acting, rate in (({}, 0.5), ({"speed_mps": 3.0}, 2.0)):
        assert axis.rates(state, inputs, axis.values(), acting)["speed_mps"] == rate


@pytest.mark.parametrize(
    ("returned", "said"),
    [
        (lambda u, c, forces: forces.speed, r"force at 'speed' is not there.*: speed_mps"),
        (lambda u, c, forces: forces["speed"], r"force at 'speed' is not there.*: speed_mps"),
        (
            lambda u, c, forces: u.force_n + forces.speed_mps,
            "derivative_under gives another 'speed_mps' than derivative where no force acts",
        ),
    ],
)
def test_a_system_that_distributes_forces_wrongly_is_told_when_it_is_loaded(returned, said):
    with pytest.raises(UnusableInput, match=said):
        checked(_under(returned))


@pytest.mark.parametrize("bounds", [{}, {"low": -8.5, "high": 7.5}])
def test_an_offset_near_zero_may_turn(bounds):
    """As far as it says, or as its spread does: four of them to each side."""
    offset = Constant("buoyancy_n", -0.5, spread=2.0, **bounds)
    mass = Constant("mass_kg", 2.0)
    (free,) = constants(checked(_with(constants=[mass, offset])))
    assert (free.low, free.high, free.step) == (-8.5, 7.5, 0.04)
    assert free.neutral == -0.5


def test_a_constant_is_not_blamed_for_points_at_which_no_value_gives_a_number():
    """A root of a speed gives none below a speed that the first look happens not to reach."""
    lowest = random_points(_with(), (3, 5))["speed_mps"].min()
    assert lowest > random_points(_with(), (20,))["speed_mps"].min()

    def derivative(self, state, inputs, c):
        return {
            "position_m": np.sqrt(state.speed_mps - lowest),
            "speed_mps": (inputs.force_n + c.buoyancy_n) / c.mass_kg,
        }

    constants = [Constant("mass_kg", 2.0), Constant("buoyancy_n", -0.5, spread=2.0)]
    system = checked(_with(constants=constants, derivative=derivative))
    assert system.constant("buoyancy_n").bounds == (-8.5, 7.5)


@pytest.mark.whole
def test_a_gain_of_the_wrong_sign_is_found_where_its_spread_lets_it_turn():
    """Of logs alone: the slope of what is shown over what drives it is 1.5, and stated as −0.5."""
    system = checked(
        _with(
            constants=[Constant("mass_kg", 2.0), Constant("gain", -0.5, spread=2.0)],
            derivative=lambda s, state, u, c: {
                "position_m": state.speed_mps,
                "speed_mps": c.gain * u.force_n / c.mass_kg,
            },
        )
    )
    rng, time_s = np.random.default_rng(0), np.arange(800) / 100.0
    force = np.repeat(rng.standard_normal(32), 25)
    speed = np.concatenate([[0.0], np.cumsum(0.75 * force[:-1]) / 100.0])
    place = np.concatenate([[0.0], np.cumsum(speed[:-1] + 0.5 * np.diff(speed)) / 100.0])
    shown = place + 1e-3 * rng.standard_normal(800)
    recording = Recording("made", time_s, {"force_n": force, "position_m": shown})
    model = LogModel(system, [recording])
    assert fit(model, (), range(model.episodes)).value("constant.gain") == pytest.approx(1.5, 0.1)


def _recording() -> Recording:
    time_s = np.arange(400) / 100.0
    columns = {"force_n": np.cos(time_s), "position_m": 0.5 * np.sin(time_s)}
    return Recording("made", time_s, columns)


@pytest.mark.parametrize(
    ("start", "said"),
    [
        (lambda s, measured: {"speed_mps": measured.command}, "start: output 'command' is not"),
        (lambda s, measured: {"speed": 0.0}, "start returns 'speed', which is no state"),
        (lambda s, measured: {"speed_mps": 1j}, "start gives 1j for 'speed_mps'"),
        (lambda s, measured: {"speed_mps": np.zeros(7)}, r"'speed_mps' the shape \(7,\)"),
        (lambda s, measured: {"speed_mps": float("nan")}, "something that is no number"),
        (lambda s, measured: 3.0, "start returns float; return a dict"),
    ],
)
def test_what_start_does_wrong_is_said_by_its_name(start, said):
    with pytest.raises(UnusableInput, match=f"Axis.{said}" if "start" in said else said):
        LogModel(checked(_with(start=start)), [_recording()])


def test_an_effect_of_ones_own_that_fails_during_a_fit_is_said_by_its_name():
    """It is tried with time 0 when the system is loaded, and called with times along a log."""

    def late(t, state, inputs, p):
        return {"speed_mps": p.force_n * state.position_m if np.all(t == 0.0) else inputs.wind}

    port = Port.custom("late", late, {"force_n": ("N", 1.0)})
    model = LogModel(checked(_with(ports=[port])), [_recording()])
    with pytest.raises(UnusableInput, match="Axis: the effect 'late': input 'wind' is not there"):
        fit(model, ("late",), (0, 1, 2))


def test_a_class_that_cannot_be_made_is_told_by_its_file(tmp_path):
    text = (EXAMPLES / "emps.py").read_text()
    (tmp_path / "emps.py").write_text(f"{text}\n    def __init__(self):\n        1 / 0\n")
    with pytest.raises(UnusableInput, match=r"emps\.py, Emps\(\): ZeroDivisionError"):
        read_system(tmp_path / "emps.py")


def test_a_file_is_read_and_its_errors_are_told(tmp_path):
    with pytest.raises(UnusableInput, match="no such file"):
        read_system(tmp_path / "absent.py")
    (tmp_path / "bad.py").write_text("def f(:\n")
    with pytest.raises(UnusableInput, match="line 1"):
        read_system(tmp_path / "bad.py")
    (tmp_path / "none.py").write_text("x = 1\n")
    with pytest.raises(UnusableInput, match="no class derived from System"):
        read_system(tmp_path / "none.py")


def test_a_file_that_was_changed_within_the_same_second_is_read_anew(tmp_path, monkeypatch):
    """A script that tries one value after another: size and time of the file stay as they were."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    path, text = tmp_path / "emps.py", (EXAMPLES / "emps.py").read_text()
    for rate_hz in (250.0, 500.0):
        path.write_text(text.replace("rate_hz = 250.0", f"rate_hz = {rate_hz}"))
        os.utime(path, (1e9, 1e9))
        assert read_system(path).rate_hz == rate_hz
    assert [each.name for each in tmp_path.iterdir()] == ["emps.py"]


def test_a_log_that_is_no_csv_file_is_answered_with_the_way_in(tmp_path):
    path = tmp_path / "flight.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(range(256)))
    with pytest.raises(
        UnusableInput, match=r"is no CSV file of numbers; say by --columns .*--guess"
    ):
        read_plain(path, Axis())
    with pytest.raises(UnusableInput, match="give a log that can be read"):
        read_plain(tmp_path / "absent.csv", Axis())


def test_a_log_whose_times_are_rounded_keeps_its_rate(tmp_path):
    """At 128 Hz most steps of whole milliseconds are 8, and 1 / 8 ms is another rate."""
    time_s = np.arange(600) / 128
    path = tmp_path / "log.csv"
    rows = "".join(f"{t:.3f},0,0\n" for t in time_s)
    path.write_text("time_s,force_n,position_m\n" + rows)
    np.testing.assert_allclose(read_plain(path, Axis()).time_s, time_s, atol=1e-3)


class Crane(System):
    """A load on a rope whose logged length divides: never 0, but nothing says so."""

    rate_hz = 50.0
    inputs = [Input("push_mps2", "m/s^2"), Input("rope_m", "m")]
    states = {"sway_rad": "rad", "sway_radps": "rad/s"}
    outputs = [Output("sway_rad", "rad")]

    def derivative(self, state, inputs, c):
        swings = -(9.81 * np.sin(state.sway_rad) + inputs.push_mps2) / inputs.rope_m
        return {"sway_rad": state.sway_radps, "sway_radps": swings}


def _swung(rope_m, **more):
    time_s = np.arange(200) / 50.0
    columns = more | {
        "push_mps2": np.sin(time_s),
        "rope_m": rope_m,
        "sway_rad": 0.1 * np.cos(3.0 * time_s),
    }
    return Recording("lift", time_s, columns)


def test_an_input_that_divides_need_not_be_0():
    system = checked(Crane())
    model = LogModel(system, [_swung(np.linspace(0.8, 1.5, 200))])
    assert np.isfinite(fit(model, (), (0,), None).objective)


def test_a_recording_where_an_input_leaves_the_model_says_so():
    class Smooth(Crane):
        """Held or not, the row itself is 0; the wind may be 0, as the sway is not."""

        inputs = [
            Input("push_mps2", "m/s^2"),
            Input("rope_m", "m", hold="linear"),
            Input("wind_mps", "m/s"),
        ]

        def measure(self, state, inputs, c):
            return {"sway_rad": state.sway_rad + 1e-9 / abs(state.sway_radps + inputs.wind_mps)}

    wind = {"wind_mps": np.linspace(-1.0, 1.0, 201)[:200]}
    rope_m = np.linspace(0.8, 1.5, 200)
    assert LogModel(checked(Smooth()), [_swung(rope_m, **wind)]).episodes
    rope_m[77] = 0.0
    said = r"lift: at 1\.54 s, where .*rope_m = 0, wind.*, Smooth\.derivative gives no number"
    with pytest.raises(UnusableInput, match=said):
        LogModel(checked(Smooth()), [_swung(rope_m, **wind)])

    class Shown(Axis):
        def measure(self, state, inputs, c):
            return {"position_m": state.position_m / inputs.force_n}

    time_s = np.arange(200) / 100.0
    columns = {"force_n": np.where(time_s == 0.5, 0.0, 1.0), "position_m": 0.1 * time_s}
    with pytest.raises(UnusableInput, match=r"force_n = 0, Shown\.measure gives no number"):
        LogModel(checked(Shown()), [Recording("pushed", time_s, columns)])


class Hot(Crane):
    """Nothing but what is above 273 gives a number."""

    inputs = [Input("push_mps2", "m/s^2"), Input("rope_m", "m", low=300.0)]
    constants = [Constant("k", 1.0, 0.1)]

    def derivative(self, state, inputs, c):
        warmth = np.sqrt(inputs.rope_m - 273.0)
        return {
            "sway_rad": state.sway_radps,
            "sway_radps": warmth - inputs.push_mps2 * state.sway_rad / c.k,
        }


def test_an_input_is_tried_within_its_limits():
    assert checked(Hot()).uses("sway_radps") == {"rope_m", "push_mps2", "sway_rad"}
    with pytest.raises(UnusableInput, match=r"gives nan for 'sway_radps'.*state `low` and"):
        checked(type("Hot", (Hot,), {"inputs": Crane.inputs})())
    with pytest.raises(UnusableInput, match="gives no number where it is 0"):
        checked(type("Hot", (Hot,), {"constants": [Constant("k", 1.0, 5.0)]})())


@pytest.mark.parametrize("limit", [0.05, 0.4, 0.8, 30.0])
def test_an_input_of_narrow_limits_drives_what_it_drives(limit):
    class Ship(Axis):
        inputs = [Input("force_n", "N", low=-limit, high=limit)]
        outputs = [Output("position_m", "m"), Output("felt_n", "N")]

        def measure(self, state, inputs, c):
            return {"felt_n": inputs.force_n}

    ship = checked(Ship())
    assert ship.drivers("speed_mps") == {"force_n"}
    assert ship.direct_outputs == {"felt_n"}
    assert ship.kinematic() == {"position_m": "speed_mps"}


def test_laws_and_effects_of_a_user_need_no_number_at_0_either():
    class Lawful(Crane):
        inputs = [
            Input("push_mps2", "m/s^2"),
            Input("rope_m", "m"),
            Input("kelvin", "K", law=lambda i: 300.0 + np.log(i.rope_m)),
        ]
        ports = [
            Port.custom(
                "breeze",
                lambda t, state, inputs, p: {"sway_radps": p.size / inputs.rope_m},
                {"size": ("m/s^2", 0.1)},
            )
        ]

        def derivative(self, state, inputs, c):
            swings = np.sqrt(inputs.kelvin - 273.0) - state.sway_rad
            return {"sway_rad": state.sway_radps, "sway_radps": swings}

    assert checked(Lawful()).made_of["kelvin"] == ("rope_m",)
