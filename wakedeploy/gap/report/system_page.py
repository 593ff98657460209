"""The report of a system: one self-contained HTML page and its figures.

In: a `Result`, as domain.json has it. Out: `report.html` and `figures/*.png` in the same folder.
May import what `wakedeploy.gap` may.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from wakedeploy.core import figures
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.markup import Markup, element, page, picture, table, together
from wakedeploy.gap.report import system_charts
from wakedeploy.gap.report.charts import draw_gaps, draw_ranking
from wakedeploy.gap.report.maps import draw_places
from wakedeploy.gap.report.summary import place_words
from wakedeploy.gap.report.tables import ranking_table, whiteness
from wakedeploy.gap.search.artefacts import LabelAudit, Result, Round, SingleSteps, Size
from wakedeploy.gap.wording import counted, listed, measured, number, probability, quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_PLACES = 12


def write_page(result: Result, out: Path) -> Path:
    """Draw the figures and write `report.html` into `out`; returns the page's path.

    Raises UnusableInput when the page or a figure cannot be written.
    """
    title = f"The gap in the domain {result.domain}"
    body = [element("h1", title), *_steps(result, out, "")]
    if result.far is not None:
        body += [element("h1", "The same, where no wake is"), *_steps(result.far, out, "far_")]
    body.append(_further(result, out))
    path = out / "report.html"
    write_text_whole(path, page(title, *body))
    return path


def _steps(result: Result, out: Path, prefix: str) -> list[Markup]:
    """Verdict, where, which, how much smaller: one section each."""
    plain = result.as_json()  # for figures that the gantry's report has, too

    def draw(name: str, caption: str, drawn: "Figure | None") -> Markup:
        return _picture(out / "figures" / f"{prefix}{name}.png", caption, drawn)

    with figures.style():
        return [
            _opening(result),
            _section(
                "Where they disagree",
                _places(result),
                draw(
                    "places",
                    "The mean residual on the sealed episodes over every coordinate, before and "
                    "after; the six that change most.",
                    draw_places(plain["shown"], {}),
                ),
            ),
            _section(
                "Which effect explains it",
                draw(
                    "ranking",
                    "What each effect gains on episodes that it was not fitted to, with 90 % "
                    "intervals over the episodes. Left of the threshold is what simulations of the "
                    "baseline gain by chance. Orange: accepted; blue: above the threshold and not "
                    "chosen.",
                    draw_ranking(plain),
                ),
                _alone(result.rounds),
            ),
            _section(
                "The gap before and after, on sealed episodes",
                draw("gap", "Error per channel, noise not removed.", draw_gaps(plain)),
                _placebo(result),
                draw(
                    "trace",
                    "The sealed episode whose error fell by the median share.",
                    system_charts.draw_trace(result.shown.trace),
                ),
                whiteness(plain["white"]["before"], "the baseline"),
                whiteness(plain["white"]["after"], "the baseline with what was found"),
                draw(
                    "autocorrelation",
                    "Whitened innovations of the fitted episodes: noise alone stays within the "
                    "band 19 times in 20.",
                    system_charts.draw_autocorrelation(result.white, list(result.gap)),
                ),
            ),
        ]


def _opening(result: Result) -> Markup:
    """The verdict in words, and the sizes."""
    rivals = result.rivals
    too_many = f"The baseline lacks one of {listed(rivals, 'or')}: too many to call it a class."
    verdict = {
        "named": f"The baseline lacks {listed([e.name for e in result.effects])}.",
        "class": f"The baseline lacks one of {listed(rivals, 'or')}: they cannot be told apart.",
        "unknown": too_many if rivals else "The baseline lacks what no single effect explains.",
        "none": "Nothing is missing from the baseline beyond noise.",
    }[result.verdict]
    rows = [
        [effect.name, name, _measured(size)]
        for effect in result.effects
        for name, size in effect.parameters.items()
    ]
    episodes = f"{counted(len(result.episodes), 'episode')}, {len(result.sealed)} of them sealed"
    return together(
        element("p", episodes, class_="soft"),
        element("p", verdict, class_="account"),
        table(["effect", "parameter", "value (90 % interval)"], rows),
    )


def _measured(size: Size) -> str:
    return measured(size.value, size.low, size.high, size.unit)


def _places(result: Result) -> Markup:
    if not result.where:
        return element("p", "Nowhere beyond noise.")
    rows = [
        [
            place_words(place.model_dump()).split(":")[0],
            place.channel,
            quantity(place.residual, place.unit, signed=True),
            probability("q", place.q_value),
        ]
        for place in result.where[:_MOST_PLACES]
    ]
    if len(result.where) > _MOST_PLACES:
        rows.append([f"and {len(result.where) - _MOST_PLACES} more in domain.json", "", "", ""])
    return table(["place", "channel", "mean residual", "significance"], rows)


def _alone(rounds: list[Round]) -> Markup:
    """The first ranking as a table; the parameters without their effect's name."""
    if not rounds:
        return Markup()
    ranking = [
        one.model_dump()
        | {
            "parameters": {
                name.removeprefix(f"{one.name}."): size.model_dump()
                for name, size in one.parameters.items()
            }
        }
        for one in rounds[0].ranking
    ]
    return ranking_table({"rounds": [{"ranking": ranking}]})


def _placebo(result: Result) -> Markup:
    placebo = result.placebo
    if placebo is None:
        return Markup()
    left = [
        f"{name} {quantity(before, error.unit)} → {quantity(after, error.unit)}"
        for (name, error), before, after in zip(
            result.gap.items(), placebo.before, placebo.after, strict=True
        )
    ]
    return element(
        "p",
        f"The best other effect instead, {placebo.name}: {'; '.join(left)}. On the sealed episodes "
        f"it gains {placebo.sealed_gain_nats:.1f} nats, what was found "
        f"{result.sealed_gain_nats:.1f}.",
    )


def _further(result: Result, out: Path) -> Markup:
    """What only this domain tells: an independent estimate, a profile, an audit, the truth."""
    folder = out / "figures"
    with figures.style():
        parts = [
            _single_steps(result.single_steps),
            _picture(
                folder / "delay_profile.png",
                "The largest log likelihood at each transport delay, everything else refitted. "
                "Lower summits are aliases; how far they lie below the best is what speaks against "
                "them.",
                system_charts.draw_delay_profile(result.delay_profile),
            ),
            _picture(
                folder / "phase_delay.png",
                "The phase delay from foil to tip over the frequency, from the cross-spectrum: an "
                "estimate that takes no model.",
                system_charts.draw_phase_delay(result.phase_delay),
            ),
            _label(result.label),
            _hidden(result.hidden),
        ]
    return _section("Told independently", *parts) if any(parts) else Markup()


def _single_steps(steps: SingleSteps | None) -> Markup:
    """Motor: an exponential fitted to each step alone."""
    if steps is None:
        return Markup()
    rows = [
        [name, str(way.steps), quantity(way.median_s, "s")]
        for name, way in (("up", steps.up), ("down", steps.down))
    ]
    return table(["exponential fitted to each step alone", "steps", "median time constant"], rows)


def _label(groups: Mapping[str, LabelAudit]) -> Markup:
    """Quadrotor: the label as published, and with what turning axes keep back given back to it."""
    rows = [
        [
            name,
            quantity(group.seconds, "s"),
            quantity(group.label_rms_n, "N"),
            quantity(group.corrected_rms_n, "N"),
        ]
        for name, group in groups.items()
    ]
    return table(["flights", "recorded", "vertical label, rms", "axes not turning, rms"], rows)


def _hidden(truth: Mapping[str, float]) -> Markup:
    """Downwash: what had been put in."""
    rows = [[name, f"{number(value):g}"] for name, value in truth.items()]
    return table(["what had been hidden", "value"], rows)


def _picture(path: Path, caption: str, drawn: "Figure | None") -> Markup:
    if drawn is None:
        path.unlink(missing_ok=True)  # of an earlier run
        return Markup()
    figures.save(drawn, path)
    return picture(path, caption)


def _section(title: str, *inside: str) -> Markup:
    return element("section", element("h2", title), *inside)
