"""A corrected MJCF, held against MuJoCo with the effect applied from outside at every step."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from made_answers import answer_with

from wakedeploy.gap.search.artefacts import Answer, Measured, Size, Sizes
from wakedeploy.gap.systems.files import read_system
from wakedeploy.gap.systems.mjcf.ranges import CORRECTED, RANGES
from wakedeploy.gap.systems.mjcf.system import MjcfSystem
from wakedeploy.gap.systems.mjcf.template import mjcf_template

RIG = """
<mujoco model="rig">
  <compiler angle="degree"/>
  <option timestep="0.0005" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" damping="2" {rail}/>
      <geom type="box" size="0.1 0.1 0.1" mass="2"/>
      <body name="arm" pos="0 0 0.1">
        <joint name="wrist" axis="0 1 0" damping="0.1" {wrist}/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""
GEARED = '<motor name="drive" joint="rail" gear="-40" {more}/>'
SERVO = '<position name="drive" joint="rail" kp="50" kv="3" {more}/>'
SPEED = '<velocity name="drive" joint="rail" kv="8" {more}/>'
LOOSE = (
    '<general name="drive" joint="rail" gainprm="4" biastype="affine" biasprm="0.7 -20 -1" {more}/>'
)
UNUSED = '<general name="drive" joint="rail" gainprm="4" biasprm="9 9 9" gear="2" {more}/>'
SLOW = '<position name="drive" joint="rail" kp="50" timeconst="0.02" {more}/>'
DAMPER = '<damper name="drive" joint="rail" kv="3" ctrlrange="0 2" {more}/>'
TILTED_N = -1.02


def written(folder: Path, actuators: str, rail: str = "", wrist: str = "") -> MjcfSystem:
    """A model, and the system that `gap init` makes of it."""
    text = RIG.format(rail=rail, wrist=wrist, actuators=actuators.replace("{more}", ""))
    (folder / "rig.xml").write_text(text)
    target = folder / "my_rig.py"
    target.write_text(mjcf_template(folder / "rig.xml", target))
    system = read_system(target)
    assert isinstance(system, MjcfSystem)
    (folder / "out").mkdir(exist_ok=True)
    return system


def size(value: float, unit: str = "1", half: float | None = None) -> Size:
    half = 0.1 * abs(value) if half is None else half
    return Size(value=value, low=value - half, high=value + half, unit=unit)


def answered(*effects: tuple[str, Sizes], verdict: str = "named", **constants: Size) -> Answer:
    """What name.json has of it."""
    return answer_with(verdict, dict(effects), constants)


@dataclass
class Outside:
    """What acts on the model as it was: a force on the rail, and what becomes of a command."""

    force_n: Callable[[float, float], float] = lambda x, v: 0.0
    command: Callable[[float], float] = lambda u: u


def replayed(path: Path, acting: Outside | None = None, act: float = 0.0) -> np.ndarray:
    """Positions along half a second of commands, by MuJoCo alone."""
    acting = acting or Outside()
    model = mujoco.MjModel.from_xml_path(str(path))
    data, rail = mujoco.MjData(model), model.joint("rail").id
    data.qpos[rail], data.qvel[rail], data.act[:] = 0.2, -0.3, act
    shown = []
    for k in range(1000):
        data.ctrl[:] = acting.command(0.6 * np.sin(0.01 * k) + 0.2)
        data.qfrc_applied[rail] = acting.force_n(data.qpos[rail], data.qvel[rail])
        mujoco.mj_step(model, data)
        shown.append(data.qpos.copy())
    return np.array(shown)


def assert_same(folder: Path, acting: Outside, within: float = 1e-3, **begun: float) -> None:
    """The corrected model moves as the old one does under what acts, which is not as it was."""
    truth = replayed(folder / "rig.xml", acting, **begun)
    before = np.abs(replayed(folder / "rig.xml", **begun) - truth).max()
    assert before > 1e-3
    assert np.abs(replayed(folder / "out" / CORRECTED) - truth).max() < within * before


@pytest.mark.parametrize(
    "actuators",
    [
        GEARED, SERVO, SPEED, LOOSE, UNUSED, SLOW, DAMPER,
        GEARED.replace("{more}", 'forcerange="-0.1 0.1"'),
        SERVO.replace("{more}", 'forcerange="-5 5"'),
        '<muscle name="flesh" joint="rail" lengthrange="-1 1"/>' + GEARED,
    ],
)  # fmt: skip
def test_a_constant_force_is_the_bias_of_an_actuator(tmp_path: Path, actuators: str) -> None:
    system = written(tmp_path, actuators)
    told = answered(("offset@rail_mps", {"force": size(TILTED_N, "N")}))
    said = system.export(told, tmp_path / "out")
    assert said[1].startswith(
        "  offset@rail_mps is biasprm[0] of actuator 'drive' in corrected.xml"
    )
    assert_same(tmp_path, Outside(force_n=lambda x, v: TILTED_N))


def test_limits_of_all_actuators_of_a_joint_clip_as_before(tmp_path: Path) -> None:
    system = written(tmp_path, SERVO, rail='actuatorfrcrange="-4 4"')
    told = answered(("offset@rail_mps", {"force": size(TILTED_N, "N")}))
    said = system.export(told, tmp_path / "out")
    assert "with it moves its actuatorfrcrange" in said[1]
    assert_same(tmp_path, Outside(force_n=lambda x, v: TILTED_N))


def test_a_constant_force_goes_by_the_gear_that_was_fitted(tmp_path: Path) -> None:
    system = written(tmp_path, GEARED.replace("{more}", 'ctrlrange="-1 1"'))
    told = answered(
        ("offset@rail_mps", {"force": size(TILTED_N, "N")}), drive_gear=size(-36.0, half=1.0)
    )
    system.export(told, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert model.actuator("drive").biasprm[0] == pytest.approx(TILTED_N / -36.0, rel=1e-4)
    rows = tomllib.loads((tmp_path / "out" / RANGES).read_text())["range"]
    bias = next(row for row in rows if row["attribute"] == "biasprm[0]")
    assert bias["low"] < bias["nominal"] < bias["high"]
    assert bias["unit"] == "N"


@pytest.mark.parametrize(
    ("actuators", "because"),
    [
        ('<motor name="drive" joint="wrist"/>', "as no actuator drives joint 'rail'"),
        ('<muscle name="drive" joint="rail" lengthrange="-1 1"/>', "has a bias to carry it"),
    ],
)
def test_a_constant_force_that_no_actuator_can_carry_is_said(
    tmp_path: Path, actuators: str, because: str
) -> None:
    system = written(tmp_path, actuators)
    told = answered(("offset@rail_mps", {"force": size(TILTED_N, "N")}))
    (sentence,) = system.export(told, tmp_path / "out")[1:]
    assert because in sentence
    assert not list((tmp_path / "out").iterdir())  # constants alone might replay worse


@pytest.mark.parametrize(
    "actuators",
    [*(a.replace("{more}", more) for a in (GEARED, SERVO, SPEED, LOOSE, UNUSED)
       for more in ("", 'ctrlrange="-0.3 0.5"')),
     SERVO.replace("{more}", 'inheritrange="1"')],
)  # fmt: skip
@pytest.mark.parametrize("order", [("bias", "gain"), ("gain", "bias"), ("bias",), ("gain",)])
def test_a_command_that_is_moved_or_scaled_is_so_in_the_actuator(
    tmp_path: Path, actuators: str, order: tuple[str, ...]
) -> None:
    by, error = -0.07, 0.2
    steps = {"bias": lambda u: u + by, "gain": lambda u: (1.0 + error) * u}

    def command(u: float) -> float:
        for kind in sorted(order, key=lambda kind: kind != "c"):
            u = steps[kind](u)
        return u

    system = written(tmp_path, actuators, rail='range="-2 2"')
    parameters = {"bias": {"bias": size(by)}, "gain": {"error": size(error)}}
    told = answered(*((f"{kind}@drive_command", parameters[kind]) for kind in order))
    said = system.export(told, tmp_path / "out")
    assert len(said) == 1 + len(order)
    assert_same(tmp_path, Outside(command=command))


@pytest.mark.parametrize(
    "actuators",
    [*(a.replace("{more}", more) for a in (GEARED, SERVO, SPEED, LOOSE, SLOW)
       for more in ("", 'ctrlrange="-0.2 1.2"', 'ctrllimited="false"')),
     DAMPER, SERVO.replace("{more}", 'inheritrange="1"'),
     GEARED.replace("{more}", 'forcerange="-0.6 0.6"')],
)  # fmt: skip
@pytest.mark.parametrize("order", ["c", "gc", "cg", "bc", "bgc", "gcb"])
def test_a_command_that_is_cut_has_a_range(tmp_path: Path, actuators: str, order: str) -> None:
    """It is cut before anything else acts on it, in whichever order that was found."""
    if len(order) > 1 and "damper" in actuators:
        pytest.skip("a damper is not linear in its command")
    by, error, limit = 0.1, 0.4, 0.45
    steps = {"b": lambda u: u + by, "g": lambda u: (1.0 + error) * u}
    found = {
        "b": ("bias@drive_command", {"bias": size(by)}),
        "g": ("gain@drive_command", {"error": size(error)}),
        "c": ("saturation@drive_command", {"limit": size(limit)}),
    }
    steps["c"] = lambda u: np.clip(u, -limit, limit)

    def command(u: float) -> float:
        for kind in sorted(order, key=lambda kind: kind != "c"):
            u = steps[kind](u)
        return u

    system = written(tmp_path, actuators, rail='range="-2 2"')
    told = answered(*(found[kind] for kind in order))
    said = system.export(told, tmp_path / "out")
    assert any("is the ctrlrange of actuator 'drive' in corrected.xml" in line for line in said)
    assert_same(tmp_path, Outside(command=command), act=command(0.0))  # a filter's bias has settled
    rows = tomllib.loads((tmp_path / "out" / RANGES).read_text())["range"]
    (upper,) = (row for row in rows if row["attribute"] == "ctrlrange[1]")
    assert upper["low"] < upper["nominal"] < upper["high"]


def test_a_moved_command_of_a_filter_lasts(tmp_path: Path) -> None:
    system = written(tmp_path, SLOW)
    system.export(answered(("bias@drive_command", {"bias": size(0.1)})), tmp_path / "out")
    assert_same(tmp_path, Outside(command=lambda u: u + 0.1), act=0.1)


@pytest.mark.parametrize("error", [-1.0, -1.2])
@pytest.mark.parametrize("actuator", [GEARED, SERVO])
def test_a_gain_that_leaves_nothing_of_a_command_is_said(
    tmp_path: Path, actuator: str, error: float
) -> None:
    """A range of commands over a factor of 0 would have no end; one below 0 turns it round."""
    system = written(tmp_path, actuator.replace("{more}", 'ctrlrange="-1 1"'))
    gain = ("gain@drive_command", {"error": size(error)})
    (sentence,) = system.export(answered(gain), tmp_path / "out")[1:]
    assert "a command that is turned round or lost is none" in sentence
    drag = ("viscous-friction@rail_mps", {"coefficient": size(1.0)})
    *_, sentence = system.export(answered(gain, drag), tmp_path / "out")
    assert sentence.endswith("corrected.xml is without it.")
    after = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert list(after.actuator_ctrlrange[0]) == [-1.0, 1.0]


def test_a_servo_s_bias_goes_by_the_gain_that_was_fitted(tmp_path: Path) -> None:
    system = written(tmp_path, SERVO)
    told = answered(("bias@drive_command", {"bias": size(0.1)}), drive_kp=size(60.0, "N/m"))
    system.export(told, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert list(model.actuator("drive").biasprm[:3]) == pytest.approx([6.0, -60.0, -3.0])


@pytest.mark.parametrize(
    ("effect", "because"),
    [
        ("bias@drive_command", "integrates its command"),
        ("backlash@drive_command", "MJCF has no attribute for backlash@drive_command."),
        ("sensor-bias@rail_m", "MJCF has no attribute for sensor-bias@rail_m."),
    ],
)
def test_what_has_no_exact_counterpart_is_said(tmp_path: Path, effect: str, because: str) -> None:
    system = written(tmp_path, '<intvelocity name="drive" joint="rail" kp="9" actrange="-1 1"/>')
    parameters = {name: size(0.1) for name in ("bias", "cut", "width")}
    (sentence,) = system.export(answered((effect, parameters)), tmp_path / "out")[1:]
    assert because in sentence


@pytest.mark.parametrize(
    ("kind", "parameter", "value", "force_n"),
    [
        ("viscous-friction", "coefficient", 3.0, lambda x, v: -3.0 * v),
        ("quadratic-drag", "coefficient", 9.0, lambda x, v: -9.0 * v * abs(v)),
        ("stiffness", "stiffness", 12.0, lambda x, v: -12.0 * x),
        ("square-stiffness", "coefficient", 20.0, lambda x, v: -20.0 * x**2),
        ("cubic-stiffness", "coefficient", 90.0, lambda x, v: -90.0 * x**3),
    ],
)
@pytest.mark.parametrize("rail", ["", 'springref="0.3"', 'stiffness="5"'])
def test_a_force_of_motion_or_place_is_the_joint_s(
    tmp_path: Path,
    kind: str,
    parameter: str,
    value: float,
    force_n: Callable[[float, float], float],
    rail: str,
) -> None:
    system = written(tmp_path, GEARED, rail=rail)
    told = answered((f"{kind}@rail_mps", {parameter: size(value)}))
    assert len(system.export(told, tmp_path / "out")) == 1
    assert_same(tmp_path, Outside(force_n=force_n), within=0.02)  # MuJoCo's damping is implicit


@pytest.mark.parametrize("rail", ["", 'springref="0.3"'])
def test_a_spring_that_rests_elsewhere_is_the_joint_s_with_its_place(
    tmp_path: Path, rail: str
) -> None:
    system = written(tmp_path, GEARED, rail=rail)
    spring = {"stiffness": size(12.0, "N/m"), "preload": size(-6.0, "N")}
    assert (
        len(system.export(answered(("preloaded-spring@rail_mps", spring)), tmp_path / "out")) == 1
    )
    assert_same(tmp_path, Outside(force_n=lambda x, v: -6.0 - 12.0 * x), within=0.02)


@pytest.mark.parametrize(
    ("rail", "stiffness", "because"),
    [("", -3.0, "pushes away"), ('stiffness="5"', 3.0, "has a spring of its own")],
)
def test_a_spring_that_a_joint_cannot_have_is_said(
    tmp_path: Path, rail: str, stiffness: float, because: str
) -> None:
    system = written(tmp_path, GEARED, rail=rail)
    spring = {"stiffness": size(stiffness, "N/m"), "preload": size(-6.0, "N")}
    said = system.export(answered(("preloaded-spring@rail_mps", spring)), tmp_path / "out")
    assert because in said[-1]


def test_two_springs_of_which_one_rests_elsewhere_are_no_joint_s(tmp_path: Path) -> None:
    system = written(tmp_path, GEARED)
    preloaded = {"stiffness": size(12.0, "N/m"), "preload": size(-6.0, "N")}
    told = answered(
        ("cubic-stiffness@rail_mps", {"coefficient": size(8.0)}),
        ("preloaded-spring@rail_mps", preloaded),
    )
    said = system.export(told, tmp_path / "out")
    assert "has a spring of its own" in said[-1]


def test_a_spring_beside_one_that_rests_elsewhere_moves_where_both_rest(tmp_path: Path) -> None:
    system = written(tmp_path, GEARED, rail='stiffness="5" springref="0.3"')
    told = answered(("stiffness@rail_mps", {"stiffness": size(12.0, "N/m")}))
    system.export(told, tmp_path / "out")
    assert_same(tmp_path, Outside(force_n=lambda x, v: -12.0 * x), within=0.02)
    told = answered(("cubic-stiffness@rail_mps", {"coefficient": size(12.0)}))
    (sentence,) = system.export(told, tmp_path / "out")[1:]
    assert "as the joint's own spring does not rest at 0" in sentence


def test_where_a_hinge_s_spring_rests_is_in_the_unit_of_the_file(tmp_path: Path) -> None:
    system = written(tmp_path, GEARED, wrist='stiffness="3" springref="30"')
    told = answered(("stiffness@wrist_radps", {"stiffness": size(1.0, "N m/rad")}))
    system.export(told, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert model.qpos_spring[1] == pytest.approx(0.75 * np.deg2rad(30.0), rel=1e-4)
    assert model.jnt_stiffness[1] == pytest.approx(4.0)


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_a_model_that_lacks_nothing_known_stays_as_it_is(tmp_path: Path, verdict: str) -> None:
    """Constants that were refitted alone follow the logs' noise; an earlier answer's are no use."""
    system = written(tmp_path, GEARED)
    told = answered(("offset@rail_mps", {"force": size(TILTED_N, "N")}))
    system.export(told, tmp_path / "out")
    written_files = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert written_files == sorted(system.exported)  # which a new search removes, too
    told = answered(verdict=verdict, drive_gear=size(-44.0))
    (sentence,) = system.export(told, tmp_path / "out")
    assert "rig.xml stays as it is" in sentence
    assert "those of an earlier answer are removed" in sentence
    assert list((tmp_path / "out").iterdir()) == []
    assert "earlier" not in system.export(told, tmp_path / "out")[0]


def test_a_lag_is_a_range_of_the_attribute_that_mjcf_has(tmp_path: Path) -> None:
    system = written(tmp_path, GEARED)
    system.export(answered(("lag@drive_command", {"tau_s": size(0.18, "s")})), tmp_path / "out")
    assert rows_of(tmp_path)["drive dynprm[0]"]["nominal"] == 0.18
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert model.actuator("drive").dynprm[0] == 0.18
    assert model.actuator_dyntype[0] == mujoco.mjtDyn.mjDYN_FILTEREXACT


def rows_of(folder: Path) -> dict[str, dict[str, Any]]:
    rows = tomllib.loads((folder / "out" / RANGES).read_text())["range"]
    return {f"{row['name']} {row['attribute']}": row for row in rows}


def test_a_range_reaches_to_a_stated_value_that_logs_do_not_rule_out(tmp_path: Path) -> None:
    """Two standard errors away is within what chance does to one constant in a dozen."""
    system = written(tmp_path, SERVO)
    told = answered(
        ("stiffness@rail_mps", {"stiffness": size(12.0, "N/m")}),
        drive_kp=size(46.0, "N/m", half=3.0),
        drive_kv=size(2.0, "N/(m/s)", half=0.1),
        cart_mass_kg=size(2.01, "kg", half=0.1),
    )
    said = system.export(told, tmp_path / "out")
    rows = rows_of(tmp_path)
    kp, kv, mass = rows["drive kp"], rows["drive kv"], rows["cart mass"]
    assert (kp["nominal"], kp["low"], kp["high"], kp["stated"]) == (46.0, 43.0, 50.0, 50.0)
    assert (kv["low"], kv["high"], kv["stated"]) == pytest.approx((1.9, 2.1, 3.0))
    assert (mass["low"], mass["high"]) == pytest.approx((1.91, 2.11))
    assert "stated" not in rows["rail stiffness"]
    assert any("reaches to the stated value of drive_kp:" in line for line in said)
    assert any("drive_kv is stated as 3 ± 0.6 N/(m/s), and the logs rule" in line for line in said)


def test_where_a_class_is_open_no_stated_value_is_ruled_out(tmp_path: Path) -> None:
    """Constants bend to the member that was not taken: a damping, to a delay."""
    system = written(tmp_path, SERVO)
    told = answered(
        ("stiffness@rail_mps", {"stiffness": size(12.0, "N/m")}),
        verdict="class",
        drive_kv=size(2.0, "N/(m/s)", half=0.1),
    ).model_copy(update={"rivals": ["stiffness@rail_mps", "dead-time@drive_command"]})
    said = system.export(told, tmp_path / "out")
    kv = rows_of(tmp_path)["drive kv"]
    assert (kv["nominal"], kv["low"], kv["high"]) == pytest.approx((2.0, 1.9, 3.0))
    assert not any("rule that out" in line for line in said)
    assert any("drive_kv: with another member of the class" in line for line in said)


def test_an_input_that_acts_after_its_stamps_is_said_to_have_no_delay(tmp_path: Path) -> None:
    system = written(tmp_path, SERVO)
    told = answered(("stiffness@rail_mps", {"stiffness": size(12.0, "N/m")}))
    late = {"drive_command": Measured(value=0.01, low=0.008, high=0.01, unit="s")}
    said = system.export(told.model_copy(update={"shifted": late}), tmp_path / "out")
    assert any("drive_command acts 10.0 ms after the logs' stamps" in line for line in said)


def test_a_value_that_nobody_measured_widens_no_range(tmp_path: Path) -> None:
    target = tmp_path / "my_rig.py"
    written(tmp_path, SERVO)
    target.write_text(target.read_text().replace("50, spread=10", '50, spread=float("inf")'))
    system = read_system(target)
    told = answered(("stiffness@rail_mps", {"stiffness": size(12.0, "N/m")}),
                    drive_kp=size(46.0, "N/m", half=3.0))  # fmt: skip
    system.export(told, tmp_path / "out")
    assert rows_of(tmp_path)["drive kp"]["high"] == 49.0


def test_what_the_system_states_as_exact_is_written(tmp_path: Path) -> None:
    target = tmp_path / "my_rig.py"
    written(tmp_path, SERVO)
    target.write_text(target.read_text().replace("50, spread=10", "60, spread=0"))
    system = read_system(target)
    told = answered(("stiffness@rail_mps", {"stiffness": size(12.0, "N/m")}))
    system.export(told, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert model.actuator("drive").gainprm[0] == 60.0
    assert list(rows_of(tmp_path)) == ["drive kp", "rail stiffness"]


FULL = '<inertial pos="0 0 0.02" mass="2" fullinertia="0.02 0.03 0.04 0.005 0.002 0.001"/>'
BOX = '<geom type="box" size="0.1 0.1 0.1" mass="2"/>'


HEAD = '<joint name="rail" type="slide" axis="1 0 0" damping="2" {rail}/>\n      '
TURNED = '<inertial pos="0 0 0.1" mass="7" diaginertia="1 2 2.5" euler="0 40 0"/>'
LONG = '<geom type="box" size="0.1 0.2 0.3" mass="2" euler="0 0 20"/>'


def inertia_of(model: Any, body: str) -> np.ndarray:
    """The inertia (3, 3) about a body's centre, in the body's own axes [kg m²]."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body(body).iquat)
    axes = turn.reshape(3, 3)
    return axes @ np.diag(model.body(body).inertia) @ axes.T


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (BOX, FULL),
        ('angle="degree"', 'angle="degree" settotalmass="9.2"'),
        ('angle="degree"', 'angle="degree" inertiafromgeom="true"'),
        (f"{HEAD}{BOX}", f"{HEAD}{TURNED}{LONG}"),
        (f"{HEAD}{BOX}", f"{HEAD}{TURNED}{LONG}".replace('euler="0 40 0"', 'axisangle="1 1 0 30"')),
    ],
)
def test_a_mass_is_what_was_fitted_however_the_file_states_inertias(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str, after: str
) -> None:
    """A full inertia had ended the export, and a total or geoms brought the old mass back."""
    of_geoms = RIG.replace('angle="degree"', 'angle="degree" inertiafromgeom="true"')
    text = (of_geoms if after.startswith(HEAD) else RIG).replace(before, after)
    monkeypatch.setitem(globals(), "RIG", text)
    system = written(tmp_path, SERVO)
    old = system.elements.model
    mass_kg = 1.1 * float(old.body("cart").mass[0])
    told = answered(
        ("stiffness@rail_mps", {"stiffness": size(12.0, "N/m")}), cart_mass_kg=size(mass_kg, "kg")
    )
    system.export(told, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert model.body("cart").mass[0] == pytest.approx(mass_kg, rel=1e-5)
    tensor = 1.1 * inertia_of(old, "cart")
    assert inertia_of(model, "cart") == pytest.approx(tensor, rel=1e-5, abs=1e-6 * tensor.max())
    assert model.body("arm").mass[0] == pytest.approx(old.body("arm").mass[0], rel=1e-5)


def test_springs_and_filters_of_the_model_are_constants(tmp_path: Path) -> None:
    """What the system computes with other values is MuJoCo's model with other values."""
    system = written(tmp_path, SLOW, rail='stiffness="5" springref="0.3"')
    stated = {c.name: (c.value, c.spread, c.unit) for c in system.constants}
    assert stated["rail_stiffness"] == (5.0, 1.0, "N/m")
    assert stated["drive_timeconst_s"][:2] == (0.02, 0.004)
    told = system.derivative(
        system.point("state", {**dict.fromkeys(system.states, 0.1), "drive_activation": 0.0}),
        system.point("input", {"drive_command": 0.5}),
        system.values({"rail_stiffness": 8.0, "drive_timeconst_s": 0.05}),
    )
    text = (tmp_path / "rig.xml").read_text()
    text = text.replace('stiffness="5"', 'stiffness="8"').replace('nst="0.02"', 'nst="0.05"')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.1, 0.1, 0.5
    mujoco.mj_forward(model, data)
    assert [told["rail_mps"], told["wrist_radps"]] == pytest.approx(list(data.qacc), rel=1e-6)
    assert told["drive_activation"] == pytest.approx(data.act_dot[0])
    (tmp_path / "out").mkdir(exist_ok=True)
    system.export(
        answered(
            ("viscous-friction@rail_mps", {"coefficient": size(1.0)}),
            rail_stiffness=size(8.0),
            drive_timeconst_s=size(0.05, "s"),
        ),
        tmp_path / "out",
    )
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / CORRECTED))
    assert (model.jnt_stiffness[0], model.qpos_spring[0]) == pytest.approx((8.0, 0.3))
    assert model.actuator("drive").dynprm[0] == pytest.approx(0.05)
