"""The report of a domain: one self-contained HTML page and its figures.

In: the document of `closing.close` with what the domain itself adds, as in `domain.json`. Out:
`report.html` and `figures/*.png` in the same folder. May import what `wakedeploy.gap` may.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core import figures, pages
from wakedeploy.core.files import write_text_whole
from wakedeploy.gap.report import system_charts
from wakedeploy.gap.report.charts import draw_gaps, draw_ranking
from wakedeploy.gap.report.maps import draw_places
from wakedeploy.gap.report.summary import place_words
from wakedeploy.gap.report.tables import ranking_table, whiteness
from wakedeploy.gap.wording import (
    UNKNOWN,
    counted,
    entries,
    listed,
    mapping,
    number,
    numbers,
    parameters_of,
    probability,
    quantity,
    texts,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_PLACES = 12
_CAPTIONS = {
    "places": (
        "The mean residual on the sealed episodes over every coordinate, before and after; the six "
        "that change most."
    ),
    "ranking": (
        "What each effect gains on episodes that it was not fitted to, with 90 % intervals over "
        "the episodes. Left of the threshold is what simulations of the baseline gain by chance. "
        "Orange: accepted; blue: above the threshold and not chosen."
    ),
    "gap": "Error per channel, noise not removed.",
    "trace": "The sealed episode whose error fell by the median share.",
    "autocorrelation": (
        "Whitened innovations of the fitted episodes: noise alone stays within the band 19 times "
        "in 20."
    ),
}

Document = Mapping[str, Any]
Drawing = Callable[[Document], "Figure | None"]


def write_page(
    document: Document,
    out: Path,
    *,
    said: Sequence[str] = (),
    next_commands: Sequence[str] = (),
) -> Path:
    """Draw the figures and write `report.html` into `out`; returns the page's path.

    `said` is the answer in sentences, where there is more to say than the verdict; `next_commands`
    stand on the page, to copy.

    Raises UnusableInput when the page or a figure cannot be written.
    """
    title = f"Simulation against measurement: {document.get('domain')}"
    accounts = [_account(title, document, out, "")]
    if far := mapping(document.get("far")):
        accounts.append(_account("The same, where no wake is", far, out, "far_"))
    told = {"title": title, "accounts": accounts, "further": _further(document, out)}
    told |= {"next": next_commands, "said": said}
    path = out / "report.html"
    write_text_whole(path, pages.page("wakedeploy.gap.report", "system.html", **told))
    return path


def doubt_sentence(document: Document) -> str:
    """Which of the effects found the sealed episodes speak against; "" for none."""
    doubted = texts(document.get("doubted"))
    if not doubted:
        return ""
    return f"Doubt {listed(doubted)}: with it, the error on the sealed episodes grew."


def _account(title: str, document: Document, out: Path, prefix: str) -> dict[str, Any]:
    """Verdict, where, which, how much smaller."""
    shown = mapping(document.get("shown"))

    def draw(name: str, drawing: Drawing, of: Document = document) -> pages.Picture | None:
        return _picture(out / "figures" / f"{prefix}{name}.png", _CAPTIONS[name], drawing, of)

    episodes, sealed = (len(texts(document.get(key))) for key in ("episodes", "sealed"))
    return {
        "title": title,
        "counts": f"{counted(episodes, 'episode')}, {sealed} of them sealed",
        "verdict": _verdict(document),
        "sizes": _sizes(document),
        "places": _places(document),
        "alone": _alone(document),
        "placebo": _placebo(document),
        "doubt": doubt_sentence(document),
        "white": _white(document),
        "pictures": {
            "places": draw("places", lambda told: draw_places(told, {}), shown),
            "ranking": draw("ranking", draw_ranking),
            "gap": draw("gap", draw_gaps),
            "trace": draw("trace", system_charts.draw_trace, mapping(shown.get("trace"))),
            "autocorrelation": draw("autocorrelation", system_charts.draw_autocorrelation),
        },
    }


def _verdict(document: Document) -> str:
    names = [str(effect.get("name")) for effect in entries(document.get("effects"))]
    rivals = texts(document.get("class"))
    too_many = f"The baseline lacks one of {listed(rivals, 'or')}: too many to call it a class."
    told = {
        "named": f"The baseline lacks {listed(names)}.",
        "class": f"The baseline lacks one of {listed(rivals, 'or')}: they cannot be told apart.",
        "unknown": too_many if rivals else "The baseline lacks what no single effect explains.",
        "none": "Nothing is missing from the baseline beyond noise.",
    }
    return told.get(str(document.get("verdict")), "No verdict.")


def _sizes(document: Document) -> pages.Table:
    rows = [
        [str(effect.get("name")), parameter, value]
        for effect in entries(document.get("effects"))
        for parameter, value in parameters_of(effect)
    ]
    return pages.Table(["effect", "parameter", "value (90 % interval)"], rows)


def _places(document: Document) -> pages.Table:
    found = entries(document.get("where"))
    rows = [
        [
            place_words(place).split(":")[0],
            str(place.get("channel") or UNKNOWN),
            quantity(place.get("residual"), str(place.get("unit", "")), signed=True),
            probability("q", place.get("q_value")),
        ]
        for place in found[:_MOST_PLACES]
    ]
    if len(found) > _MOST_PLACES:
        rows.append([f"and {len(found) - _MOST_PLACES} more in domain.json", "", "", ""])
    return pages.Table(["place", "channel", "mean residual", "significance"], rows)


def _alone(document: Document) -> pages.Table | None:
    """The first ranking as a table; the parameters without their effect's name."""
    rounds = entries(document.get("rounds"))
    if not rounds:
        return None
    ranking = [
        {
            **each,
            "parameters": {
                name.removeprefix(f"{each.get('name')}."): value
                for name, value in mapping(each.get("parameters")).items()
            },
        }
        for each in entries(rounds[0].get("ranking"))
    ]
    return ranking_table({"rounds": [{"ranking": ranking}]})


def _placebo(document: Document) -> str:
    placebo = mapping(document.get("placebo"))
    if not placebo:
        return ""
    channels = [(str(n), str(mapping(c).get("unit"))) for n, c in mapping(document["gap"]).items()]
    left = [
        f"{name} {quantity(before, unit)} → {quantity(after, unit)}"
        for (name, unit), before, after in zip(
            channels, numbers(placebo.get("before")), numbers(placebo.get("after")), strict=True
        )
    ]
    nats = [number(of.get("sealed_gain_nats")) for of in (placebo, document)]
    return (
        f"The best other effect instead, {placebo.get('name')}: {'; '.join(left)}. On the sealed "
        f"episodes it gains {nats[0]:.1f} nats, what was found {nats[1]:.1f}."
    )


def _white(document: Document) -> list[str]:
    white = mapping(document.get("white"))
    return [
        whiteness(mapping(white.get("before")), "the baseline"),
        whiteness(mapping(white.get("after")), "the baseline with what was found"),
    ]


def _further(document: Document, out: Path) -> list[object]:
    """What only this domain tells: an independent estimate, a profile, an audit, the truth."""
    folder = out / "figures"
    parts = [
        _single_steps(mapping(document.get("single_steps"))),
        _picture(
            folder / "delay_profile.png",
            "The largest log likelihood at each transport delay, everything else refitted. Lower "
            "summits are aliases; how far they lie below the best is what speaks against them.",
            system_charts.draw_delay_profile,
            mapping(document.get("delay_profile")),
        ),
        _picture(
            folder / "phase_delay.png",
            "The phase delay from foil to tip over the frequency, from the cross-spectrum: an "
            "estimate that takes no model.",
            system_charts.draw_phase_delay,
            mapping(document.get("phase_delay")),
        ),
        _label(mapping(document.get("label"))),
        _hidden(mapping(document.get("hidden"))),
    ]
    return [part for part in parts if part]


def _single_steps(steps: Document) -> pages.Table:
    """Motor: an exponential fitted to each step alone."""
    rows = [
        [way, str(mapping(steps.get(way)).get("steps")),
         quantity(mapping(steps.get(way)).get("median_s"), "s")]
        for way in ("up", "down")
        if way in steps
    ]  # fmt: skip
    return pages.Table(
        ["exponential fitted to each step alone", "steps", "median time constant"], rows
    )


def _label(groups: Document) -> pages.Table:
    """Quadrotor: the label as published, and with what turning axes keep back given back to it."""
    columns = (("seconds", "s"), ("label_rms_n", "N"), ("corrected_rms_n", "N"))
    rows = [
        [name, *(quantity(mapping(group).get(key), unit) for key, unit in columns)]
        for name, group in groups.items()
    ]
    return pages.Table(
        ["flights", "recorded", "vertical label, rms", "axes not turning, rms"], rows
    )


def _hidden(truth: Document) -> pages.Table:
    """Downwash: what had been put in."""
    rows = [[name, f"{number(value):g}"] for name, value in truth.items()]
    return pages.Table(["what had been hidden", "value"], rows)


def _picture(path: Path, caption: str, drawing: Drawing, of: Document) -> pages.Picture | None:
    with figures.style():
        figure = drawing(of)
    if figure is None:
        path.unlink(missing_ok=True)  # of an earlier run
        return None
    figures.save(figure, path)
    return pages.Picture(path, caption)
