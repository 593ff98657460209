"""What a search found, as the steps write it: where, which, and how much smaller the gap is.

In: a `Comparison`, its fits, and what was named. Out: the artefacts of `find`, `name` and `show`.
"""

from dataclasses import asdict
from statistics import NormalDist

import numpy as np

from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.inference import applied, fit
from wakedeploy.gap.evidence.whiteness import whiteness
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import (
    Answer,
    BeforeAfter,
    Disagreements,
    Effect,
    Error,
    Forecast,
    Half,
    Measured,
    Placebo,
    Quantity,
    Repeated,
    Size,
    Sizes,
    White,
    WhitePair,
)
from wakedeploy.gap.search.comparison import (
    Comparison,
    errors,
    residual_series,
    searched_on,
    theta_from,
)
from wakedeploy.gap.search.outcome import Named, verdict_of
from wakedeploy.gap.search.places import disagreements
from wakedeploy.gap.search.residual_profiles import profiles
from wakedeploy.gap.search.sizes import joined_sizes
from wakedeploy.gap.search.weighing import unseen, weight_of

_REACH_SD = NormalDist().inv_cdf(RULES.interval_quantile)  # of a normal interval


def found_in(model: Comparison, base: Fit, key: str = "") -> Disagreements:
    """Where system and recordings disagree."""
    maps, places = disagreements(*residual_series(model, base, base.episodes))
    return Disagreements(
        domain=model.name,
        key=key,
        episodes=[r.name for r in model.records],
        sealed=[model.records[e].name for e in model.sealed()],
        where=places,
        maps=maps,
        constants=constants_of(base),
        theta=theta_of(base),
    )


def answer_of(outcome: Named, key: str = "", again: Repeated[Half] | None = None) -> Answer:
    """Which effects are missing, and how large; `again` is what each half of the logs says."""
    model = outcome.model
    sizes = joined_sizes(model, outcome.found, outcome.rounds)
    return Answer(
        domain=model.name,
        key=key,
        verdict=verdict_of(outcome),
        rivals=list(outcome.rivals),
        threshold_nats=outcome.rounds[0].threshold_nats if outcome.rounds else 0.0,
        effects=[_effect(outcome, name, sizes) for name in outcome.found.hypothesis],
        parameters=sizes,
        constants=constants_of(outcome.found),
        stated=_stated(outcome.found),
        unknown=model.unknown_constants(),
        moved=_moved(outcome.found),
        late=model.late_inputs(outcome.base, outcome.found),
        late_by_a_row=model.late_by_a_row(outcome.found),
        shifted=_shifted(outcome),
        curved=model.curved_inputs([*outcome.found.hypothesis, *outcome.rivals]),
        answered={n: model.inputs_answered(outcome.found, n) for n in outcome.found.hypothesis},
        noise=_noise(outcome.found),
        rounds=outcome.rounds,
        unsettled=list(outcome.unsettled),
        unexplained=list(outcome.leftover),
        sealed_gain_nats=_sealed_gain(model, outcome.base, outcome.found),
        placebo=_placebo(model, outcome),
        is_outdone=outcome.is_outdone,
        is_far_ahead=outcome.is_far_ahead,
        found_theta=theta_of(outcome.found),
        base_theta=theta_of(outcome.base),
        repeated=again,
    )


def _shifted(outcome: Named) -> dict[str, Measured]:
    """What a correction has of the inputs' clocks; it has none where no effect is sure."""
    sure = set(outcome.found.hypothesis) - set(outcome.rivals)
    is_in_it = bool(sure) or verdict_of(outcome) in ("named", "class")
    is_in_it &= bool(outcome.found.hypothesis)
    return outcome.model.shifted_inputs(outcome.found) if is_in_it else {}


def _stated(found: Fit) -> dict[str, float]:
    """The constants that were fitted, as the system states them, by name."""
    return {f.quantity: f.neutral for f in found.free if f.name.startswith("constant.")}


def before_after(
    model: Comparison,
    base: Fit,
    found: Fit,
    key: str = "",
    forecast_s: float | None = None,
    near: tuple[Comparison, Fit] | None = None,
) -> BeforeAfter:
    """The gap on sealed episodes, and what the page shows beside it.

    `forecast_s` is how far ahead forecasts reach, if errors are of forecasts. For an answer far
    ahead, `near` is the system that predicts the next reading: the smaller gap before counts.
    """
    sealed = model.sealed()
    was = unseen(model, base)
    before, after = (errors(model, f, sealed) for f in (base, found))
    if near is not None:
        was_near = unseen(*near)
        if weight_of(was, was_near).share > 0.0:
            was, before = was_near, errors(*near, sealed)
    removed = weight_of(was, unseen(model, found))
    return BeforeAfter(
        domain=model.name,
        key=key,
        gap={
            name: Error(before=before[c], after=after[c], unit=unit)
            for c, (name, unit) in enumerate(model.channels)
        },
        removed=Forecast(**asdict(removed)),
        white=WhitePair(before=_white(base), after=_white(found)),
        shown=profiles(model, base, found, sealed),
        forecast_s=forecast_s,
    )


def theta_of(fitted: Fit) -> dict[str, float]:
    """Every parameter of a fit by name."""
    return dict(zip(fitted.names, map(float, fitted.theta), strict=True))


def _white(fitted: Fit) -> White:
    return White(**whiteness(fitted).as_json())


def _sealed_gain(model: Comparison, base: Fit, found: Fit) -> float:
    after, before = (applied(model, f, model.sealed()) for f in (found, base))
    return after.log_likelihood - before.log_likelihood


def _placebo(model: Comparison, outcome: Named) -> Placebo | None:
    """The best wrong effect in place of the right ones, if nothing confuses it with them.

    It is the first of the first ranking that was not found and is in no round's class.
    """
    claimed = {*outcome.found.hypothesis, *(n for r in outcome.rounds for n in r.rivals)}
    wrong = next((c for c in outcome.alone if c.name not in claimed), None)
    if not outcome.found.hypothesis or wrong is None:
        return None
    instead = wrong.fit
    is_of_part = searched_on(model) is not model
    if is_of_part or instead.names != tuple(f.name for f in model.free(instead.hypothesis)):
        start = theta_from(model, instead.hypothesis, instead)  # or it was for the next reading
        instead = fit(model, instead.hypothesis, outcome.base.episodes, start)
    before, after = (errors(model, f, model.sealed()) for f in (outcome.base, instead))
    gain = _sealed_gain(model, outcome.base, instead)
    return Placebo(name=wrong.name, before=before, after=after, sealed_gain_nats=gain)


def _effect(outcome: Named, name: str, all_sizes: Sizes) -> Effect:
    sizes = {k.split(".", 1)[1]: v for k, v in all_sizes.items() if k.startswith(f"{name}.")}
    return Effect(name=name, parameters=sizes, forecast=Forecast(**asdict(outcome.weights[name])))


def constants_of(fitted: Fit) -> Sizes:
    """Every constant that was fitted, with its interval.

    It reaches no farther than what is stated of the constant alone does: where blocks that hardly
    move do not agree, their spread would say less than nothing.
    """
    sizes = {}
    for free in fitted.free:
        if free.name.startswith("constant."):
            value, (low, high) = fitted.value(free.name), fitted.interval(free.name)
            reach = _REACH_SD * free.prior_sd
            low, high = max(low, value - reach), min(high, value + reach)
            size = Size(value=value, low=low, high=high, unit=free.unit)
            sizes[free.name.removeprefix("constant.")] = size
    return sizes


def _moved(fitted: Fit) -> dict[str, float]:
    """Constants far from their stated value, in spreads, as a wrong unit makes them."""
    far = {f.quantity: (v - f.neutral) / f.prior_sd
           for f, v in zip(fitted.free, fitted.theta, strict=True) if f.quantity}  # fmt: skip
    return {name: float(spreads) for name, spreads in far.items() if abs(spreads) > RULES.bent_sd}


def _noise(fitted: Fit) -> dict[str, Quantity]:
    """Noise parameters, which are fitted as logarithms."""
    return {
        f.name: Quantity(value=float(np.exp(fitted.value(f.name))), unit=f.unit)
        for f in fitted.free
        if f.name.startswith("noise.")
    }
