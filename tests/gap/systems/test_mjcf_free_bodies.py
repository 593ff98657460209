"""A MuJoCo body that moves freely, held against MuJoCo and against SciPy's rotations."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from made_answers import answer_with
from scipy.spatial.transform import Rotation

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.artefacts import Size, Sizes
from wakedeploy.gap.systems.files import read_system
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.mjcf.corrected import CORRECTED
from wakedeploy.gap.systems.mjcf.reading import read_elements
from wakedeploy.gap.systems.mjcf.system import MjcfSystem
from wakedeploy.gap.systems.mjcf.template import mjcf_template
from wakedeploy.gap.systems.ports import Point

# Four rotors beside a mass whose centre is above the origin; a hinge turns a camera below it.
COPTER = """
<mujoco model="copter">
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="copter" pos="0 0 1">
      <freejoint/>
      <site name="imu"/>
      <geom type="box" size="0.1 0.12 0.03" pos="0 0 0.02" mass="0.9"/>
      <site name="fl" pos="0.15 0.15 0"/> <site name="fr" pos="0.15 -0.15 0"/>
      <site name="bl" pos="-0.15 0.15 0"/> <site name="br" pos="-0.15 -0.15 0"/>
      <body name="camera" pos="0 0 -0.05">
        <joint name="tilt" axis="0 1 0" damping="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.05 0 -0.02" size="0.01" mass="0.05"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="fl" site="fl" gear="0 0 1 0 0 -0.02"/>
    <motor name="fr" site="fr" gear="0 0 1 0 0 0.02"/>
    <motor name="bl" site="bl" gear="0 0 1 0 0 0.02"/>
    <motor name="br" site="br" gear="0 0 2 0 0 -0.02"/>
    <position name="tilt" joint="tilt" kp="0.5"/>
  </actuator>
  {sensor}
</mujoco>
"""
NAMES = ["copter_x", "copter_y", "copter_z", "copter_roll", "copter_pitch", "copter_yaw", "tilt"]


def system_of(folder: Path, sensor: str = "") -> MjcfSystem:
    (folder / "copter.xml").write_text(COPTER.format(sensor=sensor))
    target = folder / "my_copter.py"
    target.write_text(mjcf_template(folder / "copter.xml", target))
    system = read_system(target)
    assert isinstance(system, MjcfSystem)
    return system


def test_rates_are_mujoco_s_own_and_angles_follow_scipy_s_rotations(tmp_path: Path) -> None:
    system, random, after_s = system_of(tmp_path), np.random.default_rng(0), 1e-6
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "copter.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    centre = data.subtree_com[1] - data.xpos[1]  # in the file's pose, which is level
    for _ in range(5):
        at, speeds = random.normal(0, 0.6, 7), random.normal(0, 0.5, 7)
        at[2] += 3.0
        pushes = random.normal(0, 0.5, 7)
        data.qpos[:3], data.qpos[7] = at[:3], at[6]
        data.qpos[3:7] = Rotation.from_euler("ZYX", at[5:2:-1]).as_quat(scalar_first=True)
        data.qvel[:] = speeds
        mujoco.mj_forward(model, data)
        # Pushed where its mass is: by MuJoCo's own map of a force at a place to its joints.
        place = data.xpos[1] + data.xmat[1].reshape(3, 3) @ centre
        data.qfrc_applied[:] = [0.0, 0.0, 0.0, *pushes[3:]]
        mujoco.mj_applyFT(model, data, pushes[:3], np.zeros(3), place, 1, data.qfrc_applied)
        data.ctrl[:] = commands = random.uniform(1.0, 3.0, 5)
        mujoco.mj_forward(model, data)
        later = data.qpos.copy()
        mujoco.mj_integratePos(model, later, data.qvel, after_s)
        turned = Rotation.from_quat(later[3:7], scalar_first=True).as_euler("ZYX")[::-1]
        moved = (np.array([*later[:3], *turned, later[7]]) - at) / after_s
        states = dict(zip(system.states, [*at, *speeds], strict=True))
        ports = [p.name for p in system.ports if p.role == "force"]
        rates = system.derivative_under(
            Point("state", states),
            Point("input", dict(zip((i.name for i in system.inputs), commands, strict=True))),
            system.values(),
            dict(zip(ports, pushes, strict=True)),
        )
        by_name = np.array([float(rates[name]) for name in system.states])
        np.testing.assert_allclose(by_name[:7], moved, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(by_name[7:], data.qacc, rtol=1e-6, atol=1e-6)


def test_a_free_body_has_the_states_that_its_file_says(tmp_path: Path) -> None:
    system = system_of(tmp_path)
    ends = ["m", "m", "m", "rad", "rad", "rad", "rad"]
    turns = ["copter_p_radps", "copter_q_radps", "copter_r_radps", "tilt_radps"]
    slides = ["copter_x_mps", "copter_y_mps", "copter_z_mps"]
    positions = [f"{name}_{end}" for name, end in zip(NAMES, ends, strict=True)]
    assert [*system.states] == [*positions, *slides, *turns]
    assert [o.name for o in system.outputs] == positions
    units = {i.name: i.unit for i in system.inputs}
    assert units["fl_command"] == "N"  # what its gear of 1 pushes with
    assert units["br_command"] == "1"
    constants = {c.name for c in system.constants}
    assert {"fl_gain", "copter_mass_kg", "tilt_damping"} <= constants
    assert not {"fl_gear", "copter_x_damping"} & constants
    heights = {p.name: p.height for p in system.ports if p.role == "force"}
    assert heights["copter_z_mps"] == "copter_z_m"
    assert heights["copter_x_mps"] == ""


@pytest.mark.parametrize(
    ("site", "is_shown"), [("", True), ('quat="0.7 0 0.7 0"', False)], ids=["along", "turned"]
)
def test_a_gyro_along_its_axes_shows_how_a_body_turns(
    tmp_path: Path, site: str, is_shown: bool
) -> None:
    sensor = '<sensor><gyro site="imu" noise="0.02"/><jointpos joint="tilt"/></sensor>'
    (tmp_path / "copter.xml").write_text(
        COPTER.format(sensor=sensor).replace('name="imu"', f'name="imu" {site}')
    )
    target = tmp_path / "my_copter.py"
    target.write_text(mjcf_template(tmp_path / "copter.xml", target))
    noise = {o.name: o.noise for o in read_system(target).outputs}
    assert noise.get("copter_q_radps") == (0.02 if is_shown else None)
    assert "copter_yaw_rad" in noise


def test_the_gain_of_a_rotor_scales_all_that_it_does(tmp_path: Path) -> None:
    system = system_of(tmp_path)
    states = Point("state", dict.fromkeys(system.states, 0.0) | {"copter_z_m": 2.0})
    names = [i.name for i in system.inputs]
    twice = dict.fromkeys(names, 0.0) | {"fl_command": 2.0}
    once = dict.fromkeys(names, 0.0) | {"fl_command": 1.0}
    plain = {c.name: c.value for c in system.constants}
    stronger = system.derivative(states, Point("input", once), Point("c", plain | {"fl_gain": 2.0}))
    by_command = system.derivative(states, Point("input", twice), Point("c", plain))
    for name, rate in by_command.items():
        assert stronger[name] == pytest.approx(rate, abs=1e-9)


def flight(seconds: float, rate_hz: float) -> dict[str, np.ndarray]:
    """A flight of MuJoCo's own, turning all ways, as a logger would have it."""
    model = mujoco.MjModel.from_xml_string(COPTER.format(sensor=""))
    data, random = mujoco.MjData(model), np.random.default_rng(1)
    data.qpos[2], data.qvel[3:6] = 30.0, (0.3, -0.2, 0.4)
    steps, rows, turned = round(1 / rate_hz / model.opt.timestep), [], []
    for k in range(round(seconds * rate_hz)):
        data.ctrl[:4] = 2.3, 2.3, 2.3, 1.15
        data.ctrl[:4] += 0.02 * np.sin(k / rate_hz * np.arange(1, 5))
        angles = Rotation.from_quat(data.qpos[3:7], scalar_first=True).as_euler("ZYX")[::-1]
        read = [*data.qpos[:3], *angles, data.qpos[7]] + 1e-4 * random.normal(size=7)
        rows.append([*data.ctrl, *read])
        turned.append(data.qvel[3:6].copy())
        for _ in range(steps):
            mujoco.mj_step(model, data)
    commands = [f"{name}_command" for name in ("fl", "fr", "bl", "br", "tilt")]
    positions = [f"{n}_{'m' if n[-1] in 'xyz' else 'rad'}" for n in NAMES]
    columns = dict(zip([*commands, *positions], np.array(rows).T, strict=True))
    return columns | {"turned": np.array(turned).T}


def test_how_it_turns_is_known_from_its_angles_and_angles_have_no_noise(tmp_path: Path) -> None:
    system, columns = system_of(tmp_path), flight(1.0, 100.0)
    turned = columns.pop("turned")
    model = LogModel(system, [Recording("flight", np.arange(100) / 100.0, columns)])
    rows = [[*system.states].index(f"copter_{letter}_radps") for letter in "pqr"]
    error = (model.along_logs()[rows] - turned)[:, 10:-10]
    assert np.abs(error).max() < 0.03  # rad/s
    assert not {f"copter_{a}_rad" for a in ("roll", "pitch", "yaw")} & {*model.driven}
    assert "copter_p_radps" in model.driven


def test_a_flight_of_mujoco_s_is_replayed(tmp_path: Path) -> None:
    system, columns = system_of(tmp_path), flight(1.0, 100.0)
    columns.pop("turned")
    replayed = system.simulate(Recording("flight", np.arange(100) / 100.0, columns))
    for name in ("copter_x_m", "copter_z_m", "copter_roll_rad", "copter_yaw_rad", "tilt_rad"):
        np.testing.assert_allclose(replayed[name], columns[name], atol=0.02)


def test_what_acts_on_a_free_body_has_no_attribute_and_that_is_said(tmp_path: Path) -> None:
    system = system_of(tmp_path)
    size = Size(value=0.2, low=0.1, high=0.3, unit="N/(m/s)")
    drag = {"viscous-friction@copter_x_mps": Sizes({"coefficient": size})}
    said = system.export(answer_with("named", drag, Sizes({})), tmp_path)
    assert "as a free joint has one number for all six axes" in " ".join(said)
    assert not (tmp_path / CORRECTED).exists()


def test_a_free_body_without_a_name_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "copter.xml"
    path.write_text(COPTER.format(sensor="").replace('<body name="copter" pos', "<body pos"))
    with pytest.raises(UnusableInput, match=r"a body has no name \(number 1 of the model\)"):
        read_elements(path)


ALIGNED = """
<mujoco>
  <compiler alignfree="true"/>
  <worldbody>
    <body name="hull" pos="0 0 1">
      <freejoint/>
      <geom type="box" size=".1 .05 .02" pos=".1 0 0" euler="0 0 40"/>
      <site name="prop"/>
    </body>
  </worldbody>
  <actuator><motor name="prop" site="prop" gear="0 0 1 0 0 0"/></actuator>
</mujoco>
"""


def test_a_body_has_the_frame_of_its_file_also_after_a_correction(tmp_path: Path) -> None:
    path = tmp_path / "hull.xml"
    path.write_text(ALIGNED)
    (tmp_path / "my_hull.py").write_text(mjcf_template(path, tmp_path / "my_hull.py"))
    system = read_system(tmp_path / "my_hull.py")
    assert isinstance(system, MjcfSystem)
    size = Size(value=0.1, low=0.09, high=0.11, unit="1")
    found = {"gain@prop_command": Sizes({"error": size})}
    system.export(answer_with("named", found, Sizes({})), tmp_path)
    pushed = []
    for text, command in ((ALIGNED.replace('"true"', '"false"'), 1.1),
                          ((tmp_path / CORRECTED).read_text(), 1.0)):  # fmt: skip
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        data.ctrl[:] = command
        mujoco.mj_forward(model, data)
        pushed.append(data.qacc.copy())
    np.testing.assert_allclose(*pushed, rtol=1e-4, atol=1e-4)  # a file has six digits
    states = Point("state", dict.fromkeys(system.states, 0.0) | {"hull_z_m": 1.0})
    rates = system.derivative(states, Point("input", {"prop_command": 1.1}), system.values())
    np.testing.assert_allclose([rates[n] for n in [*system.states][6:]], pushed[0], atol=1e-6)


BOAT = """
<mujoco>
  <worldbody>
    <body name="hull">
      <joint name="hull" type="free" damping="0.5"/>
      <site name="imu"/>
      <geom type="box" size=".5 .2 .1"/>
      <body name="rudder" pos="-.5 0 0">
        <joint name="rudder" axis="0 0 1"/>
        <geom type="box" size=".1 .01 .1"/>
        <body name="plate"><site name="second"/><geom type="sphere" size=".01"/></body>
      </body>
      <body name="box"><site name="third"/><geom type="sphere" size=".01"/></body>
    </body>
  </worldbody>
  <actuator>
    <motor name="surge" joint="hull" gear="1 0 0 0 0 .2"/>
    <motor name="yaw" joint="hull" gear="0 0 0 0 0 1"/>
    <position name="hold" site="imu" refsite="third" gear="1 0 0 0 0 0"/>
    <motor name="steer" joint="rudder"/>
  </actuator>
  <sensor><gyro site="{site}" noise="0.02"/></sensor>
</mujoco>
"""


@pytest.mark.parametrize(
    ("site", "is_shown"), [("imu", True), ("third", True), ("second", False)],
    ids=["on the body", "on what is fast to it", "beyond a hinge"],
)  # fmt: skip
def test_a_boat_is_read_as_its_file_has_it(tmp_path: Path, site: str, is_shown: bool) -> None:
    path, target = tmp_path / "boat.xml", tmp_path / "boat.py"
    path.write_text(BOAT.format(site=site))
    target.write_text(mjcf_template(path, target))
    system = read_system(target)
    units = {i.name: i.unit for i in system.inputs}
    assert units["surge_command"] == "N"
    assert units["yaw_command"] == units["steer_command"] == "N m"
    assert units["hold_command"] == "1"
    constants = {c.name: c.value for c in system.constants}
    assert constants["surge_gain"] == constants["yaw_gain"] == constants["steer_gear"] == 1.0
    assert not {"surge_gear", "yaw_gear", "hull_x_damping"} & {*constants}
    outputs = {o.name for o in system.outputs}
    assert "rudder_rad" in outputs  # no sensor of a joint says otherwise
    assert ("hull_r_radps" in outputs) == is_shown


def test_of_a_flight_upright_or_far_away_it_is_said(tmp_path: Path) -> None:
    system = system_of(tmp_path)
    level = {o.name: np.linspace(0.0, 0.5, 50) for o in system.outputs}
    assert not [n for n in system.log_notes(level) if "copter_" in n and "touch" not in n]
    steep = level | {"copter_pitch_rad": np.linspace(0.0, 1.5, 50)}
    assert any("copter_pitch_rad reaches 86°" in note for note in system.log_notes(steep))
    far = level | {"copter_y_m": 5.9e6 + np.linspace(0.0, 3.0, 50)}
    assert any("5900 km from the origin" in note for note in system.log_notes(far))
    states = dict.fromkeys(system.states, 0.0) | {"copter_y_m": 5.9e6, "copter_z_m": 2.0}
    none = Point("input", dict.fromkeys((i.name for i in system.inputs), 0.0))
    rates = system.derivative(Point("state", states), none, system.values())
    assert rates["copter_z_mps"] == pytest.approx(-9.81, abs=0.01)


def test_a_drag_turns_nothing_and_meets_the_whole_mass(tmp_path: Path) -> None:
    system = system_of(tmp_path)
    names = [i.name for i in system.inputs]
    angles = {"copter_roll_rad": 0.3, "copter_pitch_rad": -0.4, "copter_yaw_rad": 1.0}
    states = Point("state", dict.fromkeys(system.states, 0.0) | angles | {"copter_z_m": 2.0})
    none = Point("input", dict.fromkeys(names, 0.0))
    free, pushed = (
        system.derivative_under(states, none, system.values(), forces)
        for forces in ({}, {"copter_x_mps": 1.9})
    )
    change = {n: float(pushed[n]) - float(free[n]) for n in system.states}
    assert change["copter_x_mps"] == pytest.approx(1.9 / 0.95, rel=0.01)  # a camera hangs on it
    for letter in "pqr":
        assert abs(change[f"copter_{letter}_radps"]) < 0.3  # pushed at its origin, up to 5.3
    inertia = {c.name: c.value for c in system.constants}["copter_x_inertia_kg"]
    assert inertia == pytest.approx(0.95)
