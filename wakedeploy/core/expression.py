"""Arithmetic expressions from files: read against a whitelist, never evaluated as code.

In: a text such as "c1*sin(9.42*time_s) + c2*x_m". Out: an `Expression`, which gives values from
numbers or arrays, and the same text again. The grammar is Python's, but knows only numbers, the
names it is given, + - * / **, and nine functions; an exponent is a plain number from -8 to 8.
"""

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput

Number = float | npt.NDArray[np.float64]
Function = Callable[..., Number]

# What an effect may look at: the fields of `wakedeploy.physics.effects.base.Motion`.
VARIABLES = (
    "time_s",
    "x_m",
    "vx_mps",
    "z_m",
    "vz_mps",
    "source_n",
    "source_rate_nps",
    "sufferer_n",
    "wake_mps",
    "wake_n",
    "charge_s",
    "travelled_m",
    "direction",
)
FUNCTIONS: Mapping[str, tuple[int, Function]] = {
    "sin": (1, np.sin),
    "cos": (1, np.cos),
    "exp": (1, np.exp),
    "tanh": (1, np.tanh),
    "abs": (1, np.abs),
    "sqrt": (1, np.sqrt),
    "sign": (1, np.sign),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
}
MOST_CHARACTERS = 2000
MOST_TOKENS = 400  # bounds the tree's depth, too: a sum leans to the left
MOST_NESTED = 40
LARGEST_EXPONENT = 8.0

_OPERATORS: Mapping[str, tuple[int, Function]] = {  # precedence, meaning
    "+": (1, np.add),
    "-": (1, np.subtract),
    "*": (2, np.multiply),
    "/": (2, np.divide),
    "**": (4, np.power),
}
_SIGN, _ATOM = 3, 5  # a leading minus binds weaker than a power, stronger than a product
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    r"|(?P<sign>\*\*|[-+*/(),]))",
    re.ASCII,
)


@dataclass(frozen=True)
class Constant:
    """A number; never negative when read from a text."""

    value: float


@dataclass(frozen=True)
class Name:
    """A variable or a parameter."""

    name: str


@dataclass(frozen=True)
class Negative:
    """A leading minus."""

    operand: "Node"


@dataclass(frozen=True)
class Binary:
    """One of + - * / ** between two operands."""

    operator: str
    left_operand: "Node"
    right_operand: "Node"


@dataclass(frozen=True)
class Call:
    """One of `FUNCTIONS` with its arguments."""

    function: str
    arguments: tuple["Node", ...]


Node = Constant | Name | Negative | Binary | Call
Compiled = Callable[[Mapping[str, Number]], Number]


class Expression:
    """An expression that has been read: `text`, the `names` it uses, and its value when called."""

    def __init__(self, root: Node) -> None:
        self.root = root
        self.text = _format(root)[0]
        self.names = frozenset(node.name for node in nodes(root) if isinstance(node, Name))
        self._value = _compile(root)

    def __call__(self, values: Mapping[str, Number]) -> Number:
        """The value for numbers or arrays (N,) of every name in `names`.

        Infinite or not a number where the arithmetic is; the caller decides what that means.
        """
        with np.errstate(all="ignore"):
            return self._value(values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Expression) and self.root == other.root

    def __hash__(self) -> int:
        return hash(self.root)

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"

    def replaced(self, names: "Mapping[str, float | Expression]") -> "Expression":
        """The expression with some names replaced by finite numbers or other expressions."""
        trees = {
            name: to.root if isinstance(to, Expression) else Constant(float(to))
            for name, to in names.items()
        }
        return Expression(_replaced(self.root, trees))


def parse(text: str, names: Collection[str] = VARIABLES) -> Expression:
    """Read an expression in `names`; UnusableInput names the character (from 1) and what is wrong.

    Besides the grammar, it bounds length, nesting and exponents, so that an expression from
    anybody's file can be read and evaluated safely.
    """
    if len(text) > MOST_CHARACTERS:
        raise UnusableInput(
            f"The expression has {len(text)} characters; shorten it to {MOST_CHARACTERS}."
        )
    return Expression(_Parser(text, names).whole())


def expression_of(text: str, parameters: Collection[str]) -> Expression:
    """Read an expression in `VARIABLES` and a rig file's own parameters.

    Raises UnusableInput, also for a parameter that cannot be a name, that hides a variable or a
    function, or that the expression does not use.
    """
    for name in parameters:
        if not _IDENTIFIER.fullmatch(name) or name in VARIABLES or name in FUNCTIONS:
            raise UnusableInput(
                f"The expression's parameter {name!r} cannot be told from the rest; "
                "call it c1, c2 or the like."
            )
    expression = parse(text, (*parameters, *VARIABLES))
    unused = sorted(set(parameters) - expression.names)
    if unused:
        raise UnusableInput(f"The expression does not use its parameter {unused[0]!r}; remove it.")
    return expression


def nodes(root: Node) -> Iterator[Node]:
    """Every node of a tree, in the order of the text's operators."""
    yield root
    if isinstance(root, Negative):
        yield from nodes(root.operand)
    elif isinstance(root, Binary):
        yield from nodes(root.left_operand)
        yield from nodes(root.right_operand)
    elif isinstance(root, Call):
        for argument in root.arguments:
            yield from nodes(argument)


@dataclass(frozen=True)
class _Token:
    kind: str  # "number", "name", "sign" or "end"
    text: str
    position: int


class _Parser:
    """Recursive descent, one method per level of precedence."""

    def __init__(self, text: str, names: Collection[str]) -> None:
        self._tokens = _tokens(text)
        self._names = names
        self._next = self._nested = 0

    def whole(self) -> Node:
        root = self._sum()
        if self._peek.kind != "end":
            raise _refused(self._peek, "is not expected here; remove it")
        return root

    @property
    def _peek(self) -> _Token:
        return self._tokens[self._next]

    def _take(self) -> _Token:
        token = self._peek
        self._next = min(self._next + 1, len(self._tokens) - 1)
        return token

    def _sum(self) -> Node:
        tree = self._product()
        while self._peek.text in ("+", "-"):
            tree = Binary(self._take().text, tree, self._product())
        return tree

    def _product(self) -> Node:
        tree = self._signed()
        while self._peek.text in ("*", "/"):
            tree = Binary(self._take().text, tree, self._signed())
        return tree

    def _signed(self) -> Node:
        if self._peek.text not in ("+", "-"):
            return self._power()
        sign = self._take()
        self._nested += 1
        self._refuse_depth(sign)
        operand = self._signed()
        self._nested -= 1
        return Negative(operand) if sign.text == "-" else operand

    def _power(self) -> Node:
        base = self._atom()
        if self._peek.text != "**":
            return base
        self._take()
        start = self._peek
        exponent = self._signed()
        if not _is_small_number(exponent):
            raise _refused(
                start, f"is no exponent; write a number of at most {LARGEST_EXPONENT:g} in size"
            )
        return Binary("**", base, exponent)

    def _atom(self) -> Node:
        token = self._take()
        if token.kind == "number":
            return _constant(token)
        if token.text == "(":
            return self._inside(token)
        if token.kind != "name":
            raise _refused(token, "stands where a number or a name belongs; complete the term")
        if token.text in FUNCTIONS:
            return self._call(token)
        if token.text not in self._names:
            known = ", ".join((*self._names, *FUNCTIONS))
            raise _refused(token, f"is not known; use one of {known}")
        return Name(token.text)

    def _inside(self, opening: _Token) -> Node:
        self._nested += 1
        self._refuse_depth(opening)
        inner = self._sum()
        self._expect(")")
        self._nested -= 1
        return inner

    def _call(self, function: _Token) -> Node:
        count = FUNCTIONS[function.text][0]
        self._nested += 1
        self._refuse_depth(function)
        self._expect("(")
        arguments = [self._sum()]
        for _ in range(count - 1):
            self._expect(",")
            arguments.append(self._sum())
        self._expect(")")
        self._nested -= 1
        return Call(function.text, tuple(arguments))

    def _expect(self, text: str) -> None:
        token = self._take()
        if token.text != text:
            raise _refused(token, f"stands where {text!r} belongs; write that")

    def _refuse_depth(self, token: _Token) -> None:
        if self._nested > MOST_NESTED:
            raise _refused(token, f"is nested deeper than {MOST_NESTED} levels; simplify it")


def _tokens(text: str) -> list[_Token]:
    found: list[_Token] = []
    position, end = 0, len(text.rstrip())
    while position < end:
        match = _TOKEN.match(text, position)
        if match is None or match.lastgroup is None:
            position += len(text[position:]) - len(text[position:].lstrip())
            raise _refused(_Token("sign", text[position], position), "is not arithmetic; remove it")
        kind = match.lastgroup
        found.append(_Token(kind, match[kind], match.start(kind)))
        position = match.end()
        if len(found) > MOST_TOKENS:
            raise _refused(found[-1], f"comes after {MOST_TOKENS} others; shorten the expression")
    return [*found, _Token("end", "", end)]


def _constant(token: _Token) -> Constant:
    value = float(token.text)
    if not np.isfinite(value):
        raise _refused(token, "is too large a number; write one below 1e308")
    return Constant(value)


def _is_small_number(node: Node) -> bool:
    if isinstance(node, Negative):
        node = node.operand
    return isinstance(node, Constant) and abs(node.value) <= LARGEST_EXPONENT


def _refused(token: _Token, what: str) -> UnusableInput:
    shown = repr(token.text) if token.kind != "end" else "the end"
    return UnusableInput(f"The expression, character {token.position + 1}: {shown} {what}.")


def _compile(node: Node) -> Compiled:
    """The tree as nested closures over numpy's functions; nothing of the text survives in it."""
    if isinstance(node, Constant):
        value = node.value
        return lambda values: value
    if isinstance(node, Name):
        name = node.name
        return lambda values: values[name]
    if isinstance(node, Negative):
        operand = _compile(node.operand)
        return lambda values: np.negative(operand(values))
    parts = node.arguments if isinstance(node, Call) else (node.left_operand, node.right_operand)
    table = FUNCTIONS[node.function] if isinstance(node, Call) else _OPERATORS[node.operator]
    return _applied(table[1], [_compile(part) for part in parts])


def _applied(function: Function, arguments: list[Compiled]) -> Compiled:
    if len(arguments) == 1:
        only = arguments[0]
        return lambda values: function(only(values))
    first, second = arguments
    return lambda values: function(first(values), second(values))


def _format(node: Node) -> tuple[str, int]:
    """The text of a tree and how strongly its outermost operator binds."""
    if isinstance(node, Constant):
        if node.value < 0:
            return _format(Negative(Constant(-node.value)))
        return repr(node.value).removesuffix(".0"), _ATOM
    if isinstance(node, Name):
        return node.name, _ATOM
    if isinstance(node, Call):
        inner = ", ".join(_format(argument)[0] for argument in node.arguments)
        return f"{node.function}({inner})", _ATOM
    if isinstance(node, Negative):
        return f"-{_bracketed(node.operand, _SIGN)}", _SIGN
    strength = _OPERATORS[node.operator][0]
    if node.operator == "**":  # to the right of it even a sign needs no brackets
        return (
            f"{_bracketed(node.left_operand, _ATOM)}**{_bracketed(node.right_operand, _SIGN)}",
            strength,
        )
    space = " " if strength == 1 else ""
    left_text, right_text = (
        _bracketed(node.left_operand, strength),
        _bracketed(node.right_operand, strength + 1),
    )
    return f"{left_text}{space}{node.operator}{space}{right_text}", strength


def _bracketed(node: Node, least: int) -> str:
    text, strength = _format(node)
    return text if strength >= least else f"({text})"


def _replaced(node: Node, trees: Mapping[str, Node]) -> Node:
    """A tree with names replaced and every number's sign in front of it."""
    if isinstance(node, Constant):
        return Negative(Constant(-node.value)) if node.value < 0 else Constant(abs(node.value))
    if isinstance(node, Name):
        return _replaced(trees[node.name], {}) if node.name in trees else node
    if isinstance(node, Negative):
        return Negative(_replaced(node.operand, trees))
    if isinstance(node, Binary):
        left_operand, right_operand = (
            _replaced(part, trees) for part in (node.left_operand, node.right_operand)
        )
        return Binary(node.operator, left_operand, right_operand)
    return Call(node.function, tuple(_replaced(part, trees) for part in node.arguments))
