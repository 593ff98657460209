"""What an answer about one of these gantries is worth.

In: a case and `result.json`. Out: one row for the table.

Rules. Without an effect, only "nothing that matters" is right: the verdict none, or names that
are all labelled too small to matter. With one, the name or a class of at most three that holds it;
"unknown" is useless. "None" is right where the effect, known by name, would remove no twentieth of
the squared forecast error on the sealed flights at any horizon; else the effect was missed. What
was put into the rig file must not make the sealed forecast worse.
"""

from collections.abc import Mapping
from typing import Any

from benchmarks.form_error.cases import Case, jet_of_case
from benchmarks.form_error.plan import hidden_name
from wakedeploy.core.rig import Rig
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.importance import Removed

_AHEAD = "height 0.25 s ahead"


def row(
    case: Case,
    result: Mapping[str, Any],
    rig: Rig,
    seconds: float,
    worth: Mapping[float, Removed],
) -> dict[str, Any]:
    """One case, judged; `worth` is what the hidden removes, by horizon [s]."""
    jet, hidden = jet_of_case(case, rig), hidden_name(case)
    effects = [e for e in result["effects"] if (e.get("worth") or {}).get("matters", True)]
    small = [e["name"] for e in result["effects"] if e not in effects]
    channel = result["gap"][_AHEAD]
    added = result["verdict"] == "named" and bool(effects)
    named = [e["name"] for e in effects]
    matters = any(removed.share >= RULES.least_share for removed in worth.values())
    return {
        "case": case.name,
        "jet": case.jet,
        "misfit_share": jet.misfit_share,
        "misfit_n": jet.misfit_n,
        "dose": case.misfit,
        "hidden": hidden,
        "verdict": result["verdict"],
        "matters": matters,
        "worth": {f"{horizon:g}": removed.share for horizon, removed in worth.items()},
        "named": named,
        "small": small,
        "class": result["class"],
        "withdrawn": [e["name"] for e in result.get("withdrawn", [])],
        "unknown": (result.get("unknown") or {}).get("text"),
        "before_m": channel["before"],
        "after_m": channel["after"],
        "added_worse": added and channel["after"] > channel["before"],
        "answer": answer_of(hidden, result["verdict"], named, small, result, matters=matters),
        "seconds": seconds,
    }


def answer_of(
    hidden: str,
    verdict: str,
    named: list[str],
    small: list[str],
    result: Mapping[str, Any],
    matters: bool = True,
) -> str:
    """`right`, `useless`, `wrong`, `missed` or `false alarm`."""
    members = list(result["class"])
    if not hidden:
        nothing = verdict == "none" or (verdict == "named" and not named)
        return "right" if nothing else "false alarm"
    if verdict == "unknown":
        return "useless"
    if verdict == "class" or members:
        return "right" if hidden in members and len(members) <= 3 else "wrong"
    if hidden in (*named, *small):
        return "right"
    if named:
        return "wrong"
    return "missed" if matters else "right"
