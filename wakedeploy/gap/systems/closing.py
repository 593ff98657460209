"""Find, name and show for a domain: places, verdict, and the error on episodes not used before.

In: a `ResponseModel`. Out: an `Account` of plain numbers, as JSON has them. Every fourth episode
is sealed: it takes no part in fitting or ranking, and is only used to show the error before and
after. An effect is accepted if its held-out gain exceeds the largest gain that any effect had in
simulations of the fitted base (one in twenty would exceed it by chance) and if the gain's interval
over the episodes lies above zero.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.inference import Fit, Hypothesis, extended, fit, held_out
from wakedeploy.gap.evidence.ranking import Candidate, rank
from wakedeploy.gap.progress import Progress, Steps, quiet, uncounted
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.systems.before_after import shown
from wakedeploy.gap.systems.gantry.search.naming import CLASS_NATS, MOST_IN_CLASS
from wakedeploy.gap.systems.places import Place, find_places, whiteness
from wakedeploy.gap.systems.response import ResponseModel

SEALED_EVERY = 4
MOST_EFFECTS = 6
SIMULATIONS = 19  # the largest of 19 is exceeded by one further draw in twenty


@dataclass(frozen=True)
class Account:
    """What was found in a domain. `error` is the rms residual on the sealed episodes."""

    verdict: str
    effects: tuple[str, ...]
    rivals: tuple[str, ...]
    places: tuple[Place, ...]
    document: dict[str, Any]


def required(path: Path | None, domain: str) -> Path:
    """The path, or UnusableInput for none."""
    if path is None:
        raise UnusableInput(
            f"{domain}: no path given; give the folder of its recordings, or set WAKEDEPLOY_DATA."
        )
    return path


def close(
    model: ResponseModel,
    *,
    simulations: int = SIMULATIONS,
    seed: int = 0,
    progress: Progress = quiet,
) -> Account:
    """Find, name and show; `progress` is told what is being done.

    Raises UnusableInput for fewer than four episodes.
    """
    if model.episodes < FEWEST_IN_ALL:
        raise UnusableInput(
            f"{model.name}: {model.episodes} episodes; effects are ranked on episodes that they "
            f"were not fitted to, which takes at least {FEWEST_IN_ALL}."
        )
    sealed = tuple(range(SEALED_EVERY - 1, model.episodes, SEALED_EVERY))
    used = tuple(e for e in range(model.episodes) if e not in sealed)
    progress("fitting the baseline")
    base = settled(model, (), used)
    places = find_places(model, base)
    stage = "simulating the baseline for the threshold"
    progress(stage)
    steps = functools.partial(progress, stage)
    threshold = threshold_nats(model, base, simulations, seed, steps)
    rounds, found = _name(model, base, sealed, threshold, progress)
    found = _still_needed(model, found, threshold)
    rivals = _open_class(rounds, found)
    verdict = _verdict(model, base, found, rivals)
    document = _document(model, base, found, sealed, rounds, threshold)
    document |= {"domain": model.name, "verdict": verdict, "class": list(rivals)}
    document |= {"where": [vars(p) for p in places], "shown": shown(model, base, found, sealed)}
    return Account(verdict, found.hypothesis, rivals, tuple(places), document)


def settled(
    model: ResponseModel, hypothesis: Hypothesis, episodes: Sequence[int], start: Fit | None = None
) -> Fit:
    """A fit that is repeated from where it ended until it no longer rises."""
    theta = None if start is None else extended(start, model.free(hypothesis))
    fitted = fit(model, hypothesis, episodes, theta)
    for _ in range(6):
        again = fit(model, hypothesis, episodes, fitted.theta)
        if again.objective - fitted.objective < 0.1:
            return again
        fitted = again
    return fitted


def threshold_nats(
    model: ResponseModel, base: Fit, simulations: int, seed: int, steps: Steps = uncounted
) -> float:
    """The largest held-out gain of any effect in simulations in which none acts."""
    largest = 0.0
    for k in range(simulations):
        twin = model.simulated(base.hypothesis, base.theta, np.random.default_rng([seed, k]))
        again = fit(twin, base.hypothesis, base.episodes, base.theta)
        largest = max(largest, rank(twin, again, tuple(model.effects))[0].gain_nats)
        steps(k + 1, simulations)
    return largest


def _name(
    model: ResponseModel, base: Fit, sealed: tuple[int, ...], threshold: float, progress: Progress
) -> tuple[list[dict[str, Any]], Fit]:
    """Effects one after another; each round has those that cannot be told from what it accepted."""
    rounds: list[dict[str, Any]] = []
    found = base
    while len(found.hypothesis) < MOST_EFFECTS:
        left = [name for name in model.effects if name not in found.hypothesis]
        if not left:
            break
        stage = "ranking effects" + (f" beside {', '.join(found.hypothesis)}" * bool(rounds))
        progress(stage)
        ranking = rank(model, found, left, steps=functools.partial(progress, stage))
        rounds.append(_round(found, ranking, threshold))
        best = ranking[0]
        if best.gain_nats <= threshold or best.gain_interval()[0] <= 0.0:
            break
        least = best.gain_nats - CLASS_NATS
        rounds[-1]["class"] = [c.name for c in ranking if c.gain_nats > least]
        found = settled(model, best.fit.hypothesis, found.episodes, best.fit)
        rounds[-1]["accepted"] = parameters(found, (best.name,), _plain(model, found))
        rounds[-1]["sealed_error"] = errors(model, found, sealed)
    return rounds, found


def _open_class(rounds: Sequence[Mapping[str, Any]], found: Fit) -> tuple[str, ...]:
    """The first class of several effects that one still needed stands for; () if each is alone."""
    for searched in rounds:
        members = searched.get("class", ())
        if len(members) > 1 and members[0] in found.hypothesis:
            return tuple(members)
    return ()


def _still_needed(model: ResponseModel, found: Fit, threshold: float) -> Fit:
    """Without the effects that the ones found after them have made superfluous."""
    for name in found.hypothesis[:-1]:
        rest = tuple(n for n in found.hypothesis if n != name)
        without = settled(model, rest, found.episodes, found)
        if held_out(without, found).sum() <= threshold:
            found = without
    return found


def _verdict(model: ResponseModel, base: Fit, found: Fit, rivals: tuple[str, ...]) -> str:
    # What is named may leave coloured innovations, unlike on the gantry: recordings have no noise
    # model that would pass, and intervals are widened instead.
    if rivals:
        return "class" if len(rivals) <= MOST_IN_CLASS else "unknown"
    if found.hypothesis:
        return "named"
    return "none" if whiteness(model, base)["passes"] else "unknown"


def _round(given: Fit, ranking: list[Candidate], threshold: float) -> dict[str, Any]:
    return {
        "given": list(given.hypothesis),
        "threshold_nats": threshold,
        "ranking": [
            {
                "name": c.name,
                "gain_nats": c.gain_nats,
                "interval": list(c.gain_interval()),
                "parameters": parameters(c.fit, (c.name,)),
            }
            for c in ranking
        ],
    }


def parameters(
    fitted: Fit, effects: Sequence[str], unweighted: Fit | None = None
) -> dict[str, dict[str, Any]]:
    """Value, 90 % interval and unit of the effects' parameters, by `<effect>.<parameter>`.

    Where the innovations are not white, the likelihood is not quite that of these data, and an
    `unweighted` fit by least squares differs from it (Hausman, Econometrica 46, 1978). The
    interval then reaches over what single episodes say under both; `mean_low` and `mean_high`
    stay the interval of the likelihood.
    """
    result = {}
    for i, free in enumerate(fitted.free):
        if free.name.split(".")[0] in effects:
            low, high = fitted.interval(free.name)
            own = {"value": fitted.value(free.name), "low": low, "high": high, "unit": free.unit}
            if unweighted is not None:
                ranges = [_between_episodes(f, i) for f in (fitted, unweighted)]
                own |= {"low": max(min(r[0] for r in ranges), free.low), "mean_low": low}
                own |= {"high": min(max(r[1] for r in ranges), free.high), "mean_high": high}
                own |= {"least_squares": unweighted.value(free.name)}
            result[free.name] = own
    return result


def _between_episodes(fitted: Fit, i: int) -> tuple[float, float]:
    """Where nine in ten episodes would put parameter `i`, the others held.

    One Newton step in each episode, weighted by what the episode tells about the parameter.
    """
    slope = fitted.slopes.gradient()[:, i]
    information = fitted.slopes.fisher()[:, i, i]
    told = information > 1e-3 * information.max()
    variance = np.average((slope[told] / information[told]) ** 2, weights=information[told])
    reach = float(student_t.ppf(0.95, max(int(told.sum()) - 1, 1)) * np.sqrt(variance))
    return float(fitted.theta[i]) - reach, float(fitted.theta[i]) + reach


def _effect(
    name: str, own: dict[str, dict[str, Any]], rounds: list[dict[str, Any]]
) -> dict[str, Any]:
    """A named effect, its parameters without its name, its share of the belief when accepted.

    All effects and "nothing" are equally likely before, "nothing" as if it gained the threshold.
    """
    searched = next(r for r in rounds if r["ranking"][0]["name"] == name)
    ranking = searched["ranking"]
    gains = np.array([searched["threshold_nats"], *(c["gain_nats"] for c in ranking)])
    confidence = float(1.0 / np.exp(gains - ranking[0]["gain_nats"]).sum())
    mine = {k.split(".", 1)[1]: v for k, v in own.items() if k.startswith(f"{name}.")}
    return {"name": name, "confidence": confidence, "parameters": mine}


def _over_rounds(name: str, entry: dict[str, Any], rounds: list[dict[str, Any]]) -> dict[str, Any]:
    """An interval that also holds what was said when the effect was accepted.

    What stands beside an effect moves its parameters by more than their intervals where none of
    the hypotheses makes the innovations white.
    """
    earlier = [r["accepted"][name] for r in rounds if name in r.get("accepted", {})]
    low = min([entry["low"], *(e["low"] for e in earlier)])
    high = max([entry["high"], *(e["high"] for e in earlier)])
    return entry | {"low": low, "high": high}


def _plain(model: ResponseModel, found: Fit) -> Fit | None:
    """The least-squares fit of what was found, where the innovations are not white."""
    if not found.hypothesis or whiteness(model, found)["passes"]:
        return None
    return settled(model.unweighted(), found.hypothesis, found.episodes, found)


def _document(
    model: ResponseModel,
    base: Fit,
    found: Fit,
    sealed: tuple[int, ...],
    rounds: list[dict[str, Any]],
    threshold: float,
) -> dict[str, Any]:
    noise = [f for f in found.free if f.name.startswith("noise.")]
    plain = _plain(model, found)
    own = parameters(found, found.hypothesis, plain)
    if plain is not None:
        own = {name: _over_rounds(name, entry, rounds) for name, entry in own.items()}
    before, after = errors(model, base, sealed), errors(model, found, sealed)
    return {
        "episodes": [r.name for r in model.records],
        "sealed": [model.records[e].name for e in sealed],
        "threshold_nats": threshold,
        "effects": [_effect(name, own, rounds) for name in found.hypothesis],
        "parameters": own,
        "rounds": rounds,
        "gap": {
            name: {"before": before[c], "after": after[c], "unit": unit}
            for c, (name, unit) in enumerate(model.channels)
        },
        "sealed_gain_nats": _sealed_gain(model, base, found, sealed),
        "doubted": _doubted(rounds, before, found),
        "placebo": _placebo(model, base, found, rounds, sealed),
        "white": {"before": whiteness(model, base), "after": whiteness(model, found)},
        "noise": {
            f.name: {"value": float(np.exp(found.value(f.name))), "unit": f.unit} for f in noise
        },
    }


def errors(model: ResponseModel, fitted: Fit, episodes: Sequence[int]) -> list[float]:
    """Root mean square of the residual of each channel, noise neither filtered nor removed."""
    values = model.values(fitted.hypothesis, fitted.theta)
    pieces = [model.residual(values, e) for e in episodes]
    return [float(np.sqrt(np.mean(row**2))) for row in np.concatenate(pieces, axis=1)]


def _doubted(rounds: list[dict[str, Any]], before: list[float], found: Fit) -> list[str]:
    """Effects that gained on the episodes ranked on, and made the error on sealed ones grow."""
    result, error = [], np.array(before)
    for told in (r for r in rounds if "accepted" in r):
        name, now = told["ranking"][0]["name"], np.array(told["sealed_error"])
        if name in found.hypothesis and np.mean(now / error) > 1.0:
            result.append(name)
        error = now
    return result


def _sealed_gain(model: ResponseModel, base: Fit, found: Fit, sealed: Sequence[int]) -> float:
    return sum(
        float(model.score(found.hypothesis, found.theta, e).log_density.sum())
        - float(model.score(base.hypothesis, base.theta, e).log_density.sum())
        for e in sealed
    )


def _placebo(
    model: ResponseModel,
    base: Fit,
    found: Fit,
    rounds: list[dict[str, Any]],
    sealed: Sequence[int],
) -> dict[str, Any] | None:
    """The best wrong effect in place of the right ones, of those that nothing confuses with them.

    Of the first ranking, without what was found and without the members of any round's class.
    """
    claimed = {*found.hypothesis, *(n for r in rounds for n in r.get("class", ()))}
    others = [c["name"] for c in rounds[0]["ranking"] if c["name"] not in claimed]
    if not found.hypothesis or not others:
        return None
    wrong = rank(model, base, others[:1])[0].fit
    after = errors(model, wrong, sealed)
    before = errors(model, base, sealed)
    gain = _sealed_gain(model, base, wrong, sealed)
    return {"name": others[0], "before": before, "after": after, "sealed_gain_nats": gain}
