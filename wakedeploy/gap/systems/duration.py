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
# Runs with all parameters moved, by count of what searches did: of a system as it is, of each
# effect, and how many such searches an answer takes, as halves of the logs are searched, too.
_OF_BASE, _OF_EFFECT, _SEARCHES = 35.0, 0.6, 2.0
_WORTH_SAYING_S = 60.0  # of a search that finds one effect; several took up to twelve times that
_HOUR_S = 3600.0


def long_search(model: LogModel) -> list[str]:
    """What is said of a search that takes more than a few minutes, and how to shorten it."""
    lasts_s = _lasts_s(model)
    if lasts_s < _WORTH_SAYING_S:
        return []
    many = f"{len(model.system.states)} states, {len(model.library)} effects"
    by_point = ", as each of its points is computed by the simulator"
    why = by_point if model.system.costs_by_point else ""
    return [
        f"a search takes about {_rounded(lasts_s)} here ({many}){why}, and several times as long "
        "if several effects are missing. It takes less with fewer ports or kinds, constants that "
        "are exact (spread=0), a lower rate_hz, or a shorter log."
    ]


def _lasts_s(model: LogModel) -> float:
    part = model.thinned()
    theta = neutral(part.free(()))
    sets, episodes = np.repeat(theta[None], _TRIED, axis=0), range(part.episodes)
    part.scores((), sets[:1], (0,))  # compiles
    began = time.perf_counter()
    part.scores((), sets, episodes)
    of_a_set_s = (time.perf_counter() - began) / _TRIED
    return _SEARCHES * (_OF_BASE + _OF_EFFECT * len(model.library)) * len(theta) * of_a_set_s


def _rounded(seconds: float) -> str:
    """To what such a guess is worth: 1, 2, 3, 5, 10, 20, 30 and 40 minutes, then hours."""
    minutes = seconds / 60.0
    if minutes < 1.5:
        return "a minute"
    if seconds < 0.75 * _HOUR_S:
        rounded = next((m for m, most in ((2, 2.5), (3, 4.0), (5, 7.5)) if minutes < most), 0)
        return f"{rounded or 10 * max(round(minutes / 10.0), 1)} minutes"
    hours = max(round(seconds / _HOUR_S), 1)
    return "an hour" if hours == 1 else f"{hours} hours"
