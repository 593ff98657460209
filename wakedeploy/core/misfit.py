"""Whether a predictor can read an episode set: its channels, their units and its rate."""

from collections.abc import Sequence

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.even_time import RATES_DIFFER
from wakedeploy.core.manifest import Quantity


def misfit(
    observation: Sequence[Quantity], force: Sequence[Quantity], rate_hz: float, data: EpisodeSet
) -> str | None:
    """What keeps a predictor from reading a set, in words; None when nothing does.

    Rates may differ as much as those of the logs of one set: clocks do.
    """
    for kind, wanted, there in (
        ("observation", observation, data.observation),
        ("force", force, data.force),
    ):
        names, given = [(c.name, c.unit) for c in wanted], [(c.name, c.unit) for c in there]
        if names != given:
            return f"its {kind} channels are {_listed(names)}, the set has {_listed(given)}"
    if abs(data.rate_hz / rate_hz - 1.0) > RATES_DIFFER:
        return (
            f"it was trained at {rate_hz:g} Hz, the set is at {data.rate_hz:g} Hz; make the set at"
            f" {rate_hz:g} Hz (of logs: [resample] rate_hz), or train anew"
        )
    return None


def _listed(channels: list[tuple[str, str]]) -> str:
    return ", ".join(f"{name} [{unit}]" for name, unit in channels)
