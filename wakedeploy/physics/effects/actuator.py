"""Effects in motors and propellers: from the accepted pulse to the thrust."""

import numpy as np

from wakedeploy.physics.effects.base import Effect, Motion, Number, Parameter, Setting, Values

# What the loop's delays are beyond the calibrated ones, and how a step of the plant is cut, are a
# few milliseconds, always to one side: they pass for as much lag.
_FINEST_LAG_S = 0.003


def _lag(name: str, constant: str) -> Parameter:
    """A rotor's lag one way."""
    return Parameter(
        name, "s", scale=0.05, low=0.0, high=1.0, constant=constant, finest=_FINEST_LAG_S
    )


class SpoolLagSufferer(Effect):
    """The sufferer's rotor inertia."""

    name = "spool-lag-sufferer"
    physics = "The sufferer's rotor speed follows its command with a first-order lag."
    equation = "d√T / dt = (√T_c − √T) / up_s, or / down_s where T_c < T"
    stage = "actuator"
    parameters = (
        _lag("up_s", "spool.sufferer.up_s"),
        _lag("down_s", "spool.sufferer.down_s"),
    )
    confused_with = ("command-latency", "added-mass")
    split_by = "thrust steps up and down: a dead time shifts the response, a lag bends it"
    shows_in = ("sufferer-speed",)


class SpoolLagSource(Effect):
    """The wake source's rotor inertia."""

    name = "spool-lag-source"
    physics = "The wake source's rotor speed follows its command with a first-order lag."
    equation = "d√T_s / dt = (√T_c − √T_s) / up_s, or / down_s where T_c < T_s"
    stage = "actuator"
    parameters = (
        _lag("up_s", "spool.source.up_s"),
        _lag("down_s", "spool.source.down_s"),
    )
    confused_with = ("transport-speed", "transport-speed-exponent")
    split_by = "source steps at two separations: only a transport delay grows with the way"
    shows_in = ("source-speed",)


class ThrustCoefficient(Effect):
    """All thrust of the sufferer scaled."""

    name = "thrust-coefficient"
    physics = (
        "The sufferer's thrust is a constant multiple of its calibrated curve; a mass that is off "
        "looks alike."
    )
    equation = "T′ = scale · T"
    stage = "actuator"
    parameters = (
        Parameter("scale", "1", scale=0.08, low=0.5, high=1.5, constant="thrust.sufferer.scale"),
    )
    confused_with = ("thrust-exponent", "battery-sag")
    split_by = "hover at several heights, and the pulse at which the sufferer leaves its stop"


class ThrustExponent(Effect):
    """The sufferer's thrust curve bent about hover."""

    name = "thrust-exponent"
    physics = "The sufferer's thrust curve is steeper or flatter than calibrated, hover unchanged."
    equation = "T′ = W · (T / W)^exponent"
    stage = "actuator"
    parameters = (
        Parameter(
            "exponent", "1", scale=0.1, low=0.5, high=1.5, constant="thrust.sufferer.exponent"
        ),
    )
    confused_with = ("thrust-coefficient", "added-mass")
    split_by = "large thrust steps about hover"


class SourceThrustExponent(Effect):
    """The source's thrust curve bent."""

    name = "source-thrust-exponent"
    physics = "The wake source's thrust curve is steeper or flatter than calibrated."
    equation = "T_s′ = W · (T_s / W)^exponent"
    stage = "actuator"
    parameters = (
        Parameter("exponent", "1", scale=0.1, low=0.5, high=1.5, constant="thrust.source.exponent"),
    )
    confused_with = ("wake-strength", "transport-speed-exponent")
    split_by = "the source at three or more levels above a hovering sufferer"


class BatterySag(Effect):
    """A battery that weakens with the charge drawn."""

    name = "battery-sag"
    physics = "The sufferer's thrust fades with the charge drawn from its battery."
    equation = "T′ = T · exp(−sag_per_s · q)"
    stage = "actuator"
    parameters = (Parameter("sag_per_s", "1/s", scale=0.003, low=0.0, high=0.03),)
    confused_with = ("thrust-coefficient", "range-drift")
    split_by = "the battery's voltage, or two hovers at one height with a long time between them"
    shows_in = ("battery-voltage", "sufferer-speed")

    def sufferer_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """Thrust [N], smaller by `sag_per_s` for each second of hovering so far."""
        return m.sufferer_n * np.exp(-p["sag_per_s"] * m.charge_s)


class AxialInflowLoss(Effect):
    """A climbing rotor meets its air at a smaller angle."""

    name = "axial-inflow-loss"
    physics = "The sufferer's thrust falls with its own speed of climb, and grows in descent."
    equation = "T′ = T · exp(−loss_s_per_m · v_z)"
    stage = "actuator"
    parameters = (Parameter("loss_s_per_m", "s/m", scale=0.05, low=0.0, high=0.5),)
    confused_with = ("viscous-friction", "wake-inflow-loss")
    split_by = "the same climb at two levels of thrust, as with and without the wake"

    def sufferer_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """Thrust [N], smaller by `loss_s_per_m` for each m/s of climb."""
        return m.sufferer_n * np.exp(-p["loss_s_per_m"] * m.vz_mps)


class WakeInflowLoss(Effect):
    """The wake's air through the sufferer's rotor."""

    name = "wake-inflow-loss"
    physics = "Air that the wake blows down through the sufferer's rotor cuts its thrust."
    equation = "T′ = T · exp(loss_s_per_m · w)"
    stage = "actuator"
    parameters = (Parameter("loss_s_per_m", "s/m", scale=0.02, low=0.0, high=0.3),)
    confused_with = ("wake-strength", "source-thrust-exponent", "wake-width")
    split_by = "the same wake at two levels of the sufferer's thrust, one of them idle"

    def sufferer_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """Thrust [N], smaller by `loss_s_per_m` for each m/s of downwash."""
        return m.sufferer_n * np.exp(p["loss_s_per_m"] * m.wake_mps)


EFFECTS: tuple[Effect, ...] = (
    SpoolLagSufferer(),
    SpoolLagSource(),
    ThrustCoefficient(),
    ThrustExponent(),
    SourceThrustExponent(),
    BatterySag(),
    AxialInflowLoss(),
    WakeInflowLoss(),
)
