"""A range sensor that freezes in the air, also one whose noise is finer than its steps."""

import math
from pathlib import Path

import pytest
from simulated_bench import ended_by

from runtime.loop.safety import RANGE_FROZEN_S
from runtime.loop.silent_faults import frozen_limit_s
from runtime.reference import hold_plan
from wakedeploy.cli import doctor
from wakedeploy.core.rig import Effect, EffectParameter, Rig
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 1.0, "outlier_probability": 0.0})
FREEZES_S = 5.0


def with_noise(noise_m: float, resolution_m: float = 0.001) -> Rig:
    return RIG.changed(range_sensor={"noise_m": noise_m, "resolution_m": resolution_m})


def frozen(t_s, range_m, steps, _held={}):  # noqa: B006 - what it said last
    if t_s < FREEZES_S:
        _held["m"] = range_m
    return _held["m"], steps


def nothing(loop, bench, rows):
    pass


@pytest.mark.parametrize("noise_m", [0.004, 0.0008, 0.0005])
def test_a_sensor_that_freezes_in_hover_ends_the_flight(noise_m):
    rig = with_noise(noise_m)
    plan = hold_plan(rig, 16.0, 0.5, 1000.0)
    loop, _, rows = ended_by(rig, plan, -1, nothing, sensor_hook=frozen)
    assert loop.failsafe_cause == ("sensor_frozen",)
    began_s = rows[[row["mode"] for row in rows].index("FAILSAFE")]["t_s"]
    assert began_s - FREEZES_S == pytest.approx(frozen_limit_s(rig), abs=0.15)


@pytest.mark.parametrize("noise_m", [0.0008, 0.0005, 0.0003, 0.0])
def test_a_healthy_sensor_of_little_noise_is_left_alone_in_a_quiet_hover(noise_m):
    rig = with_noise(noise_m)
    loop, _, rows = ended_by(rig, hold_plan(rig, 20.0, 0.5, 1000.0), -1, nothing)
    assert loop.failsafe_cause == ()
    assert max(row["z_est_m"] for row in rows) > 0.4


def test_the_limit_grows_as_noise_is_lost_in_the_steps():
    assert frozen_limit_s(default_rig()) == RANGE_FROZEN_S
    assert frozen_limit_s(with_noise(0.001)) == RANGE_FROZEN_S
    limits_s = [frozen_limit_s(with_noise(noise_m)) for noise_m in (0.0008, 0.0005, 0.0003)]
    assert RANGE_FROZEN_S < limits_s[0] < limits_s[1] < limits_s[2]
    # Normal noise of half a step stays in the step with 68.27 %; ticks are 31.25 ms apart.
    assert limits_s[1] == pytest.approx(math.log(1e-9) / math.log(0.6827) / 32.0, rel=1e-3)
    assert frozen_limit_s(with_noise(0.0)) == math.inf
    hold = EffectParameter(value=0.125, unit="s")
    entry = Effect(name="sample-and-hold", parameters={"hold_s": hold})
    holding = with_noise(0.0005).model_copy(update={"effect": (entry,)})
    assert frozen_limit_s(holding) == pytest.approx(4.0 * limits_s[1])


@pytest.mark.parametrize(
    ("noise_m", "found"),
    [
        (0.0, "never noticed: its noise is below a step"),
        (0.0005, "noticed after 1.7 s: its noise is below a step"),
        (0.004, None),
    ],
)
def test_doctor_says_how_late_a_frozen_sensor_is_noticed(tmp_path: Path, noise_m, found):
    with_noise(noise_m).write(tmp_path / "rig.toml")
    told = {f.name: f for f in doctor.calibrations(tmp_path / "rig.toml")}
    if found is None:
        assert "frozen range sensor" not in told
    else:
        assert told["frozen range sensor"].found == found
        assert told["frozen range sensor"].state == doctor.OPTIONAL
