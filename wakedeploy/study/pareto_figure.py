"""The figure and the tables of the study of costs.

In: points of all domains, and by domain and name the errors of what learns nothing. Out: two panels
per domain, error against parameters and against the step's time, the fronts as steps, an observer
as a line across.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.domains import MEMORYLESS, ZERO
from wakedeploy.study.folder import Part
from wakedeploy.study.pareto import (
    Cost,
    Point,
    by_flash,
    by_instructions,
    by_parameters,
    by_ram,
    by_step,
    front,
    sentence,
)
from wakedeploy.study.runs import choice

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COSTS: tuple[tuple[str, Cost], ...] = (
    ("trainable parameters", by_parameters),
    ("p99 of a step, paced at 32 Hz [ms]", by_step),
)
CHIP_COSTS: tuple[tuple[str, Cost], ...] = (
    ("flash for the weights of its C [kB]", by_flash),
    ("RAM of its C [kB]", by_ram),
    ("instructions of a step of its C [10³]", by_instructions),
)
CHIP_COLUMNS = (
    "domain",
    "predictor",
    "error",
    "flash_bytes",
    "ram_bytes",
    "instructions",
    "front_of_flash",
    "front_of_ram",
    "front_of_instructions",
)
Unlearned = Mapping[str, float]  # error of what learns nothing, by its name
Box = tuple[float, float, float, float]  # left, bottom, right, top, in points
_LETTER = 3.7  # a letter's width at the names' size, in points
COLUMNS = (
    "domain",
    "predictor",
    "hyper",
    "seeds",
    "error",
    "spread",
    "trainable",
    "frozen",
    "step_p99_ms",
    "step_p99_ms_loudest",
    "front_of_parameters",
    "front_of_step",
)


def panels(
    by_domain: Mapping[str, Sequence[Point]],
    beside: Mapping[str, Unlearned],
    costs: Sequence[tuple[str, Cost]] = COSTS,
) -> "Figure":
    """Error against the costs, a row of panels per domain; of two costs two domains abreast."""
    across = min(len(by_domain), 2) if len(costs) == 2 else 1
    down = -(-len(by_domain) // across)
    size = (3.3 * len(costs) * across, 0.3 + 2.9 * down)
    with figures.style():
        drawn, grid = figures.figure(down, len(costs) * across, size=size, squeeze=False)
        pairs = grid.reshape(-1, len(costs))
        for pair, (domain, points) in zip(pairs, by_domain.items(), strict=False):
            for axes, (label, cost) in zip(pair, costs, strict=True):
                _panel(axes, points, cost, beside[domain])
                axes.set_xlabel(label)
            pair[0].set_title(domain)
            pair[0].set_ylabel("RMSE / standard deviation")
        for axes in pairs[len(by_domain) :].flat:
            axes.set_axis_off()
        drawn.draw_without_rendering()  # sizes are known after it
        for pair, points in zip(pairs, by_domain.values(), strict=False):
            for axes, (_, cost) in zip(pair, costs, strict=True):
                _labels(axes, points, cost)
    return drawn


def _panel(axes: "Axes", points: Sequence[Point], cost: Cost, beside: Unlearned) -> None:
    best = front(points, cost)
    across = {name: error for name, error in beside.items() if name != ZERO}
    axes.set_xscale("log")
    axes.set_yscale("log")
    for point in points:
        plain = point.arch == MEMORYLESS
        least, most = cost(point)
        axes.errorbar(
            least,
            point.error,
            point.spread,
            [[0.0], [most - least]],
            fmt="s" if plain else "o",
            color=figures.LIMIT if plain else figures.PREDICTED,
            markerfacecolor=None if point in best else "white",
            markersize=5,
            elinewidth=0.8,
        )
    axes.step(
        [cost(p)[0] for p in best],
        [p.error for p in best],
        where="post",
        color=figures.REFERENCE,
        linewidth=0.9,
        zorder=1,
    )
    for name, error in across.items():
        axes.axhline(error, color=figures.MEASURED, linestyle=":", linewidth=1.0, zorder=1)
        axes.set_title(f"····· {name}", loc="right", fontsize=6.5, color=figures.MEASURED)
    axes.margins(x=0.22, y=0.15)
    costs = [at for p in points for at in cost(p)]
    if max(costs) < 1.2 * min(costs):  # of one point, say, no margin is a share
        axes.set_autoscalex_on(False)
        axes.set_xlim(min(costs) / 3.0, 3.0 * max(costs))
        costs += axes.get_xlim()
    _plain_ticks(axes, costs, [*(p.error for p in points), *across.values()])


def _plain_ticks(axes: "Axes", costs: Sequence[float], errors: Sequence[float]) -> None:
    """Numbers as one says them, and some even where an axis spans less than a decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

    for axis, values in ((axes.xaxis, costs), (axes.yaxis, errors)):
        decades = max(values) / min(values)
        subs: tuple[float, ...] = (1.0, 2.0, 5.0) if decades < 10 else (1.0, 3.0)
        if decades > 50:
            subs = (1.0,)
        if decades < 3:
            subs = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
        is_narrow = decades < 1.5  # such ticks would be one, or none
        axis.set_major_locator(MaxNLocator(4) if is_narrow else LogLocator(subs=subs))
        if is_narrow:
            axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.6g}"))
        axis.set_minor_formatter(NullFormatter())


def _labels(axes: "Axes", points: Sequence[Point], cost: Cost) -> None:
    """Each name beside its point, where it covers neither a point nor another name."""
    from matplotlib.patheffects import withStroke

    scale = 72.0 / axes.figure.dpi
    ends = [[(of, p.error) for of in cost(p)] for p in points]  # of each bar
    at = scale * axes.transData.transform(np.reshape(ends, (-1, 2))).reshape(-1, 2, 2)  # in points
    (left_edge, _), (right_edge, _) = scale * axes.transAxes.transform([(0.0, 0.0), (1.0, 0.0)])
    taken: list[Box] = [(x - 3.0, y - 3.0, far + 3.0, y + 3.0) for (x, y), (far, _) in at]
    for point, bar, ((x, y), (far, _)) in zip(points, ends, at, strict=True):
        plain = point.arch == MEMORYLESS
        text = f"{point.arch} (no memory)" if plain else point.arch
        wide = _LETTER * len(text)
        over = min(max((x + far - wide) / 2, left_edge + 1.0), right_edge - wide - 1.0)
        heights = sorted(range(-40, 41, 2), key=abs)
        tried = [
            (start, dy, (start, y + dy - 3.5, start + wide, y + dy + 3.5))
            for starts in ((far + 6, x - 6 - wide), (over,))  # beside the bar, else above or below
            for dy in heights
            for start in starts
        ]
        tried.sort(key=lambda label: not _is_within(label[2], left_edge, right_edge))
        free = (label for label in tried if not any(_overlap(label[2], other) for other in taken))
        start, dy, box = next(free, tried[0])
        taken.append(box)
        end, ha = (0, "right") if start < x - wide else (1, "left")
        axes.annotate(
            text,
            bar[end],
            xytext=(start - far if end else start + wide - x, dy),
            textcoords="offset points",
            ha=ha,
            va="center",
            fontsize=6.5,
            path_effects=[withStroke(linewidth=1.5, foreground="white")],
            in_layout=False,
            arrowprops={"arrowstyle": "-", "lw": 0.4, "color": figures.LIMIT}
            if dy and start != over
            else None,
        )


def _is_within(box: Box, left_edge: float, right_edge: float) -> bool:
    return left_edge < box[0] and box[2] < right_edge


def _overlap(box: Box, other: Box) -> bool:
    return box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]


def parts(by_domain: Mapping[str, Sequence[Point]], beside: Mapping[str, Unlearned]) -> list[Part]:
    """The study's figure over all domains, then each domain's table."""
    named = {point.arch for points in by_domain.values() for point in points}
    first = Part(
        "pareto",
        f"{headline(by_domain)}Error against trainable parameters and against the step's time in "
        "the loop, of the quietest round with a bar to the loudest; filled points on the line are "
        f"beaten by none in both, where bars that overlap are no different.{choice(named)}",
        COLUMNS,
        [row for name, points in by_domain.items() for row in rows(points, beside[name])],
        panels(by_domain, beside),
        (
            ["domain", "what it says"],
            [[name, sentence(name, points)] for name, points in by_domain.items()],
        ),
    )
    return [first, *on_a_chip(by_domain, beside)] + [
        Part(
            f"pareto-{name}",
            sentence(name, points),
            COLUMNS,
            rows(points, beside[name]),
            shown=summary(points, beside[name]),
        )
        for name, points in by_domain.items()
    ]


def on_a_chip(
    by_domain: Mapping[str, Sequence[Point]], beside: Mapping[str, Unlearned]
) -> list[Part]:
    """Error against what each takes as C on a microcontroller, where that is known."""
    if not all(point.flash_bytes for points in by_domain.values() for point in points):
        return []
    return [
        Part(
            "pareto-chip",
            "Error against what a step takes as C on a microcontroller: bytes are counted, without"
            " the code's few kilobytes; instructions are estimated for a Cortex-M4F. Filled points"
            " on the line are beaten by none in both.",
            CHIP_COLUMNS,
            [row for points in by_domain.values() for row in _chip_rows(points)],
            panels(by_domain, beside, CHIP_COSTS),
        )
    ]


def _chip_rows(points: Sequence[Point]) -> list[list[Any]]:
    """Every point under `CHIP_COLUMNS`."""
    fronts = [front(points, cost) for _, cost in CHIP_COSTS]
    return [
        [
            *(point.domain, point.arch, point.error),
            *(point.flash_bytes, point.ram_bytes, point.instructions),
            *(int(point in best) for best in fronts),
        ]
        for point in points
    ]


def headline(by_domain: Mapping[str, Sequence[Point]]) -> str:
    """Who is unbeaten in error and step time on the most domains."""
    unbeaten = [p.arch for points in by_domain.values() for p in front(points, by_step)]
    if not unbeaten:
        return ""
    times = {arch: unbeaten.count(arch) for arch in dict.fromkeys(unbeaten)}
    most = max(times.values())
    names = " and ".join(arch for arch, count in times.items() if count == most)
    return (
        f"In {most} of {len(by_domain)} domains nothing beats {names} in both error and step time. "
    )


def rows(points: Sequence[Point], beside: Unlearned) -> list[list[Any]]:
    """What learns nothing and every point under `COLUMNS`."""
    fronts = [front(points, cost) for _, cost in COSTS]
    nothing = [""] * (len(COLUMNS) - 5)
    domain = points[0].domain
    unlearned = [[domain, name, "", "", error, *nothing] for name, error in beside.items()]
    return unlearned + [
        [
            point.domain,
            point.arch,
            "; ".join(dict.fromkeys(point.hyper)),
            len(point.errors),
            point.error,
            point.spread,
            point.trainable,
            point.frozen,
            *by_step(point),
            *(int(point in best) for best in fronts),
        ]
        for point in points
    ]


def summary(points: Sequence[Point], beside: Unlearned) -> tuple[list[str], list[list[str]]]:
    """One domain's table: what learns nothing, then the smallest error first; ● marks a front.

    The step's p99 is given for the quietest round and for the loudest.
    """
    columns = ["predictor", "error", "parameters", "front", "step p99 [ms]", "front"]
    weights, steps = (front(points, cost) for _, cost in COSTS)
    rows = [[name, f"{error:.3g}", "", "", "", ""] for name, error in beside.items()]
    for point in sorted(points, key=lambda p: p.error):
        name = f"{point.arch} (no memory)" if point.arch == MEMORYLESS else point.arch
        spread = "" if point.spread is None else f" ± {point.spread:.1g}"
        frozen = f" (and {point.frozen:,} frozen)" if point.frozen else ""
        rows.append(
            [
                name,
                f"{point.error:.3g}{spread}",
                f"{point.trainable:,}{frozen}",
                "●" if point in weights else "",
                "{:.3f} to {:.3f}".format(*by_step(point)),
                "●" if point in steps else "",
            ]
        )
    return columns, rows
