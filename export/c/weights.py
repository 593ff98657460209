"""How weights lie in flash: packed for the loop that reads them, as float32, float16 or int8.

A matrix is stored by blocks of eight rows, the eight weights of a column beside each other: a
block needs each input once and keeps eight sums in registers. A sparse one is stored by its
entries. Biases, gains and the small tables that other operators read stay float32, and so do
matrices that rounding would cost too much (`Matrix.kept`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from export.c.values import literals
from wakedeploy.core.manifest import FloatArray

Kind = Literal["float32", "float16", "int8"]
BLOCK = 8  # rows
_SPARSE = 0.4  # of entries: below, two bytes of column number per entry cost less than the zeros
_WORTH = 1024  # entries
STEPS_OF_INT8 = 127
BYTES: dict[Kind, int] = {"float32": 4, "float16": 2, "int8": 1}
_TYPES: dict[Kind, str] = {"float32": "float", "float16": "uint16_t", "int8": "int8_t"}
_WIDTH, _INDENT = 100, "   "


@dataclass(frozen=True, eq=False)
class Matrix:
    """Weights (outputs, inputs) with the name that they have in C.

    `tensor` is their name in the graph, where they lie by outputs or, turned, by inputs. One that
    `drives` a reservoir leads into it; `integers` (outputs, inputs) are those of int8 where others
    than the nearest have been chosen.
    """

    name: str
    weights: FloatArray
    tensor: str = ""
    is_by_outputs: bool = True
    drives: bool = False
    integers: npt.NDArray[np.int8] | None = None

    @property
    def is_sparse(self) -> bool:
        """Whether it is stored by its entries."""
        return is_sparse(self.weights)

    def kept(self, kind: Kind) -> Kind:
        """How its weights are kept where others are kept as `kind`.

        A matrix of a few rows is a readout: little flash, and a reservoir's is a difference of
        large terms, which eight bits do not hold. Nor do they hold what drives a reservoir, whose
        readout has been solved for exactly these echoes.
        """
        is_exact = len(self.weights) < BLOCK or (self.drives and kind == "int8")
        return "float32" if is_exact else kind

    def scales(self, kind: Kind) -> FloatArray:
        """What an integer of each row stands for (outputs,); ones for floats."""
        largest = np.abs(self.weights).max(axis=1)  # (outputs,)
        if self.kept(kind) != "int8":
            return np.ones_like(largest)
        return np.where(largest > 0.0, largest / np.float32(STEPS_OF_INT8), np.float32(1.0))

    def stored(self, kind: Kind) -> npt.NDArray[np.generic]:
        """The numbers as they are kept (outputs, inputs)."""
        kind = self.kept(kind)
        if kind == "int8" and self.integers is not None:
            return self.integers
        if kind == "int8":
            return np.asarray(np.rint(self.weights / self.scales(kind)[:, None]), np.int8)
        if kind == "float16":
            return np.asarray(self.weights.clip(-65504.0, 65504.0), np.float16)
        return self.weights

    def rounded(self, kind: Kind) -> npt.NDArray[np.float64]:
        """What the kept numbers stand for (outputs, inputs)."""
        kept = self.stored(kind).astype(np.float64)
        return kept * self.scales(kind).astype(np.float64)[:, None]

    def call(self, kind: Kind, x: str, bias: str, y: str) -> str:
        """The statement that multiplies `x` by it, adds `bias` (a pointer or 0) into `y`."""
        outputs, inputs = self.weights.shape
        if self.kept(kind) != kind:
            return f"few({self.name}, {bias}, {x}, {y}, {inputs}, {outputs});"
        scale = f", {self.name}_scale" if kind == "int8" else ""
        if self.is_sparse:
            places = f"{self.name}_columns, {self.name}_counts"
            return f"sparse({self.name}{scale}, {places}, {bias}, {x}, {y}, {outputs});"
        return f"dense({self.name}{scale}, {bias}, {x}, {y}, {inputs}, {outputs});"

    def declarations(self, kind: Kind) -> Iterator[str]:
        """Its constants, as C."""
        outputs, inputs = self.weights.shape
        in_blocks = self.kept(kind) == kind
        kind = self.kept(kind)
        kept, what = self.stored(kind), f"{outputs} x {inputs}"
        if self.is_sparse:
            rows, columns = np.nonzero(self.weights)  # by rows
            counts = np.bincount(rows, minlength=outputs)
            what += f", {len(rows)} entries that are not 0, by rows"
            yield _array(f"{self.name}[{len(rows)}]", kind, kept[rows, columns], what)
            yield _whole_numbers(f"{self.name}_columns[{len(rows)}]", "uint16_t", columns)
            yield _whole_numbers(f"{self.name}_counts[{outputs}]", "uint16_t", counts)
        else:
            packed = blocks(kept) if in_blocks else kept.ravel()
            yield _array(f"{self.name}[{outputs * inputs}]", kind, packed, what)
        if kind == "int8":
            yield constants(f"{self.name}_scale[{outputs}]", self.scales(kind))

    def flash_bytes(self, kind: Kind) -> int:
        """What its constants take."""
        outputs, inputs = map(int, self.weights.shape)
        kind = self.kept(kind)
        scale = 4 * outputs if kind == "int8" else 0
        if not self.is_sparse:
            return BYTES[kind] * outputs * inputs + scale
        entries = int(np.count_nonzero(self.weights))
        return (BYTES[kind] + 2) * entries + 2 * outputs + scale


def is_sparse(weights: FloatArray) -> bool:
    """Whether weights (outputs, inputs) take less flash by their entries: those of a reservoir."""
    entries = np.count_nonzero(weights)
    fits = weights.shape[1] <= 1 << 16 and len(weights) >= BLOCK
    return bool(weights.size >= _WORTH and fits and entries < _SPARSE * weights.size)


def blocks(kept: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """The order in flash of a matrix (outputs, inputs): whole blocks, then the rows left over."""
    whole = len(kept) // BLOCK * BLOCK
    packed = kept[:whole].reshape(-1, BLOCK, kept.shape[1]).transpose(0, 2, 1)
    return np.concatenate([packed.ravel(), kept[whole:].ravel()])


def constants(declared: str, values: FloatArray) -> str:
    """A constant array of float32."""
    return _filled(f"static const FLASH float {declared}", literals(values))


def _array(declared: str, kind: Kind, kept: npt.NDArray[np.generic], what: str) -> str:
    if kind == "float32":
        numbers = literals(kept)
    elif kind == "float16":
        numbers = [str(v) for v in kept.view(np.uint16)]
    else:
        numbers = [str(v) for v in kept]
    return f"/* {what} */\n" + _filled(f"static const FLASH {_TYPES[kind]} {declared}", numbers)


def _whole_numbers(declared: str, kind: str, values: npt.NDArray[np.generic]) -> str:
    return _filled(f"static const FLASH {kind} {declared}", [str(v) for v in values])


def _filled(declaration: str, numbers: Sequence[str]) -> str:
    lines, first, width = [f"{declaration} = {{"], 0, len(_INDENT)
    for place, number in enumerate(numbers):
        if width + len(number) + 2 > _WIDTH:
            lines.append(_line(numbers[first:place]))
            first, width = place, len(_INDENT)
        width += len(number) + 2
    return "\n".join([*lines, _line(numbers[first:]), "};"])


def _line(numbers: Sequence[str]) -> str:
    return _INDENT + "".join([f" {number}," for number in numbers])
