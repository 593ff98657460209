"""The figure, the table and the sentence of the study of basins.

In: where each start ended. Out: final delay over start, R² below it, true delay and alias as lines.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.basin import (
    ALIAS,
    ELSEWHERE,
    TRUE,
    UNHARMED,
    Echo,
    End,
    reference,
    where,
)
from wakedeploy.study.folder import Part
from wakedeploy.study.learned_delays import points
from wakedeploy.study.uncertainty import R2

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = (
    "start_s",
    "seed",
    "delay_s",
    "delay_sd_s",
    "kernel_width_s",
    "kernel_mean_age_s",
    "r2",
    "r2_low",
    "r2_high",
    "validation_loss",
    "r2_behind_reference_low",
    "ended_at",
)
PAPER_TRUE_S, PAPER_ALIAS_S = 0.33, 0.148
_ALIKE_S = 1.0 / 60.0  # a frame of the camera: nearer, delays agree
_COLOURS = {
    TRUE: figures.TRUE,
    ALIAS: figures.PREDICTED,
    UNHARMED: figures.SOURCE,
    ELSEWHERE: figures.LIMIT,
}
_MARKERS = {TRUE: "o", ALIAS: "s", UNHARMED: "D", ELSEWHERE: "^"}


def draw(ends: Sequence[End], echo: Echo) -> "Figure":
    """Final delay and R² over the start; coloured by where a run ended."""
    with figures.style():
        drawn, (upper, lower) = figures.figure(
            2, 1, size=(5.6, 5.4), sharex=True, height_ratios=(3, 2)
        )
        for delay_s, style, name in (
            (echo.true_s, "-", f"true delay, {echo.true_s:.3f} s"),
            (echo.alias_s, "--", f"alias, {echo.alias_s:.3f} s"),
        ):
            upper.axhline(delay_s, color=figures.REFERENCE, linestyle=style, label=name)
            lower.axvline(delay_s, color=figures.REFERENCE, linestyle=style)
        upper.axline((0.0, 0.0), slope=1.0, color=figures.LIMIT, linewidth=0.7, linestyle=":")
        window_s = float(echo.lags_s[-1])
        upper.set_ylim(-0.2 * window_s, 1.2 * window_s)
        for kind in _COLOURS:
            of_kind = [end for end in ends if where(end, echo) == kind]
            if of_kind:
                _points(upper, lower, of_kind, kind)
        upper.set_ylabel("final delay μ [s]; bars: sd over test")
        lower.margins(y=0.12)
        lower.set_ylabel("test R²; bars: 90 %")
        lower.set_xlabel("delay μ₀ at the start of training [s]")
        lower.set_xlim(0.0, window_s)
        figures.legend(upper, ncols=2)
    return drawn


def _points(upper: "Axes", lower: "Axes", ends: Sequence[End], kind: str) -> None:
    starts = [end.start_s for end in ends]
    points(
        upper,
        starts,
        [end.delay_s for end in ends],
        [end.spread_s for end in ends],
        fmt=_MARKERS[kind],
        color=_COLOURS[kind],
        markersize=5,
        label=f"ended {kind}" if kind == ELSEWHERE else f"ended at {kind}",
    )
    # Without an interval the bar has no length.
    low = [end.r2 - (end.r2 if end.r2_low is None else end.r2_low) for end in ends]
    high = [(end.r2 if end.r2_high is None else end.r2_high) - end.r2 for end in ends]
    lower.errorbar(
        starts,
        [end.r2 for end in ends],
        np.maximum([low, high], 0.0),  # a bootstrap's interval may miss what it is drawn from
        fmt=_MARKERS[kind],
        color=_COLOURS[kind],
        markersize=5,
        elinewidth=0.8,
    )


def sentence(ends: Sequence[End], echo: Echo) -> str:
    """How many runs ended where, what it cost, and whether that is what the paper has."""
    by = {kind: [end for end in ends if where(end, echo) == kind] for kind in _COLOURS}
    best = f"{reference(ends).r2:.3f} of the run that did best on validation"
    text = (
        f"On the training block the tip follows the foil after {echo.true_s:.3f} s, with an alias "
        f"at {echo.alias_s:.3f} s; of {len(ends)} runs {len(by[TRUE])} ended at the true delay"
    )
    if by[TRUE]:
        text += f" (R² {_range([end.r2 for end in by[TRUE]])})"
    if by[ALIAS]:
        starts = _range([end.start_s for end in by[ALIAS]])
        text += (
            f", {len(by[ALIAS])} at the alias (R² {_range([end.r2 for end in by[ALIAS]])}, "
            f"clearly below the {best}; started at {starts} s)"
        )
    else:
        text += f" and none at the alias with an R² clearly below the {best}"
    if by[UNHARMED]:
        text += (
            f"; {len(by[UNHARMED])} more ended at the alias without an R² that is clearly lower "
            f"({_range([end.r2 for end in by[UNHARMED]])})"
        )
    if by[ELSEWHERE]:
        text += (
            f"; {len(by[ELSEWHERE])} ended elsewhere or with a delay that varies too much, μ at "
            f"{_range([end.delay_s for end in by[ELSEWHERE]])} s "
            f"(R² {_range([end.r2 for end in by[ELSEWHERE]])})"
        )
    return f"{text}. {_beside_the_paper(by, echo)}"


def _beside_the_paper(by: Mapping[str, Sequence[End]], echo: Echo) -> str:
    """The paper's figure, and for each of its three claims whether it comes out here."""
    alike = {
        f"the true delay, here {echo.true_s:.3f} s": _is_near(echo.true_s, PAPER_TRUE_S),
        f"the alias, here {echo.alias_s:.3f} s": _is_near(echo.alias_s, PAPER_ALIAS_S),
        "the start deciding between the two with an R² that is lower at the alias": bool(
            by[TRUE] and by[ALIAS] and not by[UNHARMED] and not by[ELSEWHERE]
        ),
    }
    agreeing = [what for what, same in alike.items() if same]
    differing = [what for what, same in alike.items() if not same]
    clauses = []
    if agreeing:
        clauses.append(f"agree in {'; '.join(agreeing)}")
    if differing:
        clauses.append(f"do not agree in {'; '.join(differing)}")
    return (
        f"In the paper the start decides whether a run ends at the true delay, {PAPER_TRUE_S:.2f} "
        f"s, or with a lower R² at an alias, {PAPER_ALIAS_S:.3f} s: these runs "
        f"{', and '.join(clauses)}."
    )


def _is_near(value_s: float, paper_s: float) -> bool:
    return abs(value_s - paper_s) < _ALIKE_S


def summary(ends: Sequence[End], echo: Echo) -> tuple[list[str], list[list[str]]]:
    """One line per start: means over its seeds, and where each of them ended."""
    columns = ["start μ₀ [s]", "final μ [s]", "kernel's width σ [s]", "mean age weighed [s]"]
    columns += ["R² [90 %], by seed", "below the reference's R² by at least", "ended at, by seed"]
    rows = []
    for start_s in dict.fromkeys(end.start_s for end in ends):
        from_here = [end for end in ends if end.start_s == start_s]
        rows.append(
            [
                f"{start_s:.3f}",
                _spread([end.delay_s for end in from_here]),
                _spread([end.width_s for end in from_here]),
                _spread([end.mean_age_s for end in from_here]),
                ", ".join(R2(end.r2, end.r2_low, end.r2_high).text for end in from_here),
                _range([end.behind_low for end in from_here]),
                ", ".join(where(end, echo) for end in from_here),
            ]
        )
    return columns, rows


def parts(ends: Sequence[End], echo: Echo) -> list[Part]:
    """The study's one figure and table."""
    rows = [
        (
            *(end.start_s, end.seed, end.delay_s, end.spread_s, end.width_s, end.mean_age_s),
            *(end.r2, end.r2_low, end.r2_high, end.validation, end.behind_low, where(end, echo)),
        )
        for end in ends
    ]
    text = sentence(ends, echo)
    return [Part("basin", text, COLUMNS, rows, draw(ends, echo), summary(ends, echo))]


def _range(values: Sequence[float]) -> str:
    low, high = (f"{round(value, 3) + 0.0:.3f}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _spread(values: Sequence[float]) -> str:
    mean = f"{np.mean(values):.3f}"
    return mean if len(values) < 2 else f"{mean} ± {np.std(values, ddof=1):.3f}"
