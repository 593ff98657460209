"""The library: complete, in order, harmless at neutral values, the same for numbers and arrays."""

import numpy as np
import pytest
from effect_rigs import neutral_values
from hypothesis import given, settings
from hypothesis import strategies as st

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig_sections import Wake
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects import LIBRARY, STAGES, Effect, Motion, effect
from wakedeploy.physics.effects.chain import METHODS, Chain, setting_of
from wakedeploy.rig.file import default_rig

RIG = default_rig()
CONSTANTS = constants_of(RIG)
SETTING = setting_of(RIG)
REQUIRED = tuple(
    """
    command-latency esc-frame pwm-dead-band pwm-quantisation
    spool-lag-sufferer spool-lag-source thrust-coefficient thrust-exponent source-thrust-exponent
    battery-sag axial-inflow-loss wake-inflow-loss
    transport-speed transport-speed-exponent wake-strength wake-width wake-spreading wake-decay
    crosswind-offset wake-deflection
    coulomb-friction viscous-friction stiction ground-effect recirculation tether-spring
    added-mass
    range-bias range-scale range-drift range-delay sample-and-hold lost-steps belt-backlash
""".split()  # noqa: SIM905
)


def motions(count: int, seed: int) -> Motion:
    """Random motions over the rig's whole range."""
    rng = np.random.default_rng(seed)
    return Motion(
        time_s=rng.uniform(0.0, 60.0, count),
        x_m=rng.uniform(-0.6, 0.6, count),
        vx_mps=rng.uniform(-0.5, 0.5, count),
        z_m=rng.uniform(0.0, 1.2, count),
        vz_mps=rng.uniform(-1.5, 1.5, count),
        source_n=rng.uniform(0.0, 9.0, count),
        sufferer_n=rng.uniform(0.0, 9.0, count),
        wake_mps=rng.uniform(-10.0, 0.0, count),
        wake_n=rng.uniform(-3.0, 0.0, count),
        charge_s=rng.uniform(0.0, 60.0, count),
        travelled_m=rng.uniform(0.0, 20.0, count),
        direction=rng.choice([-1.0, 1.0], count),
    )


def strong_values(one: Effect) -> dict[str, float]:
    """Values one prior scale away from neutral, upwards."""
    neutral = neutral_values(one, CONSTANTS)
    return {p.name: min(neutral[p.name] + p.scale, p.high) for p in one.parameters}


def changes(chain: Chain, m: Motion) -> dict[str, np.ndarray]:
    """Everything a chain makes of a motion, less what it would be without effects."""
    shape = np.shape(m.z_m)
    answers = {
        "source_n": chain.source_n(m, SETTING) - m.source_n,
        "sufferer_n": chain.sufferer_n(m, SETTING) - m.sufferer_n,
        "wake_offset_m": chain.wake_offset_m(m, SETTING),
        "wake_mps": chain.wake_mps(m, SETTING) - m.wake_mps,
        "force_n": chain.force_n(m, SETTING),
        "added_mass_kg": chain.added_mass_kg(m, SETTING),
        "range_m": chain.range_m(m.z_m, m, SETTING) - m.z_m,
    }
    return {name: np.broadcast_to(np.asarray(v, float), shape) for name, v in answers.items()}


def test_the_library_is_complete_and_in_the_order_in_which_effects_act() -> None:
    assert tuple(name for name in LIBRARY if name in REQUIRED) == REQUIRED
    stages = [STAGES.index(one.stage) for one in LIBRARY.values()]
    assert stages == sorted(stages)


@pytest.mark.parametrize("one", LIBRARY.values(), ids=list(LIBRARY))
def test_an_effect_tells_what_it_is(one: Effect) -> None:
    assert one.physics.endswith(".")
    assert one.split_by
    assert one.parameters
    assert set(one.confused_with) <= set(LIBRARY) - {one.name}
    for parameter in one.parameters:
        neutral = neutral_values(one, CONSTANTS)[parameter.name]
        assert parameter.low <= neutral <= parameter.high
        assert 0.0 < parameter.scale < parameter.high - parameter.low
        assert parameter.low <= neutral + max(parameter.starts) * parameter.scale <= parameter.high
        assert parameter.constant is None or parameter.constant in CONSTANTS


@pytest.mark.parametrize("one", LIBRARY.values(), ids=list(LIBRARY))
def test_an_effect_at_its_neutral_values_changes_nothing_at_all(one: Effect) -> None:
    chain = Chain({one.name: neutral_values(one, CONSTANTS)})
    assert chain.constants(CONSTANTS) == CONSTANTS
    for answer in changes(chain, motions(500, seed=3)).values():
        assert np.all(answer == 0.0)


@given(st.floats(500.0, 2500.0), st.floats(500.0, 2500.0))
@settings(max_examples=50, deadline=None)
def test_neutral_pulses_pass(pulse_us: float, applied_us: float) -> None:
    names = ("pwm-dead-band", "pwm-quantisation")
    chain = Chain({name: neutral_values(effect(name), CONSTANTS) for name in names})
    assert chain.pulse_us(pulse_us, applied_us, "sufferer", 1000.0) == pulse_us


@given(
    st.sampled_from([effect("pwm-dead-band"), effect("pwm-quantisation")]),
    st.just(0.0) | st.floats(1e-3, 40.0),
    st.lists(st.floats(900.0, 2100.0) | st.sampled_from([1000.0, 1500.0, 1505.0]), max_size=40),
)
@settings(max_examples=100, deadline=None)
def test_a_whole_flights_pulses_are_taken_as_one_by_one(
    one: Effect, size_us: float, offered: list[float]
) -> None:
    p = {one.parameters[0].name: size_us}
    whole = one.pulses_us(p, np.array(offered), "sufferer", 1000.0)
    assert np.array_equal(whole, Effect.pulses_us(one, p, np.array(offered), "sufferer", 1000.0))


PATHS_M = st.lists(st.floats(-0.3, 0.3), min_size=2, max_size=40).map(np.array)


def trailing_m(play_m: float, drive_m: np.ndarray) -> np.ndarray:
    """How far the carriage is behind its drive [m] along the drive's path, asked step by step."""
    chain, carriage_m, found = Chain({"belt-backlash": {"backlash_m": play_m}}), None, []
    for at_m in drive_m.tolist():
        carriage_m = chain.carriage_m(at_m, carriage_m)
        found.append(at_m - carriage_m)
    return np.array(found)


@given(st.floats(0.0, 0.2), PATHS_M)
@settings(max_examples=100, deadline=None)
def test_the_play_of_a_belt_is_a_hysteresis(play_m: float, drive_m: np.ndarray) -> None:
    """The lag takes up what the drive goes, up to half the play in either direction."""
    expected, behind_m = [0.0], 0.0
    for way_m in np.diff(drive_m):
        behind_m = float(np.clip(behind_m + way_m, -0.5 * play_m, 0.5 * play_m))
        expected.append(behind_m)
    found = trailing_m(play_m, drive_m)
    assert found == pytest.approx(expected, abs=1e-12)
    assert np.abs(found).max() <= 0.5 * play_m + 1e-12
    whole = effect("belt-backlash").carriages_m({"backlash_m": play_m}, drive_m)
    assert np.array_equal(drive_m - whole, found)
    finer_m = np.interp(np.arange(0.0, len(drive_m) - 0.9, 0.1), np.arange(len(drive_m)), drive_m)
    assert trailing_m(play_m, finer_m)[::10] == pytest.approx(found, abs=1e-9)


@given(st.floats(0.001, 0.2), PATHS_M)
@settings(max_examples=30, deadline=None)
def test_play_that_homing_has_taken_up_to_one_side_is_an_offset(play_m: float, ways_m) -> None:
    """Homed to the left, the carriage is with its drive leftwards, a play behind rightwards."""
    drive_m = np.append(np.linspace(0.0, 1.01 * play_m, 5), ways_m)
    place_m = 0.0
    for at_m, found_m in zip(drive_m, trailing_m(play_m, drive_m), strict=True):
        place_m = min(max(place_m, at_m - play_m), at_m)
        if at_m > play_m or place_m != 0.0:  # the play has been gone through once
            assert at_m - found_m - place_m == pytest.approx(0.5 * play_m, abs=1e-9)


@given(PATHS_M)
@settings(max_examples=30, deadline=None)
def test_without_play_the_carriage_is_its_drive(drive_m: np.ndarray) -> None:
    assert np.array_equal(trailing_m(0.0, drive_m), np.zeros(len(drive_m)))


@given(st.floats(0.001, 0.2), st.sampled_from([-1.0, 1.0]), PATHS_M)
@settings(max_examples=30, deadline=None)
def test_a_way_longer_than_the_play_ends_half_of_it_behind(
    play_m: float, sign: float, drive_m: np.ndarray
) -> None:
    onwards_m = drive_m[-1] + sign * np.linspace(0.0, 1.01 * play_m, 20)
    found = trailing_m(play_m, np.append(drive_m, onwards_m))
    assert found[-1] == pytest.approx(sign * 0.5 * play_m, abs=1e-9)
    back_m = np.append(np.append(drive_m, onwards_m), onwards_m[-1] - sign * 0.25 * play_m)
    assert trailing_m(play_m, back_m)[-1] == pytest.approx(sign * 0.25 * play_m, abs=1e-9)


@pytest.mark.parametrize("one", LIBRARY.values(), ids=list(LIBRARY))
def test_an_effect_does_something_and_only_in_one_quantity(one: Effect) -> None:
    chain = Chain({one.name: strong_values(one)})
    moved = {name for name, value in changes(chain, motions(50, seed=5)).items() if value.any()}
    moved |= {"constant"} if chain.constants(CONSTANTS) != CONSTANTS else set()
    moved |= {name for name in ("pulse_us", "carriage_m") if chain.acts_on(name)}
    assert len(moved) == 1
    assert chain.moves == any(chain.acts_on(method) for method in METHODS)


@pytest.mark.parametrize("one", LIBRARY.values(), ids=list(LIBRARY))
def test_numbers_and_arrays_give_the_same(one: Effect) -> None:
    chain, many = Chain({one.name: strong_values(one)}), motions(5, seed=7)
    whole = changes(chain, many)
    for i in range(5):
        single = changes(
            chain,
            Motion(**{name: np.atleast_1d(v)[i % np.size(v)] for name, v in vars(many).items()}),
        )
        for name, value in single.items():
            assert value == pytest.approx(whole[name][i], rel=1e-12, abs=1e-15)


def test_a_chain_acts_in_the_librarys_order_whatever_order_it_is_given_in() -> None:
    values = {name: strong_values(effect(name)) for name in reversed(REQUIRED)}
    assert [one.name for one, _ in Chain(values).parts] == list(REQUIRED)
    m = Motion(charge_s=10.0, vz_mps=0.5, wake_mps=-4.0, sufferer_n=4.0)
    names = ("battery-sag", "axial-inflow-loss", "wake-inflow-loss")
    product = 4.0
    for name in names:
        product *= float(Chain({name: values[name]}).sufferer_n(m, SETTING)) / 4.0
    assert Chain(values).sufferer_n(m, SETTING) == pytest.approx(product)
    assert Chain(values).values["battery-sag.sag_per_s"] == 0.003


def test_the_last_of_two_sensor_effects_sees_what_the_first_has_made() -> None:
    class Doubled(Effect):
        name, physics, stage = "doubled", "Twice the range.", "sensor"
        parameters = ()

        def range_m(self, p, range_m, m, s):  # type: ignore[no-untyped-def]
            return 2.0 * range_m

    chain = Chain({"doubled": {}, "range-drift": {"drift_mps": 0.01}}, [Doubled()])
    assert chain.range_m(0.5, Motion(time_s=10.0), SETTING) == pytest.approx(2.0 * 0.6)


def test_bounds_of_constants_are_within_those_of_a_rig_file() -> None:
    for one in LIBRARY.values():
        for parameter in one.parameters:
            section, _, name = (parameter.constant or "").partition(".")
            if section == "wake":
                for value in (parameter.low, parameter.high):
                    Wake.model_validate(vars(RIG.wake) | {name: value})


def test_an_unknown_effect_is_refused_with_the_names_of_those_there_are() -> None:
    with pytest.raises(UnusableInput, match=r"ghost.*command-latency.*belt-backlash"):
        effect("ghost")
    with pytest.raises(UnusableInput, match="ghost"):
        Chain({"ghost": {}})
