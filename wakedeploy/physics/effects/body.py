"""Effects on the sufferer's inertia."""

from wakedeploy.physics.effects.base import Effect, Motion, Number, Parameter, Setting, Values


class AddedMass(Effect):
    """What moves along without being weighed."""

    name = "added-mass"
    physics = "Air, counterweights or pulleys move along: inertia grows, weight does not."
    equation = "m′ = m + mass_kg"
    stage = "body"
    parameters = (Parameter("mass_kg", "kg", scale=0.03, low=0.0, high=1.0),)
    confused_with = ("thrust-exponent", "range-scale", "spool-lag-sufferer")
    split_by = "fast sines of the height"

    def added_mass_kg(self, p: Values, m: Motion, s: Setting) -> Number:
        """The same mass [kg] always."""
        return p["mass_kg"]


EFFECTS: tuple[Effect, ...] = (AddedMass(),)
