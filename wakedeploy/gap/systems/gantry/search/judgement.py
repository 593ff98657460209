"""What becomes of an answer once sealed flights have judged it: confirmed, small, or withdrawn.

In: `name.json` as the search wrote it, and what its parts are worth (`mattering`). Out: the same
with a label beside every effect, without what the sealed flights do not bear out. What does not
matter stays named, and is not added to the rig file unless a person asks.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from wakedeploy.gap.systems.gantry.search.importance import Mattering, Removed

Told = Mapping[str, Any]


def parts_of(told: Told, hypothesis: Sequence[str]) -> list[tuple[str, ...]]:
    """What stands or falls together: each named effect alone, a class or an expression whole."""
    verdict = told.get("verdict")
    if not hypothesis or verdict in ("none", "inconclusive"):
        return []
    if verdict == "named":
        return [(name,) for name in hypothesis]
    return [tuple(hypothesis)]


def judged(
    told: Told, parts: Sequence[Sequence[str]], worth: Sequence[Mattering]
) -> dict[str, Any]:
    """`name.json` after the sealed flights' word."""
    verdict = told.get("verdict")
    labels = {tuple(part): one for part, one in zip(parts, worth, strict=True)}
    if verdict == "named":
        return _of_names(told, {part[0]: one for part, one in labels.items()})
    if not labels:
        return {**told, "withdrawn": []}
    (part, one), *_ = labels.items()
    if verdict == "class":
        return _of_class(told, part, one)
    return _of_unknown(told, part, one)


def unexplained(told: Told, worth: Removed) -> dict[str, Any]:
    """Where flights disagree and nothing was found: unknown only if knowing it would help."""
    verdict = "unknown" if worth.clearly else "none"
    return {**told, "verdict": verdict, "withdrawn": [], "explainable": worth.as_json()}


def _of_names(told: Told, labels: Mapping[str, Mattering]) -> dict[str, Any]:
    kept, gone = list[dict[str, Any]](), list[dict[str, Any]]()
    for effect in told.get("effects", ()):
        one = labels[effect["name"]]
        entry = {**effect, "worth": one.as_json()}
        (kept if one.is_confirmed else gone).append(entry)
    return {
        **told,
        "verdict": "named" if kept else "none",
        "effects": kept,
        "withdrawn": gone,
    }


def _of_class(told: Told, part: Sequence[str], one: Mattering) -> dict[str, Any]:
    """A class whose best member does not matter need not be split; what helps none is gone."""
    if one.matters:
        return {**told, "worth": one.as_json(), "withdrawn": []}
    nothing: dict[str, Any] = {"effects": [], "class": [], "more_classes": [], "others": []}
    none = {**told, **nothing, "verdict": "none"}
    if one.is_confirmed:
        text = " or ".join(told.get("class", ()))
        return {**none, "withdrawn": [], "small": {"text": text, "worth": one.as_json()}}
    gone = [{"name": name, "parameters": {}, "worth": one.as_json()} for name in part]
    return {**none, "withdrawn": gone}


def _of_unknown(told: Told, part: Sequence[str], one: Mattering) -> dict[str, Any]:
    """An expression that does not matter is no answer: what it tells of is a little rest."""
    if one.matters or not told.get("unknown"):
        return {**told, "worth": one.as_json(), "withdrawn": []}
    rest = {**told["unknown"], "worth": one.as_json()}
    small: dict[str, Any] = {"unknown": None, "beside": [], "rest": None, "withdrawn": []}
    return {**told, **small, "verdict": "none", "small": rest}
