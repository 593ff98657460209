"""Columns in another unit, and exchanged ones, are told by what a system makes of its logs."""

from collections.abc import Callable

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.real_systems.answering import recordings_of as recordings_of_case
from benchmarks.real_systems.answering import system_of
from benchmarks.real_systems.cases import CASES
from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.cli import main
from wakedeploy.core.recording import Origin, Recording
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.misread import misread

CART = """
from wakedeploy import Constant, Input, Output, Port, System


class Cart(System):
    rate_hz = 50.0
    inputs = [Input("push", "N")]
    states = {"place": "m", "speed": "m/s"}
    outputs = [Output("place", "m", noise=1e-3)]
    constants = [Constant("mass_kg", 2.0, spread=0.1)]
    ports = [Port.force("speed", inertia="mass_kg", kinds=["viscous-friction"])]

    def derivative(self, state, inputs, c):
        return {"place": state.speed, "speed": inputs.push / c.mass_kg}
"""


class Joints(System):
    """Two joints of an arm whose inertias nobody has measured; all four sensors are logged."""

    rate_hz = 50.0
    inputs = [Input("motor_1_nm", "N m"), Input("motor_2_nm", "N m")]
    states = {"first": "rad", "second": "rad", "first_rate": "rad/s", "second_rate": "rad/s"}
    outputs = [
        Output("first", "rad"), Output("second", "rad"),
        Output("first_rate", "rad/s"), Output("gyro", "rad/s"),
    ]  # fmt: skip
    constants = [Constant("per_kgm2", 1.0, spread=float("inf"), unit="1/(kg m^2)")]
    ports = [Port.input("motor_1_nm")]

    def derivative(self, state, inputs, c):
        return {
            "first": state.first_rate,
            "second": state.second_rate,
            "first_rate": c.per_kgm2 * inputs.motor_1_nm - 2.0 * state.first_rate,
            "second_rate": c.per_kgm2 * inputs.motor_2_nm - 2.0 * state.second_rate,
        }

    def measure(self, state, inputs, c):
        return {"gyro": state.second_rate}


def moved(push: np.ndarray, inertia: float, drag: float, seed: int) -> tuple[np.ndarray, ...]:
    """Places and speeds of a mass under pushes, in small steps of our own, with noise."""
    random = np.random.default_rng(seed)
    x, v, rows = 0.0, 0.0, []
    for force in push:
        rows.append((x, v))
        for _ in range(20):
            v += (force - drag * v) / inertia * 1e-3
            x += v * 1e-3
    places, speeds = np.array(rows).T
    return tuple(row + 1e-3 * random.standard_normal(len(row)) for row in (places, speeds))


def pushes(seed: int) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(-4.0, 4.0, 20), 20)


@pytest.fixture(scope="module")
def cart(tmp_path_factory):
    """A cart that rubs, which its system does not know, and a log of it in SI units."""
    path = tmp_path_factory.mktemp("cart")
    (path / "cart.py").write_text(CART)
    push = pushes(0)
    place, _ = moved(push, 2.0, 0.8, 1)
    return path, {"time_s": np.arange(400) / 50.0, "push": push, "place": place}


def written(path, columns, **scales):
    table = np.column_stack([scales.get(name, 1.0) * row for name, row in columns.items()])
    np.savetxt(path, table, "%.9g", ",", header=",".join(columns), comments="")
    return path


def slow(scales, said):
    return pytest.param(scales, said, marks=pytest.mark.slow)


def told(cart, step, *more, **scales):
    folder, columns = cart
    log = written(folder / "log.csv", columns, **scales)
    given = ["gap", step, "--system", str(folder / "cart.py"), "--measured", str(log), *more]
    ended = CliRunner().invoke(main, given, catch_exceptions=False)
    assert ended.exit_code == 0, ended.output
    return ended


@pytest.mark.parametrize(
    ("scales", "said"),
    [
        ({"place": 1e3}, "output place is in mm, and not in m"),
        slow({"place": 1.0 / 0.0254}, "output place is in in, and not in m"),
        slow({"push": 1e3}, "input push is in mN, and not in N"),
        ({"push": 1.0 / 9.80665}, "input push is in kgf, and not in N"),
        ({"place": -1.0}, "input push or output place has the other sign"),
        slow({"push": -1.0}, "input push or output place has the other sign"),
        (
            {"place": 0.0254},
            "place is 39.37 times as large as was read, as where numbers that were in m already "
            "were converted from in",
        ),
        slow(
            {"push": 1e-3},
            "times as large as was read, as where numbers that were in N already were "
            "converted from mN or ",
        ),
        slow({"place": 0.85}, ""),  # a scale error of a sensor is no unit
        slow({"place": 1.2}, ""),
        ({}, ""),
    ],
)
def test_a_column_in_another_unit_than_the_system_says_is_told(cart, scales, said):
    """Though a friction is missing as well."""
    shown = told(cart, "check", **scales).stdout
    assert ("far better if" in shown) == bool(said)
    assert said in shown


def test_an_output_that_moves_by_less_than_its_noise_is_told(cart):
    """Whatever its unit may be: friction of millions was named that holds it still."""
    shown = told(cart, "check", place=1e-6).stdout
    assert "mm in all, less than the noise that the system states of it, 1.00 mm: is its" in shown
    assert "in all, less than the noise" not in told(cart, "check", place=1e-2).stdout


def test_a_search_says_so_once_before_it_begins(cart, tmp_path):
    out = ["--out", str(tmp_path / "gap")]
    said = "output place is in mm, and not in m"
    assert said in told(cart, "find", *out, place=1e3).stderr
    assert said not in told(cart, "find", *out, place=1e3).stderr


def joints(**columns: str) -> Recording:
    """Both joints, with each of some columns in the place of another."""
    logged = {}
    for k, (place, speed) in enumerate((("first", "first_rate"), ("second", "gyro"))):
        logged[f"motor_{k + 1}_nm"] = pushes(k)
        logged[place], logged[speed] = moved(logged[f"motor_{k + 1}_nm"], 3.0, 2.0, k)
    placed = {name: logged[columns.get(name, name)] for name in logged}
    return Recording("made", np.arange(400) / 50.0, placed)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"first_rate": "gyro", "gyro": "first_rate"}, ["as gyro says, and not as first_rate",
                                                        "as first_rate says, and not as gyro"]),
        ({"first": "first_rate", "first_rate": "first"}, ["first_rate goes on as first says"]),
        ({}, []),
    ],
)  # fmt: skip
def test_rates_in_each_other_s_place_are_told(columns, said):
    """By positions alone: nobody knows how heavy the arm is."""
    notes = misread(LogModel(Joints(), [joints(**columns)]))
    assert len(notes) == len(said)
    for note, each in zip(notes, said, strict=True):
        assert each in note
        assert "exchanged?" in note


class Known(Joints):
    """The same arm with inertias that are known and without sensors of speed."""

    states = {"first": "rad", "first_rate": "rad/s", "second": "rad", "second_rate": "rad/s"}
    outputs = Joints.outputs[:2]
    constants = [Constant("per_kgm2", 1.0 / 3.0, spread=0.01, unit="1/(kg m^2)")]

    def derivative(self, state, inputs, c):
        return {
            "first": state.first_rate,
            "second": state.second_rate,
            "first_rate": c.per_kgm2 * (inputs.motor_1_nm - 2.0 * state.first_rate),
            "second_rate": c.per_kgm2 * (inputs.motor_2_nm - 2.0 * state.second_rate),
        }

    def measure(self, state, inputs, c):
        return {}


def test_columns_of_one_unit_in_each_other_s_place_are_told_by_what_drives_them():
    """Which of the two pairs it is, of motors or of angles, no log says."""
    assert misread(LogModel(Known(), [joints()])) == []
    for a, b in (("first", "second"), ("motor_1_nm", "motor_2_nm")):
        (note,) = misread(LogModel(Known(), [joints(**{a: b, b: a})]))
        assert "the outputs first and second are exchanged" in note
        assert "the inputs motor_1_nm and motor_2_nm are exchanged" in note


@pytest.mark.parametrize("is_stated", [False, True])
def test_an_input_in_the_place_of_an_output_is_told_where_no_log_says_its_unit(is_stated):
    """A header with two names turned round, in a log without units."""
    swapped = joints(first="motor_1_nm", motor_1_nm="first")
    origins = {"first": Origin("rad", is_stated), "motor_1_nm": Origin("N m", is_stated)}
    read = Recording("made", swapped.time_s, swapped.columns, origins)
    notes = misread(LogModel(Known(), [read]))
    said = "far better if input motor_1_nm and output first are exchanged: "
    assert [said in note for note in notes] == ([] if is_stated else [True])


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (180.0 / np.pi, "gyro is in deg/s, and not in rad/s"),
        (
            np.pi / 180.0,
            "if gyro is 57.3 times as large as was read, as where numbers that were in rad/s "
            "already were converted from deg/s",
        ),
    ],
)
def test_a_speed_in_another_unit_than_its_position_is_told(times, said):
    made = joints()
    columns = dict(made.columns, gyro=times * made.columns["gyro"])
    (note,) = misread(LogModel(Joints(), [Recording("made", made.time_s, columns)]))
    scale = float(note.partition("second goes ")[2].partition(" times")[0])
    assert scale == pytest.approx(1.0 / times, rel=0.05)
    assert said in note
    assert " says. That fits if " in note
    assert "columns.toml" not in note  # there is none


@pytest.mark.parametrize(
    ("gyro", "said"),
    [
        (Origin("rpm", False), "gyro is in deg/s, and not in rpm"),
        (Origin("deg/s", True), "second is in deg, and not in rad"),
    ],
)
def test_of_columns_of_a_log_the_unit_that_columns_toml_gives_is_doubted(gyro, said):
    """A gyro in deg/s that is read as rpm, or an angle in deg beside one of a unit that is said."""
    made = joints()
    columns = dict(made.columns, gyro=6.0 * made.columns["gyro"])
    if gyro.is_stated:
        columns = dict(made.columns, second=made.columns["second"] * 180.0 / np.pi)
    origins = {"gyro": gyro, "second": Origin("rad", False)}
    (note,) = misread(LogModel(Joints(), [Recording("made", made.time_s, columns, origins)]))
    assert said in note
    assert ("gyro is in" in note) is not gyro.is_stated


def test_of_a_column_whose_unit_nobody_stated_the_system_s_is_doubted():
    """A first columns.toml has unit = "1" where a log does not say one."""
    made = joints()
    columns = dict(made.columns, second=made.columns["second"] * 180.0 / np.pi)
    origins = {"gyro": Origin("rad/s", True), "second": Origin("1", False)}
    (note,) = misread(LogModel(Joints(), [Recording("made", made.time_s, columns, origins)]))
    assert "second is in deg, and not in rad" in note
    assert "gyro is" not in note
    stated = dict.fromkeys(("gyro", "second"), Origin("rad", True))
    assert misread(LogModel(Joints(), [Recording("made", made.time_s, columns, stated)])) == []


@pytest.mark.parametrize("is_stated", [False, True])
def test_no_other_unit_is_looked_for_where_the_log_says_it(is_stated):
    """Motors that do a thousandth of what the arm says look as if they were in another unit."""
    made = joints()
    pushes_mnm = {n: 1e3 * made.columns[n] for n in ("motor_1_nm", "motor_2_nm")}
    origins = dict.fromkeys(pushes_mnm, Origin("N m", is_stated))
    read = Recording("made", made.time_s, {**made.columns, **pushes_mnm}, origins)
    notes = misread(LogModel(Known(), [read]))
    assert any("is in mN m, and not in N m" in note for note in notes) is not is_stated


@pytest.mark.parametrize("times", [0.8, 1.25])
def test_of_a_scale_error_of_a_speed_nothing_is_said(times):
    made = joints()
    columns = dict(made.columns, gyro=times * made.columns["gyro"])
    assert misread(LogModel(Joints(), [Recording("made", made.time_s, columns)])) == []


@pytest.mark.parametrize("turned", ["second", "gyro"])
def test_a_speed_of_the_other_sign_than_its_position_is_told(turned):
    made = joints()
    columns = dict(made.columns, **{turned: -made.columns[turned]})
    (note,) = misread(LogModel(Joints(), [Recording("made", made.time_s, columns)]))
    assert note.startswith("output second goes the other way than its speed, gyro, says")


class Hanging(Known):
    """A load of 1.5 N m on the first joint, of 3 kg m²: it shows which sign is wrong."""

    def derivative(self, state, inputs, c):
        rates = super().derivative(state, inputs, c)
        rates["first_rate"] = rates["first_rate"] - 0.5
        return rates


@pytest.mark.parametrize(
    ("turned", "said"),
    [
        ("first", "output first has the other sign"),
        ("motor_1_nm", "input motor_1_nm has the other sign"),
    ],
)
def test_which_sign_is_wrong_is_told_where_a_load_shows_it(turned, said):
    made = joints()
    motor = made.columns["motor_1_nm"]
    place, _ = moved(motor - 1.5, 3.0, 2.0, 0)
    columns = dict(made.columns, first=place)
    columns[turned] = -columns[turned]
    (note,) = misread(LogModel(Hanging(), [Recording("made", made.time_s, columns)]))
    assert f"far better if {said}: " in note


class Driven(System):
    """A cart with a known drive and drag; both its place and its speed are of one encoder."""

    rate_hz = 50.0
    inputs = [Input("drive", "1")]
    states = {"place": "m", "speed": "m/s"}
    outputs = [Output("place", "m"), Output("speed", "m/s")]
    constants = [Constant("push_n", 4.0, spread=0.1), Constant("drag", 0.8, spread=0.1, unit="1")]
    ports = [Port.input("drive")]

    def derivative(self, state, inputs, c):
        rate = (c.push_n * inputs.drive - c.drag * state.speed) / 2.0
        return {"place": state.speed, "speed": rate}


@pytest.mark.parametrize("kind", [float, bool, np.uint8])
def test_an_input_without_a_sign_is_not_said_to_have_the_other(kind):
    """A pulse is on or off; the encoder counts the other way, in both of its columns."""
    drive = (pushes(0) > 0.0).astype(kind)
    place, speed = moved(4.0 * drive.astype(float), 2.0, 0.8, 1)
    logged = {"drive": drive, "place": -place, "speed": -speed}
    (note,) = misread(LogModel(Driven(), [Recording("made", np.arange(400) / 50.0, logged)]))
    assert "far better if outputs place and speed both have the other sign: " in note


@pytest.mark.parametrize("name", [
    "positioning system", "pendulum, position control", "pendulum, energy shaping",
    "double pendulum", "SO-101, elbow", "drone, climbing and sinking", "hydraulic actuator",
])  # fmt: skip
def test_of_recordings_in_their_right_units_nothing_is_said(
    recordings: Callable[[str], object], name: str
) -> None:
    """Though each lacks an effect that the literature names."""
    (case,) = (c for c in CASES if c.name == name)
    recordings(case.files[0].split("/")[0])
    assert misread(LogModel(system_of(case, "out"), recordings_of_case(case, "out"))) == []
