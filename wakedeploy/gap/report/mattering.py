"""What an effect is worth, in words: a person who knows no nats reads newtons and percentages.

In: an answer's entries with `worth`, as `name.json` has it. Out: sentences.
"""

import math
from collections.abc import Mapping
from typing import Any

from wakedeploy.gap.wording import (
    entries,
    listed,
    mapping,
    number,
    percent,
    quantity,
    span,
    texts,
)

_NEAR, _FAR = "0.25 s ahead", "1 s ahead"
_LEAST_N = 0.0005  # below it, it is an error of a reading
NOTHING = "Nothing that matters is missing from the model"


def matters(entry: Mapping[str, Any]) -> bool:
    """Whether an entry was found to matter; one that no flight has judged is taken to."""
    return mapping(entry.get("worth")).get("matters") is not False


def small_clause(result: Mapping[str, Any]) -> str:
    """`X is there, too small to matter here (1.9 %)`; "" where nothing is."""
    small = [e for e in entries(result.get("effects")) if not matters(e)]
    if not small:
        return ""
    told = [f"{e.get('name')} ({removed_words(e)})" for e in small]
    return f"{listed(told)} {'are' if small[1:] else 'is'} there, too small to matter here"


def form_sentences(result: Mapping[str, Any]) -> list[str]:
    """That an effect leads although its form is not the rig's, and how much is left."""
    rest = mapping(result.get("rest"))
    if not entries(result.get("effects")):
        return []
    if rest.get("text"):
        left = f"{force_words(rest)} are left, which are not added; as an expression"
        return [f"Its form is not exact: {left}, {rest['text']}."]
    if result.get("form_exact") is False:
        return ["Its form is not exact: what is left is not quite noise."]
    return []


def unsettled_sentences(result: Mapping[str, Any]) -> list[str]:
    """Fits that did not end where they should."""
    names = texts(result.get("unsettled"))
    if not names:
        return []
    told = "Did not converge, so that it may rank too low, or its interval be wrong"
    return [f"{told}: {listed(names)}."]


def repeated_sentences(result: Mapping[str, Any]) -> list[str]:
    """Whether each half of the flights gives the same answer by itself."""
    again = mapping(result.get("repeated"))
    halves = entries(again.get("halves"))
    if len(halves) != 2:
        return []
    told = [_half(half) for half in halves]
    if again.get("agree"):
        return [f"Both halves of the flights say so by themselves: {listed(told)}."]
    return [f"The two halves of the flights do not agree: {listed(told)}. More flights would tell."]


def _half(half: Mapping[str, Any]) -> str:
    low, high, unit = half.get("low"), half.get("high"), str(half.get("unit") or "")
    return f"{half.get('leading')} {span(low, high, unit)}"


def removed_words(entry: Mapping[str, Any]) -> str:
    """`1.9 %` of the squared forecast error, at the horizon where it removes more."""
    shares = [share_of(entry, _NEAR), share_of(entry, _FAR)]
    known = [s for s in shares if not math.isnan(s)]
    if not known:
        return "not measured"
    most = max(known)
    return f"{100 * most:.1f} %".replace("-", "−") if abs(most) < 0.1 else percent(most)


def share_of(entry: Mapping[str, Any], horizon: str) -> float:
    """The share of the squared forecast error that it removes; NaN where nobody measured it."""
    return number(mapping(_removed(entry).get(horizon)).get("share"))


def worth_sentences(entry: Mapping[str, Any], subject: str = "It") -> list[str]:
    """What it changes in the force and in forecasts, and whether that matters."""
    worth = mapping(entry.get("worth"))
    if not worth:
        return []
    told = [f"{subject} makes {force_words(worth)}{_tracking(worth)}"]
    for horizon in (_NEAR, _FAR):
        one = mapping(_removed(entry).get(horizon))
        if not math.isnan(number(one.get("share"))):
            told.append(f"{_with_interval(one)} {horizon}")
    shares = f"; of the squared forecast error it removes {listed(told[1:])}" if told[1:] else ""
    verdict = "it matters" if matters(entry) else "too small to matter here, and not added"
    return [f"{told[0]}{shares}: {verdict}."]


def withdrawn_sentences(result: Mapping[str, Any]) -> list[str]:
    """What the search found and the sealed flights did not bear out."""
    return [
        f"Withdrawn: {entry.get('name')}. The flights that it was found in speak for it"
        f"{_by(entry)}; those that took no part forecast no better with it "
        f"({_with_interval(mapping(_removed(entry).get(_NEAR)))} of the squared error removed "
        f"{_NEAR}{_placebo(entry)})."
        for entry in entries(result.get("withdrawn"))
    ]


def small_rest_sentences(result: Mapping[str, Any]) -> list[str]:
    """An expression that is evident and does not matter."""
    rest = mapping(result.get("small"))
    if not rest.get("text"):
        return []
    force = force_words(mapping(rest.get("worth")))
    return [
        f"A little is left that does not matter, and is not added: {rest['text']}. It makes "
        f"{force} and removes {removed_words(rest)} of the squared forecast error."
    ]


def explainable_sentences(result: Mapping[str, Any]) -> list[str]:
    """What knowing the cause of a disagreement would be worth, where no cause was found."""
    worth = mapping(result.get("explainable"))
    if not worth:
        return []
    told = f"All that could be explained of the forecast error {_NEAR} is {_with_interval(worth)}"
    few = "" if result.get("verdict") == "unknown" else ": too little to matter here"
    return [f"The flights disagree with the model beyond noise. {told}{few}."]


def _removed(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    return mapping(mapping(entry.get("worth")).get("removed"))


def force_words(worth: Mapping[str, Any]) -> str:
    """The force that something makes: `37 mN`; of a sensor's error `no force`."""
    force_n = number(worth.get("force_n"))
    if math.isnan(force_n):
        return "an unknown force"
    if force_n < _LEAST_N:
        return "no force"
    return f"{1e3 * force_n:.0f} mN" if force_n < 0.2 else quantity(force_n, "N")


def _tracking(worth: Mapping[str, Any]) -> str:
    """What ignoring it costs in flight."""
    cost = mapping(worth.get("tracking_m"))
    value, low, high = (1e3 * number(cost.get(key)) for key in ("value", "low", "high"))
    return "" if math.isnan(value) else f", {value:.1f} mm of height ({low:.1f} to {high:.1f})"


def _with_interval(one: Mapping[str, Any]) -> str:
    low, high = number(one.get("low")), number(one.get("high"))
    ends = "" if math.isnan(low + high) else f" ({_digits(low)} to {_digits(high)})"
    return f"{_digits(number(one.get('share')))} %{ends}"


def _digits(share: float) -> str:
    size = 100.0 * share
    return f"{size:.{1 if abs(size) < 10.0 else 0}f}".replace("-", "−")


def _by(entry: Mapping[str, Any]) -> str:
    gain = number(entry.get("gain_nats"))
    return "" if math.isnan(gain) else f" by {gain:.1f} nats"


def _placebo(entry: Mapping[str, Any]) -> str:
    share = number(mapping(mapping(entry.get("worth")).get("placebo_removed")).get(_NEAR))
    return "" if math.isnan(share) else f"; a wrong effect: {_digits(share)} %"
