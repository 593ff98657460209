"""Find, name, add and show for a user's system: the steps, and what each leaves in a folder.

In: a `LogModel`. Out: find.json, name.json, correction.toml and domain.json, which the report page
of `gap domain` shows. An effect is named if it is evident (it gains more than chance on blocks that
it was not fitted to, and so does every likely sum of blocks) and if it matters (forecasts of sealed
blocks get better by it). One that is not does not end the search: the next one is tried.
"""

import functools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.inference import Fit, fit, held_out
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.search.scan import Weight, elaborates, ranked, simpler, weighed
from wakedeploy.gap.systems.before_after import shown
from wakedeploy.gap.systems.closing import parameters
from wakedeploy.gap.systems.gantry.search.naming import CLASS_NATS, MOST_IN_CLASS
from wakedeploy.gap.systems.logs import LogModel
from wakedeploy.gap.systems.places import find_places, whiteness

MOST_EFFECTS = 4
_TRIED = 6  # candidates of a round that are looked at on the sealed blocks
_SETTLED_NATS, _MOST_REFITS = 0.1, 4
NO_SIZE = "its size's interval holds no effect"
_UNEXPLAINED = 0.1  # share of the error that a rejected effect removed: something is missing


@dataclass(frozen=True, eq=False)
class Named:
    """What was named: fits without and with it, rounds as JSON has them, and rivals of a class."""

    base: Fit
    found: Fit
    rounds: list[dict[str, Any]]
    rivals: tuple[str, ...] = ()
    weights: dict[str, Weight] = field(default_factory=dict)
    unsettled: tuple[str, ...] = ()


def fitted_base(model: LogModel) -> Fit:
    """The system as it is, on the blocks that are not sealed.

    Raises UnusableInput for logs that are too short.
    """
    if model.episodes < FEWEST_IN_ALL:
        raise UnusableInput(
            f"{model.name}: the logs make {model.episodes} blocks; at least {FEWEST_IN_ALL} are "
            "needed, as effects are judged on blocks that they were not fitted to."
        )
    sealed = model.sealed()
    used = [e for e in range(model.episodes) if e not in sealed]
    return settled(model, fit(model, (), used))[0]


def settled(model: LogModel, fitted: Fit) -> tuple[Fit, bool]:
    """A fit repeated from where it ended, and whether it no longer rises."""
    for _ in range(_MOST_REFITS):
        again = fit(model, fitted.hypothesis, fitted.episodes, fitted.theta)
        rise, fitted = again.objective - fitted.objective, again
        if rise < _SETTLED_NATS:
            return fitted, True
    return fitted, False


def named(model: LogModel, base: Fit, progress: Progress = quiet) -> Named:
    """Effects one after another, as long as one is evident and matters."""
    told = Named(base, base, [])
    while len(told.found.hypothesis) < MOST_EFFECTS:
        told, goes_on = _round(model, told, progress)
        if not goes_on:
            break
    return _still_needed(model, told)


def _round(model: LogModel, told: Named, progress: Progress) -> tuple[Named, bool]:
    found = told.found
    left = [n for n in model.effects if n not in found.hypothesis]
    beside = f" beside {', '.join(found.hypothesis)}" if found.hypothesis else ""
    stage = f"ranking effects{beside}"
    progress(stage)
    ranking, chance = ranked(model, found, left, functools.partial(progress, stage))
    searched: dict[str, Any] = {
        "given": list(found.hypothesis),
        "threshold_nats": chance,
        "ranking": [_entry(c, found) for c in ranking],
    }
    told.rounds.append(searched)
    accepted: list[tuple[Candidate, Weight]] = []
    for entry, one in list(zip(searched["ranking"], ranking, strict=True))[:_TRIED]:
        entry["judged"], weight = _judged(model, found, one, chance)
        if weight is not None:
            entry["forecast"] = asdict(weight)
        if entry["judged"] != "accepted" or weight is None:
            continue
        if not accepted or _rivals_with(accepted[0][0], one):
            accepted.append((one, weight))
    if not accepted:
        return told, False
    chosen, weight = accepted[0]
    plainer = simpler(model, found, chosen)
    if plainer is not chosen:
        other = weighed(model, found, plainer.fit, model.sealed())
        if other.matters:
            chosen, weight = plainer, other
            accepted[0] = (plainer, other)
            accepted = [
                one for k, one in enumerate(accepted) if not k or one[0].name != plainer.name
            ]
    better, still = settled(model, chosen.fit)
    while is_nothing(better, chosen.name):  # once all else has followed
        for entry in searched["ranking"]:
            if entry["name"] == chosen.name:
                entry["judged"] = NO_SIZE
        accepted = [one for one in accepted if one[0].name != chosen.name]
        if not accepted:
            return told, False
        chosen, weight = accepted[0]
        better, still = settled(model, chosen.fit)
    searched["chosen"] = chosen.name
    searched["class"] = [one.name for one, _ in accepted]
    rivals = told.rivals
    if len(accepted) > 1 and not rivals:
        rivals = tuple(searched["class"])
    unsettled = told.unsettled if still else (*told.unsettled, chosen.name)
    searched["accepted"] = parameters(better, (chosen.name,))
    weights = told.weights | {chosen.name: weight}
    return Named(told.base, better, told.rounds, rivals, weights, unsettled), True


def _judged(
    model: LogModel, found: Fit, one: Candidate, chance: float
) -> tuple[str, Weight | None]:
    """Why a candidate is not named, or "accepted"."""
    if one.gain_nats <= chance:
        return "no more than chance", None
    if is_nothing(one.fit, one.name):
        return NO_SIZE, None
    if one.gain_interval()[0] <= 0.0:
        return "its gain's interval reaches zero", weighed(model, found, one.fit, model.sealed())
    weight = weighed(model, found, one.fit, model.sealed())
    if weight.share < 0.0:
        return "forecasts of sealed blocks get worse", weight
    if not weight.matters:
        return "evident, but forecasts of sealed blocks hardly change", weight
    return "accepted", weight


def is_nothing(fitted: Fit, name: str) -> bool:
    """Whether the intervals of all parameters of an effect hold the value without effect."""
    own = [f for f in fitted.free if f.name.startswith(f"{name}.")]
    ends = [fitted.interval(f.name) for f in own]
    return all(low <= f.neutral <= high for f, (low, high) in zip(own, ends, strict=True))


def _rivals_with(best: Candidate, other: Candidate) -> bool:
    """Whether blocks do not agree that the best gains more than another."""
    apart = best.gains - other.gains
    count = len(apart)
    if count < 2:
        return float(apart.sum()) < CLASS_NATS
    reach = float(student_t.ppf(0.95, count - 1)) * float(apart.std(ddof=1)) * count**0.5
    return bool(float(apart.sum()) - reach < CLASS_NATS)


def _entry(one: Candidate, base: Fit) -> dict[str, Any]:
    low, high = one.gain_interval()
    return {
        "name": one.name,
        "gain_nats": one.gain_nats,
        "interval": [low, high],
        "parameters": parameters(one.fit, (one.name,)),
        "note": _note(one, base),
    }


def _note(one: Candidate, base: Fit) -> str:
    """What a fit shows of itself: that nothing moves, or that it ends at a bound."""
    own = [i for i, f in enumerate(one.fit.free) if f.name.startswith(f"{one.name}.")]
    moved = max(float(np.abs(s[:, own]).max()) for s in one.fit.slopes.innovation)
    if moved == 0.0:
        return "moves no output"
    ends = [one.fit.theta[i] in (one.fit.free[i].low, one.fit.free[i].high) for i in own]
    return "at a bound" if any(ends) and one.fit.objective > base.objective else ""


def _still_needed(model: LogModel, told: Named) -> Named:
    """Without the effects that those found after them have made superfluous."""
    found = told.found
    for name in found.hypothesis[:-1]:
        rest = tuple(n for n in found.hypothesis if n != name)
        known = dict(zip(found.names, found.theta, strict=True))
        start = np.array([known[f.name] for f in model.free(rest)])
        without, _ = settled(model, fit(model, rest, found.episodes, start))
        again = candidate(without, name, found)
        chance = next(r["threshold_nats"] for r in told.rounds if r.get("chosen") == name)
        if held_out(without, found).sum() <= chance or again.gain_interval()[0] <= 0.0:
            found = without
    kept = {n: w for n, w in told.weights.items() if n in found.hypothesis}
    rivals = _still_open(found, told.rivals)
    return Named(told.base, found, told.rounds, rivals, kept, told.unsettled)


def _still_open(found: Fit, rivals: tuple[str, ...]) -> tuple[str, ...]:
    """A class without its members' elaborations; () where more than one of it was found."""
    if sum(n in found.hypothesis for n in rivals) != 1:
        return ()
    own = next(n for n in rivals if n in found.hypothesis)
    left = tuple(n for n in rivals if n == own or not elaborates(n, own))
    return left if len(left) > 1 else ()


def verdict_of(told: Named) -> str:
    """The answer in a word: named, class, none or unknown."""
    if told.rivals:
        return "class" if len(told.rivals) <= MOST_IN_CLASS else "unknown"
    if told.found.hypothesis:
        return "named"
    rejected = (e for r in told.rounds for e in r["ranking"] if "forecast" in e)
    doubtful = any(e["forecast"]["share"] > _UNEXPLAINED for e in rejected)
    return "unknown" if doubtful else "none"


def found_document(model: LogModel, base: Fit) -> dict[str, Any]:
    """Where system and logs disagree, as `find.json` has it."""
    places = find_places(model, base)  # type: ignore[arg-type]
    return {
        "domain": model.name,
        "episodes": [b.name for b in model.blocks],
        "sealed": [model.blocks[e].name for e in model.sealed()],
        "where": [vars(p) for p in places],
        "constants": _constants(model, base),
    }


def named_document(model: LogModel, told: Named) -> dict[str, Any]:
    """Which effects, as `name.json` has it."""
    own = parameters(told.found, told.found.hypothesis)
    return {
        "domain": model.name,
        "verdict": verdict_of(told),
        "class": list(told.rivals),
        "threshold_nats": told.rounds[0]["threshold_nats"] if told.rounds else 0.0,
        "effects": [_effect(told, name, own) for name in told.found.hypothesis],
        "parameters": own,
        "constants": _constants(model, told.found),
        "rounds": told.rounds,
        "unsettled": list(told.unsettled),
    }


def shown_document(model: LogModel, told: Named) -> dict[str, Any]:
    """The gap before and after on sealed blocks, and what the page shows beside it."""
    sealed = model.sealed()
    before, after = (errors(model, f, sealed) for f in (told.base, told.found))
    weight = weighed(model, told.base, told.found, sealed)
    return {
        "gap": {
            name: {"before": before[c], "after": after[c], "unit": unit}
            for c, (name, unit) in enumerate(model.channels)
        },
        "forecast_s": model.horizon * model.dt_s,
        "removed": asdict(weight),
        "white": {"before": whiteness(model, told.base), "after": whiteness(model, told.found)},  # type: ignore[arg-type]
        "shown": shown(model, told.base, told.found, sealed),  # type: ignore[arg-type]
        "doubted": [],
    }


def errors(model: LogModel, fitted: Fit, episodes: Sequence[int]) -> list[float]:
    """Root mean square of measured less forecast, by output."""
    parts = np.concatenate(model.disagreements(fitted, episodes), axis=1)
    return [float(np.sqrt(np.nanmean(row**2))) for row in parts]


def _effect(told: Named, name: str, own: dict[str, dict[str, Any]]) -> dict[str, Any]:
    mine = {k.split(".", 1)[1]: v for k, v in own.items() if k.startswith(f"{name}.")}
    return {"name": name, "parameters": mine, "forecast": asdict(told.weights[name])}


def _constants(model: LogModel, fitted: Fit) -> dict[str, dict[str, Any]]:
    """Every constant that was fitted, with its interval."""
    told = {}
    for free in fitted.free:
        if free.name.startswith("constant."):
            low, high = fitted.interval(free.name)
            value = {"value": fitted.value(free.name), "low": low, "high": high}
            told[free.name.removeprefix("constant.")] = value | {"unit": free.unit}
    return told
