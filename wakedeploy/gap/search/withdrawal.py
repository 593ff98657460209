"""What is taken out of an answer once the search has ended.

In: an outcome. Out: the same without effects that later ones made superfluous, whose size may be
0, or that sealed blocks do not bear out.
"""

from collections.abc import Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, own_places, prior_precision
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.evidence.ranking import candidate
from wakedeploy.gap.evidence.separation import whitened
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.climbing import begun, height, raced
from wakedeploy.gap.search.comparison import Comparison, theta_from
from wakedeploy.gap.search.first_look import starts_of
from wakedeploy.gap.search.needed_gain import is_shared, needed_nats
from wakedeploy.gap.search.outcome import NO_SIZE, UNSEEN_WORSE, Named, chance_of, left_of, marked
from wakedeploy.gap.search.rivalry import is_nothing, sizes_of
from wakedeploy.gap.search.size_bounds import profiled
from wakedeploy.gap.search.sizes import joined_sizes
from wakedeploy.gap.search.weighing import helps, removes_most

_ALIKE = 0.2  # cosine of what two effects change


def still_needed(model: Comparison, outcome: Named) -> Named:
    """The outcome without effects that later ones made superfluous.

    What was named first took what is another's, and that one was fitted beside it. So where both
    change outputs alike, the other also begins anew. One effect is asked, not the best of many: to
    gain steadily, it need not be steadier than the luckiest of all would be. It stays, too, if it
    gains more than quiet noise brings, and surely removes most of the forecasts' error.
    """
    found = outcome.found
    if not outcome.rounds:
        return outcome
    chance = max(map(chance_of, outcome.rounds))
    for name in found.hypothesis[:-1]:
        alike = _alike(found, name)
        if not alike and _evident_by_size(found, name) > RULES.plain_times * chance.nats:
            continue
        without = _best_without(model, outcome.base, found, name, alike)
        again = candidate(without, name, found, model)
        needed = needed_nats(again, chance, alarms=RULES.false_alarms)
        if again.gains.sum() <= needed or not is_shared(again, needed):
            is_quiet = again.gains.sum() <= chance.without_loud_nats
            if is_quiet or not removes_most(model, without, found):
                found = without
    return left_of(outcome, found)


def with_sizes(model: Comparison, outcome: Named) -> Named:
    """The outcome without effects whose size may still be 0, however closely it is looked at."""
    found = outcome.found
    for name in outcome.found.hypothesis:
        if is_nothing(found, name):
            found = profiled(model, found, name)
            if is_nothing(found, name):
                outcome.rounds[:] = [marked(r, name, NO_SIZE) for r in outcome.rounds]
                found = _without(model, found, name)
    return left_of(outcome, _sized_in_all(model, outcome, found))


def _sized_in_all(model: Comparison, outcome: Named, found: Fit) -> Fit:
    """The fit without effects whose interval, as it is told, holds no effect, last first.

    It is wider than the likelihood's where the innovations are not white.
    """
    if not (found.hypothesis and hasattr(model, "unweighted")):
        return found
    sizes = joined_sizes(model, found, outcome.rounds)
    for name in reversed(found.hypothesis):
        if all(sizes[f.name].low <= f.neutral <= sizes[f.name].high for f in sizes_of(found, name)):
            outcome.rounds[:] = [marked(r, name, NO_SIZE) for r in outcome.rounds]
            return _sized_in_all(model, outcome, _without(model, found, name))
    return found


def borne_out(model: Comparison, outcome: Named) -> Named:
    """The outcome without effects that do not improve forecasts of sealed episodes, last first."""
    found = outcome.found
    for name in reversed(outcome.found.hypothesis):
        without = _without(model, found, name) if len(found.hypothesis) > 1 else outcome.base
        if helps(model, without, found, model.sealed()):
            continue
        outcome.rounds[:] = [marked(r, name, UNSEEN_WORSE) for r in outcome.rounds]
        found = without
    return left_of(outcome, found)


def _without(model: Comparison, found: Fit, name: str) -> Fit:
    """A fit without this effect."""
    rest = tuple(n for n in found.hypothesis if n != name)
    start = theta_from(model, rest, found)
    return settled(model, fit(model, rest, found.episodes, start))[0]


def _best_without(model: Comparison, base: Fit, found: Fit, name: str, anew: Sequence[str]) -> Fit:
    """The best fit without this effect, if effects `anew` begin at their usual sizes, too.

    They begin with constants and noise as they are beside the effect: without it, these bend first.
    """
    without = _without(model, found, name)
    origin = theta_from(model, without.hypothesis, found)
    starts = [
        begun(model, without.hypothesis, without, theta)
        for other in anew
        for theta in starts_of(origin, without.free, own_places(without.free, other))
    ]
    if not starts:
        return without
    best = max(raced(model, base, starts), key=height)
    best = fit(model, best.hypothesis, best.episodes, best.theta)
    return max(without, settled(model, best)[0], key=height)


def _alike(found: Fit, name: str) -> list[str]:
    """The later effects that change outputs as this one does, constants included.

    Beyond what constants of unlimited spread can do, even play and friction look little alike.
    """
    columns = np.concatenate(whitened(found.slopes))
    bases = {n: np.linalg.qr(columns[:, own_places(found.free, n)])[0] for n in found.hypothesis}
    later = found.hypothesis[found.hypothesis.index(name) + 1 :]
    return [n for n in later if np.linalg.norm(bases[name].T @ bases[n], 2) > _ALIKE]


def _evident_by_size(found: Fit, name: str) -> float:
    """Nats by which an effect's parameters are away from nothing, all else following (Wald)."""
    places = own_places(found.free, name)
    rest = [i for i in range(len(found.free)) if i not in places]
    total = found.slopes.fisher().sum(0) + np.diag(prior_precision(found.free))
    follow = np.linalg.lstsq(total[np.ix_(rest, rest)], total[np.ix_(rest, places)], rcond=1e-12)[0]
    marginal = total[np.ix_(places, places)] - total[np.ix_(places, rest)] @ follow
    away = np.array([found.theta[i] - found.free[i].neutral for i in places])
    return 0.5 * float(away @ marginal @ away)
