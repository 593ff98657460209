"""The sentences behind a verdict, in the order in which a reader asks for them.

In: the summary of a folder. Out: sentences.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from wakedeploy.gap.few_flights import cannot_tell, in_words, these, unconfirmed
from wakedeploy.gap.report.mattering import (
    explainable_sentences,
    form_sentences,
    repeated_sentences,
    small_rest_sentences,
    unsettled_sentences,
    withdrawn_sentences,
    worth_sentences,
)
from wakedeploy.gap.report.phrases import (
    coordinate,
    detectable_sizes,
    place_words,
    undetectable,
    untold,
    whiteness_words,
)
from wakedeploy.gap.report.shrinkage import flight_count, gap_channel, placebo, shrinking
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import White
from wakedeploy.gap.search.places import forbids_none
from wakedeploy.gap.systems.gantry.artefacts import Summary
from wakedeploy.gap.systems.gantry.findings import (
    Detectable,
    Effect,
    Expression,
    Leading,
    Retraining,
    Sized,
)
from wakedeploy.gap.wording import (
    confidence,
    counted,
    listed,
    measured,
    minus,
    probability,
    quantity,
    spoken,
)
from wakedeploy.physics.effects import LIBRARY

_NEEDS_NO_AT = ("at ", "above ", "below ", "between ", "everywhere")
_MUCH_MORE = 3.0  # times what the thresholds were simulated for
_MOST = 8  # of a long list on the terminal; the report shows all


def evidence(summary: Summary) -> list[str]:
    """The sentences that follow the verdict, in the order in which a reader asks for them."""
    if cannot_tell(flight_count(summary)):
        return _hints(summary)
    sentences = _values(summary)
    sentences += withdrawn_sentences(summary) + small_rest_sentences(summary.small)
    sentences += explainable_sentences(summary)
    if summary.verdict == "class":
        sentences += worth_sentences(summary.worth, "The best of them") + _splitting(summary)
    if summary.verdict == "unknown":
        sentences += _part(summary.beside) + _rest(summary.unknown) + worth_sentences(summary.worth)
    sentences += (
        form_sentences(summary) + repeated_sentences(summary) + unsettled_sentences(summary)
    )
    sentences += _place(summary)
    sentences += shrinking(summary) + placebo(summary) + _retraining(summary)
    if summary.verdict == "none":
        sentences += _fitted_anew(summary.white_before) + _detectable(summary.detectable)
    return sentences + _caveats(summary) + _doubts(summary)


def _hints(summary: Summary) -> list[str]:
    """What too few flights show, none of it a conclusion."""
    sentences = leading_sentences(summary) + _sizes_if(summary.members) + _place(summary)
    sentences += _more_than_noise(summary) + shrinking(summary)
    if summary.leading is not None and summary.leading.clear:
        sentences.append("In brackets: 90 % intervals.")
        sentences.append("No flight was kept apart: the error with it may look smaller than it is.")
    return sentences + _bent(summary) + _doubts(summary)


def leading_sentences(summary: Summary) -> list[str]:
    """Which effect explains the most of few flights, by how much, and why that is not enough."""
    leading = summary.leading
    if leading is None or not leading.names or math.isnan(leading.gain_nats):
        return []
    names, flights = leading.names, flight_count(summary)
    if leading.gain_nats <= 0.0:
        return [f"No effect stands out: none gains anything in {these(flights)}."]
    gains = f"{_nats(leading.gain_nats)} nats in {these(flights)}"
    if not leading.clear:
        return [f"No effect stands out: the best, {names[0]}, gains {gains}{_by_chance(leading)}."]
    several = len(names) > 1
    more = f" ({listed(leading.others)} nearly as much)" if leading.others else ""
    lead = f"{listed(names)} lead: they gain about" if several else f"{names[0]} leads: it gains"
    after = f", the next, {leading.next}, {_nats(leading.next_nats)}" if leading.next else ""
    what = "which it is" if several else "it"
    verb = "tell" if several else "confirm"
    return [
        f"{lead} {gains}{more}{after}{_by_chance(leading)}. "
        f"{in_words(flights).capitalize()} cannot {verb} {what}."
    ]


def _nats(gain: float) -> str:
    return minus(f"{gain:.{0 if abs(gain) >= 10.0 else 1}f}")


def _by_chance(leading: Leading) -> str:
    """What an effect has to gain before it is more than chance."""
    if math.isnan(leading.threshold_nats):
        return "; what chance alone gives on this rig is not simulated yet"
    return f"; chance alone gives up to {leading.threshold_nats:.1f}"


def _fitted_anew(white: White | None) -> list[str]:
    """Why nothing is missing although the first fit of the rig file left more than noise."""
    if white is None or white.passes:
        return []
    return ["Noise and calibration, fitted anew beside the effects tried, leave only noise."]


def _more_than_noise(summary: Summary) -> list[str]:
    """That few flights as a whole do not look like noise under the rig file as it is."""
    white = summary.white_before
    if white is None or white.passes:
        return []
    whole = f"Taken as a whole, {these(flight_count(summary))} left more than noise"
    return [f"{whole} under the rig file as it is ({whiteness_words(white)})."]


def _values(summary: Summary) -> list[str]:
    """One sentence per effect: its values, how sure the name is, its physics; then of a class."""
    sentences = []
    for effect in summary.effects:
        values = _spoken_values(effect)
        if not math.isnan(effect.confidence) and not unconfirmed(flight_count(summary)):
            values.append(f"{confidence(effect.confidence)} sure")
        physics = f" {LIBRARY[effect.name].physics}" if effect.name in LIBRARY else ""
        sentences.append(f"{effect.name}: {', '.join(values) or 'without parameters'}.{physics}")
        sentences += worth_sentences(effect.worth) + _at_bound(effect) + _may_be_nothing(effect)
    return sentences + _sizes_if(summary.members)


def _spoken_values(effect: Sized) -> list[str]:
    return [
        f"{spoken(name)} {measured(size.value, size.low, size.high, size.unit)}"
        for name, size in effect.parameters.items()
    ]


def _sizes_if(members: Sequence[Effect]) -> list[str]:
    """The sizes of each effect of a class, or of those that lead."""
    return [
        f"If it is {member.name}: {', '.join(_spoken_values(member)) or 'without parameters'}."
        for member in members
    ]


def _may_be_nothing(effect: Sized) -> list[str]:
    """That an effect gained what it must, and the flights still do not agree that it is there."""
    sizes = effect.parameters.values()
    if not sizes or not all(size.holds_neutral for size in sizes):
        return []
    return [
        f"Doubt {effect.name}: its interval reaches to where it changes nothing, so the "
        "flights do not agree on it; more of them would tell."
    ]


def _at_bound(effect: Sized) -> list[str]:
    """That sizes of an effect are the library's bounds rather than estimates."""
    ends = [spoken(name) for name, size in effect.parameters.items() if size.at_bound]
    if not ends:
        return []
    stand = "stand at the ends of their ranges" if ends[1:] else "stands at the end of its range"
    return [
        f"The {listed(ends)} of {effect.name} {stand}: the effect may have another shape, "
        "or be stronger than the library allows."
    ]


def _splitting(summary: Summary) -> list[str]:
    plan = summary.plan
    split_by = ((plan.sentence if plan else "") or summary.split_by).rstrip(".")
    asked = "`wakedeploy gap plan`, with the same --rig and --out,"
    if plan is not None and plan.manoeuvre:
        flown = "writes it with --write-reference FILE, which `run-gantry --reference` flies"
        return [f"What would tell them apart: {split_by}.", f"{asked} {flown}."]
    if not split_by:
        return [f"{asked} looks for the manoeuvre that would tell them apart."]
    return [
        f"What would tell them apart: {split_by}.",
        f"{asked} looks for the manoeuvre that does it fastest.",
    ]


def _part(known: Sequence[Sized]) -> list[str]:
    """The effects that explain a part of what is unknown."""
    if not known:
        return []
    names = listed([effect.name for effect in known])
    bounds = [sentence for effect in known for sentence in _at_bound(effect)]
    which = "which are not added by themselves" if known[1:] else "which is not added by itself"
    return [f"A part of it looks like {names}, {which}.", *bounds]


def _rest(unknown: Expression | None) -> list[str]:
    """What is known of an effect without a name."""
    sentences = []
    if unknown is not None and unknown.coordinates:
        names = listed([coordinate(c) for c in unknown.coordinates])
        sentences.append(f"What is left depends on the {names}.")
    expression = "" if unknown is None else unknown.text or unknown.expression
    if unknown is not None and expression:
        gain = unknown.gain_nats
        gains = "" if math.isnan(gain) else f", which explains {gain:.0f} nats of it"
        sentences.append(f"As an expression{gains}: {expression}")
    return sentences


def _place(summary: Summary) -> list[str]:
    """Where the disagreement is strongest, in words that the verdict can stand beside."""
    places = [p for p in summary.places or () if p.q_value <= RULES.false_discoveries]
    few = cannot_tell(flight_count(summary))
    claims = summary.claims and not few
    if not places:
        known = summary.places is not None
        return ["No single place stands out: it shows in the flights as a whole."] * (
            known and claims
        )
    words, q = place_words(places[0]), probability("q", places[0].q_value)
    at = "" if words.startswith(_NEEDS_NO_AT) else "at "
    if claims:
        return [f"It shows most ({q}) {at}{words}."]
    if few and forbids_none(places):
        alone = flight_count(summary) == 1
        subject = f"{these(flight_count(summary)).capitalize()} disagree{'s' * alone}"
        most = f"{subject} most with the rig file ({q}) {at}{words}"
        return [f"{most}; whether others would, {'it' if alone else 'they'} cannot tell."]
    return [f"Too little to say that something is missing ({q}): {words}."]


def _of_the_ratio(scores: Retraining) -> str:
    """What the flights say of new over old; nothing of one flight alone."""
    if scores.ratio_interval is None:
        return ""
    low, high = scores.ratio_interval
    sentence = f" That is {scores.ratio:.2f} of it, {low:.2f} to {high:.2f} over flights"
    return f"{sentence}: they cannot tell whether it helps." if low < 1.0 < high else f"{sentence}."


def _retraining(summary: Summary) -> list[str]:
    scores = summary.retrain
    if scores is None:
        return []
    old, new = (quantity(error, scores.unit) for error in (scores.old_rmse, scores.new_rmse))
    count = len(scores.scored_on)
    if summary.in_sample or summary.cross_validated:
        where = "on the very flights that the effect was found in"
    else:
        where = f"on {counted(count, 'sealed flight')}" if count else "on measured data"
    sentence = f"A predictor trained on the corrected rig errs by {new} {where}; before, {old}."
    sentence += _of_the_ratio(scores)
    by_old = scores.by_old_label
    if by_old is not None:
        old, new = (quantity(error, scores.unit) for error in (by_old.old_rmse, by_old.new_rmse))
        sentence += (
            " The force there is measured with the corrected rig; by the force that the old one "
            f"measures, {new} and {old}."
        )
    return [sentence]


def _detectable(sizes: Mapping[str, Detectable]) -> list[str]:
    """What would have been seen, had it been there."""
    found, hidden = detectable_sizes(sizes), undetectable(sizes)
    blind = [f"No plausible size of these would have shown: {listed(hidden)}."] if hidden else []
    if bent := untold(sizes):
        blind.append(f"From which size these would have shown is not known: {listed(bent)}.")
    if not found:
        return blind
    shown = [f"{name}, {parameter} off by {size}" for name, parameter, size in found[:_MOST]]
    more = len(found) - len(shown)
    tail = f"; {more} more in the report" if more > 0 else ""
    return [f"What these flights would have shown: {'; '.join(shown)}{tail}.", *blind]


def _caveats(summary: Summary) -> list[str]:
    sentences = []
    _, channel = gap_channel(summary)
    if summary.effects or (channel is not None and not math.isnan(channel.before_interval[0])):
        sentences.append("In brackets: 90 % intervals.")
    if summary.in_sample or summary.cross_validated:
        few = "There were too few flights to seal any: the gap may look smaller than it is."
        sentences.append(few)
    flown_s = sum(log.seconds for log in summary.logs if log.path in summary.split.fit)
    if flown_s > _MUCH_MORE * summary.threshold_of_s:
        sentences.append(
            f"The thresholds were simulated for {summary.threshold_of_s:.0f} s of flight, these "
            f"are {flown_s:.0f} s: what is approximate in the model shows more in so many, and an "
            "effect that barely passed may be that."
        )
    sentences += _bent(summary)
    white = summary.white
    if white is not None and not white.passes and summary.verdict == "unknown":
        sentences.append(f"What is left over is not white noise ({whiteness_words(white)}).")
    return sentences


def _bent(summary: Summary) -> list[str]:
    """Constants that had to be bent: errors are those of the rig file as recalibrated by this."""
    flights = flight_count(summary)
    few = cannot_tell(flights)
    agree = (
        f"{these(flights).capitalize()} agree{'s' * (flights == 1)}" if few else "The flights agree"
    )
    return [
        f"{agree} only with {bent.name} at {bent.fitted:.3g}, where "
        f"the rig file has {bent.stated:.3g} ± {bent.spread:.2g} "
        f"({bent.away_sd:.1f} of its spreads away); errors told here are with it."
        f"{'' if few else ' Calibrate it again.'}"
        for bent in summary.calibration
    ]


def _doubts(summary: Summary) -> list[str]:
    """What the flights leave open, or what had to be assumed of them, each said once."""
    sentences = [log.sentence for log in summary.unflown]
    for doubt in dict.fromkeys(note for log in summary.logs for note in log.notes):
        names = [Path(log.path).name for log in summary.logs if doubt in log.notes]
        where = "every flight" if len(names) == len(summary.logs) else listed(names)
        sentences.append(f"In {where}: {doubt}.")
    return sentences
