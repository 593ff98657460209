"""What one, two or three flights cannot tell, in words.

In: how many flights there are. Out: which of the two limits they miss, and sentences that say so.
Of one or two nothing is concluded: a verdict takes three to fit to. Three give a verdict, and none
is kept apart to confirm it: what they say is missing is added to no rig file unasked.
"""

from wakedeploy.gap.rules import FEWEST_IN_ALL, RULES, sealed_count

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six")


def cannot_tell(flights: int) -> bool:
    """Whether this many flights are too few for a verdict. False for 0, which means "not known"."""
    return flights > 0 and flights - sealed_count(flights) < RULES.fewest_flights


def unconfirmed(flights: int) -> bool:
    """Whether this many flights give a verdict but leave none to confirm it."""
    return 0 < flights < FEWEST_IN_ALL and not cannot_tell(flights)


def in_words(flights: int) -> str:
    """`one flight`, `two flights`."""
    number = _NUMBERS[flights] if flights < len(_NUMBERS) else str(flights)
    return f"{number} flight{'' if flights == 1 else 's'}"


def these(flights: int) -> str:
    """`this one flight`, `these two flights`."""
    return f"{'this' if flights == 1 else 'these'} {in_words(flights)}"


def headline(flights: int) -> str:
    """That nothing can be concluded, and how many flights would do."""
    return f"Cannot tell from {in_words(flights)}: fly at least {FEWEST_IN_ALL}."


def caution(flights: int) -> str:
    """What an effect rests on that is added all the same; "" where a flight was kept apart."""
    if cannot_tell(flights):
        return f"{in_words(flights).capitalize()} cannot confirm it: fly at least {FEWEST_IN_ALL}."
    if unconfirmed(flights):
        return "No flight was kept apart to confirm it: fly one more."
    return ""
