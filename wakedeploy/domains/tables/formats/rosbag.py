"""rosbag2: a folder with metadata.yaml, or one of its .db3 files; MCAP ones are read as such."""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import text_of
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats import mcap, ros
from wakedeploy.domains.tables.formats.messages import Decode, Message, MessageLog
from wakedeploy.domains.tables.log import library, require_size, unreadable

_COMPRESSED = re.compile(r"^\s*compression_mode:\s*['\"]?(file|message)", re.I | re.M)


def open_log(path: Path, csv: Delimited) -> MessageLog:
    """Open a recording of rosbag2."""
    if path.is_dir() and (files := sorted(path.glob("*.mcap"))):
        return mcap.open_files(path, files)
    for file in sorted(path.glob("*.db3")) if path.is_dir() else [path]:
        require_size(file)
    _refuse_compressed(path)
    rosbag2 = library(path, "rosbags.rosbag2", "rosbags", "rosbag")
    with _bag(path, rosbag2) as bag:
        connections = list(bag.connections)
    decoders = {c.topic: ros.when_needed(_decoder, path, c) for c in connections}

    def stream() -> Iterator[Message]:
        with _bag(path, rosbag2) as bag:
            for connection, stamp_ns, content in bag.messages():
                topic = connection.topic
                yield Message(topic, int(stamp_ns), bytes(content), decoders[topic])

    return MessageLog(path, {c.topic for c in connections}, stream)


@contextlib.contextmanager
def _bag(path: Path, rosbag2: Any) -> Iterator[Any]:
    try:
        with rosbag2.Reader(path) as bag:
            yield bag
    except UnusableInput:
        raise
    except Exception as error:  # SQLite's, YAML's and its own share no base class
        raise unreadable(path, error) from error


def _refuse_compressed(path: Path) -> None:
    description = path / "metadata.yaml"
    try:
        text = text_of(description) if description.is_file() else ""
    except (OSError, ValueError) as error:
        raise unreadable(description, error) from error
    if _COMPRESSED.search(text):
        raise UnusableInput(
            f"{path}: is a compressed rosbag2; unpack it with `ros2 bag convert`, or record MCAP."
        )


def _decoder(path: Path, connection: Any) -> Decode:
    """By the definition in the file; before ROS 2 Jazzy there is none, and ROS's own may do."""
    kind, definition = connection.msgtype, connection.msgdef
    if definition.data and definition.format.name == "MSG":
        return ros.decoder(path, kind, definition.data, True)
    typesys = library(path, "rosbags.typesys", "rosbags", "rosbag")
    store = typesys.get_typestore(typesys.Stores.LATEST)
    if kind not in store.fielddefs:
        raise UnusableInput(
            f"{path}: the type {kind[:80]!r} of {connection.topic[:80]} is not in the file; convert"
            " it to MCAP with `ros2 bag convert`."
        )
    return lambda content: store.deserialize_cdr(content, kind)
