"""The rules by which effects of the gantry are named, as its artefacts state them."""

from dataclasses import dataclass

from wakedeploy.gap.rules import Rules


@dataclass(frozen=True)
class GantryRules(Rules):
    """What flights of the gantry must show beside the rules of any system.

    The thresholds on gains are this rig's own: `threshold.py` simulates them, and each round states
    its own.

    Attributes:
        rest_share: Share of what effects explain; a rest below it is their own imprecision.
        relatives_share: Share of what an effect explains; a relative that adds less only mends its
            form.
        clear_nats: Effects that explain more have no better expression that leaves no rest.
        same_summit_nats: Depth of the interval of a summit: half of the 90 % quantile of chi².
    """

    most_effects: int = 3
    least_share: float = 0.05
    rest_share: float = 0.25
    relatives_share: float = 0.1
    clear_nats: float = 60.0
    same_summit_nats: float = 1.35


RULES = GantryRules()
