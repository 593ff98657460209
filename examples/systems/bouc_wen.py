"""An oscillator is shaken: m y'' + c y' + k y = u. What is missing is its hysteretic force."""

from wakedeploy import Constant, Input, Output, Port, System


class BoucWen(System):
    """The simulated benchmark of Noël and Schoukens (2016), without the force that remembers."""

    rate_hz = 750.0
    steps = 2
    inputs = [Input("force_n", "N", hold="bandlimited")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-5)]
    constants = [
        Constant("mass_kg", 2.0, spread=0.05),
        Constant("damping", 10.0, spread=float("inf"), unit="N s/m"),
        Constant("stiffness", 5e4, spread=float("inf"), unit="N/m"),
    ]
    ports = [
        Port.input("force_n"),
        Port.force("speed_mps", inertia="mass_kg", position="position_m"),
        Port.output("position_m"),
    ]

    def derivative(self, state, inputs, c):
        force = inputs.force_n - c.damping * state.speed_mps - c.stiffness * state.position_m
        return {"position_m": state.speed_mps, "speed_mps": force / c.mass_kg}
