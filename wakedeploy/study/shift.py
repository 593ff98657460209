"""Study 6: models trained on one physics, flown in another.

In: predictors trained where wake speed, diffusivity and separation vary by ±10 % from episode to
episode, and others trained in the nominal physics. Out: how the former track where these vary by
±10, ±50 and ±75 % and whether the order of the models stays; the latter in the nominal physics, as
what it costs to vary it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kendalltau

from wakedeploy.domains.downwash import make_set, shifted
from wakedeploy.episodes import EpisodeSet
from wakedeploy.study.closed_loop import FIRST_SEED, LIMITS, Always, Tracked, recovered, track
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.sets import DOMAINS, SEED, OnStep, obtain

TRAINED = 0.10
FLOWN = (0.10, 0.50, 0.75)
_KEPT = 0.8  # Kendall's τ from which on an order counts as kept: one pair of ten turned


@dataclass(frozen=True, eq=False)
class Crew:
    """Who flies: trained models with their predictors, and the mean force of what they learned."""

    models: Sequence[tuple[str, Sequence[Any]]]
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

    def share(self, name: str) -> float:
        """What a model reaches of the oracle's gain."""
        nothing, oracle, *others = self.lines
        return recovered(next(m for m in others if m.name == name), nothing, oracle).share


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


def agreement(first: Shifted, other: Shifted) -> float:
    """Kendall's τ of the models' orders at two spreads: 1 the same, −1 reversed."""
    errors = {one.name: one.mean_m for one in other.models}
    order = [(one.mean_m, errors[one.name]) for one in first.models]
    return float(kendalltau(*zip(*order, strict=True)).statistic) if len(order) > 1 else 1.0


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
            f"at ±{100 * one.spread:.0f} % it is number {place} of {len(rank)} with "
            f"{100 * one.share(chosen):.0f} %, and the orders agree with τ = "
            f"{agreement(first, one):.2f}"
        )
    text = (
        f"Trained at ±{100 * TRAINED:.0f} %, {chosen}, the best on validation, reaches "
        f"{100 * first.share(chosen):.0f} % of the oracle's gain there "
        f"({100 * nominal.share(chosen):.0f} % where it learned and flies the nominal physics); "
        f"{'; '.join(parts)}."
    )
    kept = all(agreement(first, one) >= _KEPT for one in others)
    verdict = "so it does here" if kept else "here it does not"
    return f"{text}{_memory(told)} In the paper the order stays; {verdict}."


def _memory(told: Sequence[Shifted]) -> str:
    """How the model without memory and the median of those with one fare as physics moves."""
    names = [line.name for line in told[0].models]
    if MEMORYLESS not in names or len(names) < 2:
        return ""
    with_memory = [name for name in names if name != MEMORYLESS]
    shares = [
        f"{100 * float(np.median([one.share(n) for n in with_memory])):.0f} % against "
        f"{100 * one.share(MEMORYLESS):.0f} % at ±{100 * one.spread:.0f} %"
        for one in told
    ]
    return (
        f" Of the oracle's gain the median model with memory reaches, against {MEMORYLESS}: "
        f"{', '.join(shares)}."
    )
