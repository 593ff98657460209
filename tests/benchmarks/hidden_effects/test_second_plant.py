"""The second plant against analytic solutions, and against the first where both are neutral."""

import ast
import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import benchmarks.hidden_effects.second_plant as second
from benchmarks.hidden_effects.second_plant import (
    Constants,
    Jet,
    Numbers,
    SecondPlant,
    Sensing,
    Wake,
    calibrated_jet,
)
from benchmarks.hidden_effects.second_plant.motion import Inputs, air_speed
from runtime.loop.loop import Loop
from runtime.reference import random_plan
from runtime.simulated import SimulatedGantry
from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import Rows
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.physics.jet import VerticalJet
from wakedeploy.rig.file import default_rig

RIG = default_rig()
NEUTRAL = Numbers()
CALM = Sensing(noise_m=0.0, outlier_probability=0.0, turbulence_fraction=0.0, frame_s=1.0 / 256.0)
SLIPPERY = Numbers(coulomb_n=0.0, stiction_n=0.0, viscous_n_per_mps=0.0)
INSTANT = {"source_up_s": 0.0, "source_down_s": 0.0, "sufferer_up_s": 0.0, "sufferer_down_s": 0.0}


def plant(numbers: Numbers = NEUTRAL, sensing: Sensing = CALM) -> SecondPlant:
    return SecondPlant(Constants(numbers=numbers, sensing=sensing), seed=0)


def run(one: SecondPlant, seconds: float, sufferer_us: float, source_us: float = 1000.0) -> None:
    for _ in range(round(seconds / one.dt_s)):
        one.step(source_us, sufferer_us, 0.0)


def test_it_imports_nothing_of_the_project() -> None:
    allowed = {"numpy", "numba", *sys.stdlib_module_names}
    for path in Path(second.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                assert all(name.name.split(".")[0] in allowed for name in node.names), path
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 1 or str(node.module).split(".")[0] in allowed, path


def test_it_falls_freely() -> None:
    one = plant(SLIPPERY._replace(travel_m=1.0))
    one._state[0] = 1.0
    run(one, 0.25, 1000.0)
    assert one.z_m == pytest.approx(1.0 - 0.5 * 9.81 * 0.25**2, abs=1e-6)
    assert one.vz_mps == pytest.approx(-9.81 * 0.25, abs=1e-6)
    run(one, 0.5, 1000.0)
    assert (one.z_m, one.vz_mps) == (0.0, 0.0)


def test_viscous_friction_leads_to_the_terminal_speed() -> None:
    numbers = SLIPPERY._replace(viscous_n_per_mps=9.0, travel_m=1.0)
    one = plant(numbers)
    one._state[0] = 1.0
    run(one, 1.0, 1000.0)
    lag = 0.45 / 9.0
    speed = 0.45 * 9.81 / 9.0
    assert one.vz_mps == pytest.approx(-speed * (1.0 - math.exp(-1.0 / lag)), rel=1e-6)


def test_dry_friction_decelerates_evenly_and_then_holds() -> None:
    numbers = SLIPPERY._replace(coulomb_n=0.2, stiction_n=0.2, gravity_mps2=9.8, **INSTANT)
    one = plant(numbers)  # hovers at 1700 µs
    one._state[:2] = 0.3, 0.2
    one._next_frame_s = 0.0
    run(one, 0.25, 1700.0)
    assert one.vz_mps == pytest.approx(0.2 - 0.2 / 0.45 * 0.25, abs=1e-9)
    run(one, 1.0, 1700.0)
    assert one.vz_mps == 0.0
    assert one.z_m == pytest.approx(0.3 + 0.5 * 0.2**2 * 0.45 / 0.2, abs=1e-6)


def test_a_spool_without_windings_is_a_first_order_lag() -> None:
    one = plant(Numbers(electrical_share=0.0, sufferer_up_s=0.08))
    run(one, 0.2, 1500.0)
    settled = math.sqrt(2.25)
    waited = 0.2 - one.dt_s if one._next_frame_s > 0.2 else 0.2
    expected = settled * (1.0 - math.exp(-waited / 0.08))
    assert math.sqrt(one.sufferer_thrust_n) == pytest.approx(expected, rel=0.01)


def test_windings_keep_the_mean_of_the_lag() -> None:
    """A step's missing area is the mean lag, whatever its order: share · τ + (1 − share) · τ."""
    for share in (0.1, 0.5):
        one = plant(Numbers(electrical_share=share, sufferer_up_s=0.08), CALM)
        missing = 0.0
        for _ in range(512):
            one.step(1000.0, 1500.0, 0.0)
            missing += (1.5 - math.sqrt(one.sufferer_thrust_n)) * one.dt_s
        assert missing / 1.5 == pytest.approx(0.08, abs=0.006)


def test_two_equal_lags_are_a_critically_damped_second_order() -> None:
    one = plant(Numbers(electrical_share=0.5, sufferer_up_s=0.08), CALM)
    one._next_frame_s = 0.0
    run(one, 0.125, 1500.0)
    x = 0.125 / 0.04
    expected = 1.5 * (1.0 - (1.0 + x) * math.exp(-x))
    assert math.sqrt(one.sufferer_thrust_n) == pytest.approx(expected, rel=1e-5)


def still_air(distance_m: float, lateral_m: float, jet: Jet) -> float:
    inputs = Inputs(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2000, 1 / 256)
    return air_speed(2000 / 256, distance_m, lateral_m, jet, inputs, np.ones(1024))


def test_without_decay_the_jet_keeps_its_momentum() -> None:
    """∫ v² · 2πr dr is the same at every distance but for the loss that calibration found."""
    radius = np.linspace(0.0, 1.2, 1201)
    jet, flux = calibrated_jet(Wake(decay_per_s=0.0)), []
    for distance in (1.1, 1.5, 1.9):
        v = np.array([still_air(distance, r, jet) for r in radius])
        flux.append(np.trapezoid(v**2 * radius, radius))
    assert np.ptp(flux) / np.mean(flux) < 0.02


def test_the_jet_widens_in_proportion_to_the_distance() -> None:
    jet, widths = calibrated_jet(Wake()), []
    for distance in (1.2, 1.5, 1.8):
        axis, aside = (still_air(distance, r, jet) for r in (0.0, 0.15))
        widths.append(0.15 / math.sqrt(2.0 * math.log(axis / aside)))
    assert widths[2] - widths[1] == pytest.approx(widths[1] - widths[0], rel=1e-6)
    assert widths[0] < widths[1]


def test_the_calibrated_jet_blows_as_the_rigs_wake_does() -> None:
    """Same thrust, same places, a moving carriage: forces within a few per cent of their size."""
    rng = np.random.default_rng(1)
    dt = 1 / 256
    jet, field = calibrated_jet(Wake()), VerticalJet(RIG.wake, 2.0, dt)
    thrust, history = 2.0, np.zeros(1024)
    ours, theirs = [], []
    for k in range(256 * 12):
        if k % 128 == 0:
            target = rng.uniform(0.3, 7.0)
        thrust += (target - thrust) * (1.0 - math.exp(-dt / 0.1))
        field.inject(thrust)
        history[k % 1024] = math.sqrt(thrust / 4.41)
        x, z = 0.25 * math.sin(0.9 * k * dt), 0.6 + 0.25 * math.sin(0.5 * k * dt)
        inputs = Inputs(k * dt, x, 0.0, 0.0, 0.0, 0.0, k, dt)
        if k > 256:
            ours.append(0.03 * air_speed((k + 0.5) * dt, 2.0 - z, x, jet, inputs, history) ** 2)
            theirs.append(0.03 * field.velocity(x, z) ** 2)
    wrong = np.std(np.subtract(ours, theirs)) / np.std(theirs)
    assert wrong < 0.03
    assert np.mean(ours) == pytest.approx(np.mean(theirs), rel=0.03)


def blown(play_m: float, *legs_m: float) -> float:
    """The wake's force [N] under a carriage that went these legs, then waited two seconds."""
    one = plant(SLIPPERY._replace(backlash_m=play_m))
    for leg_m in (*legs_m, 0.0):
        steps = round(abs(leg_m) / 0.2 / one.dt_s) or 512
        for _ in range(steps):
            one.step(1700.0, 1000.0, leg_m / steps / one.dt_s)
    return one.wake_force_n


def test_a_belts_play_is_taken_up_before_the_carriage_moves() -> None:
    assert blown(0.06, 0.025, -0.05, 0.03) == pytest.approx(blown(0.0), rel=1e-6)
    assert blown(0.06, 0.12) == pytest.approx(blown(0.0, 0.09), rel=1e-6)
    assert blown(0.06, 0.12, -0.05) == pytest.approx(blown(0.0, 0.09), rel=1e-6)
    assert blown(0.06, 0.12, -0.07) == pytest.approx(blown(0.0, 0.08), rel=1e-6)
    assert blown(0.06, 0.12, -0.2) == pytest.approx(blown(0.0, -0.05), rel=1e-6)
    assert blown(0.0, 0.12) != pytest.approx(blown(0.0, 0.09), rel=0.05)


def test_the_integrator_converges_with_its_tolerance() -> None:
    ends = []
    for tolerance in (1e-4, 1e-6, 1e-9):
        one = SecondPlant(Constants(sensing=CALM), seed=0, tolerance=tolerance)
        for k in range(512):
            one.step(1600.0 if k % 64 < 32 else 1300.0, 1720.0 if k % 50 < 25 else 1690.0, 0.1)
        ends.append((one.z_m, one.integrator_steps))
    assert abs(ends[1][0] - ends[2][0]) < 1e-4
    assert abs(ends[1][0] - ends[2][0]) <= abs(ends[0][0] - ends[2][0]) + 1e-7
    assert ends[2][1] > ends[1][1]


def fly(make: Callable[[], GantryPlant | SecondPlant], seed: int, seconds: float) -> RunLog:
    world = SimulatedGantry(make(), truth=RIG, seed=seed)  # type: ignore[arg-type]
    rows = Rows()
    Loop(RIG, world, world, random_plan(RIG, seconds, seed), None, rows, world).run()
    return RunLog.from_rows(rows.rows)


@pytest.mark.whole
def test_the_rigs_loop_flies_it_as_it_flies_the_first_plant() -> None:
    first = fly(lambda: GantryPlant(RIG, seed=5), 5, 12.0)
    other = fly(lambda: SecondPlant(Constants(), seed=5), 5, 12.0)
    assert set(other["mode"]) == {"ARMED", "RUNNING", "LANDING"}
    apart = first["true_z_m"] - other["true_z_m"]
    assert np.sqrt(np.mean(apart**2)) < 0.012
    assert np.ptp(other["true_z_m"]) > 0.3
    assert other.tracking_rmse_m("true_z_m") == pytest.approx(
        first.tracking_rmse_m("true_z_m"), rel=0.15
    )


@pytest.mark.whole
def test_a_flight_repeats_by_seed() -> None:
    flights = [fly(lambda s=s: SecondPlant(Constants(), seed=s), 2, 6.0) for s in (2, 2, 3)]
    assert np.array_equal(flights[0]["range_m"], flights[1]["range_m"], equal_nan=True)
    assert not np.array_equal(flights[0]["range_m"], flights[2]["range_m"], equal_nan=True)


def test_a_stronger_jet_that_moves_faster_thins_out() -> None:
    """In steady state, air that goes (u / u₀)^e times as fast lies that much less dense."""
    inputs = Inputs(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2000, 1 / 256)
    strong = np.full(1024, math.sqrt(7.0 / 4.41))
    for exponent in (0.2, -0.2):
        wake = RIG.changed(wake={"speed_exponent": exponent}).wake
        field = VerticalJet(wake, 2.0, 1 / 256)
        for _ in range(600):
            field.inject(7.0)
        jet = calibrated_jet(Wake(speed_exponent=exponent))
        ours = air_speed(2000.5 / 256, 1.4, 0.1, jet, inputs, strong)
        assert ours == pytest.approx(field.velocity(0.1, 0.6), rel=0.02)
