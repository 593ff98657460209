"""A force from a rig file's expression acts as its arithmetic says, within three weights."""

import pickle

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.physics.effects.base import Motion, Parameter, Setting
from wakedeploy.physics.effects.symbolic import expression_force, symbolic_effect

SETTING = Setting(
    source_height_m=2.0, mass_kg=0.45, weight_n=4.41, rotor_radius_m=0.127, travel_m=1.2
)


def entry(expression, **values):
    parameters = {name: EffectParameter(value=v, unit="N") for name, v in values.items()}
    return Effect(name="symbolic-force", expression=expression, parameters=parameters)


def force(expression, motion, **values):
    return symbolic_effect(entry(expression, **values)).force_n(values, motion, SETTING)


def test_it_is_the_force_that_the_expression_says():
    t_s, x_m = np.linspace(0, 20, 50), np.linspace(-0.5, 0.5, 50)
    motion = Motion(time_s=t_s, x_m=x_m)
    there = force("c1*sin(6.28*1.5*time_s) + c2*x_m", motion, c1=0.3, c2=-0.2)
    np.testing.assert_allclose(there, 0.3 * np.sin(9.42 * t_s) - 0.2 * x_m, rtol=1e-9)


def test_numbers_give_what_arrays_give():
    heights = np.linspace(0, 1, 7)
    together = force("c1*exp(-z_m/0.2)", Motion(z_m=heights), c1=0.4)
    alone = [force("c1*exp(-z_m/0.2)", Motion(z_m=float(z)), c1=0.4) for z in heights]
    np.testing.assert_allclose(together, np.array(alone, float))


def test_it_has_its_parameters_with_units_and_vanishes_where_they_are_zero():
    effect = symbolic_effect(entry("c1*z_m + c2*vz_mps", c1=0.1, c2=0.2))
    assert [(p.name, p.unit) for p in effect.parameters] == [("c1", "N"), ("c2", "N")]
    still = {p.name: p.neutral for p in effect.parameters}
    assert effect.force_n(still, Motion(z_m=0.5, vz_mps=1.0), SETTING) == 0.0


@pytest.mark.parametrize(("speed", "expected"), [(0.0, 3 * 4.41), (-1e-9, -3 * 4.41)])
def test_it_never_exceeds_three_weights(speed, expected):
    assert force("1/vz_mps", Motion(vz_mps=speed)) == pytest.approx(expected)


def test_a_force_that_is_no_number_names_the_state():
    motion = Motion(z_m=np.array([0.1, -0.2]), x_m=0.3)
    with pytest.raises(UnusableInput, match=r"at x_m = 0.3, z_m = -0.2; rewrite"):
        force("sqrt(z_m)*x_m", motion)


def test_an_entry_without_expression_is_refused():
    with pytest.raises(UnusableInput, match="has no expression"):
        symbolic_effect(Effect(name="tether-spring"))


def test_a_term_travels_to_another_process():
    gradient = Parameter("c", "N/m", scale=0.2, low=-2.0, high=2.0)
    term = expression_force("height", "Changes with height.", "c*(z_m - 0.5*travel_m)", [gradient])
    copy = pickle.loads(pickle.dumps(term))
    assert (copy.name, copy.parameters, copy.formula) == ("height", (gradient,), term.formula)
    assert copy.force_n({"c": 0.5}, Motion(z_m=1.0), SETTING) == pytest.approx(0.2)
