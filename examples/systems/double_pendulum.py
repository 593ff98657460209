"""Two links, two motors: M(q) q'' + C(q, q') q' + G(q) = τ. What is missing is friction."""

import numpy as np

from wakedeploy import Constant, Input, Output, Port, System

INF = float("inf")


class DoublePendulum(System):
    """The double pendulum of the DFKI, design A.0, without friction in its joints."""

    rate_hz = 100.0
    inputs = [Input("torque_1_nm", "N m"), Input("torque_2_nm", "N m")]
    states = {
        "angle_1_rad": "rad",
        "angle_2_rad": "rad",
        "speed_1_radps": "rad/s",
        "speed_2_radps": "rad/s",
    }
    outputs = [Output("angle_1_rad", "rad", noise=1e-3), Output("angle_2_rad", "rad", noise=1e-3)]
    constants = [
        Constant("inertia_1_kgm2", 0.13, spread=INF),
        Constant("inertia_2_kgm2", 0.03, spread=INF),
        Constant("between_kgm2", 0.03, spread=INF),
        Constant("weight_1_nm", 3.5, spread=INF, unit="N m"),
        Constant("weight_2_nm", 1.2, spread=INF, unit="N m"),
    ]
    ports = [
        Port.input("torque_1_nm"),
        Port.input("torque_2_nm"),
        Port.force("speed_1_radps", inertia="inertia_1_kgm2", position="angle_1_rad"),
        Port.force("speed_2_radps", inertia="inertia_2_kgm2", position="angle_2_rad"),
    ]

    def derivative(self, state, inputs, c):
        return self.derivative_under(state, inputs, c, {})

    def derivative_under(self, state, inputs, c, forces):
        """A torque at one joint moves both."""
        cosine, sine = np.cos(state.angle_2_rad), np.sin(state.angle_2_rad)
        m22 = c.inertia_2_kgm2
        m12 = m22 + c.between_kgm2 * cosine
        m11 = c.inertia_1_kgm2 + m22 + 2.0 * c.between_kgm2 * cosine
        turning = c.between_kgm2 * sine
        lower = c.weight_2_nm * np.sin(state.angle_1_rad + state.angle_2_rad)
        first = inputs.torque_1_nm + forces.get("speed_1_radps", 0.0)
        first = first - c.weight_1_nm * np.sin(state.angle_1_rad) - lower
        first = first + turning * state.speed_2_radps * (
            2.0 * state.speed_1_radps + state.speed_2_radps
        )
        second = inputs.torque_2_nm + forces.get("speed_2_radps", 0.0)
        second = second - lower - turning * state.speed_1_radps**2
        share = m11 * m22 - m12**2
        return {
            "angle_1_rad": state.speed_1_radps,
            "angle_2_rad": state.speed_2_radps,
            "speed_1_radps": (m22 * first - m12 * second) / share,
            "speed_2_radps": (m11 * second - m12 * first) / share,
        }
