"""A small drone takes off and lands: m v' = sum of its rotors' thrust − m g. Missing: the floor."""

from wakedeploy import Constant, Input, Output, Port, System


class Takeoff(System):
    """A small Crazyflie of the Neural-Swarm flights, which nothing holds where it stands."""

    rate_hz = 50.0
    steps = 4
    inputs = [Input(f"thrust_{i}_n", "N") for i in range(1, 5)]
    states = {"height_m": "m", "climb_mps": "m/s"}
    outputs = [Output("height_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", 0.032, spread=0.001), Constant("gravity_mps2", 9.81)]
    ports = [
        Port.force("climb_mps", inertia="mass_kg", position="height_m", height="height_m"),
        Port.output("height_m"),
    ]

    def derivative(self, state, inputs, c):
        thrust = inputs.thrust_1_n + inputs.thrust_2_n + inputs.thrust_3_n + inputs.thrust_4_n
        return {
            "height_m": state.climb_mps,
            "climb_mps": thrust / c.mass_kg - c.gravity_mps2,
        }
