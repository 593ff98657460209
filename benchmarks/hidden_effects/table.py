"""The benchmark's tables, from its lines: what was answered, how often that was right, how sure.

In: lines of `cases.jsonl`. Out: a summary as plain data, as text and as a Markdown page.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

Line = Mapping[str, Any]
BINS = ((0.0, 10.0), (10.0, 25.0), (25.0, 50.0), (50.0, 100.0), (100.0, math.inf))
BELIEFS = ((0.0, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 0.99), (0.99, 1.0))
_Z95 = 1.959963984540054


def wilson(successes: int, trials: int, z: float = _Z95) -> tuple[float, float]:
    """Wilson's score interval for a proportion (1927), 95 % by default; (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    share, z2 = successes / trials, z * z
    centre = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    reach = z / (1 + z2 / trials)
    reach *= math.sqrt(share * (1 - share) / trials + z2 / (4 * trials * trials))
    return max(0.0, centre - reach), min(1.0, centre + reach)


def summary(lines: Sequence[Line]) -> dict[str, Any]:
    """Everything that the page shows, ready for JSON.

    A case on which the workflow failed counts as wrong, and as a false alarm where nothing was
    hidden; its time and intervals are not known.
    """
    singles = [line for line in lines if line["kind"] == "effect"]
    pairs = [line for line in lines if line["kind"] == "pair"]
    strong = [line for line in singles if (line.get("nats") or 0.0) >= 50.0]
    weak = [line for line in singles if 15.0 <= (line.get("nats") or 0.0) < 50.0]
    none = [line for line in lines if line["kind"] == "none"]
    commits = sorted({line.get("commit", "") for line in lines})
    return {
        "commits": commits,
        "by_commit": {
            commit: {
                "cases": len(of_it := [line for line in lines if line.get("commit", "") == commit]),
                "seconds": spread(line["seconds"] for line in of_it),
                "longest_seconds": max((line["seconds"] or 0.0 for line in of_it), default=0.0),
                **rates_with_a_bar(of_it),
            }
            for commit in commits
        },
        "cases": dict(Counter(line["kind"] for line in lines)),
        "errors": {line["name"]: line["error"] for line in lines if "error" in line},
        **rates_with_a_bar(lines),
        **rates_beside(lines),
        "pairs_right": _rate(line["right"] for line in pairs),
        "pairs_in_part": _rate(line["partial"] and line["verdict"] != "named" for line in pairs),
        "by_nats": [_bin(singles, low, high) for low, high in BINS],
        "by_plant": {
            plant: _rate(line["right"] for line in (*strong, *weak) if line["plant"] == plant)
            for plant in ("first", "second")
        },
        "false_alarms_by_plant": {
            plant: _rate(line["verdict"] != "none" for line in none if line["plant"] == plant)
            for plant in ("first", "second")
        },
        "coverage_fitted": coverage(r for line in lines for r in line.get("fitted_intervals", [])),
        "coverage_named": coverage(row for line in lines for row in line["named_intervals"]),
        "belief": belief(row for line in lines for row in line.get("beliefs", [])),
        "closed_from_50_nats": spread(closed(line) for line in (*strong, *pairs)),
        "closed_by_a_member": spread(line["closed"] for line in (*strong, *pairs)),
        "closed_by_own_floor": spread(
            line.get("closed_by_own_floor") for line in (*strong, *pairs)
        ),
        "does_not_show": _rate(
            not line["shows"] for line in (*strong, *pairs) if line.get("shows") is not None
        ),
        "class_size": spread(len(line["class"]) for line in lines if line["class"]),
        "seconds": spread(line["seconds"] for line in lines),
        "tracking": tracking(lines),
        "confusion": confusion(lines),
    }


def rates_with_a_bar(lines: Sequence[Line]) -> dict[str, dict[str, Any]]:
    """How often single effects are named, nothing is found where nothing is, and so on."""
    singles = [(line.get("nats") or 0.0, line) for line in lines if line["kind"] == "effect"]
    none = [line for line in lines if line["kind"] == "none"]
    return {
        "right_from_50_nats": _rate(line["right"] for nats, line in singles if nats >= 50.0),
        "right_15_to_50_nats": _rate(
            line["right"] for nats, line in singles if 15.0 <= nats < 50.0
        ),
        "false_alarms": _rate(line["verdict"] != "none" for line in none),
        "unknown_outside": _rate(line["right"] for line in lines if line["kind"] == "outside"),
    }


def rates_beside(lines: Sequence[Line]) -> dict[str, dict[str, Any]]:
    """Rates without a bar: of effects that show in the forecast error, and of those outside.

    Whether an effect shows is the judge's own measurement.
    """
    singles, outside = (
        [line for line in lines if line["kind"] == kind and (line.get("nats") or 0.0) >= 15.0]
        for kind in ("effect", "outside")
    )
    every_outside = [line for line in lines if line["kind"] == "outside"]
    return {
        "right_shown": _rate(line["right"] for line in singles if line.get("shows")),
        "right_not_shown": _rate(line["right"] for line in singles if line.get("shows") is False),
        "unknown_outside_from_15_nats": _rate(line["right"] for line in outside),
        "unknown_outside_shown": _rate(line["right"] for line in outside if line.get("shows")),
        "outside_or_unseen": _rate(line["right"] or unseen(line) for line in every_outside),
    }


def unseen(line: Line) -> bool:
    """Whether "nothing that matters" is true: what was hidden does not show ahead.

    The judge measures that by its own fit of the truth, of which the workflow knows nothing.
    """
    return line["verdict"] == "none" and line.get("shows") is False


def tracking(lines: Iterable[Line]) -> dict[str, Any]:
    """Cases of which both predictors were flown, by name, and the geometric mean of the ratios."""
    flown = [line for line in lines if "tracking" in line]
    ratios = [t["ratio"] for line in flown if (t := line["tracking"]) and t["ratio"]]
    return {
        "cases": {
            line["name"]: {
                "plant": line["plant"],
                "verdict": line["verdict"],
                "right": line["right"],
                "error": line.get("tracking_error"),
                "flown": line["tracking"],
            }
            for line in sorted(flown, key=lambda line: str(line["name"]))
        },
        "mean_ratio": math.exp(sum(map(math.log, ratios)) / len(ratios)) if ratios else None,
        "count": len(ratios),
    }


def closed(line: Line) -> float | None:
    """The share of the gap closed by what was added: of a class, nothing is."""
    return 0.0 if line["closed"] is not None and line["class"] else line["closed"]


def coverage(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """How often 90 % intervals held the truth: per effect, and "all"."""
    held: dict[str, list[bool]] = {"all": []}
    for row in rows:
        held["all"].append(row["held"])
        held.setdefault(row["effect"], []).append(row["held"])
    return {name: _rate(values) for name, values in held.items()}


def belief(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """How often what was held for so sure was so: one row per range of confidence, if any."""
    known, belief_rows = list(rows), []
    for low, high in BELIEFS:
        ends_it = high == BELIEFS[-1][1]
        inside = [
            r for r in known if low <= r["confidence"] and (r["confidence"] < high or ends_it)
        ]
        if inside:
            held = sum(r["confidence"] for r in inside) / len(inside)
            belief_rows.append(
                {"from": low, "to": high, "held": held} | _rate(r["hidden"] for r in inside)
            )
    return belief_rows


def confusion(lines: Sequence[Line]) -> dict[str, dict[str, int]]:
    """Hidden effect → answer → count; a class that holds the hidden effect counts as "class"."""
    table: dict[str, Counter[str]] = {}
    for line in lines:
        if line["kind"] == "pair":
            continue
        hidden = line["hidden"][0] if line["hidden"] else "none"
        table.setdefault(hidden, Counter())[answer(line, hidden)] += 1
    return {hidden: dict(counts) for hidden, counts in table.items()}


def answer(line: Line, hidden: str) -> str:
    """One word for an answer: an effect, "class", "other class", "several", or the verdict."""
    if line["verdict"] == "named":
        return str(line["named"][0]) if len(line["named"]) == 1 else "several"
    if line["verdict"] == "class":
        return "class" if hidden in line["class"] and not line["named"] else "other class"
    return str(line["verdict"])


def spread(values: Iterable[float | None]) -> dict[str, float] | None:
    """Mean, median and extremes of what is known; None without any."""
    known = sorted(v for v in values if v is not None and math.isfinite(v))
    if not known:
        return None
    mean, middle = sum(known) / len(known), known[len(known) // 2]
    least, most = known[0], known[-1]
    return {"mean": mean, "median": middle, "least": least, "most": most, "count": len(known)}


def _rate(flags: Iterable[bool]) -> dict[str, float]:
    values = [bool(flag) for flag in flags]
    count, total = sum(values), len(values)
    low, high = wilson(count, total)
    share = count / total if total else math.nan
    return {"count": count, "of": total, "share": share, "low": low, "high": high}


def _bin(lines: Sequence[Line], low: float, high: float) -> dict[str, Any]:
    inside = [line for line in lines if low <= (line.get("nats") or 0.0) < high]
    rate = _rate(line["right"] for line in inside)
    shares = {"low_share": rate.pop("low"), "high_share": rate.pop("high")}
    return {"low": low, "high": high} | rate | shares
