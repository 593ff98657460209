"""The figure and the tables of the study of the past that is seen.

In: points of all domains. Out: for each domain the error against the past, with the shortest that
suffices marked.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.colours import looks
from wakedeploy.study.domains import MEMORYLESS, SOURCE_ONLY, ZERO
from wakedeploy.study.folder import Part
from wakedeploy.study.runs import choice
from wakedeploy.study.uncertainty import R2, spread
from wakedeploy.study.window import (
    WHOLE,
    Seen,
    architectures_of,
    need,
    sentence,
    unlearned_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FARTHEST = 1.15  # of the panel's largest other error: what is farther off is text, not drawn
_LEGEND_IN = 4.4  # the least width [inch] in which the legend's two columns have room
COLUMNS = (
    "domain",
    "arch",
    "seed",
    "hyper",
    "past_s",
    "memory",
    "samples",
    "bytes",
    "rmse",
    "sd",
    "r2",
    "r2_low",
    "r2_high",
    "scored",
)


def curves(
    by_domain: Mapping[str, Sequence[Seen]], delays_s: Mapping[str, float | None]
) -> "Figure":
    """Error over the channel's standard deviation against the past [s], domain by domain.

    A line where the wake's delay is known.
    """
    across = min(len(by_domain), 3)
    down = -(-len(by_domain) // across)
    size = (max(3.1 * across, _LEGEND_IN), 0.7 + 2.4 * down)
    with figures.style():
        drawn, grid = figures.figure(down, across, size=size, squeeze=False)
        for axes, (domain, points) in zip(grid.flat, by_domain.items(), strict=False):
            _panel(axes, domain, points, delays_s.get(domain))
        for axes in list(grid.flat)[len(by_domain) :]:
            axes.set_axis_off()
        for axes in grid[:, 0]:
            axes.set_ylabel("RMSE / standard deviation")
        figures.legend_above(drawn, grid, 4 if across == 3 else 2)
    return drawn


def _panel(axes: "Axes", domain: str, points: Sequence[Seen], delay_s: float | None) -> None:
    plain = float(np.mean([p.share for p in points if p.arch == MEMORYLESS]))
    axes.axhline(plain, color=figures.LIMIT, linestyle="--", label=f"{MEMORYLESS} (no memory)")
    if delay_s is not None:
        axes.axvline(delay_s, color=figures.TRUE, linewidth=0.9, label="transport delay")
    _unlearned(axes, points)
    names = architectures_of(points)
    known = looks([name.removesuffix(SOURCE_ONLY) for name in names])
    for arch in names:
        colour, marker = known[arch.removesuffix(SOURCE_ONLY)]
        of_arch = [p for p in points if p.arch == arch]
        pasts = sorted({p.past_s for p in of_arch if p.past_s < WHOLE})
        values = [[p.share for p in of_arch if p.past_s == past] for past in pasts]
        mean, deviation = [float(np.mean(v)) for v in values], [float(np.std(v)) for v in values]
        blinded = arch.endswith(SOURCE_ONLY)
        axes.errorbar([0.0, *pasts], [plain, *mean], [0.0, *deviation], color=colour, marker=marker,
                      markersize=4, elinewidth=0.8, label=arch, alpha=0.5 if blinded else 1.0,
                      linestyle="--" if blinded else "-")  # fmt: skip
        whole = [p.share for p in of_arch if p.past_s == WHOLE]
        if whole and not blinded:
            axes.axhline(float(np.mean(whole)), color=colour, linestyle=":", linewidth=0.9,
                         label=f"{arch}, whole past")  # fmt: skip
        found = need(points, arch)
        if found.enough is not None and not found.loses:
            axes.plot(found.enough.past_s, found.error, "o", markersize=8, markerfacecolor="none",
                      color=colour, clip_on=False)  # fmt: skip
    axes.plot([], [], "o", markersize=8, markerfacecolor="none", color=figures.REFERENCE,
              label="shortest that suffices")  # fmt: skip
    axes.set_title(domain)
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("past that is seen [s]")


def _unlearned(axes: "Axes", points: Sequence[Seen]) -> None:
    """What learned nothing: a line across, or in words where that would squeeze the others."""
    beside = unlearned_of(points)
    highest = max(p.share for p in points if p not in beside)
    far = [point for point in beside if point.share > _FARTHEST * highest]
    for point in beside:
        if point not in far:
            colour = figures.LIMIT if point.arch == ZERO else figures.REFERENCE
            axes.axhline(point.share, color=colour, linestyle="-.", linewidth=0.9, label=point.arch)
    if far:
        text = ", ".join(f"{point.arch}: {point.share:.2f} ↑" for point in far)
        # Beside the title: in the panel it would lie on a curve.
        axes.text(1.0, 1.02, text, fontsize=6.5, ha="right", transform=axes.transAxes)


def parts(
    by_domain: Mapping[str, Sequence[Seen]],
    mains: Mapping[str, str],
    rates_hz: Mapping[str, float],
    delays_s: Mapping[str, float | None],
) -> list[Part]:
    """The figure over all domains with what is needed, then each domain's table.

    `mains`, `rates_hz` and `delays_s` are each domain's channel, rate and transport delay.
    """
    said = {n: sentence(n, points, rates_hz[n], delays_s[n]) for n, points in by_domain.items()}
    seen = {point.arch for points in by_domain.values() for point in points}
    first = Part(
        "window",
        f"{headline(by_domain)}Error against how much of the past is seen; a ring marks the "
        "shortest with which it is within 5 % of the least. Of a model that carries a state that "
        "is at most what it needs: its past was cut after a training that never scored so young "
        f"a state. One that sees a window was trained for each length.{choice(seen)}",
        COLUMNS,
        rows([p for points in by_domain.values() for p in points]),
        curves(by_domain, delays_s),
        needed(by_domain),
    )
    return [first] + [
        Part(f"window-{name}", said[name], COLUMNS, rows(points),
             shown=summary(points, mains[name]))
        for name, points in by_domain.items()
    ]  # fmt: skip


def headline(by_domain: Mapping[str, Sequence[Seen]]) -> str:
    """Each domain's shortest past that suffices, of the predictor that errs least."""
    said = []
    for domain, points in by_domain.items():
        found = [need(points, arch) for arch in architectures_of(points)]
        if not found:
            continue
        need_of_best = min(found, key=lambda each: each.least)
        if need_of_best.loses:
            said.append(f"none on {domain}, where nothing beats the present alone")
        elif need_of_best.enough is None:
            said.append(f"no less than all on {domain} ({need_of_best.arch})")
        else:
            most = "at most " if need_of_best.enough.memory == "state" else ""
            said.append(
                f"{most}{need_of_best.enough.past_s:.2g} s on {domain} ({need_of_best.arch})"
            )
    return f"The past that suffices to err least: {'; '.join(said)}. " if said else ""


def rows(points: Sequence[Seen]) -> list[list[Any]]:
    """Every point under `COLUMNS`; the whole past is an empty cell."""
    return [[point.as_json()[name] for name in COLUMNS] for point in points]


def needed(by_domain: Mapping[str, Sequence[Seen]]) -> tuple[list[str], list[list[str]]]:
    """What a computer on board has to keep: one row per domain and architecture."""
    columns = ["domain", "predictor", "past [s]", "samples seen", "kept", "bytes kept", "error",
               "least", "without memory"]  # fmt: skip
    lines = []
    for name, points in by_domain.items():
        for arch in architectures_of(points):
            found = need(points, arch)
            enough = found.enough
            # Only a state is ever carried on from the start, and it is as large as with any past.
            kept_point = enough or next(p for p in points if (p.arch, p.past_s) == (arch, WHOLE))
            errors = (found.error, found.least, found.memoryless)
            past, *kept = _kept(kept_point)
            bound = "at most " if enough is not None and enough.memory == "state" else ""
            lines.append(
                [name, arch, f"{bound}{past}", *kept, *(f"{value:.3f}" for value in errors)]
            )
    return columns, lines


def summary(points: Sequence[Seen], main: str) -> tuple[list[str], list[list[str]]]:
    """One domain's table: mean ± spread over seeds for every past."""
    columns = ["predictor", "past [s]", "samples seen", "kept", "bytes kept", f"RMSE {main}",
               "RMSE / sd", "R²", "R² by seed [90 %]"]  # fmt: skip
    lines = []
    for arch, past in dict.fromkeys((p.arch, p.past_s) for p in points):
        alike = [p for p in points if (p.arch, p.past_s) == (arch, past)]
        lines.append([
            arch,
            *_kept(alike[0]),
            spread([p.rmse for p in alike], ".4g"),
            spread([p.share for p in alike], ".3f"),
            spread([p.r2 for p in alike], ".3f"),
            ", ".join(R2(p.r2, p.r2_low, p.r2_high).text for p in alike),
        ])  # fmt: skip
    return columns, lines


def _kept(point: Seen) -> list[str]:
    """How long a past, of how many samples, what is kept of it, and its bytes."""
    what = {"state": "state", "window": "history"}.get(point.memory, "present")
    past = "whole" if point.samples is None else f"{point.past_s:.3g}"
    return [past, "–" if point.samples is None else f"{point.samples}", what, f"{point.bytes:,}"]
