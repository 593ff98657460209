"""The report's tables: places, ranking, noise, what could be detected, what was added, logs.

In: parts of the artefacts. Out: tables and sentences for the template; empty where there is nothing
to say.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

from wakedeploy.core.pages import Table
from wakedeploy.core.rig import Effect as RigEffect
from wakedeploy.gap.report.phrases import (
    coordinate,
    detectable_sizes,
    place_words,
    undetectable,
    untold,
    whiteness_words,
)
from wakedeploy.gap.report.shrinkage import closed_words, gap_values, unchanged
from wakedeploy.gap.search.artefacts import Place, Quantity, White
from wakedeploy.gap.systems.gantry.artefacts import Log, Unflown
from wakedeploy.gap.systems.gantry.findings import Detectable, Expression, Gap, Ranked, Sizes
from wakedeploy.gap.wording import (
    UNKNOWN,
    confidence,
    listed,
    measured,
    probability,
    quantity,
    spoken,
)

_MOST_PLACES, _MOST_RANKED = 16, 10
_NO_NATS = 0.05


def place_table(places: Sequence[Place]) -> Table:
    """The places where the disagreement is significant, the strongest first."""
    rows = [
        [
            place_words(place).split(":")[0],
            place.channel,
            "known beforehand" if place.exogenous else "fed back",
            quantity(place.residual, place.unit, signed=True),
            probability("q", place.q_value),
        ]
        for place in places[:_MOST_PLACES]
    ]
    if len(places) > _MOST_PLACES:
        rows.append([f"and {len(places) - _MOST_PLACES} more in find.json", "", "", "", ""])
    return Table(["place", "channel", "coordinate", "residual", "significance"], rows)


def ranking_table(ranking: Iterable[Ranked]) -> Table:
    """The best of a round with gain, confidence and fitted values."""
    best = ranked(ranking)
    rows = [_ranked(candidate) for candidate in best[:_MOST_RANKED]]
    titles = ["effect alone", "gain [nats]", "confidence", "values"]
    if all(math.isnan(each.confidence) for each in best):
        titles, rows = [*titles[:2], titles[3]], [[*row[:2], row[3]] for row in rows]
    return Table(titles, rows)


def ranked(ranking: Iterable[Ranked]) -> list[Ranked]:
    """The effects of a round whose gain is known, the best first."""
    known = [each for each in ranking if not math.isnan(each.gain_nats)]
    return sorted(known, key=lambda each: -each.gain_nats)


def values_of(sizes: Sizes) -> list[tuple[str, str]]:
    """Name and measured value of every parameter."""
    return [(name, measured(p.value, p.low, p.high, p.unit)) for name, p in sizes.items()]


def _ranked(candidate: Ranked) -> list[str]:
    values = ", ".join(f"{spoken(name)} {value}" for name, value in values_of(candidate.parameters))
    return [candidate.name, _gain(candidate), confidence(candidate.confidence), values]


def _gain(candidate: Ranked) -> str:
    """A gain in nats with its interval; below a twentieth of one it says nothing."""
    nats, ends = candidate.gain_nats, candidate.interval
    if max(map(abs, (nats, *ends))) < _NO_NATS:
        return "0.0"
    return measured(nats, *ends, "")


def noise_table(noise: Mapping[str, Quantity]) -> Table:
    """The noise model as fitted together with what was found."""
    rows = [[spoken(name), quantity(each.value, each.unit)] for name, each in noise.items()]
    return Table(["noise", "value"], rows)


def detectable_table(sizes: Mapping[str, Detectable]) -> Table:
    """The smallest size of each effect that would have shown; the answer if nothing is missing."""
    rows = [list(row) for row in detectable_sizes(sizes)]
    rows += [[hidden, UNKNOWN, "no plausible size"] for hidden in undetectable(sizes)]
    rows += [[bent, UNKNOWN, "not known: far from linear"] for bent in untold(sizes)]
    return Table(["effect", "parameter", "off by"], rows)


def unknown_effect(unknown: Expression | None) -> dict[str, object]:
    """The expression for an effect without a name, and what it depends on."""
    if unknown is None:
        return {}
    names = [coordinate(each) for each in unknown.coordinates]
    return {
        "depends": f"What is left depends on the {listed(names)}." if names else "",
        "lines": [each for each in (unknown.text, unknown.expression) if each],
        "coefficients": Table(
            ["coefficient", "value (90 % interval)"], values_of(unknown.parameters)
        ),
    }


def added_effects(effects: Sequence[RigEffect]) -> Table:
    """The values that the new rig file states."""
    rows = []
    for effect in effects:
        values = [
            (name, measured(p.value, p.low, p.high, p.unit))
            for name, p in effect.parameters.items()
        ]
        rows += [[effect.name, *pair] for pair in values or [(UNKNOWN, UNKNOWN)]]
    return Table(["effect", "parameter", "value (90 % interval)"], rows)


def gap_table(gap: Mapping[str, Gap]) -> Table:
    """Every channel before, after, floor, and the share of the gap that is closed."""
    rows = [
        [
            name,
            *gap_values(channel),
            UNKNOWN if unchanged(channel) else closed_words(channel) or UNKNOWN,
        ]
        for name, channel in gap.items()
    ]
    return Table(["channel", "before", "after", "noise alone", "closed"], rows)


def whiteness(white: White | None, of: str) -> str:
    """One sentence: whether what is left looks like noise, which is no proof that it is."""
    if white is None:
        return ""
    verdict = "cannot be told from noise" if white.passes else "are more than noise"
    return f"For {of}, the innovations {verdict} ({whiteness_words(white)})."


def log_rows(logs: Sequence[Log], sealed: Sequence[str]) -> list[dict[str, str]]:
    """Every log read: length, use, notes, hash."""
    return [
        {
            "path": log.path,
            "length": quantity(log.seconds, "s"),
            "samples": str(log.samples),
            "use": "sealed" if log.path in sealed else "fitted",
            "notes": "; ".join(log.notes),
            "sha256": log.sha256[:12],
        }
        for log in logs
    ]


def unflown_rows(logs: Sequence[Unflown]) -> list[dict[str, str]]:
    """Every log that was left out, in the columns of `log_rows`."""
    blank = {"length": UNKNOWN, "samples": UNKNOWN, "sha256": UNKNOWN}
    return [{"path": log.path, "use": "left out", "notes": log.why} | blank for log in logs]
