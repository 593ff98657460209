"""Columns of logs that a system asks for: by name, by unit, and not where it could be another."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.guess_asked import Asked, matched
from wakedeploy.domains.tables.reading import read_recordings

VOLTAGE = Asked("motor_v", "input", "V")
PLACE = Asked("cart_m", "output", "m")
ANGLE = Asked("left_hip_pitch_1_rad", "output", "rad")
SPEED = Asked("speed_radps", "output", "rad/s")


def found(asked: list[Asked], columns: dict[str, str | None]) -> dict[str, str]:
    """Names of columns by the names of what they were taken for."""
    places = {("", name): unit for name, unit in columns.items()}
    return {match.asked.name: name for (_, name), match in matched(asked, places).found.items()}


@pytest.mark.parametrize(
    ("asked", "column", "unit"),
    [
        (VOLTAGE, "motor_mV", "mV"),
        (VOLTAGE, "Motor (V)", "V"),
        (VOLTAGE, "motorVoltage", None),
        (VOLTAGE, "/drive/motor", None),
        (ANGLE, "left hip/pitch-1", None),
        (ANGLE, "LeftHipPitch1 [deg]", "deg"),
        (PLACE, "encoder_mm", "mm"),
        (Asked("position_m", "output", "m"), "pos", None),
        (Asked("q_1_rad", "output", "rad"), "/joints/q[1]", None),
        (Asked("motor_command", "input", "rad"), "motor", None),
        (Asked("shoulder_pan_command", "input", "rad"), "shoulder_pan_cmd", None),
        (Asked("shoulder_pan_command", "input", "rad"), "action.shoulder_pan.pos", "deg"),
        (Asked("shoulder_pan_rad", "output", "rad"), "observation.state.shoulder_pan.pos", "deg"),
        (Asked("elbow_ref_rad", "input", "rad"), "elbowTarget", None),
        (Asked("shoulder_rad", "output", "rad"), "/joint_states/shoulder.position", None),
        (Asked("oven_c", "output", "°C"), "Oven (°C)", "°C"),
        (Asked("oven_k", "output", "K"), "oven", "°C"),
        (Asked("größe_v", "input", "V"), "Größe", None),
        (Asked("knee_rad", "output", "rad"), "/joint_states/knee/position", None),
        (Asked("knee_radps", "output", "rad/s"), "/joint_states/knee/velocity", None),
        (Asked("knee_ref_rad", "input", "rad"), "/cmd/knee/position", None),
        (SPEED, "gyro", "deg/s"),
        (VOLTAGE, "/motor.data", None),  # std_msgs/Float64
        (Asked("motor_cmd", "input", "1"), "/boat/motor_cmd.data", None),
    ],
)
def test_a_column_is_known_by_its_name_or_its_unit(asked: Asked, column: str, unit) -> None:
    assert found([asked], {column: unit, "temperature": "K"}) == {asked.name: column}


@pytest.mark.parametrize(
    ("asked", "columns"),
    [
        (VOLTAGE, {"motor_rpm": "rpm"}),  # another quantity of the same thing
        (VOLTAGE, {"left_motor": "V", "right_motor": "V"}),
        (ANGLE, {"ratio": "1"}),  # an angle is no pure number
        (PLACE, {"x": None, "y": None}),
        (Asked("share", "input", "1"), {"load": "%"}),
        (PLACE, {}),
        (PLACE, {"cart_ref": None}),
        (PLACE, {"cart_error_mm": "mm"}),
        (Asked("pan_command", "input", "rad"), {"pan_goal": None, "pan_target": None}),
        (Asked("heater_w", "input", "W"), {"heater_setpoint": None}),
        (Asked("pan_command", "input", "rad"), {"tilt_cmd": None}),
        (PLACE, {"cart_speed": None}),
        (Asked("theta_rad", "output", "rad"), {"theta_dot": None}),
        (Asked("joint_1_rad", "output", "rad"), {"joint_2": None}),
        (Asked("q_1_rad", "output", "rad"), {"q[0]": None}),
        (Asked("left_wheel_radps", "output", "rad/s"), {"right_wheel": None}),
        (VOLTAGE, {"motor_enabled": None}),
        (VOLTAGE, {"left_motor": None, "right_motor_v": "V"}),
        (Asked("motor_command", "input", "rad"), {"motor_position": None}),
        (Asked("rate_radps", "output", "rad/s"), {"temperature_rate": None}),
    ],
)
def test_what_could_be_two_or_has_another_quantity_is_neither(asked: Asked, columns) -> None:
    assert found([asked], columns) == {}


def test_a_joints_reading_is_told_from_what_is_asked_of_it() -> None:
    """As PlotJuggler writes both, by their topics."""
    columns = {"/joint_states/knee/position": None, "/cmd/knee/position": None,
               "/joint_states/knee/velocity": None, "/joint_states/hip/position": None}  # fmt: skip
    asked = [Asked("knee_target_rad", "input", "rad"), Asked("knee_rad", "output", "rad")]
    assert found(asked, columns) == {
        "knee_target_rad": "/cmd/knee/position", "knee_rad": "/joint_states/knee/position",
    }  # fmt: skip


def test_the_word_itself_comes_before_another_for_the_same() -> None:
    asked = [Asked(f"x_{word}_m", "input", "m") for word in ("ref", "command")]
    assert found(asked, {"x_ref": None, "x_command": None}) == {
        "x_ref_m": "x_ref", "x_command_m": "x_command"}  # fmt: skip
    pan = Asked("pan_command", "input", "rad")
    assert found([pan], {"pan_command_deg": "deg", "pan_target_deg": "deg"}) == {
        "pan_command": "pan_command_deg"}  # fmt: skip


def test_the_same_name_comes_first_and_a_unit_last() -> None:
    load = Asked("load_m", "output", "m")
    columns = {"cart": None, "cart_m": "m", "hook_mps": "m/s"}
    assert found([load, PLACE], columns) == {"cart_m": "cart_m"}
    assert found([PLACE], {"cart": "m", "height": "m"}) == {"cart_m": "cart"}
    assert found([load, PLACE], {"cart": "m", "hook": "m"}) == {"cart_m": "cart"}  # hook, perhaps


def test_two_that_one_column_could_be_have_none() -> None:
    current = Asked("motor_a", "output", "A")
    assert found([VOLTAGE, current], {"motor": None}) == {}
    assert found([VOLTAGE, current], {"motor": "A"}) == {"motor_a": "motor"}


def test_what_cannot_be_read_is_replaced_by_no_other() -> None:
    places = {("", "cart"): "m"}
    assert matched([PLACE], places, ["cart_m"]).found == {}


WORDS = st.lists(st.sampled_from(["cart", "pos", "ref", "1", "2", "[0]", "m"]), min_size=1).map(
    "_".join
)


@given(
    st.lists(st.sampled_from(["cart", "cart_1", "cart_2", "pos", "cart_pos"]), unique=True),
    st.dictionaries(
        WORDS | st.text(max_size=8), st.sampled_from([None, "m", "mm", "V"]), max_size=6
    ),
)
def test_nothing_is_found_twice_and_the_order_does_not_matter(names, columns) -> None:
    asked = [Asked(f"{name}_m", "output", "m") for name in names]
    forth = found(asked, columns)
    assert len(set(forth.values())) == len(forth)
    assert forth == found(asked[::-1], dict(reversed(columns.items())))


def log(path: Path, header: str) -> Path:
    t = np.arange(500) / 100.0
    rows = [t, 3.0 * np.sin(t), 1e3 * np.cos(t), np.where(t < 2.0, t, np.nan)]
    np.savetxt(path, np.column_stack(rows), "%.5f", ",", header=header, comments="")
    return path


def test_what_is_written_is_read_in_the_systems_names_and_units(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t,motor,encoder_mm,note")
    text = guess_columns(path, [VOLTAGE, PLACE, SPEED])
    assert 'unit = "V"  # ? the log does not say; taken as the system has it' in text
    assert 'column = "encoder_mm"  # ? the only one in such a unit' in text
    assert "# Not found: speed_radps [rad/s]; none is like it." in text
    (one,) = read_recordings([path], parse_columns(text), {"cart_m": "m"}).recordings
    assert set(one.columns) == {"motor_v", "cart_m"}
    assert one.columns["cart_m"] == pytest.approx(np.cos(np.arange(500) / 100.0), abs=1e-4)


def test_where_none_is_called_like_it_the_free_columns_in_such_a_unit_are_told(tmp_path) -> None:
    """A log in another language: whoever flew it knows which column is which."""
    header = "t,Schub links (N),Schub rechts (N),soll ref (m)"
    asked = [Asked("left_n", "input", "N"), Asked("depth_m", "output", "m"), VOLTAGE]
    text = " ".join(guess_columns(log(tmp_path / "log.csv", header), asked).split("\n# "))
    assert (
        "Not found: left_n [N]; none is called like it; by its unit it could be Schub links (N) or "
        "Schub rechts (N). Name its column [columns.left_n]" in text
    )
    assert "Not found: depth_m [m]; none is like it." in text  # what is wanted is measured nowhere
    assert "Not found: motor_v [V]; none is like it." in text


def test_no_other_column_takes_a_name_that_is_asked_for(tmp_path: Path) -> None:
    """A column that is called as an output, in another quantity, is left to the person."""
    path = log(tmp_path / "log.csv", "t,motor (V),cart_m (V),note")
    text = guess_columns(path, [VOLTAGE, PLACE])
    assert "[columns.cart_m_2]" in text
    assert "# Not found: cart_m [m]; none is like it." in text


def test_a_celsius_is_read_by_a_system_in_celsius(tmp_path: Path) -> None:
    asked = [VOLTAGE, Asked("oven_c", "output", "°C")]
    for header in ("t,motor (V),oven (°C),note", "t,motor (V),oven,note"):
        text = guess_columns(log(tmp_path / "log.csv", header), asked)
        read = read_recordings([tmp_path / "log.csv"], parse_columns(text), {"oven_c": "°C"})
        oven = read.recordings[0].columns["oven_c"]
        assert oven == pytest.approx(1e3 * np.cos(np.arange(500) / 100.0), abs=1e-2)


def test_a_name_that_a_columns_file_cannot_have_is_said(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t,größe,encoder_mm,note")
    text = guess_columns(path, [Asked("größe_v", "input", "V"), PLACE])
    assert "größe_v [V]; a column's name has letters from A to Z alone: rename it" in text
    assert "cart_m" in parse_columns(text).columns


def test_a_unit_that_nobody_knows_is_not_the_systems(tmp_path: Path) -> None:
    text = guess_columns(log(tmp_path / "log.csv", "t,motor (V),cart (furlong),note"), [PLACE])
    assert "the log says furlong, which is not known\n" in text
    assert "# Not found: cart_m" in text


def test_what_is_asked_for_is_listed_among_many(tmp_path: Path) -> None:
    names = [f"n{i:03d}" for i in range(450)]
    rows = np.random.default_rng(1).standard_normal((20, 450))
    rows = np.column_stack([np.arange(20) / 10.0, rows, rows[:, :2]])
    header = ",".join(["t", *names, "motor_v", "cart_m"])
    np.savetxt(tmp_path / "log.csv", rows, "%.5f", ",", header=header, comments="")
    text = guess_columns(tmp_path / "log.csv", [VOLTAGE, PLACE])
    assert "# Not found" not in text
    assert {"motor_v", "cart_m"} < set(parse_columns(text).columns)


def test_parts_of_a_recording_that_both_have_a_column_are_told(tmp_path: Path) -> None:
    folder = tmp_path / "fold"
    folder.mkdir()
    log(folder / "cmd.csv", "t,motor_v,load,note")
    log(folder / "state.csv", "t,motor_v,cart_mm,other")
    text = guess_columns(folder, [VOLTAGE, PLACE])
    assert "it could be motor_v of cmd.csv or motor_v of state.csv" in " ".join(text.split("\n# "))
    assert 'column = "cart_mm"  # ? by its name' in text


X, YAW = Asked("x_m", "output", "m"), Asked("yaw_rad", "output", "rad")


@pytest.mark.parametrize(
    ("asked", "columns", "likes"),
    [
        (X, {"/mocap.pose.position.x": "m", "/odom.position.x": "mm"}, 2),
        (X, {"/mocap.pose.position.y": "m", "/odom.position.z": "m"}, 0),
        (X, {"/odom.linear.x": "m/s", "/imu.orientation.x": "1", "/fix.x": None}, 0),
        (X, {"tool_x_ref": "m", "tool_y": "m"}, 0),  # what a controller wants is measured nowhere
        (Asked("left_hip_rad", "output", "rad"), {"left_knee": "rad", "right_hip": "rad"}, 0),
        (Asked("position_m", "output", "m"), {"x": "m", "y": "m"}, 0),  # any is a position
    ],
)
def test_what_could_be_asked_for_is_told_where_none_is_it(asked: Asked, columns, likes) -> None:
    matches = matched([asked], {("", name): unit for name, unit in columns.items()})
    assert not matches.found
    assert [name for _, name in matches.undecided[asked]] == list(columns)[:likes]


def test_what_was_taken_is_not_told_again() -> None:
    names = ("x_m", "tool_x", "arm_x")
    asked = [X, Asked("hand_x_m", "output", "m")]
    assert matched(asked, {("", name): "m" for name in names}).undecided == {asked[1]: []}
    asked = [PLACE, X]
    columns = {("", name): "m" for name in ("cart_m", "tool_x", "arm_x")}
    assert matched(asked, columns).undecided == {X: [("", "tool_x"), ("", "arm_x")]}


@pytest.mark.parametrize(
    ("count", "said"), [(2, "{} or {}"), (6, "{} or {} or {} or {} or one of 2 more")]
)
def test_angles_of_two_quaternions_are_both_told(tmp_path: Path, count: int, said: str) -> None:
    half = 0.5 * np.linspace(0.0, 3.0, 100)
    zeros = np.zeros_like(half)
    sides = [[zeros, zeros, np.sin(half), np.cos(half)] for _ in range(count)]
    stems = [f"sensor{number}.orientation" for number in range(count)]
    header = ",".join(["t", *(f"{stem}.{letter}" for stem in stems for letter in "xyzw")])
    rows = np.column_stack([np.arange(100) / 50.0, *(part for side in sides for part in side)])
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=header, comments="")
    text = " ".join(guess_columns(tmp_path / "log.csv", [YAW]).split("\n# "))
    named = said.format(*(f"the yaw of {stem}" for stem in stems))
    assert f"Not found: yaw_rad [rad]; it could be {named}. Name its column" in text


@pytest.mark.parametrize("stem", ["drone_q", "drone.pose.orientation.", "q", "mocap_rot_"])
def test_all_angles_of_a_quaternion_may_be_asked_for(tmp_path: Path, stem: str) -> None:
    angles = 0.4 * np.sin(np.arange(3)[:, None] + np.linspace(0.0, 3.0, 100))  # yaw, pitch, roll
    quaternions = Rotation.from_euler("ZYX", angles.T).as_quat()
    rows = np.column_stack([np.arange(100) / 50.0, quaternions])
    header = "t," + ",".join(f"{stem}{letter}" for letter in "xyzw")
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=header, comments="")
    asked = [Asked(f"drone_{angle}_rad", "output", "rad") for angle in ("yaw", "pitch", "roll")]
    text = guess_columns(tmp_path / "log.csv", asked)
    (read,) = read_recordings([tmp_path / "log.csv"], parse_columns(text)).recordings
    for each, expected in zip(asked, angles, strict=True):
        assert read.columns[each.name] == pytest.approx(expected, abs=1e-4)


def test_the_heading_of_a_quaternion_may_be_asked_for(tmp_path: Path) -> None:
    half = 0.5 * np.linspace(0.0, 3.0, 100)
    zero = np.zeros(100)
    rows = np.column_stack([np.arange(100) / 50.0, zero, zero, np.sin(half), np.cos(half)])
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header="t,q_x,q_y,q_z,q_w", comments="")
    text = guess_columns(tmp_path / "log.csv", [Asked("q_yaw_rad", "output", "rad")])
    (read,) = read_recordings([tmp_path / "log.csv"], parse_columns(text)).recordings
    assert read.columns["q_yaw_rad"] == pytest.approx(2.0 * half, abs=1e-3)


def test_a_column_that_gets_another_name_loses_the_unit_of_its_own(tmp_path: Path) -> None:
    """With `to = "bar"` left in it, [columns.tank_pa] is refused."""
    log = tmp_path / "log.csv"
    rows = np.column_stack([np.arange(100) / 20.0, *([np.linspace(0.5, 1.3, 100)] * 2)])
    np.savetxt(log, rows, "%.6f", ",", header="t [s],p_tank [bar],p_supply [bar]", comments="")
    text = guess_columns(
        log, [Asked("tank_pa", "output", "Pa"), Asked("supply_pa", "output", "Pa")]
    )
    told = " ".join(text.split("\n# "))
    assert 'Name its column [columns.tank_pa], with role = "output" and without `to`.' in told
    renamed = text.replace("p_tank_bar]", "tank_pa]").replace("p_supply_bar]", "supply_pa]")
    followed = [line for line in renamed.splitlines() if not line.startswith("to = ")]
    columns = parse_columns("\n".join(followed).replace('"unused"', '"output"'))
    (recording,) = read_recordings([log], columns).recordings
    assert recording.columns["tank_pa"][0] == pytest.approx(0.5e5)


@pytest.mark.parametrize(
    ("header", "asked", "unit", "factor"),
    [
        ("enc_deg", "angle_deg", "deg", 1.0), ("enc_rad", "angle_deg", "deg", 180.0 / np.pi),
        ("tank_kpa", "tank", "bar", 0.01), ("enc_deg", "angle_rad", "rad", np.pi / 180.0),
    ],
)  # fmt: skip
def test_python_reads_a_guessed_column_in_the_systems_unit_too(
    header: str, asked: str, unit: str, factor: float, tmp_path: Path
) -> None:
    """`read_log` knows no system; it refused the name, or gave its replay other numbers."""
    path = tmp_path / "log.csv"
    path.write_text(f"t,{header}\n" + "".join(f"{k / 100},{k % 9}\n" for k in range(99)))
    guessed = guess_columns(path, [Asked(asked, "output", unit)], 100.0)
    assert ("to = " in guessed) == (unit != "rad")
    (read,) = read_recordings([path], parse_columns(guessed)).recordings
    np.testing.assert_allclose(read.columns[asked], [k % 9 * factor for k in range(99)])


def test_where_a_sensor_of_a_system_fails_the_recording_goes_on(tmp_path: Path) -> None:
    """A reading in 50 that failed made 80 recordings of half a second."""
    path = tmp_path / "log.csv"
    rows = (f"{k / 100},{k % 7},{'nan' if k % 50 == 9 else k % 9}\n" for k in range(4000))
    path.write_text("t,motor_v,cart_m\n" + "".join(rows))
    guessed = guess_columns(path, [VOLTAGE, Asked("cart_m", "output", "m")], 100.0)
    (read,) = read_recordings([path], parse_columns(guessed)).recordings
    assert np.flatnonzero(np.isnan(read.columns["cart_m"])).tolist() == list(range(9, 4000, 50))
