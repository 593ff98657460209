"""A motor drives a carriage along a rail: M a = k u. What is missing is friction."""

from wakedeploy import Constant, Input, Output, Port, System


class Emps(System):
    """The positioning system of Janot, Gautier and Brunot (2019), without its friction."""

    rate_hz = 250.0
    inputs = [Input("voltage_v", "V")]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-5)]
    constants = [Constant("mass_kg", 95.0, spread=5.0), Constant("gain_n_per_v", 35.15)]
    ports = [
        Port.input("voltage_v"),
        Port.force("speed_mps", inertia="mass_kg", position="position_m"),
        Port.output("position_m"),
    ]

    def derivative(self, state, inputs, c):
        return {
            "position_m": state.speed_mps,
            "speed_mps": c.gain_n_per_v * inputs.voltage_v / c.mass_kg,
        }
