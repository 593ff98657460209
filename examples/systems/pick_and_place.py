"""A mounting head hangs on a spring: y'' = b u − d y' − k y. Missing: impact and dry friction."""

from wakedeploy import Constant, Input, Output, Port, System


class PickAndPlace(System):
    """The placement machine of Juloski, Heemels and Ferrari-Trecate (2004), never in contact."""

    rate_hz = 400.0
    inputs = [Input("motor_v", "V")]
    states = {"height": "1", "speed_per_s": "1/s"}
    outputs = [Output("height", "1", noise=0.01)]
    constants = [
        Constant("stiffness", 900.0, spread=float("inf")),
        Constant("damping", 40.0, spread=float("inf")),
        Constant("gain", -2e5, spread=float("inf")),
        Constant("rest", 0.0, spread=1e4),
    ]
    ports = [
        Port.input("motor_v"),
        Port.force("speed_per_s", position="height"),
        Port.output("height"),
    ]

    def derivative(self, state, inputs, c):
        pull = c.gain * inputs.motor_v - c.stiffness * state.height + c.rest
        return {
            "height": state.speed_per_s,
            "speed_per_s": pull - c.damping * state.speed_per_s,
        }
