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

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.domains.domain import OnStep
from wakedeploy.domains.downwash import make_set, shifted
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
from wakedeploy.study.sets import DOMAINS, SEED, obtain
from wakedeploy.study.uncertainty import FloatArray

TRAINED = 0.10
FLOWN = (0.10, 0.50, 0.75)
KEPT = 0.8  # Kendall's τ that surely lies above it says that an order stays: a tenth is turned


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
    def text(self) -> str:
        """The spread as it is printed."""
        return f"±{100 * self.spread:.0f} %"

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
    """How the models' order at one spread agrees with that at another.

    `tau` is Kendall's: 1 the same, −1 reversed, with a 90 % interval over flights and seeds; it has
    no bounds where there are too few flights. Models that fly alike change places by chance, which
    makes τ small without any meaning. So `apart` counts the pairs, of `pairs`, that the flights
    tell apart at both spreads (at 99 %), and `turned` those of them that change places.
    """

    tau: float
    low: float | None
    high: float | None
    pairs: int
    apart: int
    turned: int

    @property
    def kept(self) -> bool | None:
        """Whether the order stays, None where the flights cannot tell."""
        if self.turned:
            return False
        sure = self.low is not None and self.low >= KEPT
        return True if sure or self.apart == self.pairs else None

    @property
    def text(self) -> str:
        """τ with its interval."""
        if self.low is None or self.high is None:
            return f"{self.tau:.2f}"
        return f"{self.tau:.2f} [{self.low:.2f}, {self.high:.2f}]"


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
    found = []
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
        found.append(Shifted(spread, tuple(lines)))
    return found


def agreement(first: Shifted, other: Shifted) -> Agreement:
    """How the order of the models at one spread agrees with that at another."""
    means = [np.array([[line.mean_m for line in spread.models]]).T for spread in (first, other)]
    tau = float(_kendall(*means)[0])
    pairs = len(first.models) * (len(first.models) - 1) // 2
    drawn = [resampled(spread.models) if spread.models else None for spread in (first, other)]
    if drawn[0] is None or drawn[1] is None:
        return Agreement(tau, None, None, pairs, 0, 0)
    low, high = np.quantile(_kendall(drawn[0], drawn[1]), [0.05, 0.95])
    sure = _clear(drawn[0]) * _clear(drawn[1])
    apart, turned = int(np.sum(sure != 0)), int(np.sum(sure < 0))
    return Agreement(tau, float(low), float(high), pairs, apart, turned)


def _clear(drawn: FloatArray) -> FloatArray:
    """The sign of each pair's difference (pairs,); 0 where the draws (L, D) leave it open."""
    first, second = np.triu_indices(len(drawn), 1)
    low, high = np.quantile(drawn[first] - drawn[second], [0.005, 0.995], axis=1)
    return np.asarray((low > 0.0).astype(float) - (high < 0.0))


def _kendall(order: FloatArray, other: FloatArray) -> FloatArray:
    """τ of two orders of models, draw by draw: (L, D), (L, D) -> (D,); 1 for fewer than two."""
    first, second = np.triu_indices(len(order), 1)
    if len(first) == 0:
        return np.ones(order.shape[1])
    same = np.sign(order[first] - order[second]) * np.sign(other[first] - other[second])
    return np.asarray(same.mean(0))


def sentence(nominal: Shifted, spreads: Sequence[Shifted], chosen: str | None = None) -> str:
    """What the flights say of each spread; `chosen` is the best on validation forces."""
    first, *others = spreads
    if chosen is None or not first.models:
        return f"Flown at {len(spreads)} spreads of the physics."
    parts = []
    for at_spread in others:
        rank = sorted(at_spread.models, key=lambda line: line.mean_m)
        place = [line.name for line in rank].index(chosen) + 1
        parts.append(
            f"at {at_spread.text} it is number {place} of {len(rank)} and {at_spread.share(chosen)}"
        )
    text = (
        f"Trained at {first.text}, {chosen}, the best on validation, {first.share(chosen)} "
        f"there (where it learned and flies the nominal physics, it {nominal.share(chosen)}); "
        f"{'; '.join(parts)}."
    )
    return f"{text} {_order(first, others)}{_memory(spreads)}"


def _order(first: Shifted, others: Sequence[Shifted]) -> str:
    """The paper's claim of the order, with what these flights can say of it."""
    words = {True: "stays", False: "does not stay", None: "is not clear"}
    said = []
    for at_spread in others:
        found = agreement(first, at_spread)
        said.append(
            f"at {at_spread.text} it {words[found.kept]} (Kendall's τ = {found.text}; of the "
            f"{found.apart} of {found.pairs} pairs that the flights separate at both, "
            f"{found.turned} change places)"
        )
    return f"In the paper the order of the models stays: here {'; '.join(said)}."


def _memory(spreads: Sequence[Shifted]) -> str:
    """The paper's claim of memory, spread by spread."""
    found = {at_spread.text: memory(at_spread.models) for at_spread in spreads}
    said = [f"at {at} {effect.text}" for at, effect in found.items() if effect is not None]
    if not said:
        return ""
    return f" In the paper memory helps in flight at every spread: here {'; '.join(said)}."
