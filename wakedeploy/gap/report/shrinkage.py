"""The part of the account that says by how much the gap shrank, and what hides that it did.

In: the summary of a folder. Out: sentences and numbers in words.
"""

import math
from collections.abc import Mapping

from wakedeploy.gap.few_flights import cannot_tell, in_words
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.systems.gantry.artefacts import Summary
from wakedeploy.gap.systems.gantry.findings import Gap
from wakedeploy.gap.wording import counted, listed, measured, minus, nats, percent, quantity

FORECAST = "height 0.25 s ahead"  # the channel by which the gap is judged
_HARDLY = 0.98  # of the error before; an error after beyond that asks for an explanation
_LITTLE, _LESS = 0.2, 0.7  # of the gain of what was found; so much a wrong effect may imitate


def gap_channel(summary: Summary) -> tuple[str, Gap | None]:
    """The channel by which the gap is judged, and its numbers; ("", None) where there is none."""
    name = FORECAST if FORECAST in summary.gap else next(iter(summary.gap), "")
    return name, summary.gap.get(name)


def closed_words(channel: Gap) -> str:
    """The share closed as a percentage, no more than 100 and no less than 0; "" if unknown.

    The floor is an estimate, too: an error below it closes the gap, not more than the gap.
    """
    share = channel.closed
    return "" if math.isnan(share) else percent(min(max(share, 0.0), 1.0))


def unchanged(channel: Gap | None) -> bool:
    """Nothing was added, so that before and after are one model."""
    return channel is not None and channel.before == channel.after


def noise_unknown(summary: Summary) -> bool:
    """Whether something is or may be missing and nothing was added: the fitted noise has it."""
    open_ = summary.verdict == "unknown" or cannot_tell(flight_count(summary))
    return open_ and unchanged(gap_channel(summary)[1])


def flight_count(summary: Summary) -> int:
    """How many flights a result is of, sealed ones included; 0 where it does not say."""
    return summary.flights or len(summary.logs)


def shrinking(summary: Summary) -> list[str]:
    """The error before and after, and where that says too little of what was found, why."""
    name, channel = gap_channel(summary)
    if channel is None:
        return []
    if math.isnan(channel.after) or unchanged(channel):
        return [_as_it_is(summary, name, channel)]
    before, after, floor = gap_values(channel)
    judged = _judged_on(summary)
    if summary.as_if:
        judged = f"If it is {listed(summary.as_if)}: {judged[0].lower()}{judged[1:]}"
    sentence = f"{judged}, the error of the {name} goes from {before} to {after}"
    if cannot_tell(flight_count(summary)):
        return [f"{sentence}."]
    hardly = channel.after > _HARDLY * channel.before
    return [
        f"{sentence}, where noise alone gives {floor}{_closed(channel)}.",
        *(_instead(summary) if hardly else []),
    ]


def _as_it_is(summary: Summary, name: str, channel: Gap) -> str:
    """The error where nothing was added, and what is known of the noise in it."""
    before, _, floor = gap_values(channel)
    sentence = f"{_judged_on(summary)}, the error of the {name} is {before}"
    flights = flight_count(summary)
    if cannot_tell(flights):
        return f"{sentence}; how much of it is noise, {in_words(flights)} cannot tell."
    if noise_unknown(summary):
        return f"{sentence}; how much of it is noise is not known while something is missing."
    return f"{sentence}; noise alone: {floor}."


def _closed(channel: Gap) -> str:
    """How much of a gap that was judged is closed."""
    if channel.after > channel.before:
        return ": the gap did not shrink"
    if channel.closed > 1.0:  # the noise that a model expects of itself is an estimate, mostly high
        return ": no more is left than noise"
    return "" if math.isnan(channel.closed) else f": {closed_words(channel)} of the gap closed"


def _instead(summary: Summary) -> list[str]:
    """Why an error ahead hardly shrinks, and what the likelihood of the same flights says.

    Calibration is fitted before and after: what it imitates leaves the error before as small.
    """
    hiding = [f"{each.name} (by {each.away_sd:.1f} of its spreads)" for each in summary.hidden_by]
    sentence, against = "Judged by that, what was found hardly shows", ""
    if hiding:
        bent = f"a calibration bent in {listed(hiding)}"
        sentence = f"Before, {bent} had hidden what was found from this forecast"
        against = "against such a calibration, "
    gain = summary.log_density_gain_nats
    if math.isnan(gain):
        return [f"{sentence}."]
    speaks = f"hardly speaks for it ({nats(gain)})"
    if gain > RULES.speaks_nats:
        speaks = f"speaks for it by {nats(gain)}"
    elif gain < 0.0:
        speaks = f"does not speak for it ({quantity(gain, 'nats')})"
    return [f"{sentence}; {against}the likelihood of the same flights {speaks}."]


def gap_values(channel: Gap) -> tuple[str, str, str]:
    """The error before, after, and what noise alone leaves, with intervals where there are some."""
    return (
        measured(channel.before, *channel.before_interval, channel.unit),
        measured(channel.after, *channel.after_interval, channel.unit),
        quantity(channel.noise_floor, channel.unit),
    )


def channel_lines(summary: Summary) -> list[str]:
    """Every channel in one line, for a terminal; noise where it is known."""
    lines = []
    for name, channel in summary.gap.items():
        before, after, floor = (
            quantity(value, channel.unit)
            for value in (channel.before, channel.after, channel.noise_floor)
        )
        change = before if unchanged(channel) else f"{before} → {after}"
        noise = "" if noise_unknown(summary) else f" (noise {floor})"
        lines.append(f"{name}: {change}{noise}")
    return lines


def without_noise(gap: Mapping[str, Gap]) -> dict[str, Gap]:
    """The channels without what noise alone leaves, where that is not known."""
    unknown = {"noise_floor": math.nan, "closed": math.nan}
    return {name: channel.model_copy(update=unknown) for name, channel in gap.items()}


def _judged_on(summary: Summary) -> str:
    fitted = "noise and calibration" if unchanged(gap_channel(summary)[1]) else "sizes"
    if summary.in_sample:
        flights = "flight" if flight_count(summary) == 1 else "flights"
        return f"On the very {flights} that {fitted} were fitted to"
    if summary.cross_validated:
        return f"On each flight, with {fitted} fitted to the others"
    if not summary.sealed:
        return "In these flights"
    return f"On {counted(len(summary.sealed), 'flight')} that took no part in finding it"


def placebo(summary: Summary) -> list[str]:
    """Whether a wrong effect helps as well."""
    wrong = summary.placebo
    if wrong is None or unchanged(gap_channel(summary)[1]):
        return []
    change = f"{quantity(wrong.before, wrong.unit)} to {quantity(wrong.after, wrong.unit)}"
    gain, found = wrong.gain_nats, wrong.found_gain_nats
    if not math.isnan(gain + found):
        change += f"; gain {nats(gain)}, of what was found {minus(f'{found:.1f}')}"
    start = f"A placebo, the best wrong effect {wrong.name} in its place,"
    if not wrong.helps:
        return [f"{start} does not help ({change})."]
    if gain < _LITTLE * found:
        return [f"{start} helps a little ({change}): it imitates a part."]
    if gain < _LESS * found:
        return [f"{start} helps less ({change}): it imitates much of it."]
    return [
        f"Careful: {start[0].lower()}{start[1:]} helps as well ({change}); "
        "what was found may be no more than a better fit."
    ]
