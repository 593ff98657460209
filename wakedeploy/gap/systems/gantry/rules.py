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
        shorter_nats: Of two expressions closer than this, the shorter one is taken.
        long_terms: An expression of so many terms is believed only after effects were tried in
            pairs.
        dropped_nats: An effect that gains less beside others is dropped.
        used_nats: A wrong effect that gained less than this where it was fitted is no placebo, as
            it changes nothing.
        stray: Errors beyond so many times the usual are readings that strayed, and no forecasts'.
        nothing_level: An effect that reference flights show has an interval of this level that does
            not hold "no effect".
        odd_p: A flight is unlike the others where chance makes one so far away less often.
        variation_p: A constant varies from flight to flight where chance makes as much less often.
    """

    most_effects: int = 3
    least_share: float = 0.05
    rest_share: float = 0.25
    relatives_share: float = 0.1
    clear_nats: float = 60.0
    same_summit_nats: float = 1.35
    shorter_nats: float = 1.0
    long_terms: int = 3
    dropped_nats: float = 1.0
    used_nats: float = 0.5
    stray: float = 6.0
    nothing_level: float = 0.95
    odd_p: float = 0.01
    variation_p: float = 0.05


RULES = GantryRules()
