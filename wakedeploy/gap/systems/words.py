"""What a step found in a user's system, as sentences for a terminal."""

from wakedeploy.gap.search.artefacts import Answer, Artefact, Disagreements, Result, Size
from wakedeploy.gap.search.judging import ACCEPTED, CHANCE, UNSEEN_WORSE
from wakedeploy.gap.wording import listed

_MOST_PLACES, _MOST_RANKED = 6, 5


def sentences(told: Artefact) -> list[str]:
    """The lines that a command prints."""
    if isinstance(told, Disagreements) and not isinstance(told, Result):
        return _found(told)
    assert isinstance(told, Answer)
    lines = [_verdict(told), *_moved(told), *_effects(told), *_unexplained(told), *_rejected(told)]
    return lines + _gap(told) if isinstance(told, Result) else lines


def _found(told: Disagreements) -> list[str]:
    places = told.where
    if not places:
        return ["The system and its logs disagree nowhere beyond noise."]
    lines = [f"They disagree in {len(places)} places; the clearest:"]
    for p in places[:_MOST_PLACES]:
        lines.append(
            f"  {p.channel}: {p.residual:+.3g} {p.unit} where {p.coordinate} is "
            f"{p.low:.3g} to {p.high:.3g} {p.coordinate_unit}"
        )
    return lines


def _verdict(told: Answer) -> str:
    if told.verdict == "class":
        return f"The system lacks one of {listed(told.rivals, 'or')}: the logs cannot say which."
    if told.verdict == "named":
        return f"The system lacks {listed([e.name for e in told.effects])}."
    if told.verdict == "none":
        return "Nothing that matters is missing from the system."
    if told.is_outdone:
        return (
            "The system forecasts no better than its outputs' last readings or their means: its "
            "equations are wrong by more than an effect."
        )
    if told.rivals:
        return f"Something is missing; these explain it about as well: {listed(told.rivals)}."
    return "Something acts on the system that no known effect explains."


def _moved(told: Answer) -> list[str]:
    return [
        f"  Doubt this: it holds only with {name} {abs(spreads):.0f} of its spreads away from what "
        "the system states. Check its unit, and those of the log's columns."
        for name, spreads in told.moved.items()
    ]


def _effects(told: Answer) -> list[str]:
    lines = []
    for effect in told.effects:
        sizes = ", ".join(_size(*one) for one in effect.parameters.items())
        share = effect.forecast
        lines.append(
            f"  {effect.name}: {sizes}; removes {_percent(share.share)} of the squared forecast "
            f"error where it was not fitted [{_percent(share.low)}, {_percent(share.high)}]"
        )
    for name in told.unsettled:
        lines.append(
            f"  The fit with {name} was stopped before it came to rest: its size is less sure than "
            "its interval says."
        )
    return lines


def _unexplained(told: Answer) -> list[str]:
    """What still acts: on which rate, how large, how long, and what it follows."""
    lines = []
    for one in told.unexplained:
        lines.append(
            f"  Not explained: on {one.state}, {one.sd:.3g} {one.unit} (sd) that last "
            f"{one.lasts_s:.2g} s, {_percent(one.share)} of the usual rate."
        )
        at = one.against
        if at is not None:
            lines.append(
                f"    It follows {at.coordinate}, which tells {_percent(at.share)} of it: "
                f"from {at.means[0]:+.3g} {one.unit} at {at.edges[0]:.3g} {at.unit} "
                f"to {at.means[-1]:+.3g} {one.unit} at {at.edges[-1]:.3g} {at.unit}."
            )
    return lines


def _size(name: str, size: Size) -> str:
    return f"{name} {size.value:.4g} [{size.low:.4g}, {size.high:.4g}] {size.unit}"


def _percent(share: float) -> str:
    """A share in whole percent; what is not all of it never reads as all of it."""
    return "over 99%" if 0.99 < share < 1.0 else f"{share:.0%}"


def _rejected(told: Answer) -> list[str]:
    """Of the last round, what was evident and yet not named, and why; and what was withdrawn."""
    if not told.rounds:
        return []
    judged = {
        one.name: one.judged
        for one in told.rounds[-1].ranking[:_MOST_RANKED]
        if one.judged not in ("", ACCEPTED, CHANCE)
    }
    ranked = (one for searched in told.rounds for one in searched.ranking)
    judged |= {one.name: UNSEEN_WORSE for one in ranked if one.judged == UNSEEN_WORSE}
    return [f"  Not named: {name}: {why}." for name, why in judged.items()]


def _gap(told: Result) -> list[str]:
    return [
        f"  {name}: forecasts over {told.forecast_s:.3g} s were off by {error.before:.4g}, now "
        f"by {error.after:.4g} {error.unit} (rms, sealed blocks)"
        for name, error in told.gap.items()
    ]
