"""The first screen of an answer: does it matter, how sure is it, what to do next.

A reader of the verdict asks these three questions, and needs no statistics for the answers: forces
in newtons, heights in millimetres, shares in per cent.

In: `result.json`, or more (see `steps.Steps.summary`). Out: pairs of a question and its answer.
"""

import math
from collections.abc import Mapping
from typing import Any

from wakedeploy.gap.few_flights import cannot_tell, unconfirmed
from wakedeploy.gap.report.mattering import force_words, matters, share_of
from wakedeploy.gap.report.shrinkage import flight_count, gap_channel, gap_value
from wakedeploy.gap.wording import confidence, entries, listed, mapping, number, percent, texts

Result = Mapping[str, Any]

_HORIZONS = ("0.25 s ahead", "1 s ahead")


def first_screen(result: Result) -> list[tuple[str, str]]:
    """Each question that can be answered, with its answer; none of too few flights."""
    if cannot_tell(flight_count(result)) or not result.get("verdict"):
        return []
    answers = [
        ("Does it matter?", importance(result)),
        ("How sure is that?", certainty(result)),
        ("What next?", next_step(result)),
    ]
    return [(question, answer) for question, answer in answers if answer]


def importance(result: Result) -> str:
    """What it does to the sufferer, and what a forecast loses by not knowing it."""
    verdict = result.get("verdict")
    if verdict == "none":
        return _nothing_matters(result)
    if verdict == "named":
        return _of_names(entries(result.get("effects")))
    if explainable := mapping(result.get("explainable")):
        share = percent(explainable.get("share"))
        return f"Yes: knowing it would remove up to {share} of the squared forecast error."
    told = _costs("it", result)
    return f"Yes: {told}." if told else ""


def _nothing_matters(result: Result) -> str:
    name, channel = gap_channel(result)
    if not channel:
        return ""
    error, noise = gap_value(channel, "before"), gap_value(channel, "noise_floor")
    return f"No: the rig file forecasts the {name} to {error}, and noise alone gives {noise}."


def _of_names(effects: list[Mapping[str, Any]]) -> str:
    judged = [e for e in effects if e.get("worth")]
    counts = [_costs(str(e.get("name")), e) for e in judged if matters(e)]
    if counts:
        return f"Yes: {'; '.join(counts)}."
    small = [_costs(str(e.get("name")), e) for e in judged]
    return f"No: {'; '.join(small)}." if small else ""


def _costs(name: str, entry: Mapping[str, Any]) -> str:
    """`crosswind-offset makes 37 mN, 1.4 mm of height and 34 % of the squared forecast error`."""
    worth = mapping(entry.get("worth"))
    if not worth:
        return ""
    told = [force_words(worth)]
    height_mm = 1e3 * number(mapping(worth.get("tracking_m")).get("value"))
    if height_mm > 0.0:
        told.append(f"{height_mm:.1f} mm of height")
    shares = {h: share_of(entry, h) for h in _HORIZONS}
    known = {h: share for h, share in shares.items() if not math.isnan(share)}
    if known:
        best = max(known, key=lambda h: known[h])
        told.append(f"{percent(max(known[best], 0.0))} of the squared forecast error {best}")
    return f"{name} makes {listed(told)}"


def certainty(result: Result) -> str:
    """How sure the verdict is, in per cent and by what it was tried on."""
    verdict = result.get("verdict")
    told = {"named": _names_sure, "class": _class_sure, "unknown": _unknown_sure}
    if verdict not in told:
        return (
            "Where nothing is missing, one search in twenty finds something; this one found "
            "nothing that flights kept apart bear out."
            if entries(result.get("withdrawn"))
            else ""
        )
    return " ".join(part for part in (*told[verdict](result), _halves(result)) if part)


def _names_sure(result: Result) -> list[str]:
    effects = entries(result.get("effects"))
    if unconfirmed(flight_count(result)):
        return ["No flight was kept apart to confirm it."]
    known = [(str(e.get("name")), number(e.get("confidence"))) for e in effects]
    sure = [f"{name} {confidence(c)}" for name, c in known if not math.isnan(c)]
    told = [f"{listed(sure)}."] if sure else []
    if all(mapping(e.get("worth")).get("confirmed") for e in effects):
        told.append("Flights that took no part in finding it bear it out.")
    return told


def _class_sure(result: Result) -> list[str]:
    return [f"One of {listed(texts(result.get('class')), 'or')} is there; which, is open."]


def _unknown_sure(result: Result) -> list[str]:
    if entries(result.get("beside")):
        return ["That there is more than the known part is beyond chance; what it is, is open."]
    return ["That something is missing is beyond chance; what it is, is open."]


def _halves(result: Result) -> str:
    again = mapping(result.get("repeated"))
    if not again:
        return ""
    if again.get("agree"):
        return "Each half of the flights by itself says the same."
    return "The two halves of the flights do not agree: fly more."


def next_step(result: Result) -> str:
    """What to do, in words; the commands stand below where there are any."""
    if why := mapping(result.get("next")).get("why"):
        return f"{str(why)[:1].upper()}{str(why)[1:]}."
    verdict = result.get("verdict")
    if verdict == "named" and any(matters(e) for e in entries(result.get("effects"))):
        return "Simulate and train with the corrected rig file."
    if verdict in ("named", "none"):
        return "Nothing: simulate and train with the rig file as it is."
    if verdict == "unknown":
        return "Look where flights and rig file disagree, and fly there more."
    return ""
