"""Stages that are stepped by the plant and computed over whole flights by fits agree."""

import numpy as np
import pytest
from effect_rigs import CLEAN, DT_S
from scipy.integrate import quad

from wakedeploy.core.rig_sections import SpoolLag
from wakedeploy.physics.effects import LIBRARY, Motion
from wakedeploy.physics.effects.acting import ActingEffects, blow, motion_along, push
from wakedeploy.physics.effects.chain import Chain, setting_of
from wakedeploy.physics.motor import exact_mean_thrust, kept, mean_thrust, spooled


def test_what_is_noted_step_by_step_is_what_a_whole_flight_has() -> None:
    t_s = DT_S * np.arange(400)
    vx_mps = 0.2 * np.sin(9.0 * t_s) * (t_s > 0.3)
    x_m = np.cumsum(vx_mps) * DT_S
    effects = ActingEffects(Chain({}), CLEAN, DT_S)
    take_off_s, noted = t_s[100], []
    for k, time_s in enumerate(t_s):
        effects.look(time_s, x_m[k], vx_mps[k], 0.3, 0.0)
        noted.append((effects.motion.time_s, effects.motion.direction))
        effects.source_n(time_s, 1.0, 5.0 if k >= 100 else 0.0)
        effects.travel(vx_mps[k])
    motion = motion_along(t_s, take_off_s, x_m, vx_mps, DT_S)
    assert np.stack([motion.time_s, motion.direction]) == pytest.approx(np.array(noted).T)
    assert motion.travelled_m[-1] == pytest.approx(effects.motion.travelled_m)
    assert {-1.0, 0.0, 1.0} == set(motion.direction)


def test_all_effects_push_a_whole_flight_as_they_push_step_by_step() -> None:
    values = {
        name: {p.name: p.neutral + 0.5 * p.scale for p in one.parameters}
        for name, one in LIBRARY.items()
    }
    chain, setting, rng = Chain(values), setting_of(CLEAN), np.random.default_rng(1)
    fields = dict(
        zip(vars(Motion()), rng.uniform(0.1, 1.0, (len(vars(Motion())), 20)), strict=True)
    )

    def pushed(m: Motion):
        air_mps = blow(chain, m, setting, -3.0 * m.z_m)
        return (air_mps, *push(chain, m, setting, 0.1 * air_mps), m.sufferer_n)

    whole = pushed(Motion(**fields))
    for k in range(20):
        single = pushed(Motion(**{name: float(column[k]) for name, column in fields.items()}))
        for got, expected in zip(whole, single, strict=True):
            assert np.broadcast_to(got, 20)[k] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("lag_s", [0.0, 0.001, 0.02, 0.1])
@pytest.mark.parametrize(("before", "target"), [(1.0, 2.0), (2.1, 1.5)])
def test_the_mean_thrust_of_a_step(before: float, target: float, lag_s: float) -> None:
    lag = SpoolLag(up_s=lag_s, down_s=lag_s)
    exact_n = exact_mean_thrust(before, target, lag_s / DT_S, kept(lag_s, DT_S))
    summed, _ = quad(lambda t: spooled(before, target, lag, t) ** 2, 0.0, DT_S, points=[5 * lag_s])
    assert exact_n == pytest.approx(summed / DT_S, rel=1e-6)
    short_n = mean_thrust(before, spooled(before, target, lag, DT_S), lag)
    if lag_s == 0.0 or lag_s > DT_S:
        share = (DT_S / lag_s) ** 2 / 6.0 if lag_s else 0.0
        assert abs(short_n - exact_n) <= share * abs(target**2 - before**2) + 1e-12
