"""Python functions of plain arithmetic as MATLAB, which Octave reads, too.

In: syntax trees of functions made of numbers, arrays, conditions and loops over a count. Out: their
text in MATLAB. Indices are moved by one, products and powers are element by element. What has no
counterpart here is refused by name, never guessed.
"""

import ast
import re
from collections.abc import Callable
from typing import Any

from wakedeploy.core.errors import UnusableInput

_BINARY: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: ".*",
    ast.Div: "./",
    ast.Pow: ".^",
}
_COMPARED: dict[type[ast.cmpop], str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "~=",
}
_PLAIN = ("exp", "sqrt", "sign", "floor", "ceil", "tanh", "sin", "cos", "abs", "sum", "log")
_NUMPY = {name: f"{name}({{0}})" for name in _PLAIN} | {
    "absolute": "abs({0})",
    "maximum": "max({0}, {1})",
    "minimum": "min({0}, {1})",
    "asarray": "({0})",
    "copysign": "abs({0}) .* sign({1})",
    "dot": "sum({0} .* {1})",
    "zeros": "zeros(1, {0})",
    "arange": "(0:{0} - 1)",
    "roll": "circshift({0}, {1})",
    "interp": "interp1({1}, {2}, min(max({0}, {1}(1)), {1}(end)))",
    "logaddexp": "log_of_sum({0}, {1})",
    "where": "chosen({0}, {1}, {2})",
    "hypot": "hypot({0}, {1})",
    "log1p": "log1p({0})",
    "expm1": "expm1({0})",
    "arctan2": "atan2({0}, {1})",
    "clip": "min(max({0}, {1}), {2})",
}
_BUILT_IN = {
    "max": "max({0}, {1})",
    "min": "min({0}, {1})",
    "abs": "abs({0})",
    "len": "numel({0})",
    "int": "fix({0})",
    "float": "({0})",
    "round": "to_even({0})",
    "SimpleNamespace": "struct()",
}
_NAMED = {"inf": "Inf", "nan": "NaN", "pi": "pi"}

HELPERS = """
function y = log_of_sum(a, b)
  % log(exp(a) + exp(b)) without overflow
  y = max(a, b) + log1p(exp(-abs(a - b)));
end

function y = to_even(a)
  % the nearest whole number, halves to the even one
  y = round(a);
  if abs(a - fix(a)) == 0.5
    y = 2 * round(a / 2);
  end
end

function y = chosen(condition, a, b)
  % a where the condition holds, else b
  y = b;
  if condition
    y = a;
  end
end
"""


def function(tree: ast.FunctionDef) -> str:
    """One function; UnusableInput names what MATLAB has no counterpart for."""
    return _Writer(tree).text()


class _Writer:
    """Writes one function."""

    def __init__(self, tree: ast.FunctionDef) -> None:
        self._tree = tree
        self._names = [argument.arg for argument in tree.args.args]
        self._outputs = _outputs(tree)

    def text(self) -> str:
        tree = self._tree
        outputs = ", ".join(self._outputs)
        lines = [f"function [{outputs}] = {tree.name}({', '.join(self._names)})"]
        doc = ast.get_docstring(tree)
        lines += [f"  % {line}".rstrip() for line in (doc or "").splitlines()]
        lines += self._defaults()
        lines += self._block(tree.body[1:] if doc else tree.body, 1)
        return "\n".join([*lines, "end"]) + "\n"

    def _defaults(self) -> list[str]:
        given = self._tree.args.defaults
        first = len(self._names) - len(given)
        return [
            f"  if nargin < {first + i + 1}, {self._names[first + i]} = {self._value(each)}; end"
            for i, each in enumerate(given)
        ]

    def _block(self, body: list[ast.stmt], depth: int) -> list[str]:
        return [line for statement in body for line in self._statement(statement, depth)]

    def _statement(self, node: ast.stmt, depth: int) -> list[str]:
        pad = "  " * depth
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            return [pad + line for line in self._assignment(node.targets[0], node.value)]
        if isinstance(node, ast.AugAssign):
            target, sign = self._value(node.target), _BINARY.get(type(node.op))
            if sign is not None:
                return [f"{pad}{target} = {target} {sign} ({self._value(node.value)});"]
        if isinstance(node, ast.If):
            return self._condition(node, depth)
        if isinstance(node, ast.For):
            return self._loop(node, depth)
        if isinstance(node, ast.Return) and node.value is not None:
            return [pad + line for line in [*self._result(node.value), "return;"]]
        raise self._refused(node)

    def _assignment(self, target: ast.expr, value: ast.expr) -> list[str]:
        if not isinstance(target, ast.Tuple):
            return [f"{self._value(target)} = {self._value(value)};"]
        targets = [self._value(element) for element in target.elts]
        if isinstance(value, ast.Tuple):
            pairs = zip(targets, value.elts, strict=True)
            return [f"{name} = {self._value(element)};" for name, element in pairs]
        return [f"[{', '.join(targets)}] = {self._value(value)};"]

    def _condition(self, node: ast.If, depth: int) -> list[str]:
        pad = "  " * depth
        lines = [f"{pad}if {self._value(node.test)}", *self._block(node.body, depth + 1)]
        if node.orelse:
            lines += [f"{pad}else", *self._block(node.orelse, depth + 1)]
        return [*lines, f"{pad}end"]

    def _loop(self, node: ast.For, depth: int) -> list[str]:
        pad, over = "  " * depth, node.iter
        if not (isinstance(over, ast.Call) and _called(over) == "range" and len(over.args) == 1):
            raise self._refused(node)
        head = f"{pad}for {self._value(node.target)} = 0:({self._value(over.args[0])} - 1)"
        return [head, *self._block(node.body, depth + 1), f"{pad}end"]

    def _result(self, value: ast.expr) -> list[str]:
        values = value.elts if isinstance(value, ast.Tuple) else [value]
        pairs = zip(self._outputs, values, strict=True)
        return [f"{name} = {self._value(element)};" for name, element in pairs]

    def _value(self, node: ast.expr) -> str:
        writers: dict[type[ast.expr], Callable[[Any], str]] = {
            ast.Constant: self._constant,
            ast.Name: self._name,
            ast.Attribute: self._attribute,
            ast.Subscript: self._element,
            ast.BinOp: self._binary,
            ast.UnaryOp: self._unary,
            ast.Compare: self._compare,
            ast.BoolOp: self._boolean,
            ast.Call: self._call,
            ast.IfExp: self._either,
            ast.Dict: self._record,
        }
        if type(node) in writers:
            return writers[type(node)](node)
        raise self._refused(node)

    def _constant(self, node: ast.Constant) -> str:
        if isinstance(node.value, bool):
            return "true" if node.value else "false"
        if isinstance(node.value, str):
            return "'" + node.value.replace("'", "''") + "'"
        if isinstance(node.value, int | float):
            return repr(node.value)
        raise self._refused(node)

    def _name(self, node: ast.Name) -> str:
        return node.id

    def _attribute(self, node: ast.Attribute) -> str:
        if isinstance(node.value, ast.Name) and node.value.id in ("np", "math"):
            if node.attr not in _NAMED:
                raise self._refused(node)
            return _NAMED[node.attr]
        return f"{self._value(node.value)}.{node.attr}"

    def _element(self, node: ast.Subscript) -> str:
        index = node.slice
        if isinstance(index, ast.Slice | ast.Tuple):
            raise self._refused(node)
        return f"{self._value(node.value)}({self._value(index)} + 1)"

    def _binary(self, node: ast.BinOp) -> str:
        if type(node.op) not in _BINARY:
            raise self._refused(node)
        left_operand, right_operand = self._value(node.left), self._value(node.right)
        return f"({left_operand} {_BINARY[type(node.op)]} {right_operand})"

    def _unary(self, node: ast.UnaryOp) -> str:
        signs: dict[type[ast.unaryop], str] = {ast.USub: "-", ast.UAdd: "+", ast.Not: "~"}
        if type(node.op) not in signs:
            raise self._refused(node)
        return f"({signs[type(node.op)]}{self._value(node.operand)})"

    def _compare(self, node: ast.Compare) -> str:
        if len(node.ops) != 1 or type(node.ops[0]) not in _COMPARED:
            raise self._refused(node)
        left_operand, right_operand = self._value(node.left), self._value(node.comparators[0])
        if isinstance(node.comparators[0], ast.Constant) and isinstance(
            node.comparators[0].value, str
        ):
            alike = f"strcmp({left_operand}, {right_operand})"
            return alike if isinstance(node.ops[0], ast.Eq) else f"(~{alike})"
        return f"({left_operand} {_COMPARED[type(node.ops[0])]} {right_operand})"

    def _boolean(self, node: ast.BoolOp) -> str:
        sign = " && " if isinstance(node.op, ast.And) else " || "
        return f"({sign.join(self._value(operand) for operand in node.values)})"

    def _either(self, node: ast.IfExp) -> str:
        parts = (self._value(part) for part in (node.test, node.body, node.orelse))
        return f"chosen({', '.join(parts)})"

    def _record(self, node: ast.Dict) -> str:
        parts = []
        for key, value in zip(node.keys, node.values, strict=True):
            if key is None:
                raise self._refused(node)
            parts += [self._value(key), self._value(value)]
        return f"struct({', '.join(parts)})"

    def _call(self, node: ast.Call) -> str:
        if node.keywords:
            raise self._refused(node)
        arguments, name = [self._value(argument) for argument in node.args], _called(node)
        if isinstance(node.func, ast.Name) and name not in _BUILT_IN:
            return f"{name}({', '.join(arguments)})"
        known = _BUILT_IN if isinstance(node.func, ast.Name) else _NUMPY
        if name not in known or len(arguments) != len(set(re.findall(r"{(\d)}", known[name]))):
            raise self._refused(node)
        return known[name].format(*arguments)

    def _refused(self, node: ast.AST) -> UnusableInput:
        shown = ast.unparse(node).splitlines()[0]
        return UnusableInput(
            f"{self._tree.name}: {shown!r} has no counterpart in the MATLAB export; write it with "
            "plain arithmetic, conditions and numpy's elementary functions."
        )


def _called(node: ast.Call) -> str:
    if isinstance(node.func, ast.Name):
        return node.func.id
    return node.func.attr if isinstance(node.func, ast.Attribute) else ""


def _outputs(tree: ast.FunctionDef) -> list[str]:
    """Names for what a function returns, from its first return."""
    found = next((n for n in ast.walk(tree) if isinstance(n, ast.Return)), None)
    count = len(found.value.elts) if found and isinstance(found.value, ast.Tuple) else 1
    return [f"out{i + 1}" for i in range(count)]
