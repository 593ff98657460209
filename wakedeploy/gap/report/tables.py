"""The report's tables: places, ranking, noise, what could be detected, what was added, logs.

In: parts of the artefacts. Out: tables and sentences for the template; empty where there is nothing
to say.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from wakedeploy.core.pages import Table
from wakedeploy.gap.report.shrinkage import closed_words, gap_value, unchanged
from wakedeploy.gap.report.summary import (
    coordinate,
    detectable_sizes,
    place_words,
    undetectable,
    untold,
    whiteness_words,
)
from wakedeploy.gap.wording import (
    UNKNOWN,
    confidence,
    entries,
    interval,
    listed,
    mapping,
    measured,
    number,
    parameters_of,
    probability,
    quantity,
    spoken,
    texts,
    unit_of,
)

_MOST_PLACES, _MOST_RANKED = 16, 10
_NO_NATS = 0.05

Artefact = Mapping[str, Any]


def place_table(places: Sequence[Artefact]) -> Table:
    """The places where the disagreement is significant, the strongest first."""
    rows = [
        [
            place_words(place).split(":")[0],
            str(place.get("channel") or UNKNOWN),
            "known beforehand" if place.get("exogenous") else "fed back",
            quantity(place.get("residual"), unit_of(place), signed=True),
            probability("q", place.get("q_value")),
        ]
        for place in places[:_MOST_PLACES]
    ]
    if len(places) > _MOST_PLACES:
        rows.append([f"and {len(places) - _MOST_PLACES} more in find.json", "", "", "", ""])
    return Table(["place", "channel", "coordinate", "residual", "significance"], rows)


def ranking_table(name: Artefact) -> Table:
    """The best of the first round with gain, confidence and fitted values."""
    rounds = entries(name.get("rounds"))
    ranking = ranked(rounds[0]) if rounds else []
    rows = [_ranked(candidate) for candidate in ranking[:_MOST_RANKED]]
    titles = ["effect alone", "gain [nats]", "confidence", "values"]
    if all(math.isnan(number(each.get("confidence"))) for each in ranking):
        titles, rows = [*titles[:2], titles[3]], [[*row[:2], row[3]] for row in rows]
    return Table(titles, rows)


def ranked(round_: Artefact) -> list[Artefact]:
    """The effects of a round whose gain is known, the best first."""
    known = entries(round_.get("ranking"))
    known = [each for each in known if not math.isnan(number(each.get("gain_nats")))]
    return sorted(known, key=lambda each: -number(each.get("gain_nats")))


def _ranked(candidate: Artefact) -> list[str]:
    values = ", ".join(f"{spoken(name)} {value}" for name, value in parameters_of(candidate))
    gain = _gain(candidate)
    return [str(candidate.get("name")), gain, confidence(candidate.get("confidence")), values]


def _gain(candidate: Artefact) -> str:
    """A gain in nats with its interval; below a twentieth of one it says nothing."""
    nats, ends = number(candidate.get("gain_nats")), interval(candidate.get("interval"))
    if max(map(abs, (nats, *ends))) < _NO_NATS:
        return "0.0"
    return measured(nats, *ends, "")


def noise_table(noise: Artefact) -> Table:
    """The noise model as fitted together with what was found."""
    rows = [
        [spoken(str(name)), quantity(mapping(value).get("value"), unit_of(mapping(value)))]
        for name, value in noise.items()
    ]
    return Table(["noise", "value"], rows)


def detectable_table(name: Artefact) -> Table:
    """The smallest size of each effect that would have shown; the answer if nothing is missing."""
    rows = [list(row) for row in detectable_sizes(name)]
    rows += [[hidden, UNKNOWN, "no plausible size"] for hidden in undetectable(name)]
    rows += [[bent, UNKNOWN, "not known: far from linear"] for bent in untold(name)]
    return Table(["effect", "parameter", "off by"], rows)


def unknown_effect(unknown: Artefact) -> dict[str, object]:
    """The expression for an effect without a name, and what it depends on."""
    if not unknown:
        return {}
    names = [coordinate(each) for each in texts(unknown.get("coordinates"))]
    return {
        "depends": f"What is left depends on the {listed(names)}." if names else "",
        "lines": [str(unknown[key]) for key in ("text", "expression") if unknown.get(key)],
        "coefficients": Table(["coefficient", "value (90 % interval)"], parameters_of(unknown)),
    }


def added_effects(effects: Sequence[Artefact]) -> Table:
    """The values that the new rig file states."""
    rows = [
        [str(effect.get("name")), parameter, value]
        for effect in effects
        for parameter, value in parameters_of(effect) or [(UNKNOWN, UNKNOWN)]
    ]
    return Table(["effect", "parameter", "value (90 % interval)"], rows)


def gap_table(gap: Artefact) -> Table:
    """Every channel before, after, floor, and the share of the gap that is closed."""
    channels = [(str(name), mapping(channel)) for name, channel in gap.items()]
    rows = [
        [
            name,
            *(gap_value(channel, key) for key in ("before", "after", "noise_floor")),
            UNKNOWN if unchanged(channel) else closed_words(channel) or UNKNOWN,
        ]
        for name, channel in channels
    ]
    return Table(["channel", "before", "after", "noise alone", "closed"], rows)


def whiteness(white: Artefact, of: str) -> str:
    """One sentence: whether what is left looks like noise, which is no proof that it is."""
    if white.get("passes") is None:
        return ""
    left = "cannot be told from noise" if white["passes"] else "are more than noise"
    return f"For {of}, the innovations {left} ({whiteness_words(white)})."


def log_rows(logs: Sequence[Artefact], sealed: Sequence[str]) -> list[dict[str, str]]:
    """Every log read: length, use, notes, hash."""
    return [_log_row(log, sealed) for log in logs]


def _log_row(log: Artefact, sealed: Sequence[str]) -> dict[str, str]:
    path = str(log.get("path"))
    return {
        "path": path,
        "length": quantity(log.get("seconds"), "s"),
        "samples": f"{number(log.get('samples')):.0f}".replace("nan", UNKNOWN),
        "use": "sealed" if any(_same(path, name) for name in sealed) else "fitted",
        "notes": "; ".join(texts(log.get("notes"))),
        "sha256": str(log.get("sha256") or UNKNOWN)[:12],
    }


def _same(path: str, name: str) -> bool:
    """A split names logs by path or by file name, with or without the ending."""
    last = path.replace("\\", "/").rsplit("/", 1)[-1]
    return name in (path, last, last.rsplit(".", 1)[0])
