"""How far the form of a gantry's model may be off: a smooth, small correction in every hypothesis.

No model's jet has quite the rig's shape, and no friction curve has its bend near rest. Without a
term for that, whatever is named on top absorbs the model's own error (Kennedy and O'Hagan, J. R.
Stat. Soc. B 63, 2001); with a term of no stated size, nothing can be named at all (Brynjarsdóttir
and O'Hagan, Inverse Problems 30, 2014). The rig file states the size, `[discrepancy]`.

In: a rig. Out: free parameters with their priors, and the factors and forces that they make. These
are over the model's own coordinates: the lateral place in widths of the jet, the height, the
vertical speed.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.fits import Free
from wakedeploy.gap.systems.gantry.flight import FloatArray
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.physics.jet import VerticalJet

PREFIX = "discrepancy."
_EVEN_AT = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)  # in widths of the jet
_ODD_AT = (0.5, 1.5, 2.5)
_BUMP = 0.4
_OVERLAP = 1.42  # sum of the squares of all bumps at any one place
_ODD_SHARE = 0.7  # of an even bump's size: an axis that is off is an effect, a skew jet is not
_FLOWN_WIDTHS = 3.0
_FARTHEST = 3.8  # beyond it there is no air to correct
# Of the force's share: how much the air's speed may differ at the ends of the rail, linear and
# curved; the force differs by twice as much. A round jet that is 4 % of the force away from a
# calibrated model needs two of these sd. With a tenth of this, twice as much of its force is left,
# and how it fades is found as an effect. A ground effect or a spring shows without a wake, too.
_HEIGHT_SHARE = 0.3
# Of the force on the axis: the error beside the turbulence that is always there, as a weight.
# Between two range samples it is most of the error; a weight of the turbulence alone leaves half of
# a shift.
_UNREST = 1.0
_BEND_MPS = (0.03, 0.1)
_CORNER_MPS = 0.02
_LEAST_FRICTION_N = 0.01

_EVEN = tuple(f"{PREFIX}wake.even{i}" for i in range(len(_EVEN_AT)))
_ODD = tuple(f"{PREFIX}wake.odd{i}" for i in range(len(_ODD_AT)))
_HEIGHT = (f"{PREFIX}wake.height1", f"{PREFIX}wake.height2")
WAKE_TERMS = (*_EVEN, *_ODD, *_HEIGHT)
_SPEED = tuple(f"{PREFIX}friction.speed{i}" for i in range(len(_BEND_MPS)))
_ALONG = (f"{PREFIX}friction.along",)
FRICTION_TERMS = (*_SPEED, *_ALONG)


def free_terms(rig: Rig) -> tuple[Free, ...]:
    """The correction's parameters, each N(0, sd²); none if the rig file states no size.

    Together the bumps give the wake's force at any place the stated share of its size on the axis.
    The air's speed counts twice in the force. The centres are what reference flights have shown.
    """
    wake, friction = rig.discrepancy.wake, rig.discrepancy.friction
    bump = 0.5 * wake / _OVERLAP**0.5
    sizes = dict.fromkeys(_EVEN, bump) | dict.fromkeys(_ODD, _ODD_SHARE * bump)
    sizes |= dict.fromkeys(_HEIGHT, _HEIGHT_SHARE * wake)
    sizes |= dict.fromkeys(FRICTION_TERMS, friction)
    known = {f"{PREFIX}{name}": pair for name, pair in rig.discrepancy.fitted.items()}
    terms = {name: known.get(name, (0.0, sd)) for name, sd in sizes.items() if sd > 0.0}
    return tuple(_free(name, *pair) for name, pair in terms.items())


def _free(name: str, size: float, sd: float) -> Free:
    low, high = size - 6.0 * sd, size + 6.0 * sd
    return Free(name, "", size, sd, low, high, 0.1 * sd, is_form=True)


def wake_factor(constants: Mapping[str, float], basis: FloatArray) -> FloatArray:
    """The factor (N,) on the air's speed, from a `wake_basis` (K, N)."""
    sizes = [constants.get(name, 0.0) for name in WAKE_TERMS]
    return np.asarray(1.0 + np.array(sizes) @ basis)


def wake_basis(places: FloatArray, heights: FloatArray) -> FloatArray:
    """Every function of the wake's correction, over the model's speed at each place, (K, N).

    `places` (N,) are lateral, in widths of the jet; `heights` (N,) run from −1 to 1 along the rail.
    A bump adds a share of the air's speed on the axis, so that the edge of the jet, where the model
    has next to nothing, may have something.
    """
    at = np.clip(places, -_FARTHEST, _FARTHEST)
    centres = sorted({*_EVEN_AT, *_ODD_AT})
    bumps = {c: _bump_to_axis(at, c) for c in (*centres, *(-c for c in centres if c))}
    even = [bumps[c] + bumps[-c] if c else bumps[c] for c in _EVEN_AT]
    # One flank up, the other down, without the part that shifts the jet's axis.
    odd = [bumps[c] - bumps[-c] - _shift_in(c) * at for c in _ODD_AT]
    return np.array([*even, *odd, heights, heights**2 - 1.0 / 3.0])


def _bump_to_axis(at: FloatArray, centre: float) -> FloatArray:
    """A bump of the air's speed, over the model's speed at each place and its speed on the axis."""
    return np.asarray(np.exp(0.5 * (at**2 - ((at - centre) / _BUMP) ** 2)))


def _bump(at: FloatArray, centre: float) -> FloatArray:
    return np.asarray(np.exp(-0.5 * ((at - centre) / _BUMP) ** 2))


@functools.cache
def _shift_in(centre: float) -> float:
    """How much of a shifted axis an odd pair of bumps holds, weighed as flights weigh it.

    The weight is its part in the force over the force's unrest: turbulence grows with the force.
    Without this the form would explain a shift, and crosswind could never be named.
    """
    at = np.linspace(-_FLOWN_WIDTHS, _FLOWN_WIDTHS, 601)
    shift = at * np.exp(-0.5 * at**2)
    force = np.exp(-(at**2))
    weight = force / (force**2 + _UNREST**2)
    pair = _bump(at, centre) - _bump(at, -centre)
    return float((weight * pair * shift).sum() / (weight * shift**2).sum())


def friction_n(rig: Rig, constants: Mapping[str, float], basis: FloatArray) -> FloatArray:
    """Friction [N] against the motion beyond the model's curve (…), of a `friction_basis` (K, …).

    Sizes are shares of the rig file's Coulomb friction.
    """
    sizes = np.array([constants.get(name, 0.0) for name in FRICTION_TERMS])
    return np.asarray(
        max(rig.rail.coulomb_n, _LEAST_FRICTION_N)
        * (sizes @ basis.reshape(len(sizes), -1)).reshape(basis.shape[1:])
    )


def friction_basis(vz_mps: FloatArray, heights: FloatArray) -> FloatArray:
    """Bends at two speeds and a growth along the rail, at these speeds and heights (…), (K, …)."""
    bends = [vz_mps / at * np.exp(0.5 - 0.5 * (vz_mps / at) ** 2) for at in _BEND_MPS]
    return np.array([*bends, heights * np.tanh(vz_mps / _CORNER_MPS)])


def places_of(
    constants: Mapping[str, float], source_height_m: float, x_m: FloatArray, z_m: FloatArray
) -> FloatArray:
    """Lateral places (N,) in widths of the jet at these heights."""
    below = np.maximum(source_height_m - z_m, 0.1)
    age_s = below / constants["wake.speed_mps"]
    width2 = constants["wake.width_m"] ** 2 + 2.0 * constants["wake.diffusivity_m2ps"] * age_s
    return np.asarray(x_m / np.sqrt(width2))


def heights_of(travel_m: float, z_m: FloatArray) -> FloatArray:
    """Heights (N,) from −1 at the stop to 1 at the rail's end."""
    return np.asarray(np.clip(2.0 * z_m / travel_m - 1.0, -1.0, 1.0))


@dataclass(eq=False)
class FormedWorld:
    """A simulated gantry's wake and friction with a drawn or fitted correction, as its two hooks.

    `sizes` are the correction's parameters. The wake is the closed form's, puff by puff.
    """

    rig: Rig
    sizes: Mapping[str, float]
    constants: Mapping[str, float]

    def hooks(self) -> dict[str, Any]:
        """`wake_hook` and `force_hook` of one plant, for one flight."""
        jet = VerticalJet(self.rig.wake, self.rig.source.height_m, GantryPlant.dt_s)

        def wake(t_s: float, source_n: float, x_m: float, z_m: float) -> tuple[float, float]:
            jet.inject(source_n)
            x, z = np.array([x_m]), np.array([z_m])
            places = places_of(self.constants, self.rig.source.height_m, x, z)
            factor = wake_factor(self.sizes, wake_basis(places, self._heights(z)))
            return 0.0, jet.velocity(x_m, z_m) * float(factor[0])

        def force(t_s: float, state: Mapping[str, float]) -> float:
            v, z = np.array([state["vz_mps"]]), np.array([state["z_m"]])
            return -float(friction_n(self.rig, self.sizes, friction_basis(v, self._heights(z)))[0])

        return {"wake_hook": wake, "force_hook": force}

    def _heights(self, z_m: FloatArray) -> FloatArray:
        return heights_of(self.rig.sufferer.travel_m, z_m)


def drawn(rig: Rig, rng: np.random.Generator) -> dict[str, float]:
    """A correction drawn from its prior, by name."""
    terms = free_terms(rig)
    return {f.name: f.neutral + f.prior_sd * float(rng.standard_normal()) for f in terms}


def form_hooks(rig: Rig) -> dict[str, Any]:
    """The hooks of a simulated flight in the form that reference flights have shown; {} if none."""
    if not rig.discrepancy.fitted:
        return {}
    sizes = {f.name: f.neutral for f in free_terms(rig)}
    return FormedWorld(rig, sizes, constants_of(rig)).hooks()
