"""MCAP: messages as JSON or of ROS; unpacked chunk by chunk, within bounds."""

import mmap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from mcap.records import Channel, Schema
from mcap.records import Message as McapMessage

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import json_of
from wakedeploy.core.runlog_mcap import records, was_closed
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats import ros
from wakedeploy.domains.tables.formats.messages import Decode, Message, MessageLog
from wakedeploy.domains.tables.log import MOST_BYTES, require_size, unreadable

_MOST_PACKED = 100  # times that chunks may be larger than the file
_ROS = {("cdr", "ros2msg"): True, ("ros1", "ros1msg"): False}


def open_log(path: Path, csv: Delimited) -> MessageLog:
    """Open an MCAP file."""
    return open_files(path, [path])


def open_files(path: Path, files: Sequence[Path]) -> MessageLog:
    """Open some MCAP files as one log, which is called `path`."""
    for file in files:
        require_size(file)
    streams = [_Stream(file) for file in files]
    topics = {topic for stream in streams for topic in stream.topics()}
    log = MessageLog(path, topics, lambda: (m for stream in streams for m in stream.messages()))
    log.notes += [stream.cut for stream in streams if stream.cut]
    return log


@dataclass
class _Stream:
    """The messages of one file."""

    path: Path
    cut: str = ""  # a note on a recording that has no end
    _schemas: dict[int, Schema] = field(default_factory=dict)
    _channels: dict[int, Channel] = field(default_factory=dict)
    _decoders: dict[int, Decode] = field(default_factory=dict)

    def topics(self) -> set[str]:
        """The topics that have messages."""
        with_messages = {record.channel_id for record in self._records()}
        return {self._channel(number).topic for number in with_messages}

    def messages(self) -> Iterator[Message]:
        """Every message, in the file's order."""
        for record in self._records():
            number = record.channel_id
            topic, stamp_ns = self._channel(number).topic, record.log_time
            yield Message(topic, stamp_ns, record.data, self._decoder(number))

    def _records(self) -> Iterator[McapMessage]:
        try:
            size = require_size(self.path)
            with self.path.open("rb") as file, _mapped(file) as content:
                for record in records(content, size, min(MOST_BYTES, _MOST_PACKED * size)):
                    if isinstance(record, Schema):
                        self._schemas[record.id] = record
                    elif isinstance(record, Channel):
                        self._channels[record.id] = record
                    elif isinstance(record, McapMessage):
                        yield record
        except OSError as error:
            raise unreadable(self.path, error) from error
        except UnusableInput:
            raise
        except Exception as error:  # decompressor and parser share no base class
            if was_closed(self.path):
                raise unreadable(self.path, error) from error
            self.cut = f"{self.path}: the recording was cut off ({one_line(error)})"

    def _channel(self, number: int) -> Channel:
        if number not in self._channels:
            raise UnusableInput(f"{self.path}: has messages of no channel; record it again.")
        return self._channels[number]

    def _decoder(self, number: int) -> Decode:
        if number not in self._decoders:
            self._decoders[number] = ros.when_needed(self._new_decoder, self._channel(number))
        return self._decoders[number]

    def _new_decoder(self, channel: Channel) -> Decode:
        if channel.message_encoding == "json":
            return json_of
        schema = self._schemas.get(channel.schema_id)
        encodings = channel.message_encoding, schema.encoding if schema else ""
        if schema is None or encodings not in _ROS:
            return _unknown(self.path, channel)
        definition = schema.data.decode("utf-8", "replace")
        return ros.decoder(self.path, schema.name, definition, _ROS[encodings])


def _mapped(file: IO[bytes]) -> Any:
    """A file as memory: of it, unlike of a file, no more is read than there is."""
    return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def _unknown(path: Path, channel: Channel) -> Callable[[bytes], object]:
    def refuse(content: bytes) -> object:
        raise UnusableInput(
            f"{path}: messages of {channel.topic} are written as {channel.message_encoding!r};"
            " JSON and ROS messages (ros2msg, ros1msg) are read."
        )

    return refuse
