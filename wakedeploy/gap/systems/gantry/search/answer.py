"""What `name.json` says of an answer: sizes, gains, who could be taken for whom, and the noise.

In: an `Answer`. Out: the artefact of `name`, and the fits beside it.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.gap.evidence.inference import Fit
from wakedeploy.gap.evidence.separation import gather, loss_nats
from wakedeploy.gap.folder import forget, write_step
from wakedeploy.gap.rules import MOST_IN_CLASS
from wakedeploy.gap.systems.gantry.effect_force import force_of
from wakedeploy.gap.systems.gantry.search.detectability import detectable
from wakedeploy.gap.systems.gantry.search.naming import Answer, Round
from wakedeploy.gap.systems.gantry.search.saved_fits import Found
from wakedeploy.gap.systems.gantry.search.threshold import FLIGHTS, SECONDS
from wakedeploy.physics.effects import LIBRARY

_CONFUSED = 14  # effects in the picture of what can be told apart
_NEAR_TOP = 5  # of a ranking; what comes after it decides nothing
_BENT_SD = 3.0  # of twenty constants, chance bends one as far in one rig of twenty


def write_answer(
    answer: Answer, out: Path, started_s: float, is_simulated: bool = True
) -> dict[str, Any]:
    """Write `name.json`, and the fits beside it; the search began at `started_s`, monotonic.

    `is_simulated` says that the thresholds are the rig's own. What only a verdict can stand on, as
    how sure a name is and what would have been detected, an inconclusive answer leaves out.
    """
    concluded = answer.verdict != "inconclusive"
    told = {
        "verdict": answer.verdict,
        "effects": [_effect(answer, n) for n in answer.effects],
        "class": list(answer.members),
        "more_classes": [list(members) for members in answer.classes[1:]],
        "others": _others(answer),
        "leading": None if concluded else _leading(answer, is_simulated),
        "untried": [] if concluded else _untried(answer),
        "split_by": _split_by(answer),
        "rounds": [_round(r, concluded, is_simulated) for r in answer.rounds],
        "confusion": _confusion(answer) if concluded else {},
        "detectable": detectable(answer) if concluded else {},
        "unknown": answer.unknown.as_json() if answer.unknown is not None else None,
        "rest": _rest(answer),
        "closest": _closest(answer),
        "form_exact": answer.rest is None and answer.white.passes(answer.thresholds.whiteness),
        "unsettled": unsettled(answer),
        "together": [
            {"name": n, "parameters": sizes_of(answer.fit, n)}
            for n in answer.fit.hypothesis
            if n in LIBRARY
        ],
        "beside": [{"name": n, "parameters": sizes_of(answer.fit, n)} for n in _beside(answer)],
        "calibration": bent(answer.fit),
        "white": answer.white.as_json(answer.thresholds.whiteness),
        "fitted_flights": answer.model.episodes,
        "threshold_of_s": FLIGHTS * SECONDS,
        "noise": _noise(answer.fit),
        "seconds": time.monotonic() - started_s,
    }
    forget(out, "name")
    Found.of(answer).write(out)
    return write_step(out, "name", told)


def _effect(answer: Answer, effect: str) -> dict[str, Any]:
    best_in = [r for r in answer.rounds if r.found == effect]
    searched = best_in[0] if best_in else answer.rounds[0]
    found = next(c for c in searched.ranking if c.name == effect)
    return {
        "name": effect,
        "confidence": searched.confidence(found),
        "gain_nats": found.gain_nats,
        "parameters": sizes_of(answer.fit, effect),
    }


def sizes_of(fitted: Fit, effect: str) -> dict[str, dict[str, Any]]:
    """The parameters of one of a fit's effects, with 90 % intervals.

    `at_bound` is only with those that stand at an end of the library's range, `holds_neutral` with
    others whose interval reaches to where the parameter changes nothing.
    """
    told = {}
    for p in LIBRARY[effect].parameters:
        name = f"{effect}.{p.name}"
        low, high = fitted.interval(name)
        told[p.name] = {"value": fitted.value(name), "low": low, "high": high, "unit": p.unit}
        free = next(f for f in fitted.free if f.name == name)
        # An end of the range is no estimate; not so zero, nor where the parameter changes nothing.
        if fitted.value(name) in {free.low, free.high} - {0.0, free.neutral}:
            told[p.name]["at_bound"] = True
        elif low <= free.neutral <= high:
            told[p.name]["holds_neutral"] = True
    return told


def bent(fitted: Fit) -> list[dict[str, Any]]:
    """Calibrated constants that the flights want far from where the rig file has them."""
    told = []
    for f, value in zip(fitted.free, fitted.theta, strict=True):
        away_sd = abs(float(value) - f.neutral) / f.prior_sd
        if f.quantity == f.name and away_sd > _BENT_SD:
            one = {"name": f.name, "stated": f.neutral, "spread": f.prior_sd}
            told.append(one | {"fitted": float(value), "away_sd": away_sd})
    return sorted(told, key=lambda one: -float(one["away_sd"]))


def _closest(answer: Answer) -> str:
    """Of an unknown, the known effect that gains most alone, if it gains enough; or ""."""
    best = answer.rounds[0].ranking[0]
    leads = answer.verdict == "unknown" and best.gain_nats >= answer.rounds[0].least_nats
    return best.name if leads else ""


def _rest(answer: Answer) -> dict[str, Any] | None:
    """What is left beyond the effects, with the size of its force along the flights."""
    if answer.rest is None:
        return None
    force_n = force_of(answer.model, answer.rest.fit, answer.rest.terms)
    return answer.rest.as_json() | {"force_n": force_n}


def unsettled(answer: Answer) -> list[str]:
    """Effects near the top of a ranking whose fit did not converge, or never left its start."""
    names = []
    for searched in answer.rounds:
        near = [c for c in searched.ranking[:_NEAR_TOP] if c.gain_nats > 0.0]
        names += [c.name for c in near if not c.fit.converged or _unmoved(c.fit, c.name)]
    names += [n for n in answer.fit.hypothesis if not answer.fit.converged]
    return list(dict.fromkeys(names))


def _unmoved(fitted: Fit, effect: str) -> bool:
    """Whether all of an effect's parameters stand exactly where they are neutral."""
    own = [f for f in fitted.free if f.name.startswith(f"{effect}.")]
    return all(abs(fitted.value(f.name) - f.neutral) < 1e-9 * f.prior_sd for f in own)


def _beside(answer: Answer) -> list[str]:
    """Effects that explain a part of what is unknown, also beside its expression, if it has one."""
    return [n for n in answer.fit.hypothesis if n in LIBRARY and answer.verdict == "unknown"]


def _leading(answer: Answer, is_simulated: bool) -> dict[str, Any]:
    """The effects that few flights speak for most and do not tell apart, and what comes after.

    `clear` says that they gain more than noise and calibration alone.
    """
    (searched,) = answer.rounds
    after = next((c for c in searched.ranking if c not in searched.near), None)
    return {
        "clear": bool(searched.found),
        "names": [c.name for c in searched.rivals],
        "others": [c.name for c in searched.near[MOST_IN_CLASS:]],
        "gain_nats": searched.near[0].gain_nats,
        "next": after.name if after is not None else None,
        "next_nats": after.gain_nats if after is not None else None,
        "threshold_nats": searched.least_nats if is_simulated else None,
    }


def _untried(answer: Answer) -> list[str]:
    """Effects of the library that neither the ranking nor the rig file has."""
    known = {c.name for c in answer.rounds[0].ranking} | {e.name for e in answer.model.rig.effect}
    return [name for name in LIBRARY if name not in known]


def _round(searched: Round, concluded: bool, is_simulated: bool) -> dict[str, Any]:
    ranking = []
    for c in searched.ranking:
        ends = (end if np.isfinite(end) else None for end in c.gain_interval())
        ranking.append(
            {
                "name": c.name,
                "gain_nats": c.gain_nats,
                "interval": list(ends),
                "confidence": searched.confidence(c) if concluded else None,
                "parameters": sizes_of(c.fit, c.name),
            }
        )
    return {
        "given": list(searched.given),
        "found": searched.found,
        "near_nats": searched.near_nats,
        "threshold_nats": searched.least_nats if is_simulated else None,
        "ranking": ranking,
    }


def _confusion(answer: Answer) -> dict[str, Any]:
    """How well each leading effect could be imitated by each other one, at the size found."""
    first = answer.rounds[0]
    leading = list(first.ranking[:_CONFUSED])
    sizes = {
        c.name: [c.fit.value(f"{c.name}.{p.name}") for p in LIBRARY[c.name].parameters]
        for c in leading
        if c.gain_nats > answer.thresholds.effect_nats
    }
    names = [c.name for c in leading]
    evidence = gather(answer.base_model, answer.base, names, sizes)
    return {"names": names, "loss_nats": loss_nats(evidence).tolist()}


def _noise(fitted: Fit) -> dict[str, Any]:
    told = {}
    for i, f in enumerate(fitted.free):
        if f.name.startswith("noise.log_"):
            told[f.name.removeprefix("noise.log_")] = {
                "value": float(np.exp(fitted.theta[i])),
                "unit": _NOISE_UNITS[f.name.removeprefix("noise.log_")],
            }
    return told


_NOISE_UNITS = {
    "acceleration": "m/s^2 sqrt(s)",
    "turbulence": "of the wake's force",
    "turbulence_time": "s",
    "range": "m",
}


def _split_by(answer: Answer) -> str:
    known = [LIBRARY[m].split_by for m in answer.members if LIBRARY[m].split_by]
    return "; or ".join(dict.fromkeys(known))


def _others(answer: Answer) -> list[str]:
    """What is as near as the members of a class, beyond the three that it lists."""
    found = [r for r in answer.rounds if r.found in answer.members]
    return [c.name for c in found[0].near[MOST_IN_CLASS:]] if found else []
