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
from wakedeploy.gap.rules import sealed_count
from wakedeploy.gap.systems.gantry.artefacts import Summary
from wakedeploy.gap.systems.gantry.findings import Effect, Worth
from wakedeploy.gap.wording import confidence, listed, percent

_HORIZONS = ("0.25 s ahead", "1 s ahead")


def first_screen(summary: Summary) -> list[tuple[str, str]]:
    """Each question that can be answered, with its answer; none of too few flights."""
    if cannot_tell(flight_count(summary)) or summary.verdict is None:
        return []
    answers = [
        ("Does it matter?", importance(summary)),
        ("How sure is that?", certainty(summary)),
        ("What next?", next_step(summary)),
    ]
    return [(question, answer) for question, answer in answers if answer]


def importance(summary: Summary) -> str:
    """What it does to the sufferer, and what a forecast loses by not knowing it."""
    if summary.verdict == "none":
        return _nothing_matters(summary)
    if summary.verdict == "named":
        return _of_names(summary.effects)
    if summary.explainable is not None:
        share = percent(summary.explainable.share)
        return f"Yes: knowing it would remove up to {share} of the squared forecast error."
    costs = _costs("it", summary.worth)
    return f"Yes: {costs}." if costs else ""


def _nothing_matters(summary: Summary) -> str:
    name, channel = gap_channel(summary)
    if channel is None:
        return ""
    error, _, noise = gap_values(channel)
    if summary.calibration:
        fitted = listed([f"`{bent.name}`" for bent in summary.calibration])
        return (
            f"No effect does. But the rig file forecasts the {name} to {error} only with {fitted} "
            f"as fitted to these flights; noise alone gives {noise}."
        )
    return f"No: the rig file forecasts the {name} to {error}, and noise alone gives {noise}."


def _of_names(effects: Sequence[Effect]) -> str:
    judged = [effect for effect in effects if effect.worth is not None]
    several = len(effects) > 1
    costs = [_costs(f"`{e.name}`" if several else "it", e.worth) for e in judged]
    counts = [cost for effect, cost in zip(judged, costs, strict=True) if effect.matters]
    if counts:
        return f"Yes: {'; '.join(counts)}."
    return f"No: {'; '.join(costs)}." if costs else ""


def _costs(name: str, worth: Worth | None) -> str:
    """`it makes 37 mN, 1.4 mm of height and 34 % of the squared forecast error`."""
    if worth is None:
        return ""
    costs = [force_words(worth.force_n)]
    height_mm = 1e3 * worth.tracking_m.value
    if height_mm > 0.0:
        costs.append(f"{height_mm:.1f} mm of height")
    shares = {h: share_of(worth, h) for h in _HORIZONS}
    known = {h: share for h, share in shares.items() if not math.isnan(share)}
    if known:
        best = max(known, key=lambda h: known[h])
        costs.append(f"{percent(max(known[best], 0.0))} of the squared forecast error {best}")
    return f"{name} makes {listed(costs)}"


def certainty(summary: Summary) -> str:
    """How sure the verdict is, in per cent and by what it was tried on."""
    sure = {"named": _names_sure, "class": _class_sure, "unknown": _unknown_sure}
    if summary.verdict not in sure:
        return (
            "Where nothing is missing, one search in twenty finds something; this one found "
            "nothing that flights kept apart bear out."
            if summary.withdrawn
            else ""
        )
    return " ".join(part for part in (*sure[summary.verdict](summary), _halves(summary)) if part)


def _names_sure(summary: Summary) -> list[str]:
    if unconfirmed(flight_count(summary)):
        return ["No flight was kept apart to confirm it."]
    known = [effect for effect in summary.effects if not math.isnan(effect.confidence)]
    several = len(summary.effects) > 1
    sure = listed(
        [f"{confidence(e.confidence)} sure{f' of `{e.name}`' if several else ''}" for e in known]
    )
    sentences = [f"{sure[:1].upper()}{sure[1:]}."] if sure else []
    if all(effect.worth is not None and effect.worth.confirmed for effect in summary.effects):
        apart = sealed_count(flight_count(summary))
        subject, verb = ("Flights", "bear") if apart != 1 else ("A flight", "bears")
        sentences.append(f"{subject} that took no part in finding it {verb} it out.")
    return sentences


def _class_sure(summary: Summary) -> list[str]:
    several = "The two" if len(summary.rivals) == 2 else f"These {len(summary.rivals)}"
    return [f"{several} look alike on these flights; one of them is there; which, is open."]


def _unknown_sure(summary: Summary) -> list[str]:
    if summary.beside:
        return ["That there is more than the known part is beyond chance; what it is, is open."]
    return ["That something is missing is beyond chance; what it is, is open."]


def _halves(summary: Summary) -> str:
    if summary.repeated is None:
        return ""
    if summary.repeated.agree:
        return "Each half of the flights by itself says the same."
    return "The two halves of the flights do not agree: fly more."


def next_step(summary: Summary) -> str:
    """What to do, in words; the commands stand below where there are any."""
    if summary.next is not None:
        return f"{summary.next.why[:1].upper()}{summary.next.why[1:]}."
    if summary.verdict == "named" and summary.to_add:
        return "Simulate and train with the corrected rig file."
    if summary.verdict == "none" and summary.calibration:
        return _calibrate([bent.name for bent in summary.calibration])
    if summary.verdict in ("named", "none"):
        return "Nothing: simulate and train with the rig file as it is."
    if summary.verdict == "unknown":
        return "Look where flights and rig file disagree, and fly there more."
    return ""


def _calibrate(names: Sequence[str]) -> str:
    """What to do about constants of the rig file that the flights contradict."""
    mass = " Weigh the vehicle, too: a mass that is off looks like its thrust."
    heavy = mass if any(name.startswith("thrust.") for name in names) else ""
    which = listed([f"`{name}`" for name in names])
    return f"Calibrate {which} again, and simulate and train with that rig file.{heavy}"
