"""What becomes of an answer once sealed flights have judged it: confirmed, small, or withdrawn.

In: `name.json` as the search wrote it, and what its parts are worth (`mattering`). Out: the same
with a label for every effect, without what the sealed flights do not bear out. What does not matter
stays named, but is not added to the rig file unless a person asks.
"""

from collections.abc import Mapping, Sequence

from wakedeploy.gap.systems.gantry.artefacts import Name
from wakedeploy.gap.systems.gantry.findings import Effect, Expression
from wakedeploy.gap.systems.gantry.search.importance import Mattering, Removed


def parts_of(named: Name, hypothesis: Sequence[str]) -> list[tuple[str, ...]]:
    """What stands or falls together: each named effect alone, a class or an expression whole."""
    if not hypothesis or named.verdict in ("none", "inconclusive"):
        return []
    if named.verdict == "named":
        return [(name,) for name in hypothesis]
    return [tuple(hypothesis)]


def judged(named: Name, parts: Sequence[Sequence[str]], worth: Sequence[Mattering]) -> Name:
    """`name.json` after the sealed flights' judgement."""
    labels = {tuple(part): each for part, each in zip(parts, worth, strict=True)}
    if named.verdict == "named":
        return _of_names(named, {part[0]: each for part, each in labels.items()})
    if not labels:
        return named
    (part, worth_all), *_ = labels.items()
    if named.verdict == "class":
        return _of_class(named, part, worth_all)
    return _of_unknown(named, worth_all)


def unexplained(named: Name, worth: Removed) -> Name:
    """If flights disagree and nothing was found: "unknown" only if knowing it would help."""
    verdict = "unknown" if worth.clearly else "none"
    return named.model_copy(update={"verdict": verdict, "explainable": worth.as_artefact})


def _of_names(named: Name, labels: Mapping[str, Mattering]) -> Name:
    kept, gone = list[Effect](), list[Effect]()
    for effect in named.effects:
        label = labels[effect.name]
        entry = effect.model_copy(update={"worth": label.as_artefact})
        (kept if label.is_confirmed else gone).append(entry)
    verdict = "named" if kept else "none"
    return named.model_copy(update={"verdict": verdict, "effects": kept, "withdrawn": gone})


def _of_class(named: Name, part: Sequence[str], worth: Mattering) -> Name:
    """A class whose best member does not matter need not be split; if unconfirmed, it is gone."""
    if worth.matters:
        return named.model_copy(update={"worth": worth.as_artefact})
    nothing: dict[str, object] = {
        "verdict": "none",
        "effects": [],
        "rivals": [],
        "more_classes": [],
        "others": [],
    }
    if worth.is_confirmed:
        small = Expression(text=" or ".join(named.rivals), worth=worth.as_artefact)
        return named.model_copy(update={**nothing, "small": small})
    gone = [Effect(name=name, worth=worth.as_artefact) for name in part]
    return named.model_copy(update={**nothing, "withdrawn": gone})


def _of_unknown(named: Name, worth: Mattering) -> Name:
    """An expression that does not matter is no answer: what it explains is a small rest."""
    if worth.matters or named.unknown is None:
        return named.model_copy(update={"worth": worth.as_artefact})
    small = named.unknown.model_copy(update={"worth": worth.as_artefact})
    nothing: dict[str, object] = {"unknown": None, "beside": [], "rest": None}
    return named.model_copy(update={**nothing, "verdict": "none", "small": small})
