"""The report of a system: one self-contained HTML page and its figures.

In: a `Result`, as domain.json has it. Out: `report.html` and `figures/*.png` in the same folder.
May import what `wakedeploy.gap` may.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures, pages
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.line_chart import Curve, LineChart
from wakedeploy.gap.report import system_charts
from wakedeploy.gap.report.charts import draw_gaps
from wakedeploy.gap.report.maps import MOST_PLACES, draw_places, drawable_places, labelled
from wakedeploy.gap.report.phrases import place_words
from wakedeploy.gap.report.ranking_chart import ranking_charts
from wakedeploy.gap.report.tables import ranking_table, whiteness
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import (
    LabelAudit,
    Ranked,
    Result,
    Round,
    SingleSteps,
    Trace,
)
from wakedeploy.gap.systems.answers.advice import rest_words
from wakedeploy.gap.systems.answers.calibration import constant_rows
from wakedeploy.gap.systems.answers.halves import repeated_sentences
from wakedeploy.gap.systems.answers.importance import removed_words
from wakedeploy.gap.systems.answers.reader_units import as_read
from wakedeploy.gap.systems.answers.words import lacking_of_class
from wakedeploy.gap.systems.gantry import findings as drawn
from wakedeploy.gap.systems.gantry.artefacts import Profile
from wakedeploy.gap.systems.gantry.findings import Gap
from wakedeploy.gap.systems.kinds.library import plain
from wakedeploy.gap.wording import (
    counted,
    listed,
    measured,
    nats,
    number,
    numbers,
    probability,
    quantity,
    spoken,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_PLACES = 12
_CAPTIONS = {
    "gap": "Error per channel, noise not removed.",
    "autocorrelation": (
        "Whitened innovations of the fitted blocks: noise alone stays within the band 19 times "
        "in 20."
    ),
}

_RANKED = (
    "What each effect gains on blocks that it was not fitted to, with 90 % intervals over "
    "the blocks. The threshold is what the luckiest of all gains by chance; one that gains in "
    "block after block needs less. Orange: accepted; blue: more than chance and not chosen; grey: "
    "no more than chance. Point at a row for its numbers."
)
_TRACE = "The sealed block whose error fell by the median share. Point at a curve for a value."

Drawing = Callable[[], "Figure | None"]


def write_page(
    result: Result,
    out: Path,
    *,
    answers: Sequence[str] = (),
    remarks: Sequence[str] = (),
    next_step: tuple[str, Sequence[str]] | None = None,
) -> Path:
    """Draw the figures and write `report.html` into `out`; returns the page's path.

    `answers` are the first screen, where there is more to say than the verdict, `remarks` what
    stands in no table; without them it is what each half of the logs says. `next_step` is a
    sentence, and commands to copy.

    Raises UnusableInput when the page or a figure cannot be written.
    """
    title = f"Simulation against measurement: {result.domain}"
    accounts = [_account(title, result, out, "")]
    if remarks:
        accounts[0]["remarks"] = remarks
    accounts[0]["constants"] = _constants(result)
    if next_step is not None:
        why, commands = next_step
        accounts[0]["next"] = (f"Next step: {why[:1].lower()}{why[1:]}", commands)
    if answers:
        accounts[0]["answers"] = answers
    if result.far is not None:
        accounts.append(_account("The same, where no wake is", result.far, out, "far_"))
    contents = {"title": title, "accounts": accounts, "further": _further(result, out)}
    contents["trace_caption"] = _TRACE
    path = out / "report.html"
    write_text_whole(path, pages.page("wakedeploy.gap.report", "system.html", **contents))
    return path


def _account(title: str, result: Result, out: Path, prefix: str) -> dict[str, Any]:
    """Verdict, where, which, how much smaller."""
    profiles = [Profile(**dict(each)) for each in result.shown.places]
    drawings: dict[str, Drawing] = {
        "places": lambda: draw_places(profiles),
        "gap": lambda: draw_gaps({n: Gap(**dict(each)) for n, each in result.gap.items()}),
        "trace": lambda: system_charts.draw_trace(result.shown.trace),
        "autocorrelation": lambda: system_charts.draw_autocorrelation(
            result.white, list(result.gap)
        ),
    }
    folder, blocks = out / "figures", counted(len(result.episodes), "block")
    captions = _CAPTIONS | {"places": _caption_of_places(profiles), "trace": _TRACE}
    return {
        "title": title,
        "counts": (
            f"{blocks} of recordings, {len(result.sealed)} of them sealed: kept apart while the "
            "search ran, to show the answer on."
        ),
        "answers": [_verdict(result)],
        "tile_pairs": _tiles(result),
        "next": None,
        "remarks": repeated_sentences(result),
        "sizes": _sizes(result),
        "constants": None,
        "where": _where(result),
        "places": _places(result),
        "ranking": ranking_charts(
            _rounds(result.rounds), [each.name for each in result.effects], result.rivals
        ),
        "ranking_caption": _RANKED,
        "alone": _alone(result.rounds),
        "placebo": _placebo(result),
        "charts": _charts(result.shown.trace),
        "white": _white(result),
        "pictures": {
            name: _picture(folder / f"{prefix}{name}.png", captions[name], drawing)
            for name, drawing in drawings.items()
        },
    }


def _verdict(result: Result) -> str:
    rivals = result.rivals
    several = listed([plain(name) for name in rivals], "or")
    too_many = f"The baseline lacks one of these: {several}. They are too many to call it a class."
    named = listed([plain(effect.name) for effect in result.effects])
    return {
        "named": f"The baseline lacks {named}.{rest_words(result)}",
        "class": f"The baseline lacks {lacking_of_class(result)}. These cannot be told apart.",
        "unknown": too_many if rivals else "The baseline lacks what no single effect explains.",
        "none": "Nothing is missing from the baseline beyond noise.",
    }[result.verdict]


def _tiles(result: Result) -> list[tuple[str, str]]:
    """Sizes, and the error before and after; of nothing found the error alone."""
    several = len(result.effects) > 1
    tiles = [
        (
            f"{effect.name}, {spoken(name)}" if several else spoken(name),
            measured(size.value, size.low, size.high, size.unit),
        )
        for effect in result.effects
        for name, size in (as_read(effect.name, *each) for each in effect.parameters.items())
    ]
    for name, error in result.gap.items():
        before, after = quantity(error.before, error.unit), quantity(error.after, error.unit)
        if result.effects:
            tiles += [(f"error of {name}, before", before), (f"error of {name}, after", after)]
        else:
            tiles.append((f"error of {name}", before))
    return tiles


def _sizes(result: Result) -> pages.Table:
    rows = [
        [
            effect.name,
            name,
            measured(size.value, size.low, size.high, size.unit),
            removed_words(effect.forecast),
        ]
        for effect in result.effects
        for name, size in (as_read(effect.name, *each) for each in effect.parameters.items())
    ]
    mean = f", mean over {len(result.gap)} outputs" if len(result.gap) > 1 else ""
    removes = f"removes of the squared error{mean}"
    columns = ["effect", "parameter", "value (90 % interval)", removes]
    return pages.Table(columns, rows)


def _constants(result: Result) -> pages.Table | None:
    """As fitted beside what was found, and as the system states them."""
    rows = [list(row) for row in constant_rows(result)]
    columns = ["constant", "stated", "fitted (90 % interval)"]
    return pages.Table(columns, rows) if rows else None


def _caption_of_places(profiles: Sequence[Profile]) -> str:
    caption = "The mean residual on the sealed blocks, before and after, over "
    more = len(drawable_places(profiles)) > MOST_PLACES
    return f"{caption}{'the coordinates where it changes most' if more else 'every coordinate'}."


def _where(result: Result) -> str:
    """What the table says, by the threshold by which it was made; or why there is none."""
    threshold = f"q ≤ {RULES.false_discoveries:g}"
    if result.where:
        several = len(result.where) > 1
        count = counted(len(result.where), "place")
        return f"{count} stand{'' if several else 's'} out ({threshold})."
    least = min((each.q_value for each in result.maps), default=math.nan)
    clearest = "" if math.isnan(least) else f"; the clearest has {probability('q', least)}"
    nothing = f"No single place stands out ({threshold}{clearest})."
    largest = [
        f"{quantity(error, unit)} ({name})"
        for name, (error, unit) in _largest_means(result).items()
    ]
    if result.verdict == "none" or not largest:
        return nothing
    return (
        f"{nothing} They disagree all the same: the mean residual over a part of a coordinate "
        f"reaches {listed(largest)}, and follows no coordinate clearly."
    )


def _largest_means(result: Result) -> dict[str, tuple[float, str]]:
    """By channel, the largest mean residual over a part of a coordinate, with its unit."""
    largest: dict[str, tuple[float, str]] = {}
    for place in result.shown.places:
        means = np.abs(numbers(place.before))
        if len(means) and bool(np.isfinite(means).any()):
            known = largest.get(place.channel, (0.0, ""))[0]
            largest[place.channel] = (max(known, float(np.nanmax(means))), place.unit)
    return largest


def _white(result: Result) -> list[str]:
    """Whether noise is left before and after; a fit without the effect takes it for noise."""
    before, after = result.white.before, result.white.after
    sentences = [
        whiteness(before, "the baseline"),
        whiteness(after, "the baseline with what was found") if result.effects else "",
    ]
    if result.effects and before.passes:
        sentences[0] += (
            " Its noise was fitted with the effect missing, and is as wide as that asks."
        )
    return sentences


def _charts(trace: Trace) -> list[LineChart]:
    """Measured and forecast, by channel."""
    return [
        LineChart(
            [
                Curve("measured", trace.time_s, course.measured),
                Curve("baseline", trace.time_s, course.before),
                Curve("with what was found", trace.time_s, course.after),
            ],
            f"time in {system_charts.episode_words(trace.episode)} [s]",
            labelled(name, course.unit),
        )
        for name, course in trace.channels.items()
    ]


def _places(result: Result) -> pages.Table | None:
    if not result.where:
        return None
    rows = [
        [
            place_words(place).split(":")[0],
            place.channel,
            quantity(place.residual, place.unit, signed=True),
            probability("q", place.q_value),
        ]
        for place in result.where[:_MOST_PLACES]
    ]
    if len(result.where) > _MOST_PLACES:
        rows.append([f"and {len(result.where) - _MOST_PLACES} more in domain.json", "", "", ""])
    return pages.Table(["place", "channel", "mean residual", "significance"], rows)


def _alone(rounds: Sequence[Round]) -> pages.Table | None:
    """The first ranking as a table."""
    return ranking_table(_rounds(rounds)[0].ranking) if rounds else None


def _rounds(rounds: Sequence[Round]) -> list[drawn.Round]:
    """As they are drawn; the parameters without their effect's name."""
    return [
        drawn.Round(
            given=searched.given,
            threshold_nats=searched.threshold_nats,
            ranking=[_drawn(candidate) for candidate in searched.ranking],
        )
        for searched in rounds
    ]


def _drawn(candidate: Ranked) -> drawn.Ranked:
    sizes = {
        name: drawn.Size(value=size.value, low=size.low, high=size.high, unit=size.unit)
        for name, size in (
            as_read(candidate.name, key.removeprefix(f"{candidate.name}."), each)
            for key, each in candidate.parameters.items()
        )
    }
    return drawn.Ranked(
        name=candidate.name,
        gain_nats=candidate.gain_nats,
        interval=candidate.interval,
        parameters=sizes,
        needed_nats=candidate.needed_nats,
    )


def _placebo(result: Result) -> str:
    placebo = result.placebo
    if placebo is None:
        return ""
    errors = [
        f"{name} {quantity(before, error.unit)} → {quantity(after, error.unit)}"
        for (name, error), before, after in zip(
            result.gap.items(), placebo.before, placebo.after, strict=True
        )
    ]
    return (
        f"The best other effect instead, {placebo.name}: {'; '.join(errors)}. On the sealed "
        f"blocks it gains {nats(placebo.sealed_gain_nats)}, what was found "
        f"{nats(result.sealed_gain_nats)}."
    )


def _further(result: Result, out: Path) -> list[object]:
    """What only this domain adds: an independent estimate, a profile, an audit, the truth."""
    folder = out / "figures"
    parts = [
        _single_steps(result.single_steps),
        _picture(
            folder / "delay_profile.png",
            "The largest log likelihood at each transport delay, everything else refitted. Lower "
            "summits are aliases; how far they lie below the best is what speaks against them.",
            lambda: system_charts.draw_delay_profile(result.delay_profile),
        ),
        _picture(
            folder / "phase_delay.png",
            "The phase delay from foil to tip over the frequency, from the cross-spectrum: an "
            "estimate that takes no model.",
            lambda: system_charts.draw_phase_delay(result.phase_delay),
        ),
        _label(result.label),
        _hidden(result.hidden),
    ]
    return [part for part in parts if part]


def _single_steps(steps: SingleSteps | None) -> pages.Table | None:
    """Motor: an exponential fitted to each step alone."""
    if steps is None:
        return None
    rows = [
        [name, str(way.steps), quantity(way.median_s, "s")]
        for name, way in (("up", steps.up), ("down", steps.down))
    ]
    return pages.Table(
        ["exponential fitted to each step alone", "steps", "median time constant"], rows
    )


def _label(groups: Mapping[str, LabelAudit]) -> pages.Table:
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
    return pages.Table(
        ["flights", "recorded", "vertical label, rms", "axes not turning, rms"], rows
    )


def _hidden(truth: Mapping[str, float]) -> pages.Table:
    """Downwash: what had been put in."""
    rows = [[name, f"{number(value):g}"] for name, value in truth.items()]
    return pages.Table(["what had been hidden", "value"], rows)


def _picture(path: Path, caption: str, drawing: Drawing) -> pages.Picture | None:
    with figures.style():
        figure = drawing()
    if figure is None:
        path.unlink(missing_ok=True)  # of an earlier run
        return None
    figures.save(figure, path)
    return pages.Picture(path, caption)
