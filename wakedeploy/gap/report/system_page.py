"""The report of a system: one self-contained HTML page and its figures.

In: a `Result`, as domain.json has it. Out: `report.html` and `figures/*.png` in the same folder.
May import what `wakedeploy.gap` may.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core import figures, pages
from wakedeploy.core.files import write_text_whole
from wakedeploy.gap.report import system_charts
from wakedeploy.gap.report.charts import draw_gaps, draw_ranking
from wakedeploy.gap.report.maps import draw_places
from wakedeploy.gap.report.phrases import place_words
from wakedeploy.gap.report.tables import ranking_table, whiteness
from wakedeploy.gap.search.artefacts import LabelAudit, Ranked, Result, Round, SingleSteps
from wakedeploy.gap.systems.gantry import findings as drawn
from wakedeploy.gap.systems.gantry.artefacts import Profile
from wakedeploy.gap.systems.gantry.findings import Gap
from wakedeploy.gap.wording import DETAILS, counted, listed, measured, number, probability, quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_PLACES = 12
_CAPTIONS = {
    "places": (
        "The mean residual on the sealed blocks over every coordinate, before and after; the six "
        "that change most."
    ),
    "ranking": (
        "What each effect gains on blocks that it was not fitted to, with 90 % intervals over "
        "the blocks. Left of the threshold is what simulations of the baseline gain by chance. "
        "Orange: accepted; blue: above the threshold and not chosen."
    ),
    "gap": "Error per channel, noise not removed.",
    "trace": "The sealed block whose error fell by the median share.",
    "autocorrelation": (
        "Whitened innovations of the fitted blocks: noise alone stays within the band 19 times "
        "in 20."
    ),
}

Drawing = Callable[[], "Figure | None"]


def write_page(
    result: Result,
    out: Path,
    *,
    said: Sequence[str] = (),
    next_commands: Sequence[str] = (),
) -> Path:
    """Draw the figures and write `report.html` into `out`; returns the page's path.

    `said` is the answer in sentences, where there is more to say than the verdict; those after
    `DETAILS` stand below. `next_commands` stand on the page, to copy.

    Raises UnusableInput when the page or a figure cannot be written.
    """
    title = f"Simulation against measurement: {result.domain}"
    accounts = [_account(title, result, out, "")]
    if result.far is not None:
        accounts.append(_account("The same, where no wake is", result.far, out, "far_"))
    contents = {"title": title, "accounts": accounts, "further": _further(result, out)}
    details = list(said).index(DETAILS) if DETAILS in said else len(said)
    contents |= {"next": next_commands, "said": said[:details], "details": said[details + 1 :]}
    path = out / "report.html"
    write_text_whole(path, pages.page("wakedeploy.gap.report", "system.html", **contents))
    return path


def _account(title: str, result: Result, out: Path, prefix: str) -> dict[str, Any]:
    """Verdict, where, which, how much smaller."""
    drawings: dict[str, Drawing] = {
        "places": lambda: draw_places([Profile(**dict(each)) for each in result.shown.places]),
        "ranking": lambda: draw_ranking(_rounds(result.rounds), found, result.rivals),
        "gap": lambda: draw_gaps({n: Gap(**dict(each)) for n, each in result.gap.items()}),
        "trace": lambda: system_charts.draw_trace(result.shown.trace),
        "autocorrelation": lambda: system_charts.draw_autocorrelation(
            result.white, list(result.gap)
        ),
    }
    found = [effect.name for effect in result.effects]
    folder, blocks = out / "figures", counted(len(result.episodes), "block")
    return {
        "title": title,
        "counts": (
            f"{blocks} of recordings, {len(result.sealed)} of them sealed: kept apart while the "
            "search ran, to show the answer on."
        ),
        "verdict": _verdict(result),
        "sizes": _sizes(result),
        "places": _places(result),
        "alone": _alone(result.rounds),
        "placebo": _placebo(result),
        "white": [
            whiteness(result.white.before, "the baseline"),
            whiteness(result.white.after, "the baseline with what was found"),
        ],
        "pictures": {
            name: _picture(folder / f"{prefix}{name}.png", _CAPTIONS[name], drawing)
            for name, drawing in drawings.items()
        },
    }


def _verdict(result: Result) -> str:
    rivals = result.rivals
    too_many = f"The baseline lacks one of {listed(rivals, 'or')}: too many to call it a class."
    return {
        "named": f"The baseline lacks {listed([e.name for e in result.effects])}.",
        "class": f"The baseline lacks one of {listed(rivals, 'or')}: they cannot be told apart.",
        "unknown": too_many if rivals else "The baseline lacks what no single effect explains.",
        "none": "Nothing is missing from the baseline beyond noise.",
    }[result.verdict]


def _sizes(result: Result) -> pages.Table:
    rows = [
        [effect.name, name, measured(size.value, size.low, size.high, size.unit)]
        for effect in result.effects
        for name, size in effect.parameters.items()
    ]
    return pages.Table(["effect", "parameter", "value (90 % interval)"], rows)


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
        name.removeprefix(f"{candidate.name}."): drawn.Size(
            value=size.value, low=size.low, high=size.high, unit=size.unit
        )
        for name, size in candidate.parameters.items()
    }
    return drawn.Ranked(
        name=candidate.name,
        gain_nats=candidate.gain_nats,
        interval=candidate.interval,
        parameters=sizes,
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
        f"blocks it gains {placebo.sealed_gain_nats:.1f} nats, what was found "
        f"{result.sealed_gain_nats:.1f}."
    )


def _further(result: Result, out: Path) -> list[object]:
    """What only this domain tells: an independent estimate, a profile, an audit, the truth."""
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
