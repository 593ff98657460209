"""What still acts on a system and is explained by nothing named: where, how large, how lasting.

In: a `LogModel` and a fit. Out: for each driven rate the lasting push that the filter has to
assume, if it is no small share of the rate, the coordinate that it follows most, and what forecasts
would gain if it followed it always. What forecasts gain nothing from is a disturbance, of which no
model can tell more; what they do gain from is a law that nobody has named yet.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.gap.evidence.inference import Fit, FloatArray, fit, settled
from wakedeploy.gap.evidence.ranking import candidate
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.residual_profiles import ranges
from wakedeploy.gap.search.weighing import crossed, weight_of
from wakedeploy.gap.systems.kinds.kind import Scales
from wakedeploy.gap.systems.kinds.library import Effect, custom_kind
from wakedeploy.gap.systems.system import Port

if TYPE_CHECKING:
    from wakedeploy.gap.systems.logs import LogModel

LITTLE = 0.05  # of the usual rate: as much as any model's form may be off
_SURE = 0.5  # ln sd: a push whose size is told no better is no finding
_FOLLOWED = 0.1  # share of a push's variance that a coordinate has to tell
_KNOTS = 5  # of a law over a coordinate


@dataclass(frozen=True)
class Leftover:
    """A push on a state's rate: its sd, how long it lasts, and its share of the usual rate.

    `against` says which coordinate it follows most, if any: its name and unit, the share of the
    push's variance that it tells, edges of its ranges and the push's mean in each. `removes` is the
    share of forecasts' squared error that a law over that coordinate would remove, `matters`
    whether that is enough to say that something unknown is missing, or the push as large as what
    the model knows.
    """

    state: str
    sd: float
    unit: str
    lasts_s: float
    share: float
    against: dict[str, Any] | None = None
    removes: float = 0.0
    matters: bool = False


def leftovers(model: "LogModel", fitted: Fit, chance_nats: float) -> tuple[Leftover, ...]:
    """Pushes that are no small share of their rate, the largest share first.

    A law is believed that gains more than chance brings, and if forecasts of blocks that it was not
    fitted to get better by it.
    """
    found = []
    for k, name in enumerate(model.driven):
        sd = float(np.exp(fitted.value(f"push.{name}")))
        share = sd / model.sizes[f"d {name}"]
        if share > LITTLE and fitted.standard_error(f"push.{name}") < _SURE:
            unit = f"{model.system.states[name]}/s"
            lasts_s = float(np.exp(fitted.value(f"lasting.{name}")))
            against = _followed(model, fitted, k)
            found.append(Leftover(name, sd, unit, lasts_s, share, against))
    asked = [_asked(model, fitted, push, chance_nats) for push in found]
    return tuple(sorted(asked, key=lambda push: -push.share))


def _asked(model: "LogModel", fitted: Fit, push: Leftover, chance_nats: float) -> Leftover:
    """A push with what forecasts would gain by a law over the coordinate that it follows."""
    largely = push.share > RULES.unknown_push
    if push.against is None:
        return replace(push, matters=largely)
    law = _law(model, push)
    part = model.thinned()
    before = fitted
    if part is not model:
        again = fit(part, fitted.hypothesis, fitted.episodes, fitted.theta)
        before = settled(part, again)[0]
    lawful = part.with_effect(law)
    start = np.append(before.theta, [f.neutral for f in law.free])
    after = fit(lawful, (*before.hypothesis, law.name), before.episodes, start)
    if candidate(before, law.name, after).gain_nats <= chance_nats:
        return replace(push, matters=largely)
    removed = weight_of(crossed(part, before), crossed(lawful, after))
    matters = removed.share > RULES.unexplained_share and removed.low > 0.0
    return replace(push, removes=max(removed.share, 0.0), matters=largely or matters)


def _law(model: "LogModel", push: Leftover) -> Effect:
    """An effect on a state's rate that is any function of a coordinate, straight between knots."""
    assert push.against is not None
    coordinate, edges = push.against["coordinate"], push.against["edges"]
    knots = np.quantile(edges, np.linspace(0.0, 1.0, _KNOTS))
    knots = knots[np.insert(np.diff(knots) > 0.0, 0, True)]
    per_step = 1.0 / model.system.rate_hz if model.system.has_step else 1.0
    names = [f"at_{k}" for k in range(len(knots))]

    def acting(time_s: Any, state: Any, inputs: Any, p: Any) -> Mapping[str, Any]:
        of = state if coordinate in model.system.states else inputs
        at = np.clip(getattr(of, coordinate), knots[0], knots[-1])
        total = 0.0 * at
        for k, name in enumerate(names):
            hat = np.ones_like(at)
            if k > 0:
                hat = np.minimum(hat, (at - knots[k - 1]) / (knots[k] - knots[k - 1]))
            if k + 1 < len(knots):
                hat = np.minimum(hat, (knots[k + 1] - at) / (knots[k + 1] - knots[k]))
            total = total + getattr(p, name) * np.maximum(hat, 0.0)
        return {push.state: per_step * total}

    size = model.sizes[f"d {push.state}"]
    port = Port.custom(
        f"law-over-{coordinate}@{push.state}", acting, dict.fromkeys(names, (push.unit, size))
    )
    own = {f"own {name}": size for name in names}
    scales = Scales(own, dict.fromkeys(own, push.unit))
    return Effect(port.name, custom_kind(port), port, scales)


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
