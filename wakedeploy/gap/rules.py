"""The rules by which the gap workflow decides."""

import itertools

CLASS_NATS = 3.0  # rivals within this of the best cannot be told from it
MOST_IN_CLASS = 3
FEWEST_FLIGHTS = 3  # to fit to; of two, each is judged by one other and their spread by one number
_SEALED, _MOST_SEALED = {1: 0, 2: 0, 3: 0, 4: 1, 5: 1}, 2


def sealed_count(flights: int) -> int:
    """How many of so many flights are sealed, for the gap to be shown on; the last ones.

    Of three, none: two would be too few to find anything in. Each is then left out in turn.
    """
    return _SEALED.get(flights, _MOST_SEALED)


# Enough to fit to, and one beside them that confirms what was found in those.
FEWEST_IN_ALL = next(
    n for n in itertools.count(1) if sealed_count(n) and n - sealed_count(n) >= FEWEST_FLIGHTS
)
