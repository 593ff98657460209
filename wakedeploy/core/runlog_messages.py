"""A tick of a run as messages: one a topic, JSON, in the form that viewers of logs plot directly.

Foxglove reads no schema in which a value may be of two types, and PlotJuggler needs one for each
topic. So every property has one type, and what is missing is left out.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from wakedeploy.core.runlog_columns import COLUMN, MODES, TOPICS, Column, Value, plain_value

ENCODING, SCHEMA_ENCODING = "json", "jsonschema"
_ENCODE = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode
_CLOSING = list(TOPICS)[-1]
_COLUMNS = {topic: tuple(COLUMN[name] for name in names) for topic, names in TOPICS.items()}


def schema_name(topic: str) -> str:
    """The name of a topic's schema: `wakedeploy.height`."""
    return f"wakedeploy.{topic.removeprefix('/')}"


def message_schema(topic: str, further: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The JSON schema of a topic's messages; `further` has units of numbers that are no columns."""
    properties = {column.name: _property(column) for column in _COLUMNS[topic]}
    for name, unit in (further or {}).items():
        properties[name] = {"type": "number", "description": f"in {unit}"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": schema_name(topic),
        "type": "object",
        "properties": properties,
    }


def _property(column: Column) -> dict[str, Any]:
    schema: dict[str, Any] = {"type": "string" if column.kind == "text" else column.kind}
    if column.unit:
        schema["description"] = f"in {column.unit}"
    if column.name == "mode":
        schema["enum"] = list(MODES)
    return schema


def tick_messages(row: Mapping[str, Value]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Topic and values of each group that has a value in this tick; `/state` always, and last."""
    for topic, columns in _COLUMNS.items():
        if (values := _values(columns, row)) or topic == _CLOSING:
            yield topic, values


def json_bytes(content: Mapping[str, Any]) -> bytes:
    """A message or a schema as it is sent and written; ValueError for what JSON cannot say."""
    return _ENCODE(content).encode()


def _values(columns: tuple[Column, ...], row: Mapping[str, Value]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for column in columns:
        if (value := row.get(column.name)) is not None and value == value:
            values[column.name] = plain_value(column, value)
    return values
