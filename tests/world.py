"""Plant and board in one process and in simulated time, behind the frames of the wire."""

import math

import numpy as np

from runtime.io.conversation import HELLO_PERIOD_S, REBOOT_LIMIT_S, Answer
from runtime.io.protocol import Disarm, Frame, FrameDecoder, Hello, HelloReply, Status, encode_frame
from runtime.io.range_source import RangeReading
from runtime.reference import FlightPlan
from runtime.virtual.mcu_port import McuPort
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.25})


def resting_plan(ticks):
    """Motors off."""
    nothing = np.zeros(ticks)
    return FlightPlan(nothing, nothing, nothing, motors_off=True)


class World:
    """Plant and MCU, brought up to the present whenever someone looks; link and sensor in one."""

    def __init__(self, rig=RIG, port=None, boot_s=0.0, **hooks):
        self.now_s = 1000.0
        self.plant, self.port = GantryPlant(rig, seed=1, **hooks), port or McuPort(rig, boot_s=0.0)
        self.later = []  # what happens at which time [s]
        self.decoder, self.sequence, self.sent_s = FrameDecoder(), 0, {}
        self.failure = None
        self.muted = False
        self.commands = []
        self._answer, self._newest, self._reply = None, RangeReading(0.0, 0), None
        self.origin_s = self.now_s
        self.port.opened(0.0)
        self.sleep(boot_s + 0.02)
        self._send(Hello())
        self.sleep(0.02)

    # What Loop asks of a clock …
    def monotonic(self):
        self.now_s += 1e-5  # nothing takes no time
        return self.now_s

    def sleep(self, seconds):
        self.now_s += seconds
        self.present()

    def present(self):
        plant = self.plant
        while plant.t_s <= self.now_s - self.origin_s:
            while self.later and self.later[0][0] <= plant.t_s + self.origin_s:
                self.later.pop(0)[1]()
            for frame in self.decoder.feed(self.port.answer(plant.t_s, plant)):
                self._hear(frame)
            out = self.port.advance(plant.t_s, plant.dt_s)
            plant.step(out.source_us, out.sufferer_us, out.carriage_mps)
            sample = plant.range_sample()
            if math.isfinite(sample.range_m):
                taken_us = int((self.origin_s + sample.sensor_time_s) * 1e6)
                truth = (plant.wake_force_n, plant.hook_force_n, plant.z_m)
                self._newest = RangeReading(1e3 * sample.range_m, taken_us, 0, *truth)

    @property
    def unanswered_since_s(self):
        newest = self._answer.status.sequence if self._answer else 0
        return min((s for n, s in self.sent_s.items() if n > newest), default=None)

    def _hear(self, frame):
        if isinstance(frame.message, HelloReply):
            self._reply = frame.message
        if isinstance(frame.message, Status):
            now_s = self.now_s
            trip_s = now_s - self.sent_s[frame.sequence]
            self._answer = Answer(frame.message, frame.time_us, now_s, trip_s)

    def _send(self, message):
        self.sequence += 1
        self.sent_s[self.sequence] = self.now_s
        frame = encode_frame(Frame(self.sequence, 0, message))
        self.port.receive(self.now_s - self.origin_s, frame)
        return self.sequence

    # … of a link …
    @property
    def answer(self):
        self.present()
        return self._answer

    def arm(self, limits):
        self._send(limits)
        self.sleep(0.03)
        self.started_s = self.now_s
        return self.answer.status

    def send(self, command):
        self.present()
        self.commands.append(command)
        if self.muted:
            self.sequence += 1
            self.sent_s[self.sequence] = self.now_s
            return self.sequence
        return self._send(command)

    def disarm(self):
        self.disarmed = True

    def greet_again(self):
        self._reply, end_s = None, self.now_s + REBOOT_LIMIT_S
        while self._reply is None and self.now_s < end_s:
            if not self.muted:
                self._send(Hello())
            self.sleep(HELLO_PERIOD_S)
        if self._reply is None:
            return None
        self._send(Disarm())
        self.sleep(0.03)
        return self.answer.status

    # … and of a range source.
    @property
    def newest(self):
        self.present()
        return self._newest
