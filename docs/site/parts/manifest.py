"""What a package states about itself, with the bounds that a reader enforces."""

from collections.abc import Iterator, Mapping
from typing import Any

from parts.markdown import plain, table
from wakedeploy.core.manifest import Manifest

_OF_NUMBERS = {
    "exclusiveMinimum": "above {}",
    "minimum": "from {}",
    "exclusiveMaximum": "below {}",
    "maximum": "to {}",
    "minItems": "from {}",
    "maxItems": "to {} entries",
    "maxProperties": "to {} entries",
    "maxLength": "to {} letters",
}
MEANINGS = {
    "schema": "the version of this description",
    "arch": "the architecture's name",
    "hyper": "its hyper-parameters, each a number, a short text, true, false or null",
    "domain": "the set that it learned from",
    "rate_hz": "steps per second; the loop refuses another rate",
    "lead_s": "how far ahead of the newest observation the force is",
    "observation": "the inputs in their order: name, unit, range in training, how filtered",
    "force": "the outputs in their order: name, unit, range in training",
    "memory": "what it remembers from step to step",
    "warm_up_steps": "the step from a cold start, counted from 1, whose force is the first that "
    "counts: its window is full, the first without a memory, and where errors begin of one that is "
    "carried on",
    "trainable": "trained weights",
    "frozen": "weights that stayed as they were drawn, as a reservoir's",
    "data_sha256": "the hash of the episode set",
    "seed": "of the training",
    "test": "errors on the test episodes",
    "parity": "the exported graph beside the training-time forward",
    "versions": "of the libraries that made it",
    "graph_sha256": "the hash of everything but this description",
}


def markdown() -> str:
    """A table of the description itself, then one of each part."""
    schema = Manifest.model_json_schema()
    return "\n\n".join((_table(schema, MEANINGS), *_parts(schema["$defs"])))


def _parts(parts: Mapping[str, Any]) -> Iterator[str]:
    for name, one in parts.items():
        if "properties" in one:
            words = [plain(part) for part in one.get("description", "").split("\n\n")]
            yield "\n\n".join((f"### {name}", *words, _table(one, {})))


def _table(schema: Mapping[str, Any], meanings: Mapping[str, str]) -> str:
    head = ["Field", "Kind", "Bounds"] + (["What"] if meanings else [])
    rows = (
        [f"`{name}`", _kind(field), _bounds(field) or "–"] + ([meanings[name]] if meanings else [])
        for name, field in schema["properties"].items()
    )
    return table(head, rows)


def _kind(field: Mapping[str, Any]) -> str:
    if "anyOf" in field:
        return " or ".join(dict.fromkeys(_kind(one) for one in field["anyOf"]))
    if "$ref" in field:
        return str(field["$ref"]).rpartition("/")[2]
    if "enum" in field or "const" in field:
        return ", ".join(f"`{one}`" for one in field.get("enum", [field.get("const")]))
    return _of_kind(field)


def _of_kind(field: Mapping[str, Any]) -> str:
    kind = str(field.get("type", "any"))
    if kind == "array":
        return f"list of {_kind(field['items'])}" if "items" in field else "list"
    if kind == "object" and isinstance(field.get("additionalProperties"), dict):
        return f"{_kind(field['additionalProperties'])} by name"
    return kind


def _bounds(field: Mapping[str, Any]) -> str:
    own = [words.format(_number(field[key])) for key, words in _OF_NUMBERS.items() if key in field]
    inner = [_bounds(one) for one in field.get("anyOf", ())]
    if "pattern" in field and "maxLength" not in field:
        own.append(f"`{field['pattern']}`")
    return " ".join(dict.fromkeys(filter(None, (*own, *inner))))


def _number(value: float) -> str:
    whole = isinstance(value, int) and value < 10**9
    return f"{value:,}" if whole else f"{value:g}"
