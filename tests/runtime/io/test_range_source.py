"""The I²C form with a sensor that the test plays."""

import os
import subprocess
import sys
import time
import types

import pytest

from runtime.io.range_source import I2cRangeSource, wait_for_first
from wakedeploy.core.errors import UnusableInput


class FakeSensor:
    """A VL53L0X in continuous mode: `data_ready` meets the next reading or error."""

    def __init__(self, readings):
        self.readings = list(readings)
        self.measurement_timing_budget = 0
        self.running = False

    def start_continuous(self):
        self.running = True

    def stop_continuous(self):
        self.running = False

    @property
    def data_ready(self):
        if not self.readings:
            return False
        if isinstance(self.readings[0], Exception):
            raise self.readings.pop(0)
        return True

    @property
    def range(self):
        return self.readings.pop(0)


def until(condition, limit_s=5.0):
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, "it never happened"
        time.sleep(0.002)


def test_samples_are_taken_as_they_come_and_dated_to_the_middle_of_the_measurement():
    sensor = FakeSensor([412])
    source = I2cRangeSource(sensor)
    first = wait_for_first(source)
    assert first.range_m == pytest.approx(0.412)
    assert time.monotonic() - first.sensor_time_s >= 0.010
    assert sensor.measurement_timing_budget == 20_000
    source.close()
    assert not sensor.running


def test_no_target_is_a_missing_sample_and_a_hiccup_of_the_bus_is_survived():
    # What is ready after an error may be an older measurement: the 250 is not kept.
    errors = [OSError("no ack"), RuntimeError("late")]
    source = I2cRangeSource(FakeSensor([*errors, 250, 8190, 300]))
    until(lambda: source.newest is not None)
    assert source.newest.range_mm != 250
    until(lambda: source.newest.range_mm == 300)
    assert source.failure is None
    source.close()


def test_a_sensor_that_stops_answering_is_one_sentence():
    source = I2cRangeSource(FakeSensor([OSError(121, "Remote I/O error")] * 40))
    with pytest.raises(UnusableInput, match="stopped answering"):
        wait_for_first(source)
    source.close()


def test_without_the_driver_the_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "adafruit_vl53l0x", None)
    with pytest.raises(UnusableInput, match=r"pip install .*rig"):
        I2cRangeSource()


def on_a_pi_5(code, tmp_path, *, gpiod):
    """Some Python with the real Blinka, which is told that it runs on a Raspberry Pi 5."""
    if not gpiod:
        (tmp_path / "gpiod.py").write_text("raise ModuleNotFoundError('none', name='gpiod')")
    environment = os.environ | {"BLINKA_FORCEBOARD": "RASPBERRY_PI_5"}
    paths = f"import sys; sys.path[:] = {[str(tmp_path), *sys.path]!r}\n"
    return subprocess.run(
        [sys.executable, "-c", paths + code], env=environment, capture_output=True, text=True
    )  # fmt: skip


def test_on_a_pi_5_the_driver_needs_gpiod_and_says_so(tmp_path):
    code = "from runtime.io.range_source import I2cRangeSource; I2cRangeSource()"
    ended = on_a_pi_5(code, tmp_path, gpiod=False)
    last = ended.stderr.splitlines()[-1]
    assert last.startswith("wakedeploy.core.errors.UnusableInput"), ended.stderr
    assert "'gpiod' was not found" in last
    assert "-m pip install --constraint constraints.txt '.[rig]' (in wakedeploy's checkout)" in last


def test_on_a_pi_5_the_driver_loads_with_what_rig_installs(tmp_path):
    pytest.importorskip("gpiod")
    code = "from runtime.io.range_source import import_driver; print(import_driver()[1].board_id)"
    ended = on_a_pi_5(code, tmp_path, gpiod=True)
    assert ended.stdout.strip() == "RASPBERRY_PI_5", ended.stderr


def test_a_computer_without_known_pins_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "adafruit_vl53l0x", types.SimpleNamespace())
    monkeypatch.setitem(sys.modules, "board", types.SimpleNamespace())
    with pytest.raises(UnusableInput, match="no I²C pins"):
        I2cRangeSource()


def test_an_empty_bus_says_to_check_the_wiring(monkeypatch):
    def nobody(_, io_timeout_s):
        raise ValueError("No I2C device at address: 0x29")

    monkeypatch.setitem(sys.modules, "adafruit_vl53l0x", types.SimpleNamespace(VL53L0X=nobody))
    monkeypatch.setitem(sys.modules, "board", types.SimpleNamespace(I2C=lambda: None))
    with pytest.raises(UnusableInput, match="No VL53L0X answers"):
        I2cRangeSource()
