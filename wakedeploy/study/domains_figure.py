"""The figure and the tables of study 1.

In: lines of all domains. Out: bars per domain with the spread over seeds, the memoryless marked.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy import figures
from wakedeploy.study.domains import (
    MEMORYLESS,
    SOURCE_ONLY,
    VALID_ONLY,
    Line,
    by_predictor,
    held_out,
    sentence,
)
from wakedeploy.study.folder import Part
from wakedeploy.study.uncertainty import R2

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = (
    "domain",
    "predictor",
    "seed",
    "channel",
    "unit",
    "rmse",
    "sd",
    "r2",
    "r2_low",
    "r2_high",
)


def bars(told: Mapping[str, Sequence[Line]]) -> "Figure":
    """Error over the force's standard deviation, mean and spread over seeds, domain by domain."""
    across = min(len(told), 3)
    down = -(-len(told) // across)
    with figures.style():
        drawn, grid = figures.figure(down, across, size=(3.1 * across, 2.6 * down), squeeze=False)
        for axes, (domain, lines) in zip(grid.flat, told.items(), strict=False):
            every = by_predictor([line for line in lines if line.seed is not None])
            named = {name: own for name, own in every.items() if not name.endswith(SOURCE_ONLY)}
            for place, (name, own) in enumerate(named.items()):
                values = [line.normalised for line in own]
                plain = name == MEMORYLESS
                axes.barh(
                    place,
                    float(np.mean(values)),
                    xerr=float(np.std(values, ddof=1)) if len(values) > 1 else None,
                    color=figures.LIMIT if plain else figures.PREDICTED,
                    hatch="///" if plain else None,
                    edgecolor="white",
                    height=0.75,
                )
                kept = [line.normalised for line in every.get(name + SOURCE_ONLY, ())]
                if kept:
                    axes.plot(float(np.mean(kept)), place, "D", color=figures.SOURCE, markersize=4)
            for line in lines:
                if line.seed is None and line.predictor != "zero":
                    axes.axvline(line.normalised, color=figures.REFERENCE, linestyle="--")
                    axes.text(
                        line.normalised,
                        len(named) - 0.4,
                        line.predictor,
                        fontsize=6.5,
                        ha="center",
                        va="bottom",
                    )
            axes.set_yticks(range(len(named)), list(named))
            axes.invert_yaxis()
            axes.set_title(domain)
            hidden = len(every) > len(named)
            axes.set_xlabel(
                "RMSE / standard deviation" + ("; ◆ source's past only" if hidden else "")
            )
            axes.grid(axis="y", visible=False)
        for axes in list(grid.flat)[len(told) :]:
            axes.set_axis_off()
    return drawn


def parts(told: Mapping[str, Sequence[Line]]) -> list[Part]:
    """The study's figure over all domains, then each domain's table."""
    first = Part(
        "domains",
        "Error of each architecture, as a share of what predicting the mean would leave.",
        COLUMNS,
        rows([line for own in told.values() for line in own]),
        bars(told),
        (["domain", "what it says"], [[name, sentence(name, own)] for name, own in told.items()]),
    )
    others = []
    for name, own in told.items():
        others.append(
            Part(f"domains-{name}", sentence(name, own), COLUMNS, rows(own), shown=summary(own))
        )
        if own[0].groups:
            others.append(_kinds(name, own))
    return [first, *others]


def _kinds(name: str, lines: Sequence[Line]) -> Part:
    """RMSE of each kind of test episode; the page shows the last force channel, the file all."""
    channels, kinds = lines[0].channels, list(lines[0].groups)
    told = [
        [line.predictor, line.seed, kind, channel["channel"], channel["unit"], rmse]
        for line in lines
        for kind in kinds
        for channel, rmse in zip(channels, line.groups[kind], strict=True)
    ]
    means = [kind for kind in kinds if kind != VALID_ONLY]
    shown = []
    for predictor, own in by_predictor(lines).items():
        each = {kind: [line.groups[kind][-1] for line in own] for kind in kinds}
        mean = np.mean([each[kind] for kind in means], axis=0)
        shown.append(
            [predictor, *(_spread(v, ".3g") for v in each.values()), _spread(list(mean), ".3g")]
        )
    best, least = best_over_kinds(lines)
    text = (
        f"{channels[-1]['channel']} on {name} by kind of flight, RMSE in {channels[-1]['unit']}: "
        f"{best}, the best on validation, has a mean of {least:.2f} over the kinds."
    )
    columns = ("predictor", "seed", "kind", "channel", "unit", "rmse")
    return Part(
        f"domains-{name}-kinds", text, columns, told, shown=(["predictor", *kinds, "mean"], shown)
    )


def best_over_kinds(lines: Sequence[Line]) -> tuple[str, float]:
    """The predictor that is best on validation, and its last channel's RMSE, mean over kinds."""
    validation = held_out(lines)
    best = min(validation, key=lambda name: validation[name])
    own = [line for line in lines if line.predictor == best]
    kinds = [kind for kind in lines[0].groups if kind != VALID_ONLY]
    return best, float(np.mean([[line.groups[kind][-1] for kind in kinds] for line in own]))


def rows(lines: Sequence[Line]) -> list[list[Any]]:
    """Every channel of every line, under `COLUMNS`."""
    return [
        [
            line.domain,
            line.predictor,
            line.seed,
            *(channel[name] for name in COLUMNS[3:]),
        ]
        for line in lines
        for channel in line.channels
    ]


def summary(lines: Sequence[Line]) -> tuple[list[str], list[list[str]]]:
    """One domain's table: mean ± spread over seeds, and the first seed's R² with its interval."""
    channels = lines[0].channels
    columns = ["predictor"]
    for channel in channels:
        columns += [f"RMSE {channel['channel']} [{channel['unit']}]", "R²", "R² of one seed [90 %]"]
    told = []
    for name, own in by_predictor(lines).items():
        row = [f"{name} (no memory)" if name == MEMORYLESS else name]
        for i in range(len(channels)):
            row.append(_spread([line.channels[i]["rmse"] for line in own], ".4g"))
            row.append(_spread([line.channels[i]["r2"] for line in own], ".3f"))
            first = own[0].channels[i]
            row.append(R2(first["r2"], first["r2_low"], first["r2_high"]).text)
        told.append(row)
    return columns, told


def _spread(values: Sequence[float], form: str) -> str:
    mean = format(float(np.mean(values)), form)
    if len(values) < 2:
        return mean
    return f"{mean} ± {format(float(np.std(values, ddof=1)), '.1g')}"
