"""How long a search takes, said before it begins.

In: a `LogModel`. Out: a sentence, if the search is long. It takes seconds or a night, by how many
states, ports and samples there are, by how much is missing, and by whether a simulator is asked for
each point; nobody guesses which.
"""

import time

import numpy as np

from wakedeploy.gap.evidence.fits import neutral
from wakedeploy.gap.systems.likelihood.logs import LogModel

_TRIED = 8  # parameter sets that are timed: one alone takes longer than one of many
# Sets that a search usually tries, per effect: of 19 recordings and 30 simulated plants five took
# more, up to 2,000, and seven, of which nothing or one effect is missing, took less.
_LEAST, _MOST = 100.0, 1000.0
_WORTH_SAYING_S = 120.0  # of what it usually takes at most
_HOUR_S = 3600.0


def long_search(model: LogModel) -> list[str]:
    """What is said of a search that takes more than a few minutes, and how to shorten it."""
    of_each_s = _of_each_set_s(model) * len(model.library)
    if _MOST * of_each_s < _WORTH_SAYING_S:
        return []
    least, most = _rounded(_LEAST * of_each_s), _rounded(_MOST * of_each_s)
    many = f"{len(model.system.states)} states, {len(model.library)} effects"
    by_point = ", as each of its points is computed by the simulator"
    why = by_point if model.system.costs_by_point else ""
    return [
        f"a search usually takes between {least} and {most} here ({many}){why}, and more where "
        "much is missing. It takes less with fewer ports or kinds, constants that are exact "
        "(spread=0), a lower rate_hz, or a shorter log."
    ]


def _of_each_set_s(model: LogModel) -> float:
    part = model.thinned()
    theta = neutral(part.free(()))
    sets, episodes = np.repeat(theta[None], _TRIED, axis=0), range(part.episodes)
    part.scores((), sets[:1], (0,))  # compiles
    began = time.perf_counter()
    part.scores((), sets, episodes)
    return (time.perf_counter() - began) / _TRIED


def _rounded(seconds: float) -> str:
    """To what such a guess is worth: seconds, 1, 2, 3, 5, 10, 20, 30 and 40 minutes, then hours."""
    if seconds < 50.0:
        return f"{10 * max(round(seconds / 10.0), 1)} seconds"
    minutes = seconds / 60.0
    if minutes < 1.5:
        return "a minute"
    if seconds < 0.75 * _HOUR_S:
        rounded = next((m for m, most in ((2, 2.5), (3, 4.0), (5, 7.5)) if minutes < most), 0)
        return f"{rounded or 10 * max(round(minutes / 10.0), 1)} minutes"
    hours = max(round(seconds / _HOUR_S), 1)
    return "an hour" if hours == 1 else f"{hours} hours"
