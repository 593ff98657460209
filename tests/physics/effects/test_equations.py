"""The equations of the documentation, evaluated as they are printed, against the code."""

import re

import numpy as np
import pytest
from test_library import CONSTANTS, RIG, SETTING, changes, motions, strong_values

from wakedeploy.physics.constants import moved_thrust
from wakedeploy.physics.effects import LIBRARY, Motion
from wakedeploy.physics.effects.chain import Chain
from wakedeploy.physics.gantry import _Seen
from wakedeploy.physics.jet import PuffTable, VerticalJet

_SIGNS = {"·": "*", "−": "-", "²": "**2", "^": "**", "√(": "sqrt(", "≥": ">="}
_FUNCTIONS = {"exp": np.exp, "ln": np.log, "sqrt": np.sqrt, "round": np.round}


def evaluated(name: str, **symbols: float | np.ndarray) -> float | np.ndarray:
    """The right-hand side of an effect's equation, with its parameters a scale from neutral."""
    right = LIBRARY[name].equation.split(" = ", 1)[1]
    for sign, code in _SIGNS.items():
        right = right.replace(sign, code)
    right = re.sub(r"\|([^|]*)\|", r"abs(\1)", right)
    return eval(right, {}, _FUNCTIONS | symbols | strong_values(LIBRARY[name]))


def of_motion(m: Motion) -> dict[str, float | np.ndarray]:
    """The symbols of the page."""
    return {
        "T": m.sufferer_n,
        "W": SETTING.weight_n,
        "m": SETTING.mass_kg,
        "z": m.z_m,
        "v_z": m.vz_mps,
        "v_x": m.vx_mps,
        "w": m.wake_mps,
        "q": m.charge_s,
        "L": m.travelled_m,
        "t": m.time_s,
        "r": m.z_m,
    }


@pytest.mark.parametrize("one", LIBRARY.values(), ids=list(LIBRARY))
def test_every_effect_has_an_equation_with_all_its_parameters(one) -> None:
    for parameter in one.parameters:
        assert re.search(rf"\b{parameter.name}(?![a-z_])", one.equation)


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("battery-sag", "sufferer_n"),
        ("axial-inflow-loss", "sufferer_n"),
        ("wake-inflow-loss", "sufferer_n"),
        ("crosswind-offset", "wake_offset_m"),
        ("wake-deflection", "wake_offset_m"),
        ("ground-effect", "force_n"),
        ("recirculation", "force_n"),
        ("tether-spring", "force_n"),
        ("added-mass", "added_mass_kg"),
        ("range-drift", "range_m"),
        ("lost-steps", "wake_offset_m"),
    ],
)
def test_an_effect_on_the_motion_does_what_its_equation_says(name, quantity) -> None:
    m = motions(50, seed=11)
    change = changes(Chain({name: strong_values(LIBRARY[name])}), m)[quantity]
    without = {"sufferer_n": m.sufferer_n, "added_mass_kg": SETTING.mass_kg, "range_m": m.z_m}
    expected = evaluated(name, **of_motion(m)) - without.get(quantity, 0.0)
    np.testing.assert_allclose(change, np.broadcast_to(expected, 50), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["pwm-dead-band", "pwm-quantisation"])
def test_an_effect_on_pulses_does_what_its_equation_says(name) -> None:
    one, rng = LIBRARY[name], np.random.default_rng(4)
    for pulse_us, before_us in rng.uniform(1400.0, 1420.0, (50, 2)):
        taken_us = one.pulse_us(strong_values(one), pulse_us, before_us, "sufferer", 1000.0)
        assert taken_us == pytest.approx(
            evaluated(name, u=pulse_us, u_k=before_us, u_idle=1000.0), rel=1e-12
        )


def test_a_belts_play_is_as_its_equation_says() -> None:
    one, rng = LIBRARY["belt-backlash"], np.random.default_rng(5)
    for drive_m, before_m in rng.uniform(-0.02, 0.02, (50, 2)):
        expected = evaluated(one.name, x=drive_m, x_c=before_m)
        assert one.carriage_m(strong_values(one), drive_m, before_m) == pytest.approx(expected)


def test_constants_that_effects_replace_stand_in_the_rigs_equations() -> None:
    thrust_n, weight_n = np.linspace(0.1, 9.0, 20), SETTING.weight_n
    for name, symbol in (("thrust-exponent", "T"), ("source-thrust-exponent", "T_s")):
        (exponent,) = strong_values(LIBRARY[name]).values()
        curve = moved_thrust(thrust_n, 1.0, exponent, weight_n)
        assert evaluated(name, W=weight_n, **{symbol: thrust_n}) == pytest.approx(curve)
    (scale,) = strong_values(LIBRARY["thrust-coefficient"]).values()
    curve = moved_thrust(thrust_n, scale, 1.0, weight_n)
    assert evaluated("thrust-coefficient", T=thrust_n) == pytest.approx(curve)
    for name in ("range-bias", "range-scale"):
        constants = Chain({name: strong_values(LIBRARY[name])}).constants(CONSTANTS)
        assert evaluated(name, z=0.4) == pytest.approx(_Seen(constants, 0.01).height_m(0.4))


@pytest.mark.parametrize(
    "name", ["transport-speed", "wake-strength", "wake-width", "wake-spreading", "wake-decay"]
)
def test_the_wakes_puffs_are_as_the_equations_say(name) -> None:
    """Each with one constant replaced and the rig's own for the others, at the reference thrust."""
    replaced = {
        p.constant.removeprefix("wake."): strong_values(LIBRARY[name])[p.name]
        for p in LIBRARY[name].parameters
    }
    wake, dt_s = RIG.changed(wake=replaced).wake, 1.0 / 256.0
    table = PuffTable(wake, dt_s, RIG.source.height_m, 0.5 * dt_s)
    symbols = {
        "S": wake.strength,
        "σ": wake.width_m,
        "w_a": wake.speed_mps,
        "n": 0.0,
        "κ": wake.diffusivity_m2ps,
        "λ": wake.decay_per_s,
        "τ": table.ages_s,
        "dt": dt_s,
        "T_s": wake.reference_thrust_n,
        "T_ref": wake.reference_thrust_n,
        "s": np.sqrt(0.5 / table.inverse_2width2),
    }
    made = {"h": table.sunk_m, "s²": 0.5 / table.inverse_2width2, "a": table.amplitude_mps}
    left = LIBRARY[name].equation.split(" = ")[0]
    np.testing.assert_allclose(evaluated(name, **symbols), made[left], rtol=1e-12)


def test_a_wake_whose_speed_goes_with_the_thrust_sinks_as_the_equation_says() -> None:
    (exponent,) = strong_values(LIBRARY["transport-speed-exponent"]).values()
    wake = RIG.changed(wake={"speed_exponent": exponent}).wake
    root = np.array([np.sqrt(1.7 / wake.reference_thrust_n)])
    (pace,) = VerticalJet(wake, RIG.source.height_m, 0.01)._pace(root)
    symbols = {"w_a": wake.speed_mps, "T_s": 1.7, "T_ref": wake.reference_thrust_n, "τ": 1.0}
    sunk_m = evaluated("transport-speed-exponent", **symbols)
    assert sunk_m == pytest.approx(pace * wake.speed_mps)
    assert sunk_m != pytest.approx(wake.speed_mps, rel=0.05)
