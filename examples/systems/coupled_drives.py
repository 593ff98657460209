"""Two motors move a belt over a sprung pulley. What is missing is the motors' lag."""

import numpy as np

from wakedeploy import Constant, Input, Output, Port, System


class CoupledDrives(System):
    """The drives of Wigren and Schoukens (2017): a resonance alone; the sensor shows |speed|."""

    rate_hz = 50.0
    inputs = [Input("drive_v", "V")]
    states = {"speed_v": "V", "slope_v_per_s": "V/s"}
    outputs = [Output("reading_v", "V", noise=0.03)]
    constants = [
        Constant("stiffness", 60.0, spread=float("inf")),
        Constant("damping", 5.0, spread=float("inf")),
        Constant("gain", 2.0, spread=float("inf")),
    ]
    ports = [
        Port.input("drive_v"),
        Port.force("slope_v_per_s", position="speed_v"),
        Port.output("reading_v"),
    ]

    def start(self, measured):
        return {"speed_v": measured.reading_v}

    def derivative(self, state, inputs, c):
        pull = c.gain * inputs.drive_v - state.speed_v
        return {
            "speed_v": state.slope_v_per_s,
            "slope_v_per_s": c.stiffness * pull - c.damping * state.slope_v_per_s,
        }

    def measure(self, state, inputs, c):
        return {"reading_v": np.abs(state.speed_v)}
