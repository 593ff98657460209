"""The figure and the tables of study 1.

In: lines of all domains. Out: bars per domain with the spread over seeds, the memoryless marked.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.domains import (
    MAIN,
    MEMORYLESS,
    SOURCE_ONLY,
    VALID_ONLY,
    Line,
    by_predictor,
    held_out,
    r2_over_seeds,
)
from wakedeploy.study.domains_sentence import headline, sentence
from wakedeploy.study.folder import Part
from wakedeploy.study.runs import choice
from wakedeploy.study.uncertainty import spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FARTHEST = 1.4  # of the longest bar: what learns nothing is drawn as far as that
COLUMNS = (
    "domain",
    "predictor",
    "seed",
    "hyper",
    "channel",
    "unit",
    "rmse",
    "rmse_low",
    "rmse_high",
    "sd",
    "r2",
    "r2_low",
    "r2_high",
)


def bars(by_domain: Mapping[str, Sequence[Line]]) -> "Figure":
    """Error over the standard deviation, mean and spread over seeds, domain by domain."""
    across = min(len(by_domain), 3)
    down = -(-len(by_domain) // across)
    size = (3.1 * across, 0.3 + 2.6 * down)
    with figures.style():
        drawn, grid = figures.figure(down, across, size=size, squeeze=False)
        for axes, (domain, lines) in zip(grid.flat, by_domain.items(), strict=False):
            _panel(axes, lines)
            axes.set_title(f"{domain}, {MAIN[domain]}" if domain in MAIN else domain)
        for axes in list(grid.flat)[len(by_domain) :]:
            axes.set_axis_off()
        figures.legend_above(drawn, grid, across)
    return drawn


def _panel(axes: "Axes", lines: Sequence[Line]) -> None:
    every = by_predictor([line for line in lines if line.seed is not None])
    named = {name: runs for name, runs in every.items() if not name.endswith(SOURCE_ONLY)}
    longest = 1.0e-9
    for place, (name, runs) in enumerate(named.items()):
        values = [line.error for line in runs]
        plain = name == MEMORYLESS
        deviation = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
        longest = max(longest, float(np.mean(values)) + deviation)
        axes.barh(
            place,
            float(np.mean(values)),
            xerr=deviation if len(values) > 1 else None,
            color=figures.LIMIT if plain else figures.PREDICTED,
            hatch="///" if plain else None,
            edgecolor="white",
            height=0.75,
        )
        kept = [line.error for line in every.get(name + SOURCE_ONLY, ())]
        if kept:
            axes.plot(float(np.mean(kept)), place, "D", color=figures.SOURCE, markersize=4,
                      linestyle="none", label="source's past only")  # fmt: skip
            longest = max(longest, float(np.mean(kept)))
    room = 0.0  # below the bars, for words
    for line, style in _limits(lines):
        if line.error <= _FARTHEST * longest:
            axes.axvline(line.error, color=figures.REFERENCE, linestyle=style, linewidth=0.9,
                         label=line.predictor)  # fmt: skip
        else:  # drawn where it is, it would squeeze the bars
            room = 0.5
            axes.text(0.99, 0.01, f"{line.predictor}: {line.error:.2f} →", fontsize=6.5, ha="right",
                      va="bottom", transform=axes.transAxes,
                      bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})  # fmt: skip
    axes.set_yticks(range(len(named)), list(named))
    axes.set_ylim(len(named) - 0.4 + room, -0.6)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("RMSE / standard deviation")
    axes.grid(axis="y", visible=False)


def _limits(lines: Sequence[Line]) -> list[tuple[Line, str]]:
    """What learns nothing, with the style of its line."""
    styles = {"zero": ":"}
    return [(line, styles.get(line.predictor, "--")) for line in lines if line.seed is None]


def parts(by_domain: Mapping[str, Sequence[Line]]) -> list[Part]:
    """The study's figure over all domains, then each domain's table."""
    seen = {line.predictor for lines in by_domain.values() for line in lines}
    first = Part(
        "domains",
        f"{headline(by_domain)}The bars are each architecture's error, as a share of what "
        f"predicting the mean would leave.{choice(seen)}",
        COLUMNS,
        rows([line for lines in by_domain.values() for line in lines]),
        bars(by_domain),
        (
            ["domain", "what it says"],
            [[name, sentence(name, lines)] for name, lines in by_domain.items()],
        ),
    )
    others = []
    for name, lines in by_domain.items():
        others.append(
            Part(
                f"domains-{name}", sentence(name, lines), COLUMNS, rows(lines), shown=summary(lines)
            )
        )
        if lines[0].groups:
            others.append(_kinds(name, lines))
    return [first, *others]


def _kinds(name: str, lines: Sequence[Line]) -> Part:
    """RMSE of each kind of test episode; the page shows the last force channel, the file all."""
    channels, kinds = lines[0].channels, list(lines[0].groups)
    rows = [
        [
            line.predictor,
            line.seed,
            line.hyper_text,
            kind,
            channel["channel"],
            channel["unit"],
            rmse,
        ]
        for line in lines
        for kind in kinds
        for channel, rmse in zip(channels, line.groups[kind], strict=True)
    ]
    means = [kind for kind in kinds if kind != VALID_ONLY]
    shown = []
    for predictor, runs in by_predictor(lines).items():
        each = {kind: [line.groups[kind][-1] for line in runs] for kind in kinds}
        mean = np.mean([each[kind] for kind in means], axis=0)
        shown.append(
            [predictor, *(spread(v, ".3g") for v in each.values()), spread(list(mean), ".3g")]
        )
    text = f"{channels[-1]['channel']} on {name} by kind of flight, RMSE in {channels[-1]['unit']}."
    best = best_over_kinds(lines)
    if best is not None:
        arch, least = best
        text = (
            f"{text[:-1]}: {arch}, the best on validation, has a mean of {least:.2f} over the "
            "kinds of test flights."
        )
    columns = ("predictor", "seed", "hyper", "kind", "channel", "unit", "rmse")
    return Part(
        f"domains-{name}-kinds", text, columns, rows, shown=(["predictor", *kinds, "mean"], shown)
    )


def best_over_kinds(lines: Sequence[Line]) -> tuple[str, float] | None:
    """The predictor that is best on validation, and its last channel's RMSE, mean over kinds.

    None where nothing was trained. What is kept from a past is no candidate.
    """
    validation = {n: v for n, v in held_out(lines).items() if not n.endswith(SOURCE_ONLY)}
    if not validation:
        return None
    best = min(validation, key=lambda name: validation[name])
    kinds = [kind for kind in lines[0].groups if kind != VALID_ONLY]
    of_best = [line for line in lines if line.predictor == best]
    return best, float(np.mean([[line.groups[kind][-1] for kind in kinds] for line in of_best]))


def rows(lines: Sequence[Line]) -> list[list[Any]]:
    """Every channel of every line, under `COLUMNS`."""
    return [
        [
            line.domain,
            line.predictor,
            line.seed,
            line.hyper_text,
            *(channel[name] for name in COLUMNS[4:]),
        ]
        for line in lines
        for channel in line.channels
    ]


def summary(lines: Sequence[Line]) -> tuple[list[str], list[list[str]]]:
    """One domain's table: mean ± spread over seeds, and R² with the interval of its mean."""
    channels = lines[0].channels
    columns = ["predictor"]
    for channel in channels:
        columns += [f"RMSE {channel['channel']} [{channel['unit']}]", "R²", "its mean [90 %]"]
    rows = []
    for name, runs in by_predictor(lines).items():
        row = [f"{name} (no memory)" if name == MEMORYLESS else name]
        for i in range(len(channels)):
            row.append(spread([line.channels[i]["rmse"] for line in runs], ".4g"))
            row.append(spread([line.channels[i]["r2"] for line in runs], ".3f"))
            row.append(r2_over_seeds(runs, i).text)
        rows.append(row)
    return columns, rows
