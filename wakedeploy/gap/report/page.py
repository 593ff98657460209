"""The report: one self-contained HTML page and its figures, as far as the steps have run.

In: a folder with the steps' artefacts. Out: `report.html` and `figures/*.png` in the same folder.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core import figures, pages
from wakedeploy.core.files import write_text_whole
from wakedeploy.gap.few_flights import cannot_tell, caution, in_words, unconfirmed
from wakedeploy.gap.folder import TITLE, Steps, read_steps
from wakedeploy.gap.report import charts
from wakedeploy.gap.report import maps as report_maps
from wakedeploy.gap.report.advice import advice
from wakedeploy.gap.report.first_screen import first_screen
from wakedeploy.gap.report.shrinkage import (
    closed_words,
    flight_count,
    gap_channel,
    gap_value,
    noise_unknown,
    shrinking,
    unchanged,
)
from wakedeploy.gap.report.summary import evidence, verdict_sentence
from wakedeploy.gap.report.tables import (
    added_effects,
    detectable_table,
    gap_table,
    log_rows,
    noise_table,
    place_table,
    ranking_table,
    unknown_effect,
    whiteness,
)
from wakedeploy.gap.wording import (
    UNKNOWN,
    counted,
    entries,
    listed,
    mapping,
    number,
    parameters_of,
    quantity,
    spoken,
    texts,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """One figure of the report: file name, caption, and who draws it."""

    name: str
    caption: str
    draw: "Callable[[Steps], Figure | None]"


PICTURES = (
    Picture(
        "maps_exogenous",
        "Where they disagree, against what was known beforehand: mean residual (line) and its 90 % "
        "interval (band) per bin; dotted, a bin that was passed through once: its interval is not "
        "known. Blue: significant (q ≤ 0.05, all maps counted); grey: not. A place is listed only "
        "if it exceeds what the model's approximations leave on this rig; an innovation (sd: "
        "standard deviations of a reading's forecast) counts by q alone.",
        lambda steps: report_maps.draw_maps(report_maps.strongest_maps(steps.find)[0]),
    ),
    Picture(
        "maps_fed_back",
        "The same against what the controller feeds back. A disagreement here can be an echo of "
        "one elsewhere: under control, a missing force shows in the command.",
        lambda steps: report_maps.draw_maps(report_maps.strongest_maps(steps.find)[1]),
    ),
    Picture(
        "replay",
        "Open-loop replay from filtered states: the error in height after each horizon, and the "
        "error that the model expects of itself. Its noise is fitted to the same flights, so a "
        "missing effect raises both.",
        lambda steps: charts.draw_replay(steps.find),
    ),
    Picture(
        "spectrum",
        "Innovations, the part of each measurement that the model did not foresee. If only noise "
        "is left, spectrum and autocorrelation stay within the shaded bands.",
        lambda steps: charts.draw_spectrum(
            steps.find, {} if cannot_tell(steps.flights) and not steps.add else steps.show
        ),
    ),
    Picture(
        "ranking",
        "What each effect gains on flights that its own parameters were not fitted to (noise and "
        "calibration were, under every hypothesis), with 90 % intervals. Left of "
        "the threshold is what calibration errors alone can gain on this rig. Orange: found; blue: "
        "above the threshold and not chosen; grey: below.",
        lambda steps: charts.draw_ranking(steps.name),
    ),
    Picture(
        "confusion",
        "If the effect of a row is the truth, how much the best version of the effect of a column "
        "loses on these flights, at the size found or else at its usual size. Below 3 nats (×) "
        "they cannot be told apart; in a row full of × that effect would hardly show at all.",
        lambda steps: charts.draw_confusion(steps.name),
    ),
    Picture(
        "before_after",
        "The gap per channel on the flights shown, with 90 % intervals; dashed, what noise alone "
        "leaves. Closed: (before² − after²) / (before² − floor²), no more than 100 %. Noise and "
        "calibration are fitted before and after; the new rig file has the effect alone, with the "
        "calibration as it was.",
        lambda steps: charts.draw_gaps({"gap": _gap(steps)}),
    ),
    Picture(
        "places",
        "The mean residual at the places found, on the flights shown, before and after, with 90 % "
        "intervals.",
        lambda steps: report_maps.draw_places(steps.show, steps.find),
    ),
    Picture(
        "forecasts",
        "One flight: height 0.25 s ahead as forecast by the model before and after. The rms leaves "
        "out readings that strayed.",
        lambda steps: charts.draw_traces(steps.show),
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
        lambda steps: charts.draw_retraining(steps.show),
    ),
)

# Of too few flights no others are drawn, and their ranking is nothing like a held-out one.
_OF_FEW = ("maps_exogenous", "maps_fed_back", "replay", "spectrum", "ranking")
_RANKED_ON_FEW = (
    "What each effect gains on so few flights. Of two, each is judged by sizes fitted to the "
    "other; of one nothing can be left out, and each parameter costs a nat instead (Akaike 1974). "
    "Blue: above the threshold, which is what calibration errors alone can gain on this rig, where "
    "that is simulated; grey: below. Neither is a finding."
)


def write_report(out: Path) -> Path:
    """Draw the figures of the steps that have run in `out`, and write its `report.html`.

    Returns the page's path. Raises UnusableInput for an artefact that cannot be read, and when the
    page or a figure cannot be written.
    """
    steps = read_steps(out)
    pictures = draw_pictures(steps, out / "figures")
    told = _opening(steps, out) | _data(steps) | {"pictures": pictures, "title": TITLE}
    told |= {"where": _where(steps), "which": _which(steps), "shown": _shown(steps)}
    told |= {"added": _added(steps), "nothing_added": _nothing_added(steps)}
    path = out / "report.html"
    write_text_whole(path, pages.page("wakedeploy.gap.report", "report.html", **told))
    return path


def draw_pictures(steps: Steps, folder: Path) -> dict[str, pages.Picture]:
    """Draw every figure there is something for, as PNG; others are removed."""
    drawn = {}
    few = cannot_tell(steps.flights)
    left_out = () if not few or steps.add else {each.name for each in PICTURES} - {*_OF_FEW}
    for each in PICTURES:
        path = folder / f"{each.name}.png"
        with figures.style():
            figure = None if each.name in left_out else each.draw(steps)
        if figure is None:
            path.unlink(missing_ok=True)  # of an earlier run
            continue
        figures.save(figure, path)
        caption = _RANKED_ON_FEW if few and each.name == "ranking" else each.caption
        drawn[each.name] = pages.Picture(path, caption)
    return drawn


def _opening(steps: Steps, out: Path) -> dict[str, Any]:
    """The first screen, the numbers that matter, what comes next; then the account in detail."""
    summary = steps.summary
    return {
        "flights": _flights(steps),
        "verdict": verdict_sentence(summary),
        "answers": first_screen(summary),
        "tile_pairs": _tiles(summary),
        "next": advice(steps, out),
        "evidence": evidence(summary),
    }


def _flights(steps: Steps) -> str:
    logs = entries(steps.find.get("logs"))
    seconds = quantity(sum(number(log.get("seconds")) for log in logs), "s")
    return f"{counted(len(logs), 'flight')}, {seconds}" if logs else "No flights read yet"


def _tiles(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    tiles = []
    for effect in entries(summary.get("effects")):
        for parameter, value in parameters_of(effect):
            tiles.append((f"{effect.get('name')}, {spoken(parameter)}", value))
    name, channel = gap_channel(summary)
    if channel and cannot_tell(flight_count(summary)):
        tiles.append((f"error of the {name}", gap_value(channel, "before")))
    elif channel:
        tiles.append((f"{name}, before", gap_value(channel, "before")))
        members = texts(summary.get("as_if"))
        after = f"after, if it is {listed(members)}" if members else "after"
        tiles.append((after, gap_value(channel, "after")))
        tiles.append(("noise alone", gap_value(channel, "noise_floor")))
        tiles.append(("of the gap closed", closed_words(channel) or UNKNOWN))
        if unchanged(channel):
            noise = [] if noise_unknown(summary) else [tiles[-2]]
            tiles[-4:] = [(f"error of the {name}", gap_value(channel, "before")), *noise]
    return tiles


def _where(steps: Steps) -> dict[str, Any]:
    find = steps.find
    if not find:
        return {}
    return {
        "sentence": find.get("sentence"),
        "places": place_table(entries(find.get("places"))),
        "white": whiteness(mapping(find.get("white")), "the rig as it is"),
    }


def _which(steps: Steps) -> dict[str, Any]:
    name = steps.name
    if not name:
        return {}
    return {
        "rest_white": _rest_white(steps),
        "untried": _untried(name),
        "unknown": unknown_effect(mapping(name.get("unknown"))),
        "ranking": ranking_table(name),
        "noise": noise_table(mapping(name.get("noise"))),
        "detectable": detectable_table(name),
        "folds_detectable": name.get("verdict") != "none",
    }


def _rest_white(steps: Steps) -> str:
    """Whether the answer leaves more than noise; nothing where the answer is the rig as it is."""
    white, leading = mapping(steps.name.get("white")), mapping(steps.name.get("leading"))
    if not cannot_tell(steps.flights):
        fitted = "the rig as it is, fitted anew" if steps.name.get("verdict") == "none" else ""
        return whiteness(white, fitted or "the model with what was found")
    if not leading.get("clear"):
        return ""
    return whiteness(white, f"the rig as if {texts(leading.get('names'))[0]} were in it")


def _untried(name: Mapping[str, Any]) -> str:
    left = texts(name.get("untried"))
    if not left:
        return ""
    return (
        f"Not tried, as nothing stands out: {listed(left)}. Of their hundreds of sizes, some fit "
        "the noise of so few flights."
    )


def _added(steps: Steps) -> dict[str, Any]:
    add = steps.add
    if not add:
        return {}
    old, new = (str(add.get(f"{which}_sha256") or UNKNOWN)[:12] for which in ("old", "new"))
    return {
        "rig": add.get("rig"),
        "old": old,
        "new": new,
        "effects": added_effects(entries(add.get("effects"))),
        "caution": caution(steps.flights),
    }


def _nothing_added(steps: Steps) -> str:
    """Why not; "" where something was added, or the step has still to come."""
    if steps.add or steps.missing in ("find", "name", "add"):
        return ""
    if cannot_tell(steps.flights):
        why = f"{in_words(steps.flights)} cannot confirm what to add"
    elif unconfirmed(steps.flights) and steps.name.get("verdict") != "none":
        why = "no flight was kept apart to confirm what to add"
    else:
        return "Nothing: the rig file stays."
    return f"Nothing: {why}. The rig file stays."


def _shown(steps: Steps) -> dict[str, Any]:
    show = steps.show
    if not show:
        nothing = "Nothing was added, so there is nothing to compare."
        return {"sentences": [nothing]} if steps.missing is None else {}
    if cannot_tell(steps.flights) and not steps.add:
        return {"sentences": shrinking(steps.summary)}
    white = mapping(show.get("white"))
    return {
        "sentences": [_judging(show)],
        "gap": gap_table(_gap(steps)),
        "white": [
            whiteness(mapping(white.get("before")), "these flights before"),
            whiteness(mapping(white.get("after")), "these flights after"),
        ],
    }


def _gap(steps: Steps) -> Mapping[str, Any]:
    """The channels; without a floor where what noise alone leaves is not known."""
    gap = mapping(steps.show.get("gap"))
    if not noise_unknown(steps.summary):
        return gap
    kept = ("before", "after", "before_interval", "after_interval", "unit")
    return {n: {k: v for k, v in mapping(c).items() if k in kept} for n, c in gap.items()}


def _judging(show: Mapping[str, Any]) -> str:
    sealed = texts(show.get("sealed"))
    if show.get("cross_validated"):
        return (
            "Judged on each flight with sizes fitted to the others; what to fit was chosen with "
            "all of them, as there were too few to keep one apart."
        )
    if show.get("in_sample") or not sealed:
        return (
            "Judged in sample, on the very flights that it was fitted to: there were too few to "
            "keep one apart."
        )
    verb = "was" if len(sealed) == 1 else "were"
    return f"Judged on {listed(sealed)}, which {verb} not looked at before."


def _data(steps: Steps) -> dict[str, Any]:
    sealed = texts(mapping(steps.find.get("split")).get("sealed"))
    return {
        "logs": log_rows(entries(steps.find.get("logs")), sealed),
        "rig_sha256": steps.find.get("rig_sha256") or UNKNOWN,
    }
