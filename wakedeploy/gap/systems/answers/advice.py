"""What to do where an answer explains too little: the most useful step, and where all stand.

In: a `Result`. Out: sentences.
"""

from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Answer, Law, Leftover, Result
from wakedeploy.gap.systems.answers.importance import whole_percent
from wakedeploy.gap.wording import listed

_PAGE = "docs/how-to/unknown.md#of-a-system-of-your-own"
_OWN_EFFECT = "docs/how-to/own-effect.md#an-effect-for-any-system"
_ALL_OF_IT = 1.0  # of a rate or its parts: more than all that the system itself does
_ALL = (
    f"All ways on are in {_PAGE}: units and samples, constants, kinds, the equations, another log, "
    "half of the log, uneven noise."
)


def unknown_step(result: Result) -> str:
    """What to do first, by what is known of the unknown, and where the rest stands."""
    return f"{_first(result)} {_ALL}"


def rest_words(answer: Answer) -> str:
    """That what was named is not all, or not of the right form, where a law says most of the rest.

    Names then stand for what comes nearest to it, and may be wrong.
    """
    rest = _mostly_lawful(answer)
    if rest is None or rest.law is None:
        return ""
    removes = whole_percent(rest.law.removes)
    return (
        f" That is not all of it, or not its form: a law over {over(rest.law)} on {rest.state} "
        f"removes {removes} of the squared forecast error that is left."
    )


def pushes_left(answer: Answer) -> str:
    """What still acts although no effect was named: on which rates, and how much of them."""
    each = [
        f"{push.state} ({whole_percent(push.share)} of its usual rate)"
        for push in _by_share(answer)
    ]
    return f" But something is left that none of them explains: on {listed(each)}."


def outweighs(answer: Answer) -> Leftover | None:
    """The push that is more than all that the system itself does to a rate; of several the largest.

    A force that nobody thought of is rarely that large, a column in another unit often is. A rate
    whose inputs hold against its states, as those of a stiff servo, says little of what the system
    does: the push has to be more than these parts, too. None where constants say so already,
    and where forecasts show that the equations are wrong.
    """
    larger = [p for p in _by_share(answer) if min(p.share, p.of_parts) > _ALL_OF_IT]
    if not larger or answer.moved or answer.is_outdone:
        return None
    return larger[0]


def units_first(answer: Answer) -> str:
    """That columns are to be checked before all else, where a push is that large; "" for others."""
    push = outweighs(answer)
    if push is None:
        return ""
    return (
        "First check units, signs and columns: `gap check` prints the range of each column in the "
        f"system's unit. What is left on {push.state} is more than all that the system itself "
        "does, as of a column in another unit. If all are right:"
    )


def own_law(answer: Answer) -> str:
    """Where to write a law that a person knows of what is left."""
    state = _by_share(answer)[0].state
    return (
        f"If you know a law for what is left on {state}, give it as Port.custom, also one over "
        f"several coordinates, and ask again; {_OWN_EFFECT} says how."
    )


def _by_share(answer: Answer) -> list[Leftover]:
    return sorted(answer.unexplained, key=lambda push: -push.share)


def more_than_named(result: Result) -> str:
    """What to do where a law says most of what names leave; "" where none does."""
    rest = _mostly_lawful(result)
    return "" if rest is None else _more_kinds(rest) or _term(rest)


def _mostly_lawful(answer: Answer) -> Leftover | None:
    """What is left of which a law surely removes most of the error; of several, the most."""
    lawful = [p for p in answer.unexplained if p.law and p.law.low > RULES.surely_share]
    return max(lawful, key=_removes, default=None)


def _more_kinds(rest: Leftover) -> str:
    """Which port to add or to offer more kinds at, for what is left; "" where all are offered.

    People take kinds out of a port that they hold to be impossible: one of these may be it.
    """
    assert rest.law is not None
    if not rest.has_port:
        lacks = f'{rest.state} has no port. Add Port.force("{rest.state}", …)'
    elif rest.not_offered:
        kinds = listed(rest.not_offered)
        lacks = f"the port of {rest.state} leaves out {kinds}. Add them to its kinds"
    else:
        return ""
    return (
        f"Let the search try more: what is left on {rest.state} follows a law over "
        f"{over(rest.law)}, and {lacks}, and ask again."
    )


def _first(result: Result) -> str:
    if result.rivals:
        return "Record an input that tells these apart, if there is one."
    rest = _mostly_lawful(result)
    offer = "" if rest is None else _more_kinds(rest)
    if offer:
        return offer
    lawful = [push for push in result.unexplained if push.law and push.law.removes > 0.0]
    if lawful:
        return _term(max(lawful, key=_removes))
    if result.unexplained:
        state = max(result.unexplained, key=lambda push: push.share).state
        return (
            f"Look for what acts on {state} and stands in no column, as a load, a slope or wind; "
            "if it can be logged, make it an input."
        )
    return (
        "See whether units and samples are right, and which effects look alike; then record a log "
        "that excites them more."
    )


def _term(push: Leftover) -> str:
    """What to write into the equations."""
    assert push.law is not None
    return (
        f"Write the term that is missing: what acts on {push.state} follows {over(push.law)}, "
        f"which the rate of {push.state} in your equations does not have, or not so."
    )


def over(law: Law) -> str:
    """What a law is over, in words."""
    return f"{law.coordinate} and the direction of motion" if law.by_direction else law.coordinate


def _removes(push: Leftover) -> float:
    return push.law.removes if push.law else 0.0
