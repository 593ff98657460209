"""What a step found in a user's system, as sentences for a terminal."""

from collections.abc import Mapping
from typing import Any

from wakedeploy.gap.search.judging import ACCEPTED, CHANCE
from wakedeploy.gap.wording import listed

_MOST_PLACES, _MOST_RANKED = 6, 5


def sentences(step: str, told: Mapping[str, Any]) -> list[str]:
    """The lines that a command prints."""
    if step == "find":
        return _found(told)
    lines = [_verdict(told), *_effects(told), *_unexplained(told), *_rejected(told)]
    if "gap" in told:
        lines += _gap(told)
    return lines


def _found(told: Mapping[str, Any]) -> list[str]:
    places = told["where"]
    if not places:
        return ["The system and its logs disagree nowhere beyond noise."]
    lines = [f"They disagree in {len(places)} places; the clearest:"]
    for p in places[:_MOST_PLACES]:
        lines.append(
            f"  {p['channel']}: {p['residual']:+.3g} {p['unit']} where {p['coordinate']} is "
            f"{p['low']:.3g} to {p['high']:.3g} {p['coordinate_unit']}"
        )
    return lines


def _verdict(told: Mapping[str, Any]) -> str:
    names = [e["name"] for e in told["effects"]]
    if told["verdict"] == "class":
        return f"The system lacks one of {listed(told['class'], 'or')}: the logs cannot say which."
    if told["verdict"] == "named":
        return f"The system lacks {listed(names)}."
    if told["verdict"] == "none":
        return "Nothing that matters is missing from the system."
    return "Something acts on the system that no known effect explains."


def _effects(told: Mapping[str, Any]) -> list[str]:
    lines = []
    for effect in told["effects"]:
        sizes = ", ".join(
            f"{n} {p['value']:.4g} [{p['low']:.4g}, {p['high']:.4g}] {p['unit']}"
            for n, p in effect["parameters"].items()
        )
        share = effect["forecast"]
        lines.append(
            f"  {effect['name']}: {sizes}; removes {_percent(share['share'])} of the squared "
            "forecast error where it was not fitted "
            f"[{_percent(share['low'])}, {_percent(share['high'])}]"
        )
    for name in told.get("unsettled", ()):
        lines.append(f"  The fit with {name} had not settled: its size is a lower guess.")
    return lines


def _unexplained(told: Mapping[str, Any]) -> list[str]:
    """What still acts: on which rate, how large, how long, and what it follows."""
    lines = []
    for one in told.get("unexplained", ()):
        lines.append(
            f"  Not explained: on {one['state']}, {one['sd']:.3g} {one['unit']} (sd) that last "
            f"{one['lasts_s']:.2g} s, {_percent(one['share'])} of the usual rate."
        )
        at = one["against"]
        if at is not None:
            lines.append(
                f"    It follows {at['coordinate']}, which tells {_percent(at['share'])} of it: "
                f"from {at['means'][0]:+.3g} {one['unit']} at {at['edges'][0]:.3g} {at['unit']} "
                f"to {at['means'][-1]:+.3g} {one['unit']} at {at['edges'][-1]:.3g} {at['unit']}."
            )
    return lines


def _percent(share: float) -> str:
    """A share in whole percent; what is not all of it never reads as all of it."""
    return "over 99%" if 0.99 < share < 1.0 else f"{share:.0%}"


def _rejected(told: Mapping[str, Any]) -> list[str]:
    """Of the last round, what was evident and yet not named, and why."""
    if not told["rounds"]:
        return []
    lines = []
    for entry in told["rounds"][-1]["ranking"][:_MOST_RANKED]:
        why = entry.get("judged", "")
        if why and why not in (ACCEPTED, CHANCE):
            lines.append(f"  Not named: {entry['name']}: {why}.")
    return lines


def _gap(told: Mapping[str, Any]) -> list[str]:
    return [
        f"  {name}: forecasts over {told['forecast_s']:.3g} s were off by {g['before']:.4g}, now "
        f"by {g['after']:.4g} {g['unit']} (rms, sealed blocks)"
        for name, g in told["gap"].items()
    ]
