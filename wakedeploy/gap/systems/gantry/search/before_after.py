"""The gap before and after, on flights that nothing was fitted to.

If there are too few flights to seal any, each is shown with the sizes from the others.

In: what was found and the flights to show. Out: `show.json`: errors per channel with intervals and
the noise floor, errors per place, whiteness of the rest, and a placebo: the wrong effect of the
same number of parameters that gains most, which must not help.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wakedeploy.gap.evidence.fits import NO_SLOPES, Fit, Hypothesis, Slopes
from wakedeploy.gap.evidence.inference import applied, fit
from wakedeploy.gap.evidence.whiteness import samples, spectrum, whiteness
from wakedeploy.gap.few_flights import cannot_tell
from wakedeploy.gap.search.artefacts import Place, White, WhitePair
from wakedeploy.gap.search.places import Residuals, bin_means, block_length, blocks_of
from wakedeploy.gap.systems.gantry import artefacts
from wakedeploy.gap.systems.gantry.artefacts import Profile, Show, Traces
from wakedeploy.gap.systems.gantry.effect_force import mean_ends
from wakedeploy.gap.systems.gantry.findings import Bent, Gap, Placebo
from wakedeploy.gap.systems.gantry.flight import Flight, FloatArray
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.residuals import (
    AHEAD_S,
    CHANNELS,
    COORDINATES,
    residuals,
)
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.answer import bent
from wakedeploy.gap.systems.gantry.search.naming import without_effects
from wakedeploy.gap.systems.gantry.search.places import AXES, HORIZONS_S
from wakedeploy.gap.systems.gantry.search.refitting import refitted
from wakedeploy.gap.systems.gantry.search.saved_fits import Found, Tried
from wakedeploy.physics.effects import LIBRARY

_BLOCK_S = 2.0
_BINS = 8
_TRACE_S = 10.0
_MOST_MAPS = 6


@dataclass(frozen=True, eq=False)
class Shown:
    """Flights under a hypothesis, around the motion that it explains.

    `by_flight` are the fits that give each flight its parameters; if there are several, none is
    fitted to its own flight. `fit` has all flights' scores.
    """

    model: GantryModel
    fit: Fit
    by_flight: tuple[Fit, ...]

    @classmethod
    def of(cls, model: GantryModel, fitted: Fit) -> "Shown":
        """Sealed flights scored under a fit's parameters; nothing is fitted to them.

        It begins around the motion of `model`, which is best that of something simpler.
        """
        near = model.around_own_motion(fitted)
        return cls(near, applied(near, fitted), (fitted,) * near.episodes)

    @classmethod
    def left_out(cls, model: GantryModel, fits: Sequence[Fit]) -> "Shown":
        """Each flight under the fit to the others; (E,) fits of one hypothesis."""
        each = [cls.of(model.only([i]), fitted) for i, fitted in enumerate(fits)]
        near = GantryModel(model.rig, [shown.model.flights[0] for shown in each], model.extra)
        scores = tuple(shown.fit.slopes.scores[0] for shown in each)
        density = np.concatenate([shown.fit.per_episode for shown in each])
        episodes = tuple(range(len(fits)))
        joined = replace(
            each[0].fit, episodes=episodes, slopes=Slopes(scores, (), ()), per_episode=density
        )
        return cls(near, joined, tuple(fits))


def show(
    found: Found,
    corrected: Fit | None,
    sealed: Sequence[Flight],
    places: Sequence[Place],
    *,
    members: Sequence[str] = (),
    whiteness_limit: float,
    in_sample: bool = False,
) -> Show:
    """`show.json`, without the predictors of `retrain`.

    `corrected` is the fit whose effects the corrected rig file has (None: nothing was added);
    `members` is the class that was named, if any. `in_sample` says that none is sealed, so that the
    flights shown are the fitted ones: each is then left out in turn, unless it is the only one.
    There is then no placebo: beside an effect that cannot be confirmed it would confirm nothing.
    """
    crossed = in_sample and len(sealed) > 1
    few = in_sample and cannot_tell(len(sealed))
    begin = _line(GantryModel(found.model.rig, sealed, found.model.extra), found.base)
    before = under(begin, found.base_model, found.base, crossed)
    after = before
    if corrected is not None:
        after = under(before.model, found.model, corrected, crossed)
    gain = _log_density(after) - _log_density(before)

    def white(shown: Shown) -> White:
        return White(**whiteness(shown.fit).as_json(whiteness_limit))

    return Show(
        shown_on=[flight.name for flight in sealed],
        sealed=[] if in_sample else [flight.name for flight in sealed],
        in_sample=in_sample and not crossed,
        cross_validated=crossed,
        gap=gaps(before, after),
        places=[_by_place(before, after, *here) for here in _maps_of(places)[:_MOST_MAPS]],
        placebo=None
        if few
        else _placebo(found, after.fit.hypothesis, members, before, gain, crossed),
        white=WhitePair(before=white(before), after=white(after)),
        spectrum=artefacts.SpectrumPair(before=_spectrum(before), after=_spectrum(after)),
        traces=_traces(before, after),
        log_density_gain_nats=gain,
        hidden_by=[] if corrected is None else _hiding(found.base, corrected),
    )


def under(flights: GantryModel, fitted_in: GantryModel, fitted: Fit, crossed: bool) -> Shown:
    """The flights under a fit, or (`crossed`) each under the fit to the others."""
    if not crossed:
        return Shown.of(flights, fitted)
    others = [[j for j in range(flights.episodes) if j != i] for i in range(flights.episodes)]
    fits = [fit(fitted_in, fitted.hypothesis, some, fitted.theta) for some in others]
    return Shown.left_out(flights, fits)


def _hiding(base: Fit, corrected: Fit) -> list[Bent]:
    """Constants that are bent far without an effect, but not with it, or that it replaces."""
    still = {constant.name for constant in bent(corrected)}
    return [constant for constant in bent(base) if constant.name not in still]


def gaps(before: Shown, after: Shown) -> dict[str, Gap]:
    """Root mean square errors ahead, before and after, with 90 % intervals and the noise floor.

    The floor is the error that the corrected model expects of itself: range noise and turbulence.
    """
    table = {}
    for horizon_s in HORIZONS_S:
        old, new = _errors(before, horizon_s), _errors(after, horizon_s)
        b, a = _rms(old), _rms(new)
        # Noise alone errs no more than any model; the fitted noise may expect more of itself.
        floor = min(_expected(after, horizon_s), a, b)
        table[f"height {horizon_s:g} s ahead"] = Gap(
            before=b,
            after=a,
            noise_floor=floor,
            unit="m",
            before_interval=_rms_interval(old),
            after_interval=_rms_interval(new),
            closed=closed_share(b, a, floor),
        )
    return table


def closed_share(before: float, after: float, floor: float) -> float:
    """(before² − after²) / (before² − floor²); NaN if noise alone errs nearly as much."""
    excess = before**2 - floor**2
    return (before**2 - after**2) / excess if excess > 0.02 * floor**2 else math.nan


def _errors(shown: Shown, horizon_s: float) -> list[FloatArray]:
    """Errors in blocks of two seconds, over all sealed flights."""
    blocks = []
    for episode in range(shown.model.episodes):
        ahead = shown.model.forecasts(shown.by_flight[episode], episode, (horizon_s,))
        error = ahead.measured_m[0] - ahead.forecast_m[0]
        number = np.floor((ahead.at_s - ahead.at_s[0]) / _BLOCK_S)
        known = np.isfinite(error)
        usual = float(np.median(np.abs(error[known]))) if known.any() else 0.0
        known &= np.abs(np.nan_to_num(error)) < RULES.stray * 1.4826 * usual
        blocks += [error[known & (number == n)] for n in np.unique(number)]
    return [b for b in blocks if len(b)]


def _rms(blocks: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(blocks)) ** 2)))


def _rms_interval(blocks: Sequence[FloatArray]) -> tuple[float, float]:
    """Student's 90 % interval of the mean square, from blocks."""
    low, high = mean_ends(np.array([float((b**2).mean()) for b in blocks]))
    return float(np.sqrt(low)), float(np.sqrt(high))


def _expected(shown: Shown, horizon_s: float) -> float:
    variance = [
        shown.model.forecasts(shown.by_flight[i], i, (horizon_s,)).variance_m2[0]
        for i in range(shown.model.episodes)
    ]
    return float(np.sqrt(np.nanmean(np.concatenate(variance))))


def _by_place(before: Shown, after: Shown, channel: str, coordinate: str) -> Profile:
    """Mean residual in bins of one coordinate, before and after, each with its 90 % reach."""
    old, new = (
        [residuals(shown.model, each, channel, i) for i, each in enumerate(shown.by_flight)]
        for shown in (before, after)
    )
    where = np.concatenate([s.coordinates[coordinate] for s in old])
    edges = np.unique(np.quantile(where[np.isfinite(where)], np.linspace(0.0, 1.0, _BINS + 1)))
    was, was_reach = _binned(old, coordinate, edges)
    now, now_reach = _binned(new, coordinate, edges)
    return Profile(
        channel=channel,
        coordinate=coordinate,
        coordinate_unit=COORDINATES[coordinate][0],
        edges=edges.tolist(),
        before=was,
        before_reach=was_reach,
        after=now,
        after_reach=now_reach,
        unit=CHANNELS[channel],
    )


def _line(model: GantryModel, base: Fit) -> GantryModel:
    """Flights around the motion that a base explains without the rig file's own effects."""
    if not model.rig.effect:
        return model
    bare = GantryModel(without_effects(model.rig), model.flights, model.extra)
    known = dict(zip(base.names, base.theta, strict=True))
    free = bare.free(())
    theta = np.array([known.get(f.name, f.neutral) for f in free])
    plain = Fit((), free, (), theta, NO_SLOPES, np.zeros(0))
    return GantryModel(model.rig, bare.around_own_motion(plain).flights, model.extra)


def _maps_of(places: Sequence[Place]) -> list[tuple[str, str]]:
    """The channel and coordinate of each place, every map once; "everywhere" counts as height."""
    maps = [(place.channel, place.coordinate) for place in places]
    return list(
        dict.fromkeys(
            (channel, name if name in COORDINATES else "height")
            for channel, name in maps
            if channel in CHANNELS
        )
    )


def _binned(
    series: Sequence[Residuals], name: str, edges: FloatArray
) -> tuple[list[float], list[float]]:
    """Means per bin, and their 90 % reach; neighbours in time err alike."""
    where = np.concatenate([s.coordinates[name] for s in series])
    value = np.concatenate([s.value for s in series])
    known = np.isfinite(where) & np.isfinite(value)
    bins = np.clip(np.digitize(where, edges[1:-1]), 0, max(len(edges) - 2, 0))
    bins = np.where(known, bins, -1)
    blocks = blocks_of(series, block_length(series, AXES))
    means, errors, _ = bin_means(value, bins, blocks, len(edges) - 1)
    return means.tolist(), (1.645 * errors).tolist()


def _placebo(
    found: Found,
    hypothesis: Hypothesis,
    members: Sequence[str],
    before: Shown,
    found_nats: float,
    crossed: bool,
) -> Placebo | None:
    """The best wrong effect in place of what was found, fitted and shown the same way.

    None if there is none.
    """
    wrong = wrong_effects(found.tried, hypothesis, members)
    if not wrong:
        return None
    chosen = wrong[0]
    shown = under(before.model, *refitted(found.base_model, chosen.fit), crossed)
    gain = _log_density(shown) - _log_density(before)
    return Placebo(
        name=chosen.name,
        before=_rms(_errors(before, AHEAD_S)),
        after=_rms(_errors(shown, AHEAD_S)),
        after_interval=_rms_interval(_errors(shown, AHEAD_S)),
        unit="m",
        gain_nats=gain,
        found_gain_nats=found_nats,
        helps=bool(gain > RULES.speaks_nats),
    )


def wrong_effects(
    tried: Sequence[Tried], hypothesis: Hypothesis, members: Sequence[str] = ()
) -> list[Tried]:
    """The first search's effects that can be told from what was found, in its order.

    Left out are those of the hypothesis and the class, and those confused with one of these,
    whichever of the two names the other. Those that the fit used are kept, if any: an effect fitted
    to nothing could not help. Of these, those with as many parameters are kept, if any.
    """
    claimed = {*hypothesis, *members}
    known = [LIBRARY[n] for n in claimed if n in LIBRARY]
    related = {r for effect in known for r in effect.confused_with}
    related |= {n for n, effect in LIBRARY.items() if claimed & set(effect.confused_with)}
    others = [t for t in tried if t.name not in claimed | related]
    others = [t for t in others if t.fitted_gain > RULES.used_nats] or others
    wanted = sum(len(LIBRARY[n].parameters) for n in hypothesis if n in LIBRARY) or 1
    return [t for t in others if len(LIBRARY[t.name].parameters) == min(wanted, 2)] or others


def _log_density(shown: Shown) -> float:
    return float(shown.fit.per_episode.sum())


def _spectrum(shown: Shown) -> artefacts.Spectrum:
    rate_hz = 1.0 / shown.model.flights[0].spacing_s
    white = [samples(s)[0] for s in shown.fit.slopes.scores]
    return artefacts.Spectrum(**spectrum(white, rate_hz))


def _traces(before: Shown, after: Shown) -> Traces:
    """Forecasts a quarter of a second ahead along part of the first sealed flight."""
    old = before.model.forecasts(before.by_flight[0], 0, (AHEAD_S,))
    new = after.model.forecasts(after.by_flight[0], 0, (AHEAD_S,))
    chosen = old.at_s < old.at_s[0] + _TRACE_S
    chosen &= np.isfinite(old.forecast_m[0]) & np.isfinite(new.forecast_m[0])
    return Traces(
        t_s=(old.at_s[chosen] + AHEAD_S - old.at_s[0]).tolist(),
        measured_m=old.measured_m[0][chosen].tolist(),
        before_m=old.forecast_m[0][chosen].tolist(),
        after_m=new.forecast_m[0][chosen].tolist(),
    )
