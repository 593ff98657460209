"""Effects in the wake: how its air is made, how it travels, widens, fades and is displaced."""

from wakedeploy.physics.effects.base import Effect, Motion, Number, Parameter, Setting, Values


class TransportSpeed(Effect):
    """How fast the wake sinks."""

    name = "transport-speed"
    physics = (
        "The wake sinks at another speed, so it arrives at another time and thins or piles up."
    )
    equation = "h = speed_mps · (T_s / T_ref)^n · τ"
    stage = "wake"
    parameters = (
        Parameter("speed_mps", "m/s", scale=1.5, low=0.5, high=40.0, constant="wake.speed_mps"),
    )
    confused_with = ("spool-lag-source", "transport-speed-exponent")
    split_by = "source steps at two separations: only a transport delay grows with the way"


class TransportSpeedExponent(Effect):
    """A strong wake that sinks faster than a weak one."""

    name = "transport-speed-exponent"
    physics = "The wake's speed goes with a power of the thrust that made it."
    equation = "h = w_a · (T_s / T_ref)^exponent · τ"
    stage = "wake"
    parameters = (
        Parameter("exponent", "1", scale=0.2, low=-1.0, high=1.0, constant="wake.speed_exponent"),
    )
    confused_with = ("source-thrust-exponent", "transport-speed", "spool-lag-source")
    split_by = "source steps between weak levels and between strong levels"


class WakeStrength(Effect):
    """The wake's injection, and with it the source's thrust scale."""

    name = "wake-strength"
    physics = (
        "The wake is stronger or weaker than modelled; strength and the scale of the source's "
        "thrust are one product that no flight can split."
    )
    equation = "a = strength · √(T_s / T_ref) · dt · exp(−λ · τ) · σ² / s²"
    stage = "wake"
    parameters = (
        Parameter("strength", "m/s^2", scale=100.0, low=0.0, high=1e4, constant="wake.strength"),
    )
    confused_with = ("wake-inflow-loss", "source-thrust-exponent", "wake-decay")
    split_by = "hover below the source at several of its levels and at several heights"


class WakeWidth(Effect):
    """The jet's width at the source."""

    name = "wake-width"
    physics = "The wake leaves the source wider or narrower than modelled."
    equation = "s² = width_m² + 2 · κ · τ"
    stage = "wake"
    parameters = (
        Parameter("width_m", "m", scale=0.02, low=0.02, high=1.0, constant="wake.width_m"),
    )
    confused_with = ("wake-spreading", "wake-strength")
    split_by = "carriage passes at two heights"


class WakeSpreading(Effect):
    """How fast the jet widens."""

    name = "wake-spreading"
    physics = "The wake widens faster or more slowly on its way down than modelled."
    equation = "s² = σ² + 2 · diffusivity_m2ps · τ"
    stage = "wake"
    parameters = (
        Parameter(
            "diffusivity_m2ps",
            "m^2/s",
            scale=0.03,
            low=0.0,
            high=1.0,
            constant="wake.diffusivity_m2ps",
        ),
    )
    confused_with = ("wake-width", "wake-decay")
    split_by = "carriage passes at two heights"


class WakeDecay(Effect):
    """How fast the wake dies out."""

    name = "wake-decay"
    physics = "The wake loses its speed on the way down faster or more slowly than modelled."
    equation = "a = S · √(T_s / T_ref) · dt · exp(−decay_per_s · τ) · σ² / s²"
    stage = "wake"
    parameters = (
        Parameter("decay_per_s", "1/s", scale=0.5, low=0.0, high=20.0, constant="wake.decay_per_s"),
    )
    confused_with = ("wake-strength", "wake-spreading")
    split_by = "hover in the jet's axis at several heights"


class CrosswindOffset(Effect):
    """A steady draught."""

    name = "crosswind-offset"
    physics = "A steady draught or a tilted source puts the wake's axis to one side."
    equation = "x_w = offset_m"
    stage = "wake"
    parameters = (Parameter("offset_m", "m", scale=0.04, low=-0.5, high=0.5),)
    confused_with = ("lost-steps", "wake-deflection")
    split_by = "carriage passes in both directions, early and late in the flight"

    def wake_offset_m(self, p: Values, m: Motion, s: Setting) -> Number:
        """The same offset [m] always."""
        return p["offset_m"]


class WakeDeflection(Effect):
    """Air dragged along by the carriage."""

    name = "wake-deflection"
    physics = "The moving carriage drags the wake along, in proportion to its speed."
    equation = "x_w = deflection_s · v_x"
    stage = "wake"
    parameters = (Parameter("deflection_s", "s", scale=0.05, low=-1.0, high=1.0),)
    confused_with = ("belt-backlash", "crosswind-offset")
    split_by = "carriage passes in both directions at two speeds"

    def wake_offset_m(self, p: Values, m: Motion, s: Setting) -> Number:
        """An offset [m] in the direction of the carriage's motion."""
        return p["deflection_s"] * m.vx_mps


EFFECTS: tuple[Effect, ...] = (
    TransportSpeed(),
    TransportSpeedExponent(),
    WakeStrength(),
    WakeWidth(),
    WakeSpreading(),
    WakeDecay(),
    CrosswindOffset(),
    WakeDeflection(),
)
