"""The result in plain words: what is missing, how sure that is, how much of the gap it closes.

In: the summary of a folder. Out: sentences.
"""

from collections.abc import Sequence

from wakedeploy.gap.few_flights import cannot_tell, headline, in_words, unconfirmed
from wakedeploy.gap.report.evidence import evidence
from wakedeploy.gap.report.first_screen import first_screen
from wakedeploy.gap.report.mattering import NOTHING, small_sentence
from wakedeploy.gap.report.phrases import plain
from wakedeploy.gap.report.shrinkage import flight_count
from wakedeploy.gap.systems.gantry.artefacts import Summary
from wakedeploy.gap.wording import DETAILS, listed

_NOTHING_AT_ALL = "Nothing is missing from the model beyond noise."


def account(summary: Summary) -> str:
    """A short account of a result, one sentence or two per line: the first screen, then why.

    Only `verdict` is needed; whatever else is missing is left out or shown as a dash.
    """
    asked = [f"{question} {answer}" for question, answer in first_screen(summary)]
    apart = ["", DETAILS] if asked else []
    return "\n".join([verdict_sentence(summary), *asked, *apart, *evidence(summary)])


def verdict_sentence(summary: Summary) -> str:
    """What is missing, in one sentence; of too few flights, how many it takes to tell."""
    flights = flight_count(summary)
    if cannot_tell(flights):
        return headline(flights)
    sentence = _verdict_of(summary)
    if unconfirmed(flights) and summary.claims:
        sentence += f" {in_words(flights).capitalize()} say so; one more has to confirm it."
    return sentence


def _verdict_of(summary: Summary) -> str:
    """The sentence of a verdict, whatever it rests on."""
    if summary.verdict == "named" and summary.effects:
        return _named_sentence(summary)
    if summary.verdict == "class":
        return _class_sentence(summary)
    if summary.verdict == "unknown" and summary.beside:
        return "Something is missing from the model, and known effects explain only a part of it."
    if summary.verdict == "unknown" and summary.closest:
        near = "The known effect that comes nearest explains too little of it: "
        return f"Something is missing from the model. {near}{plain(summary.closest)}."
    if summary.verdict == "unknown":
        return "Something is missing from the model, and no known effect explains it."
    if summary.verdict == "none":
        nothing = f"{NOTHING}." if _was_judged(summary) else _NOTHING_AT_ALL
        return f"{nothing}{_but_calibrated(summary)}"
    return "No verdict yet."


def _but_calibrated(summary: Summary) -> str:
    """Which constants of the rig file the flights contradict, though no effect is missing."""
    off = [f"{b.name} is {b.stated:.3g} and should be {b.fitted:.3g}" for b in summary.calibration]
    return f" But its calibration is off: {listed(off)}." if off else ""


def _was_judged(summary: Summary) -> bool:
    """Whether something was found, and found not to count."""
    return bool(summary.withdrawn) or summary.small is not None or summary.explainable is not None


def _named_sentence(summary: Summary) -> str:
    """The effects that matter, and those that are there and do not."""
    effects = [plain(effect.name) for effect in summary.to_add]
    small = small_sentence(summary)
    if not effects:
        return f"{NOTHING}. {small}"
    return f"Missing from the model: {listed(effects)}. {small}".rstrip()


def _class_sentence(summary: Summary) -> str:
    """What is sure, the class, what is nearly as near, and what else is missing."""
    sure = [plain(effect.name) for effect in summary.effects if effect.name not in summary.rivals]
    several = "either" if len(summary.rivals) == 2 else "one of these,"
    rivals = [plain(name) for name in summary.rivals]
    members = f"{several} {listed(rivals, 'or')}; these flights cannot tell which."
    known = f"{listed(sure)}, and " if sure else ""
    others = summary.others
    more = f" {listed(_code(others))} would do nearly as well." if others else ""
    classes = [listed(_code(each), "or") for each in summary.more_classes if each]
    besides = "".join(f" Besides, {each} is missing." for each in classes)
    return f"Missing from the model: {known}{members}{more}{besides}"


def _code(names: Sequence[str]) -> list[str]:
    return [f"`{name}`" for name in names]
