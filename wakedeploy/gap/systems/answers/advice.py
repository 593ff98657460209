"""What to do about an answer that has no name: the most useful step, and where all of them stand.

In: a `Result` whose verdict is unknown. Out: sentences.
"""

from wakedeploy.gap.search.artefacts import Leftover, Result

_PAGE = "docs/how-to/unknown.md#of-a-system-of-your-own"
_ALL = (
    f"All ways on are in {_PAGE}: units and samples, constants, equations, another log, half of "
    "the log."
)


def unknown_step(result: Result) -> str:
    """What to do first, by what is known of the unknown, and where the rest stands."""
    return f"{_first(result)} {_ALL}"


def _first(result: Result) -> str:
    if result.rivals:
        return "Record an input that tells these apart, if there is one."
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
    law = push.law
    over = f"{law.coordinate} and the direction of motion" if law.by_direction else law.coordinate
    return (
        f"Write the term that is missing: what acts on {push.state} follows {over}, which the rate "
        f"of {push.state} in your equations does not have, or not so."
    )


def _removes(push: Leftover) -> float:
    return push.law.removes if push.law else 0.0
