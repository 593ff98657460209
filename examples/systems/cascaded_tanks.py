"""A pump fills a tank that drains into a second one. What is missing is the overflow."""

import numpy as np

from wakedeploy import Constant, Input, Output, Port, System


class CascadedTanks(System):
    """The tanks of Schoukens, Mattsson, Wigren and Noël (2016); levels in volts of the sensor."""

    rate_hz = 0.25
    inputs = [Input("pump_v", "V")]
    states = {"upper_v": "V", "level_v": "V"}
    outputs = [Output("level_v", "V", noise=0.03)]
    constants = [
        Constant("inflow_per_s", 0.05, spread=float("inf")),
        Constant("between", 0.08, spread=float("inf")),
        Constant("outflow", 0.08, spread=float("inf")),
    ]
    ports = [
        Port.force("upper_v", position="upper_v"),
        Port.force("level_v", position="level_v"),
        Port.input("pump_v"),
        Port.output("level_v"),
    ]

    def start(self, measured):
        return {"upper_v": measured.level_v}

    def derivative(self, state, inputs, c):
        upper, lower = (np.sqrt(np.maximum(x, 1e-3)) for x in (state.upper_v, state.level_v))
        return {
            "upper_v": c.inflow_per_s * inputs.pump_v - c.between * upper,
            "level_v": c.between * upper - c.outflow * lower,
        }
