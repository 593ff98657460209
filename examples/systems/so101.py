"""A joint of a small arm follows its command: a servo of second order, which acts at once."""

from wakedeploy import Constant, Input, Output, Port, System


class So101(System):
    """One joint of the SO-101 (Feetech STS3215), without dead time, play, friction and weight."""

    rate_hz = 50.0
    inputs = [Input("command_rad", "rad")]
    states = {"angle_rad": "rad", "speed_radps": "rad/s"}
    outputs = [Output("angle_rad", "rad", noise=1e-3)]
    constants = [
        Constant("stiffness_per_s2", 400.0, spread=float("inf")),
        Constant("damping_per_s", 40.0, spread=float("inf")),
    ]
    ports = [
        Port.input("command_rad"),
        Port.force("speed_radps", position="angle_rad"),
        Port.output("angle_rad"),
    ]

    def derivative(self, state, inputs, c):
        pull = c.stiffness_per_s2 * (inputs.command_rad - state.angle_rad)
        return {
            "angle_rad": state.speed_radps,
            "speed_radps": pull - c.damping_per_s * state.speed_radps,
        }
