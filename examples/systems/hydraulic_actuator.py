"""A valve moves a robot's arm by oil: a linear model of the pressure. Missing: what valves do."""

from wakedeploy import Constant, Input, Output, Port, System

INF = float("inf")


class HydraulicActuator(System):
    """The actuator of Gunnarsson and Krus (1990), whose pressure follows its last three samples.

    Nobody states a sampling rate or a unit: a second here is a sample.
    """

    rate_hz = 1.0
    inputs = [Input("valve", "1")]
    states = {"pressure": "1", "pressure_1": "1", "pressure_2": "1", "valve_1": "1", "valve_2": "1"}
    outputs = [Output("pressure", "1", noise=0.05)]
    constants = [
        Constant("a_1", 2.0, spread=INF),
        Constant("a_2", -1.6, spread=INF),
        Constant("a_3", 0.5, spread=INF),
        Constant("b_1", 0.5, spread=INF, low=-10.0, high=10.0),
        Constant("b_2", -0.1, spread=INF, low=-10.0, high=10.0),
        Constant("b_3", -0.1, spread=INF, low=-10.0, high=10.0),
    ]
    ports = [Port.input("valve"), Port.force("pressure"), Port.output("pressure")]

    def start(self, measured):
        p = measured.pressure
        return {"pressure_1": p, "pressure_2": p}

    def step(self, state, inputs, c):
        remembered = c.a_1 * state.pressure + c.a_2 * state.pressure_1 + c.a_3 * state.pressure_2
        driven = c.b_1 * inputs.valve + c.b_2 * state.valve_1 + c.b_3 * state.valve_2
        return {
            "pressure": remembered + driven,
            "pressure_1": state.pressure,
            "pressure_2": state.pressure_1,
            "valve_1": inputs.valve,
            "valve_2": state.valve_1,
        }
