"""Whether an answer is right, by what was expected; and whether two halves agree."""

from collections.abc import Mapping
from typing import Any

from benchmarks.real_systems.cases import Case

Answer = Mapping[str, Any]


def judged_left_out(case: Case, answer: Answer) -> str:
    """The answer where the effect is missing.

    "right" has an expected effect and nothing that the literature does not know; "partly" has one
    beside others; "class" leaves a known one among at most three rivals; "wrong" has none;
    "nothing" names no effect, or so many rivals that the answer is "unknown".
    """
    names = answers(answer)
    if not names or answer["verdict"] == "unknown":
        return "nothing"
    if not names & set(case.expected):
        return "wrong"
    alike, known = {*answer["class"]}, {*case.expected, *case.further}
    if names - alike <= known and (not alike or alike & known):
        return "class" if alike else "right"
    return "partly"


def judged_left_in(case: Case, answer: Answer) -> str:
    """The answer where the effect is built in.

    "right" is "none that matters"; "next" names what else the literature knows, or was expected and
    is still missing; "unsure" is an unknown that is named by nothing; "wrong" names anything else,
    or what is built in once more.
    """
    names = answers(answer)
    if not names or answer["verdict"] == "unknown":
        return "right" if answer["verdict"] == "none" else "unsure"
    still = () if case.added is None else case.added.leaves
    alike, known = {*answer["class"]}, {*case.further, *still}
    return "next" if names - alike <= known and (not alike or alike & known) else "wrong"


def answers(answer: Answer) -> set[str]:
    """Every effect that an answer names, or leaves among rivals."""
    return {*answer["class"], *(e["name"] for e in answer["effects"])}


def agreement(first: Answer, second: Answer) -> str:
    """How two halves agree: "same" names, "in part" with some in common, or "differ"."""
    first_names, second_names = answers(first), answers(second)
    if first_names == second_names:
        return "same"
    return "in part" if first_names & second_names else "differ"
