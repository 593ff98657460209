"""A motor turns a pendulum: I θ'' = τ − m g l sin θ. What is missing is friction."""

import numpy as np

from wakedeploy import Constant, Input, Output, Port, System


class Pendulum(System):
    """The torque-limited simple pendulum of the DFKI, without its friction."""

    rate_hz = 200.0
    inputs = [Input("torque_nm", "N m")]
    states = {"angle_rad": "rad", "speed_radps": "rad/s"}
    outputs = [Output("angle_rad", "rad", noise=1e-3)]
    constants = [
        Constant("inertia_kgm2", 0.17, spread=0.03),
        Constant("weight_nm", 3.3, spread=0.3, unit="N m"),
    ]
    ports = [
        Port.input("torque_nm"),
        Port.force("speed_radps", inertia="inertia_kgm2", position="angle_rad"),
        Port.output("angle_rad"),
    ]

    def derivative(self, state, inputs, c):
        torque = inputs.torque_nm - c.weight_nm * np.sin(state.angle_rad)
        return {"angle_rad": state.speed_radps, "speed_radps": torque / c.inertia_kgm2}
