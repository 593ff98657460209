"""A MuJoCo model as a system, held against MuJoCo's own forward dynamics and simulation."""

import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from made_answers import answer_with

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.artefacts import Size, Sizes
from wakedeploy.gap.systems.files import read_system
from wakedeploy.gap.systems.kinds.library import Effect, offered
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.mjcf.corrected import CORRECTED, RANGES
from wakedeploy.gap.systems.mjcf.reading import read_elements
from wakedeploy.gap.systems.mjcf.system import MjcfSystem
from wakedeploy.gap.systems.mjcf.template import coupling_notes, mjcf_template

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.05" armature="0.01" {shoulder}/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" damping="0.03" armature="0.005"/>
        <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="30" kv="1.0" forcerange="-20 20"/>
    <position name="elbow" joint="elbow" kp="15" kv="0.5" {elbow}/>
  </actuator>
  <sensor><jointpos joint="shoulder"/><jointpos joint="elbow"/></sensor>
</mujoco>
"""


_ALL_BUT_SENSORS = ARM[: ARM.index("  <actuator>")] + "</mujoco>"


def written(folder: Path, **more: str) -> Path:
    path = folder / "arm.xml"
    path.write_text(ARM.format(**{"shoulder": "", "elbow": "", **more}))
    return path


def system_of(folder: Path, **more: str) -> MjcfSystem:
    target = folder / "my_arm.py"
    target.write_text(mjcf_template(written(folder, **more), target))
    system = read_system(target)
    assert isinstance(system, MjcfSystem)
    return system


def test_the_written_file_asks_for_the_kinds_that_it_names(tmp_path: Path) -> None:
    ports = {port.name: port.kinds for port in system_of(tmp_path).ports}
    assert "dead-time" in ports["shoulder_command"]
    assert "coulomb-friction" in ports["elbow_radps"]
    assert "upper-stop" not in ports["elbow_radps"]
    assert "sensor-lag" in ports["elbow_rad"]


def test_rates_are_mujoco_s_own(tmp_path: Path) -> None:
    system = system_of(tmp_path, shoulder='frictionloss="0.4"', elbow='timeconst="0.06"')
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    assert system.kinematic() == {"shoulder_rad": "shoulder_radps", "elbow_rad": "elbow_radps"}
    for _ in range(5):
        mujoco.mj_resetData(model, data)
        x, u, tau = random.normal(0, 0.5, 5), random.normal(0, 0.5, 2), random.normal(0, 0.5, 2)
        damping = random.uniform(0.01, 0.2)
        model.dof_damping[1] = damping
        data.qpos[:], data.qvel[:], data.act[:], data.ctrl[:] = x[:2], x[2:4], x[4:], u
        data.qfrc_applied[:] = tau
        mujoco.mj_forward(model, data)
        told = system.derivative_under(
            system.point("state", dict(zip(system.states, x, strict=True))),
            system.point("input", dict(zip([i.name for i in system.inputs], u, strict=True))),
            system.values({"elbow_damping": damping}),
            {"shoulder_radps": tau[0], "elbow_radps": tau[1]},
        )
        assert [told["shoulder_radps"], told["elbow_radps"]] == pytest.approx(data.qacc, rel=1e-6)
        assert told["elbow_activation"] == pytest.approx(data.act_dot[0], rel=1e-6)


def offered_at_one(system: MjcfSystem, name: str) -> tuple[Effect, dict[str, float]]:
    """An effect of a system in which all sizes are 1, and the sizes."""
    sizes = dict.fromkeys((*system.states, *(f"d {n}" for n in system.states)), 1.0)
    sizes |= {i.name: 1.0 for i in system.inputs} | {f"y {o.name}": 1.0 for o in system.outputs}
    return offered(system, sizes, (0.01, 30.0))[name], sizes


def test_a_force_at_a_port_moves_the_whole_chain(tmp_path: Path) -> None:
    """Friction of the search is MuJoCo's damping, which the mass matrix hands on to both joints."""
    system = system_of(tmp_path)
    effect, sizes = offered_at_one(system, "viscous-friction@elbow_radps")
    acting = Acting(system, [effect], sizes)
    x = np.array([0.2, -0.4, 1.0, -2.0])
    u = {i.name: 0.1 for i in system.inputs}
    told = acting.rates(
        x, u, acting.constants({}, np.zeros(1)), {f"{effect.name}.coefficient": 0.2}, np.zeros(1)
    )
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    model.dof_damping[1] += 0.2
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = x[:2], x[2:], 0.1
    mujoco.mj_forward(model, data)
    assert told[2:] == pytest.approx(data.qacc, rel=1e-6)


def test_an_answer_is_written_as_the_model_that_it_is(tmp_path: Path) -> None:
    """The corrected file moves as the one from which the answer was made up."""
    system = system_of(tmp_path)

    def size(value: float, unit: str = "s") -> Size:
        return Size(value=value, low=0.9 * value, high=1.1 * value, unit=unit)

    found: dict[str, Sizes] = {
        "coulomb-friction@shoulder_radps": {"force": size(0.4, "N m")},
        "viscous-friction@elbow_radps": {"coefficient": size(0.02)},
        "lag@elbow_command": {"tau_s": size(0.06)},
        "dead-time@shoulder_command": {"delay_s": size(0.025)},
        "gravity@elbow_radps": {"sine": size(0.1), "cosine": size(0.1)},
    }
    constants = {"elbow_kp": size(16.0), "lower_mass_kg": size(0.35), "elbow_damping": size(0.04)}
    told = answer_with("named", found, constants)
    (tmp_path / "out").mkdir()
    said = system.export(told, tmp_path / "out")
    assert "gravity@elbow_radps" in said[-1]
    ranges = (tmp_path / "out" / RANGES).read_text()
    assert 'attribute = "damping"\nnominal = 0.06\nlow = 0.054' in ranges

    direct = written(
        tmp_path,
        shoulder='frictionloss="0.4"',
        elbow='timeconst="0.06"',
    ).read_text()
    direct = direct.replace('damping="0.03"', 'damping="0.06"').replace('kp="15"', 'kp="16"')
    direct = direct.replace('mass="0.3"', 'mass="0.35"')
    direct = direct.replace('forcerange="-20 20"', 'forcerange="-20 20" delay="0.025" nsample="26"')
    models = [
        mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED)),
        mujoco.MjModel.from_xml_string(direct),
    ]
    ends = []
    for model in models:
        data = mujoco.MjData(model)
        for k in range(500):
            data.ctrl[:] = 0.3 * np.sin(0.02 * k), 0.5
            mujoco.mj_step(model, data)
        ends.append(data.qpos.copy())
    assert ends[0] == pytest.approx(ends[1], abs=1e-5)


SLIDE_AND_HINGE = """
<mujoco>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0"/><geom size="0.1"/>
      <body name="arm"><joint name="wrist" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/></body>
    </body>
  </worldbody>
  <tendon><fixed name="cord"><joint joint="rail" coef="1"/></fixed></tendon>
  <actuator>{actuator}</actuator>
  {more}
</mujoco>
"""


@pytest.mark.parametrize(
    ("actuator", "of_slide", "of_hinge"),
    [
        ("<motor JOINT/>", "N", "N m"),
        ('<motor JOINT gear="3"/>', "1", "1"),
        ('<general JOINT gainprm="3"/>', "1", "1"),
        ('<general JOINT dyntype="integrator"/>', "1", "1"),
        ('<position JOINT kp="5" kv="1"/>', "m", "rad"),
        ('<position JOINT kp="5" timeconst="0.1"/>', "m", "rad"),
        ('<general JOINT gainprm="5" biastype="affine" biasprm="0 -5 0"/>', "m", "rad"),
        ('<general JOINT gainprm="5" biastype="affine" biasprm="2 -5 0" dyntype="integrator"/>',
         "m/s", "rad/s"),
        ('<velocity JOINT kv="2"/>', "m/s", "rad/s"),
        ('<intvelocity JOINT kp="7" actrange="-1 1"/>', "m/s", "rad/s"),
        ('<damper JOINT kv="2" ctrlrange="0 1"/>', "1", "1"),  # of its damping
        ('<cylinder JOINT area="2" timeconst="0.1"/>', "Pa", "Pa"),
        ('<muscle JOINT lengthrange="-1 1"/>', "1", "1"),  # of its excitation
        ('<dcmotor JOINT motorconst="0.05" resistance="1"/>', "V", "V"),
        ('<general JOINT biastype="affine" biasprm="2 0 0"/>', "N", "N m"),
    ],
)  # fmt: skip
def test_a_command_has_the_unit_of_what_it_asks_for(
    tmp_path: Path, actuator: str, of_slide: str, of_hinge: str
) -> None:
    """As MuJoCo has it of each type of actuator."""
    for joint, unit in (("rail", of_slide), ("wrist", of_hinge)):
        path = tmp_path / f"{joint}.xml"
        there = actuator.replace("JOINT", f'name="a" joint="{joint}"')
        path.write_text(SLIDE_AND_HINGE.format(actuator=there, more=""))
        text = mjcf_template(path, tmp_path / "my_arm.py")
        assert f'Input("a_command", "{unit}"),' in text
        (tmp_path / "my_arm.py").write_text(text)
        read_system(tmp_path / "my_arm.py")


@pytest.mark.parametrize(
    "actuator",
    ['<adhesion name="a" body="cart" gain="3" ctrlrange="0 1"/>', '<motor name="a" tendon="cord"/>',
     '<position name="a" tendon="cord" kp="3"/>'],
)  # fmt: skip
def test_what_acts_on_no_joint_has_a_command_without_unit(tmp_path: Path, actuator: str) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(SLIDE_AND_HINGE.format(actuator=actuator, more=""))
    assert 'Input("a_command", "1"),' in mjcf_template(path, tmp_path / "my_arm.py")


@pytest.mark.parametrize(
    ("actuator", "unit"),
    [
        ('<position name="a" joint="wrist" kp="5" timeconst="0.1"/>', "rad"),
        ('<intvelocity name="a" joint="rail" kp="7" actrange="-1 1"/>', "m"),
        ('<muscle name="a" joint="rail" lengthrange="-1 1"/>', "1"),
    ],
)
def test_an_activation_has_the_unit_of_what_it_holds(
    tmp_path: Path, actuator: str, unit: str
) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(SLIDE_AND_HINGE.format(actuator=actuator, more=""))
    text = mjcf_template(path, tmp_path / "my_arm.py")
    assert f'"a_activation": "{unit}",' in text
    assert 'Output("a_activation' not in text


def test_an_output_has_the_noise_that_its_sensor_states(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(shoulder="", elbow="").replace(
        '<jointpos joint="shoulder"/>', '<jointpos joint="shoulder" noise="0.0037"/>'
    ))  # fmt: skip
    text = mjcf_template(path, tmp_path / "my_arm.py")
    assert 'Output("shoulder_rad", "rad", noise=0.0037),' in text
    assert 'Output("elbow_rad", "rad", noise=0.0037),' not in text


def test_joints_that_an_equality_holds_are_told_of(tmp_path: Path) -> None:
    """A search of a gripper with coupled fingers may take hours, unless they are welded."""
    path = tmp_path / "arm.xml"
    pair = '<equality><joint joint1="rail" joint2="wrist" active="{}"/></equality>'
    path.write_text(SLIDE_AND_HINGE.format(actuator="", more=pair.format("true")))
    (note,) = coupling_notes(path)
    assert note.startswith("joints rail and wrist are held by an equality")
    text = mjcf_template(path, tmp_path / "my_arm.py")
    assert "        # joints rail and wrist are held by an equality" in text
    assert max(map(len, text.splitlines())) <= 110
    (tmp_path / "my_arm.py").write_text(text)
    read_system(tmp_path / "my_arm.py")
    path.write_text(SLIDE_AND_HINGE.format(actuator="", more=pair.format("false")))
    assert coupling_notes(path) == []


def test_bodies_that_touch_where_logs_have_been_are_told_of(tmp_path: Path) -> None:
    """A floor under the arm: the hand goes through it where the elbow hangs down."""
    floor = '<worldbody><geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -0.2"/>'
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(shoulder="", elbow="").replace("<worldbody>", floor, 1))
    target = tmp_path / "my_arm.py"
    target.write_text(mjcf_template(path, target))
    system = read_system(target)
    shoulder, elbow = np.zeros(200), np.linspace(0.0, np.pi / 2.0, 200)
    (told,) = system.log_notes({"shoulder_rad": shoulder, "elbow_rad": elbow})
    # The capsule's end, 0.25 m below at a right angle, is 0.02 m thick: sin q > 0.18 / 0.25.
    share = float(np.mean(0.25 * np.sin(elbow) > 0.18))
    assert f"touch at {share:.0%} of the samples (world and lower)" in told
    rarely = np.where(np.arange(200) == 199, elbow, 0.0)
    assert "less than 1%" in system.log_notes({"shoulder_rad": shoulder, "elbow_rad": rarely})[0]
    assert system.log_notes({"shoulder_rad": shoulder, "elbow_rad": 0.0 * elbow}) == []
    assert system.log_notes({"elbow_rad": elbow}) == []  # of the shoulder nothing is known


def test_contacts_of_stated_pairs_and_within_a_margin_are_told_of(tmp_path: Path) -> None:
    """They push without the kinds of a geom, and before it is reached."""
    floor = (
        '<worldbody><geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -0.2" contype="0"'
        ' conaffinity="0"/>'
    )
    pair = '<contact><pair geom1="floor" geom2="hand" margin="0.05"/></contact></mujoco>'
    text = ARM.format(shoulder="", elbow="").replace("<worldbody>", floor, 1)
    text = text.replace('0.25 0 0" size="0.02"', '0.25 0 0" size="0.02" name="hand"')
    text = text.replace("<geom type", '<geom contype="0" conaffinity="0" type')
    path, target = tmp_path / "arm.xml", tmp_path / "my_arm.py"
    path.write_text(text.replace("</mujoco>", pair))
    target.write_text(mjcf_template(path, target))
    system, shoulder = read_system(target), np.zeros(2)
    for sine, told in ((0.5, 0), (0.6, 1), (0.9, 1)):  # 0.125 m, 0.15 and 0.225 down, of 0.18
        elbow = np.full(2, np.arcsin(sine))
        assert len(system.log_notes({"shoulder_rad": shoulder, "elbow_rad": elbow})) == told


@pytest.mark.parametrize("left_out", ['<exclude body1="world" body2="lower"/>', ""])
def test_contacts_that_the_model_leaves_out_are_not_told_of(tmp_path: Path, left_out: str) -> None:
    floor = '<worldbody><geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -0.2"/>'
    text = ARM.format(shoulder="", elbow="").replace("<worldbody>", floor, 1)
    path, target = tmp_path / "arm.xml", tmp_path / "my_arm.py"
    path.write_text(text.replace("</mujoco>", f"<contact>{left_out}</contact></mujoco>"))
    target.write_text(mjcf_template(path, target))
    down = {"shoulder_rad": np.zeros(2), "elbow_rad": np.full(2, np.pi / 2.0)}
    assert bool(read_system(target).log_notes(down)) == (not left_out)


@pytest.mark.parametrize(
    ("delay", "acts_s"),
    [('delay="0.02" nsample="5"', 0.005), ('delay="0.0205" nsample="30"', 0.021),
     ('delay="0.0205" nsample="30" interp="linear"', 0.0205)],
)  # fmt: skip
def test_a_command_waits_as_long_as_mujoco_lets_it(
    tmp_path: Path, delay: str, acts_s: float
) -> None:
    """By its buffer, and without interpolation by whole steps: here of 1 ms."""
    elements = read_elements(written(tmp_path, elbow=delay))
    assert [a.delay_s for a in elements.actuators] == pytest.approx([0.0, acts_s])
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, forces = mujoco.MjData(model), []
    data.ctrl[1] = 0.2
    for _ in range(40):
        mujoco.mj_step(model, data)
        forces.append(float(data.actuator_force[1]))
    acts = np.array(forces) > 1.4  # half of 15 N m/rad times 0.2 rad
    assert int(np.argmax(acts)) == pytest.approx(acts_s / 0.001, abs=0.6)


def test_files_may_have_any_names(tmp_path: Path) -> None:
    model, target = tmp_path / 'arm "2" FILE.xml', tmp_path / 'STATES "of" \\N.py'
    model.write_text(SLIDE_AND_HINGE.format(actuator='<motor name="a" joint="rail"/>', more=""))
    target.write_text(mjcf_template(model, target))
    assert read_system(target).name == "STATESOfN"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco", "it is no XML (unclosed token"),
        ("<mujoco/>", "nothing moves in it"),
        (ARM.replace("armature", "armatur", 1), "MuJoCo cannot read it (XML Error"),
        (ARM.replace('armature="0.005"', 'armature="inf"'), "joint has armature='inf'"),
        (ARM.replace('armature="0.005"', 'armature="-0.005"').replace('mass="0.3"', 'mass="1e-9"'),
         "what it moves has no usable mass"),
        (ARM.replace('"elbow"', '"²"'), "joint '²': give it a name of letters"),
        (ARM.replace("<option", '<size nuser_body="1000000000"/><option'), "size has nuser_body="),
        (ARM.replace("<worldbody>", '<worldbody><replicate count="100"><replicate count="100">'
                     '<site/></replicate></replicate>'), "more than 5000 elements"),
        (ARM.replace("<worldbody>", '<worldbody><replicate count="1000000000"><site/></replicate>'),
         "more than 5000 elements"),
        (ARM.replace("<worldbody>", '<worldbody><replicate count="+99999"><site/></replicate>'),
         "more than 5000 elements"),
        ("<!DOCTYPE mujoco [<!ENTITY a 'b'>]>" + ARM.strip(), "it declares a document type"),
        (_ALL_BUT_SENSORS.replace('axis="0 1 0"', 'type="ball"', 1),
         "joint 'shoulder' is a ball"),
        (ARM.replace('name="elbow" axis', "axis").replace('joint="elbow"', 'joint="shoulder"'),
         'a joint has no name (number 2 of the model), and logs refer to it by name; add name="'),
        (ARM.replace('<position name="elbow"', "<position"),
         "an actuator has no name (number 2 of the model)"),
        (ARM.replace("{elbow}", 'nsample="30"'), "keeps more from step to step than positions"),
        (ARM.replace('joint="shoulder"/><', 'joint="shoulder" nsample="4"/><'),
         "take out `nsample` of actuators and sensors"),
    ],
)  # fmt: skip
def test_what_no_system_can_have_is_said_in_a_sentence(
    tmp_path: Path, text: str, said: str
) -> None:
    path = tmp_path / "bad.xml"
    path.write_text(text.replace("{shoulder}", "").replace("{elbow}", ""))
    with pytest.raises(UnusableInput) as error:
        read_elements(path)
    assert str(error.value).startswith(f"{path}: ")
    assert said in str(error.value)


def test_names_in_another_encoding_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"upper", "unté".encode("latin-1")))
    with pytest.raises(UnusableInput, match="it is no UTF-8 text"):
        read_elements(path)


def test_a_file_that_is_included_is_bounded_too(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_text(path.read_text().replace("<option", '<include file="more.xml"/><option'))
    (tmp_path / "more.xml").write_text('<mujoco><option density="nan"/></mujoco>')
    with pytest.raises(UnusableInput, match=r"more.xml \(included by .*arm.xml\): option has"):
        read_elements(path)


def test_mujoco_s_warnings_go_nowhere(tmp_path: Path) -> None:
    """They would stand in the middle of a command's output, and in a file beside the user's."""
    path = written(tmp_path)
    masses = 'armature="-0.005"', 'mass="1e-9"'
    path.write_text(path.read_text().replace('armature="0.005"', masses[0])
                    .replace('mass="0.3"', masses[1]))  # fmt: skip
    code = (
        "from pathlib import Path\n"
        "from wakedeploy.gap.systems.mjcf import reading\n"
        "try: reading.read_elements(Path('arm.xml'))\n"
        "except reading.UnusableInput: pass\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert ended.stdout + ended.stderr == ""
    assert [file.name for file in tmp_path.iterdir()] == ["arm.xml"]


def test_names_that_the_model_does_not_have_are_refused(tmp_path: Path) -> None:
    target = tmp_path / "my_arm.py"
    text = mjcf_template(written(tmp_path), target)
    target.write_text(text.replace('Constant("elbow_kp"', 'Constant("wrist_kp"'))
    with pytest.raises(UnusableInput, match=r"constant 'wrist_kp' is no attribute of .*elbow_kp"):
        read_system(target)


def test_friction_at_a_port_is_refused_where_mujoco_has_its_own(tmp_path: Path) -> None:
    target = tmp_path / "my_arm.py"
    text = mjcf_template(written(tmp_path), target)
    assert 'Port.force("elbow_radps", ' in text
    stated = 'Port.force("elbow_radps", friction="elbow_kp", '
    target.write_text(text.replace('Port.force("elbow_radps", ', stated))
    with pytest.raises(UnusableInput, match="port of 'elbow_radps' states a friction; MuJoCo's"):
        read_system(target)


LEVER = """
<mujoco model="lever">
  <compiler angle="radian"/>
  <worldbody>
    <body name="link">
      <joint name="shoulder" axis="0 1 0" damping="0.05" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
    </body>
  </worldbody>
  <actuator><position name="shoulder" joint="shoulder" kp="20" kv="0.8"{hidden}/></actuator>
  <sensor><jointpos joint="shoulder"/></sensor>
</mujoco>
"""
_FEWER = """
COMMAND = ["dead-time", "lag", "gain"]
JOINT = ["viscous-friction", "coulomb-friction", "offset"]
SENSOR = ["sensor-bias"]


class MyArm"""


def _lever(folder: Path, kinds: str) -> None:
    """The lever's model and system, at 50 Hz, with few kinds of effect."""
    (folder / "arm.xml").write_text(LEVER.format(hidden=""))
    target = folder / "my_arm.py"
    text = mjcf_template(folder / "arm.xml", target).replace("rate_hz = 100.0", "rate_hz = 50.0")
    target.write_text(text.replace("\n\nclass MyArm", kinds))


def test_a_model_whose_actuator_waits_is_read_replayed_and_corrected_again(tmp_path: Path) -> None:
    """As a first answer leaves it: what is searched next is beside the delay that is known."""
    waits = LEVER.format(hidden=' delay="0.06" nsample="31"')
    (tmp_path / "arm.xml").write_text(waits)
    target = tmp_path / "my_arm.py"
    text = mjcf_template(tmp_path / "arm.xml", target).replace("rate_hz = 100.0", "rate_hz = 50.0")
    assert 'Input("shoulder_command", "rad", delay_s=0.06),' in text
    target.write_text(text)
    system = read_system(target)
    assert isinstance(system, MjcfSystem)
    rows = np.genfromtxt(_log(tmp_path / "log.csv", waits, 0), delimiter=",", names=True)
    log = Recording("log", rows["time_s"], {n: rows[n] for n in rows.dtype.names[1:]})
    off = (system.simulate(log)["shoulder_rad"] - rows["shoulder_rad"])[50:]
    assert float(np.sqrt(np.mean(off**2))) < 2e-3  # of which 1e-3 are noise

    later = {
        "dead-time@shoulder_command": {"delay_s": Size(value=0.02, low=0.01, high=0.03, unit="s")}
    }
    (tmp_path / "out").mkdir()
    system.export(answer_with("named", later, {}), tmp_path / "out")
    corrected = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert corrected.actuator_delay[0] == pytest.approx(0.08)

    for wrong in ("", ', delay_s="0.06"', ", delay_s=None"):
        target.write_text(text.replace(", delay_s=0.06", wrong))
        with pytest.raises(UnusableInput, match=r"a delay of 0\.06 s; state the same in both"):
            read_system(target)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_hidden_dead_time_is_named_and_the_corrected_model_replays(tmp_path: Path) -> None:
    """MuJoCo itself replays a new log, from its commands alone, with a tenth of the error."""
    _lever(tmp_path, _FEWER)
    hidden = LEVER.format(hidden=' delay="0.04" nsample="21"')
    first, second = (_log(tmp_path / f"{seed}.csv", hidden, seed) for seed in (0, 1))
    command = [sys.executable, "-m", "wakedeploy", "gap", "close", "--system", "my_arm.py"]
    told = subprocess.run(
        [*command, "--measured", first.name, "--out", "gap"],
        cwd=tmp_path, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    assert "lacks a delay before shoulder_command acts (`dead-time@shoulder_command`)." in told
    rows = np.genfromtxt(second, delimiter=",", names=True)
    off = [
        _played(mujoco.MjModel.from_xml_path(str(path)), rows["shoulder_command"])
        - rows["shoulder_rad"]
        for path in (tmp_path / "arm.xml", tmp_path / "gap" / CORRECTED)
    ]
    before, after = (float(np.sqrt(np.mean(one**2))) for one in off)
    assert before > 0.02
    assert after < 0.1 * before, (before, after)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_hidden_dry_friction_is_named_with_its_size_and_no_play_beside_it(tmp_path: Path) -> None:
    """A servo that sticks follows as one with play does, unless what sticks is truly held."""
    _lever(tmp_path, _FEWER.replace('"lag", "gain"', '"backlash"'))
    hidden = LEVER.format(hidden="").replace('damping="0.05"', 'damping="0.05" frictionloss="0.2"')
    _log(tmp_path / "first.csv", hidden, 0)
    command = [sys.executable, "-m", "wakedeploy", "gap", "close", "--system", "my_arm.py"]
    subprocess.run([*command, "--measured", "first.csv", "--out", "gap"], cwd=tmp_path, check=True)
    answer = json.loads((tmp_path / "gap" / "name.json").read_text())
    assert [e["name"] for e in answer["effects"]] == ["coulomb-friction@shoulder_radps"]
    force = answer["effects"][0]["parameters"]["force"]
    assert force["low"] < 0.2 < force["high"]
    assert force["high"] - force["low"] < 0.1


def test_a_unit_of_friction_acts_through_the_mass_matrix(tmp_path: Path) -> None:
    system = system_of(tmp_path)
    effect, sizes = offered_at_one(system, "coulomb-friction@shoulder_radps")
    acting = Acting(system, [effect], sizes)
    x = np.array([0.3, -0.5, 0.2, 0.1])
    u = {"shoulder_command": np.zeros(1), "elbow_command": np.zeros(1)}
    values = {f"{effect.name}.force": 0.2, f"{effect.name}.turning": 0.01}
    constants = acting.constants({}, np.zeros(1))
    strengths, _, answers = acting.rubbed(x[:, None], u, constants, values, np.zeros(1))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, alone = mujoco.MjData(model), np.array([[1.0, 0.0]])
    data.qpos[:] = x[:2]
    mujoco.mj_forward(model, data)
    pushed = np.zeros_like(alone)
    mujoco.mj_solveM(model, data, pushed, alone)
    assert strengths[0] == pytest.approx([0.2])
    assert answers[0, 2:, 0] == pytest.approx(pushed[0], rel=1e-6)
    assert answers[0, :2, 0] == pytest.approx([0.0, 0.0])


def _log(path: Path, text: str, seed: int) -> Path:
    random = np.random.default_rng(seed)
    time_s = np.arange(1500) / 50.0
    waves = zip(random.uniform(0.1, 1.5, 8), random.uniform(0, 6.28, 8), strict=True)
    commands = sum(0.25 * np.sin(2 * np.pi * f * time_s + p) / (1 + f) for f, p in waves)
    commands = commands + np.repeat(random.uniform(-0.4, 0.4, 30), 50)
    shown = _played(mujoco.MjModel.from_xml_string(text), commands)
    shown += 1e-3 * random.standard_normal(len(shown))
    header = "time_s,shoulder_command,shoulder_rad"
    table = np.column_stack([time_s, commands, shown])
    np.savetxt(path, table, "%.6f", ",", header=header, comments="")
    return path


def _played(model: mujoco.MjModel, commands: np.ndarray) -> np.ndarray:
    """Angles at the samples of a log, each command held over ten steps of MuJoCo."""
    data = mujoco.MjData(model)
    data.qpos[0] = commands[0]
    shown = []
    for command in commands:
        shown.append(data.qpos[0])
        data.ctrl[0] = command
        mujoco.mj_step(model, data, nstep=10)
    return np.array(shown)
