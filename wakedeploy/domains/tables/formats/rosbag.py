"""rosbag2: a folder with metadata.yaml, or one of its .db3 files; MCAP ones are read as such.

A loss of power leaves no metadata.yaml, or one that is empty or cut off. The files are read without
it then.
"""

import contextlib
import importlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import text_of
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats import mcap, ros
from wakedeploy.domains.tables.formats.messages import Decode, Message, MessageLog
from wakedeploy.domains.tables.log import library, require_size, unreadable

_COMPRESSED = re.compile(r"^\s*compression_mode:\s*['\"]?(file|message)", re.I | re.M)
_SAID = {  # in every metadata.yaml, whatever its version
    "version", "storage_identifier", "relative_file_paths", "duration", "starting_time",
    "message_count", "topics_with_message_count",
}  # fmt: skip
_SAID_OF_TOPIC = {"name", "type", "serialization_format"}


def open_log(path: Path, csv: Delimited) -> MessageLog:
    """Open a recording of rosbag2."""
    files = sorted(path.glob("*.mcap"), key=_as_recorded) if path.is_dir() else []
    if files:
        log = mcap.open_files(path, files)
    else:
        files = sorted(path.glob("*.db3"), key=_as_recorded) if path.is_dir() else [path]
        log = _open_databases(path, files)
    if lost := _lost_description(path):
        log.notes.append(f"{path}: {lost}; all of its {files[0].suffix} files are read without it")
    return log


def _open_databases(path: Path, files: Sequence[Path]) -> MessageLog:
    for file in files:
        require_size(file)
    _refuse_compressed(path)
    rosbag2 = library(path, "rosbags.rosbag2", "rosbags", "rosbag")
    lost = _lost_description(path)
    if lost and not files:
        raise UnusableInput(f"{path}: {lost}, and there is no .db3 or .mcap file; copy it again.")
    parts = files if lost else [path]
    decoders: dict[str, Decode] = {}
    for part in parts:
        with _bag(part, rosbag2) as bag:
            for c in bag.connections:
                decoders.setdefault(c.topic, ros.when_needed(_decoder, path, c))

    def stream() -> Iterator[Message]:
        for part in parts:
            with _bag(part, rosbag2) as bag:
                for connection, stamp_ns, content in bag.messages():
                    topic = connection.topic
                    yield Message(topic, int(stamp_ns), bytes(content), decoders[topic])

    return MessageLog(path, set(decoders), stream)


def _as_recorded(file: Path) -> tuple[int, str]:
    """The order in which a recorder numbers its files: 10 comes after 9."""
    return len(file.name), file.name


def _lost_description(path: Path) -> str:
    """What is wrong with the metadata.yaml of a folder; nothing where it can be used."""
    description = path / "metadata.yaml"
    if not path.is_dir():
        return ""
    if not description.is_file():
        return "it has no metadata.yaml"
    try:
        text = text_of(description)
    except (OSError, ValueError):
        return "its metadata.yaml cannot be read"
    if not text.strip():
        return "its metadata.yaml is empty"
    try:
        yaml = importlib.import_module("ruamel.yaml")  # comes with rosbags
    except ImportError:
        return ""  # as of MCAP with JSON, whose files need no description
    try:
        said = yaml.YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
        topics = [topic["topic_metadata"] for topic in said["topics_with_message_count"]]
        is_whole = said.keys() >= _SAID and all(topic.keys() >= _SAID_OF_TOPIC for topic in topics)
    except Exception:  # YAML's share no base class with those of what it holds
        is_whole = False
    return "" if is_whole else "its metadata.yaml is cut off or not of rosbag2"


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
    except UnicodeDecodeError:
        return  # nobody can see it there
    except (OSError, ValueError) as error:
        raise unreadable(description, error) from error
    if _COMPRESSED.search(text) or (path.is_dir() and any(path.glob("*.zstd"))):
        raise UnusableInput(
            f"{path}: is a compressed rosbag2; unpack it by `ros2 bag convert`, its files by"
            " `zstd -d` where metadata.yaml is lost, or record MCAP."
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
