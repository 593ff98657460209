"""The first screen of an answer: does it matter, how sure is it, what to do next.

A reader of the verdict asks these three questions, and needs no statistics for the answers: forces
in newtons, heights in millimetres, shares in per cent.

In: the summary of a folder. Out: pairs of a question and its answer.
"""

import math
from collections.abc import Sequence

from wakedeploy.gap.few_flights import cannot_tell, unconfirmed
from wakedeploy.gap.report.mattering import force_words, share_of
from wakedeploy.gap.report.shrinkage import flight_count, gap_channel, gap_values
from wakedeploy.gap.systems.gantry.artefacts import Summary
from wakedeploy.gap.systems.gantry.findings import Effect, Worth
from wakedeploy.gap.wording import confidence, listed, percent

_HORIZONS = ("0.25 s ahead", "1 s ahead")


def first_screen(told: Summary) -> list[tuple[str, str]]:
    """Each question that can be answered, with its answer; none of too few flights."""
    if cannot_tell(flight_count(told)) or told.verdict is None:
        return []
    answers = [
        ("Does it matter?", importance(told)),
        ("How sure is that?", certainty(told)),
        ("What next?", next_step(told)),
    ]
    return [(question, answer) for question, answer in answers if answer]


def importance(told: Summary) -> str:
    """What it does to the sufferer, and what a forecast loses by not knowing it."""
    if told.verdict == "none":
        return _nothing_matters(told)
    if told.verdict == "named":
        return _of_names(told.effects)
    if told.explainable is not None:
        share = percent(told.explainable.share)
        return f"Yes: knowing it would remove up to {share} of the squared forecast error."
    costs = _costs("it", told.worth)
    return f"Yes: {costs}." if costs else ""


def _nothing_matters(told: Summary) -> str:
    name, channel = gap_channel(told)
    if channel is None:
        return ""
    error, _, noise = gap_values(channel)
    return f"No: the rig file forecasts the {name} to {error}, and noise alone gives {noise}."


def _of_names(effects: Sequence[Effect]) -> str:
    judged = [effect for effect in effects if effect.worth is not None]
    counts = [_costs(effect.name, effect.worth) for effect in judged if effect.matters]
    if counts:
        return f"Yes: {'; '.join(counts)}."
    small = [_costs(effect.name, effect.worth) for effect in judged]
    return f"No: {'; '.join(small)}." if small else ""


def _costs(name: str, worth: Worth | None) -> str:
    """`crosswind-offset makes 37 mN, 1.4 mm of height and 34 % of the squared forecast error`."""
    if worth is None:
        return ""
    told = [force_words(worth.force_n)]
    height_mm = 1e3 * worth.tracking_m.value
    if height_mm > 0.0:
        told.append(f"{height_mm:.1f} mm of height")
    shares = {h: share_of(worth, h) for h in _HORIZONS}
    known = {h: share for h, share in shares.items() if not math.isnan(share)}
    if known:
        best = max(known, key=lambda h: known[h])
        told.append(f"{percent(max(known[best], 0.0))} of the squared forecast error {best}")
    return f"{name} makes {listed(told)}"


def certainty(told: Summary) -> str:
    """How sure the verdict is, in per cent and by what it was tried on."""
    sure = {"named": _names_sure, "class": _class_sure, "unknown": _unknown_sure}
    if told.verdict not in sure:
        return (
            "Where nothing is missing, one search in twenty finds something; this one found "
            "nothing that flights kept apart bear out."
            if told.withdrawn
            else ""
        )
    return " ".join(part for part in (*sure[told.verdict](told), _halves(told)) if part)


def _names_sure(told: Summary) -> list[str]:
    if unconfirmed(flight_count(told)):
        return ["No flight was kept apart to confirm it."]
    known = [effect for effect in told.effects if not math.isnan(effect.confidence)]
    sure = [f"{effect.name} {confidence(effect.confidence)}" for effect in known]
    sentences = [f"{listed(sure)}."] if sure else []
    if all(effect.worth is not None and effect.worth.confirmed for effect in told.effects):
        sentences.append("Flights that took no part in finding it bear it out.")
    return sentences


def _class_sure(told: Summary) -> list[str]:
    return [f"One of {listed(told.rivals, 'or')} is there; which, is open."]


def _unknown_sure(told: Summary) -> list[str]:
    if told.beside:
        return ["That there is more than the known part is beyond chance; what it is, is open."]
    return ["That something is missing is beyond chance; what it is, is open."]


def _halves(told: Summary) -> str:
    if told.repeated is None:
        return ""
    if told.repeated.agree:
        return "Each half of the flights by itself says the same."
    return "The two halves of the flights do not agree: fly more."


def next_step(told: Summary) -> str:
    """What to do, in words; the commands stand below where there are any."""
    if told.next is not None:
        return f"{told.next.why[:1].upper()}{told.next.why[1:]}."
    if told.verdict == "named" and told.to_add:
        return "Simulate and train with the corrected rig file."
    if told.verdict in ("named", "none"):
        return "Nothing: simulate and train with the rig file as it is."
    if told.verdict == "unknown":
        return "Look where flights and rig file disagree, and fly there more."
    return ""
