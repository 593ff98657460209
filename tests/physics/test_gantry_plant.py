"""The plant against an adaptive integrator, and the promises about its hooks."""

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig, parse_rig

CLEAN = default_rig().changed(
    disturbance={
        "turbulence_fraction": 0.0,
        "outlier_probability": 0.0,
        "clock_jitter_s": 0.0,
        "esc_frame_s": 0.0,
    },
    rail={"coulomb_n": 0.0, "stiction_n": 0.0, "viscous_n_per_mps": 0.3},
)


def fly_open_loop(plant: GantryPlant, seconds: float) -> np.ndarray:
    """Heights under a fixed sequence of pulse widths, the carriage crossing the jet."""
    heights = []
    for i in range(round(seconds / plant.dt_s)):
        source_us = 1850.0 if (i // 128) % 2 else 1400.0
        plant.step(source_us, 1730.0 if i < 64 else 1712.0, 0.1)
        heights.append(plant.z_m)
    return np.array(heights)


def test_flight_agrees_with_an_adaptive_integrator() -> None:
    rig = CLEAN.changed(wake={"strength": 0.0})
    flown = fly_open_loop(GantryPlant(rig, seed=0), 1.0)

    def flow(t_s: float, state: np.ndarray) -> list[float]:
        z, v, speed = state
        target = np.sqrt(rig.thrust.sufferer.thrust(1730.0 if t_s < 0.25 else 1712.0))
        lag = rig.spool.sufferer.up_s if target > speed else rig.spool.sufferer.down_s
        force = speed**2 - 0.3 * v - rig.sufferer.mass_kg * 9.81
        on_stop = z <= 0.0 and force < 0.0 and v <= 0.0
        return [0.0 if on_stop else v, 0.0 if on_stop else force / 0.45, (target - speed) / lag]

    solved = solve_ivp(flow, (0.0, 1.0), [0.0, 0.0, 0.0], max_step=0.001, rtol=1e-8, atol=1e-10)
    assert flown[-1] == pytest.approx(solved.y[0, -1], abs=0.003)
    assert flown[-1] > 0.02  # it did fly


def test_each_hook_is_called_once_per_step_in_order_from_zero() -> None:
    calls: dict[str, list[float]] = {"command": [], "force": [], "sensor": [], "wake": []}

    def command(t_s: float, source: float, sufferer: float, dt_s: float) -> tuple[float, float]:
        assert dt_s <= 1.0 / 128.0
        calls["command"].append(t_s)
        return source, sufferer

    def force(t_s: float, state: Mapping[str, float]) -> float:
        assert set(state) >= {"z_m", "vz_mps", "x_m", "vx_mps", "source_thrust_n"}
        with pytest.raises(TypeError):
            state["z_m"] = 1.0  # type: ignore[index]
        calls["force"].append(t_s)
        return 0.0

    def sensor(t_s: float, range_m: float, steps: int) -> tuple[float, int]:
        assert isinstance(steps, int)
        calls["sensor"].append(t_s)
        return range_m, steps

    def wake(t_s: float, thrust_n: float, x_m: float, z_m: float) -> tuple[float, float]:
        calls["wake"].append(t_s)
        return 0.0, 0.0

    plant = GantryPlant(
        CLEAN,
        seed=0,
        command_hook=command,
        force_hook=force,
        sensor_hook=sensor,
        wake_hook=wake,
    )
    fly_open_loop(plant, 0.5)
    expected = np.arange(128) * plant.dt_s
    for times in calls.values():
        assert np.allclose(times, expected, atol=1e-12)


def test_a_command_hook_acts_on_the_motors_and_is_hidden_from_the_report() -> None:
    plant = GantryPlant(CLEAN, seed=0, command_hook=lambda t, a, b, dt: (a - 100.0, b - 200.0))
    for _ in range(512):
        plant.step(1600.0, 1500.0, 0.0)
    assert plant.source_thrust_n == pytest.approx(CLEAN.thrust.source.thrust(1500.0), rel=1e-3)
    assert plant.sufferer_thrust_n == pytest.approx(0.81, rel=1e-3)
    assert (plant.source_applied_us, plant.sufferer_applied_us) == (1600.0, 1500.0)


def test_a_force_hook_lifts_the_sufferer() -> None:
    weight_n = CLEAN.sufferer.mass_kg * 9.81
    plant = GantryPlant(CLEAN, seed=0, force_hook=lambda t, state: weight_n + 0.45)
    for _ in range(128):
        plant.step(1000.0, 1000.0, 0.0)
    tau = 0.45 / 0.3  # one newton per kilogram up, against 0.3 N s/m of viscous friction
    height = 0.45 / 0.3 * (0.5 - tau * (1 - np.exp(-0.5 / tau)))
    assert plant.z_m == pytest.approx(height, abs=0.003)


def test_a_sensor_hook_changes_only_what_is_read() -> None:
    def broken(t_s: float, range_m: float, steps: int) -> tuple[float, int]:
        return (float("nan") if t_s > 0.5 else range_m + 0.1), steps - 7

    plants = [GantryPlant(CLEAN, seed=4, sensor_hook=hook) for hook in (None, broken)]
    flown = [fly_open_loop(plant, 1.0) for plant in plants]
    assert np.array_equal(*flown)
    assert plants[1].steps == plants[0].steps - 7
    assert np.isnan(plants[1].range_sample().range_m)


def test_a_wake_hook_replaces_the_field() -> None:
    plant = GantryPlant(CLEAN, seed=0, wake_hook=lambda t, thrust, x, z: (3.0, -4.0))
    plant.step(1000.0, 1000.0, 0.0)
    assert plant.wake_force_n == pytest.approx(-0.5 * 1.2 * 0.05 * 4.0 * 5.0)
    with pytest.raises(UnusableInput, match="wake_hook"):
        plant.wake_force_ahead(0.1)


def test_the_force_ahead_is_the_force_that_comes() -> None:
    plant = GantryPlant(CLEAN, seed=0, wake_hook=None)
    fly_open_loop(plant, 1.5)
    foreseen = [plant.wake_force_ahead(24 * plant.dt_s)]
    for _ in range(24):
        plant.step(1400.0, 1712.0, 0.1)
    assert foreseen[0] == pytest.approx(plant.wake_force_n, abs=0.01)
    assert abs(foreseen[0]) > 0.1


def test_flights_differ_by_seed_alone() -> None:
    def flown(rig: Rig, seed: int) -> np.ndarray:
        return fly_open_loop(GantryPlant(rig, seed=seed), 0.5)

    assert np.array_equal(flown(default_rig(), 1), flown(default_rig(), 1))
    assert not np.array_equal(flown(default_rig(), 1), flown(default_rig(), 2))


def test_an_effect_that_is_not_known_is_refused_rather_than_ignored() -> None:
    raw = default_rig().text + '\n[[effect]]\nname = "ghost"\n'
    with pytest.raises(UnusableInput, match="ghost"):
        GantryPlant(parse_rig(raw), seed=0)
