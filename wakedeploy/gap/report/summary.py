"""The result in plain words: what is missing, how sure that is, how much of the gap it closes.

In: `result.json`, or more (see `steps.Steps.summary`). Out: sentences.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wakedeploy.gap.few_flights import cannot_tell, headline, in_words, these, unconfirmed
from wakedeploy.gap.report.first_screen import first_screen
from wakedeploy.gap.report.mattering import (
    NOTHING,
    explainable_sentences,
    form_sentences,
    matters,
    repeated_sentences,
    small_clause,
    small_rest_sentences,
    unsettled_sentences,
    withdrawn_sentences,
    worth_sentences,
)
from wakedeploy.gap.report.shrinkage import flight_count, gap_channel, placebo, shrinking
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.places import forbids_none
from wakedeploy.gap.wording import (
    confidence,
    counted,
    entries,
    listed,
    mapping,
    number,
    parameters_of,
    probability,
    quantity,
    span,
    spoken,
    texts,
    unit_of,
)
from wakedeploy.physics.effects import LIBRARY

_STATED_Q = re.compile(r",? ?\(?q [=<] [0-9.e-]+\)?$")  # at the end of a place's own words
_NEEDS_NO_AT = ("at ", "above ", "below ", "between ", "everywhere")
_MUCH_MORE = 3.0  # times what the thresholds were simulated for
_CLAIMS = ("named", "class", "unknown")  # verdicts by which something is missing
_NOTHING_AT_ALL = "Nothing is missing from the model beyond noise."
_MOST = 8  # of a long list on the terminal; the report shows all


def account(result: Mapping[str, Any]) -> str:
    """A short account of a result, one sentence or two per line: the first screen, then why.

    Only `verdict` is needed; whatever else is missing or null is left out or shown as a dash.
    """
    asked = [f"{question} {answer}" for question, answer in first_screen(result)]
    apart = ["", "In detail:"] if asked else []
    return "\n".join([verdict_sentence(result), *asked, *apart, *evidence(result)])


def verdict_sentence(result: Mapping[str, Any]) -> str:
    """What is missing, in one sentence; of too few flights, how many it takes to tell."""
    flights = flight_count(result)
    if cannot_tell(flights):
        return headline(flights)
    told = _verdict_of(result)
    if unconfirmed(flights) and result.get("verdict") in _CLAIMS:
        told += f" {in_words(flights).capitalize()} say so; one more has to confirm it."
    return told


def _verdict_of(result: Mapping[str, Any]) -> str:
    """The sentence of a verdict, whatever it rests on."""
    verdict = result.get("verdict")
    names = [str(e.get("name")) for e in entries(result.get("effects"))]
    if verdict == "named" and names:
        return _named_sentence(result)
    if verdict == "class":
        members, others = texts(result.get("class")), texts(result.get("others"))
        more = f" {listed(others).capitalize()} would do nearly as well." if others else ""
        return _class_sentence(members, names) + more + _more_classes(result)
    if verdict == "unknown" and entries(result.get("beside")):
        return "Something is missing from the model, and known effects explain only a part of it."
    if verdict == "unknown" and result.get("closest"):
        near = (
            f"the known effect that comes nearest, {result['closest']}, explains too little of it"
        )
        return f"Something is missing from the model; {near}."
    if verdict == "unknown":
        return "Something is missing from the model, and no known effect explains it."
    if verdict == "none":
        return f"{NOTHING}." if _was_judged(result) else _NOTHING_AT_ALL
    return "No verdict yet."


def _was_judged(result: Mapping[str, Any]) -> bool:
    """Whether something was found, and found not to count."""
    small = mapping(result.get("small")) or mapping(result.get("explainable"))
    return bool(entries(result.get("withdrawn")) or small)


def _named_sentence(result: Mapping[str, Any]) -> str:
    """The effects that matter, and those that are there and do not."""
    names = [str(e.get("name")) for e in entries(result.get("effects")) if matters(e)]
    small = small_clause(result)
    if not names:
        return f"{NOTHING}: {small}."
    several = "Effects" if len(names) > 1 else "Effect"
    also = f" Besides, {small}." if small else ""
    return f"{several} missing from the model: {listed(names)}.{also}"


def evidence(result: Mapping[str, Any]) -> list[str]:
    """The sentences that follow the verdict, in the order in which a reader asks for them."""
    verdict = result.get("verdict")
    if cannot_tell(flight_count(result)):
        return _hints(result)
    told = _values(result)
    told += withdrawn_sentences(result) + small_rest_sentences(result)
    told += explainable_sentences(result)
    if verdict == "class":
        told += worth_sentences(result, "The best of them") + _splitting(result)
    if verdict == "unknown":
        told += _part(result) + _rest(mapping(result.get("unknown"))) + worth_sentences(result)
    told += form_sentences(result) + repeated_sentences(result) + unsettled_sentences(result)
    told += _place(result)
    told += shrinking(result) + placebo(result) + _retraining(result)
    if verdict == "none":
        told += _fitted_anew(result) + _detectable(result)
    return told + _caveats(result) + _doubts(result)


def _hints(result: Mapping[str, Any]) -> list[str]:
    """What too few flights show, none of it a conclusion."""
    told = leading_sentences(result) + _sizes_if(result) + _place(result) + _more_than_noise(result)
    told += shrinking(result)
    if mapping(result.get("leading")).get("clear"):
        told.append("In brackets: 90 % intervals.")
        told.append("No flight was kept apart: the error with it may look smaller than it is.")
    return told + _bent(result) + _doubts(result)


def leading_sentences(result: Mapping[str, Any]) -> list[str]:
    """Which effect explains the most of few flights, by how much, and why that is not enough."""
    leading = mapping(result.get("leading"))
    names, gain = texts(leading.get("names")), number(leading.get("gain_nats"))
    if not names or math.isnan(gain):
        return []
    flights, several = flight_count(result), bool(names[1:])
    if gain <= 0.0:
        return [f"No effect stands out: none gains anything in {these(flights)}."]
    gains = f"{_nats(gain)} nats in {these(flights)}"
    if not leading.get("clear"):
        return [f"No effect stands out: the best, {names[0]}, gains {gains}{_by_chance(leading)}."]
    others = texts(leading.get("others"))
    more = f" ({listed(others)} nearly as much)" if others else ""
    told = f"{listed(names)} lead: they gain about" if several else f"{names[0]} leads: it gains"
    after = f", the next, {leading['next']}, " if leading.get("next") else ""
    after += _nats(number(leading.get("next_nats"))) if after else ""
    what = "which it is" if several else "it"
    verb = "tell" if several else "confirm"
    return [
        f"{told} {gains}{more}{after}{_by_chance(leading)}. "
        f"{in_words(flights).capitalize()} cannot {verb} {what}."
    ]


def _nats(gain: float) -> str:
    return f"{gain:.{0 if abs(gain) >= 10.0 else 1}f}".replace("-", "−")


def _by_chance(leading: Mapping[str, Any]) -> str:
    """What an effect has to gain before it is more than chance."""
    least = number(leading.get("threshold_nats"))
    if math.isnan(least):
        return "; what chance alone gives on this rig is not simulated yet"
    return f"; chance alone gives up to {least:.1f}"


def _fitted_anew(result: Mapping[str, Any]) -> list[str]:
    """Why nothing is missing although the first fit of the rig file left more than noise."""
    if mapping(result.get("white_before")).get("passes") is not False:
        return []
    return ["Noise and calibration, fitted anew beside the effects tried, leave only noise."]


def _more_than_noise(result: Mapping[str, Any]) -> list[str]:
    """That few flights as a whole do not look like noise under the rig file as it is."""
    white = mapping(result.get("white_before"))
    if white.get("passes") is not False:
        return []
    whole = f"Taken as a whole, {these(flight_count(result))} left more than noise"
    return [f"{whole} under the rig file as it is ({whiteness_words(white)})."]


def _class_sentence(members: list[str], named: list[str]) -> str:
    sure = [name for name in named if name not in members]
    several = "either" if len(members) == 2 else "one of"
    one = f"{several} {listed(members, 'or')}; these flights cannot tell which."
    if sure:
        return f"Missing from the model: {listed(sure)}, and {one}"
    return f"Missing from the model: {one}"


def _more_classes(result: Mapping[str, Any]) -> str:
    """What else is missing, and cannot be told from rivals of its own."""
    classes = [texts(each) for each in result.get("more_classes") or ()]
    told = [listed(each, "or") for each in classes if each]
    return "".join(f" Besides, {each} is missing." for each in told)


def _values(result: Mapping[str, Any]) -> list[str]:
    """One sentence per effect: its values, how sure the name is, its physics; then of a class."""
    told = []
    for effect in entries(result.get("effects")):
        name = str(effect.get("name"))
        values = [f"{spoken(each)} {value}" for each, value in parameters_of(effect)]
        sure = number(effect.get("confidence"))
        if not math.isnan(sure) and not unconfirmed(flight_count(result)):
            values.append(f"{confidence(sure)} sure")
        physics = f" {LIBRARY[name].physics}" if name in LIBRARY else ""
        told.append(f"{name}: {', '.join(values) or 'without parameters'}.{physics}")
        told += worth_sentences(effect) + _at_bound(effect) + _may_be_nothing(effect)
    return told + _sizes_if(result)


def _sizes_if(result: Mapping[str, Any]) -> list[str]:
    """The sizes of each effect of a class, or of those that lead."""
    told = []
    for member in entries(result.get("members")):
        values = [f"{spoken(each)} {value}" for each, value in parameters_of(member)]
        told.append(f"If it is {member.get('name')}: {', '.join(values) or 'without parameters'}.")
    return told


def _may_be_nothing(effect: Mapping[str, Any]) -> list[str]:
    """That an effect gained what it must, and the flights still do not agree that it is there."""
    sizes = [mapping(p) for p in mapping(effect.get("parameters")).values()]
    if not sizes or not all(p.get("holds_neutral") is True for p in sizes):
        return []
    return [
        f"Doubt {effect.get('name')}: its interval reaches to where it changes nothing, so the "
        "flights do not agree on it; more of them would tell."
    ]


def _at_bound(effect: Mapping[str, Any]) -> list[str]:
    """That sizes of an effect are the library's bounds rather than estimates."""
    sizes = mapping(effect.get("parameters")).items()
    ends = [spoken(str(name)) for name, p in sizes if mapping(p).get("at_bound") is True]
    if not ends:
        return []
    stand = "stand at the ends of their ranges" if ends[1:] else "stands at the end of its range"
    return [
        f"The {listed(ends)} of {effect.get('name')} {stand}: the effect may have another shape, "
        "or be stronger than the library allows."
    ]


def _splitting(result: Mapping[str, Any]) -> list[str]:
    plan = mapping(result.get("plan"))
    split_by = str(plan.get("sentence") or result.get("split_by") or "").rstrip(".")
    asked = "`wakedeploy gap plan`, with the same --rig and --out,"
    if plan.get("manoeuvre"):
        flown = "writes it with --write-reference FILE, which `run-gantry --reference` flies"
        return [f"What would tell them apart: {split_by}.", f"{asked} {flown}."]
    if not split_by:
        return [f"{asked} looks for the manoeuvre that would tell them apart."]
    return [
        f"What would tell them apart: {split_by}.",
        f"{asked} looks for the manoeuvre that does it fastest.",
    ]


def _part(result: Mapping[str, Any]) -> list[str]:
    """The effects that explain a part of what is unknown."""
    known = entries(result.get("beside"))
    if not known:
        return []
    names = listed([str(effect.get("name")) for effect in known])
    bounds = [told for effect in known for told in _at_bound(effect)]
    which = "which are not added by themselves" if known[1:] else "which is not added by itself"
    return [f"A part of it looks like {names}, {which}.", *bounds]


def _rest(unknown: Mapping[str, Any]) -> list[str]:
    """What is known of an effect without a name."""
    told = []
    coordinates = texts(unknown.get("coordinates"))
    if coordinates:
        told.append(f"What is left depends on the {listed([coordinate(c) for c in coordinates])}.")
    expression = unknown.get("text") or unknown.get("expression")
    if expression:
        gain = number(unknown.get("gain_nats"))
        gains = "" if math.isnan(gain) else f", which explains {gain:.0f} nats of it"
        told.append(f"As an expression{gains}: {expression}")
    return told


def _place(result: Mapping[str, Any]) -> list[str]:
    """Where the disagreement is strongest, in words that the verdict can stand beside."""
    places = entries(result.get("places")) or entries(result.get("where"))
    places = [place for place in places if number(place.get("q_value")) <= RULES.false_discoveries]
    few = cannot_tell(flight_count(result))
    claims = result.get("verdict") in _CLAIMS and not few
    if not places:
        known = "places" in result or "where" in result
        return ["No single place stands out: it shows in the flights as a whole."] * (
            known and claims
        )
    words = place_words(places[0])
    at = "" if words.startswith(_NEEDS_NO_AT) else "at "
    if claims:
        return [f"It shows most ({_q(places[0])}) {at}{words}."]
    if few and forbids_none(places):
        one = flight_count(result) == 1
        subject = f"{these(flight_count(result)).capitalize()} disagree{'s' * one}"
        told = f"{subject} most with the rig file ({_q(places[0])}) {at}{words}"
        return [f"{told}; whether others would, {'it' if one else 'they'} cannot tell."]
    return [f"Too little to say that something is missing ({_q(places[0])}): {words}."]


def place_words(place: Mapping[str, Any]) -> str:
    """A place in words: those it came with, without the q value, or made of its bounds."""
    if place.get("words"):
        return _STATED_Q.sub("", str(place["words"]).rstrip("."))
    where = span(place.get("low"), place.get("high"), str(place.get("coordinate_unit", "")))
    residual = quantity(place.get("residual"), str(place.get("unit", "")), signed=True)
    return f"at {place.get('coordinate')} {where}: {place.get('channel')} {residual}"


def _q(place: Mapping[str, Any]) -> str:
    return probability("q", place.get("q_value"))


def _of_the_ratio(scores: Mapping[str, Any]) -> str:
    """What the flights say of new over old; nothing of one flight alone."""
    ends = scores.get("ratio_interval")
    if not isinstance(ends, list) or len(ends) != 2:
        return ""
    low, high = ends
    told = f" That is {number(scores.get('ratio')):.2f} of it, {low:.2f} to {high:.2f} over flights"
    return f"{told}: they cannot tell whether it helps." if low < 1.0 < high else f"{told}."


def _retraining(result: Mapping[str, Any]) -> list[str]:
    retrain = mapping(result.get("retrain"))
    if not retrain:
        return []
    unit = unit_of(retrain)
    old, new = (quantity(retrain.get(key), unit) for key in ("old_rmse", "new_rmse"))
    scored = len(texts(retrain.get("scored_on")))
    if result.get("in_sample") or result.get("cross_validated"):
        where = "on the very flights that the effect was found in"
    else:
        where = f"on {counted(scored, 'sealed flight')}" if scored else "on measured data"
    told = f"A predictor trained on the corrected rig errs by {new} {where}; before, {old}."
    told += _of_the_ratio(retrain)
    by_old = mapping(retrain.get("by_old_label"))
    if by_old:
        old, new = (quantity(by_old.get(key), unit) for key in ("old_rmse", "new_rmse"))
        told += (
            " The force there is measured with the corrected rig; by the force that the old one "
            f"measures, {new} and {old}."
        )
    return [told]


def _detectable(result: Mapping[str, Any]) -> list[str]:
    """What would have been seen, had it been there."""
    sizes = detectable_sizes(result)
    hidden = undetectable(result)
    blind = [f"No plausible size of these would have shown: {listed(hidden)}."] if hidden else []
    if bent := untold(result):
        blind.append(f"From which size these would have shown is not known: {listed(bent)}.")
    if not sizes:
        return blind
    shown = [f"{name}, {parameter} off by {size}" for name, parameter, size in sizes[:_MOST]]
    more = len(sizes) - len(shown)
    tail = f"; {more} more in the report" if more > 0 else ""
    return [f"What these flights would have shown: {'; '.join(shown)}{tail}.", *blind]


def detectable_sizes(result: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """(effect, parameter, smallest size that would have been found) where that is known."""
    return [
        (
            str(name),
            spoken(str(size.get("parameter", "size"))),
            quantity(size.get("size"), unit_of(size)),
        )
        for name, size in mapping(result.get("detectable")).items()
        if isinstance(size, Mapping) and not math.isnan(number(size.get("size")))
    ]


def undetectable(result: Mapping[str, Any]) -> list[str]:
    """Effects that would not have been found at any size within their bounds."""
    return _sizeless(result, known=True)


def untold(result: Mapping[str, Any]) -> list[str]:
    """Effects that are so far from linear that no size can be told without flying them."""
    return _sizeless(result, known=False)


def _sizeless(result: Mapping[str, Any], *, known: bool) -> list[str]:
    return [
        str(name)
        for name, size in mapping(result.get("detectable")).items()
        if isinstance(size, Mapping)
        and math.isnan(number(size.get("size")))
        and bool(size.get("known", True)) is known
    ]


def _caveats(result: Mapping[str, Any]) -> list[str]:
    told = []
    if entries(result.get("effects")) or gap_channel(result)[1].get("before_interval"):
        told.append("In brackets: 90 % intervals.")
    if result.get("in_sample") or result.get("cross_validated"):
        told.append("There were too few flights to seal any: the gap may look smaller than it is.")
    used = texts(mapping(result.get("split")).get("fit"))
    logs = [log for log in entries(result.get("logs")) if log.get("path") in used]
    flown_s = sum(number(log.get("seconds")) for log in logs)
    simulated_s = number(result.get("threshold_of_s"))
    if flown_s > _MUCH_MORE * simulated_s:
        told.append(
            f"The thresholds were simulated for {simulated_s:.0f} s of flight, these are "
            f"{flown_s:.0f} s: what is approximate in the model shows more in so many, and an "
            "effect that barely passed may be that."
        )
    told += _bent(result)
    white = mapping(result.get("white"))
    if white.get("passes") is False and result.get("verdict") == "unknown":
        told.append(f"What is left over is not white noise ({whiteness_words(white)}).")
    return told


def _bent(result: Mapping[str, Any]) -> list[str]:
    """Constants that had to be bent: errors are those of the rig file as recalibrated by this."""
    flights = flight_count(result)
    few = cannot_tell(flights)
    agree = (
        f"{these(flights).capitalize()} agree{'s' * (flights == 1)}" if few else "The flights agree"
    )
    return [
        f"{agree} only with {one.get('name')} at {number(one.get('fitted')):.3g}, where "
        f"the rig file has {number(one.get('stated')):.3g} ± {number(one.get('spread')):.2g} "
        f"({number(one.get('away_sd')):.1f} of its spreads away); errors told here are with it."
        f"{'' if few else ' Calibrate it again.'}"
        for one in entries(result.get("calibration"))
    ]


def _doubts(result: Mapping[str, Any]) -> list[str]:
    """What the flights cannot tell, or what had to be assumed of them, each said once."""
    logs = entries(result.get("logs"))
    doubts = dict.fromkeys(note for log in logs for note in texts(log.get("notes")))
    told = []
    for doubt in doubts:
        doubtful = [log for log in logs if doubt in texts(log.get("notes"))]
        names = [Path(str(log.get("path"))).name for log in doubtful]
        where = "every flight" if len(names) == len(logs) else listed(names)
        told.append(f"In {where}: {doubt}.")
    return told


def whiteness_words(white: Mapping[str, Any]) -> str:
    """The statistic beside what noise alone hardly exceeds; the p value where no limit is known."""
    if math.isnan(number(white.get("limit"))):
        return probability("p", white.get("p_value"))
    statistic, limit = (quantity(white.get(key), "") for key in ("statistic", "limit"))
    return f"statistic {statistic}, of noise alone at most {limit}"


def coordinate(symbol: str) -> str:
    """A variable of an expression in words: `carriage position (x_m)`."""
    return f"{_SPOKEN[symbol]} ({symbol})" if symbol in _SPOKEN else symbol


_SPOKEN = {
    "time_s": "time in flight",
    "x_m": "carriage position",
    "vx_mps": "carriage speed",
    "z_m": "height",
    "vz_mps": "vertical speed",
    "source_n": "source's thrust",
    "source_rate_nps": "slope of the source's thrust",
    "sufferer_n": "sufferer's thrust",
    "wake_mps": "wake's speed at the sufferer",
    "wake_n": "wake's force",
    "charge_s": "charge drawn",
    "travelled_m": "carriage's way",
    "direction": "carriage's direction",
}
