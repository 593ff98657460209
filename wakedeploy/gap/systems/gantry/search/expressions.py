"""A sparse expression for a force that no effect of the library explains.

In: a model, and a fit of it that leaves something over. Out: a few terms of `expression_terms`, as
text with units and as an effect that a rig file can hold. Terms are chosen one after another by
their gain on episodes that they were not fitted to. All are refitted together; those no longer
needed are dropped.

Only the most promising terms of each round are fitted (`expected_gains`). An early term that stood
for two others gives its place to a rival, or is dropped.
"""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from wakedeploy.core import rig
from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.expression import (
    VARIABLES,
    Binary,
    Call,
    Constant,
    Expression,
    Name,
    Negative,
    Node,
    expression_of,
    nodes,
    parse,
)
from wakedeploy.gap.evidence.expected_gains import promises
from wakedeploy.gap.evidence.fits import Fit, FloatArray, Hypothesis, Model, extended
from wakedeploy.gap.evidence.inference import fit, held_out
from wakedeploy.gap.evidence.ranking import Candidate, rank
from wakedeploy.gap.systems.gantry import findings
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.expression_terms import (
    TERMS,
    is_wave_in_time,
    neighbours,
    wave_in_time,
)
from wakedeploy.physics.effects.symbolic import SYMBOLIC, ExpressionForce

SEARCHED = (*TERMS, *(wave_in_time(0.05 * n) for n in range(10, 101)))  # 0.5 to 5 Hz
MOST_TERMS = 3
_NEAR_NATS = 8.0  # a term that promises this much less than the best is not fitted
_MOST_FITTED = 4
_WORTH_FITTING = 0.7  # of what a term must gain: slopes at zero promise somewhat too little
_MOST_RIVALS = 6
_RIVALS_SHARE = 0.4  # of the best's promise: such a term may take the best one's place later
_MOST_WAVES = 25  # the most waves of one round that are tried in the next
_SURELY = 3.0  # standard errors from zero beyond which a term needs no refit without it

Rank = Callable[[Model, Fit, Sequence[str]], list[Candidate]]
_ranked: Rank = functools.partial(rank, released=False)  # a term moves no calibrated constant


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
    `coordinates` are what it depends on, the most telling first. `gain_nats` is its gain on
    episodes held out: `gains` (E,) per episode, and `prior_gain` by the priors. `fit` is the fit
    that has it.
    """

    terms: tuple[str, ...]
    expression: str
    text: str
    coefficients: tuple[Coefficient, ...]
    coordinates: tuple[str, ...]
    gains: FloatArray
    prior_gain: float
    fit: Fit

    @property
    def gain_nats(self) -> float:
        """The sum over the episodes, with the priors' part."""
        return float(self.gains.sum()) + self.prior_gain

    @property
    def as_artefact(self) -> findings.Expression:
        """What `name.json` says under "unknown"."""
        return findings.Expression(
            coordinates=list(self.coordinates),
            expression=self.expression,
            text=self.text,
            gain_nats=self.gain_nats,
            terms=list(self.terms),
            parameters={
                c.name: findings.Size(value=c.value, low=c.low, high=c.high, unit=c.unit)
                for c in self.coefficients
            },
        )


def search(
    model: Model,
    base: Fit,
    rank_function: Rank = _ranked,
    *,
    setting: Mapping[str, float],
    names: Sequence[str] = SEARCHED,
    terms: Mapping[str, ExpressionForce] = TERMS,
    least_nats: float | None = None,
    wave_nats: float | None = None,
    most_terms: int = MOST_TERMS,
) -> Symbolic | None:
    """The sparse expression on top of `base`, or None if no term gains enough.

    `model` must know the terms as effects. `setting` has the numbers of the rig that terms mention
    (`vars(setting_of(rig))`). Each term must gain `least_nats` on held-out episodes; by default as
    much as the best of as many false terms would hardly gain. A wave in time must gain `wave_nats`,
    if that is given: there are many of them, unlike one another, with two coefficients each, and
    the best of them gains more by chance.
    """
    least = math.log(len(names)) + 3.0 if least_nats is None else least_nats
    bars = _Bars(least, least if wave_nats is None else wave_nats)
    searched = _Search(model, base, rank_function, names, terms, bars)
    while len(searched.chosen) < most_terms and searched.add():
        searched.exchange()
    searched.drop_idle()
    if not searched.chosen:
        return None
    return symbolic_of(base, searched.current, tuple(searched.chosen), setting, terms)


def to_effect(
    symbolic: Symbolic | findings.Expression,
    data_sha256: str | None = None,
    date: str | None = None,
    onto: rig.Effect | None = None,
) -> rig.Effect:
    """The expression as a rig file's effect; it may also come from `name.json`'s "unknown".

    `onto` is the symbolic force that the rig already has; both are summed. Raises UnusableInput for
    a text that is no expression in the variables and its own parameters.
    """
    known = symbolic.as_artefact if isinstance(symbolic, Symbolic) else symbolic
    try:
        stated = known.entries()
        expression = expression_of(known.expression, stated)
    except ValueError as error:
        raise UnusableInput(
            f"The result's unknown force cannot be read ({one_line(error)}); name it again."
        ) from error
    if onto is not None and onto.expression is not None:
        expression, stated = _summed(onto, onto.expression, expression, stated)
    return rig.Effect(
        name=SYMBOLIC,
        expression=expression.text,
        parameters=stated,
        data_sha256=data_sha256,
        date=date,
    )


def _summed(
    old: rig.Effect, text: str, new: Expression, stated: Mapping[str, rig.EffectParameter]
) -> tuple[Expression, dict[str, rig.EffectParameter]]:
    """Two forces as one; the new one's parameters get names that are still free."""
    before = expression_of(text, old.parameters)
    free = (name for n in itertools.count(1) if (name := f"c{n}") not in old.parameters)
    names = dict(zip(stated, free))  # noqa: B905 - the second never ends
    renamed = new.replaced({name: parse(to, (to,)) for name, to in names.items()})
    parameters = dict(old.parameters) | {names[name]: p for name, p in stated.items()}
    return expression_of(f"{before.text} + ({renamed.text})", parameters), parameters


@dataclass(frozen=True)
class _Bars:
    """What a term must gain [nats]."""

    state: float
    time: float

    def of(self, name: str) -> float:
        """The bar of the family that a term belongs to."""
        return self.time if is_wave_in_time(name) else self.state


class _Search:
    """Forward selection with exchanges: `chosen` terms, each with its rivals, and their fit."""

    def __init__(
        self,
        model: Model,
        base: Fit,
        rank_function: Rank,
        names: Sequence[str],
        terms: Mapping[str, ExpressionForce],
        bars: _Bars,
    ) -> None:
        self._model, self._rank = model, rank_function
        self._names, self._terms, self._bars = names, terms, bars
        self.current = base
        self.chosen: dict[str, tuple[str, ...]] = {}
        self._fits: dict[Hypothesis, Fit] = {base.hypothesis: base}

    def add(self) -> bool:
        """Take the term that gains most on held-out episodes, if it gains enough.

        A wave has its frequency refined. A term is not fitted if it promises little of what it must
        gain even on the episodes that it is fitted to.
        """
        remaining = [name for name in self._names if name not in self.chosen]
        promised = dict(zip(remaining, promises(self._model, self.current, remaining), strict=True))
        order = sorted(remaining, key=lambda name: -promised[name])
        hopeful = [n for n in order if promised[n] > _WORTH_FITTING * self._bars.of(n)]
        if not hopeful:
            return False
        most = promised[order[0]]
        near = [name for name in hopeful[:_MOST_FITTED] if promised[name] > most - _NEAR_NATS]
        ranked = self._rank(self._model, self.current, near)
        ranked = [c for c in ranked if c.gain_nats > self._bars.of(c.name)]
        if not ranked:
            return False
        best = _simplest(ranked, self._terms)
        best = self._refined(best, promised[best.name])
        self.current = self._fits[best.fit.hypothesis] = best.fit
        rivals = [n for n in order[:_MOST_RIVALS] if promised[n] > _RIVALS_SHARE * most]
        self.chosen[best.name] = tuple(n for n in rivals if n != best.name)
        waves = [name for name in order if neighbours(name)]
        self._names = [name for name in order if name not in waves[_MOST_WAVES:]]
        return True

    def exchange(self) -> None:
        """Give an earlier term's place to its best rival, if that now gains more."""
        for name, rivals in list(self.chosen.items())[:-1]:
            free = [rival for rival in rivals if rival not in self.chosen]
            if not free:
                continue
            smaller = self._without(name)
            rival = free[int(promises(self._model, smaller, free).argmax())]
            best = self._rank(self._model, smaller, [rival])[0]
            present = held_out(smaller, self.current)
            if best.gain_nats > float(present.sum()) + RULES.shorter_nats:
                del self.chosen[name]
                self.chosen = {rival: rivals, **self.chosen}
                self.current = best.fit

    def drop_idle(self) -> None:
        """Drop terms whose absence costs less than they must gain, the idlest first."""
        while len(self.chosen) > 1:
            doubtful = [name for name in self.chosen if not self._surely_needed(name)]
            losses = {
                name: float(held_out(self._without(name), self.current).sum()) for name in doubtful
            }
            idle = min(losses, key=lambda name: losses[name] - self._bars.of(name), default=None)
            if idle is None or losses[idle] >= self._bars.of(idle):
                break
            self.current = self._without(idle)
            del self.chosen[idle]

    def _surely_needed(self, name: str) -> bool:
        """Whether one of a term's coefficients is so far from zero that no refit is needed."""
        parameters = [n for n in self.current.names if n.startswith(f"{name}.")]
        away = [self.current.value(n) / self.current.standard_error(n) for n in parameters]
        return 0.5 * max(abs(z) for z in away) ** 2 > _SURELY * self._bars.of(name)

    def _without(self, name: str) -> Fit:
        hypothesis: Hypothesis = tuple(n for n in self.current.hypothesis if n != name)
        if hypothesis not in self._fits:
            start = extended(self.current, self._model.free(hypothesis))
            self._fits[hypothesis] = fit(self._model, hypothesis, self.current.episodes, start)
        return self._fits[hypothesis]

    def _refined(self, best: Candidate, promised: float) -> Candidate:
        """The candidate or, for a wave, the neighbour that promises more and gains more."""
        near = neighbours(best.name)
        if not near:
            return best
        there = promises(self._model, self.current, near)
        if there.max() <= promised:
            return best
        closest = self._rank(self._model, self.current, [near[int(there.argmax())]])[0]
        return max(best, closest, key=lambda candidate: candidate.gain_nats)


def _simplest(ranked: Sequence[Candidate], terms: Mapping[str, ExpressionForce]) -> Candidate:
    """The candidate with the fewest parts among those that gain nearly as much as the best."""
    best = max(c.gain_nats for c in ranked)
    equal = [c for c in ranked if c.gain_nats > best - RULES.shorter_nats]
    return min(equal, key=lambda c: (len(list(nodes(terms[c.name].formula.root))), -c.gain_nats))


def symbolic_of(
    base: Fit,
    fitted: Fit,
    names: Sequence[str],
    setting: Mapping[str, float],
    terms: Mapping[str, ExpressionForce] = TERMS,
) -> Symbolic:
    """The terms of these names in a fit as one expression, and what they gain over a base."""
    chosen = [terms[name] for name in names]
    formulas, texts = list[str](), list[str]()
    coefficients = list[Coefficient]()
    for term in chosen:
        added = _coefficients(fitted, term, first=len(coefficients) + 1)
        formula = Expression(_worked_out(term.formula.replaced(setting).root))
        renamed = {
            p.name: parse(c.name, (c.name,)) for p, c in zip(term.parameters, added, strict=True)
        }
        formulas.append(formula.replaced(renamed).text)
        texts.append(_term_text(formula, added))
        coefficients += added
    return Symbolic(
        tuple(term.name for term in chosen),
        " + ".join(formulas),
        " ".join(texts).removeprefix("+ "),
        tuple(coefficients),
        _coordinates(chosen),
        held_out(base, fitted),
        fitted.log_prior - base.log_prior,
        fitted,
    )


def _coefficients(fitted: Fit, term: ExpressionForce, first: int) -> list[Coefficient]:
    """A term's parameters under the names c1, c2, … counted from `first`."""
    found = []
    for number, p in enumerate(term.parameters, first):
        name = f"{term.name}.{p.name}"
        found.append(
            Coefficient(f"c{number}", fitted.value(name), *fitted.interval(name), unit=p.unit)
        )
    return found


def _coordinates(chosen: Sequence[ExpressionForce]) -> tuple[str, ...]:
    """The variables, in the order in which the terms were found."""
    found = [
        node.name
        for term in chosen
        for node in nodes(term.formula.root)
        if isinstance(node, Name) and node.name in VARIABLES
    ]
    return tuple(dict.fromkeys(found))


def _term_text(formula: Expression, coefficients: Sequence[Coefficient]) -> str:
    """A term with its sign, number and unit; sine and cosine as one wave with a phase."""
    if len(coefficients) == 2:
        return _wave_text(formula, coefficients[0], coefficients[1])
    value, unit = coefficients[0].value, coefficients[0].unit
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
    worked = Binary(node.operator, _worked_out(node.left_operand), _worked_out(node.right_operand))
    if isinstance(worked.left_operand, Constant) and isinstance(worked.right_operand, Constant):
        return Constant(float(f"{float(Expression(worked)({})):.6g}"))
    return worked
