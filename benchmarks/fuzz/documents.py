"""Damage within documents: a value of a JSON or TOML tree replaced, moved, renamed or left out."""

import functools
import json
import random
import tomllib
from collections.abc import Callable
from typing import Any

import tomli_w

from benchmarks.fuzz.text import any_text

EXTREMES: tuple[Any, ...] = (
    float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 5e-324, -0.0, 0, 1, -1, 2, 7, 0.5,
    2**31, 2**53, 2**63 - 1, 2**63, -(2**63), 2**64, 10**9, 10**19, 10**300, -(10**400), 10**4000,
)  # fmt: skip
TEXTS = (
    "", " ", "x", "x" * 10_000, "nan", "1", "\x00", "\x1b[2J\n", "\u202e", "../../etc/passwd",
    "/dev/zero", "a/b", ".", "\ud800", "é" * 300, "{0}", "%s", "0" * 64, "f" * 64, "true", "null",
    "none", "m/s", "kg", "1e999", "٣", "²", "2020-02-30", "9" * 5000,
)  # fmt: skip
OTHERS: tuple[Any, ...] = (
    None, True, False, [], {}, [[]], [None], [1] * 1000, ["x"] * 1000, {"": {}}, {"value": 1},
    {"a": {"b": [1, {"c": None}]}}, [[1.0, 2.0], [3.0]], ["a", 1, None], {"x" * 3000: 1},
)  # fmt: skip
KEYS = ("", "x", "schema", "value", "name", "\x00", "k" * 5000, "__class__", "a.b", "\ud800", "é")


def altered(draw: random.Random, tree: Any) -> Any:
    """A tree with one to three changes somewhere in it; the given one stays as it is."""
    for _ in range(draw.choice((1, 1, 1, 2, 3))):
        tree = _changed(draw, tree, 0)
    return tree


def json_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A JSON file damaged in its tree or in its text."""
    tree = _parsed(json.loads, data) if draw.random() < 0.75 else None
    if tree is None:
        return any_text(draw, data, other)
    return as_json(altered(draw, tree))


def toml_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A TOML file damaged in its tree or in its text."""
    tree = _parsed(tomllib.loads, data) if draw.random() < 0.6 else None
    if tree is None:
        return any_text(draw, data, other)
    try:
        return tomli_w.dumps(_sayable(altered(draw, tree))).encode()
    except Exception:  # what TOML, or its writer, cannot say
        return any_text(draw, data, other)


def json_lines(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A file of JSON lines with one of them damaged, doubled, moved or left out."""
    lines = data.splitlines(keepends=True)
    if not lines or draw.random() < 0.3:
        return any_text(draw, data, other)
    at = draw.randrange(len(lines))
    lines[at] = json_file(draw, lines[at], draw.choice(lines)).strip(b"\n") + b"\n"
    return b"".join(lines)


def as_json(tree: Any) -> bytes:
    """A tree as JSON of one value a line, whatever numbers are in it."""
    return json.dumps(tree, indent=0).encode()


@functools.lru_cache(maxsize=200)
def _parsed(parse: Callable[[str], Any], data: bytes) -> Any:
    """A sound file's tree, which is parsed once; None for what is damaged already."""
    try:
        return parse(data.decode())
    except (ValueError, RecursionError):
        return None


def _changed(draw: random.Random, tree: Any, depth: int) -> Any:
    """A copy along the way to the change alone: down by chance, whatever a branch holds."""
    if isinstance(tree, dict | list) and tree and draw.random() < (0.95 if depth < 2 else 0.75):
        key = draw.choice(list(tree)) if isinstance(tree, dict) else draw.randrange(len(tree))
        copy: Any = tree.copy()
        copy[key] = _changed(draw, tree[key], depth + 1)
        return copy
    if isinstance(tree, dict) and draw.random() < 0.85:
        return _other_keys(draw, tree)
    if isinstance(tree, list) and draw.random() < 0.8:
        return _other_entries(draw, tree)
    return _other_value(draw, tree)


def _other_keys(draw: random.Random, tree: dict[str, Any]) -> dict[str, Any]:
    copy = dict(tree)
    key = draw.choice(list(copy)) if copy else ""
    way = draw.randrange(5)
    if way < 2:
        copy.pop(key, None)
    elif way == 2:
        copy[draw.choice(KEYS)] = copy.pop(key, None)
    elif way == 3:
        copy[draw.choice(KEYS)] = draw.choice((*OTHERS, *EXTREMES, copy.get(key)))
    elif copy:
        copy[key] = copy[draw.choice(list(copy))]
    return copy


def _other_entries(draw: random.Random, tree: list[Any]) -> list[Any]:
    copy = list(tree)
    at = draw.randrange(len(copy) + 1)
    way = draw.randrange(6)
    if way == 0:
        return copy[:at]
    if way == 1:
        return copy[:at] + copy[at + 1 :]
    if way == 2:
        return [*copy[:at], draw.choice((*OTHERS, *EXTREMES, *TEXTS)), *copy[at:]]
    if way == 3:
        return copy * draw.choice((2, 100))
    if way == 4:
        return copy[::-1]
    draw.shuffle(copy)
    return copy


def _other_value(draw: random.Random, value: Any) -> Any:
    """Mostly one of the same type, so that it is not refused at the door."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if draw.random() < 0.6:
        if is_number:
            near = (value * 1000, -value, value + 1, value // 3, str(value), [value])
            return draw.choice((*EXTREMES, *near))
        if isinstance(value, str):
            near = (value + "x", value[:-1], value.upper(), value * 2, [value], f" {value}")
            return draw.choice((*TEXTS, *near))
        if isinstance(value, bool):
            return not value
    return draw.choice(draw.choice((EXTREMES, TEXTS, OTHERS)))


def _sayable(tree: Any) -> Any:
    """The tree without null, which TOML does not have."""
    if isinstance(tree, dict):
        return {key: _sayable(value) for key, value in tree.items() if value is not None}
    if isinstance(tree, list):
        return [_sayable(value) for value in tree if value is not None]
    return tree
