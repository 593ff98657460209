"""A sparse expression for a force that no effect of the library explains.

In: a model, and a fit of it that leaves something over. Out: at most a few terms of `gap.terms`,
chosen one after another by what they gain on episodes that they were not fitted to, refitted
together, with those dropped that are no longer needed; as text with units, and as an effect that a
rig file can hold.

Trying a term takes one finite difference per parameter: how far it would improve the fit follows
from the slopes, everything else readjusted (a score test; Rao 1948). Only the most promising are
fitted.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wakedeploy import rig
from wakedeploy.gap.inference import (
    Candidate,
    Fit,
    FloatArray,
    Free,
    Model,
    Score,
    extended,
    fit,
    held_out,
    rank,
)
from wakedeploy.gap.terms import TERMS, neighbours, wave_in_time
from wakedeploy.physics.effects.symbolic import SYMBOLIC, ExpressionForce
from wakedeploy.physics.expression import (
    VARIABLES,
    Binary,
    Call,
    Constant,
    Expression,
    Name,
    Negative,
    Node,
    nodes,
    parse,
)

SEARCHED = (*TERMS, *(wave_in_time(0.05 * n) for n in range(10, 101)))  # 0.5 to 5 Hz
MOST_TERMS = 3
_NEAR_NATS = 10.0  # terms that promise so much less than the best are not fitted
_MOST_FITTED = 6
_WORTH_FITTING = 0.7
_EQUAL_NATS = 1.0

Rank = Callable[[Model, Fit, Sequence[str]], list[Candidate]]


@dataclass(frozen=True)
class Coefficient:
    """A number of the expression under its name there, with its 90 % interval."""

    name: str
    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, eq=False)
class Symbolic:
    """A force as an expression.

    `expression` is in newtons, with coefficients by name; `text` has their numbers and units.
    `coordinates` are what it depends on, the most telling first; `gain_nats` is what it gains on
    episodes held out, `gains` (E,) per episode, and `fit` the fit that has it.
    """

    terms: tuple[str, ...]
    expression: str
    text: str
    coefficients: tuple[Coefficient, ...]
    coordinates: tuple[str, ...]
    gains: FloatArray
    fit: Fit

    @property
    def gain_nats(self) -> float:
        """The sum over the episodes."""
        return float(self.gains.sum())

    def as_json(self) -> dict[str, Any]:
        """What `name.json` says under "unknown"."""
        return {
            "coordinates": list(self.coordinates),
            "expression": self.expression,
            "text": self.text,
            "gain_nats": self.gain_nats,
            "terms": list(self.terms),
            "parameters": {
                c.name: {"value": c.value, "low": c.low, "high": c.high, "unit": c.unit}
                for c in self.coefficients
            },
        }


def search(
    model: Model,
    base: Fit,
    rank_function: Rank = rank,
    *,
    setting: Mapping[str, float],
    names: Sequence[str] = SEARCHED,
    terms: Mapping[str, ExpressionForce] = TERMS,
    least_nats: float | None = None,
    most_terms: int = MOST_TERMS,
) -> Symbolic | None:
    """The sparse expression on top of `base`, or None where no term gains enough.

    `model` must know the terms as effects. `setting` has the numbers of the rig that terms mention
    (`vars(setting_of(rig))`). Each term must gain `least_nats` on held-out episodes; by default as
    much as the best of so many terms without any truth in them would hardly gain.
    """
    least = math.log(len(names)) + 2.0 if least_nats is None else least_nats
    current, chosen = base, list[str]()
    while len(chosen) < most_terms:
        left = [name for name in names if name not in chosen]
        best = _best(model, current, left, terms, rank_function, least)
        if best is None or best.gain_nats < least:
            break
        current, chosen = best.fit, [*chosen, best.name]
    current, chosen = _without_idle(model, current, chosen, least)
    if not chosen:
        return None
    gains = held_out(model, current) - held_out(model, base)
    return _told(current, [terms[name] for name in chosen], setting, gains)


def to_effect(
    symbolic: Symbolic | Mapping[str, Any],
    data_sha256: str | None = None,
    date: str | None = None,
) -> rig.Effect:
    """The expression as a rig file's effect; from `name.json`'s "unknown" as well.

    Raises UnusableInput for an expression that is none, KeyError where parts of it are missing.
    """
    known = symbolic.as_json() if isinstance(symbolic, Symbolic) else symbolic
    parse(known["expression"], (*known["parameters"], *VARIABLES))
    parameters = {name: rig.EffectParameter(**p) for name, p in known["parameters"].items()}
    return rig.Effect(
        name=SYMBOLIC,
        expression=known["expression"],
        parameters=parameters,
        data_sha256=data_sha256,
        date=date,
    )


def promises(model: Model, base: Fit, names: Sequence[str]) -> FloatArray:
    """How many nats each term would gain on the episodes of the fit, by its slopes at zero (T,)."""
    slopes = base.slopes
    parts = zip(slopes.scores, slopes.innovation, slopes.variance, strict=True)
    shared = np.vstack([_white_slopes(*each) for each in parts])
    prior = np.diag([1.0 / f.prior_sd for f in base.free])
    held, _ = np.linalg.qr(np.vstack([shared, prior]))
    held = held[: len(shared)]
    rest = np.concatenate([_white_rest(score) for score in slopes.scores])
    rest = rest - held @ (held.T @ rest)
    return np.array([_promise(model, base, name, held, rest) for name in names])


def _best(
    model: Model,
    current: Fit,
    names: Sequence[str],
    terms: Mapping[str, ExpressionForce],
    rank_function: Rank,
    least: float,
) -> Candidate | None:
    """The term that gains most on held-out episodes, a wave with its frequency refined.

    None where no term promises much of `least` even on the episodes that it is fitted to.
    """
    promised = promises(model, current, names)
    order = [i for i in np.argsort(-promised) if promised[i] > promised.max() - _NEAR_NATS]
    if not order or promised.max() < _WORTH_FITTING * least:
        return None
    ranked = rank_function(model, current, [names[i] for i in order[:_MOST_FITTED]])
    best = _simplest(ranked, terms)
    near = neighbours(best.name)
    if near:
        closest = near[int(np.argmax(promises(model, current, near)))]
        best = max(best, *rank_function(model, current, [closest]), key=lambda c: c.gain_nats)
    return best


def _simplest(ranked: Sequence[Candidate], terms: Mapping[str, ExpressionForce]) -> Candidate:
    """Of the candidates that gain nearly as much as the best, the one with the fewest parts."""
    best = max(c.gain_nats for c in ranked)
    equal = [c for c in ranked if c.gain_nats > best - _EQUAL_NATS]
    return min(equal, key=lambda c: (len(list(nodes(terms[c.name].formula.root))), -c.gain_nats))


def _without_idle(
    model: Model, current: Fit, chosen: list[str], least: float
) -> tuple[Fit, list[str]]:
    """The fit and its terms, less those whose absence costs less than `least`, the idlest first."""
    while len(chosen) > 1:
        densities = held_out(model, current).sum()
        losses = []
        for name in chosen:
            hypothesis = tuple(n for n in current.hypothesis if n != name)
            start = extended(current, hypothesis, model.free(hypothesis))
            smaller = fit(model, hypothesis, current.episodes, start)
            losses.append((float(densities - held_out(model, smaller).sum()), name, smaller))
        loss, idle, smaller = min(losses, key=lambda entry: entry[0])
        if loss >= least:
            break
        current, chosen = smaller, [n for n in chosen if n != idle]
    return current, chosen


def _promise(model: Model, base: Fit, name: str, held: FloatArray, rest: FloatArray) -> float:
    """Half the squared length of the rest along the term's own directions."""
    hypothesis = (*base.hypothesis, name)
    free = model.free(hypothesis)
    theta = extended(base, hypothesis, free)
    own = [i for i, f in enumerate(free) if f.name.startswith(f"{name}.")]
    columns = [_direction(model, base, hypothesis, theta, free, i) for i in own]
    span = np.stack(columns, axis=1)
    span = span - held @ (held.T @ span)
    prior = np.diag([1.0 / free[i].prior_sd ** 2 for i in own])
    pull = span.T @ rest
    return 0.5 * float(pull @ np.linalg.solve(span.T @ span + prior, pull))


def _direction(
    model: Model,
    base: Fit,
    hypothesis: tuple[str, ...],
    theta: FloatArray,
    free: Sequence[Free],
    column: int,
) -> FloatArray:
    moved = theta.copy()
    moved[column] += free[column].step
    parts = []
    for episode, score in zip(base.episodes, base.slopes.scores, strict=True):
        there = model.score(hypothesis, moved, episode)
        de = (there.innovation - score.innovation) / free[column].step
        dv = (there.variance - score.variance) / free[column].step
        parts.append(_white_slopes(score, de[:, None], dv[:, None])[:, 0])
    return np.concatenate(parts)


def _white_slopes(score: Score, de: FloatArray, dv: FloatArray) -> FloatArray:
    """Slopes whose products are the Fisher information (2n, p)."""
    root = np.sqrt(score.weight)[:, None]
    variance = score.variance[:, None]
    return np.vstack([-root * de / np.sqrt(variance), root * dv / (variance * math.sqrt(2.0))])


def _white_rest(score: Score) -> FloatArray:
    """What the slopes are multiplied with to give the gradient (2n,)."""
    squares = np.sqrt(0.5 * score.weight) * (score.innovation**2 / score.variance - 1.0)
    return np.concatenate([score.white, squares])


def _told(
    fitted: Fit, chosen: Sequence[ExpressionForce], setting: Mapping[str, float], gains: FloatArray
) -> Symbolic:
    formulas, texts = list[str](), list[str]()
    coefficients = list[Coefficient]()
    for term in chosen:
        own = _coefficients(fitted, term, first=len(coefficients) + 1)
        formula = Expression(_worked_out(term.formula.replaced(setting).root))
        renamed = {
            p.name: parse(c.name, (c.name,)) for p, c in zip(term.parameters, own, strict=True)
        }
        formulas.append(formula.replaced(renamed).text)
        texts.append(_term_text(formula, own))
        coefficients += own
    return Symbolic(
        tuple(term.name for term in chosen),
        " + ".join(formulas),
        " ".join(texts).removeprefix("+ "),
        tuple(coefficients),
        _coordinates(chosen),
        gains,
        fitted,
    )


def _coefficients(fitted: Fit, term: ExpressionForce, first: int) -> list[Coefficient]:
    """A term's parameters under the names c1, c2, … counted from `first`."""
    own = []
    for number, p in enumerate(term.parameters, first):
        name = f"{term.name}.{p.name}"
        own.append(
            Coefficient(f"c{number}", fitted.value(name), *fitted.interval(name), unit=p.unit)
        )
    return own


def _coordinates(chosen: Sequence[ExpressionForce]) -> tuple[str, ...]:
    """The variables in the order in which the terms were found."""
    found = [
        node.name
        for term in chosen
        for node in nodes(term.formula.root)
        if isinstance(node, Name) and node.name in VARIABLES
    ]
    return tuple(dict.fromkeys(found))


def _term_text(formula: Expression, own: Sequence[Coefficient]) -> str:
    """A term with its sign, number and unit; sine and cosine as one wave with a phase."""
    if len(own) == 2:
        return _wave_text(formula, own[0], own[1])
    value, unit = own[0].value, own[0].unit
    number = f"{'-' if value < 0 else '+'} {abs(value):.3g}{'' if unit == '1' else ' ' + unit}"
    function = formula.text.removeprefix("c").removeprefix("*")
    return f"{number} * {function}" if function else number


def _wave_text(formula: Expression, sine: Coefficient, cosine: Coefficient) -> str:
    size, phase = math.hypot(sine.value, cosine.value), math.atan2(cosine.value, sine.value)
    turning = next(node for node in nodes(formula.root) if isinstance(node, Call)).arguments[0]
    rate = next(node.value for node in nodes(turning) if isinstance(node, Constant))
    variable = next(node.name for node in nodes(turning) if isinstance(node, Name))
    shift = f"{'-' if phase < 0 else '+'} {abs(phase):.2f}"
    return f"+ {size:.3g} {sine.unit} * sin(2π*{rate / math.tau:.4g}*{variable} {shift})"


def _worked_out(node: Node) -> Node:
    """The tree with operations between numbers carried out, to six digits."""
    if isinstance(node, Negative):
        return Negative(_worked_out(node.operand))
    if isinstance(node, Call):
        return Call(node.function, tuple(_worked_out(part) for part in node.arguments))
    if not isinstance(node, Binary):
        return node
    worked = Binary(node.operator, _worked_out(node.left), _worked_out(node.right))
    if isinstance(worked.left, Constant) and isinstance(worked.right, Constant):
        return Constant(float(f"{float(Expression(worked)({})):.6g}"))
    return worked
