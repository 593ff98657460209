"""A servo that holds an angle, as its maker states it: spring and damper of unit inertia."""

from typing import ClassVar

from wakedeploy import Constant, Input, Output, Port, System

RATE_HZ, STIFF, DAMPED = 50.0, 400.0, 30.0


class Servo(System):
    """Its angle follows the command."""

    rate_hz = RATE_HZ
    inputs: ClassVar = [Input("command_rad", "rad")]
    states: ClassVar = {"angle_rad": "rad", "speed_radps": "rad/s"}
    outputs: ClassVar = [Output("angle_rad", "rad", noise=5e-4)]
    constants: ClassVar = [Constant("stiff", STIFF, 20.0), Constant("damped", DAMPED, 2.0)]
    ports: ClassVar = [
        Port.input("command_rad"),
        Port.force("speed_radps", position="angle_rad"),
        Port.output("angle_rad"),
    ]

    def derivative(self, state, inputs, c):
        pull = c.stiff * (inputs.command_rad - state.angle_rad) - c.damped * state.speed_radps
        return {"angle_rad": state.speed_radps, "speed_radps": pull}
