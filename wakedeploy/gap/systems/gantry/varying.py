"""What differs from one flight to the next: each flight's own thrust, battery and bias.

A motor runs on a battery that was charged anew, a sensor was unplugged. One constant for all
flights leaves a force in each, which an effect would then explain. The rig file states how much
they vary, `[repeatability]`. Each flight's own deviation is integrated out, as a random effect
(Laird and Ware, Biometrics 38, 1982): innovations are linear in it.

In: a rig, one flight's scores. Out: the same scores, free of what is the flight's own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.core import rig
from wakedeploy.gap.evidence.fits import FloatArray, Score
from wakedeploy.physics.constants import Constants, with_constants
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.chain import Chain

SAG = "battery-sag"
_SIMULATED = {SAG: (SAG, "sag_per_s"), "range.bias_m": ("range-bias", "bias_m")}


@dataclass(frozen=True)
class Varying:
    """A quantity that differs between flights: how much it varies (1 sd), in words."""

    name: str
    words: str
    unit: str
    sd: float

    def moved(self, constants: Constants, effects: Chain, amount: float) -> tuple[Constants, Chain]:
        """Constants and effects with this flight's value moved by an amount, in its own unit."""
        if self.name != SAG:
            return {**constants, self.name: constants[self.name] + amount}, effects
        values = {effect.name: parameters for effect, parameters in effects.parts}
        sag = {"sag_per_s": values.get(SAG, {"sag_per_s": 0.0})["sag_per_s"] + amount}
        parts = [part for part in effects.parts if part[0].name != SAG]
        order = {name: i for i, name in enumerate(LIBRARY)}
        before = [order.get(effect.name, len(order)) < order[SAG] for effect, _ in parts]
        parts.insert(sum(before), (LIBRARY[SAG], sag))
        return constants, Chain.in_order(tuple(parts))

    def simulated(self, truth: rig.Rig, amount: float) -> rig.Rig:
        """A simulated gantry with this flight's amount, within what the effect allows."""
        if self.name.startswith("thrust."):
            return with_constants(truth, {self.name: 1.0 + amount})
        effect, parameter = _SIMULATED[self.name]
        p = next(p for p in LIBRARY[effect].parameters if p.name == parameter)
        present = {e.name: e.parameters[parameter].value for e in truth.effect if e.name == effect}
        value = present.get(effect, p.neutral) + amount
        size = rig.EffectParameter(value=min(max(value, p.low), p.high), unit=p.unit)
        entry = rig.Effect(name=effect, parameters={parameter: size})
        others = tuple(e for e in truth.effect if e.name != effect)
        return truth.model_copy(update={"effect": (*others, entry)})


def varying(stated_by: rig.Rig) -> tuple[Varying, ...]:
    """What varies on this rig; () if its file states nothing."""
    stated = stated_by.repeatability
    known = (
        Varying("thrust.sufferer.scale", "the sufferer's thrust", "", stated.thrust),
        Varying(SAG, "how fast the battery fades", "1/s", stated.sag_per_s),
        Varying("range.bias_m", "the range sensor's bias", "m", stated.bias_m),
    )
    return tuple(quantity for quantity in known if quantity.sd > 0.0)


def of_one_flight(truth: rig.Rig, stated: rig.Rig, rng: np.random.Generator) -> rig.Rig:
    """A simulated gantry in one flight: what varies is drawn as the rig file states it."""
    for quantity in varying(stated):
        truth = quantity.simulated(truth, quantity.sd * float(rng.standard_normal()))
    return truth


def own_amounts(
    score: Score, directions: FloatArray, stand: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A flight's deviations (K,) in standard deviations, and the inverse of their covariance.

    `directions` (n, K) are what one standard deviation of each does to the innovations; the score
    is of a flight with the deviations `stand` (K,).
    """
    weighted = directions * (score.weight / score.variance)[:, None]
    precision = np.eye(directions.shape[1]) + weighted.T @ directions
    pull = weighted.T @ score.innovation + stand
    return np.asarray(stand - np.linalg.solve(precision, pull)), precision


def freed(score: Score, directions: FloatArray, stand: FloatArray) -> Score:
    """The score with the flight's own deviations integrated out, linear around `stand`.

    They follow the samples as one prior each, with its own deviation as innovation.
    """
    amounts, precision = own_amounts(score, directions, stand)
    innovation = score.innovation + directions @ (amounts - stand)
    density = score.log_density.copy()
    density -= 0.5 * score.weight * (innovation**2 - score.innovation**2) / score.variance
    log_density = -0.5 * amounts**2
    log_density[0] -= 0.5 * float(np.linalg.slogdet(precision)[1])
    ones = np.ones(len(amounts))
    return Score(
        np.concatenate([density, log_density]),
        np.concatenate([innovation, amounts]),
        np.concatenate([score.variance, ones]),
        np.concatenate([score.weight, ones]),
        channels=score.channels,
    )


def shifted(
    constants: Constants, effects: Chain, quantities: Sequence[Varying], amounts: FloatArray
) -> tuple[Constants, Chain]:
    """Constants and effects with a flight's own deviations (K,), in standard deviations."""
    for quantity, amount in zip(quantities, amounts, strict=True):
        constants, effects = quantity.moved(constants, effects, quantity.sd * float(amount))
    return constants, effects
