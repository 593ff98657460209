"""What an effect is worth, in words: a person who knows no nats reads newtons and percentages.

In: an answer, and its effects with `worth`. Out: sentences.
"""

import math

from wakedeploy.gap.report.phrases import plain
from wakedeploy.gap.search.artefacts import Forecast
from wakedeploy.gap.systems.gantry.findings import Answer, Effect, Expression, Half, Worth
from wakedeploy.gap.wording import halves_said, listed, minus, nats, percent, quantity, span

_NEAR, _FAR = "0.25 s ahead", "1 s ahead"
_LEAST_N = 0.0005  # below it, it is an error of a reading
NOTHING = "Nothing that matters is missing from the model"


def small_sentence(answer: Answer) -> str:
    """`There, but too small to matter here: …` with the share that each removes; "" for none."""
    small = [effect for effect in answer.effects if not effect.matters]
    if not small:
        return ""
    names = [f"{plain(effect.name)}, {removed_words(effect.worth)}" for effect in small]
    return f"There, but too small to matter here: {'; '.join(names)}."


def form_sentences(answer: Answer) -> list[str]:
    """That an effect leads although its form is not the rig's, and how much is left."""
    rest = answer.rest
    if not answer.effects:
        return []
    if rest is not None and rest.text:
        remainder = f"{force_words(rest.force_n)} are left, which are not added; as an expression"
        return [f"Its form is not exact: {remainder}, {rest.text}."]
    if not answer.form_exact:
        return ["Its form is not exact: what is left is not quite noise."]
    return []


def unsettled_sentences(answer: Answer) -> list[str]:
    """Fits that did not end where they should."""
    if not answer.unsettled:
        return []
    start = "Did not converge, so that it may rank too low, or its interval be wrong"
    return [f"{start}: {listed(answer.unsettled)}."]


def repeated_sentences(answer: Answer) -> list[str]:
    """Whether each half of the flights gives the same answer by itself."""
    again = answer.repeated
    if again is None or len(again.halves) != 2:
        return []
    return [halves_said(again.agree, [_half(half) for half in again.halves], "flights")]


def _half(half: Half) -> str:
    return f"{half.leading} {span(half.low, half.high, half.unit)}"


def removed_words(worth: Worth | None) -> str:
    """`1.9 %` of the squared forecast error, at the horizon where it removes more."""
    shares = [share_of(worth, _NEAR), share_of(worth, _FAR)]
    known = [s for s in shares if not math.isnan(s)]
    if not known:
        return "not measured"
    most = max(known)
    return minus(f"{100 * most:.1f} %") if abs(most) < 0.1 else percent(most)


def share_of(worth: Worth | None, horizon: str) -> float:
    """The share of the squared forecast error that it removes; NaN where nobody measured it."""
    removed = None if worth is None else worth.removed.get(horizon)
    return math.nan if removed is None else removed.share


def worth_sentences(worth: Worth | None, subject: str = "It") -> list[str]:
    """What it changes in the force and in forecasts, and whether that matters."""
    if worth is None:
        return []
    shares_told = [f"{subject} makes {force_words(worth.force_n)}{_tracking(worth)}"]
    for horizon in (_NEAR, _FAR):
        if not math.isnan(share_of(worth, horizon)):
            shares_told.append(f"{_with_interval(worth.removed[horizon])} {horizon}")
    shares = (
        f"; of the squared forecast error it removes {listed(shares_told[1:])}"
        if shares_told[1:]
        else ""
    )
    verdict = _matters(worth) if worth.matters else "too small to matter here, and not added"
    return [f"{shares_told[0]}{shares}: {verdict}."]


def _matters(worth: Worth) -> str:
    """That it matters; and by what, where the forecasts' intervals leave it open."""
    known = [r for r in worth.removed.values() if not math.isnan(r.low)]
    if not known or any(r.low > 0.0 for r in known):
        return "it matters"
    return (
        "it matters, as all readings of the flights kept apart say together; their forecasts alone "
        "scatter too much"
    )


def withdrawn_sentences(answer: Answer) -> list[str]:
    """What the search found and the sealed flights did not bear out."""
    return [
        f"Withdrawn: {effect.name}. The flights that it was found in speak for it"
        f"{_by(effect)}; those that took no part forecast no better with it "
        f"({_near(effect.worth)} of the squared error removed {_NEAR}{_placebo(effect.worth)})."
        for effect in answer.withdrawn
    ]


def small_rest_sentences(rest: Expression | None) -> list[str]:
    """An expression that is evident and does not matter."""
    if rest is None or not rest.text:
        return []
    force = force_words(math.nan if rest.worth is None else rest.worth.force_n)
    return [
        f"A little is left that does not matter, and is not added: {rest.text}. It makes "
        f"{force} and removes {removed_words(rest.worth)} of the squared forecast error."
    ]


def explainable_sentences(answer: Answer) -> list[str]:
    """What knowing the cause of a disagreement would be worth, where no cause was found."""
    share = answer.explainable
    if share is None:
        return []
    sentence = (
        f"All that could be explained of the forecast error {_NEAR} is {_with_interval(share)}"
    )
    few = "" if answer.verdict == "unknown" else ": too little to matter here"
    return [f"The flights disagree with the model beyond noise. {sentence}{few}."]


def force_words(force_n: float) -> str:
    """The force that something makes: `37 mN`; of a sensor's error `no force`."""
    if math.isnan(force_n):
        return "an unknown force"
    if force_n < _LEAST_N:
        return "no force"
    return f"{1e3 * force_n:.0f} mN" if force_n < 0.2 else quantity(force_n, "N")


def _tracking(worth: Worth) -> str:
    """What ignoring it costs in flight."""
    cost = worth.tracking_m
    value, low, high = (1e3 * each for each in (cost.value, cost.low, cost.high))
    return "" if math.isnan(value) else f", {value:.1f} mm of height ({low:.1f} to {high:.1f})"


def _near(worth: Worth | None) -> str:
    removed = None if worth is None else worth.removed.get(_NEAR)
    return "an unknown share" if removed is None else _with_interval(removed)


def _with_interval(removed: Forecast) -> str:
    low, high = removed.low, removed.high
    ends = "" if math.isnan(low + high) else f" ({_digits(low)} to {_digits(high)})"
    return f"{_digits(removed.share)} %{ends}"


def _digits(share: float) -> str:
    size = 100.0 * share
    return minus(f"{size:.{1 if abs(size) < 10.0 else 0}f}")


def _by(effect: Effect) -> str:
    return "" if math.isnan(effect.gain_nats) else f" by {nats(effect.gain_nats)}"


def _placebo(worth: Worth | None) -> str:
    removed = (worth and worth.placebo_removed) or {}
    share = removed.get(_NEAR, math.nan)
    return "" if math.isnan(share) else f"; a wrong effect: {_digits(share)} %"
