"""A robot of two alike wheels: what both lack is found on both, and what it is no other kind."""

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel

WHEELS = ("left", "right")
LATE_SAMPLES, BIAS_RADPS = 3, 0.03


class TwoWheels(System):
    """Each wheel's speed follows its command; a gyro sees them turn the robot."""

    rate_hz = 50.0
    inputs = [Input(f"{wheel}_command_radps", "rad/s") for wheel in WHEELS]
    states = {f"{wheel}_radps": "rad/s" for wheel in WHEELS}
    outputs = [
        *(Output(f"{wheel}_radps", "rad/s", noise=0.05) for wheel in WHEELS),
        Output("yaw_radps", "rad/s", noise=0.01),
    ]
    constants = [
        Constant("tau_s", 0.12, spread=0.01),
        Constant("radius_m", 0.05, spread=0.001),
        Constant("track_m", 0.3, spread=0.005),
    ]
    ports = [
        *(Port.input(f"{wheel}_command_radps") for wheel in WHEELS),
        *(Port.force(f"{wheel}_radps", unit="rad/s^2") for wheel in WHEELS),
        *(Port.output(name) for name in ("left_radps", "right_radps", "yaw_radps")),
    ]

    def derivative(self, state, inputs, c):
        return {
            "left_radps": (inputs.left_command_radps - state.left_radps) / c.tau_s,
            "right_radps": (inputs.right_command_radps - state.right_radps) / c.tau_s,
        }

    def measure(self, state, inputs, c):
        turning = c.radius_m / c.track_m * (state.right_radps - state.left_radps)
        return {n: getattr(state, n) for n in self.states} | {"yaw_radps": turning}


def _driven(seed):
    """A minute of it, the commands three samples late and the gyro biased, by exact steps."""
    random, samples = np.random.default_rng(seed), 3000
    times = np.arange(samples) / 50.0
    commands = np.zeros((2, samples))
    for command in commands:
        waves = zip(random.uniform(0.05, 0.8, 6), random.uniform(0.0, 2.0 * np.pi, 6), strict=True)
        command[:] = 4.0 + 3.3 * sum(np.sin(2.0 * np.pi * f * times + p) for f, p in waves)
    speeds, kept = np.zeros((2, samples)), np.exp(-0.02 / 0.118)
    for k in range(1, samples):
        late = commands[:, max(k - 1 - LATE_SAMPLES, 0)]
        speeds[:, k] = late + kept * (speeds[:, k - 1] - late)
    noise = random.standard_normal((3, samples)) * np.array([[0.05], [0.05], [0.01]])
    turning = 0.0502 / 0.302 * (speeds[1] - speeds[0]) + BIAS_RADPS
    columns = {f"{wheel}_command_radps": commands[i] for i, wheel in enumerate(WHEELS)}
    columns |= {f"{wheel}_radps": speeds[i] + noise[i] for i, wheel in enumerate(WHEELS)}
    return Recording(f"drive {seed}", times, columns | {"yaw_radps": turning + noise[2]})


@pytest.mark.slow
def test_a_dead_time_of_both_wheels_is_no_hold_of_one():
    """Gain, drift and hold of each promise more at first sight, and had filled the race."""
    model = LogModel(checked(TwoWheels()), [_driven(1), _driven(2)])
    found = named(model, fitted_base(model)).found
    assert set(found.hypothesis) == {
        "dead-time@left_command_radps",
        "dead-time@right_command_radps",
        "sensor-bias@yaw_radps",
    }
    sizes = dict(zip(found.names, found.theta, strict=True))
    clock_s = sizes["clock.left_command_radps"]
    for wheel in WHEELS:
        late_s = sizes[f"dead-time@{wheel}_command_radps.delay_s"] + clock_s
        assert late_s == pytest.approx(LATE_SAMPLES / 50.0, abs=0.002)
    assert sizes["sensor-bias@yaw_radps.bias"] == pytest.approx(BIAS_RADPS, abs=0.002)
