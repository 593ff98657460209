"""A small drone below two others: m v' = sum of its rotors' thrust − m g. Missing: their wakes."""

import numpy as np

from wakedeploy import Constant, Input, Output, Port, System

MASS_KG = 0.032


def downwash(t, state, inputs, p):
    """The jets of the drones that are above, each a Gaussian about its axis."""
    blown = 0.0 * state.height_m
    for x_m, y_m, z_m in (
        (inputs.first_x_m, inputs.first_y_m, inputs.first_z_m),
        (inputs.second_x_m, inputs.second_y_m, inputs.second_z_m),
    ):
        aside_m2 = (x_m - inputs.x_m) ** 2 + (y_m - inputs.y_m) ** 2
        blown = blown + (z_m > state.height_m) * np.exp(-aside_m2 / p.width_m**2)
    return {"climb_mps": -p.strength_n * blown / MASS_KG}


class ThreeDrones(System):
    """The lowest of three Crazyflies that change places, as if it flew alone (Neural-Swarm)."""

    rate_hz = 50.0
    inputs = [
        *(Input(f"thrust_{i}_n", "N") for i in range(1, 5)),
        *(Input(name, "m", is_commanded=False) for name in ("x_m", "y_m")),
        *(
            Input(f"{who}_{axis}_m", "m", is_commanded=False)
            for who in ("first", "second")
            for axis in "xyz"
        ),
    ]
    states = {"height_m": "m", "climb_mps": "m/s"}
    outputs = [Output("height_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", MASS_KG, spread=0.001), Constant("gravity_mps2", 9.81)]
    ports = [
        Port.force("climb_mps", inertia="mass_kg", position="height_m", height="height_m"),
        Port.output("height_m"),
        Port.custom("downwash", downwash, {"strength_n": ("N", 0.1)}, {"width_m": ("m", 0.1)}),
    ]

    def derivative(self, state, inputs, c):
        thrust = inputs.thrust_1_n + inputs.thrust_2_n + inputs.thrust_3_n + inputs.thrust_4_n
        return {
            "height_m": state.climb_mps,
            "climb_mps": thrust / c.mass_kg - c.gravity_mps2,
        }
