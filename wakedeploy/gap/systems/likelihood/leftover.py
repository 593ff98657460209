"""What still acts on a system although nothing named explains it: where, how large, how lasting.

In: a `LogModel` and a fit. Out: for each driven rate the lasting push that the filter has to
assume, if it is no small share of the rate; the law that it seems to follow; and what forecasts
would gain by that law. A law is any function of one coordinate, straight between knots, or of one
coordinate and the direction of motion. A push that follows no such law acts like a disturbance.
Laws are sought far ahead: a push that drifts predicts the next reading as well.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Followed, Law, Leftover
from wakedeploy.gap.search.comparison import is_far_ahead
from wakedeploy.gap.search.first_look import Ground, Look, looks
from wakedeploy.gap.search.residual_profiles import ranges
from wakedeploy.gap.search.scan import chance_nats
from wakedeploy.gap.search.weighing import unfitted, weight_of
from wakedeploy.gap.systems.kinds.kind import Scales
from wakedeploy.gap.systems.kinds.library import Effect, custom_kind, not_offered, rate_unit
from wakedeploy.gap.systems.ports import Port

if TYPE_CHECKING:
    from wakedeploy.gap.systems.likelihood.logs import LogModel

_KNOTS, _FEWER_KNOTS = 16, 6  # of a law over a coordinate; of one that has a direction as well
_TURNS = 0.02  # of the usual speed: a direction turns over this range


def leftovers(model: "LogModel", fitted: Fit) -> tuple[Leftover, ...]:
    """Pushes that are no small share of their rate, or whose law improves forecasts; largest first.

    A large one does not matter if no law is evident in it, or if the law surely improves forecasts
    of blocks little; a small one matters if it surely improves them. Above half of the usual rate
    it always matters. If effects were named, only large pushes are asked about.
    """
    large, small = [], []
    for k, name in enumerate(model.driven):
        sd = float(np.exp(fitted.value(f"push.{name}")))
        share = sd / model.sizes[f"d {name}"]
        unit = rate_unit(model.system.states[name])
        lasts_s = float(np.exp(fitted.value(f"lasting.{name}")))
        push = Leftover(
            state=name,
            sd=sd,
            unit=unit,
            lasts_s=lasts_s,
            share=share,
            of_parts=sd / model.sizes[f"parts {name}"],
            matters=True,
            not_offered=not_offered(model.system, name, model.sizes),
            has_port=any(p.role == "force" and p.name == name for p in model.system.ports),
        )
        if share > RULES.push_share and _is_known(fitted, f"push.{name}", share):
            large.append(push.model_copy(update={"against": _followed(model, fitted, k)}))
        elif not fitted.hypothesis:
            small.append(push)
    if not large and not small:
        return ()
    asked, fitted = _refitted(model, fitted)
    pushes = [_asked(asked, fitted, push) for push in large]
    lawful = (_asked(asked, fitted, push) for push in small)
    pushes += [push for push in lawful if _is_gained_by(push)]
    return tuple(sorted(pushes, key=lambda push: -push.share))


def _is_known(fitted: Fit, parameter: str, share: float) -> bool:
    """Whether a push's size is known, or surely large.

    What pushes in a few blocks alone, as a hand does now and then, has a size that blocks hardly
    agree on, and may be most of what acts.
    """
    if fitted.standard_error(parameter) < RULES.push_ln_sd:
        return True
    ln_least = fitted.interval(parameter)[0] - fitted.value(parameter)
    return share * float(np.exp(ln_least)) > RULES.unknown_push


def _refitted(model: "LogModel", fitted: Fit) -> tuple["LogModel", Fit]:
    """The model asked far ahead, where no push replaces a law, and its fit."""
    asked = model.thinned()
    asked = asked.far_ahead() or asked
    if asked is model:
        return model, fitted
    known = dict(zip(fitted.names, fitted.theta, strict=True))
    start = np.array([known[f.name] for f in asked.free(fitted.hypothesis)])
    return asked, settled(asked, fit(asked, fitted.hypothesis, fitted.episodes, start))[0]


def _is_gained_by(push: Leftover) -> bool:
    """Whether a push's law surely improves forecasts, and by enough that something is missing."""
    law = push.law
    return law is not None and law.removes > RULES.unexplained_share and law.low > 0.0


def _asked(model: "LogModel", fitted: Fit, push: Leftover) -> Leftover:
    """A push with the most evident law that it follows, and what the law is worth."""
    laws = _laws(model, push)
    wider = model.with_effects(laws)
    ground = Ground.of(fitted)
    seen = looks(wider, ground, list(laws))
    best = max(seen, key=_merit, default=None)
    law = None
    by_block = is_far_ahead(model)
    if (
        best is not None
        and _merit(best) > chance_nats(ground, seen, fitted, by_block=by_block).nats
    ):
        law = _worth(wider, fitted, best, laws[best.name])
    matters = law is not None and law.high >= RULES.unexplained_share
    if by_block:  # evidence alone says little, as a disturbance shows in many innovations
        matters = matters and law is not None and law.low > 0.0
    matters = matters or push.share > RULES.unknown_push
    return push.model_copy(update={"law": law, "matters": matters})


def _merit(look: Look) -> float:
    """What a law promises [nats], less the gain by chance of each of its knots."""
    return float(look.promised - look.columns[0].shape[1])


def _worth(model: "LogModel", fitted: Fit, look: Look, law: Effect) -> Law:
    """What forecasts gain by a law once it is fitted."""
    hypothesis = (*fitted.hypothesis, law.name)
    start = look.fit.theta if look.fit.objective > fitted.objective else None
    if start is None:
        start = np.append(fitted.theta, [f.neutral for f in law.free])
    after = fit(model, hypothesis, fitted.episodes, start)
    removed = weight_of(*(unfitted(model, f) for f in (fitted, after)))
    by_direction = law.kind.name == _BY_DIRECTION
    return Law(
        coordinate=law.other,
        by_direction=by_direction,
        removes=removed.share,
        low=removed.low,
        high=removed.high,
    )


_BY_DIRECTION = "law-by-direction"


def _laws(model: "LogModel", push: Leftover) -> dict[str, Effect]:
    """Laws over every input and every state that the logs show, without and with a direction."""
    known = [model.coordinates(e) for e in range(model.episodes)]
    moving = model.sizes.get(f"turns {push.state}", 0.0) > 0.0
    laws = {}
    for coordinate in (name for name in known[0] if name != "time"):
        values = np.concatenate([at[coordinate][1] for at in known])
        for by_direction in (False, True) if moving and coordinate != push.state else (False,):
            count = _FEWER_KNOTS if by_direction else _KNOTS
            knots = np.unique(np.nanquantile(values, np.linspace(0.0, 1.0, count)))
            if len(knots) > 1 or by_direction:
                law = _law(model, push, coordinate, knots, by_direction)
                laws[law.name] = law
    return laws


def _law(
    model: "LogModel", push: Leftover, coordinate: str, knots: FloatArray, by_direction: bool
) -> Effect:
    """An effect on a state's rate that is any function of a coordinate, straight between knots.

    Its parameters are the height at the first knot and the change at each further one; where logs
    say nothing, a law goes on as beside it.
    """
    per_step = 1.0 / model.system.rate_hz if model.system.has_step else 1.0
    names = ["first", *(f"added_{k}" for k in range(1, len(knots)))]
    turns = _TURNS * model.sizes[push.state]

    def acting(time_s: Any, state: Any, inputs: Any, p: Any) -> Mapping[str, Any]:
        of = state if coordinate in model.system.states else inputs
        heights = list(itertools.accumulate(getattr(p, name) for name in names))
        total = _straight(getattr(of, coordinate), knots, heights)
        if by_direction:
            total = total * np.tanh(getattr(state, push.state) / turns)
        return {push.state: per_step * total}

    size = model.sizes[f"d {push.state}"]
    kind = _BY_DIRECTION if by_direction else "law"
    name = f"{kind}-over-{coordinate}@{push.state}"
    each = [size, *(len(names) - 1) * [size / len(names) ** 0.5]]  # a random walk
    port = Port.custom(kind, acting, {n: (push.unit, s) for n, s in zip(names, each, strict=True)})
    sizes = {f"own {n}": s for n, s in zip(names, each, strict=True)}
    scales = Scales(sizes, dict.fromkeys(sizes, push.unit))
    return Effect(name, custom_kind(port), port, scales, coordinate)


def _straight(at: Any, knots: FloatArray, heights: Sequence[Any]) -> Any:
    """Straight lines between knots; beyond them the value at the last one."""
    if len(knots) < 2:
        return heights[0] + 0.0 * at
    at = np.clip(at, knots[0], knots[-1])
    total = 0.0 * at
    for k, height in enumerate(heights):
        hat = np.ones_like(at)
        if k > 0:
            hat = np.minimum(hat, (at - knots[k - 1]) / (knots[k] - knots[k - 1]))
        if k + 1 < len(knots):
            hat = np.minimum(hat, (knots[k + 1] - at) / (knots[k + 1] - knots[k]))
        total = total + height * np.maximum(hat, 0.0)
    return total


def _followed(model: "LogModel", fitted: Fit, place: int) -> Followed | None:
    """The coordinate that explains most of a push; None if none explains enough."""
    push, at = _tracked(model, fitted, place)
    best: Followed | None = None
    for name, (unit, values) in at.items():
        bins = ranges(values)
        if name == "time" or len(bins) < 2:
            continue
        means = [float(push[inside].mean()) for _, _, inside in bins]
        counts = np.array([np.count_nonzero(inside) for _, _, inside in bins])
        share = float(counts @ (np.array(means) - push.mean()) ** 2 / counts.sum() / push.var())
        if share > RULES.followed_share and (best is None or share > best.share):
            edges = [bins[0][0], *(high for _, high, _ in bins)]
            best = Followed(coordinate=name, unit=unit, share=share, edges=edges, means=means)
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
