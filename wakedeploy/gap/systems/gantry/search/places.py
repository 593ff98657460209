"""Where a rig's flights and its file disagree: maps, places, whiteness, and the replay's errors.

In: a gantry's model and its fitted base. Out: `find.json` without its header.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.whiteness import samples, spectrum, whiteness
from wakedeploy.gap.few_flights import cannot_tell, these
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Map, Place, Quantity, White
from wakedeploy.gap.search.places import INNOVATION, Axes, disagreements, forbids_none
from wakedeploy.gap.systems.gantry.artefacts import Find, Replay, Spectrum
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.residuals import CHANNELS, COORDINATES, residuals
from wakedeploy.gap.wording import counted

HORIZONS_S = (0.25, 0.5, 1.0)
# A block is at least four times as long as the channel's own window correlates what it measures.
AXES = Axes(
    CHANNELS,
    COORDINATES,
    {"force": 3.0, "control effort": 4.0, "height 0.25 s ahead": 3.0, INNOVATION: 2.0},
)


def find_places(
    model: GantryModel, base: Fit, limit: float, least: Mapping[str, float] | None = None
) -> Find:
    """`find.json` without its header: maps, places, whiteness (`limit`), spectrum, replay, floor.

    A place counts from the size `least` of its channel on: this much the model's own approximations
    leave on this rig when nothing is missing (see `threshold`).
    """
    limits = dict(least or {})
    series = {
        channel: [residuals(model, base, channel, i) for i in range(model.episodes)]
        for channel in CHANNELS
    }
    maps, places = disagreements(series, AXES, limits)
    white = [samples(score)[0] for score in base.slopes.scores]
    rest = whiteness(base)
    return Find(
        white=White(**rest.as_json(limit)),
        places=places,
        maps=maps,
        spectrum=Spectrum(**spectrum(white, 1.0 / model.flights[0].spacing_s)),
        replay=[_replay(model, base, h) for h in HORIZONS_S],
        noise_floor=_noise_floors(maps),
        least_residual={c: Quantity(value=v, unit=CHANNELS[c]) for c, v in limits.items()},
        sentence=places_sentence(places, rest.passes(limit), model.episodes),
    )


def _noise_floors(maps: Sequence[Map]) -> dict[str, Quantity]:
    """What noise alone puts into a bin of a channel's maps: the median reach of 90 % intervals."""
    reaches: dict[str, list[float]] = {}
    for m in maps:
        reach = 0.5 * (np.array(m.high) - np.array(m.low))
        reaches.setdefault(m.channel, []).extend(reach.tolist())
    return {
        channel: Quantity(value=float(np.median(each)), unit=CHANNELS[channel])
        for channel, each in reaches.items()
    }


def _replay(model: GantryModel, base: Fit, horizon_s: float) -> Replay:
    errors, expected = [], []
    for episode in range(model.episodes):
        ahead = model.forecasts(base, episode, (horizon_s,))
        errors.append(ahead.measured_m[0] - ahead.forecast_m[0])
        expected.append(ahead.variance_m2[0])
    error, variance = np.concatenate(errors), np.concatenate(expected)
    known = np.isfinite(error) & np.isfinite(variance)
    typical = np.abs(error[known]) < 6.0 * np.median(np.abs(error[known]))
    return Replay(
        horizon_s=horizon_s,
        rmse_m=float(np.sqrt((error[known][typical] ** 2).mean())),
        expected_m=float(np.sqrt(variance[known].mean())),
    )


def places_sentence(places: Sequence[Place], is_white: bool, flights: int) -> str:
    """What the places of `flights` fitted flights say, and no more than a verdict could bear."""
    if not places and is_white:
        sentence = "no place stands out from noise"
    elif not places:
        sentence = "no single place stands out, but as a whole more than noise is left"
    else:
        where = f"in {counted(len(places), 'place')} (q ≤ {RULES.false_discoveries:g})"
        sentence = f"they disagree beyond noise {where}"
        if not forbids_none(places):
            sentence = f"{where} they may disagree, in none so clearly that something is missing"
        sentence += f"; the clearest: {places[0].words}"
    scope = f"in {these(flights)}, " if cannot_tell(flights) else ""
    sentence = scope + sentence
    return f"{sentence[0].upper()}{sentence[1:]}."
