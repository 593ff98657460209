"""Forces given by an expression: one from a rig file, or a term that a search tries.

An expression is arithmetic that has been read against a whitelist (`core.expression`). Whatever
it says, the force stays within three times the sufferer's weight, and a force that is no number
stops the simulation with the state at which it happened.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from wakedeploy.core import rig
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.expression import VARIABLES, Expression, expression_of, parse
from wakedeploy.physics.effects.base import Effect, Motion, Number, Parameter, Setting, Values

SYMBOLIC = "symbolic-force"
MOST_WEIGHTS = 3.0
SETTING_NAMES = tuple(Setting.__dataclass_fields__)


class ExpressionForce(Effect):
    """A vertical force on the sufferer that is an expression in the state of the rig."""

    stage = "force"
    formula: ClassVar[Expression]

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """The expression's value [N], within ±3 weights; UnusableInput where it is no number."""
        state = vars(m)
        force = self.formula({**vars(s), **state, **p})
        undefined = np.isnan(force)
        if np.any(undefined):
            raise UnusableInput(
                f"The expression {self.formula.text} is no number "
                f"{_place(self.formula, state, undefined)}; rewrite it for such states."
            )
        most = MOST_WEIGHTS * s.weight_n
        return np.minimum(np.maximum(force, -most), most)

    def __reduce__(self) -> tuple[object, ...]:
        return expression_force, (self.name, self.physics, self.formula.text, self.parameters)


def expression_force(
    name: str, physics: str, expression: str, parameters: Sequence[Parameter]
) -> ExpressionForce:
    """An effect from an expression [N] in its parameters, `Motion`'s and `Setting`'s fields.

    Raises UnusableInput for an expression that is none.
    """
    names = (*(parameter.name for parameter in parameters), *VARIABLES, *SETTING_NAMES)
    attributes = {
        "name": name,
        "physics": physics,
        "parameters": tuple(parameters),
        "formula": parse(expression, names),
    }
    made: ExpressionForce = type("NamedExpressionForce", (ExpressionForce,), attributes)()
    return made


def symbolic_effect(entry: rig.Effect) -> ExpressionForce:
    """The effect that a rig file's "symbolic-force" describes; UnusableInput without expression."""
    if entry.expression is None:
        raise UnusableInput(f"The effect {entry.name!r} has no expression; write one.")
    formula = expression_of(entry.expression, entry.parameters)
    parameters = [_parameter(name, known) for name, known in entry.parameters.items()]
    return expression_force(
        entry.name, "A force without a name, as an expression.", formula.text, parameters
    )


def _parameter(name: str, known: rig.EffectParameter) -> Parameter:
    return Parameter(
        name, known.unit, scale=abs(known.value) or 1.0, low=float("-inf"), high=float("inf")
    )


def _place(formula: Expression, state: Mapping[str, Number], undefined: Number) -> str:
    """The variables' values at the first sample that is no number."""
    first = int(np.argmax(undefined))
    values = []
    for name in sorted(formula.names & set(state)):
        column = np.atleast_1d(state[name])
        values.append(f"{name} = {column[first % len(column)]:g}")
    return "at " + ", ".join(values) if values else "anywhere"
