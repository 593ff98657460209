"""Charts of `gap power`: sizes that are seen, what ignoring an effect costs, minutes to name it.

In: a `Power`. Out: one chart each, with a row for every effect.
"""

import math

from wakedeploy.core.dot_chart import GREEN, GREY, ORANGE, Dot, DotChart
from wakedeploy.gap.systems.gantry.planning.power import EffectPower, Power
from wakedeploy.gap.wording import minus

_COLOURS = {"named": GREEN, "class": ORANGE, "too small": GREY}
_UNKNOWN = (math.nan, math.nan, math.nan)  # value and ends of a row that has a note alone
_LINEAR_SIZES, _LINEAR_MINUTES = 0.1, 1.0  # beyond, the axes are logarithmic


def sizes_chart(power: Power) -> DotChart:
    """From the size that is detected to the one that is named, in plausible sizes."""
    return DotChart(
        title="Sizes that are detected and named",
        x_label="size over plausible size",
        dots=[_sizes(each) for each in power.effects],
        limit=1.0,
        limit_says="plausible",
        linear=_LINEAR_SIZES,
    )


def cost_chart(power: Power) -> DotChart:
    """What ignoring an effect adds to the tracking error."""
    return DotChart(
        title="What ignoring it costs",
        x_label="added tracking error [mm]",
        dots=[_cost(each) for each in power.effects],
    )


def minutes_chart(power: Power) -> DotChart:
    """How long one flies until an effect is named."""
    planned = power.flights * power.flight_s / 60.0
    return DotChart(
        title="How long until it is named",
        x_label="minutes of flight",
        dots=[_minutes(each) for each in power.effects],
        limit=planned,
        limit_says=f"planned, {planned:.1f} min",
        linear=_LINEAR_MINUTES,
    )


def _sizes(each: EffectPower) -> Dot:
    colour = _COLOURS[each.verdict]
    if each.detectable is None:
        note = "not seen at any size"
        return Dot(each.name, *_UNKNOWN, f"{each.name}: {note}", colour, note=note)
    low = each.detectable / abs(each.size)
    if each.nameable is None:
        says = f"{each.name}: detected from {low:.2g}, never named"
        return Dot(each.name, math.nan, low, low, says, colour, note="never named")
    high = each.nameable / abs(each.size)
    says = f"{each.name}: detected from {low:.2g}, named from {high:.2g} plausible sizes"
    return Dot(each.name, high, low, high, says, colour)


def _cost(each: EffectPower) -> Dot:
    colour = _COLOURS[each.verdict]
    if each.cost_mm is None:
        says = f"{each.name}: ends the flight in a failsafe"
        return Dot(each.name, *_UNKNOWN, says, colour, note="failsafe")
    says = f"{each.name}: {minus(f'{each.cost_mm:+.1f}')} mm"
    return Dot(
        each.name, each.cost_mm, min(0.0, each.cost_mm), max(0.0, each.cost_mm), says, colour
    )


def _minutes(each: EffectPower) -> Dot:
    colour = _COLOURS[each.verdict]
    if each.minutes is None:
        return Dot(each.name, *_UNKNOWN, f"{each.name}: never", colour, note="never")
    says = f"{each.name}: {each.minutes:.1f} minutes"
    return Dot(each.name, each.minutes, 0.0, each.minutes, says, colour)
