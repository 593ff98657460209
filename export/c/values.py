"""What a tensor is while C is written: numbers in memory, or an expression not yet computed.

A step serves one series, so that the batch axis has length 1 everywhere. Shapes are those of the
graph; axes of length 1 take no loop.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from wakedeploy.core.onnx_graph import Shape

LOOP_VARIABLES = "ijklmn"
_LONGEST = 16  # characters of a number that is written without an exponent
# What each element of an expression becomes; tanh and the like are those of <math.h>.
FORMS = {
    "Add": "{} + {}",
    "Sub": "{} - {}",
    "Mul": "{} * {}",
    "Div": "{} / {}",
    "Greater": "{} > {}",
    "Where": "{} ? {} : {}",
    "Exp": "expf({})",
    "Reciprocal": "1.0f / {}",
    "Relu": "{0} < 0.0f ? 0.0f : {0}",  # what is no number stays none
    "Sigmoid": "sigmoid({})",
    "Softplus": "softplus({})",
    "Sqrt": "sqrtf({})",
    "Tanh": "tanhf({})",
}


@dataclass(frozen=True)
class Index:
    """A place along an axis: a sum of loop variables, each times a whole number, and an offset."""

    terms: tuple[tuple[str, int], ...] = ()
    offset: int = 0

    def __add__(self, other: "Index") -> "Index":
        sums = dict(self.terms)
        for name, factor in other.terms:
            sums[name] = sums.get(name, 0) + factor
        return Index(tuple(sums.items()), self.offset + other.offset)

    def times(self, factor: int) -> "Index":
        """The same, scaled."""
        return Index(tuple((n, f * factor) for n, f in self.terms), self.offset * factor)

    def __str__(self) -> str:
        parts = [name if factor == 1 else f"{name} * {factor}" for name, factor in self.terms]
        if self.offset or not parts:
            parts.append(str(self.offset))
        return " + ".join(parts)


@dataclass(frozen=True, eq=False)
class Store:
    """Room for float32 numbers: a variable of the step, a member of the state, or a constant.

    `name` is what C calls it; a variable's is settled once it is known who needs room when.
    `is_variable` says that the numbers are those of one step only.
    """

    name: str
    size: int
    is_variable: bool = True


@dataclass(frozen=True, eq=False)
class Buffer:
    """A tensor in memory: where its elements lie in a store. Strides are in elements."""

    store: Store
    shape: Shape
    strides: Shape
    offset: int = 0

    def at(self, indices: Sequence[Index]) -> str:
        """The element at these indices, one for each axis."""
        place = Index((), self.offset)
        for index, stride, length in zip(indices, self.strides, self.shape, strict=True):
            if length > 1:
                place = place + index.times(stride)
        return f"{token(self.store)}[{place}]"

    @property
    def is_contiguous(self) -> bool:
        """Whether the elements lie one after the other, in row-major order."""
        expected = row_major(self.shape)
        axes = zip(self.shape, self.strides, expected, strict=True)
        return all(length == 1 or size == other for length, size, other in axes)

    @property
    def start(self) -> str:
        """A pointer to the first element."""
        return token(self.store) + (f" + {self.offset}" if self.offset else "")


@dataclass(frozen=True, eq=False)
class Number:
    """A constant that is written where it is used."""

    value: float
    shape: Shape = ()


@dataclass(frozen=True, eq=False)
class Computed:
    """An expression for every element of a shape, from elements at the same place.

    `form` has a place for each operand. `name` is what a loop calls it.
    """

    name: str
    form: str
    operands: "tuple[Value, ...]"
    shape: Shape
    uses: int = field(default=1)  # how many nodes of the graph, outputs among them, take it


Value = Buffer | Number | Computed


def token(store: Store) -> str:
    """What stands for a store's name in text until that is settled."""
    return f"\x01{store.name}\x02" if store.is_variable else store.name


def row_major(shape: Shape) -> Shape:
    """Strides of elements that lie one after the other."""
    return tuple(math.prod(shape[axis + 1 :]) for axis in range(len(shape)))


def whole(store: Store, shape: Shape) -> Buffer:
    """A tensor that fills its store."""
    return Buffer(store, shape, row_major(shape))


def same_but_units(first: Shape, other: Shape) -> bool:
    """Whether two shapes differ at most by axes of length 1."""
    return [n for n in first if n > 1] == [n for n in other if n > 1]


def literal(value: float) -> str:
    """A float32 as C writes it, the same to the last bit."""
    text = np.format_float_positional(np.float32(value), unique=True, trim="0")
    if len(text) > _LONGEST:
        text = np.format_float_scientific(np.float32(value), unique=True, trim="0")
    return f"{text}f"


def literals(values: npt.NDArray[np.generic]) -> list[str]:
    """The same of many values. NumPy writes most of them so by itself, all at once and sooner."""
    numbers = np.asarray(values, np.float32).ravel()
    return [
        f"{text}f" if len(text) <= _LONGEST and "e" not in text else literal(value)
        for text, value in zip(numbers.astype(str).tolist(), numbers.tolist(), strict=True)
    ]


def loop_axes(shape: Shape) -> tuple[list[Index], list[tuple[str, int]]]:
    """An index for every axis, and the loops over those longer than 1: variable and length."""
    indices: list[Index] = []
    loops: list[tuple[str, int]] = []
    for length in shape:
        if length == 1:
            indices.append(Index())
            continue
        name = LOOP_VARIABLES[len(loops)]
        loops.append((name, length))
        indices.append(Index(((name, 1),)))
    return indices, loops
