"""The physics as plain functions: the simulation's own, with names that stand alone.

In: effects of a `Chain`. Out: Python syntax trees of functions, those of effects named
`<effect>_<method>(p, m, s, …)`, made from the source of what the simulation calls, so that there is
one equation only.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Collection, Iterable
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.expression import VARIABLES
from wakedeploy.physics.effects.acting import in_steps
from wakedeploy.physics.effects.base import Effect, Motion, Setting
from wakedeploy.physics.effects.chain import METHODS, Chain
from wakedeploy.physics.effects.symbolic import MOST_WEIGHTS, ExpressionForce
from wakedeploy.physics.jet import air_mps, drag_force, paces, puff_shapes
from wakedeploy.physics.motor import approached, kept, mean_thrust, spooled
from wakedeploy.physics.rail import is_held, slid
from wakedeploy.physics.range_sensor import seen_m

_STAGES: tuple[Callable[..., Any], ...] = (
    in_steps, kept, approached, spooled, mean_thrust, puff_shapes, paces, air_mps, drag_force,
    is_held, slid, seen_m,
)  # fmt: skip
_FUNCTIONS = {"abs": "abs", "min": "minimum", "max": "maximum"}  # the others are called alike
_COMBINED = {
    "source_n": ("changed_source_n", "m.source_n = {call}", "return m.source_n"),
    "sufferer_n": ("changed_sufferer_n", "m.sufferer_n = {call}", "return m.sufferer_n"),
    "wake_mps": ("changed_wake_mps", "m.wake_mps = {call}", "return m.wake_mps"),
    "wake_offset_m": ("added_offset_m", "total = total + {call}", "return total"),
    "force_n": ("added_force_n", "total = total + {call}", "return total"),
    "added_mass_kg": ("added_mass_kg", "total = total + {call}", "return total"),
}


def acting_name(effect: Effect) -> str:
    """An effect's name as a variable's: `ground-effect` → `effect_ground_effect`."""
    return "effect_" + effect.name.replace("-", "_")


def is_acting(effect: Effect) -> bool:
    """Whether an effect does more than to replace constants."""
    return any(effect.changes(method) for method in METHODS)


def stage_functions() -> list[ast.FunctionDef]:
    """The functions of the plant's stages that the exported model calls."""
    return [_stage(function) for function in _STAGES]


def effect_functions(chain: Chain) -> list[ast.FunctionDef]:
    """One function per effect and method that acts, in the order in which effects act."""
    return [
        _function(effect, method)
        for effect, _ in chain.parts
        for method in METHODS
        if effect.changes(method)
    ]


def combining_functions(chain: Chain) -> list[ast.FunctionDef]:
    """The functions by which the model asks for everything that the effects change."""
    made = [_combined(chain, method, *shape) for method, shape in _COMBINED.items()]
    return [*made, _accepted(chain), _trailed(chain), _ranged(chain), _motion()]


def _function(effect: Effect, method: str) -> ast.FunctionDef:
    if isinstance(effect, ExpressionForce):
        return _of_expression(effect)
    function = getattr(type(effect), method)
    try:
        source = textwrap.dedent(inspect.getsource(function))
    except (OSError, TypeError) as error:
        raise UnusableInput(
            f"The effect {effect.name!r} has no source text, so it cannot be exported; define it "
            "in a file."
        ) from error
    plain = _Plain(effect.name, function.__globals__).visit(_parsed(source))
    assert isinstance(plain, ast.FunctionDef)
    plain.name = f"{acting_name(effect)}_{method}"
    return ast.fix_missing_locations(plain)


def _stage(function: Callable[..., Any]) -> ast.FunctionDef:
    tree = _OfNumpy().visit(_parsed(inspect.getsource(function)))
    known = function.__globals__ | {"np": np}
    plain = _Plain(function.__name__, known, _STAGES).visit(tree)
    assert isinstance(plain, ast.FunctionDef)
    return ast.fix_missing_locations(plain)


class _OfNumpy(ast.NodeTransformer):
    """numpy's functions in place of those of the same name in `math`."""

    def visit_Name(self, node: ast.Name) -> ast.Name:
        return ast.Name("np", node.ctx) if node.id == "math" else node


class _Plain(ast.NodeTransformer):
    """A method without its class: no self, no annotations, values for the file's own numbers.

    It may call the functions of `others`, which are exported, too.
    """

    def __init__(
        self, effect: str, known: dict[str, object], others: Collection[object] = ()
    ) -> None:
        self._effect, self._known, self._others = effect, known, others

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        node.args.args = [
            ast.arg(argument.arg) for argument in node.args.args if argument.arg != "self"
        ]
        node.returns, node.decorator_list = None, []
        self._local = {argument.arg for argument in node.args.args} | _assigned(node)
        node.body = [self.visit(statement) for statement in node.body]
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.Assign:
        assert node.value is not None
        return ast.Assign([node.target], self.visit(node.value))

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        is_value = isinstance(node.value, ast.Name) and node.value.id == "p"
        if is_value and isinstance(node.slice, ast.Constant):
            return ast.Attribute(node.value, str(node.slice.value), ast.Load())
        return node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self._local or isinstance(node.ctx, ast.Store):
            return node
        value = self._known.get(node.id)
        if isinstance(value, int | float):
            return ast.Constant(float(value))
        if value is np:
            return ast.Name("np", ast.Load())
        if value in self._others:
            return node
        if value is None and node.id in ("abs", "min", "max", "round", "int"):
            return node
        raise UnusableInput(
            f"The effect {self._effect!r} uses {node.id!r}, which cannot be exported; write its "
            "methods with numbers, numpy, p, m and s alone."
        )


def _assigned(node: ast.FunctionDef) -> set[str]:
    names = (n for n in ast.walk(node) if isinstance(n, ast.Name))
    return {name.id for name in names if isinstance(name.ctx, ast.Store)}


def _of_expression(effect: ExpressionForce) -> ast.FunctionDef:
    """A force that a rig file gives as an expression."""
    parsed = ast.parse(effect.formula.text, mode="eval").body
    body = ast.unparse(_InState().visit(parsed))
    text = (
        f"def {acting_name(effect)}_force_n(p, m, s):\n"
        f"    '''A force without a name, as an expression, within 3 weights [N].'''\n"
        f"    force_n = {body}\n"
        f"    most_n = {MOST_WEIGHTS} * s.weight_n\n"
        "    return np.minimum(np.maximum(force_n, -most_n), most_n)\n"
    )
    return _parsed(text)


class _InState(ast.NodeTransformer):
    """An expression's names as fields of motion, setting and parameters."""

    def visit_Call(self, node: ast.Call) -> ast.Call:
        assert isinstance(node.func, ast.Name)
        called = _FUNCTIONS.get(node.func.id, node.func.id)
        function = ast.Attribute(ast.Name("np", ast.Load()), called, ast.Load())
        return ast.Call(function, [self.visit(argument) for argument in node.args], [])

    def visit_Name(self, node: ast.Name) -> ast.Attribute:
        setting = Setting.__dataclass_fields__
        owner = "m" if node.id in VARIABLES else "s" if node.id in setting else "p"
        return ast.Attribute(ast.Name(owner, ast.Load()), node.id, ast.Load())


def _combined(chain: Chain, method: str, name: str, each: str, last: str) -> ast.FunctionDef:
    lines = ["total = 0.0"] if "total" in last else []
    lines += [each.format(call=_call(effect, method, "m, c")) for effect in _acting(chain, method)]
    return _defined(f"{name}(c, m)", [*lines, last])


def _accepted(chain: Chain) -> ast.FunctionDef:
    rest = "pulse_us, before_us, motor, c.idle_us"
    acting = _acting(chain, "pulse_us")
    lines = [f"pulse_us = {_call(effect, 'pulse_us', rest)}" for effect in acting]
    return _defined("accepted_us(c, pulse_us, before_us, motor)", [*lines, "return pulse_us"])


def _trailed(chain: Chain) -> ast.FunctionDef:
    acting = _acting(chain, "carriage_m")
    lines = [f"drive_m = {_call(effect, 'carriage_m', 'drive_m, before_m')}" for effect in acting]
    return _defined("carriage_place_m(c, drive_m, before_m)", [*lines, "return drive_m"])


def _ranged(chain: Chain) -> ast.FunctionDef:
    acting = _acting(chain, "range_m")
    lines = [f"range_m = {_call(effect, 'range_m', 'range_m, m, c')}" for effect in acting]
    return _defined("changed_range_m(c, m, range_m)", [*lines, "return range_m"])


def _motion() -> ast.FunctionDef:
    fields = [f"m.{name} = 0.0" for name in Motion.__dataclass_fields__]
    return _defined("motion_at_rest()", ["m = SimpleNamespace()", *fields, "return m"])


def _acting(chain: Chain, method: str) -> list[Effect]:
    return [effect for effect, _ in chain.parts if effect.changes(method)]


def _call(effect: Effect, method: str, rest: str) -> str:
    name = acting_name(effect)
    return f"{name}_{method}(c.{name}, {rest})"


def _defined(signature: str, lines: Iterable[str]) -> ast.FunctionDef:
    return _parsed(f"def {signature}:\n" + "".join(f"    {line}\n" for line in lines))


def _parsed(text: str) -> ast.FunctionDef:
    made = ast.parse(text).body[0]
    assert isinstance(made, ast.FunctionDef)
    return made
