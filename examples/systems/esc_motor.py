"""A motor controller's duty turns a propeller: speed' = b u − d speed. Missing: the air's drag."""

from wakedeploy import Constant, Input, Output, Port, System


class EscMotor(System):
    """A brushless motor on a stand, as if its load grew in proportion to its speed."""

    rate_hz = 50.0
    inputs = [Input("duty_percent", "%")]
    states = {"speed_rpm": "rpm"}
    outputs = [Output("speed_rpm", "rpm", noise=30.0)]
    constants = [
        Constant("gain", 2000.0, spread=float("inf"), unit="rpm/s"),
        Constant("slowing_per_s", 20.0, spread=float("inf")),
    ]
    ports = [
        Port.input("duty_percent"),
        Port.force("speed_rpm"),
        Port.output("speed_rpm"),
    ]

    def derivative(self, state, inputs, c):
        return {"speed_rpm": c.gain * inputs.duty_percent - c.slowing_per_s * state.speed_rpm}
