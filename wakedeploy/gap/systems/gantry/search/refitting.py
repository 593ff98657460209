"""Hypotheses refitted around the motion that they explain, without what they no longer need.

In: a model and a fit. Out: the model around that fit's own motion, and everything refitted there.
"""

from collections.abc import Callable, Sequence

from wakedeploy.gap.evidence.fits import Fit, Hypothesis, extended
from wakedeploy.gap.evidence.inference import applied, fit
from wakedeploy.gap.evidence.ranking import candidate
from wakedeploy.gap.evidence.starts import with_louder_noise
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.expressions import Symbolic, symbolic_of
from wakedeploy.physics.effects.chain import setting_of

STILL_NATS = 0.3  # a fit that gains less around a new motion has found its own
_MOST_TURNS = 10


def refitted(model: GantryModel, found: Fit) -> tuple[GantryModel, Fit]:
    """A hypothesis with everything refitted around the motion that it explains.

    Motion and fit take turns until the fit gains nothing around its motion. Around another
    hypothesis's motion the same one may seem tens of nats more or less likely; likelihoods around
    different motions compare only if each motion is the hypothesis's own.
    """
    for _ in range(_MOST_TURNS):
        model = model.around_own_motion(found)
        before = applied(model, found, found.episodes)
        found = fit(model, found.hypothesis, found.episodes, found.theta)
        if found.objective < before.objective + STILL_NATS:
            break
    return model, found


def reduced(model: GantryModel, current: Fit, rest: Hypothesis) -> tuple[GantryModel, Fit]:
    """A hypothesis without some of its effects, refitted from where it stands.

    A constant that one of these effects had replaced starts from the effect's value. Its prior
    pulls it back at once, to where the noise fitted with the effect is far too little: the climb
    begins with a louder one, or it ends among outliers.
    """
    free = model.free(rest)
    start = with_louder_noise(free, extended(current, free))
    return refitted(model, fit(model, rest, current.episodes, start))


def without_idle(
    model: GantryModel,
    current: Fit,
    among: Sequence[str] | None = None,
    least_nats: float = RULES.dropped_nats,
) -> tuple[GantryModel, Fit]:
    """Drop each effect (of `among`, or of all) that gains too little beside the others."""
    for name in current.hypothesis if among is None else among:
        if len(current.hypothesis) < 2:
            break
        rest = tuple(n for n in current.hypothesis if n != name)
        near, without = reduced(model, current, rest)
        if candidate(without, name, current).gain_nats < least_nats:
            model, current = near, without
    return model, current


def expressed_by_own_motion(model: GantryModel, on: Fit, found: Symbolic) -> Symbolic:
    """An expression found on top of a fit, refitted around the motion that it explains itself."""
    _, fitted = refitted(model, found.fit)
    return _symbolic(model, on, fitted, found.terms)


def joined(
    model: GantryModel,
    on: Fit,
    found: Symbolic,
    base: tuple[GantryModel, Fit],
    search: Callable[[GantryModel, Fit], Symbolic | None],
    least_nats: float,
) -> tuple[GantryModel, Symbolic]:
    """An expression and the effects that are needed beside it, all refitted together.

    An effect that was found first may have stood for what the expression says better. It is
    dropped. The expression may have mended its faults, and so is sought again on top of what is
    left. `least_nats` is what noise alone hardly gains: an effect beside the expression must gain
    as much, and so must each term of the new expression for it to be the better. `on` is the fit of
    the effects, `base` the one without any.
    """
    near, joint = refitted(model, found.fit)
    effects = tuple(n for n in joint.hypothesis if n not in found.terms)
    near, joint = without_idle(near, joint, effects, least_nats)
    remaining = tuple(n for n in effects if n in joint.hypothesis)
    if not remaining:
        model, on = base
    elif remaining != effects:
        model, on = reduced(near, joint, remaining)
    here = _symbolic(near, on, joint, found.terms)
    again = search(model, on) if remaining != effects else None
    if again is None or _merit(again, least_nats) <= _merit(here, least_nats):
        return near, here
    return joined(model, on, again, base, search, least_nats)


def _merit(symbolic: Symbolic, least_nats: float) -> float:
    return symbolic.gain_nats - least_nats * len(symbolic.terms)


def _symbolic(model: GantryModel, on: Fit, fitted: Fit, terms: Sequence[str]) -> Symbolic:
    return symbolic_of(on, fitted, terms, vars(setting_of(model.rig)))
