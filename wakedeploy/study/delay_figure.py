"""The figure, the tables and the sentences of the study of delays.

In: where models look, and how long the wake is on its way. Out: weights over age with the true
delay as a line; learned against physical delays.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.claims import agrees
from wakedeploy.study.delay import (
    ALIKE_S,
    Attended,
    Learned,
    Transport,
    best,
    by_run,
    trend,
)
from wakedeploy.study.folder import Part
from wakedeploy.study.learned_delays import points
from wakedeploy.study.uncertainty import R2

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ATTENTION_COLUMNS = ("domain", "seed", "age_s", "weight")
DELAY_COLUMNS = (
    "domain",
    "setting",
    "seed",
    "start_s",
    "validation_loss",
    "best_start",
    "transport_s",
    "transport_low_s",
    "transport_high_s",
    "source_lag_s",
    "delay_s",
    "delay_sd_s",
    "kernel_width_s",
    "kernel_mean_age_s",
    "outside_window",
    "r2",
    "r2_low",
    "r2_high",
)
PAPER_DOMAIN = "downwash"  # the one whose delays the paper shows
PAPER_TRUE_S, PAPER_PEAK_S, PAPER_SHIFT_S = 0.38, 0.5, 0.12
ALIKE_SLOPE = 0.25
_TITLE_PAD = 44  # points: three rows of a legend fit below
_COLOURS = {"downwash": figures.MEASURED, "gantry": figures.PREDICTED}
_MARKERS = {"downwash": "o", "gantry": "s"}


def draw(looks: Sequence[Attended], lines: Sequence[Learned]) -> "Figure":
    """Left the weights of each domain, right the learned delays."""
    count = len(looks)
    with figures.style():
        drawn, grid = figures.figure(1, count + 1, size=(3.1 * (count + 1), 3.8), squeeze=False)
        for axes, look in zip(grid[0], looks, strict=False):
            _weights(axes, look)
        grid[0, 0].set_ylabel("attention weight / uniform weight")
        _delays(grid[0, -1], lines)
    return drawn


def _weights(axes: "Axes", look: Attended) -> None:
    """Weights in units of what each snapshot would have if all had the same."""
    shares = look.weights * len(look.ages_s)
    colour = _COLOURS.get(look.domain, figures.MEASURED)
    for row in shares if len(shares) > 1 else ():
        axes.plot(look.ages_s, row, color=colour, alpha=0.35, linewidth=0.7)
    axes.plot(look.ages_s, shares.mean(0), ".-", color=colour, markersize=4)
    true = look.transport
    axes.axvspan(true.low_s, true.high_s, color=figures.TRUE, alpha=0.15, linewidth=0)
    axes.axvline(true.mean_s, color=figures.TRUE, label="transport delay")
    if look.source_lag_s:
        late_s = true.mean_s + look.source_lag_s
        axes.axvline(late_s, color=figures.TRUE, linestyle="--", label="and source's lag")
    axes.axhline(1.0, color=figures.LIMIT, linewidth=0.8)
    axes.set_xlim(look.ages_s[0], 0.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("age of the snapshot [s]")
    axes.set_title(f"Cross-Attention, {look.domain}", pad=_TITLE_PAD)
    figures.legend(axes, ncols=1)


def _delays(axes: "Axes", lines: Sequence[Learned]) -> None:
    """Learned against physical delays with the line on which they would be equal."""
    longest_s = 1.15 * max(line.transport.mean_s for line in lines)
    axes.set_xlim(0.0, longest_s)
    axes.set_ylim(-0.15 * longest_s, 1.25 * longest_s)
    for domain in dict.fromkeys(line.domain for line in lines):
        every = [line for line in lines if line.domain == domain]
        chosen = best(every)
        colour, marker = _COLOURS.get(domain, figures.MEASURED), _MARKERS.get(domain, "o")
        physical_s = [line.transport.mean_s for line in chosen]
        points(
            axes,
            physical_s,
            [line.delay_s for line in chosen],
            [line.spread_s for line in chosen],
            rotation=90.0,
            fmt=marker,
            color=colour,
            markersize=4,
            label=f"{domain}, μ",
        )
        _other_starts(axes, every, chosen, colour)
        ages_s = [line.mean_age_s for line in chosen]
        hollow: Any = {"color": colour, "markerfacecolor": "white", "markersize": 4}
        axes.plot(physical_s, ages_s, marker, **hollow, label=f"{domain}, mean age")
        if chosen[0].source_lag_s:
            late: Any = {"slope": 1.0, "color": figures.TRUE, "linestyle": "--", "linewidth": 0.8}
            axes.axline((0.0, chosen[0].source_lag_s), **late)
    axes.axline((0.0, 0.0), slope=1.0, color=figures.TRUE, linewidth=0.8)
    axes.plot([], [], "x", color=figures.LIMIT, markersize=4, label="the other start's μ")
    axes.plot([], [], ">", color=figures.LIMIT, markersize=5, label="starts μ₀")
    axes.set_xlabel("transport delay [s]")
    axes.set_ylabel("learned delay [s]")
    axes.set_title("Delay Embedding", pad=_TITLE_PAD)
    figures.legend(axes, ncols=2, columnspacing=1.0, handletextpad=0.3)


def _other_starts(
    axes: "Axes", every: Sequence[Learned], chosen: Sequence[Learned], colour: str
) -> None:
    """Where the starts that do worse on validation ended; the starts themselves at the edge."""
    others = [line for line in every if line not in chosen]
    points(
        axes,
        [line.transport.mean_s for line in others],
        [line.delay_s for line in others],
        [0.0] * len(others),
        rotation=90.0,
        fmt="x",
        color=colour,
        markersize=4,
    )
    for start_s in sorted({line.start_s for line in every}):
        axes.plot(0.0, start_s, ">", color=colour, markersize=5, clip_on=False)


def attention_sentence(looks: Sequence[Attended]) -> str:
    """Where Cross-Attention looks, domain by domain, and the paper's figure where it has one."""
    sentences = []
    for look in looks:
        uniform_s = float(np.mean(look.ages_s))
        lag = (
            f", {look.transport.mean_s + look.source_lag_s:.3f} s with the source's lag"
            if look.source_lag_s
            else ""
        )
        sentences.append(
            f"On {look.domain} the wake takes {_interval(look.transport)}{lag}; Cross-Attention "
            f"gives the present {100 * look.present:.0f} % of its weight, beyond it most to the "
            f"snapshot of {_peak(look)} ago, and looks {look.mean_age_s:.3f} s back on "
            f"average ({uniform_s:.3f} s if all weights were equal)."
        )
        if look.domain == PAPER_DOMAIN:
            sentences.append(_attention_in_the_paper(look))
    return " ".join(sentences)


def _peak(look: Attended) -> str:
    """The peak of the mean over the seeds, and between which ages their own lie."""
    low_s, high_s = look.peaks_s[0], look.peaks_s[-1]
    seeds = len(look.peaks_s)
    seeds_range = "" if seeds < 2 else f" ({low_s:.3f} to {high_s:.3f} s over {seeds} seeds)"
    return f"{look.peak_s:.3f} s{seeds_range}"


def _attention_in_the_paper(look: Attended) -> str:
    """The paper's figure of the weights, and whether this one agrees."""
    peak_s = float(look.ages_s[np.argmax(look.mean_weights)])
    share = look.present * len(look.ages_s)  # of the weight that it would have if all were equal
    is_there = abs(peak_s - look.transport.mean_s - PAPER_SHIFT_S) <= ALIKE_S
    return (
        f"In the paper the weights peak {PAPER_PEAK_S:g} s ago, {PAPER_SHIFT_S:g} s longer than "
        f"the transport delay of {PAPER_TRUE_S:g} s, and recent snapshots have next to none: here "
        f"they peak {_age(peak_s)}, {_apart(peak_s - look.transport.mean_s)} than the transport "
        f"delay, which {agrees(is_there)} within {ALIKE_S:g} s, and the present has {share:.1f} "
        f"times the uniform weight, which {agrees(share < 0.5)}."
    )


def delay_sentence(lines: Sequence[Learned]) -> str:
    """How learned delays follow the physical ones, and the paper's figure where it has one."""
    sentences = []
    for domain in dict.fromkeys(line.domain for line in lines):
        every = [line for line in lines if line.domain == domain]
        chosen = best(every)
        found, weighed = trend(chosen), trend(chosen, "mean_age_s")
        outside = float(np.mean([line.outside for line in chosen]))
        lag = (
            f" (the source's lag is {chosen[0].source_lag_s:.3f} s)"
            if chosen[0].source_lag_s
            else ""
        )
        sentences.append(
            f"On {domain} Delay Embedding's delay μ grows by {_two(found.slope)} s a second of "
            f"transport delay and is {_apart(found.off_s)} on average{lag}; {100 * outside:.0f} % "
            f"of all μ lie outside the window. The mean age of what its kernels weigh grows by "
            f"{_two(weighed.slope)} s and is {_apart(weighed.off_s)}."
        )
        sentences.append(_starts(every))
        if domain == PAPER_DOMAIN:
            sentences.append(_delay_in_the_paper(chosen))
    return " ".join(sentences)


def _starts(lines: Sequence[Learned]) -> str:
    """Where training began, which start did better, and whether the ends are one."""
    starts_s = sorted({line.start_s for line in lines})
    runs, chosen = by_run(lines), best(lines)
    better = ", ".join(
        f"{sum(line.start_s == start_s for line in chosen)} from {start_s:.3f} s"
        for start_s in starts_s
    )
    apart_s = [max(x.delay_s for x in starts) - min(x.delay_s for x in starts) for starts in runs]
    alike = sum(value <= ALIKE_S for value in apart_s)
    alone = ", ".join(
        f"from {start_s:.3f} s alone {_apart(trend(begun).off_s)} (slopes of μ and of the mean "
        f"age {_two(trend(begun).slope)} and {_two(trend(begun, 'mean_age_s').slope)})"
        for start_s in starts_s
        if (begun := [line for line in lines if line.start_s == start_s])
    )
    text = (
        f"Training began at μ₀ = {' and '.join(f'{s:.3f}' for s in starts_s)} s whatever the "
        f"transport delay; the start that does better on validation counts ({better}). On average "
        f"μ ends {alone} than the transport delay. From all starts it ends within {ALIKE_S:g} s in "
        f"{alike} of {len(runs)} cases, {np.mean(apart_s):.3f} s apart on average"
    )
    if lines[0].domain == PAPER_DOMAIN:
        text += (
            "; in the paper it ends at the physical delay wherever it starts, which "
            f"{agrees(alike == len(runs) and _at_the_delay(lines))}"
        )
    return f"{text}."


def _at_the_delay(lines: Sequence[Learned]) -> bool:
    """Whether every run ended at the physical delay, or at the paper's shift from it or between."""
    off_s = [line.delay_s - line.transport.mean_s for line in lines]
    return all(-ALIKE_S <= value <= PAPER_SHIFT_S + ALIKE_S for value in off_s)


def _delay_in_the_paper(lines: Sequence[Learned]) -> str:
    """The paper's figure of learned over physical delays, and whether this one agrees."""
    follows = abs((slope := trend(lines).slope) - 1.0) <= ALIKE_SLOPE
    settings = dict.fromkeys(line.setting for line in lines)
    apart_s = [trend([line for line in lines if line.setting == s]).off_s for s in settings]
    alike = sum(abs(off_s - PAPER_SHIFT_S) <= ALIKE_S for off_s in apart_s)
    offsets = ", ".join(f"{off_s:+.2f}".replace("-", "−") for off_s in apart_s)
    return (
        f"In the paper μ is {PAPER_SHIFT_S:g} s longer than the transport delay at all five "
        f"separations, which is a slope of 1: here it is longer by {offsets} s, within "
        f"{ALIKE_S:g} s of that at {alike} of {len(apart_s)}, which "
        f"{agrees(alike == len(apart_s))}, with a slope of {_two(slope)}, which "
        f"{agrees(follows)} within {ALIKE_SLOPE:g}."
    )


def attention_summary(looks: Sequence[Attended]) -> tuple[list[str], list[list[str]]]:
    """One line per domain."""
    columns = ["domain", "transport delay [s], 5 % to 95 %", "and source's lag [s]"]
    columns += ["weight of the present", "peak beyond it [s]", "over the seeds [s]"]
    columns += ["mean age [s]"]
    rows = [
        [
            look.domain,
            _interval(look.transport, unit=""),
            f"{look.transport.mean_s + look.source_lag_s:.3f}",
            f"{look.present:.3f}",
            f"{look.peak_s:.3f}",
            f"{look.peaks_s[0]:.3f} to {look.peaks_s[-1]:.3f}",
            f"{look.mean_age_s:.3f}",
        ]
        for look in looks
    ]
    return columns, rows


def delay_summary(lines: Sequence[Learned]) -> tuple[list[str], list[list[str]]]:
    """One line per setting: of the better starts, means over the seeds; then all starts' ends."""
    columns = ["domain", "setting", "transport delay [s], 5 % to 95 %", "learned μ [s]"]
    columns += ["μ over samples, sd [s]", "kernel's width σ [s]", "mean age weighed [s]"]
    columns += ["μ outside the window", "R², by seed [90 %]", "start → end of μ [s], by seed"]
    rows = []
    for domain, setting in dict.fromkeys((line.domain, line.setting) for line in lines):
        every = [line for line in lines if (line.domain, line.setting) == (domain, setting)]
        chosen = best(every)
        delays = [line.delay_s for line in chosen]
        spread = f" ± {np.std(delays, ddof=1):.3f}" if len(chosen) > 1 else ""
        row = [domain, setting, _interval(chosen[0].transport, unit="")]
        row.append(f"{np.mean(delays):.3f}{spread}")
        for name in ("spread_s", "width_s", "mean_age_s", "outside"):
            row.append(f"{np.mean([getattr(line, name) for line in chosen]):.3f}")
        row.append(", ".join(R2(line.r2, line.r2_low, line.r2_high).text for line in chosen))
        row.append(", ".join(f"{line.start_s:.3f} → {line.delay_s:.3f}" for line in every))
        rows.append(row)
    return columns, rows


def parts(looks: Sequence[Attended], lines: Sequence[Learned]) -> list[Part]:
    """The figure with the attention's table, then the delays' table."""
    attention_rows = [
        (look.domain, seed, float(age_s), float(weight))
        for look in looks
        for seed, row in enumerate(look.weights)
        for age_s, weight in zip(look.ages_s, row, strict=True)
    ]
    first = Part(
        "delay",
        attention_sentence(looks),
        ATTENTION_COLUMNS,
        attention_rows,
        draw(looks, lines),
        attention_summary(looks),
    )
    chosen = best(lines)
    delay_rows: list[list[Any]] = [
        [
            *(line.domain, line.setting, line.seed, line.start_s, line.validation),
            int(line in chosen),
            *(line.transport.mean_s, line.transport.low_s, line.transport.high_s),
            *(line.source_lag_s, line.delay_s, line.spread_s, line.width_s, line.mean_age_s),
            *(line.outside, line.r2, line.r2_low, line.r2_high),
        ]
        for line in lines
    ]
    text = delay_sentence(lines)
    second = Part("delay-embedding", text, DELAY_COLUMNS, delay_rows, shown=delay_summary(lines))
    return [first, second]


def _interval(true: Transport, unit: str = " s") -> str:
    return f"{true.mean_s:.3f}{unit} [{true.low_s:.3f}, {true.high_s:.3f}]"


def _age(age_s: float) -> str:
    return "at the present" if age_s == 0.0 else f"{age_s:.3f} s ago"


def _apart(off_s: float) -> str:
    return f"{abs(off_s):.3f} s {'longer' if off_s >= 0.0 else 'shorter'}"


def _two(value: float) -> str:
    """Two decimals, without the sign of a zero."""
    return f"{round(value, 2) + 0.0:.2f}"
