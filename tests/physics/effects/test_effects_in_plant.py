"""Each effect in the plant against physics that can be worked out by hand."""

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from effect_rigs import (
    CLEAN,
    DT_S,
    NO_WAKE,
    PROMPT,
    WEIGHT_N,
    flown,
    with_effects,
)

from wakedeploy.core.rig import Rig
from wakedeploy.physics.effects.acting import DelayLine
from wakedeploy.physics.gantry import GantryPlant

MASS_KG = CLEAN.sufferer.mass_kg


def plant(rig: Rig, **effects: Mapping[str, float]) -> GantryPlant:
    return GantryPlant(with_effects(rig, **effects), seed=0)


def zigzag_us(t_s: float) -> float:
    return 1740.0 if t_s % 0.5 < 0.25 else 1690.0


def test_command_latency_shifts_the_response_by_exactly_that_time() -> None:
    prompt = flown(plant(NO_WAKE), 1.0, sufferer_us=zigzag_us)
    late = flown(plant(NO_WAKE, command_latency={"latency_s": 16 * DT_S}), 1.0,
                 sufferer_us=zigzag_us)  # fmt: skip
    assert np.array_equal(late["z_m"][16:], prompt["z_m"][:-16])
    assert prompt["z_m"].max() > 0.05


def test_a_delay_between_steps_delays_a_ramp_by_exactly_that_time() -> None:
    line = DelayLine(5.3 * DT_S, DT_S, 0.0)
    answers = [line.passed(7.0 * k * DT_S) for k in range(40)]
    assert answers[-1] == pytest.approx(7.0 * (39 - 5.3) * DT_S)


@pytest.mark.parametrize(
    ("effect", "values", "sections"),
    [
        ("esc_frame", {"frame_s": 0.05}, {"disturbance": {"esc_frame_s": 0.05}}),
        (
            "spool_lag_sufferer",
            {"up_s": 0.2, "down_s": 0.3},
            {"spool": {"sufferer": {"up_s": 0.2, "down_s": 0.3}}},
        ),
        (
            "spool_lag_source",
            {"up_s": 0.2, "down_s": 0.3},
            {"spool": {"source": {"up_s": 0.2, "down_s": 0.3}}},
        ),
        ("transport_speed", {"speed_mps": 4.0}, {"wake": {"speed_mps": 4.0}}),
        ("transport_speed_exponent", {"exponent": 0.4}, {"wake": {"speed_exponent": 0.4}}),
        ("wake_strength", {"strength": 500.0}, {"wake": {"strength": 500.0}}),
        ("wake_width", {"width_m": 0.15}, {"wake": {"width_m": 0.15}}),
        ("wake_spreading", {"diffusivity_m2ps": 0.1}, {"wake": {"diffusivity_m2ps": 0.1}}),
        ("wake_decay", {"decay_per_s": 2.0}, {"wake": {"decay_per_s": 2.0}}),
        ("coulomb_friction", {"coulomb_n": 0.3}, {"rail": {"coulomb_n": 0.3}}),
        ("viscous_friction", {"viscous_n_per_mps": 1.0}, {"rail": {"viscous_n_per_mps": 1.0}}),
        ("stiction", {"stiction_n": 0.5}, {"rail": {"stiction_n": 0.5}}),
    ],
)
def test_an_effect_on_a_constant_is_the_rig_with_that_constant(
    effect: str, values: dict[str, float], sections: dict[str, Any]
) -> None:
    drive = {
        "sufferer_us": lambda t_s: 1760.0 if t_s % 0.5 < 0.25 else 1680.0,
        "source_us": zigzag_us,
        "carriage_mps": lambda t_s: 0.1,
    }
    by_effect = flown(plant(CLEAN, **{effect: values}), 1.0, **drive)
    by_rig = flown(GantryPlant(CLEAN.changed(**sections), seed=0), 1.0, **drive)
    without = flown(GantryPlant(CLEAN, seed=0), 1.0, **drive)
    assert np.array_equal(by_effect["z_m"], by_rig["z_m"])
    assert not np.array_equal(by_effect["z_m"], without["z_m"])


def test_thrust_coefficient_moves_the_hover_pulse() -> None:
    pulse_us = PROMPT.thrust.sufferer.pulse(WEIGHT_N / 1.1)
    run = flown(plant(PROMPT, thrust_coefficient={"scale": 1.1}), 0.5,
                sufferer_us=lambda t_s: pulse_us)  # fmt: skip
    assert run["sufferer_thrust_n"][-1] == pytest.approx(WEIGHT_N, rel=1e-9)


@pytest.mark.parametrize(("motor", "effect"), [("sufferer", "thrust_exponent"),
                                              ("source", "source_thrust_exponent")])  # fmt: skip
def test_a_thrust_exponent_bends_the_curve_about_hover(motor: str, effect: str) -> None:
    for pulse_us, table_n in ((1500.0, 2.25), (2000.0, 9.0)):
        run = flown(plant(PROMPT, **{effect: {"exponent": 1.2}}), 0.1,
                    **{f"{motor}_us": lambda t_s, us=pulse_us: us})  # fmt: skip
        expected_n = WEIGHT_N * (table_n / WEIGHT_N) ** 1.2
        assert run[f"{motor}_thrust_n"][-1] == pytest.approx(expected_n, rel=1e-9)


def test_a_dead_band_holds_the_pulse_until_the_change_is_large_enough() -> None:
    pulses = [1700.0] * 10 + [1704.0] * 10 + [1709.0] * 10 + [1705.0] * 10
    run = flown(plant(PROMPT, pwm_dead_band={"band_us": 5.0}), len(pulses) * DT_S,
                sufferer_us=lambda t_s: pulses[round(t_s / DT_S)])  # fmt: skip
    expected = [PROMPT.thrust.sufferer.thrust(us) for us in (1700.0, 1700.0, 1709.0, 1709.0)]
    assert run["sufferer_thrust_n"][5::10] == pytest.approx(expected)


def test_quantised_pulses_are_multiples_of_a_step_above_idle() -> None:
    run = flown(plant(PROMPT, pwm_quantisation={"step_us": 8.0}), 0.1,
                sufferer_us=lambda t_s: 1713.0, source_us=lambda t_s: 1715.0)  # fmt: skip
    thrust = PROMPT.thrust.sufferer.thrust
    assert run["sufferer_thrust_n"][-1] == pytest.approx(thrust(1712.0))
    assert run["source_thrust_n"][-1] == pytest.approx(thrust(1712.0))


def test_a_battery_sags_with_the_thrust_drawn_so_far() -> None:
    run = flown(plant(PROMPT, battery_sag={"sag_per_s": 0.01}), 8.0,
                sufferer_us=lambda t_s: 1600.0)  # fmt: skip
    drawn_s = 8.0 * 3.24 / WEIGHT_N
    assert run["sufferer_thrust_n"][-1] == pytest.approx(3.24 * np.exp(-0.01 * drawn_s), rel=1e-6)


def test_thrust_falls_with_the_speed_of_climb() -> None:
    run = flown(plant(PROMPT, axial_inflow_loss={"loss_s_per_m": 0.2}), 0.4,
                sufferer_us=lambda t_s: 1800.0)  # fmt: skip
    # m·dv/dt = T·exp(−k·v) − m·g; to first order in k·v an exponential approach.
    rate = 0.2 * 5.76 / MASS_KG
    first_order = (5.76 - WEIGHT_N) / (0.2 * 5.76) * (1.0 - np.exp(-rate * 0.4))
    assert run["vz_mps"][-1] == pytest.approx(first_order, rel=0.03)
    assert run["vz_mps"][-1] < 0.7 * (5.76 - WEIGHT_N) / MASS_KG * 0.4


def test_downwash_through_the_rotor_cuts_its_thrust() -> None:
    rig = with_effects(PROMPT, wake_inflow_loss={"loss_s_per_m": 0.03})
    blown = GantryPlant(rig, seed=0, wake_hook=lambda t_s, thrust_n, x_m, z_m: (0.0, -4.0))
    run = flown(blown, 0.1)
    assert run["sufferer_thrust_n"][-1] == pytest.approx(WEIGHT_N * np.exp(-0.12), rel=1e-9)
    assert flown(plant(PROMPT, wake_inflow_loss={"loss_s_per_m": 0.03}), 0.1)["sufferer_thrust_n"][
        -1
    ] == pytest.approx(WEIGHT_N, rel=1e-9)


def peaks_m(rig: Rig, speed_mps: float, passes: int = 2) -> list[float]:
    """Where the wake is strongest, as the carriage sees it, in passes to the right and back.

    The carriage swings between −0.3 and 0.3 m; the source has run for a second by then.
    """
    stretch_s = 0.6 / speed_mps

    def carriage(t_s: float) -> float:
        if t_s < 1.0:
            return -0.3
        return speed_mps if (t_s - 1.0) % (2 * stretch_s) < stretch_s else -speed_mps

    run = flown(GantryPlant(rig, seed=0), 1.0 + passes * stretch_s,
                sufferer_us=lambda t_s: 1000.0, source_us=lambda t_s: 1700.0,
                carriage_mps=carriage)  # fmt: skip
    edges = [round((1.0 + i * stretch_s) / DT_S) for i in range(passes + 1)]
    found = []
    for start, stop in itertools.pairwise(edges):
        force, x_m = run["wake_force_n"][start:stop], run["x_m"][start:stop]
        top = force < 0.8 * force.min()
        curve = np.polyfit(x_m[top], np.log(-force[top]), 2)  # of a Gaussian an exact parabola
        found.append(float(-0.5 * curve[1] / curve[0]))
    return found


SPEED = 0.3


@pytest.mark.parametrize(
    ("effect", "values", "expected_m"),
    [
        ("crosswind_offset", {"offset_m": 0.02}, (0.02, 0.02)),
        ("wake_deflection", {"deflection_s": 0.05}, (0.015, -0.015)),
        ("belt_backlash", {"backlash_m": 0.03}, (0.015, -0.015)),
        # 0.3 m of way to the left end, then 0.3 m to the middle, then 0.6 m to the middle again
        ("lost_steps", {"lost_per_m": 0.02}, (0.012, 0.024)),
    ],
)
def test_the_wakes_peak_moves(
    effect: str, values: dict[str, float], expected_m: tuple[float, float]
) -> None:
    still = peaks_m(CLEAN, SPEED)
    moved = peaks_m(with_effects(CLEAN, **{effect: values}), SPEED)
    assert np.subtract(moved, still) == pytest.approx(expected_m, abs=0.0015)


def forces_n(play_m: float, legs_m: tuple[float, ...]) -> np.ndarray:
    """The wake's force under a carriage that goes these legs, then waits for a second."""
    one = GantryPlant(with_effects(CLEAN, belt_backlash={"backlash_m": play_m}), seed=0)
    found = []
    for leg_m in (*legs_m, 0.0):
        steps = round(abs(leg_m) / 0.2 / DT_S) or 256
        for _ in range(steps):
            one.step(1700.0, 1000.0, leg_m / steps / DT_S)
            found.append(one.wake_force_n)
    return np.array(found)


def test_a_carriage_stays_while_its_drive_takes_up_the_play() -> None:
    """A drive that moves within the play leaves the sufferer where it is in the wake."""
    swung = forces_n(0.06, (0.025, -0.05, 0.03))
    assert swung[-1] < -0.3
    assert swung == pytest.approx(forces_n(0.0, (0.0,) * 3)[: len(swung)], abs=1e-12)
    # 0.12 m on, less half the play; then 0.05 m back, which the play takes up.
    expected = forces_n(0.0, (0.09,))[-1]
    assert forces_n(0.06, (0.12, -0.05))[-1] == pytest.approx(expected, rel=1e-6)
    expected = forces_n(0.0, (0.08,))[-1]
    assert forces_n(0.06, (0.12, -0.07))[-1] == pytest.approx(expected, rel=1e-6)
    assert forces_n(0.0, (0.12,))[-1] != pytest.approx(expected, rel=0.05)


def test_a_force_ahead_is_of_where_the_carriage_will_be() -> None:
    """Within the play the drive's speed takes it nowhere."""
    rig = with_effects(CLEAN, belt_backlash={"backlash_m": 0.2})
    for one, carriage_mps in ((GantryPlant(rig, seed=0), 0.1), (GantryPlant(rig, seed=0), 0.0)):
        for _ in range(128):
            one.step(1700.0, 1000.0, carriage_mps)
        if carriage_mps:
            moving_n = one.wake_force_ahead(0.2)
    assert moving_n == pytest.approx(one.wake_force_ahead(0.2), abs=1e-12)
    assert moving_n < -0.1


def test_crosswind_moves_what_a_wake_hook_is_asked_for() -> None:
    asked: list[float] = []

    def wake(t_s: float, thrust_n: float, x_m: float, z_m: float) -> tuple[float, float]:
        asked.append(x_m)
        return 0.0, 0.0

    rig = with_effects(CLEAN, crosswind_offset={"offset_m": 0.1})
    flown(GantryPlant(rig, seed=0, wake_hook=wake), 3 * DT_S, carriage_mps=lambda t_s: 0.2)
    assert asked == pytest.approx([-0.1, 0.2 * DT_S - 0.1, 0.4 * DT_S - 0.1])


@pytest.mark.parametrize(
    ("effect", "values", "thrust_n", "height_m"),
    [
        # a spring of 5 N/m from 0.4 m on carries 0.5 N of surplus 0.1 m above
        ("tether_spring", {"stiffness_n_per_m": 5.0, "slack_m": 0.4}, WEIGHT_N + 0.5, 0.5),
        # T·(1 + 0.2/(1 + (z/0.1)²)) = W, with T = W/1.1 where z = 0.1
        ("ground_effect", {"gain": 0.2, "height_m": 0.1}, WEIGHT_N / 1.1, 0.1),
    ],
)
def test_the_sufferer_settles_where_forces_balance(
    effect: str, values: dict[str, float], thrust_n: float, height_m: float
) -> None:
    damped = PROMPT.changed(rail={"viscous_n_per_mps": 3.0})
    pulse_us = damped.thrust.sufferer.pulse(thrust_n)
    run = flown(plant(damped, **{effect: values}), 8.0, sufferer_us=lambda t_s: pulse_us)
    assert run["z_m"][-1] == pytest.approx(height_m, abs=1e-3)


def test_recirculation_takes_thrust_with_its_square_near_the_base() -> None:
    values = {"loss": 0.1, "height_m": 0.15}
    first = flown(plant(PROMPT, recirculation=values), DT_S, sufferer_us=lambda t_s: 1800.0)
    net_n = 5.76 - 0.1 * 5.76**2 / WEIGHT_N - WEIGHT_N
    assert first["vz_mps"][0] == pytest.approx(net_n / MASS_KG * DT_S, rel=1e-9)


@pytest.mark.parametrize("added_kg", [0.05, 0.2])
def test_added_mass_slows_an_acceleration_and_weighs_nothing(added_kg: float) -> None:
    bare = flown(plant(PROMPT), 0.25, sufferer_us=lambda t_s: 1800.0)
    heavy = flown(
        plant(PROMPT, added_mass={"mass_kg": added_kg}), 0.25, sufferer_us=lambda t_s: 1800.0
    )
    ratio = MASS_KG / (MASS_KG + added_kg)
    assert heavy["vz_mps"][-1] / bare["vz_mps"][-1] == pytest.approx(ratio, rel=1e-9)
    rest = flown(plant(PROMPT, added_mass={"mass_kg": added_kg}), 0.25)
    assert rest["vz_mps"][-1] == pytest.approx(0.0, abs=1e-9)


def test_coulomb_friction_decelerates_by_force_over_mass() -> None:
    rig = with_effects(PROMPT, coulomb_friction={"coulomb_n": 0.2})
    launched = GantryPlant(rig, seed=0, force_hook=lambda t_s, state: 2.0 if t_s < 0.2499 else 0.0)
    run = flown(launched, 0.4)
    coasting = run["vz_mps"][64:]
    assert coasting[0] - coasting[25] == pytest.approx(0.2 / MASS_KG * 25 * DT_S, rel=1e-9)


def test_stiction_holds_until_its_threshold() -> None:
    rig = with_effects(PROMPT, stiction={"stiction_n": 0.3})
    for push_n, moves in ((0.29, False), (0.31, True)):
        pushed = GantryPlant(rig, seed=0, force_hook=lambda t_s, state, n=push_n: n)
        assert (flown(pushed, 0.1)["z_m"][-1] > 0.0) == moves


def climbing(rig: Rig) -> dict[str, np.ndarray]:
    return flown(GantryPlant(rig, seed=0), 0.8, sufferer_us=lambda t_s: 1740.0)


@pytest.mark.parametrize(
    ("effects", "scale", "bias_m"),
    [
        ({"range_bias": {"bias_m": 0.05}}, 1.0, 0.05),
        ({"range_scale": {"scale": 1.1}}, 1.1, 0.0),
        ({"range_bias": {"bias_m": 0.05}, "range_scale": {"scale": 1.1}}, 1.1, 0.05),
    ],
)
def test_bias_and_scale_of_the_range(
    effects: dict[str, dict[str, float]], scale: float, bias_m: float
) -> None:
    plain, wrong = climbing(PROMPT), climbing(with_effects(PROMPT, **effects))
    assert np.array_equal(plain["z_m"], wrong["z_m"])
    seen = np.isfinite(plain["range_m"])
    assert wrong["range_m"][seen] == pytest.approx(scale * plain["range_m"][seen] + bias_m)


def test_a_range_drift_begins_with_the_flight() -> None:
    def late_start(t_s: float) -> float:
        return 1000.0 if t_s < 1.0 else 1740.0

    runs = [
        flown(GantryPlant(rig, seed=0), 2.0, sufferer_us=late_start)
        for rig in (PROMPT, with_effects(PROMPT, range_drift={"drift_mps": 0.02}))
    ]
    drift_m = runs[1]["range_m"] - runs[0]["range_m"]
    assert drift_m[200] == 0.0
    expected_m = 0.02 * (runs[1]["sensor_time_s"][-1] - 1.0)
    assert drift_m[-1] == pytest.approx(expected_m, abs=1e-9)


def test_a_delayed_range_is_the_height_of_that_time_ago() -> None:
    run = climbing(with_effects(PROMPT, range_delay={"delay_s": 10 * DT_S}))
    taken = np.rint(run["sensor_time_s"][-50:] / DT_S).astype(int)
    assert run["range_m"][-50:] == pytest.approx(run["z_m"][taken - 11], abs=1e-12)


def test_sample_and_hold_repeats_readings_under_new_time_stamps() -> None:
    run = climbing(with_effects(PROMPT, sample_and_hold={"hold_s": 0.05}))
    _, first = np.unique(run["sensor_time_s"][100:], return_index=True)
    readings = run["range_m"][100:][first]
    changes = np.flatnonzero(np.diff(readings))
    assert set(np.diff(changes)) <= {3, 4}  # 50 ms are 3.2 samples of 1/64 s
    assert len(changes) == pytest.approx(len(readings) / 3.2, abs=1.0)


def test_a_command_hook_comes_before_the_latency_and_is_called_in_every_step() -> None:
    seen: list[float] = []

    def hook(t_s: float, source: float, sufferer: float, dt_s: float) -> tuple[float, float]:
        seen.append(t_s)
        return source, sufferer + 100.0

    rig = with_effects(PROMPT, command_latency={"latency_s": 4 * DT_S})
    run = flown(GantryPlant(rig, seed=0, command_hook=hook), 8 * DT_S,
                sufferer_us=lambda t_s: 1600.0)  # fmt: skip
    assert len(seen) == 8
    thrusts = run["sufferer_thrust_n"]
    assert thrusts[:4] == pytest.approx(0.0)
    assert thrusts[4:] == pytest.approx(PROMPT.thrust.sufferer.thrust(1700.0))
