"""The figure and the tables of the study of the lead.

In: points of both domains. Out: force error and tracking error against the lead, domain by domain,
between the limits.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.colours import looks
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.folder import Part
from wakedeploy.study.lead import NOTHING, TRUTH, Point, best, models, sentence, shares, tracking
from wakedeploy.study.runs import choice
from wakedeploy.study.uncertainty import R2, spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = (
    "domain",
    "predictor",
    "lead_s",
    "seed",
    "hyper",
    "rmse_n",
    "rmse_low_n",
    "rmse_high_n",
    "sd_n",
    "r2",
    "r2_low",
    "r2_high",
    "scored",
    "tracking_rms_m",
    "failsafes",
)
PER_FLIGHT = ("domain", "predictor", "lead_s", "seed", "flight", "tracking_rms_m")


def curves(by_domain: Mapping[str, Sequence[Point]]) -> "Figure":
    """Force error above, tracking below, against the lead [s]; a column for each domain."""
    with figures.style():
        across = len(by_domain)
        size = (3.4 * across, 5.2)
        drawn, grid = figures.figure(2, across, size=size, squeeze=False, sharex=True)
        for (above, below), (domain, points) in zip(grid.T, by_domain.items(), strict=True):
            _forces(above, points)
            _tracks(below, points)
            above.set_title(domain)
            below.set_xlabel("lead [s]")
        grid[0, 0].set_ylabel("force RMSE / standard deviation")
        grid[1, 0].set_ylabel("tracking error, rms [mm]")
        figures.legend_above(drawn, grid, 3)
    return drawn


def _forces(axes: "Axes", points: Sequence[Point]) -> None:
    for name, (colour, marker, line) in _styles(points).items():
        by_lead = shares(points, name)
        mean, deviation = (
            [np.mean(v) for v in by_lead.values()],
            [np.std(v) for v in by_lead.values()],
        )
        axes.errorbar(list(by_lead), mean, deviation, color=colour, linestyle=line, marker=marker,
                      markersize=4, elinewidth=0.8, label=name)  # fmt: skip
    axes.set_ylim(bottom=0.0)


def _tracks(axes: "Axes", points: Sequence[Point]) -> None:
    """Every model's mean with its spread over seeds; a ring where it is best."""
    limits = {TRUTH: (figures.TRUE, "*", "-")}
    for name, (colour, marker, line) in (_styles(points) | limits).items():
        flown = [p for p in points if p.predictor == name]
        leads = sorted({p.lead_s for p in flown if p.lead_s is not None})
        at = [[p for p in flown if p.lead_s == lead_s] for lead_s in leads]
        mean = [_mm(same) for same in at]
        deviation = [float(np.std(seeds)) if (seeds := _each_mm(same)) else 0.0 for same in at]
        axes.errorbar(leads, mean, deviation, color=colour, linestyle=line, marker=marker,
                      markersize=4, elinewidth=0.8, label=name)  # fmt: skip
        early = [i for i, same in enumerate(at) if not all(p.whole for p in same)]
        if early:
            axes.plot([leads[i] for i in early], [mean[i] for i in early], "x", markersize=9,
                      color=figures.REFERENCE, label="flights ended early")  # fmt: skip
        found = best(points, name)
        if found is not None:
            axes.plot(found.lead_s, 1e3 * found.tracking_m, "o", markersize=8,
                      markerfacecolor="none", color=colour, label="_nolegend_")  # fmt: skip
    nothing_mm = _mm([p for p in points if p.predictor == NOTHING])
    axes.axhline(nothing_mm, color=figures.REFERENCE, linestyle=":", label=NOTHING)
    axes.set_ylim(bottom=0.0)


def _mm(points: Sequence[Point]) -> float:
    """Tracking in millimetres, NaN (which is not drawn) where nothing was flown."""
    tracked_m = tracking(points)
    return float("nan") if tracked_m is None else 1e3 * tracked_m


def _each_mm(points: Sequence[Point]) -> list[float]:
    """Tracking of each seed in millimetres, of those that flew."""
    return [1e3 * value for p in points if (value := tracking([p])) is not None]


def _styles(points: Sequence[Point]) -> dict[str, tuple[str, str, str]]:
    """Colour, marker and line of each model, the memoryless one broken."""
    return {
        name: (*look, "--" if name == MEMORYLESS else "-")
        for name, look in looks(models(points)).items()
    }


def _r2(points: Sequence[Point]) -> str:
    """Each seed's R² of the force with its interval; limits have none."""
    texts = [R2(p.r2, p.r2_low, p.r2_high).text for p in points if p.r2 is not None]
    return ", ".join(texts) or "–"


def headline(by_domain: Mapping[str, Sequence[Point]]) -> str:
    """Who tracks best on each domain, at which lead, and the same without one."""
    said = []
    for domain, points in by_domain.items():
        found = {name: best(points, name) for name in models(points)}
        flown = {name: lead for name, lead in found.items() if lead is not None}
        if not flown:
            continue
        name = min(flown, key=lambda each: flown[each].tracking_m)
        lead = flown[name]
        zero = "" if lead.at_zero_m is None else f" instead of {1e3 * lead.at_zero_m:.1f}"
        said.append(
            f"on {domain} {name} {1e3 * lead.lead_s:.0f} ms ahead, {1e3 * lead.tracking_m:.1f} mm"
            f"{zero if lead.lead_s else ''}"
        )
    return f"What tracks best: {'; '.join(said)}. " if said else ""


def parts(by_domain: Mapping[str, Sequence[Point]]) -> list[Part]:
    """The figure with each domain's sentence, each domain's table, and every flight."""
    said = {domain: sentence(domain, points) for domain, points in by_domain.items()}
    every = [p for points in by_domain.values() for p in points]
    first = Part(
        "lead",
        f"{headline(by_domain)}Force error and tracking error against how far ahead the force is "
        f"predicted; rings mark each line's best lead.{choice({p.predictor for p in every})}",
        COLUMNS,
        rows(every),
        curves(by_domain),
        (["domain", "what it says"], [[domain, text] for domain, text in said.items()]),
    )
    tables = [
        Part(f"lead-{domain}", said[domain], COLUMNS, rows(points), shown=summary(points))
        for domain, points in by_domain.items()
    ]
    flights = [
        [p.domain, p.predictor, p.lead_s, p.seed, flight, value]
        for p in every
        for flight, value in enumerate(p.tracking_m)
    ]
    shown = ["flights", "lines"], [[f"{len(flights)}", f"{len(every)}"]]
    last = Part("lead-flights", "Every flight is in lead-flights.csv.", PER_FLIGHT, flights,
                shown=shown)  # fmt: skip
    return [first, *tables, last]


def rows(points: Sequence[Point]) -> list[list[Any]]:
    """Every point under `COLUMNS`."""
    return [
        [
            *(p.domain, p.predictor, p.lead_s, p.seed, p.hyper),
            *(p.rmse, p.rmse_low, p.rmse_high, p.sd, p.r2, p.r2_low, p.r2_high),
            *(p.scored, tracking([p]), p.failsafes),
        ]
        for p in points
    ]


def summary(points: Sequence[Point]) -> tuple[list[str], list[list[str]]]:
    """One domain's table: mean ± spread over seeds, at each lead."""
    columns = ["predictor", "lead [ms]", "force RMSE / sd", "R² by seed [90 %]"]
    columns += ["tracking rms [mm]", "failsafes"]
    lines = []
    for name, lead_s in dict.fromkeys((p.predictor, p.lead_s) for p in points):
        alike = [p for p in points if (p.predictor, p.lead_s) == (name, lead_s)]
        errors = shares(alike, name).get(lead_s, []) if lead_s is not None else []
        lines.append([
            name,
            "–" if lead_s is None else f"{1e3 * lead_s:.0f}",
            spread(errors, ".3f") if errors else "–",
            _r2(alike),
            spread(_each_mm(alike), ".2f") if _each_mm(alike) else "–",
            f"{sum(p.failsafes for p in alike)}",
        ])  # fmt: skip
    return columns, lines
