"""Whether an answer is right: the workflow's result against the truth that it never saw.

In: a case's folder, `result.json`'s content and the truth file, which is opened here and only
after the workflow has ended. Out: one verdict with everything that the tables need.

Rules. A named effect must be the hidden one and alone. A class must hold the hidden effect, and
each member, refitted here, must lie within 3 nats of it. Effects outside the library must be called
unknown, no effect none. Of two hidden effects both must be found; one of them and an admitted rest
is kept apart as found in part. A workflow that failed (`FAILED`) is wrong in every case.

The share of the gap that is closed has a floor that the workflow has no say in: what the judge's
own fit of the truth to the other flights leaves on the sealed ones.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.hidden_effects.measure import Floor, Measured, Strength, finite
from wakedeploy.gap.evidence.fits import told_by_data
from wakedeploy.gap.rules import sealed_count
from wakedeploy.gap.systems.gantry.flight import usable_flights
from wakedeploy.rig.file import read_rig

CLASS_NATS = 3.0
FAILED = "error"  # the verdict of a workflow that raised
_CHANNEL = "height 0.25 s ahead"

Result = Mapping[str, Any]
Truth = Mapping[str, Any]


def judge(folder: Path, result: Result, truth_path: Path) -> dict[str, Any]:
    """Measure the hidden effect's strength, decide, and compare every interval with the truth."""
    truth: Truth = json.loads(truth_path.read_text(encoding="utf-8"))
    judgement: dict[str, Any] = {
        key: truth[key] for key in ("name", "kind", "plant", "seed", "modes") if key in truth
    }
    judgement |= {"target_nats": truth["nats"], "hidden": hidden_names(truth)}
    judgement |= {"verdict": result["verdict"], "named": named(result), "class": members(result)}
    gains: dict[str, float] = {}
    floor = None
    if truth["kind"] != "none":
        rig = read_rig(folder / "rig.toml")
        flights, _ = usable_flights(sorted(folder.glob("flight*.mcap")), rig)
        measured = Measured(rig, flights)
        strength = measured.strength(truth["effects"], truth["outside"])
        judgement |= _strength(strength, truth)
        floor = measured.floor(strength.fit, sealed(folder, [f.name for f in flights]))
        judgement |= {"floor_m": floor.rms_m, "shows": floor.shows}
        gains = _class_gains(measured, truth, result)
        for name in set(judgement["hidden"]) & set(gains) if len(judgement["hidden"]) == 1 else ():
            gains[name] = max(gains[name], strength.nats)  # two fits of one thing: the better one
    judgement |= decided(truth, result, gains)
    judgement["class_gains"] = {name: finite(gain) for name, gain in gains.items()}
    judgement["beliefs"] = beliefs(truth, result)
    judgement["named_intervals"] = named_intervals(truth, result)
    judgement["closed"] = share_closed(result, floor)
    judgement["closed_by_own_floor"] = share_by_own_floor(result)
    return judgement


def hidden_names(truth: Truth) -> list[str]:
    """Names of all hidden effects, the library's first."""
    return [*truth["effects"], *truth["outside"]]


def named(result: Result) -> list[str]:
    """Effects that the workflow committed itself to, class members left out."""
    alternatives = members(result)
    return [e["name"] for e in result.get("effects", []) if e["name"] not in alternatives]


def members(result: Result) -> list[str]:
    """The members of the class, if that is the verdict."""
    return list(result.get("class") or []) if result["verdict"] == "class" else []


def decided(truth: Truth, result: Result, gains: Mapping[str, float]) -> dict[str, bool]:
    """`right`, and for pairs `partial`; `gains` are the class members', refitted [nats]."""
    verdict, hidden = result["verdict"], set(hidden_names(truth))
    found, alternatives = set(named(result)), members(result)
    kind = truth["kind"]
    if kind == "none":
        return {"right": verdict == "none", "partial": False}
    if kind == "outside":
        return {"right": verdict == "unknown", "partial": False}
    if verdict == "named":
        right = found == hidden
    elif verdict == "class":
        missing = hidden - found
        right = (
            found <= hidden
            and len(missing) == 1
            and missing <= set(alternatives)
            and fair_class(missing.pop(), alternatives, gains)
        )
    else:
        right = False
    if verdict == "unknown":
        found = {e["name"] for e in result.get("beside", [])}
    honest = bool(found) and found < hidden and verdict in ("unknown", "class")
    return {"right": right, "partial": kind == "pair" and not right and honest}


def fair_class(hidden: str, alternatives: Sequence[str], gains: Mapping[str, float]) -> bool:
    """Whether each member explains the data within 3 nats of what the hidden effect does."""
    return all(gains[hidden] - gains[name] <= CLASS_NATS for name in alternatives)


def named_intervals(truth: Truth, result: Result) -> list[dict[str, Any]]:
    """For each named effect that is hidden: parameter, interval, truth, and whether it is held."""
    rows = []
    for entry in result.get("effects", []):
        values = truth["effects"].get(entry["name"], {})
        for name, stated in entry.get("parameters", {}).items():
            if name in values and stated.get("low") is not None:
                rows.append(
                    _interval(entry["name"], name, stated["low"], stated["high"], values[name])
                )
    return rows


def beliefs(truth: Truth, result: Result) -> list[dict[str, Any]]:
    """For each effect of an answer, a class's members too: what it was held for, and the truth."""
    return [
        {
            "effect": e["name"],
            "confidence": e["confidence"],
            "hidden": e["name"] in truth["effects"],
        }
        for e in result.get("effects", [])
        if e.get("confidence") is not None
    ]


def sealed(folder: Path, flights: Sequence[str]) -> list[str]:
    """The flights that the workflow sealed; those that it would have, where it failed before.

    All of them where they are too few to seal any: then it shows what it fitted.
    """
    path = folder / "answer" / "show.json"
    if path.exists():
        return list(json.loads(path.read_text(encoding="utf-8"))["sealed"] or flights)
    return list(flights[-(sealed_count(len(flights)) or len(flights)) :])


def share_closed(result: Result, floor: Floor | None) -> float | None:
    """(G²before − G²after) / (G²before − G²floor), G the error 0.25 s ahead on sealed flights.

    None where the hidden effect does not show in that error: there is nothing to close. A workflow
    that failed has closed nothing of what does.
    """
    if floor is None or not floor.shows:
        return None
    if result["verdict"] == FAILED:
        return 0.0
    return _share(result, floor.rms_m)


def share_by_own_floor(result: Result) -> float | None:
    """The same with the floor that the workflow's corrected model expects of itself."""
    return _share(result, None)


def _share(result: Result, floor_m: float | None) -> float | None:
    channel = (result.get("gap") or {}).get(_CHANNEL)
    if channel is None:
        return None
    floor = (float(channel["noise_floor"]) if floor_m is None else floor_m) ** 2
    before, after = (float(channel[k]) ** 2 for k in ("before", "after"))
    return finite((before - after) / (before - floor)) if before > floor else None


def _strength(strength: Strength, truth: Truth) -> dict[str, Any]:
    rows = []
    for effect, values in truth["effects"].items():
        fitted = told_by_data(strength.fit, effect)
        for name, value in values.items():
            low, high = fitted.interval(f"{effect}.{name}")
            rows.append(_interval(effect, name, low, high, value))
    return {"nats": finite(strength.nats), "fitted_intervals": rows}


def _interval(effect: str, name: str, low: float, high: float, value: float) -> dict[str, Any]:
    interval = {"effect": effect, "parameter": name, "low": low, "high": high, "truth": value}
    return interval | {"held": bool(low <= value <= high)}


def _class_gains(measured: Measured, truth: Truth, result: Result) -> dict[str, float]:
    """Gains of the class's members and of the hidden effect that they stand for."""
    alternatives = members(result)
    if not alternatives:
        return {}
    found = [name for name in named(result) if name in truth["effects"]]
    given = None
    if found:
        given = measured.strength({name: truth["effects"][name] for name in found})
    wanted = [name for name in hidden_names(truth) if name not in found]
    return measured.gains(sorted({*alternatives, *wanted}), given)
