"""Run logs as MCAP: written while the loop runs, readable up to the last flush whatever happens.

The library's default chunk is a megabyte, which a killed run would lose; here a chunk is closed
and handed to the operating system at least twice a second.
"""

import io
import os
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC, Writer

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import json_of, write_whole
from wakedeploy.core.runlog_columns import (
    COLUMN,
    EXTRA,
    SCHEMA,
    TOPICS,
    Table,
    Value,
    refuse_unknown,
)
from wakedeploy.core.runlog_messages import (
    ENCODING,
    SCHEMA_ENCODING,
    json_bytes,
    message_schema,
    schema_name,
    tick_messages,
)
from wakedeploy.core.version import VERSION

_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, times of log and publication [ns]
CHUNK_NS = 500_000_000
_MOST_BYTES = 256 << 20  # of ticks, unpacked: three hours
_MOST_PACKED = 100  # times that chunks may be larger than the file; a log packs by 8
_OLD_SCHEMA = "wakedeploy.run"  # until schema 2: one message a tick, which had all columns
_CLOSING_SCHEMA = schema_name(list(TOPICS)[-1])  # of the message that ends a tick
_SCHEMAS = {_OLD_SCHEMA, *map(schema_name, TOPICS)}
_METADATA_NAME = "wakedeploy.run"
_END_NAME = "wakedeploy.end"
_EXTRA_NAMES = "extra_columns"


class RunLogWriter:
    """Writes a run tick by tick; what was flushed stays readable when the process is killed.

    Any method may raise OSError (a full disk); the file then holds everything up to there, and
    `abandon()` closes it.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("wb")
        self._writer: Any = Writer(self._file, enable_data_crcs=True)  # its methods have no types
        self._chunk_start_ns: int | None = None
        self._sequence = 0
        self._extra: set[str] = set()  # those of the extra columns that were given, if only as None
        self.flushed = 0  # ticks that the operating system has
        try:
            self._channels = self._begun(metadata)
        except OSError:
            self.abandon()
            raise

    def _begun(self, metadata: Mapping[str, str]) -> dict[str, int]:
        """Write what comes before the first tick; the number of each topic's channel."""
        self._writer.start(library=f"wakedeploy {VERSION}")
        self._writer.add_metadata(_METADATA_NAME, {"schema": str(SCHEMA)} | dict(metadata))
        channels = {topic: self._channel(topic) for topic in TOPICS}
        self._file.flush()
        return channels

    def _channel(self, topic: str) -> int:
        schema = json_bytes(message_schema(topic))
        number = self._writer.register_schema(schema_name(topic), SCHEMA_ENCODING, schema)
        channel: int = self._writer.register_channel(topic, ENCODING, number)
        return channel

    def write(self, row: Mapping[str, Value], log_time_ns: int) -> None:
        """Add one tick; an absent key is a missing value, one that is no column a ValueError."""
        refuse_unknown(row)
        self._extra |= EXTRA & row.keys()
        for topic, values in tick_messages(row):
            channel, data = self._channels[topic], json_bytes(values)
            self._writer.add_message(channel, log_time_ns, data, log_time_ns, self._sequence)
        self._sequence += 1
        if self._chunk_start_ns is None:
            self._chunk_start_ns = log_time_ns
        elif log_time_ns - self._chunk_start_ns >= CHUNK_NS:
            self.flush()

    def flush(self) -> None:
        """Close the chunk and hand everything to the operating system."""
        self._writer.flush()
        self.flushed = self._sequence
        self._chunk_start_ns = None

    def sync(self) -> None:
        """Wait until the operating system has put it on the disk; may take long on an SD card."""
        os.fsync(self._file.fileno())

    def close(self, ending: Mapping[str, str] | None = None) -> None:
        """Finish the file; `ending` is what is only known now and joins the metadata."""
        self.flush()
        extra = {_EXTRA_NAMES: " ".join(sorted(self._extra))}
        self._writer.add_metadata(_END_NAME, dict(ending or {}) | extra)
        self._writer.finish()
        self._file.close()

    def abandon(self) -> None:
        """Let go of the file as it is, after an error."""
        try:
            self._file.close()
        except OSError:
            self._file.raw.close()


def write_mcap(table: Table, path: Path) -> None:
    """A whole log at once; the same log gives the same bytes."""
    notes = ("unfinished", "ignored_columns")  # remarks of the reader, not of the run
    metadata = {k: v for k, v in table.metadata.items() if k not in notes}

    def fill(temporary: Path) -> None:
        writer = RunLogWriter(temporary, metadata)
        start_ns = _start_ns(table.metadata.get("started_utc", ""))
        for row in table.rows:
            writer.write(row, start_ns + round(float(row["t_s"] or 0.0) * 1e9))
        writer.close()

    write_whole(path, fill)


def _start_ns(started_utc: str) -> int:
    try:
        return round(datetime.fromisoformat(started_utc).timestamp() * 1e9)
    except ValueError:
        return 0


@dataclass
class _Found:
    """What has been read from a file so far; a tick's messages have its number."""

    ticks: dict[int, dict[str, Value]] = field(default_factory=dict)
    whole: set[int] = field(default_factory=set)
    metadata: dict[str, str] | None = None
    channels: dict[int, str] = field(default_factory=dict)
    schemas: dict[int, str] = field(default_factory=dict)
    promised: set[str] = field(default_factory=set)  # columns that it says it has
    ended: bool = False

    @property
    def rows(self) -> list[dict[str, Value]]:
        """The ticks that are whole, in their order."""
        return [row for number, row in self.ticks.items() if number in self.whole]


def read_mcap(path: Path) -> Table:
    """A log's table, as far as an unfinished file goes; UnusableInput for any other file."""
    found = _Found()
    problem = _read_into(found, path)
    if found.metadata is None:
        if not _is_mcap(path):
            raise UnusableInput(
                f"{path}: is not an MCAP run log of wakedeploy; name what --log has recorded "
                "(.mcap), or what `wakedeploy log export` made of it (.csv)."
            )
        if problem is not None:
            raise UnusableInput(
                f"{path}: is cut or damaged before its first tick; copy it again from where it was "
                "recorded."
            )
        raise UnusableInput(
            f"{path}: is an MCAP file, and no run log of wakedeploy; name what --log has recorded."
        )
    _refuse_newer(found.metadata, path)
    if problem is not None and was_closed(path):
        raise UnusableInput(
            f"{path}: is damaged after {len(found.rows)} ticks ({one_line(problem)}); "
            "copy it again from where it was recorded."
        )
    metadata = {k: v for k, v in found.metadata.items() if k != "schema"}
    if not found.ended:
        metadata["unfinished"] = (
            "the recording was cut off; everything up to its last flush is here"
        )
    return Table(_names(found), found.rows, metadata)


def _is_mcap(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC


def _names(found: _Found) -> list[str]:
    """The columns that a file has: those of its messages, and what its schemas promise of any."""
    given = set().union(*found.rows)
    if not given and not found.promised:  # an old file without a tick
        return list(COLUMN)
    known = [name for name in COLUMN if name in given | found.promised]
    return [*known, *sorted(given - COLUMN.keys())]


def _read_into(found: _Found, path: Path) -> Exception | None:
    """Read records until the end or the first that cannot be read; that problem is returned."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UnusableInput(f"{path}: cannot be read ({one_line(error)}).") from error
    try:
        size = max(len(content), 1)
        room = min(_MOST_BYTES, _MOST_PACKED * size)
        for record in records(io.BytesIO(content), size, room):
            _take(found, record)
    # Decompressor, decoder and record parser share no base class; all mean: no further than this.
    except Exception as error:
        return error
    return None


def records(file: IO[bytes], size: int, room: int) -> Iterator[McapRecord]:
    """The records of a file of `size` bytes and those in its chunks, of which at most `room` bytes.

    The library would take whatever memory a chunk asks for. Raises whatever it and the
    decompressors raise for what is damaged, ValueError for what takes more room.
    """
    reader = StreamReader(
        file, emit_chunks=True, validate_crcs=True, record_size_limit=max(size, 1)
    )
    for record in reader.records:
        if isinstance(record, Chunk):
            plain = _unpacked(record, min(room, _MOST_BYTES))
            room -= len(plain)
            yield from _inside(plain)
        else:
            yield record


def _unpacked(chunk: Chunk, room: int) -> bytes:
    """The bytes of a chunk; ValueError for more than `room`, or for others than were written."""
    plain: bytes = chunk.data
    if chunk.compression == "zstd":
        plain = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(room + 1)
    elif chunk.compression == "lz4":
        plain = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=room + 1)
    elif chunk.compression:
        raise ValueError(f"a chunk is packed by {chunk.compression!r}")
    if len(plain) > room:
        raise ValueError("it unpacks to more than a log holds")
    if chunk.uncompressed_crc not in (0, zlib.crc32(plain)):
        raise ValueError("the sum of a chunk does not fit its bytes")
    return plain


def _inside(plain: bytes) -> Iterator[McapRecord]:
    """The schemas, channels and messages of a chunk; ValueError for one that is cut or empty."""
    at = 0
    while at < len(plain):
        kind, length = struct.unpack_from("<BQ", plain, at)
        content = plain[at + 9 : at + 9 + length]
        if kind == 0 or len(content) < length:
            raise ValueError("a chunk ends within a record")
        if kind == Opcode.MESSAGE:
            yield _message_record(content)
        elif kind == Opcode.SCHEMA:
            yield Schema.read(ReadDataStream(io.BytesIO(content)))
        elif kind == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(io.BytesIO(content)))
        at += 9 + length


def _message_record(content: bytes) -> Message:
    """What `Message.read` gives, in a quarter of its time; a log has two hundred a second."""
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
    return Message(
        channel_id=channel,
        sequence=sequence,
        log_time=log_time,
        publish_time=publish_time,
        data=content[_MESSAGE.size :],
    )


def _take(found: _Found, record: object) -> None:
    if isinstance(record, Metadata) and record.name == _METADATA_NAME:
        found.metadata = dict(record.metadata)
    elif isinstance(record, Metadata) and record.name == _END_NAME:
        ending = dict(record.metadata)
        found.promised |= EXTRA & set(ending.pop(_EXTRA_NAMES, "").split())
        found.metadata = (found.metadata or {}) | ending
        found.ended = True
    elif isinstance(record, Schema) and record.name in _SCHEMAS:
        found.schemas[record.id] = record.name
        if record.name != _OLD_SCHEMA:
            found.promised |= _promised(record.data)
    elif isinstance(record, Channel) and record.schema_id in found.schemas:
        found.channels[record.id] = found.schemas[record.schema_id]
    elif isinstance(record, Message) and record.channel_id in found.channels:
        _take_message(found, record, found.channels[record.channel_id])


def _promised(schema: bytes) -> set[str]:
    """The columns that are always there, of those in a topic's schema."""
    properties = _message(schema).get("properties")
    return set(properties) - EXTRA if isinstance(properties, dict) else set()


def _take_message(found: _Found, message: Message, schema: str) -> None:
    values = _message(message.data)
    if schema == _OLD_SCHEMA:
        number = len(found.ticks)
        found.ticks[number] = values
    else:
        number = message.sequence
        found.ticks.setdefault(number, {}).update(values)
    if schema in (_OLD_SCHEMA, _CLOSING_SCHEMA):
        found.whole.add(number)


def _message(data: bytes) -> dict[str, Value]:
    row = json_of(data)
    if not isinstance(row, dict):
        raise ValueError("a tick that is no JSON object")
    return row


def _refuse_newer(metadata: Mapping[str, str], path: Path) -> None:
    schema = metadata.get("schema", "")
    if not re.fullmatch("[0-9]{1,9}", schema) or int(schema) > SCHEMA:
        raise UnusableInput(
            f"{path}: run log schema {schema!r} is not one this wakedeploy reads ({SCHEMA}); "
            "upgrade it."
        )


def was_closed(path: Path) -> bool:
    """Whether the file has its proper end, so that a fault inside is damage, not a cut."""
    with path.open("rb") as handle:
        handle.seek(0, os.SEEK_END)
        handle.seek(max(0, handle.tell() - len(MCAP0_MAGIC)))
        return handle.read() == MCAP0_MAGIC
