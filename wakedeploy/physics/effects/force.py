"""Effects that push or hold the sufferer: friction of its rail, the base below it, its tether."""

import numpy as np

from wakedeploy.physics.effects.base import Effect, Motion, Number, Parameter, Setting, Values

_SLACKENS_OVER_M = 0.01  # a tether becomes taut over this way, not at a point


class CoulombFriction(Effect):
    """Dry friction of the rail."""

    name = "coulomb-friction"
    physics = "The rail resists a motion with a constant force."
    equation = "F = −coulomb_n · sign(v_z)"
    stage = "force"
    parameters = (
        Parameter("coulomb_n", "N", scale=0.1, low=0.0, high=5.0, constant="rail.coulomb_n"),
    )
    confused_with = ("viscous-friction", "stiction")
    split_by = "slow and fast triangles of the height"


class ViscousFriction(Effect):
    """Lubricated friction of the rail."""

    name = "viscous-friction"
    physics = "The rail resists a motion in proportion to its speed."
    equation = "F = −viscous_n_per_mps · v_z"
    stage = "force"
    parameters = (
        Parameter(
            "viscous_n_per_mps",
            "N s/m",
            scale=0.2,
            low=0.0,
            high=10.0,
            constant="rail.viscous_n_per_mps",
        ),
    )
    confused_with = ("coulomb-friction", "axial-inflow-loss")
    split_by = "slow and fast triangles of the height"


class Stiction(Effect):
    """What it takes to start moving."""

    name = "stiction"
    physics = "The rail holds a resting sufferer until a threshold force breaks it loose."
    equation = "v_z = 0 until the forces exceed stiction_n (and coulomb_n)"
    stage = "force"
    parameters = (
        Parameter(
            "stiction_n",
            "N",
            scale=0.1,
            low=0.0,
            high=10.0,
            constant="rail.stiction_n",
            starts=(0.5, 2.0),
            finest=0.025,  # readings miss the moment of breaking loose, and laws differ there
        ),
    )
    confused_with = ("coulomb-friction", "pwm-dead-band")
    split_by = "very slow triangles of the height, at which the sufferer sticks and slips"


class GroundEffect(Effect):
    """More thrust close above the carriage base."""

    name = "ground-effect"
    physics = (
        "Close above the carriage base thrust rises; far from it with the inverse square of the "
        "height, as Cheeseman and Bennett found."
    )
    equation = "F = gain · T / (1 + (z / height_m)²)"
    stage = "force"
    parameters = (
        Parameter("gain", "1", scale=0.1, low=0.0, high=1.0),
        Parameter("height_m", "m", scale=0.05, low=0.02, high=0.6, neutral=0.1),
    )
    confused_with = ("recirculation", "tether-spring", "range-scale")
    split_by = "hover at several heights below 0.3 m"

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """A share of the thrust [N]: `gain` on the base, half of it at `height_m`."""
        return p["gain"] * m.sufferer_n / (1.0 + (m.z_m / p["height_m"]) ** 2)


class Recirculation(Effect):
    """Own downwash sucked in again."""

    name = "recirculation"
    physics = "Close above the base the rotor breathes its own reflected wash and loses thrust."
    equation = "F = −loss · T² / W · exp(−z / height_m)"
    stage = "force"
    parameters = (
        Parameter("loss", "1", scale=0.1, low=0.0, high=1.0),
        Parameter("height_m", "m", scale=0.07, low=0.02, high=0.6, neutral=0.15),
    )
    confused_with = ("ground-effect", "thrust-coefficient")
    split_by = "hover at several heights below 0.3 m, with and without the wake"

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """A loss [N] that grows with the square of the thrust and fades over `height_m`."""
        fading = np.exp(-m.z_m / p["height_m"])
        return -p["loss"] * m.sufferer_n * (m.sufferer_n / s.weight_n) * fading


class TetherSpring(Effect):
    """A cable that becomes taut."""

    name = "tether-spring"
    physics = "Above a slack height the supply cable pulls the sufferer down like a spring."
    equation = "F = −stiffness_n_per_m · 0.01 · ln(1 + exp((z − slack_m) / 0.01))"
    stage = "force"
    parameters = (
        Parameter("stiffness_n_per_m", "N/m", scale=0.5, low=0.0, high=20.0),
        Parameter("slack_m", "m", scale=0.2, low=0.0, high=5.0, neutral=0.4),
    )
    confused_with = ("ground-effect", "range-scale")
    split_by = "hover at several heights up to the top"

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """The spring's pull [N], from a centimetre below the slack height on."""
        stretched_m = _SLACKENS_OVER_M * np.logaddexp(
            0.0, (m.z_m - p["slack_m"]) / _SLACKENS_OVER_M
        )
        return -p["stiffness_n_per_m"] * stretched_m


EFFECTS: tuple[Effect, ...] = (
    CoulombFriction(),
    ViscousFriction(),
    Stiction(),
    GroundEffect(),
    Recirculation(),
    TetherSpring(),
)
