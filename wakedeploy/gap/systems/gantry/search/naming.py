"""Which effect explains the disagreement: a name, a class, "unknown" or "none".

In: a model of three flights or more to fit (`glance` is for fewer), and thresholds. Out: an
`Answer`. Every effect is tried alone and on top of those found, ranked on flights held out. What is
found is refitted together, and dropped when it is no longer needed. What no effect explains is
sought as an expression; an effect beside it may no longer be needed either.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace

from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.expected_gains import worth_trying
from wakedeploy.gap.evidence.fits import Fit, Hypothesis, own_parameters
from wakedeploy.gap.evidence.inference import fit, gain_over
from wakedeploy.gap.evidence.ranking import LEDGE_NATS, Candidate, candidate, rank_fairly
from wakedeploy.gap.evidence.starts import Scans, scanned_starts
from wakedeploy.gap.evidence.whiteness import Whiteness, whiteness
from wakedeploy.gap.progress import Progress, StepsDone, quiet, uncounted
from wakedeploy.gap.systems.gantry.findings import Verdict
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.expression_terms import TERMS
from wakedeploy.gap.systems.gantry.search.expressions import MOST_TERMS, Symbolic, search
from wakedeploy.gap.systems.gantry.search.outcome import Answer, Round, Thresholds
from wakedeploy.gap.systems.gantry.search.pairs import best_pair
from wakedeploy.gap.systems.gantry.search.refitting import (
    STILL_NATS,
    expressed_by_own_motion,
    joined,
    refitted,
    without_idle,
)
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.chain import setting_of

_HOPE_SHARE = 0.3  # of the threshold; a smaller linear promise will not reach it
_CONTENDING_NATS = 12.0  # behind the best, a candidate may yet gain more around its own motion
_MOST_CONTENDERS = 4


def fitted_base(model: GantryModel) -> tuple[GantryModel, Fit]:
    """The base hypothesis, fitted around the motion that it and the readings agree on.

    Effects that the rig file already has, mostly friction, start from the motion that the readings
    have without them: a raw motion has too many corners.
    """
    everything = range(model.episodes)
    model = model.standing(model.neutral())
    if model.rig.effect:
        bare = GantryModel(without_effects(model.rig), model.flights, model.extra)
        bare = bare.standing(bare.neutral())
        bare, _ = refitted(bare, fit(bare, (), everything, bare.start(())))
        model = GantryModel(model.rig, bare.flights, model.extra)
        model = model.standing(model.neutral())
    first = refitted(model, fit(model, (), everything, model.start(())))
    near = first[0]
    again = fit(near, (), everything, near.start(()))  # either climb may end on a ledge
    if again.objective < first[1].objective + STILL_NATS:
        return first
    return max(first, refitted(near, again), key=lambda pair: pair[1].objective)


def without_effects(rig: Rig) -> Rig:
    """The rig without its effects."""
    return rig.model_copy(update={"effect": ()})


def name_effects(
    rig: Rig,
    model: GantryModel,
    thresholds: Thresholds,
    progress: Progress = quiet,
    candidates: Sequence[str] | None = None,
    base: Fit | None = None,
    share: float = 1.0,
    disagrees: bool = False,
) -> Answer:
    """Find, refit, drop, and decide. ValueError for fewer flights than `RULES.fewest_flights`.

    `base` is the unchanged rig file, fitted around the motion of a `model` with terms, if that is
    already known (`fitted_base`). `share` is the part of all flights that is in `model`: effects
    are rivals if all flights, the sealed ones included, could not tell them apart, as nats grow
    with the data. `disagrees` says that flights and rig file disagree beyond noise at some places:
    then something is missing, even if the fitted noise makes it look white and no form explains it.
    """
    if model.episodes < RULES.fewest_flights:
        raise ValueError(f"{model.episodes} flights; a verdict takes {RULES.fewest_flights}")
    if base is None:
        progress("fitting the rig file as it is")
        model, base = fitted_base(with_terms(model))
    names = [n for n in (candidates or LIBRARY) if n not in {e.name for e in rig.effect}]
    searched = _Search(model, base, base, thresholds, RULES.class_nats * share)
    while len(searched.current.hypothesis) < RULES.most_effects and searched.find(names, progress):
        pass
    base = searched.base
    model, current = without_idle(searched.model, searched.current)
    rounds = _still_needed(searched.rounds, current)
    progress("looking for what no effect explains")
    beyond = searched.expression(model, current)
    unknown, rest = _rest(searched.base_model, base, current, beyond, thresholds)
    if unknown is not None and len(unknown.terms) >= RULES.long_terms:
        progress("trying effects in pairs")
        pair = _pair_instead(searched, unknown, thresholds)
        if pair is not None:
            (model, current), unknown, rest = pair, None, None
    conclude = functools.partial(_concluded, searched, disagrees=disagrees)
    if unknown is None:
        return conclude(model, current, rounds, None, rest)
    instead = conclude(model, current, rounds, None, beyond) if current.hypothesis else None
    bare, least = (searched.base_model, base), thresholds.expression_nats
    model, unknown = joined(model, current, unknown, bare, searched.expression, least)
    rounds = _still_needed(searched.rounds, unknown.fit)
    formula = conclude(model, unknown.fit, rounds, unknown, None)
    return replace(formula, instead=instead)


def _concluded(
    searched: "_Search",
    model: GantryModel,
    current: Fit,
    rounds: Sequence[Round],
    unknown: Symbolic | None,
    rest: Symbolic | None,
    disagrees: bool,
) -> Answer:
    """The answer that a fit makes, with the expression of the unknown or of the rest."""
    white = whiteness(current)
    verdict, classes = _verdict(rounds, current, unknown, white, searched.thresholds, disagrees)
    return Answer(
        verdict,
        _claimed(verdict, rounds, current),
        classes,
        tuple(rounds),
        model,
        searched.base_model,
        searched.base,
        current,
        white,
        unknown,
        rest,
        searched.thresholds,
    )


def ranked_by_own_motion(
    model: GantryModel,
    base: Fit,
    names: Sequence[str],
    threshold_nats: float,
    steps: StepsDone = uncounted,
) -> tuple[GantryModel, Fit, list[Candidate]]:
    """The effects on top of a base, best first, each contender around its own motion.

    Around the base's motion a friction may show a third of what it gains; so those near the best
    and its relatives contend. Those that gain little compared with the threshold stay as they were
    ranked there. Also returns the model around the base's motion, and the base: a better base with
    another motion may have been met.
    """
    least_nats = 0.5 * threshold_nats
    scans: Scans = {}
    again, ranked = rank_fairly(model, base, names, least_nats=least_nats, steps=steps, scans=scans)
    if again.objective > base.objective + LEDGE_NATS:
        model, again = refitted(model, again)
        again, ranked = rank_fairly(
            model, again, names, least_nats=least_nats, steps=steps, scans=scans
        )
    hopeful = [c for c in ranked if c.gain_nats > _HOPE_SHARE * threshold_nats]
    best = ranked[0]
    near = [c for c in hopeful if c.gain_nats > best.gain_nats - _CONTENDING_NATS]
    near = near[:_MOST_CONTENDERS]
    near += [c for c in hopeful if c not in near and _related(c.name, best.name)]
    refined = [candidate(again, c.name, refitted(model, c.fit)[1]) for c in near]
    others = [c for c in ranked if c.name not in {each.name for each in refined}]
    return model, again, sorted([*refined, *others], key=lambda c: -c.gain_nats)


class _Search:
    """The search through the library: effects found one after another, all refitted together."""

    def __init__(
        self, model: GantryModel, base: Fit, current: Fit, thresholds: Thresholds, near_nats: float
    ) -> None:
        self.model, self.base, self.current = model, base, current
        self.base_model = model
        self.rounds: list[Round] = []
        self.thresholds, self._near_nats = thresholds, near_nats
        self._gains: dict[str, float] = {}  # of each effect found, when it was found [nats]
        self._beyond: dict[Hypothesis, Symbolic | None] = {}

    def find(self, names: Sequence[str], progress: Progress) -> bool:
        """Make one round; return whether there should be another."""
        least = self.thresholds.effect_nats
        remaining = [n for n in names if n not in self.current.hypothesis]
        if self.current.hypothesis:  # the first round ranks all, for the record
            remaining = worth_trying(self.model, self.current, remaining, _HOPE_SHARE * least)
        if not remaining:
            return False
        stage = f"trying {len(remaining)} effects" + _on_top(self.current.hypothesis)
        progress(stage)
        steps = functools.partial(progress, stage)
        self.model, self.current, ranked = ranked_by_own_motion(
            self.model, self.current, remaining, least, steps
        )
        if not self.current.hypothesis:
            self.base_model, self.base = self.model, self.current
        given = self.current.hypothesis
        best = self._taken(ranked)
        found = best.name if best is not None else ""
        self.rounds.append(Round(given, tuple(ranked), found, self._near_nats, least))
        if best is not None:
            self._gains[best.name] = best.gain_nats
        return best is not None

    def _taken(self, ranked: Sequence[Candidate]) -> Candidate | None:
        """The first that may be taken and whose size is not 0; the others are passed over."""
        remaining = list(ranked)
        while remaining:
            best = self._chosen(remaining)
            if best is None:
                return None
            model, fitted = settled(self.model, best.fit)
            if not may_be_nothing(fitted, best.name):
                self.model, self.current = model, fitted
                return best
            remaining = [c for c in remaining if c is not best]
        return None

    def expression(self, model: GantryModel, current: Fit) -> Symbolic | None:
        """The expression beyond a fit, sought once."""
        if current.hypothesis not in self._beyond:
            self._beyond[current.hypothesis] = _expression(model, current, self.thresholds)
        return self._beyond[current.hypothesis]

    def _chosen(self, ranked: Sequence[Candidate]) -> Candidate | None:
        """The first that gains what it must, or as much as an expression that gains enough."""
        for entry in ranked:
            if entry.gain_nats >= _needed(entry.name, self._gains, self.thresholds):
                return entry
        best = ranked[0]
        if _form_nats(best.name, self._gains) > best.gain_nats:
            return None
        # If something is missing, an effect that explains it as well is its better name.
        beyond = self.expression(self.model, self.current)
        close = beyond is not None and best.gain_nats >= beyond.gain_nats - RULES.class_nats
        return best if close else None


def may_be_nothing(fitted: Fit, name: str, level: float = 0.9) -> bool:
    """Whether every parameter's interval holds the value that changes nothing."""
    parameters = own_parameters(fitted.free, name)
    ends = [(fitted.interval(f.name, level), f.neutral) for f in parameters]
    return all(low <= neutral <= high for (low, high), neutral in ends)


def _still_needed(rounds: Sequence[Round], current: Fit) -> list[Round]:
    """The rounds that found what is in a fit, or searched on top of nothing else."""
    needed = set(current.hypothesis)
    return [r for r in rounds if r.found in needed or set(r.given) <= needed]


def _needed(name: str, found: Mapping[str, float], thresholds: Thresholds) -> float:
    """What an effect must gain [nats] to be found, beside those found with their gains."""
    return max(thresholds.effect_nats, _form_nats(name, found))


def _form_nats(name: str, found: Mapping[str, float]) -> float:
    """The gain [nats] of a relative of found effects if their form is not quite the rig's."""
    return RULES.relatives_share * sum(
        gain for relative, gain in found.items() if _related(relative, name)
    )


def _related(name: str, other: str) -> bool:
    return other in LIBRARY[name].confused_with or name in LIBRARY[other].confused_with


def with_terms(model: GantryModel) -> GantryModel:
    """The same model, able to try terms of an expression as well."""
    return GantryModel(model.rig, model.flights, TERMS)


def settled(model: GantryModel, found: Fit) -> tuple[GantryModel, Fit]:
    """The found hypothesis, with everything refitted around the motion that it explains."""
    around = refitted(model, found)
    starts = scanned_starts(around[0], found)
    if not starts:
        return around
    # One of several summits may be the highest around its own motion but not around another's.
    fits = [fit(around[0], found.hypothesis, found.episodes, theta) for theta in starts]
    best = max(fits, key=lambda f: f.objective).objective
    near = [f for f in fits if f.objective > best - RULES.class_nats]
    reached = [around, *(refitted(around[0], f) for f in near)]
    line, highest = max(reached, key=lambda p: p[1].objective)
    as_high = (f for _, f in reached if f.objective > highest.objective - RULES.same_summit_nats)
    return line, replace(highest, summits=tuple(f for f in as_high if f is not highest))


def _expression(
    model: GantryModel, on: Fit, thresholds: Thresholds, most_terms: int = MOST_TERMS
) -> Symbolic | None:
    found = search(
        model,
        on,
        setting=vars(setting_of(model.rig)),
        least_nats=thresholds.expression_nats,
        wave_nats=thresholds.wave_nats,
        most_terms=most_terms,
    )
    if found is None:
        return None
    refined = expressed_by_own_motion(model, on, found)
    least = min(thresholds.expression_nats, thresholds.wave_nats)
    return refined if refined.gain_nats > least else None


def _rest(
    model: GantryModel, base: Fit, current: Fit, beyond: Symbolic | None, thresholds: Thresholds
) -> tuple[Symbolic | None, Symbolic | None]:
    """An expression that explains more than the effects do, with or without them; or else a rest.

    The second is what is left beyond effects that lead: they keep their name although their form is
    not exact. An expression takes a name's place only if it is better by more than the width of a
    class, and by more than the best of as many expressions gains by chance. It does not if effects
    explain nearly as much: two terms for one effect's exact form always exceed that effect.
    """
    if not current.hypothesis:
        return beyond, None
    explained = gain_over(base, current)
    rest_nats = beyond.gain_nats if beyond is not None else 0.0
    if rest_nats > explained:
        return beyond, None
    if explained > RULES.clear_nats and rest_nats < RULES.rest_share * explained:
        return None, beyond
    instead = _expression(model, base, thresholds, most_terms=2)
    least = explained + thresholds.expression_nats + RULES.class_nats
    if instead is None or instead.gain_nats <= least:
        return None, beyond
    if explained >= RULES.simpler_share * instead.gain_nats:
        return None, beyond
    return instead, None


def _pair_instead(
    searched: _Search, unknown: Symbolic, thresholds: Thresholds
) -> tuple[GantryModel, Fit] | None:
    """Two effects that together explain what a long expression does, and are both there."""
    paired = best_pair(searched.base_model, searched.base, searched.rounds[0].ranking)
    if paired is None:
        return None
    model, fitted, gain_nats = paired
    least = max(unknown.gain_nats - RULES.class_nats, 2.0 * thresholds.effect_nats)
    if gain_nats < least or any(may_be_nothing(fitted, name) for name in fitted.hypothesis):
        return None
    return model, fitted


def _verdict(
    rounds: Sequence[Round],
    current: Fit,
    unknown: Symbolic | None,
    white: Whiteness,
    thresholds: Thresholds,
    disagrees: bool,
) -> tuple[Verdict, tuple[tuple[str, ...], ...]]:
    if unknown is not None:
        return "unknown", ()
    if not current.hypothesis:
        is_noise = white.passes(thresholds.whiteness) and not disagrees
        return ("none" if is_noise else "unknown"), ()
    unsettled = _unsettled(rounds, current)
    if unsettled:
        return "class", tuple(tuple(c.name for c in r.rivals) for r in unsettled)
    return "named", ()


def _unsettled(rounds: Sequence[Round], current: Fit) -> list[Round]:
    """The rounds whose effect cannot be told from others."""
    settling = [r for r in rounds if r.found in current.hypothesis]
    return [searched for searched in settling if len(searched.rivals) > 1]


def _claimed(verdict: Verdict, rounds: Sequence[Round], current: Fit) -> tuple[str, ...]:
    """The effects that an answer commits itself to: none of a class."""
    if verdict not in ("named", "class"):
        return ()
    # One round's rival may be what another round took, and is in doubt all the same.
    open_ones = {c.name for searched in _unsettled(rounds, current) for c in searched.rivals}
    return tuple(name for name in current.hypothesis if name not in open_ones)


def _on_top(found: Sequence[str]) -> str:
    return f" on top of {', '.join(found)}" if found else ""
