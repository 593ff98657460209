"""What `name.json` says of an answer: sizes, gains, likely confusions, and the noise.

In: an `Answer`. Out: the artefact of `name`.
"""

import math
import time

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, own_parameters, told_by_data
from wakedeploy.gap.evidence.separation import gather, loss_nats
from wakedeploy.gap.search.artefacts import Quantity, White
from wakedeploy.gap.systems.gantry.artefacts import Name
from wakedeploy.gap.systems.gantry.effect_force import force_of
from wakedeploy.gap.systems.gantry.findings import (
    Bent,
    Confusion,
    Effect,
    Expression,
    Leading,
    Ranked,
    Size,
    Sized,
    Sizes,
)
from wakedeploy.gap.systems.gantry.findings import Round as RoundTold
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.detectability import detectable
from wakedeploy.gap.systems.gantry.search.outcome import Answer, Round
from wakedeploy.gap.systems.gantry.search.threshold import FLIGHTS, SECONDS
from wakedeploy.physics.effects import LIBRARY

_CONFUSED = 14  # effects in the picture of confusions
_NEAR_TOP = 5  # of a ranking; what comes after them decides nothing


def told_of(answer: Answer, started_s: float, is_simulated: bool = True) -> Name:
    """What `name.json` says; the search began at `started_s`, monotonic.

    `is_simulated` says that the thresholds are the rig's own. An inconclusive answer leaves out
    what only a verdict can rest on: how sure a name is, and what would have been detected.
    """
    concluded = answer.verdict != "inconclusive"
    return Name(
        verdict=answer.verdict,
        effects=[_effect(answer, n) for n in answer.effects],
        rivals=list(answer.members),
        more_classes=[list(members) for members in answer.classes[1:]],
        others=_others(answer),
        leading=None if concluded else _leading(answer, is_simulated),
        untried=[] if concluded else _untried(answer),
        split_by=_split_by(answer),
        rounds=[_round(r, concluded, is_simulated) for r in answer.rounds],
        confusion=_confusion(answer) if concluded else Confusion(),
        detectable=detectable(answer) if concluded else {},
        unknown=answer.unknown.as_artefact if answer.unknown is not None else None,
        rest=_rest(answer),
        closest=_closest(answer),
        form_exact=answer.rest is None and answer.white.passes(answer.thresholds.whiteness),
        unsettled=unsettled(answer),
        together=[_sized(answer.fit, n) for n in answer.fit.hypothesis if n in LIBRARY],
        beside=[_sized(answer.fit, n) for n in _beside(answer)],
        calibration=bent(answer.fit),
        white=White(**answer.white.as_json(answer.thresholds.whiteness)),
        fitted_flights=answer.model.episodes,
        threshold_of_s=FLIGHTS * SECONDS,
        noise=_noise(answer.fit),
        seconds=time.monotonic() - started_s,
    )


def _effect(answer: Answer, effect: str) -> Effect:
    best_in = [r for r in answer.rounds if r.found == effect]
    searched = best_in[0] if best_in else answer.rounds[0]
    found = next(c for c in searched.ranking if c.name == effect)
    return Effect(
        name=effect,
        confidence=searched.confidence(found),
        gain_nats=found.gain_nats,
        parameters=sizes_of(answer.fit, effect),
    )


def _sized(fitted: Fit, effect: str) -> Sized:
    return Sized(name=effect, parameters=sizes_of(fitted, effect))


def sizes_of(fitted: Fit, effect: str) -> Sizes:
    """The parameters of one of a fit's effects by the flights, with 90 % intervals."""
    fitted = told_by_data(fitted, effect)
    return {p.name: _size(fitted, f"{effect}.{p.name}", p.unit) for p in LIBRARY[effect].parameters}


def _size(fitted: Fit, name: str, unit: str) -> Size:
    value, (low, high) = fitted.value(name), fitted.interval(name)
    free = next(f for f in fitted.free if f.name == name)
    # An end of the range is no estimate, unless it is 0 or where the parameter changes nothing.
    at_bound = value in {free.low, free.high} - {0.0, free.neutral}
    holds_neutral = not at_bound and bool(low <= free.neutral <= high)
    return Size(
        value=value, low=low, high=high, unit=unit, at_bound=at_bound, holds_neutral=holds_neutral
    )


def bent(fitted: Fit) -> list[Bent]:
    """Calibrated constants that the flights want far from the rig file's value."""
    found = [
        Bent(
            name=f.name,
            stated=f.neutral,
            spread=f.prior_sd,
            fitted=float(value),
            away_sd=abs(float(value) - f.neutral) / f.prior_sd,
        )
        for f, value in zip(fitted.free, fitted.theta, strict=True)
        if f.quantity == f.name
    ]
    far = [constant for constant in found if constant.away_sd > RULES.bent_sd]
    return sorted(far, key=lambda constant: -constant.away_sd)


def _closest(answer: Answer) -> str:
    """For an unknown, the known effect that gains most alone, if it gains enough; or ""."""
    best = answer.rounds[0].ranking[0]
    leads = answer.verdict == "unknown" and best.gain_nats >= answer.rounds[0].least_nats
    return best.name if leads else ""


def _rest(answer: Answer) -> Expression | None:
    """What is left beyond the effects, with the size of its force along the flights."""
    if answer.rest is None:
        return None
    force_n = force_of(answer.model, answer.rest.fit, answer.rest.terms)
    return answer.rest.as_artefact.model_copy(update={"force_n": force_n})


def unsettled(answer: Answer) -> list[str]:
    """Effects near the top of a ranking whose fit did not converge, or never left its start."""
    names = []
    for searched in answer.rounds:
        near = [c for c in searched.ranking[:_NEAR_TOP] if c.gain_nats > 0.0]
        names += [c.name for c in near if not c.fit.converged or _unmoved(c.fit, c.name)]
    names += [n for n in answer.fit.hypothesis if not answer.fit.converged]
    return list(dict.fromkeys(names))


def _unmoved(fitted: Fit, effect: str) -> bool:
    """Whether all of an effect's parameters are exactly neutral."""
    parameters = own_parameters(fitted.free, effect)
    return all(abs(fitted.value(f.name) - f.neutral) < 1e-9 * f.prior_sd for f in parameters)


def _beside(answer: Answer) -> list[str]:
    """Effects that explain a part of what is unknown, beside an expression if there is one."""
    return [n for n in answer.fit.hypothesis if n in LIBRARY and answer.verdict == "unknown"]


def _leading(answer: Answer, is_simulated: bool) -> Leading:
    """The effects that few flights favour most and cannot tell apart, and what comes after."""
    (searched,) = answer.rounds
    after = next((c for c in searched.ranking if c not in searched.near), None)
    return Leading(
        clear=bool(searched.found),
        names=[c.name for c in searched.rivals],
        others=[c.name for c in searched.near[RULES.most_in_class :]],
        gain_nats=searched.near[0].gain_nats,
        next=after.name if after is not None else None,
        next_nats=after.gain_nats if after is not None else math.nan,
        threshold_nats=searched.least_nats if is_simulated else math.nan,
    )


def _untried(answer: Answer) -> list[str]:
    """Effects of the library that are neither in the ranking nor in the rig file."""
    known = {c.name for c in answer.rounds[0].ranking} | {e.name for e in answer.model.rig.effect}
    return [name for name in LIBRARY if name not in known]


def _round(searched: Round, concluded: bool, is_simulated: bool) -> RoundTold:
    return RoundTold(
        given=list(searched.given),
        found=searched.found,
        near_nats=searched.near_nats,
        threshold_nats=searched.least_nats if is_simulated else math.nan,
        ranking=[
            Ranked(
                name=c.name,
                gain_nats=c.gain_nats,
                interval=c.gain_interval(),
                confidence=searched.confidence(c) if concluded else math.nan,
                parameters=sizes_of(c.fit, c.name),
            )
            for c in searched.ranking
        ],
    )


def _confusion(answer: Answer) -> Confusion:
    """How well each other effect could imitate each leading one, at the size found."""
    first = answer.rounds[0]
    leading = list(first.ranking[:_CONFUSED])
    sizes = {
        c.name: [c.fit.value(f"{c.name}.{p.name}") for p in LIBRARY[c.name].parameters]
        for c in leading
        if c.gain_nats > answer.thresholds.effect_nats
    }
    names = [c.name for c in leading]
    evidence = gather(answer.base_model, answer.base, names, sizes)
    return Confusion(names=names, loss_nats=loss_nats(evidence).tolist())


def _noise(fitted: Fit) -> dict[str, Quantity]:
    return {
        f.name.removeprefix(_NOISE): Quantity(
            value=float(np.exp(value)), unit=_NOISE_UNITS[f.name.removeprefix(_NOISE)]
        )
        for f, value in zip(fitted.free, fitted.theta, strict=True)
        if f.name.startswith(_NOISE)
    }


_NOISE = "noise.log_"
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
    """Effects as near as the members of a class, beyond the three that it lists."""
    found = [r for r in answer.rounds if r.found in answer.members]
    return [c.name for c in found[0].near[RULES.most_in_class :]] if found else []
