"""The part of the account that tells by how much the gap shrank, and what hides that it did.

In: `result.json`, or more (see `steps.Steps.summary`). Out: sentences and numbers in words.
"""

import math
from collections.abc import Mapping
from typing import Any

from wakedeploy.gap.few_flights import cannot_tell, in_words
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.wording import (
    counted,
    entries,
    interval,
    listed,
    mapping,
    measured,
    number,
    percent,
    quantity,
    texts,
    unit_of,
)

FORECAST = "height 0.25 s ahead"  # the channel by which the gap is judged
_HARDLY = 0.98  # of the error before; an error after beyond that asks for an explanation
_LITTLE, _LESS = 0.2, 0.7  # of the gain of what was found; so much a wrong effect may imitate


def gap_channel(result: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """The channel by which the gap is judged, and its numbers; ("", {}) where there is none."""
    channels = mapping(result.get("gap"))
    name = FORECAST if FORECAST in channels else next(iter(channels), "")
    return name, mapping(channels.get(name))


def closed_share(channel: Mapping[str, Any]) -> float:
    """(before² − after²) / (before² − floor²), unless the channel says so itself; or NaN.

    A channel that states none has no gap to speak of: noise alone errs nearly as much as before.
    """
    if "closed" in channel:
        return number(channel["closed"])
    before, after, floor = (number(channel.get(k)) for k in ("before", "after", "noise_floor"))
    possible = before**2 - floor**2
    return (before**2 - after**2) / possible if possible > 0.0 else math.nan


def closed_words(channel: Mapping[str, Any]) -> str:
    """The share closed as a percentage, no more than 100 and no less than 0; "" if unknown.

    The floor is an estimate, too: an error below it closes the gap, not more than the gap.
    """
    share = closed_share(channel)
    return "" if math.isnan(share) else percent(min(max(share, 0.0), 1.0))


def unchanged(channel: Mapping[str, Any]) -> bool:
    """Nothing was added, so that before and after are one model."""
    return number(channel.get("before")) == number(channel.get("after"))


def noise_unknown(result: Mapping[str, Any]) -> bool:
    """Whether something is or may be missing and nothing was added: the fitted noise has it."""
    open_ = result.get("verdict") == "unknown" or cannot_tell(flight_count(result))
    return open_ and unchanged(gap_channel(result)[1])


def flight_count(result: Mapping[str, Any]) -> int:
    """How many flights a result is of, sealed ones included; 0 where it does not say."""
    stated = number(result.get("flights"))
    return len(entries(result.get("logs"))) if math.isnan(stated) else round(stated)


def shrinking(result: Mapping[str, Any]) -> list[str]:
    """The error before and after, and where that says too little of what was found, why."""
    name, channel = gap_channel(result)
    if not channel:
        return []
    if math.isnan(number(channel.get("after"))) or unchanged(channel):
        return [_as_it_is(result)]
    before, after, floor = (gap_value(channel, k) for k in ("before", "after", "noise_floor"))
    members = texts(result.get("as_if"))
    judged = _judged_on(result)
    if members:
        judged = f"If it is {listed(members)}: {judged[0].lower()}{judged[1:]}"
    told = f"{judged}, the error of the {name} goes from {before} to {after}"
    if cannot_tell(flight_count(result)):
        return [f"{told}."]
    hardly = number(channel.get("after")) > _HARDLY * number(channel.get("before"))
    return [
        f"{told}, where noise alone gives {floor}{_closed(channel)}.",
        *(_instead(result) if hardly else []),
    ]


def _as_it_is(result: Mapping[str, Any]) -> str:
    """The error where nothing was added, and what is known of the noise in it."""
    name, channel = gap_channel(result)
    told = f"{_judged_on(result)}, the error of the {name} is {gap_value(channel, 'before')}"
    flights = flight_count(result)
    if cannot_tell(flights):
        return f"{told}; how much of it is noise, {in_words(flights)} cannot tell."
    if noise_unknown(result):
        return f"{told}; how much of it is noise is not known while something is missing."
    return f"{told}; noise alone: {gap_value(channel, 'noise_floor')}."


def _closed(channel: Mapping[str, Any]) -> str:
    """How much of a gap that was judged is closed."""
    share = closed_share(channel)
    if number(channel.get("after")) > number(channel.get("before")):
        return ": the gap did not shrink"
    if share > 1.0:  # the noise that a model expects of itself is an estimate, mostly a high one
        return ": no more is left than noise"
    return "" if math.isnan(share) else f": {closed_words(channel)} of the gap closed"


def _instead(result: Mapping[str, Any]) -> list[str]:
    """Why an error ahead hardly shrinks, and what the likelihood of the same flights says.

    Calibration is fitted before and after: what it imitates leaves the error before as small.
    """
    hiding = [
        f"{one.get('name')} (by {number(one.get('away_sd')):.1f} of its spreads)"
        for one in entries(result.get("hidden_by"))
    ]
    told, against = "Judged by that, what was found hardly shows", ""
    if hiding:
        bent = f"a calibration bent in {listed(hiding)}"
        told = f"Before, {bent} had hidden what was found from this forecast"
        against = "against such a calibration, "
    nats = number(result.get("log_density_gain_nats"))
    if math.isnan(nats):
        return [f"{told}."]
    speaks = f"hardly speaks for it ({nats:.1f} nats)"
    if nats > RULES.speaks_nats:
        speaks = f"speaks for it by {nats:.1f} nats"
    elif nats < 0.0:
        speaks = f"does not speak for it ({quantity(nats, 'nats')})"
    return [f"{told}; {against}the likelihood of the same flights {speaks}."]


def gap_value(channel: Mapping[str, Any], key: str) -> str:
    """A gap with its interval, if it has one: key `before`, `after` or `noise_floor`."""
    return measured(channel.get(key), *interval(channel.get(f"{key}_interval")), unit_of(channel))


def channel_lines(result: Mapping[str, Any]) -> list[str]:
    """Every channel in one line, for a terminal; noise where it is known."""
    lines = []
    for name, channel in mapping(result.get("gap")).items():
        before, after, floor = (
            quantity(mapping(channel).get(k), unit_of(mapping(channel)))
            for k in ("before", "after", "noise_floor")
        )
        change = before if unchanged(mapping(channel)) else f"{before} → {after}"
        noise = "" if noise_unknown(result) else f" (noise {floor})"
        lines.append(f"{name}: {change}{noise}")
    return lines


def _judged_on(result: Mapping[str, Any]) -> str:
    sealed = texts(result.get("sealed"))
    nothing = unchanged(gap_channel(result)[1])
    fitted = "noise and calibration" if nothing else "sizes"
    if result.get("in_sample"):
        flights = "flight" if flight_count(result) == 1 else "flights"
        return f"On the very {flights} that {fitted} were fitted to"
    if result.get("cross_validated"):
        return f"On each flight, with {fitted} fitted to the others"
    if not sealed:
        return "In these flights"
    return f"On {counted(len(sealed), 'flight')} that took no part in finding it"


def placebo(result: Mapping[str, Any]) -> list[str]:
    """Whether a wrong effect helps as well."""
    wrong = mapping(result.get("placebo"))
    if not wrong.get("name") or unchanged(gap_channel(result)[1]):
        return []
    unit = unit_of(wrong)
    change = f"{quantity(wrong.get('before'), unit)} to {quantity(wrong.get('after'), unit)}"
    gains = [number(wrong.get(key)) for key in ("gain_nats", "found_gain_nats")]
    if not math.isnan(sum(gains)):
        change += f"; gain {gains[0]:.1f} nats, of what was found {gains[1]:.1f}"
    start = f"A placebo, the best wrong effect {wrong['name']} in its place,"
    if not wrong.get("helps"):
        return [f"{start} does not help ({change})."]
    if gains[0] < _LITTLE * gains[1]:
        return [f"{start} helps a little ({change}): it imitates a part."]
    if gains[0] < _LESS * gains[1]:
        return [f"{start} helps less ({change}): it imitates much of it."]
    return [
        f"Careful: {start[0].lower()}{start[1:]} helps as well ({change}); "
        "what was found may be no more than a better fit."
    ]
