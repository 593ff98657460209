"""What still acts on a system and is explained by nothing named: where, how large, how lasting.

In: a `LogModel` and a fit. Out: for each driven rate the lasting push that the filter has to
assume, if it is no small share of the rate, and the coordinate that it follows most.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.gap.evidence.inference import Fit, FloatArray
from wakedeploy.gap.search.residual_profiles import ranges

if TYPE_CHECKING:
    from wakedeploy.gap.systems.logs import LogModel

LITTLE = 0.05  # of the usual rate: as much as any model's form may be off
_SURE = 0.5  # ln sd: a push whose size is told no better is no finding
_FOLLOWED = 0.1  # share of a push's variance that a coordinate has to tell


@dataclass(frozen=True)
class Leftover:
    """A push on a state's rate: its sd, how long it lasts, and its share of the usual rate.

    `against` says which coordinate it follows most, if any: its name and unit, the share of the
    push's variance that it tells, edges of its ranges and the push's mean in each.
    """

    state: str
    sd: float
    unit: str
    lasts_s: float
    share: float
    against: dict[str, Any] | None = None


def leftovers(model: "LogModel", fitted: Fit) -> tuple[Leftover, ...]:
    """Pushes that are no small share of their rate, the largest share first."""
    found = []
    for k, name in enumerate(model.driven):
        sd = float(np.exp(fitted.value(f"push.{name}")))
        share = sd / model.sizes[f"d {name}"]
        if share > LITTLE and fitted.standard_error(f"push.{name}") < _SURE:
            unit = f"{model.system.states[name]}/s"
            lasts_s = float(np.exp(fitted.value(f"lasting.{name}")))
            against = _followed(model, fitted, k)
            found.append(Leftover(name, sd, unit, lasts_s, share, against))
    return tuple(sorted(found, key=lambda push: -push.share))


def _followed(model: "LogModel", fitted: Fit, place: int) -> dict[str, Any] | None:
    """The coordinate that tells most of a push."""
    push, at = _tracked(model, fitted, place)
    best: dict[str, Any] | None = None
    for name, (unit, values) in at.items():
        bins = ranges(values)
        if name == "time" or len(bins) < 2:
            continue
        means = [float(push[inside].mean()) for _, _, inside in bins]
        counts = np.array([np.count_nonzero(inside) for _, _, inside in bins])
        share = float(counts @ (np.array(means) - push.mean()) ** 2 / counts.sum() / push.var())
        if share > _FOLLOWED and (best is None or share > best["share"]):
            edges = [bins[0][0], *(high for _, high, _ in bins)]
            best = {"coordinate": name, "unit": unit, "share": share}
            best |= {"edges": edges, "means": means}
    return best


def _tracked(
    model: "LogModel", fitted: Fit, place: int
) -> tuple[FloatArray, dict[str, tuple[str, FloatArray]]]:
    """A push as the filter follows it, (n,), and the coordinates of the same samples."""
    run = model.run(fitted.hypothesis, fitted.theta[None], fitted.episodes)
    states = run.states[:, -len(model.driven) + place, 0, :]
    parts: list[FloatArray] = []
    places: dict[str, list[FloatArray]] = {}
    units: dict[str, str] = {}
    for i, episode in enumerate(fitted.episodes):
        coordinates, start = model.coordinates(episode), model.blocks[episode].start
        for s in np.flatnonzero(run.pieces.block == i):
            inside = run.pieces.scored[:, s]
            parts.append(states[inside, s])
            at = run.pieces.sample[inside, s] - start
            for name, (unit, values) in coordinates.items():
                units[name] = unit
                places.setdefault(name, []).append(values[at])
    joined = {name: (units[name], np.concatenate(values)) for name, values in places.items()}
    return np.concatenate(parts), joined
