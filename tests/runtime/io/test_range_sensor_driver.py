"""The real driver and the real range source, on a bus whose sensor is played register by register.

Only `board`, which refuses to load anywhere but on a single-board computer, is replaced.
"""

import itertools
import statistics
import sys
import time
import types

import pytest
from vl53l0x_registers import STOP_VARIABLE, RegisterSensor

from runtime.io.range_source import (
    NOTHING_IN_RANGE_MM,
    TIMING_BUDGET_US,
    I2cRangeSource,
    SocketRangeSource,
    wait_for_first,
)
from runtime.request import RunRequest
from runtime.run import fly
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import default_rig

pytest.importorskip("adafruit_vl53l0x", reason="the range sensor's driver is not installed")

RIG = default_rig().changed(disturbance={"rest_s": 0.2})


@pytest.fixture
def wired(monkeypatch):
    """Puts a sensor on this 'Pi's' bus and opens a range source, closed at the end."""
    opened = []

    def wire(chip):
        monkeypatch.setitem(sys.modules, "board", types.SimpleNamespace(I2C=lambda: chip))
        opened.append(I2cRangeSource())
        return opened[-1]

    yield wire
    for source in opened:
        source.close()


def until(condition, limit_s=10.0):
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, "it never happened"
        time.sleep(0.002)


def counting(start=300):
    """A chip whose every measurement is another number, and those numbers' times in its list."""
    count = itertools.count(start)
    return RegisterSensor(lambda _: next(count))


def test_the_driver_sets_the_chip_up_and_measures_continuously(wired):
    chip = counting()
    source = wired(chip)
    first = wait_for_first(source)
    assert chip.continuous
    assert chip.enabled_spads == 5
    # Budgets are quantised; the nearest that the chip can have lies within 5 %.
    budget_us = source._sensor.measurement_timing_budget
    assert budget_us == pytest.approx(TIMING_BUDGET_US, rel=0.05)
    until(lambda: source.newest.range_mm >= first.range_mm + 5)
    source.close()
    assert not chip.continuous


def test_values_are_the_sensors_and_each_is_dated_once_and_after_it_was_taken(wired):
    chip = counting()
    source, seen = wired(chip), {}
    while len(seen) < 10:
        if source.newest is not None:
            seen[source.newest.sensor_time_us] = source.newest.range_mm
        time.sleep(0.001)
    taken_s = {value: when_s for when_s, value in chip.measured}
    assert len(set(seen.values())) == len(seen)  # no measurement under two times
    assert set(seen.values()) <= set(taken_s)
    late_s = [1e-6 * us - taken_s[value] for us, value in seen.items()]
    # Looking takes time, so a date is late rather than early; a measurement that ends between
    # looking and reading is the one exception.
    assert min(late_s) > -1e-5 - chip.period_s
    assert statistics.median(late_s) > -2e-3


def test_a_stop_variable_that_is_not_the_chips_own_starts_nothing():
    chip = counting()
    chip.try_lock()
    for index, value in ((0xFF, 1), (0x91, STOP_VARIABLE ^ 1), (0xFF, 0), (0x00, 2)):
        chip.writeto(0x29, bytes([index, value]))
    chip.unlock()
    time.sleep(0.05)
    chip.try_lock()
    chip.readfrom_into(0x29, bytearray(1))
    assert not chip.measured


def test_nothing_in_range_is_a_missing_sample(wired):
    far = RegisterSensor(lambda _: NOTHING_IN_RANGE_MM)
    source = wired(far)
    until(lambda: source.newest is not None)
    assert source.newest.range_m != source.newest.range_m
    with pytest.raises(UnusableInput, match="no valid reading within"):
        wait_for_first(source, limit_s=0.2)


def test_some_errors_of_the_bus_are_survived(wired):
    chip = counting()
    source = wired(chip)
    wait_for_first(source)
    before = source.newest.range_mm
    chip.errors = 6
    until(lambda: chip.errors == 0)
    until(lambda: source.newest.range_mm > before + 2)
    assert source.failure is None


def test_a_measurement_that_could_not_be_cleared_is_not_dated_anew(wired):
    values = itertools.count(300)
    chip = RegisterSensor(lambda _: next(values), period_s=0.2)  # slower than it is looked at
    source = wired(chip)
    wait_for_first(source)
    chip.fail_on_clear = 1
    held, seen = len(chip.measured), set()
    while len(chip.measured) < held + 3:
        seen.add(source.newest.range_mm)
        time.sleep(0.002)
    assert chip.uncleared
    assert len(seen) > 1
    assert not chip.uncleared & seen


def test_a_sensor_that_is_pulled_out_is_one_sentence(wired):
    chip = counting()
    source = wired(chip)
    wait_for_first(source)
    chip.gone = True
    until(lambda: source.failure is not None)
    assert "stopped answering" in source.failure
    assert source.failure.endswith(".")


def test_a_sensor_that_answers_but_measures_no_more_is_a_failure_too(wired):
    chip = counting()
    source = wired(chip)
    wait_for_first(source)
    chip.frozen = True
    until(lambda: source.failure is not None)
    assert "has not measured" in source.failure


def test_without_a_sensor_or_with_one_that_hangs_the_sentence_says_what_to_check(wired):
    absent = counting()
    absent.gone = True
    with pytest.raises(UnusableInput, match=r"No VL53L0X answers .*check its wiring"):
        wired(absent)
    hanging = counting()
    hanging.never_calibrates = True
    with pytest.raises(UnusableInput, match=r"No VL53L0X answers .*Timeout"):
        wired(hanging)


def test_another_chip_at_that_address_is_refused(wired):
    other = counting()
    other._pages[0][0xC0] = 0xEA  # a VL53L1X says so
    with pytest.raises(UnusableInput, match="expected ID register values"):
        wired(other)


@pytest.fixture
def gantry_with_sensor(monkeypatch):
    """A virtual gantry whose range comes over I²C: the chip measures what the plant reads."""
    with VirtualGantryProcess(RIG, seed=0) as gantry:
        plant = SocketRangeSource(gantry.range_socket)
        wait_for_first(plant)

        def range_mm(_):
            newest = plant.newest
            return NOTHING_IN_RANGE_MM if newest.status else round(newest.range_mm)

        chip = RegisterSensor(range_mm)
        # At a rig's port only an UNO may answer; here the sensor is what is tried.
        monkeypatch.setattr("runtime.run._may_be_virtual", lambda request: True)
        monkeypatch.setitem(sys.modules, "board", types.SimpleNamespace(I2C=lambda: chip))
        yield gantry, chip
        plant.close()


@pytest.mark.wallclock
def test_the_loop_flies_by_the_real_driver_and_logs_age_and_repeats(gantry_with_sensor, tmp_path):
    gantry, chip = gantry_with_sensor
    # One measurement in 50 ms for a tick in 31 ms: some ticks have to repeat.
    chip.period_s = 0.05
    log = tmp_path / "flight.mcap"
    tally = fly(RunRequest(RIG, 3.0, port=gantry.port, log=log))
    assert tally.ended == "whole"
    recorded = read_run_log(log)
    age_s, repeats = recorded["range_age_s"], recorded["range_repeats"]
    assert set(repeats) >= {0, 1}
    fresh = repeats == 0
    assert (age_s > 0.5e-6 * TIMING_BUDGET_US - 1e-5).all()
    # Within a run of repeats the sample only grows older, and all of the run is one reading.
    again = ~fresh[1:]
    assert (age_s[1:][again] > age_s[:-1][again]).all()
    assert (recorded["range_m"][1:][again] == recorded["range_m"][:-1][again]).all()


@pytest.mark.wallclock
def test_a_sensor_that_freezes_in_flight_ends_it_and_the_sentence_names_it(
    gantry_with_sensor, tmp_path
):
    gantry, chip = gantry_with_sensor
    log = tmp_path / "flight.mcap"

    def freeze(done_s, _):
        chip.frozen = done_s > 2.2

    with pytest.raises(CheckFailed, match=r"sensor_lost.*has not measured"):
        fly(RunRequest(RIG, 8.0, port=gantry.port, log=log, realtime=False), show=freeze)
    recorded = read_run_log(log)
    assert recorded["mode"][-1] == "FAILSAFE"
    assert recorded["sufferer_cmd_us"][-1] == RIG.limits.pulse_us[0]
