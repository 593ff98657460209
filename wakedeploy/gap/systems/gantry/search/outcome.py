"""What a search of the gantry's effects found: its rounds, and the answer that they make.

In: fits. Out: values that `naming` fills, and that `answer` puts into words and numbers.
"""

import math
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.evidence.whiteness import Whiteness
from wakedeploy.gap.systems.gantry.findings import Verdict
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.expressions import Symbolic


@dataclass(frozen=True)
class Thresholds:
    """What data without any missing effect hardly ever exceed on this rig; see `threshold`.

    First the gains [nats] of the best effect, of the best term of an expression in the state, and
    of the best wave in time; then the whiteness statistic of the innovations, and by channel the
    largest residual at any one place.
    """

    effect_nats: float
    expression_nats: float
    wave_nats: float
    whiteness: float
    force_n: float
    effort_n: float
    ahead_m: float

    @property
    def places(self) -> dict[str, float]:
        """The residuals by channel."""
        return {
            "force": self.force_n,
            "control effort": self.effort_n,
            "height 0.25 s ahead": self.ahead_m,
        }


@dataclass(frozen=True, eq=False)
class Round:
    """One search through the library, on top of the effects `given`.

    `found` is what it took, mostly the best; a better relative of a given effect may have been
    passed over. Rivals are within `near_nats` of it. `least_nats` is what the best of all effects
    gains, once in twenty, if nothing is missing.
    """

    given: tuple[str, ...]
    ranking: tuple[Candidate, ...]
    found: str = ""
    near_nats: float = RULES.class_nats
    least_nats: float = 0.0

    def confidence(self, candidate: Candidate) -> float:
        """The candidate's share of the belief, all effects and "nothing" equally likely before.

        "Nothing" is believed as if it gained `least_nats`: trying all effects on flights whose
        calibration is off brings that much, and says nothing for any one of them.
        """
        gains = np.array([self.least_nats, *(c.gain_nats for c in self.ranking)])
        weights = np.exp(gains - gains.max())
        return float(math.exp(candidate.gain_nats - gains.max()) / weights.sum())

    @property
    def near(self) -> tuple[Candidate, ...]:
        """The one taken (or else the best), and those that gain at most `near_nats` less."""
        taken = next((c for c in self.ranking if c.name == self.found), self.ranking[0])
        least = taken.gain_nats - self.near_nats
        others = (c for c in self.ranking if c is not taken and c.gain_nats > least)
        return (taken, *others)

    @property
    def rivals(self) -> tuple[Candidate, ...]:
        """The first of those, as many as a class has at most."""
        return self.near[: RULES.most_in_class]


@dataclass(frozen=True, eq=False)
class Answer:
    """What was found: `fit` has all of it, `base` nothing.

    `fit` has the effects and, if something is `unknown`, the expression's terms, refitted together.
    `model` is linear around the motion that `fit` explains, `base_model` around the base's;
    `white` tests what `fit` leaves.
    """

    verdict: Verdict
    effects: tuple[str, ...]
    classes: tuple[
        tuple[str, ...], ...
    ]  # members of each effect that stays open, first found first
    rounds: tuple[Round, ...]
    model: GantryModel
    base_model: GantryModel
    base: Fit
    fit: Fit
    white: Whiteness
    unknown: Symbolic | None
    rest: Symbolic | None  # beyond the effects, but too little to doubt them
    thresholds: Thresholds
    instead: "Answer | None" = None  # the effects, if an expression has taken their place

    @property
    def members(self) -> tuple[str, ...]:
        """The members of the first class; () without one."""
        return self.classes[0] if self.classes else ()
