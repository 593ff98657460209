"""An electronic mass, damper and spring: m y'' + d y' + k y = u. What is missing hardens it."""

from wakedeploy import Constant, Input, Output, Port, System


class Silverbox(System):
    """The Silverbox of Wigren and Schoukens (2013), without its cubic spring."""

    rate_hz = 610.3515625
    steps = 2
    inputs = [Input("input_v", "V", hold="bandlimited")]
    states = {"output_v": "V", "slope_v_per_s": "V/s"}
    outputs = [Output("output_v", "V", noise=3e-4)]
    constants = [
        Constant("stiffness", 1.9e5, spread=float("inf")),
        Constant("damping", 50.0, spread=float("inf")),
        Constant("gain", 1e5, spread=float("inf")),
    ]
    ports = [
        Port.input("input_v"),
        Port.force("slope_v_per_s", position="output_v"),
        Port.output("output_v"),
    ]

    def derivative(self, state, inputs, c):
        force = c.gain * inputs.input_v - c.stiffness * state.output_v
        return {
            "output_v": state.slope_v_per_s,
            "slope_v_per_s": force - c.damping * state.slope_v_per_s,
        }
