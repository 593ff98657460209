"""The report: one self-contained HTML page and its figures, as far as the steps have run.

In: a folder with the steps' artefacts. Out: `report.html` and `figures/*.png` in the same folder.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core import figures, pages
from wakedeploy.core.files import write_text_whole
from wakedeploy.gap.few_flights import cannot_tell, caution, in_words, unconfirmed
from wakedeploy.gap.report import charts
from wakedeploy.gap.report import maps as report_maps
from wakedeploy.gap.report.advice import advice
from wakedeploy.gap.report.evidence import evidence
from wakedeploy.gap.report.first_screen import first_screen
from wakedeploy.gap.report.ranking_chart import ranking_charts
from wakedeploy.gap.report.shrinkage import (
    closed_words,
    flight_count,
    gap_channel,
    gap_values,
    noise_unknown,
    shrinking,
    unchanged,
    without_noise,
)
from wakedeploy.gap.report.summary import verdict_sentence
from wakedeploy.gap.report.tables import (
    added_effects,
    detectable_table,
    gap_table,
    log_rows,
    noise_table,
    place_table,
    ranking_table,
    unflown_rows,
    unknown_effect,
    values_of,
    whiteness,
)
from wakedeploy.gap.search.artefacts import Map
from wakedeploy.gap.systems.gantry.artefacts import Find, Name, Show, Summary
from wakedeploy.gap.systems.gantry.findings import Confusion, Gap
from wakedeploy.gap.systems.gantry.folder import TITLE, StepArtefacts, read_steps
from wakedeploy.gap.wording import (
    UNKNOWN,
    counted,
    listed,
    quantity,
    spoken,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _found(steps: StepArtefacts) -> Find:
    return steps.find or Find()


def _maps(steps: StepArtefacts) -> tuple[list[Map], list[Map]]:
    return report_maps.strongest_maps(_found(steps).maps)


@dataclass(frozen=True)
class Picture:
    """One figure of the report: file name, caption, and who draws it."""

    name: str
    caption: str
    draw: "Callable[[StepArtefacts], Figure | None]"


PICTURES = (
    Picture(
        "maps_exogenous",
        "Where they disagree, against what was known beforehand: mean residual (line) and its 90 % "
        "interval (band) per bin; dotted, a bin that was passed through once: its interval is not "
        "known. Blue: significant (q ≤ 0.05, all maps counted); grey: not. A place is listed only "
        "if it exceeds what the model's approximations leave on this rig; an innovation (sd: "
        "standard deviations of a reading's forecast) counts by q alone.",
        lambda steps: report_maps.draw_maps(_maps(steps)[0]),
    ),
    Picture(
        "maps_fed_back",
        "The same against what the controller feeds back. A disagreement here can be an echo of "
        "one elsewhere: under control, a missing force shows in the command.",
        lambda steps: report_maps.draw_maps(_maps(steps)[1]),
    ),
    Picture(
        "replay",
        "Open-loop replay from filtered states: the error in height after each horizon, and the "
        "error that the model expects of itself. Its noise is fitted to the same flights, so a "
        "missing effect raises both.",
        lambda steps: charts.draw_replay(_found(steps).replay),
    ),
    Picture(
        "spectrum",
        "Innovations, the part of each measurement that the model did not foresee. If only noise "
        "is left, spectrum and autocorrelation stay within the shaded bands.",
        lambda steps: charts.draw_spectrum(
            _found(steps),
            None if cannot_tell(steps.flights) and steps.add is None else steps.show,
        ),
    ),
    Picture(
        "confusion",
        "If the effect of a row is the truth, how much the best version of the effect of a column "
        "loses on these flights, at the size found or else at its usual size. Below 3 nats (×) "
        "they cannot be told apart; in a row full of × that effect would hardly show at all.",
        lambda steps: charts.draw_confusion(steps.name.confusion if steps.name else Confusion()),
    ),
    Picture(
        "before_after",
        "The gap per channel on the flights shown, with 90 % intervals; dashed, what noise alone "
        "leaves. Closed: (before² − after²) / (before² − floor²), no more than 100 %. Noise and "
        "calibration are fitted before and after; the new rig file has the effect alone, with the "
        "calibration as it was.",
        lambda steps: charts.draw_gaps(_gap(steps)),
    ),
    Picture(
        "places",
        "The mean residual at the places found, on the flights shown, before and after, with 90 % "
        "intervals.",
        lambda steps: report_maps.draw_places(steps.show.places if steps.show else []),
    ),
    Picture(
        "forecasts",
        "One flight: height 0.25 s ahead as forecast by the model before and after. The rms leaves "
        "out readings that strayed.",
        lambda steps: charts.draw_traces(steps.show.traces if steps.show else None),
    ),
    Picture(
        "placebo",
        "A placebo: a wrong effect in the place of what was found, with as many parameters where "
        "there is one, fitted likewise. Of the effects that can be told from what was found, the "
        "best by gain on held-out flights. It must not help, that is gain over 3 nats on the "
        "flights shown.",
        lambda steps: charts.draw_placebo(steps.summary),
    ),
    Picture(
        "retraining",
        "Predictors trained on the old and on the corrected simulation, scored on the flights that "
        "are shown here, with 90 % intervals over flights where there are several. The force is "
        "measured with the corrected rig for both.",
        lambda steps: charts.draw_retraining(steps.show.retrain if steps.show else None),
    ),
)

# Of too few flights no others are drawn, and their ranking is nothing like a held-out one.
_OF_FEW = ("maps_exogenous", "maps_fed_back", "replay", "spectrum")
_RANKED = (
    "What each effect gains on flights that its own parameters were not fitted to (noise and "
    "calibration were, under every hypothesis), with 90 % intervals. Left of "
    "the threshold is what calibration errors alone can gain on this rig. Orange: found; blue: "
    "above the threshold and not chosen; grey: below. Point at a row for its numbers."
)
_RANKED_ON_FEW = (
    "What each effect gains on so few flights. Of two, each is judged by sizes fitted to the "
    "other; of one nothing can be left out, and each parameter costs a nat instead (Akaike 1974). "
    "Blue: above the threshold, which is what calibration errors alone can gain on this rig, where "
    "that is simulated; grey: below. Neither is a finding. Point at a row for its numbers."
)


def write_report(out: Path) -> Path:
    """Draw the figures of the steps that have run in `out`, and write its `report.html`.

    Returns the page's path. Raises UnusableInput for an artefact that cannot be read, and when the
    page or a figure cannot be written.
    """
    steps = read_steps(out)
    pictures = draw_pictures(steps, out / "figures")
    content = _opening(steps, out) | _data(steps) | {"pictures": pictures, "title": TITLE}
    content |= {"where": _where(steps), "which": _which(steps), "shown": _shown(steps)}
    content |= {"added": _added(steps), "nothing_added": _nothing_added(steps)}
    path = out / "report.html"
    write_text_whole(path, pages.page("wakedeploy.gap.report", "report.html", **content))
    return path


def draw_pictures(steps: StepArtefacts, folder: Path) -> dict[str, pages.Picture]:
    """Draw every figure there is something for, as PNG; others are removed."""
    drawn = {}
    few = cannot_tell(steps.flights)
    left_out = (
        () if not few or steps.add is not None else {each.name for each in PICTURES} - {*_OF_FEW}
    )
    for each in PICTURES:
        path = folder / f"{each.name}.png"
        with figures.style():
            figure = None if each.name in left_out else each.draw(steps)
        if figure is None:
            path.unlink(missing_ok=True)  # of an earlier run
            continue
        figures.save(figure, path)
        drawn[each.name] = pages.Picture(path, each.caption)
    return drawn


def _opening(steps: StepArtefacts, out: Path) -> dict[str, Any]:
    """The first screen, the numbers that matter, what comes next; then the account in detail."""
    summary, verdict = steps.summary, verdict_sentence(steps.summary)
    after = advice(steps, out)
    return {
        "flights": _flights(steps),
        "verdict": verdict,
        "answers": [
            verdict,
            *(f"{question} {sentence}" for question, sentence in first_screen(summary)),
        ],
        "tile_pairs": _tiles(summary),
        "next": None if after is None else (f"Next step: {after.why}.", after.commands),
        "evidence": evidence(summary),
    }


def _flights(steps: StepArtefacts) -> str:
    logs = _found(steps).logs
    seconds = quantity(sum(log.seconds for log in logs), "s")
    return f"{counted(len(logs), 'flight')}, {seconds}" if logs else "No flights read yet"


def _tiles(summary: Summary) -> list[tuple[str, str]]:
    tiles = [
        (f"{effect.name}, {spoken(parameter)}", value)
        for effect in summary.effects
        for parameter, value in values_of(effect.parameters)
    ]
    name, channel = gap_channel(summary)
    if channel is None:
        return tiles
    before, after, noise = gap_values(channel)
    if cannot_tell(flight_count(summary)) or unchanged(channel):
        tiles.append((f"error of the {name}", before))
        unknown = cannot_tell(flight_count(summary)) or noise_unknown(summary)
        return tiles if unknown else [*tiles, ("noise alone", noise)]
    return [
        *tiles,
        (f"{name}, before", before),
        (f"after, if it is {listed(summary.as_if)}" if summary.as_if else "after", after),
        ("noise alone", noise),
        ("of the gap closed", closed_words(channel) or UNKNOWN),
    ]


def _where(steps: StepArtefacts) -> dict[str, Any]:
    find = steps.find
    if find is None:
        return {}
    return {
        "sentence": find.sentence,
        "places": place_table(find.places),
        "white": whiteness(find.white, "the rig as it is"),
    }


def _which(steps: StepArtefacts) -> dict[str, Any]:
    name = steps.name
    if name is None:
        return {}
    return {
        "rest_white": _rest_white(name, steps.flights),
        "untried": _untried(name),
        "unknown": unknown_effect(name.unknown),
        "charts": ranking_charts(
            name.rounds, [each.name for each in name.effects], name.rivals, name.fitted_flights
        ),
        "caption": _RANKED_ON_FEW if cannot_tell(steps.flights) else _RANKED,
        "ranking": ranking_table(name.rounds[0].ranking if name.rounds else ()),
        "noise": noise_table(name.noise),
        "detectable": detectable_table(name.detectable),
        "folds_detectable": name.verdict != "none",
    }


def _rest_white(name: Name, flights: int) -> str:
    """Whether the answer leaves more than noise; nothing where the answer is the rig as it is."""
    if not cannot_tell(flights):
        fitted = "the rig as it is, fitted anew" if name.verdict == "none" else ""
        return whiteness(name.white, fitted or "the model with what was found")
    if name.leading is None or not name.leading.clear:
        return ""
    return whiteness(name.white, f"the rig as if {name.leading.names[0]} were in it")


def _untried(name: Name) -> str:
    if not name.untried:
        return ""
    return (
        f"Not tried, as nothing stands out: {listed(name.untried)}. Of their hundreds of sizes, "
        "some fit the noise of so few flights."
    )


def _added(steps: StepArtefacts) -> dict[str, Any]:
    add = steps.add
    if add is None:
        return {}
    return {
        "rig": add.rig,
        "old": add.old_sha256[:12],
        "new": add.new_sha256[:12],
        "effects": added_effects(add.effects),
        "caution": caution(steps.flights),
    }


def _nothing_added(steps: StepArtefacts) -> str:
    """Why not; "" where something was added, or the step has still to come."""
    if steps.add is not None or steps.missing in ("find", "name", "add"):
        return ""
    verdict = None if steps.name is None else steps.name.verdict
    if cannot_tell(steps.flights):
        why = f"{in_words(steps.flights)} cannot confirm what to add"
    elif unconfirmed(steps.flights) and verdict != "none":
        why = "no flight was kept apart to confirm what to add"
    else:
        return "Nothing: the rig file stays."
    return f"Nothing: {why}. The rig file stays."


def _shown(steps: StepArtefacts) -> dict[str, Any]:
    show = steps.show
    if show is None:
        nothing = "Nothing was added, so there is nothing to compare."
        return {"sentences": [nothing]} if steps.missing is None else {}
    if cannot_tell(steps.flights) and steps.add is None:
        return {"sentences": shrinking(steps.summary)}
    before, after = (show.white.before, show.white.after) if show.white else (None, None)
    return {
        "sentences": [_judging(show)],
        "gap": gap_table(_gap(steps)),
        "white": [
            whiteness(before, "these flights before"),
            whiteness(after, "these flights after"),
        ],
    }


def _gap(steps: StepArtefacts) -> dict[str, Gap]:
    """The channels; without a floor where what noise alone leaves is not known."""
    gap = {} if steps.show is None else steps.show.gap
    return without_noise(gap) if noise_unknown(steps.summary) else gap


def _judging(show: Show) -> str:
    if show.cross_validated:
        return (
            "Judged on each flight with sizes fitted to the others; what to fit was chosen with "
            "all of them, as there were too few to keep one apart."
        )
    if show.in_sample or not show.sealed:
        return (
            "Judged in sample, on the very flights that it was fitted to: there were too few to "
            "keep one apart."
        )
    verb = "was" if len(show.sealed) == 1 else "were"
    return f"Judged on {listed(show.sealed)}, which {verb} not looked at before."


def _data(steps: StepArtefacts) -> dict[str, Any]:
    find = _found(steps)
    return {
        "logs": log_rows(find.logs, find.split.sealed) + unflown_rows(find.unflown),
        "rig_sha256": find.rig_sha256 or UNKNOWN,
    }
