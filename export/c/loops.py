"""One nest of loops in C: what it computes at each place, and which memory it touches."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from export.c.values import (
    Buffer,
    Computed,
    Index,
    Number,
    Store,
    Value,
    literal,
    loop_axes,
    whole,
)
from wakedeploy.core.onnx_graph import Shape

_INDENT = "    "


class Loop:
    """Loops over the axes of a shape that are longer than 1; `reduced` axes are summed over.

    What lies `in_memory` already is read from there.
    """

    def __init__(
        self,
        shape: Shape,
        in_memory: Mapping[Computed, Buffer],
        reduced: Collection[int] = (),
    ) -> None:
        self.shape, self.in_memory = shape, in_memory
        self.indices, loops = loop_axes(shape)
        inner = {str(self.indices[axis]) for axis in reduced}
        self.outer = [loop for loop in loops if loop[0] not in inner]
        self.inner = [loop for loop in loops if loop[0] in inner]
        self.stored: dict[Computed, Buffer] = {}
        self._kept_axes = [axis for axis in range(len(shape)) if axis not in set(reduced)]
        self._locals: dict[Computed, str] = {}
        self._counts: Counter[Computed] = Counter()
        self._body: list[str] = []
        self._ends: list[str] = []  # of the body: what is written there
        self._after: list[str] = []  # the inner loops
        self._before: list[str] = []
        self._read: dict[Store, set[str]] = {}
        self._written: dict[Store, str] = {}

    @property
    def reads(self) -> set[Store]:
        """Stores that are read."""
        return set(self._read)

    @property
    def writes(self) -> set[Store]:
        """Stores that are written."""
        return set(self._written)

    def in_step(self) -> set[tuple[Store, Store]]:
        """Pairs of a store read and one written, always at the same place."""
        return {
            (read, written)
            for read, places in self._read.items()
            for written, place in self._written.items()
            if places == {place}
        }

    def store(self, value: Computed, target: Store) -> None:
        """Write an expression's values one after the other into a store."""
        self._count(value)
        made = whole(target, value.shape)
        text = self._text(value, self._indices_for(value.shape), is_root=True)
        self._ends.append(f"{self._write(made, value.shape)} = {text};")
        self.stored[value] = made

    def copy(self, buffer: Buffer, target: Store) -> None:
        """Write a buffer's values one after the other into a store."""
        self.copy_to(buffer, whole(target, buffer.shape))

    def copy_to(self, buffer: Buffer, target: Buffer) -> None:
        """Write a buffer's values into another of the same shape."""
        text = self._text(buffer, self.indices)
        self._ends.append(f"{self._write(target, buffer.shape)} = {text};")

    def sum(self, value: Value, target: Buffer, divisor: int) -> None:
        """Add up an expression over the inner loops; a `divisor` above 1 makes it a mean."""
        if isinstance(value, Computed):
            self._count(value)
        is_kept = isinstance(value, Computed) and value.uses > 1
        text = self._text(value, self._indices_for(self.shape), is_root=not is_kept)
        self._ends.append(f"sum += {text};")
        self._finish(target, self._kept(target.shape), divisor)

    def sum_of_products(self, first: Buffer, other: Buffer, target: Buffer) -> None:
        """(…, M, D) times (…, D, N) into (…, M, N), which is the shape of the loops."""
        depth = first.shape[-1]
        names = {name for name, _ in self.outer}
        free = next(name for name in "ijklmnpq" if name not in names)
        inner = Index(((free, 1),)) if depth > 1 else Index()
        self.inner = [(free, depth)] if depth > 1 else []
        *stack, row, column = self.indices
        left_factor = self._text(first, [*stack, row, inner])
        right_factor = self._text(other, [*stack, inner, column])
        self._ends.append(f"sum += {left_factor} * {right_factor};")
        self._finish(target, self.indices, 1)

    def needed_elsewhere(self, value: Computed, *, with_it: bool = False) -> list[Computed]:
        """Inner expressions that have other uses than those in this one; `with_it`, it as well."""
        inside = Counter[Computed]()
        _count_uses(value, self.in_memory, inside)
        return [
            line
            for line, times in inside.items()
            if (with_it or line is not value) and line.uses > times and line not in self.in_memory
        ]

    def lines(self) -> list[str]:
        """The loops as C."""
        body = [*self._body, *self._ends]
        body = [*self._before, *_nested(self.inner, body), *self._after]
        lines = _nested(self.outer, body)
        is_open = any(line.startswith(("float ", "const ")) for line in lines)
        return ["{", *(_INDENT + line for line in lines), "}"] if is_open else lines

    def _finish(self, target: Buffer, indices: Sequence[Index], divisor: int) -> None:
        self._before.append("float sum = 0.0f;")
        place = target.at(indices)
        self._written[target.store] = _place_of(place)
        share = f" / {literal(float(divisor))}" if divisor > 1 else ""
        self._after.append(f"{place} = sum{share};")

    def _kept(self, shape: Shape) -> list[Index]:
        """Indices of a reduced shape, with or without the axes that were summed over."""
        kept = [self.indices[axis] for axis in self._kept_axes]
        if len(shape) == len(kept):
            return kept
        all_axes = range(len(self.shape))
        return [self.indices[a] if a in self._kept_axes else Index() for a in all_axes]

    def _indices_for(self, shape: Shape) -> list[Index]:
        """The loops' indices for a shape that differs from theirs by axes of length 1 at most."""
        running = iter([i for i, n in zip(self.indices, self.shape, strict=True) if n > 1])
        return [next(running) if length > 1 else Index() for length in shape]

    def _write(self, made: Buffer, shape: Shape) -> str:
        place = made.at(self._indices_for(shape))
        self._written[made.store] = _place_of(place)
        return place

    def _count(self, value: Computed) -> None:
        _count_uses(value, self.in_memory, self._counts)

    def _text(
        self,
        value: Value,
        indices: Sequence[Index],
        *,
        is_operand: bool = False,
        is_root: bool = False,
    ) -> str:
        """The value at a place; what it needs is computed in the body before.

        An operand of several parts is in parentheses; a root needs no name of its own.
        """
        if isinstance(value, Number):
            text = literal(value.value)
            return f"({text})" if value.value < 0 and is_operand else text
        if isinstance(value, Computed) and value in self.in_memory:
            value = self.in_memory[value]
            indices = self._indices_for(value.shape)
        if isinstance(value, Buffer):
            text = value.at(_aligned(indices, value.shape))
            self._read.setdefault(value.store, set()).add(_place_of(text))
            return text
        if value in self._locals:
            return self._locals[value]
        return self._computed(value, is_operand, is_root)

    def _computed(self, value: Computed, is_operand: bool, is_root: bool) -> str:
        indices = self._indices_for(value.shape)
        alone = "{0}" in value.form
        parts = [self._part(operand, indices, alone) for operand in value.operands]
        if value.form.endswith("({})"):
            parts = [part[1:-1] if part.startswith("(") else part for part in parts]
        text = value.form.format(*parts)
        is_shared = self._counts[value] > 1
        is_named = value.uses > self._counts[value] or value.form.endswith("({})")
        if is_shared or (is_named and not is_root):
            self._body.append(f"const float {value.name} = {text};")
            self._locals[value] = value.name
            return value.name
        return f"({text})" if is_operand else text

    def _part(self, operand: Value, indices: Sequence[Index], alone: bool) -> str:
        """An operand; `alone`, it is used more than once and therefore has a name."""
        text = self._text(operand, indices, is_operand=True)
        if not alone or not text.startswith("(") or not isinstance(operand, Computed):
            return text
        self._body.append(f"const float {operand.name} = {text[1:-1]};")
        self._locals[operand] = operand.name
        return operand.name


def _count_uses(
    value: Computed, in_memory: Mapping[Computed, Buffer], counts: Counter[Computed]
) -> None:
    """How often each expression within one is used in it, itself once."""
    counts[value] += 1
    if counts[value] > 1 or value in in_memory:
        return
    for operand in value.operands:
        if isinstance(operand, Computed):
            _count_uses(operand, in_memory, counts)


def _aligned(indices: Sequence[Index], shape: Shape) -> list[Index]:
    """Indices of the last axes for a shape of fewer; an axis of length 1 stands still."""
    if len(shape) > len(indices):
        missing = [Index()] * (len(shape) - len(indices))
        return [*missing, *indices]
    return list(indices[len(indices) - len(shape) :])


def _place_of(text: str) -> str:
    return text[text.index("[") :]


def _nested(loops: Sequence[tuple[str, int]], body: Sequence[str]) -> list[str]:
    lines = list(body)
    for name, length in reversed(loops):
        head = f"for (int {name} = 0; {name} < {length}; ++{name}) {{"
        lines = [head, *(_INDENT + line for line in lines), "}"]
    return lines
