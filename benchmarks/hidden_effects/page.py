"""The benchmark's summary as text, as a Markdown page, and as a figure.

In: what `table.summary` made. Out: strings, and a matplotlib figure. The bars are those that were
set before the run.
"""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.hidden_effects.cases import all_cases
from benchmarks.results.section import table
from wakedeploy.core import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Summary = Mapping[str, Any]
_RATES = (
    ("right_from_50_nats", "right, 50 nats and above", "≥ 95 %"),
    ("right_15_to_50_nats", "right, 15 to 50 nats", "≥ 80 %"),
    ("right_shown", "right, 15 nats and above, of those that show in forecasts", ""),
    ("right_not_shown", "right, 15 nats and above, of those that do not", ""),
    ("false_alarms", "false alarms without an effect", "≤ 5 %"),
    ("unknown_outside", "outside the library, called unknown", "≥ 90 %"),
    ("unknown_outside_from_15_nats", "the same, 15 nats and above", ""),
    ("unknown_outside_shown", "the same, of those that show in forecasts", ""),
    (
        "outside_or_unseen",
        "outside the library, unknown, or nothing that matters where none shows",
        "",
    ),
    ("pairs_right", "pairs, both found", ""),
    ("pairs_in_part", "pairs, one found and a rest admitted", ""),
)
_SPREADS = (
    ("closed_from_50_nats", "share of the gap closed, mean", "≥ 0.8", 1.0),
    ("closed_by_a_member", "the same, had the best of a class been added", "", 1.0),
    ("class_size", "size of a class, mean", "≤ 2", 1.0),
    ("seconds", "seconds per case, mean", "< 120", 1.0),
)


def text_of(summary: Summary) -> str:
    """The page as it stands in a terminal: the same tables."""
    return markdown_of(summary)


def markdown_of(summary: Summary, figure_name: str = "", lines_name: str = "") -> str:
    """The page: headline figures against their bars, then the tables behind them."""
    counts = ", ".join(f"{n} {kind}" for kind, n in sorted(summary["cases"].items()))
    several = len(summary["commits"]) > 1
    frozen = "the commits below" if several else "".join(summary["commits"]) or "no commit"
    parts = [
        "# The gap workflow against hidden effects",
        "`python -m benchmarks.hidden_effects` hides effects in two plants and judges the answers "
        "of the gap workflow. The second plant imports nothing of this project. Every case has "
        "turbulence, outliers, clock jitter and calibration errors of the size that the rig file "
        "states.",
        "Strength is the gain in log-likelihood of the hidden effect on held-out flights, in nats, "
        "as the judge measures it. Brackets are Wilson's 95 % intervals. A case on which the "
        "workflow failed counts as wrong.",
        f"Cases: {counts}{_unfinished_text(summary)}. Code frozen at: {frozen}."
        + (
            f" Each case has a line in [{Path(lines_name).name}]({lines_name})."
            if lines_name
            else ""
        ),
        headline(summary),
        _closed(summary),
        f"![Share of right answers against the strength of the hidden effect]({figure_name})"
        if figure_name
        else "",
        "## Right answers against strength\n\n" + _by_nats(summary["by_nats"]),
        "## Plants\n\n" + _plants(summary),
        _by_commit(summary["by_commit"]),
        "## Coverage of 90 % intervals\n\n"
        + _coverage(summary["coverage_fitted"], summary["coverage_named"]),
        _belief(summary["belief"]),
        "## What was answered\n\nA class that holds the hidden effect counts as *class*.\n\n"
        + _confusion(summary["confusion"]),
        _tracking(summary["tracking"]),
        _errors(summary["errors"]),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _unfinished_text(summary: Summary) -> str:
    """How much of the full list a run has not done yet."""
    done, listed = sum(summary["cases"].values()), len(all_cases())
    return f" (a partial run: {done} of {listed})" if done < listed else ""


def draw(summary: Summary) -> "Figure":
    """Accuracy against nats with intervals, and the confusion matrix."""
    hidden = sorted(summary["confusion"])
    with figures.style():
        tall = max(3.4, 0.17 * len(hidden) + 1.5)
        drawn, (bins_axes, confusion_axes) = figures.figure(
            1, 2, size=(11.0, tall), gridspec_kw={"width_ratios": (1.0, 1.5)}
        )
        _draw_bins(bins_axes, summary["by_nats"])
        _draw_confusion(confusion_axes, summary["confusion"], hidden)
    return drawn


def headline(summary: Summary) -> str:
    """The figures that have a bar, and those beside them."""
    rows = [
        [label, _share(summary[key]), f"{summary[key]['count']} of {summary[key]['of']}", bar]
        for key, label, bar in _RATES
    ]
    for key, label, bar, scale in _SPREADS:
        measure = summary[key]
        if measure is not None:
            rows.append([label, f"{measure['mean'] * scale:.2f}", f"over {measure['count']}", bar])
    flown = summary["tracking"]
    if flown["mean_ratio"] is not None:
        label = "tracking error, corrected rig and its predictor over uncorrected, mean"
        rows.append([label, f"{flown['mean_ratio']:.2f}", f"over {flown['count']}", ""])
    for key, label in (("coverage_fitted", "all cases"), ("coverage_named", "named ones")):
        measure = summary[key]["all"]
        rows.append(
            [
                f"90 % intervals, {label}",
                _share(measure),
                f"{measure['count']} of {measure['of']}",
                "85–95 %",
            ]
        )
    return table(["", "measured", "cases", "bar"], rows)


def _closed(summary: Summary) -> str:
    """What the share of the gap closed is a share of, and in how many cases there is none."""
    unseen, own_floor = summary["does_not_show"], summary["closed_by_own_floor"]
    text = (
        "The share closed is (before² − after²) / (before² − floor²). These are errors 0.25 s "
        "ahead on sealed flights, for effects of 50 nats and above and for pairs. The floor is the "
        "error of the judge, who fits the hidden effect to the other flights.\n\n"
        f"{unseen['count']} of {unseen['of']} cases have no share: the hidden effect does not show "
        "in that error beyond its scatter."
    )
    if own_floor is not None:
        text += (
            " With the floor that the corrected model expects of itself, the mean is "
            f"{own_floor['mean']:.2f}, over {own_floor['count']}."
        )
    return text + (
        "\n\nAn effect outside the library that does not show in that error does not matter as far "
        'as anyone can tell: "nothing that matters" is a true answer then, as "unknown" is.'
    )


def _by_nats(bins: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        [
            _range(b),
            _share(dict(b) | {"low": b["low_share"], "high": b["high_share"]}),
            f"{b['count']} of {b['of']}",
        ]
        for b in bins
    ]
    return table(["nats", "right", "cases"], rows)


def _plants(summary: Summary) -> str:
    rows = [
        [plant, _share(summary["by_plant"][plant]), _share(summary["false_alarms_by_plant"][plant])]
        for plant in summary["by_plant"]
    ]
    return table(["plant", "right from 15 nats", "false alarms"], rows)


def _by_commit(rates: Mapping[str, Mapping[str, Any]]) -> str:
    """The same rates for the cases of each commit, where there are several."""
    if len(rates) < 2:
        return ""
    keys = ("right_from_50_nats", "right_15_to_50_nats", "false_alarms", "unknown_outside")
    rows = [
        [
            commit or "no commit",
            str(of_it["cases"]),
            *(f"{of_it[key]['count']} of {of_it[key]['of']}" for key in keys),
            "–" if of_it["seconds"] is None else f"{of_it['seconds']['mean']:.0f}",
            f"{of_it['longest_seconds']:.0f}",
        ]
        for commit, of_it in rates.items()
    ]
    head = ["commit", "cases", "right from 50 nats", "15 to 50", "false alarms", "outside, unknown"]
    return (
        "## Commits\n\nCases are asked in an order in which any first part is a fair sample.\n\n"
        + table([*head, "seconds, mean", "longest"], rows)
    )


def _coverage(fitted: Mapping[str, Any], named: Mapping[str, Any]) -> str:
    blank = {"share": math.nan, "low": 0.0, "high": 1.0, "count": 0, "of": 0}
    rows = []
    for name, coverage in fitted.items():
        other = named.get(name, blank)
        cells = [
            f"{_share(x)}, {x['count']} of {x['of']}" if x["of"] else "–" for x in (coverage, other)
        ]
        rows.append([name, *cells])
    return table(["effect", "all cases, true effect fitted", "named by the workflow"], rows)


def _belief(rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return ""
    cells = [
        [
            f"{100 * row['from']:g} to {100 * row['to']:g} %",
            f"{100 * row['held']:.1f} %",
            _share(row),
            f"{row['count']} of {row['of']}",
        ]
        for row in rows
    ]
    text = (
        "Each named effect has a confidence; members of classes are not counted. A confidence is "
        "honest where the share of hidden effects agrees with the mean confidence."
    )
    head = ["confidence", "mean", "hidden indeed", "answers"]
    return f"## How sure, and how often rightly\n\n{text}\n\n{table(head, cells)}"


def _confusion(confused: Mapping[str, Mapping[str, int]]) -> str:
    rows = []
    for hidden, counts in sorted(confused.items()):
        others = sorted(((n, a) for a, n in counts.items() if a != hidden), reverse=True)
        total, right = sum(counts.values()), counts.get(hidden, 0)
        rows.append([hidden, f"{right} of {total}", ", ".join(f"{a} {n}" for n, a in others)])
    return table(["hidden", "answered exactly so", "other answers"], rows)


def _tracking(flown: Mapping[str, Any]) -> str:
    if not flown["cases"]:
        return ""
    rows = [[name, case["plant"], *_flown(case)] for name, case in flown["cases"].items()]
    head = ["case", "plant", "answer", "before [mm]", "after [mm]", "after / before", "force [N]"]
    mean = flown["mean_ratio"]
    text = (
        "For a few fixed cases, one predictor is trained on the simulation of the uncorrected rig "
        "file and one on that of the corrected file. Each flies with its own rig file on the plant "
        "that hides the effect, on the same references. Errors are root mean squares of the height "
        "over four flights, with 90 % intervals; flights are paired for the ratio. The last column "
        "has both predictors' errors on the sealed flights."
    )
    if mean is not None:
        text += f" Geometric mean of the ratios: {mean:.2f}, over {flown['count']}."
    return f"## Old and new predictor flown\n\n{text}\n\n{table(head, rows)}"


def _flown(case: Mapping[str, Any]) -> list[str]:
    """Cells of one tracked case after its name and plant."""
    word = "right" if case["right"] else f"{case['verdict']}, not right"
    flown = case["flown"]
    if flown is None:
        why = (case["error"] or "nothing was corrected").replace("|", "/")
        return [word, why, "–", "–", "–"]
    before, after = (
        "failsafe" if (row := flown[key])["rmse"] is None else _within(row["rmse"], row, 1)
        for key in ("before", "after")
    )
    ratio = "–"
    if flown["ratio"] is not None:
        low, high = flown["ratio_interval"] or (math.nan, math.nan)
        ratio = _within(flown["ratio"], {"low": low, "high": high}, 2)
    force = f"{flown['retrain']['old_rmse']:.3f} → {flown['retrain']['new_rmse']:.3f}"
    return [word, before, after, ratio, force]


def _within(value: float, ends: Mapping[str, float | None], digits: int) -> str:
    low, high = (math.nan if ends[k] is None else ends[k] for k in ("low", "high"))
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def _errors(errors: Mapping[str, str]) -> str:
    if not errors:
        return ""
    rows = [[name, _placeless(error)] for name, error in sorted(errors.items())]
    return "## Cases that failed\n\nEach counts as wrong.\n\n" + table(["case", "error"], rows)


def _placeless(error: str) -> str:
    """An error's words with file names alone, which mean the same on any machine."""
    return re.sub(r"\S*/(?=[^/\s])", "", error).replace("|", "/")


def _share(rate: Mapping[str, float]) -> str:
    if not rate["of"]:
        return "–"
    return f"{100 * rate['share']:.0f} % [{100 * rate['low']:.0f}, {100 * rate['high']:.0f}]"


def _range(bounds: Mapping[str, float | None]) -> str:
    high = bounds["high"]
    endless = high is None or math.isinf(high)
    return f"{bounds['low']:g} and above" if endless else f"{bounds['low']:g} to {high:g}"


def _draw_bins(axes: Any, bins: Sequence[Mapping[str, Any]]) -> None:
    known = [b for b in bins if b["of"]]
    places = range(len(known))
    share = [b["share"] for b in known]
    reach = [
        [max(s - b["low_share"], 0.0) for s, b in zip(share, known, strict=True)],
        [max(b["high_share"] - s, 0.0) for s, b in zip(share, known, strict=True)],
    ]
    axes.errorbar(places, share, yerr=reach, fmt="o", color=figures.MEASURED, capsize=3)
    axes.set_xticks(list(places), [f"{_range(b)}\n(n = {b['of']})" for b in known], fontsize=7)
    for bar, line, of in ((0.95, "--", "bar from 50 nats"), (0.8, ":", "bar from 15 nats")):
        axes.axhline(bar, color=figures.LIMIT, linestyle=line)
        axes.annotate(of, (0.01, bar), xycoords=("axes fraction", "data"), va="bottom", fontsize=7)
    axes.set(ylim=(0.0, 1.03), ylabel="share of right answers", title="Right answers")
    axes.set_xlabel("strength of the hidden effect [nats]")


def _draw_confusion(
    axes: Any, table: Mapping[str, Mapping[str, int]], hidden: Sequence[str]
) -> None:
    answers = sorted({a for counts in table.values() for a in counts})
    shares = [[table[h].get(a, 0) / sum(table[h].values()) for a in answers] for h in hidden] or [
        [0.0]
    ]
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.grid(visible=False)
    axes.set_xticks(range(len(answers)), answers, rotation=90, fontsize=6)
    axes.set_yticks(range(len(hidden)), hidden, fontsize=6)
    axes.set(title="Hidden (rows) and answered (columns)")
