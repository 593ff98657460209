"""Study 6: models trained on one physics, flown in another.

In: predictors trained where wake speed, diffusivity and separation vary by ±10 % from episode to
episode, and others trained in the nominal physics. Out: how the former track where these vary by
±10, ±50 and ±75 % and whether the order of the models stays; the latter in the nominal physics, as
what it costs to vary it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wakedeploy.domains.downwash import make_set, shifted
from wakedeploy.episodes import EpisodeSet
from wakedeploy.study.closed_loop import (
    FIRST_SEED,
    LIMITS,
    Always,
    Model,
    Tracked,
    memory,
    resampled,
    share_text,
    track,
)
from wakedeploy.study.sets import DOMAINS, SEED, OnStep, obtain
from wakedeploy.study.uncertainty import FloatArray

TRAINED = 0.10
FLOWN = (0.10, 0.50, 0.75)
KEPT = 0.8  # Kendall's τ from which on an order counts as kept: one pair of ten turned


@dataclass(frozen=True, eq=False)
class Crew:
    """Who flies: trained models with their predictors, and the mean force of what they learned."""

    models: Sequence[Model]
    constant: Always


@dataclass(frozen=True, eq=False)
class Shifted:
    """How all flew where the physics varies by `spread` (a share) from flight to flight."""

    spread: float
    lines: tuple[Tracked, ...]

    @property
    def models(self) -> tuple[Tracked, ...]:
        """The lines of trained models."""
        return self.lines[len(LIMITS) :]

    def share(self, name: str) -> str:
        """What a model reaches of the oracle's gain, in words."""
        nothing, oracle, *others = self.lines
        return share_text(next(m for m in others if m.name == name), nothing, oracle)


@dataclass(frozen=True)
class Agreement:
    """Kendall's τ of the models' orders at two spreads: 1 the same, −1 reversed.

    With a 90 % interval over flights and seeds; without bounds where there are too few flights.
    Models that fly alike change places by chance: where the interval holds `KEPT`, the flights
    cannot tell whether the order stays.
    """

    value: float
    low: float | None
    high: float | None

    @property
    def kept(self) -> bool | None:
        """Whether the order stays, None where the flights cannot tell."""
        if self.low is None or self.high is None or self.low < KEPT <= self.high:
            return None
        return self.low >= KEPT

    @property
    def text(self) -> str:
        """τ with its interval."""
        if self.low is None or self.high is None:
            return f"{self.value:.2f}"
        return f"{self.value:.2f} [{self.low:.2f}, {self.high:.2f}]"


def spread_set(folder: Path, *, quick: bool, progress: OnStep) -> EpisodeSet:
    """Flights in physics that vary by ±10 %, made once and kept in `folder`.

    Raises UnusableInput for a set there that would now be another.
    """
    name = f"downwash-{100 * TRAINED:.0f}-per-cent"
    domain = replace(DOMAINS["downwash"], name=name, make=_varied, settings=str(TRAINED))
    made = obtain(domain, folder, None, quick=quick, progress=progress)
    assert made is not None  # it has a `make`
    return made


def _varied(minutes: float, progress: OnStep) -> EpisodeSet:
    return make_set(minutes=minutes, seed=SEED, spread=TRAINED, progress=progress)


def fly_shifted(
    crews: Mapping[float, Crew],
    episodes: int,
    seconds: float,
    *,
    on_flight: Callable[[], None] = lambda: None,
) -> list[Shifted]:
    """Each spread's crew in physics that varies by it: same seeds, same stretch of the references.

    Physics is drawn in the same direction at every spread, only farther.
    """
    seeds = [FIRST_SEED + i for i in range(episodes)]
    worlds = {spread: shifted(seeds, spread) for spread in crews}
    settling_s = max(world.settling_s for world in worlds.values())
    told = []
    for spread, crew in crews.items():
        lines = track(
            crew.models,
            episodes,
            seconds,
            constant=crew.constant,
            world=worlds[spread],
            settling_s=settling_s,
            on_flight=on_flight,
        )
        told.append(Shifted(spread, tuple(lines)))
    return told


def agreement(first: Shifted, other: Shifted) -> Agreement:
    """How the order of the models at one spread agrees with that at another."""
    pairs = [np.array([[line.mean_m for line in one.models]]).T for one in (first, other)]
    value = float(_kendall(*pairs)[0])
    drawn = [resampled(one.models) if one.models else None for one in (first, other)]
    if drawn[0] is None or drawn[1] is None:
        return Agreement(value, None, None)
    low, high = np.quantile(_kendall(drawn[0], drawn[1]), [0.05, 0.95])
    return Agreement(value, float(low), float(high))


def _kendall(one: FloatArray, other: FloatArray) -> FloatArray:
    """τ of two orders of models, draw by draw: (L, D), (L, D) -> (D,); 1 for fewer than two."""
    first, second = np.triu_indices(len(one), 1)
    if len(first) == 0:
        return np.ones(one.shape[1])
    same = np.sign(one[first] - one[second]) * np.sign(other[first] - other[second])
    return np.asarray(same.mean(0))


def sentence(nominal: Shifted, told: Sequence[Shifted], chosen: str | None = None) -> str:
    """What the flights say of each spread; `chosen` is the best on validation forces."""
    first, *others = told
    if chosen is None or not first.models:
        return f"Flown at {len(told)} spreads of the physics."
    parts = []
    for one in others:
        rank = sorted(one.models, key=lambda line: line.mean_m)
        place = [line.name for line in rank].index(chosen) + 1
        parts.append(
            f"at {_spread(one)} it is number {place} of {len(rank)} and {one.share(chosen)}, and "
            f"the orders agree with τ = {agreement(first, one).text}"
        )
    text = (
        f"Trained at {_spread(first)}, {chosen}, the best on validation, {first.share(chosen)} "
        f"there (where it learned and flies the nominal physics, it {nominal.share(chosen)}); "
        f"{'; '.join(parts)}."
    )
    return f"{text} {_order(first, others)}{_memory(told)}"


def _order(first: Shifted, others: Sequence[Shifted]) -> str:
    """The paper's claim of the order, with what these flights can say of it."""
    kept = {_spread(one): agreement(first, one).kept for one in others}
    turned = [at for at, stays in kept.items() if stays is False]
    unsure = [at for at, stays in kept.items() if stays is None]
    if turned:
        here = f"here it does not at {' and '.join(turned)}"
    elif unsure:
        here = f"here these flights cannot tell at {' and '.join(unsure)}: models that fly alike"
        here += " change places by chance"
    else:
        here = "so it does here"
    return f"In the paper the order of the models stays (τ of at least {KEPT:g}); {here}."


def _memory(told: Sequence[Shifted]) -> str:
    """The paper's claim of memory, spread by spread."""
    found = {_spread(one): memory(one.models) for one in told}
    said = [f"at {at} {one.text}" for at, one in found.items() if one is not None]
    if not said:
        return ""
    return f" In the paper memory helps in flight at every spread: here {'; '.join(said)}."


def _spread(one: Shifted) -> str:
    return f"±{100 * one.spread:.0f} %"
