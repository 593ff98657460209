"""Each procedure finds a truth that the rig file does not state, and refuses what cannot be right.

In simulated time, by the loop that flies the rig. A value has to lie within three of its own
spreads, and within what is useful.
"""

import functools
import re

import numpy as np
import pytest
from simulated_site import SimulatedSite

from runtime.calibration import heights, latency, noise, spool, steps_per_metre, thrust, zero
from runtime.calibration.session import resting
from runtime.reference import hold_plan
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.runlog import RunLog
from wakedeploy.physics.constants import constants_of, spreads_of, with_constants
from wakedeploy.physics.gantry import INNER_RATE_HZ
from wakedeploy.rig.file import default_rig
from wakedeploy.rig.update import updated

RIG = default_rig()


def agrees(outcome, name, truth, useful):
    known = outcome.constants[name]
    assert abs(known.value - truth) < 3.0 * known.spread, (known, truth)
    assert abs(known.value - truth) < useful, (known, truth)
    assert known.spread < useful


@pytest.mark.parametrize("bias_m", [0.0, 0.003, 0.085])
def test_zero_finds_the_bias_also_where_half_the_noise_is_cut_off(bias_m):
    site = SimulatedSite(RIG.changed(range_sensor={"bias_m": bias_m}), seed=11)
    agrees(zero.estimate(zero.record(site, RIG), RIG), "range_sensor.bias_m", bias_m, 0.001)


def test_zero_keeps_the_motors_off():
    log = zero.record(SimulatedSite(RIG), RIG)
    assert set(log["mode"]) == {"ARMED"}
    assert set(log["sufferer_cmd_us"]) == set(log["source_cmd_us"]) == {RIG.limits.pulse_us[0]}


def test_a_calibrated_bias_is_what_estimator_and_plant_and_gap_use():
    truth = RIG.changed(range_sensor={"bias_m": 0.05, "scale": 1.04})
    site, plan = SimulatedSite(truth, seed=4), hold_plan(RIG, 10.0, 0.5, 1000.0)
    found = zero.estimate(zero.record(site, RIG), RIG)
    calibrated = updated(RIG, found.constants, "2026-01-31").changed(range_sensor={"scale": 1.04})
    flown = site.flown("hold", calibrated, plan)
    hovering = flown.flying & (np.abs(flown["z_ref_m"] - 0.5) < 1e-6)
    # By the true height, 0.5 m is read as 0.05 + 1.04 · 0.5.
    assert np.nanmean(flown["range_m"][hovering]) == pytest.approx(0.57, abs=0.004)
    assert np.mean(flown["z_est_m"][hovering]) == pytest.approx(0.5, abs=0.004)
    name = "range.bias_m"
    assert constants_of(calibrated)[name] == calibrated.range_sensor.bias_m
    assert spreads_of(calibrated)[name] == calibrated.calibration["range_sensor.bias_m"].spread


def rested(readings_m):
    """A log of a rest with these readings, one new one per tick."""
    rows = [
        {"tick": i, "t_s": i / 32, "range_m": r, "range_age_s": 0.01, "range_repeats": 0,
         "steps": 0, "source_cmd_us": 1000.0, "sufferer_cmd_us": 1000.0, "mode": "ARMED"}
        for i, r in enumerate(readings_m)
    ]  # fmt: skip
    return RunLog.from_rows(rows)


def noisy(count=400, mean_m=0.05, noise_m=0.004, seed=1):
    return np.round(np.random.default_rng(seed).normal(mean_m, noise_m, count), 3)


@pytest.mark.parametrize(
    ("readings_m", "words"),
    [
        (noisy(60), "Only 60 valid range readings"),
        (np.full(400, np.nan), "Only 0 valid"),
        (np.maximum(noisy(mean_m=-0.02), 0.0), "are zero"),
        (noisy(noise_m=0.04, mean_m=0.2), "scatter by"),
        (noisy() + np.linspace(0.0, 0.03, 400), "drifted"),
        (noisy(mean_m=0.5), "lies on the stop"),
    ],
)
def test_zero_refuses_what_is_no_rest_on_the_stop(readings_m, words):
    with pytest.raises(CheckFailed, match=words):
        zero.estimate(rested(readings_m), RIG)


def test_range_finds_bias_and_scale_from_spacers():
    truth = RIG.changed(range_sensor={"bias_m": 0.031, "scale": 1.03})
    site, heights_m = SimulatedSite(truth, seed=3), (0.0, 0.35, 0.8)
    logs = [heights.record(site, RIG, h, i) for i, h in enumerate(heights_m)]
    assert all(set(log["mode"]) == {"ARMED"} for log in logs)
    found = heights.estimate(logs, heights_m, RIG)
    agrees(found, "range_sensor.bias_m", 0.031, 0.002)
    agrees(found, "range_sensor.scale", 1.03, 0.005)
    with pytest.raises(CheckFailed, match="a fourth height would tell"):
        heights.estimate(logs, (0.0, 0.30, 0.8), RIG)  # the middle one is typed wrongly
    with pytest.raises(CheckFailed, match="per metre"):
        heights.estimate(logs[::2], (0.0, 0.5), RIG)


@pytest.mark.parametrize("wrong", range(4))
def test_range_names_the_spacer_that_is_off_also_at_an_end(wrong):
    site, heights_m = SimulatedSite(RIG, seed=4), [0.0, 0.3, 0.55, 0.8]
    logs = [heights.record(site, RIG, h, i) for i, h in enumerate(heights_m)]
    heights.estimate(logs, heights_m, RIG)
    said = heights_m[wrong] = heights_m[wrong] + 0.02
    with pytest.raises(CheckFailed, match=rf"At {said:g} m the sensor reads -\d+\.\d mm beside"):
        heights.estimate(logs, heights_m, RIG)


@pytest.mark.parametrize(
    "heights_m", [(0.3,), (0.3, 0.3), (0.3, 0.35), (0.0, 5.0), (-0.1, 0.3), (0.0, float("nan"))]
)
def test_range_needs_two_heights_apart_and_within_the_travel(heights_m):
    with pytest.raises(UnusableInput):
        heights.require_heights(heights_m, RIG)


BIASED = RIG.changed(range_sensor={"bias_m": 0.02})


@functools.cache
def hovered(noise_m):
    truth = RIG.changed(range_sensor={"noise_m": noise_m, "bias_m": 0.02})
    return noise.record(SimulatedSite(truth, seed=3), BIASED)


@pytest.mark.parametrize("noise_m", [0.002, pytest.param(0.0065, marks=pytest.mark.slow)])
def test_noise_is_found_in_hover(noise_m):
    agrees(noise.estimate(hovered(noise_m), BIASED), "range_sensor.noise_m", noise_m, 0.2 * noise_m)


def test_noise_refuses_a_sensor_that_repeats_itself_and_a_log_without_a_hover():
    log = hovered(0.002)
    with pytest.raises(CheckFailed, match="Only 0 valid"):
        noise.estimate(rested(noisy()), RIG)
    held = RunLog({**log.columns, "range_m": np.repeat(log["range_m"][::2], 2)[: len(log)]})
    with pytest.raises(CheckFailed, match="repeat the one before"):
        noise.estimate(held, BIASED)


@pytest.mark.whole
def test_latency_is_sensing_and_round_trip_together():
    """The plant senses in inner steps, and what it read before a step is seen after it."""
    found = []
    for inner_steps in (4, 8):
        round_trip_s = inner_steps / INNER_RATE_HZ
        site = SimulatedSite(RIG.changed(latency={"round_trip_s": round_trip_s}), seed=3)
        outcome = latency.estimate(latency.record(site, RIG), RIG)
        agrees(outcome, "latency.round_trip_s", round_trip_s + 1.0 / INNER_RATE_HZ, 0.002)
        found.append(outcome.constants["latency.round_trip_s"].value)
    assert found[1] - found[0] == pytest.approx(4 / INNER_RATE_HZ, abs=0.0005)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"round_trip_s": lambda t: np.full_like(t, np.nan)}, "Only 0 round trips"),
        ({"round_trip_s": lambda t: np.full_like(t, 0.05)}, "answers take 50.0 ms"),
        ({"round_trip_s": lambda t: np.tile([0.001, 0.03], len(t))[: len(t)]}, "answers scatter"),
        ({"range_age_s": lambda t: np.full_like(t, 0.4)}, "youngest range samples are 400"),
    ],
)
def test_latency_refuses_silence_and_what_is_no_latency(changes, words):
    log = latency.record(SimulatedSite(RIG, seed=3), RIG)
    spoilt = {name: made(log["t_s"]) for name, made in changes.items()}
    with pytest.raises(CheckFailed, match=words):
        latency.estimate(RunLog({**log.columns, **spoilt}), RIG)


CLIPS_KG = (0.0, 0.12, 0.25, 0.0)
DIVIDED = RIG.changed(battery={"has_divider": True})


def curve(scale, exponent):
    return with_constants(
        RIG, {"thrust.sufferer.scale": scale, "thrust.sufferer.exponent": exponent}
    )


def with_battery(log, volts):
    return RunLog({**log.columns, "battery_v": np.full(len(log), volts)})


@pytest.mark.whole
def test_thrust_finds_scale_and_exponent_of_the_curve():
    truth = curve(0.93, 1.08)
    site = SimulatedSite(truth, seed=5)
    logs = [thrust.record(site, RIG, clip, i) for i, clip in enumerate(CLIPS_KG)]
    found = thrust.estimate(logs, CLIPS_KG, RIG).constants["thrust.sufferer.thrust_n"]
    true_n, hover_n = truth.thrust.sufferer, RIG.sufferer.mass_kg * 9.81
    after = updated(RIG, {"thrust.sufferer.thrust_n": found}, "2026-01-31").thrust.sufferer
    assert abs(after.thrust(true_n.pulse(hover_n)) - hover_n) < 3.0 * found.spread < 0.1
    for clip in CLIPS_KG:  # over the range that was flown, within 1 %
        weight_n = (RIG.sufferer.mass_kg + clip) * 9.81
        assert after.thrust(true_n.pulse(weight_n)) == pytest.approx(weight_n, rel=0.01)
    with pytest.raises(CheckFailed, match="scatter by"):
        thrust.estimate(logs, (0.0, 0.25, 0.12, 0.0), RIG)  # two masses mixed up
    volts = (12.4, 12.0, 11.6, 12.0)
    sagging = [with_battery(log, v) for log, v in zip(logs, volts, strict=True)]
    with pytest.raises(CheckFailed, match=r"11\.60 to 12\.40 V"):
        thrust.estimate(sagging, CLIPS_KG, DIVIDED)
    steady = [with_battery(log, 12.1) for log in logs]
    told = thrust.estimate(steady, CLIPS_KG, DIVIDED).sentences
    assert "12.10 V" in told[0]
    assert "gap goes on assuming 0.05" in told[-1]


def sagging_flights(thrusts):
    """Flights of a battery whose thrust falls from one mass to the next."""
    return [
        thrust.record(SimulatedSite(curve(scale, 1.0), seed=5), RIG, clip, i)
        for i, (clip, scale) in enumerate(zip(CLIPS_KG, thrusts, strict=True))
    ]


@pytest.mark.slow
def test_a_battery_that_sags_from_mass_to_mass_does_not_bend_the_curve():
    volts = np.array([12.1, 12.0, 11.9, 11.8])
    logs = sagging_flights((volts / np.mean(volts)) ** 2)

    def exponent(outcome):
        (line,) = (t for t in outcome.sentences if "exponent" in t and "Scale" in t)
        return [float(number) for number in re.findall(r"exponent (\d\.\d+) ± (\d\.\d+)", line)[0]]

    measured = [with_battery(log, v) for log, v in zip(logs, volts, strict=True)]
    anything = [with_battery(log, v) for log, v in zip(logs, volts[::-1], strict=True)]
    # An open pin is not looked at, whatever it read.
    for flights, rig in ((logs, RIG), (measured, DIVIDED), (anything, RIG)):
        outcome = thrust.estimate(flights, CLIPS_KG, rig)
        value, spread = exponent(outcome)
        assert abs(value - 1.0) < 3.0 * spread < 0.1
    flat = [with_battery(log, 12.0) for log in logs]  # as if the voltage had not changed
    with pytest.raises(CheckFailed, match="scatter by"):
        thrust.estimate(flat, CLIPS_KG, DIVIDED)
    with pytest.raises(CheckFailed, match="fly the first mass again at the end"):
        thrust.estimate(logs[:3], CLIPS_KG[:3], RIG)
    three = thrust.estimate(measured[:3], CLIPS_KG[:3], DIVIDED)
    assert "curve is that of 12.00 V" in " ".join(three.sentences)


@pytest.mark.slow
def test_thrust_refuses_an_exponent_that_masses_so_close_cannot_tell():
    clips_kg = (0.0, 0.02, 0.045)
    logs = [thrust.record(SimulatedSite(RIG, seed=7), RIG, c, i) for i, c in enumerate(clips_kg)]
    logs = [with_battery(log, v) for log, v in zip(logs, (12.0, 12.05, 12.0), strict=True)]
    with pytest.raises(CheckFailed, match=r"exponent could be off by 0\.\d\d"):
        thrust.estimate(logs, clips_kg, DIVIDED)


@pytest.mark.whole
def test_thrust_refuses_a_flight_that_held_still_or_had_the_source_on():
    still = hold_plan(RIG, 28.0, 0.5, RIG.limits.pulse_us[0])
    held = SimulatedSite(RIG).flown("still", RIG, still)
    with pytest.raises(CheckFailed, match="free the rail"):
        thrust.estimate([held] * 4, CLIPS_KG, RIG)
    flown = thrust.record(SimulatedSite(curve(0.93, 1.08), seed=5), RIG, CLIPS_KG[0], 0)
    source_us = np.where(flown["z_est_m"] > 0.3, 1500.0, flown["source_cmd_us"])
    blown = RunLog({**flown.columns, "source_cmd_us": source_us})
    with pytest.raises(CheckFailed, match="source ran"):
        thrust.estimate([blown] * 4, CLIPS_KG, RIG)


@pytest.mark.parametrize(
    "clips_kg", [(0.0, 0.2), (0.1, 0.1, 0.2), (0.0, 0.01, 0.02), (0.0, 0.1, 0.4), (-0.1, 0.1, 0.2)]
)
def test_thrust_needs_three_masses_apart_that_can_be_carried(clips_kg):
    with pytest.raises(UnusableInput):
        thrust.require_masses(clips_kg, RIG)


def test_without_a_divider_the_first_mass_has_to_come_again_before_anything_flies():
    with pytest.raises(UnusableInput, match="fly the first mass again at the end"):
        thrust.require_masses(CLIPS_KG[:3], RIG)
    thrust.require_masses(CLIPS_KG, RIG)
    thrust.require_masses(CLIPS_KG[:3], DIVIDED)


@pytest.mark.whole
def test_steps_are_counted_over_the_measured_distance_with_motors_off():
    site = SimulatedSite(RIG.changed(stepper={"steps_per_m": 4000}), seed=3)
    log = steps_per_metre.record(site, RIG, -0.4, hold_s=4.0)
    assert set(log["sufferer_cmd_us"]) == set(log["source_cmd_us"]) == {RIG.limits.pulse_us[0]}
    measured_m = round(0.4 * 4200 / 4000, 3)  # as a rule would show it
    agrees(steps_per_metre.estimate(log, measured_m, RIG), "stepper.steps_per_m", 4000.0, 20.0)
    with pytest.raises(CheckFailed, match="in metres"):
        steps_per_metre.estimate(log, 42.0, RIG)
    lost = RunLog({**log.columns, "steps": log["steps"] + 100.0 * (log["t_s"] > 20.0)})
    lost["steps"][-1] = 100.0
    with pytest.raises(CheckFailed, match="lost steps"):
        steps_per_metre.estimate(lost, measured_m, RIG)
    away = RunLog({**log.columns, "homed": np.zeros(len(log))})
    with pytest.raises(CheckFailed, match="away from its home"):
        steps_per_metre.estimate(away, measured_m, RIG)
    with pytest.raises(CheckFailed, match="never stood still"):
        steps_per_metre.estimate(zero.record(site, RIG), measured_m, RIG)
    with pytest.raises(CheckFailed, match="too short"):
        steps_per_metre.estimate(log, 0.05, RIG)


@pytest.mark.parametrize("distance_m", [0.05, 0.7, float("nan")])
def test_a_drive_is_long_enough_and_within_the_limits(distance_m):
    with pytest.raises(UnusableInput, match="distance-m"):
        steps_per_metre.require_distance(distance_m, RIG)


@functools.cache
def stepped(up_s, down_s):
    truth = RIG.changed(spool={"sufferer": {"up_s": up_s, "down_s": down_s}})
    return spool.record(SimulatedSite(truth, seed=5), RIG)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("up_s", "down_s"), [(0.04, 0.07), pytest.param(0.09, 0.14, marks=pytest.mark.slow)]
)
def test_spool_finds_both_lags(up_s, down_s):
    found = spool.estimate(stepped(up_s, down_s), RIG)
    agrees(found, "spool.sufferer.up_s", up_s, 0.012)
    agrees(found, "spool.sufferer.down_s", down_s, 0.012)


@pytest.mark.whole
def test_spool_refuses_a_flight_without_steps_too_short_or_half_seen():
    still = SimulatedSite(RIG).flown("still", RIG, hold_plan(RIG, 18.0, 0.6, 1000.0))
    with pytest.raises(CheckFailed, match="has to step"):
        spool.estimate(still, RIG)
    short = SimulatedSite(RIG).flown("short", RIG, hold_plan(RIG, 10.0, 0.6, 1000.0))
    with pytest.raises(CheckFailed, match="windows of 2 s"):
        spool.estimate(short, RIG)
    log = stepped(0.04, 0.07)
    seen = np.where((log["t_s"] > 15.0) & (log["t_s"] < 19.0), np.nan, log["range_m"])
    with pytest.raises(CheckFailed, match="missed too much"):
        spool.estimate(RunLog({**log.columns, "range_m": seen}), RIG)


def test_a_rest_has_no_height_limit_and_lasts_as_long_as_asked():
    wide, plan = resting(RIG, 12.0)
    far = SimulatedSite(RIG.changed(range_sensor={"bias_m": 0.2}))
    log = far.flown("rest", wide, plan)
    assert log["t_s"][-1] == pytest.approx(12.0, abs=0.1)
    assert set(log["mode"]) == {"ARMED"}
