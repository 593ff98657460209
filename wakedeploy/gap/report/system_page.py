"""The report of a domain: one self-contained HTML page and its figures.

In: the document of `closing.close` with what the domain itself adds, as in `domain.json`. Out:
`report.html` and `figures/*.png` in the same folder. May import what `wakedeploy.gap` may.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core import figures
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.markup import Markup, element, page, picture, table, together
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

Document = Mapping[str, Any]
Drawing = Callable[[Document], "Figure | None"]


def write_page(document: Document, out: Path) -> Path:
    """Draw the figures and write `report.html` into `out`; returns the page's path.

    Raises UnusableInput when the page or a figure cannot be written.
    """
    title = f"The gap in the domain {document.get('domain')}"
    body = [element("h1", title), *_steps(document, out, "")]
    if far := mapping(document.get("far")):
        body += [element("h1", "The same, where no wake is"), *_steps(far, out, "far_")]
    body.append(_further(document, out))
    path = out / "report.html"
    write_text_whole(path, page(title, *body))
    return path


def doubt_sentence(document: Document) -> str:
    """Which of the effects found the sealed episodes speak against; "" for none."""
    doubted = texts(document.get("doubted"))
    if not doubted:
        return ""
    return f"Doubt {listed(doubted)}: with it, the error on the sealed episodes grew."


def _steps(document: Document, out: Path, prefix: str) -> list[Markup]:
    """Verdict, where, which, how much smaller: one section each."""
    names = [str(effect.get("name")) for effect in entries(document.get("effects"))]
    shown = mapping(document.get("shown"))

    def draw(name: str, caption: str, drawing: Drawing, of: Document = document) -> Markup:
        return _picture(out / "figures" / f"{prefix}{name}.png", caption, drawing, of)

    return [
        _opening(document, names),
        _section(
            "Where they disagree",
            _places(document),
            draw(
                "places",
                "The mean residual on the sealed episodes over every coordinate, before and after; "
                "the six that change most.",
                lambda told: draw_places(told, {}),
                shown,
            ),
        ),
        _section(
            "Which effect explains it",
            draw(
                "ranking",
                "What each effect gains on episodes that it was not fitted to, with 90 % intervals "
                "over the episodes. Left of the threshold is what simulations of the baseline gain "
                "by chance. Orange: accepted; blue: above the threshold and not chosen.",
                draw_ranking,
            ),
            _alone(document),
        ),
        _section(
            "The gap before and after, on sealed episodes",
            draw("gap", "Error per channel, noise not removed.", draw_gaps),
            _placebo(document),
            element("p", doubt) if (doubt := doubt_sentence(document)) else Markup(),
            draw(
                "trace",
                "The sealed episode whose error fell by the median share.",
                system_charts.draw_trace,
                mapping(shown.get("trace")),
            ),
            *_white(document),
            draw(
                "autocorrelation",
                "Whitened innovations of the fitted episodes: noise alone stays within the band 19 "
                "times in 20.",
                system_charts.draw_autocorrelation,
            ),
        ),
    ]


def _opening(document: Document, names: list[str]) -> Markup:
    """The verdict in words, and the sizes."""
    rivals = texts(document.get("class"))
    too_many = f"The baseline lacks one of {listed(rivals, 'or')}: too many to call it a class."
    told = {
        "named": f"The baseline lacks {listed(names)}.",
        "class": f"The baseline lacks one of {listed(rivals, 'or')}: they cannot be told apart.",
        "unknown": too_many if rivals else "The baseline lacks what no single effect explains.",
        "none": "Nothing is missing from the baseline beyond noise.",
    }
    episodes, sealed = (len(texts(document.get(key))) for key in ("episodes", "sealed"))
    rows = [
        [str(effect.get("name")), parameter, value]
        for effect in entries(document.get("effects"))
        for parameter, value in parameters_of(effect)
    ]
    return together(
        element("p", f"{counted(episodes, 'episode')}, {sealed} of them sealed", class_="soft"),
        element("p", told.get(str(document.get("verdict")), "No verdict."), class_="account"),
        table(["effect", "parameter", "value (90 % interval)"], rows),
    )


def _places(document: Document) -> Markup:
    found = entries(document.get("where"))
    if not found:
        return element("p", "Nowhere beyond noise.")
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
    return table(["place", "channel", "mean residual", "significance"], rows)


def _alone(document: Document) -> Markup:
    """The first ranking as a table; the parameters without their effect's name."""
    rounds = entries(document.get("rounds"))
    if not rounds:
        return Markup()
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


def _placebo(document: Document) -> Markup:
    placebo = mapping(document.get("placebo"))
    if not placebo:
        return Markup()
    channels = [(str(n), str(mapping(c).get("unit"))) for n, c in mapping(document["gap"]).items()]
    left = [
        f"{name} {quantity(before, unit)} → {quantity(after, unit)}"
        for (name, unit), before, after in zip(
            channels, numbers(placebo.get("before")), numbers(placebo.get("after")), strict=True
        )
    ]
    nats = [number(of.get("sealed_gain_nats")) for of in (placebo, document)]
    return element(
        "p",
        f"The best other effect instead, {placebo.get('name')}: {'; '.join(left)}. On the sealed "
        f"episodes it gains {nats[0]:.1f} nats, what was found {nats[1]:.1f}.",
    )


def _white(document: Document) -> list[Markup]:
    white = mapping(document.get("white"))
    return [
        whiteness(mapping(white.get("before")), "the baseline"),
        whiteness(mapping(white.get("after")), "the baseline with what was found"),
    ]


def _further(document: Document, out: Path) -> Markup:
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
    return _section("Told independently", *parts) if any(parts) else Markup()


def _single_steps(steps: Document) -> Markup:
    """Motor: an exponential fitted to each step alone."""
    rows = [
        [way, str(mapping(steps.get(way)).get("steps")),
         quantity(mapping(steps.get(way)).get("median_s"), "s")]
        for way in ("up", "down")
        if way in steps
    ]  # fmt: skip
    return table(["exponential fitted to each step alone", "steps", "median time constant"], rows)


def _label(groups: Document) -> Markup:
    """Quadrotor: the label as published, and with what turning axes keep back given back to it."""
    columns = (("seconds", "s"), ("label_rms_n", "N"), ("corrected_rms_n", "N"))
    rows = [
        [name, *(quantity(mapping(group).get(key), unit) for key, unit in columns)]
        for name, group in groups.items()
    ]
    return table(["flights", "recorded", "vertical label, rms", "axes not turning, rms"], rows)


def _hidden(truth: Document) -> Markup:
    """Downwash: what had been put in."""
    rows = [[name, f"{number(value):g}"] for name, value in truth.items()]
    return table(["what had been hidden", "value"], rows)


def _picture(path: Path, caption: str, drawing: Drawing, of: Document) -> Markup:
    with figures.style():
        figure = drawing(of)
    if figure is None:
        path.unlink(missing_ok=True)  # of an earlier run
        return Markup()
    figures.save(figure, path)
    return picture(path, caption)


def _section(title: str, *inside: str) -> Markup:
    return element("section", element("h2", title), *inside)
