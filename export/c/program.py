"""What a step does, in order, and the memory that it needs for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from export.c.values import Store, token
from export.c.weights import Kind, Matrix
from wakedeploy.core.manifest import FloatArray


@dataclass(frozen=True, eq=False)
class Statement:
    """Some lines of C that belong together, and the stores that they read and write.

    `in_step` are pairs of a store that is read and one that is written. Each element is read before
    the element at the same place is written, so both may be the same memory.
    """

    lines: tuple[str, ...]
    reads: frozenset[Store]
    writes: frozenset[Store]
    in_step: frozenset[tuple[Store, Store]] = frozenset()


@dataclass(frozen=True)
class StateMember:
    """A member of the state: an array of float with its initial values, or a counter at 0."""

    name: str
    size: int = 0  # 0: a counter
    initial: FloatArray | None = None  # (size,); None: zeros
    what: str = ""


@dataclass(frozen=True)
class Program:
    """A step as C: statements, and whatever they name."""

    statements: tuple[Statement, ...]
    members: tuple[StateMember, ...]
    matrices: tuple[Matrix, ...]
    tables: Mapping[str, FloatArray]
    rooms: Mapping[str, int] = field(default_factory=dict)  # sizes, in float
    places: Mapping[Store, str] = field(default_factory=dict)  # the room of each variable

    @property
    def state_bytes(self) -> int:
        """What the state takes."""
        return sum(4 * (member.size or 1) for member in self.members) or 4

    @property
    def room_bytes(self) -> int:
        """What a step takes of the stack for its arrays."""
        return 4 * sum(self.rooms.values())

    def weight_bytes(self, kind: Kind) -> int:
        """What its constants take in flash."""
        tables = sum(4 * values.size for values in self.tables.values())
        return tables + sum(matrix.flash_bytes(kind) for matrix in self.matrices)


def settled(
    statements: Sequence[Statement],
    states: Mapping[Store, Store],
) -> tuple[list[Statement], dict[Store, str]]:
    """Where next states may overwrite the present ones; the others are copied at the end.

    `states` maps the store of each next state to that of the present one. Out: all statements, and
    the C names of the stores that are one with a state.
    """
    named: dict[Store, str] = {}
    closing: list[Statement] = []
    for following, present in states.items():
        writer = max(i for i, statement in enumerate(statements) if following in statement.writes)
        first = min(i for i, statement in enumerate(statements) if following in statement.writes)
        late = any(present in statement.reads for statement in statements[writer + 1 :])
        writing = statements[writer]
        is_safe = present not in writing.reads or (present, following) in writing.in_step
        if first == writer and is_safe and not late:
            named[following] = present.name
            continue
        line = f"for (int i = 0; i < {present.size}; ++i) {{"
        copy = f"    {present.name}[i] = {token(following)}[i];"
        closing.append(Statement((line, copy, "}"), frozenset({following}), frozenset({present})))
    return [*statements, *closing], named


def with_rooms(
    statements: Sequence[Statement], named: Mapping[Store, str]
) -> tuple[dict[str, int], dict[Store, str]]:
    """Rooms for the variables, shared by those that are not needed at the same time.

    Out: sizes of the rooms by name, and the room of each store.
    """
    last: dict[Store, int] = {}
    for number, statement in enumerate(statements):
        for store in (*statement.reads, *statement.writes):
            last[store] = number
    sizes: list[int] = []
    free: list[int] = []
    held: dict[Store, int] = {}
    placed: dict[Store, int] = {}
    for number, statement in enumerate(statements):
        free += [held.pop(store) for store in list(held) if last[store] < number]
        for store in sorted(statement.writes, key=lambda s: (-s.size, s.name)):
            if not store.is_variable or store in named or store in placed:
                continue
            given = [s for s in held if last[s] == number and (s, store) in statement.in_step]
            free += [held.pop(s) for s in given]
            room = _fitting(free, sizes, store.size)
            sizes[room] = max(sizes[room], store.size)
            held[store] = placed[store] = room
    alone = {room for room in placed.values() if list(placed.values()).count(room) == 1}
    names = {room: store.name for store, room in placed.items() if room in alone}
    called = [names.get(room, f"room_{room}") for room in range(len(sizes))]
    rooms = dict(zip(called, sizes, strict=True))
    return rooms, {store: called[room] for store, room in placed.items()}


def _fitting(free: list[int], sizes: list[int], size: int) -> int:
    """The free room that fits best; the largest is made larger, or there is a new one."""
    if not free:
        sizes.append(size)
        return len(sizes) - 1
    enough = [room for room in free if sizes[room] >= size]
    room = min(enough, key=sizes.__getitem__) if enough else max(free, key=sizes.__getitem__)
    free.remove(room)
    return room
