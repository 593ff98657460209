"""Effects in the sensors: what the range sensor reads, and where the carriage really is."""

from wakedeploy.physics.effects.base import Effect, Motion, Number, Parameter, Setting, Values


class RangeBias(Effect):
    """A constant error of the range."""

    name = "range-bias"
    physics = "The range sensor reads too much or too little by a constant."
    equation = "r = z + bias_m"
    stage = "sensor"
    parameters = (
        Parameter("bias_m", "m", scale=0.015, low=-0.3, high=0.3, constant="range.bias_m"),
    )
    confused_with = ("thrust-coefficient", "range-scale")
    split_by = "three seconds at rest on the stop"
    shows_in = ("second-range",)


class RangeScale(Effect):
    """A gain error of the range."""

    name = "range-scale"
    physics = "The range sensor reads a constant multiple of the range."
    equation = "r = scale · z"
    stage = "sensor"
    parameters = (Parameter("scale", "1", scale=0.02, low=0.7, high=1.3, constant="range.scale"),)
    confused_with = ("added-mass", "thrust-coefficient", "range-bias")
    split_by = "a gauge block at one known height"
    shows_in = ("second-range",)


class RangeDrift(Effect):
    """An error that grows with time."""

    name = "range-drift"
    physics = "The range sensor warms up in flight and its reading drifts with time."
    equation = "r′ = r + drift_mps · t"
    stage = "sensor"
    parameters = (Parameter("drift_mps", "m/s", scale=0.0007, low=-0.02, high=0.02),)
    confused_with = ("battery-sag", "range-bias")
    split_by = "the rest on the stop before and after the flight"
    shows_in = ("second-range",)

    def range_m(self, p: Values, range_m: Number, m: Motion, s: Setting) -> Number:
        """The range [m] plus what has drifted since take-off."""
        return range_m + p["drift_mps"] * m.time_s


class RangeDelay(Effect):
    """Readings older than their time stamps."""

    name = "range-delay"
    physics = "The range sensor's readings are older than their time stamps say."
    equation = "r(t) = z(t − delay_s)"
    stage = "sensor"
    parameters = (
        Parameter("delay_s", "s", scale=0.01, low=0.0, high=0.1, constant="range.delay_s"),
    )
    confused_with = ("command-latency", "sample-and-hold")
    split_by = "fast sines of the height"
    shows_in = ("second-range",)


class SampleAndHold(Effect):
    """A sensor that repeats itself."""

    name = "sample-and-hold"
    physics = (
        "The range sensor makes a reading only so often, by a clock of its own, and repeats it in "
        "between under time stamps that go on."
    )
    equation = "r′(t) = r(t_k) from t_k = t_0 + k · hold_s on, for hold_s"
    stage = "sensor"
    parameters = (
        Parameter(
            "hold_s",
            "s",
            scale=0.03,
            low=0.0,
            high=0.3,
            constant="range.hold_s",
            starts=(1.0, 2.0, 3.0),
        ),
    )
    confused_with = ("range-delay",)
    split_by = "fast sines of the height, and readings that are equal to the last digit"
    shows_in = ("second-range",)


class LostSteps(Effect):
    """A carriage that is not where its steps say."""

    name = "lost-steps"
    physics = (
        "The carriage loses steps in one direction: its error grows with all the way, there and "
        "back."
    )
    equation = "x_w = lost_per_m · L"
    stage = "sensor"
    parameters = (Parameter("lost_per_m", "1", scale=0.01, low=-0.2, high=0.2),)
    confused_with = ("crosswind-offset",)
    split_by = "homing the carriage after the flight, or passes early and late"
    shows_in = ("carriage-position",)

    def wake_offset_m(self, p: Values, m: Motion, s: Setting) -> Number:
        """An offset [m] that grows with the carriage's way."""
        return p["lost_per_m"] * m.travelled_m


class BeltBacklash(Effect):
    """Play in the carriage's belt."""

    name = "belt-backlash"
    physics = (
        "The carriage stays while its drive takes up the belt's play, then trails it by half of it."
    )
    equation = "x_c′ = min(max(x_c, x − backlash_m / 2), x + backlash_m / 2)"
    stage = "sensor"
    parameters = (Parameter("backlash_m", "m", scale=0.01, low=0.0, high=0.2),)
    confused_with = ("wake-deflection",)
    split_by = "carriage passes in both directions at two speeds"
    shows_in = ("carriage-position",)

    def carriage_m(self, p: Values, drive_m: float, before_m: float) -> float:
        """The place [m] of before, moved no farther than either end of the play asks."""
        half_m = 0.5 * p["backlash_m"]
        return min(max(before_m, drive_m - half_m), drive_m + half_m)


EFFECTS: tuple[Effect, ...] = (
    RangeBias(),
    RangeScale(),
    RangeDrift(),
    RangeDelay(),
    SampleAndHold(),
    LostSteps(),
    BeltBacklash(),
)
