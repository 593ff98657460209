"""A flight from anywhere but the stop, or by a sensor that does not know it, is refused."""

import numpy as np
import pytest

from runtime.calibration.session import Site, resting
from runtime.calibration.steps_per_metre import driving
from runtime.io.range_source import STATUS_NO_TARGET, RangeReading, resting_range_m
from runtime.request import RunRequest
from runtime.run import fly
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.2})
BIASED = RIG.changed(range_sensor={"bias_m": 0.09})
SENTENCE = (
    r"^At rest the range sensor reads 0\.\d{3} m, and by the rig file it reads 0\.\d{3} m on the "
    r"stop: take away what the sufferer lies on, or else measure range_sensor\.bias_m with "
    r"wakedeploy calibrate zero\.$"
)


@pytest.mark.parametrize(
    ("rig", "plant"),
    [
        (RIG, {"plant_rig": BIASED}),  # a sensor that nobody calibrated
        (BIASED, {"plant_rig": RIG}),  # the rig file of another one
        (RIG, {"spacer_m": 0.08}),  # the sufferer left on its spacer
    ],
)
def test_a_virtual_flight_is_refused_before_anything_is_armed_or_recorded(tmp_path, rig, plant):
    log = tmp_path / "flight.mcap"
    with pytest.raises(UnusableInput, match=SENTENCE):
        fly(RunRequest(rig, 6.0, log=log, **plant))
    assert not log.exists()


def test_so_is_one_at_a_port():
    with VirtualGantryProcess(RIG, seed=0, spacer_m=0.3) as gantry:
        request = RunRequest(RIG, 6.0, port=gantry.port, range_socket=gantry.range_socket)
        with pytest.raises(UnusableInput, match=SENTENCE):
            fly(request)


@pytest.mark.parametrize(
    ("rig", "truth"),
    [(BIASED, BIASED), (RIG, RIG.changed(range_sensor={"bias_m": 0.03, "noise_m": 0.012}))],
)
def test_a_known_bias_and_one_of_some_centimetres_fly(tmp_path, rig, truth):
    log = tmp_path / "flight.mcap"
    fly(RunRequest(rig, 2.5, plant_rig=truth, log=log))
    assert read_run_log(log).flying.sum() > 60


@pytest.mark.parametrize("procedure", [lambda: resting(RIG, 1.0), lambda: driving(RIG, 0.1, 1.0)])
def test_what_keeps_the_motors_off_measures_all_the_same(tmp_path, procedure):
    site = Site(tmp_path, plant_rig=BIASED)
    log = site.flown("any", *procedure(), spacer_m=0.3)
    assert np.nanmedian(log["range_m"]) == pytest.approx(0.39, abs=0.01)
    assert set(log["sufferer_cmd_us"]) == {1000.0}


class Sensor:
    """A source whose newest sample is another one each time that it is looked at."""

    failure = None

    def __init__(self, samples):
        self._samples, self._count = samples, 0

    @property
    def newest(self):
        range_mm, status = self._samples[min(self._count, len(self._samples) - 1)]
        self._count += 1
        return RangeReading(range_mm, self._count, status)


def test_the_height_at_rest_is_a_median_that_strays_do_not_move():
    strays = [(40.0, 0), (900.0, 0), (8190.0, STATUS_NO_TARGET), (41.0, 0), (1200.0, 0)]
    assert resting_range_m(Sensor(strays + [(42.0, 0)] * 40)) == pytest.approx(0.042)


def test_a_sensor_that_says_one_thing_and_no_more_is_not_waited_for_for_ever():
    class Stuck(Sensor):
        newest = RangeReading(70.0, 5)

    assert resting_range_m(Stuck([]), limit_s=0.05) == pytest.approx(0.07)
