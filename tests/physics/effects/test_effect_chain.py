"""Effects from a rig file: refused where wrong, absent where neutral, believed by the model."""

import numpy as np
import pytest
from effect_rigs import CLEAN, HOVER_US, NO_WAKE, flown, neutral_values, with_effects

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.domains.gantry import record
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.chain import (
    Chain,
    believed,
    default_lead_s,
    unplaced_constants,
)
from wakedeploy.physics.field_grid import FieldPhysics
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.physics.jet import VerticalJet
from wakedeploy.rig.file import default_rig, parse_rig

RIG = default_rig()


def rig_with(toml: str) -> Rig:
    return parse_rig(RIG.text + "\n" + toml)


@pytest.mark.parametrize(
    ("toml", "told"),
    [
        ('[[effect]]\nname = "ghost"', r"'ghost'.*knows command-latency"),
        ('[[effect]]\nname = "battery-sag"', r"'battery-sag' lacks.*'sag_per_s'"),
        (
            '[[effect]]\nname = "battery-sag"\n'
            'parameters = {sag_per_s = {value = 0.01, unit = "1/s"}, '
            'volts = {value = 1.0, unit = "V"}}',
            r"no parameter 'volts'; it has sag_per_s",
        ),
        (
            '[[effect]]\nname = "range-bias"\nparameters = {bias_m = {value = 5.0, unit = "ms"}}',
            r"bias_m is in m, .*'ms'",
        ),
        (
            '[[effect]]\nname = "range-bias"\nparameters = {bias_m = {value = 5.0, unit = "m"}}',
            r"bias_m = 5 m: must lie within -0.3 and 0.3",
        ),
        (
            '[[effect]]\nname = "added-mass"\nparameters = {mass_kg = {value = 0.1, unit = "kg"}}\n'
            '[[effect]]\nname = "added-mass"\nparameters = {mass_kg = {value = 0.1, unit = "kg"}}',
            r"'added-mass' twice",
        ),
    ],
)
def test_a_wrong_entry_is_refused_in_one_sentence(toml: str, told: str) -> None:
    for use in (Chain.of, believed, lambda rig: GantryPlant(rig, seed=0)):
        with pytest.raises(UnusableInput, match=told):
            use(rig_with(toml))


def test_a_unit_may_be_spelt_with_a_superscript() -> None:
    entry = 'parameters = {diffusivity_m2ps = {value = 0.1, unit = "m²/s"}}'
    chain = Chain.of(rig_with('[[effect]]\nname = "wake-spreading"\n' + entry))
    assert chain.constants(constants_of(RIG))["wake.diffusivity_m2ps"] == 0.1


def test_all_effects_at_once_at_neutral_values_leave_a_flight_as_it_is() -> None:
    constants = constants_of(RIG)
    neutral = {
        name.replace("-", "_"): neutral_values(one, constants) for name, one in LIBRARY.items()
    }
    drive = {
        "sufferer_us": lambda t_s: 1750.0 if t_s % 0.6 < 0.3 else 1680.0,
        "source_us": lambda t_s: 1850.0 if t_s % 0.4 < 0.2 else 1400.0,
        "carriage_mps": lambda t_s: 0.2 if t_s % 1.0 < 0.5 else -0.2,
    }
    runs = [
        flown(GantryPlant(rig, seed=5), 1.5, **drive) for rig in (RIG, with_effects(RIG, **neutral))
    ]
    for name, column in runs[0].items():
        assert np.array_equal(column, runs[1][name], equal_nan=True), name


def test_two_effects_act_together() -> None:
    rig = with_effects(
        NO_WAKE.without("spool"),
        thrust_coefficient={"scale": 1.1},
        battery_sag={"sag_per_s": 0.02},
        command_latency={"latency_s": 0.1},
    )
    run = flown(GantryPlant(rig, seed=0), 3.0, sufferer_us=lambda t_s: HOVER_US)
    drawn_s = 1.1 * (3.0 - 0.1)
    expected_n = 1.1 * 0.45 * 9.81 * np.exp(-0.02 * drawn_s)
    assert run["sufferer_thrust_n"][-1] == pytest.approx(expected_n, rel=1e-3)


def test_a_rigs_effects_on_constants_are_folded_into_what_its_model_believes() -> None:
    rig = with_effects(
        RIG,
        spool_lag_sufferer={"up_s": 0.12, "down_s": 0.2},
        command_latency={"latency_s": 0.03},
        range_bias={"bias_m": 0.02},
        ground_effect={"gain": 0.1, "height_m": 0.1},
    )
    model = believed(rig)
    assert (model.spool.sufferer.up_s, model.spool.sufferer.down_s) == (0.12, 0.2)
    names = [entry.name for entry in model.effect]
    assert names == ["command-latency", "range-bias", "ground-effect"]
    assert unplaced_constants(rig) == {
        "command.delay_s": 0.03,
        "range.bias_m": 0.02,
        "range.scale": 1.0,
        "range.delay_s": 0.0,
        "range.hold_s": 0.0,
        "command.window_s": 0.004,
    }
    assert default_lead_s(model) == default_lead_s(rig) == pytest.approx(0.018 + 0.03 + 0.16)
    assert believed(RIG) is RIG


@pytest.mark.whole
def test_a_corrected_rig_flies_as_one_whose_sections_were_corrected() -> None:
    lag = {"up_s": 0.12, "down_s": 0.2}
    truth = RIG.changed(spool={"sufferer": lag})
    by_section = record(truth, seconds=4.0, seed=1, model_rig=truth)
    by_effect = record(
        truth, seconds=4.0, seed=1, model_rig=with_effects(RIG, spool_lag_sufferer=lag)
    )
    ignorant = record(truth, seconds=4.0, seed=1, model_rig=RIG)
    for name in ("z_est_m", "sufferer_cmd_us"):
        assert np.array_equal(by_section[name], by_effect[name])
        assert not np.array_equal(by_section[name], ignorant[name])


@pytest.mark.whole
def test_a_known_range_bias_is_taken_off_by_the_estimator() -> None:
    rig = with_effects(RIG, range_bias={"bias_m": 0.05})
    errors_m = {}
    for name, model in (("known", rig), ("unknown", RIG)):
        log = record(rig, seconds=6.0, seed=2, model_rig=model)
        flying = np.isin(log["mode"], ("RUNNING", "DEGRADED"))
        errors_m[name] = float(np.median((log["z_est_m"] - log["true_z_m"])[flying]))
    assert errors_m["known"] == pytest.approx(0.0, abs=0.008)
    assert errors_m["unknown"] == pytest.approx(0.05, abs=0.008)


def test_the_future_force_lies_where_the_effects_put_the_wake() -> None:
    drive = {"source_us": lambda t_s: 1700.0, "sufferer_us": lambda t_s: 1000.0}
    plants = [
        GantryPlant(rig, seed=0)
        for rig in (CLEAN, with_effects(CLEAN, crosswind_offset={"offset_m": 0.2}))
    ]
    for plant in plants:
        flown(plant, 1.5, **drive)
    foreseen = plants[1].wake_force_ahead(0.1)
    assert foreseen == pytest.approx(plants[1].wake_force_n, rel=0.01)
    assert abs(foreseen) < 0.8 * abs(plants[0].wake_force_n)


@pytest.mark.parametrize("exponent", [-0.3, 0.0, 0.5])
def test_a_wakes_speed_goes_with_a_power_of_the_thrust_that_made_it(exponent: float) -> None:
    wake = RIG.changed(wake={"speed_exponent": exponent}).wake
    for share in (0.5, 2.0):
        jet = VerticalJet(wake, 2.0, 1.0 / 256.0)
        velocity = []
        for _ in range(400):
            jet.inject(share * wake.reference_thrust_n)
            velocity.append(jet.velocity(0.0, 0.6))
        arrival_s = int(np.argmax(np.array(velocity) <= velocity[-1] / 2)) / 256.0
        assert arrival_s == pytest.approx(1.4 / (6.0 * share**exponent), abs=0.025)
        foreseen = jet.velocity_ahead(0.0, 0.6, 0.2)
        assert foreseen == pytest.approx(velocity[-1], rel=1e-3)


def test_the_2d_field_refuses_a_speed_that_depends_on_thrust() -> None:
    with pytest.raises(UnusableInput, match="speed_exponent"):
        FieldPhysics.of(RIG.changed(wake={"speed_exponent": 0.3}).wake)


def test_a_rig_without_an_exponent_keeps_its_text() -> None:
    assert "speed_exponent" not in RIG.text
    changed = RIG.changed(wake={"speed_exponent": 0.3})
    assert parse_rig(changed.text) == changed


def test_an_expression_from_a_rig_file_pushes_the_sufferer() -> None:
    entry = (
        '[[effect]]\nname = "symbolic-force"\nexpression = "a - b * vz_mps"\n'
        'parameters = { a = { value = 0.3, unit = "N" }, b = { value = 0.5, unit = "N s/m" } }'
    )
    rig = parse_rig(NO_WAKE.without("spool").text + "\n" + entry)
    run = flown(GantryPlant(rig, seed=0), 1.0)
    expected_mps = 0.3 / 0.5 * (1.0 - np.exp(-0.5 / 0.45))
    assert run["vz_mps"][-1] == pytest.approx(expected_mps, rel=0.01)
    assert believed(rig).effect == rig.effect
