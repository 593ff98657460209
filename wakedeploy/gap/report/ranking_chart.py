"""The ranking as a chart: the gain of each effect on held-out flights, by round, with intervals.

In: the rounds of a search. Out: one chart for each round in which a gain is known.
"""

import math
from collections.abc import Collection, Sequence

from wakedeploy.core.dot_chart import BLUE, GREY, ORANGE, Dot, DotChart
from wakedeploy.gap.report.tables import ranked
from wakedeploy.gap.systems.gantry.findings import Ranked, Round
from wakedeploy.gap.wording import measured, nats

_FIRST_ROUND, _LATER_ROUNDS = 30, 10  # effects shown
_USUAL_NATS = 10.0  # of an axis, where no threshold says what is much
_LEAST_NATS = 5.0
_OUTGROWN = 8.0  # times that, from which one effect would press the others together

HELD_OUT = "gain in held-out log density over the model so far [nats]"
OF_ONE = "gain in log density over the rig as it is, less a nat per parameter [nats]"


def ranking_charts(
    rounds: Sequence[Round], found: Collection[str], rivals: Collection[str], flights: int = 0
) -> list[DotChart]:
    """The best of each round from the top, and the threshold.

    `found` and `rivals` have a colour of their own; of one flight (`flights`) nothing was held out.
    """
    charts = []
    for at, each in enumerate(round_ for round_ in rounds if ranked(round_.ranking)):
        best = ranked(each.ranking)[: _LATER_ROUNDS if at else _FIRST_ROUND]
        threshold = each.threshold_nats
        charts.append(
            DotChart(
                title=_title(each, len(best)),
                x_label=OF_ONE if flights == 1 else HELD_OUT,
                dots=_dots(best, threshold, found, rivals),
                limit=threshold,
                limit_says=f"threshold, {nats(threshold)}",
                linear=_linear(best, threshold),
            )
        )
    return charts


def _dots(
    best: Sequence[Ranked], threshold: float, found: Collection[str], rivals: Collection[str]
) -> list[Dot]:
    """A class's members count from the round in which the best one passed the threshold."""
    passed = [each.gain_nats >= _needed(each, threshold) for each in best]
    dots = []
    for each, passes in zip(best, passed, strict=True):
        chosen = (passes and each.name in found) or (any(passed) and each.name in rivals)
        colour = ORANGE if chosen else BLUE if passes else GREY
        low, high = each.interval
        gain = measured(each.gain_nats, low, high, "nats")
        if _needed(each, threshold) < threshold:
            gain += f", needs {nats(_needed(each, threshold))}"
        dots.append(
            Dot(each.name, each.gain_nats, low, high, f"{each.name}: {gain}", colour, chosen)
        )
    return dots


def _needed(each: Ranked, threshold: float) -> float:
    """What an effect has to gain: the threshold, or less where it gains in block after block."""
    return threshold if math.isnan(each.needed_nats) else each.needed_nats


def _linear(best: Sequence[Ranked], threshold: float) -> float:
    """How far the axis is linear: all of it, unless one effect outgrows the rest."""
    usual = _USUAL_NATS if math.isnan(threshold) else max(threshold, _LEAST_NATS)
    ends = [abs(end) for each in best for end in (each.gain_nats, *each.interval)]
    largest = max((end for end in ends if not math.isnan(end)), default=0.0)
    return 2.0 * usual if largest > _OUTGROWN * usual else math.inf


def _title(searched: Round, count: int) -> str:
    given = ", ".join(searched.given) or "the model as it is"
    total = len(searched.ranking)
    return f"On top of {given}" + ("" if count == total else f" (best {count} of {total})")
