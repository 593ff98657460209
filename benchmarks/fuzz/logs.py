"""Kinds of logs of any system: one small motion in every format, each written by its own library.

The motion is a command `u` and a position `q` of two joints at 100 Hz.
"""

import gzip
import io
import json
import random
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fuzz.archives import npz_file, packed
from benchmarks.fuzz.binary import gzipped_csv, mat_file, mcap_file
from benchmarks.fuzz.documents import toml_file
from benchmarks.fuzz.kind import Files, Kind, taken
from benchmarks.fuzz.tables import csv_file
from benchmarks.fuzz.text import damaged
from wakedeploy.domains.tables.columns import parse_columns, read_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.reading import Reading, read_recordings

Motion = dict[str, NDArray[np.float64]]

SAMPLES, RATE_HZ = 120, 100.0
TYPE = "arm_msgs/msg/State"
DEFINITION = "# of two joints\nint32 JOINTS=2\nfloat64 u\nfloat64[] q\nstring name\n"


def kinds() -> dict[str, Callable[[], Kind]]:
    """What makes each kind, by its name."""
    return {f"table-{name}": _made(name) for name in (*_WRITE, "columns")}


def motion(samples: int = SAMPLES) -> Motion:
    """Stamps `t` [s], a command `u`, and positions `q` (n, 2)."""
    t = np.arange(samples) / RATE_HZ
    u = np.sin(7.0 * t)
    return {"t": t, "u": u, "q": np.column_stack([np.cumsum(u) / RATE_HZ, 0.5 * u])}


def columns_text(u: str, q: str, time: str = 'column = "t"') -> str:
    """A `columns.toml` for two columns of a log."""
    role = 'role = ["input", "observation"]\nunit = "V"'
    return (
        f'version = 1\n[time]\n{time}\n[columns.u]\ncolumn = "{u}"\n{role}\n'
        f'[columns.q]\ncolumn = "{q}"\nrole = ["output", "force"]\nunit = "deg"\n'
    )


def csv_text(made: Motion) -> bytes:
    """One column each, and the positions as a list in a quoted string."""
    rows = zip(made["t"], made["u"], made["q"], strict=True)
    lines = [f'{t!r},{u!r},"[{a!r}, {b!r}]"' for t, u, (a, b) in _python(rows)]
    return "\n".join(["t,u,q", *lines]).encode() + b"\n"


def _python(rows: Any) -> Any:
    return ((float(t), float(u), (float(q[0]), float(q[1]))) for t, u, q in rows)


def mat_bytes(made: Motion) -> bytes:
    """A MATLAB file of version 5, written by SciPy; vectors stand upright."""
    from scipy.io import savemat

    file = io.BytesIO()
    savemat(file, {n: a if a.ndim == 2 else a[:, None] for n, a in made.items()})
    return file.getvalue()


def parquet_bytes(made: Motion) -> bytes:
    """Written by Arrow: the positions as lists, the command within a struct."""
    import pyarrow
    import pyarrow.parquet

    q = pyarrow.array(made["q"].tolist())
    command = pyarrow.array([{"u": u} for u in made["u"].tolist()])
    table = pyarrow.table({"t": made["t"], "command": command, "q": q})
    file = io.BytesIO()
    pyarrow.parquet.write_table(table, file)
    return file.getvalue()


def hdf5_bytes(made: Motion) -> bytes:
    """Written by h5py, a group for the arm."""
    import h5py

    file = io.BytesIO()
    with h5py.File(file, "w") as opened:
        opened["t"], opened["u"] = made["t"], made["u"]
        opened.create_dataset("arm/q", data=made["q"], compression="gzip")
        opened["arm/q"].attrs["unit"] = "deg"
    return file.getvalue()


def json_mcap(made: Motion) -> bytes:
    """Messages as JSON, written by the MCAP library: the command and the state in two topics."""
    from mcap.writer import Writer

    file = io.BytesIO()
    writer = Writer(file)
    writer.start()
    schema = writer.register_schema("state", "jsonschema", b"{}")
    channels = [writer.register_channel(topic, "json", schema) for topic in ("/cmd", "/arm")]
    for t, u, (a, b) in _python(zip(made["t"], made["u"], made["q"], strict=True)):
        for channel, message in zip(
            channels, ({"u": u}, {"joints": [{"q": a}, {"q": b}]}), strict=True
        ):
            stamp_ns = round(t * 1e9)
            writer.add_message(channel, stamp_ns, json.dumps(message).encode(), stamp_ns)
    writer.finish()
    return file.getvalue()


def bag_files(made: Motion, storage: str) -> Files:
    """A folder of rosbag2 with a type of its own, written by rosbags: "SQLITE3" or "MCAP"."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(DEFINITION, TYPE))
    state = store.types[TYPE]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "bag"
        with Writer(folder, version=9, storage_plugin=StoragePlugin[storage]) as writer:
            channel = writer.add_connection("/arm", TYPE, typestore=store)
            for t, u, q in zip(made["t"], made["u"], made["q"], strict=True):
                message = state(u=float(u), q=np.asarray(q), name="arm")
                content = store.serialize_cdr(message, TYPE)
                writer.write(channel, round(float(t) * 1e9), content)
        return taken(folder)


def ulog_bytes(made: Motion) -> bytes:
    """A ULog of two topics, put together as PX4's description of the format says."""
    start_us = 5_000_000
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start_us)]
    parts += [
        _ulog("F", b"command:uint64_t timestamp;float u;"),
        _ulog("F", b"arm:uint64_t timestamp;double[2] q;uint8_t[4] _padding0;"),
        _ulog("A", struct.pack("<BH", 0, 0) + b"command"),
        _ulog("A", struct.pack("<BH", 0, 1) + b"arm"),
    ]
    for t, u, (a, b) in _python(zip(made["t"], made["u"], made["q"], strict=True)):
        stamp_us = start_us + round(t * 1e6)
        parts.append(_ulog("D", struct.pack("<HQf", 0, stamp_us, u)))
        parts.append(_ulog("D", struct.pack("<HQdd", 1, stamp_us, a, b)))
    return b"".join(parts)


def _ulog(kind: str, content: bytes) -> bytes:
    return struct.pack("<Hc", len(content), kind.encode()) + content


def ulog_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A ULog damaged in its bytes, or with formats that contain each other or come to too much."""
    if draw.random() < 0.8:
        return damaged(draw, data, other)
    new = draw.choice((
        b"arm:uint64_t timestamp;arm[3] q;", b"arm:uint64_t timestamp;command[60000] q;",
        b"arm:float[65535] q;", b"arm:uint64_t timestamp;double[2] q;double[2] q;", b"arm:q;",
        b"arm:uint8_t timestamp;double[2] q;", b"arm:", b"command:arm a;arm b;",
    ))  # fmt: skip
    return data.replace(b"\x46arm:", b"\x46" + new[:4], 1) if draw.random() < 0.2 else (
        data[:16] + _ulog("F", new) + data[16:]
    )  # fmt: skip


_Q = "q[1]"
_COLUMNS = {
    "csv": columns_text("u", _Q),
    "npz": columns_text("u", _Q),
    "mat": columns_text("u", _Q),
    "parquet": columns_text("command.u", _Q),
    "hdf5": columns_text("u", "arm/q[1]"),
    "mcap": columns_text("/cmd.u", "/arm.joints[1].q", ""),
    "rosbag": columns_text("/arm.u", "/arm.q[1]", ""),
    "ros-mcap": columns_text("/arm.u", "/arm.q[1]", ""),
    "ulog": columns_text("command.u", "arm.q[1]", "") + "[resample]\nrate_hz = 100\n",
}
_WRITE: dict[str, Callable[[Motion], Files]] = {
    "csv": lambda m: {"log.csv": csv_text(m), "log2.csv.gz": gzip.compress(csv_text(m), mtime=0)},
    "npz": lambda m: {"log.npz": packed(m)},
    "mat": lambda m: {"log.mat": mat_bytes(m)},
    "parquet": lambda m: {"log.parquet": parquet_bytes(m)},
    "hdf5": lambda m: {"log.h5": hdf5_bytes(m)},
    "mcap": lambda m: {"log.mcap": json_mcap(m)},
    "rosbag": lambda m: {f"bag/{n}": c for n, c in bag_files(m, "SQLITE3").items()},
    "ros-mcap": lambda m: {"log.mcap": next(iter(bag_files(m, "MCAP").values()))},
    "ulog": lambda m: {"log.ulg": ulog_bytes(m)},
}
_WAYS = {
    "*.gz": gzipped_csv, "*.csv": csv_file, "*.npz": npz_file, "*.mat": mat_file,
    "*.mcap": mcap_file, "*.ulg": ulog_file, "*.toml": toml_file,
    "*.parquet": damaged, "*.h5": damaged, "*.db3": damaged,
}  # fmt: skip


def columns_of(name: str) -> str:
    """The `columns.toml` of a kind of log."""
    return _COLUMNS[name]


def written(name: str, made: Motion) -> Files:
    """The files of a kind of log."""
    return _WRITE[name](made)


def _made(name: str) -> Callable[[], Kind]:
    return lambda: _columns_kind() if name == "columns" else _kind(name)


def _kind(name: str) -> Kind:
    columns = parse_columns(_COLUMNS[name])

    def read(folder: Path) -> Reading:
        there = [p for p in sorted(folder.iterdir()) if not p.name.startswith(".")]
        for path in there:
            guess_columns(path)
        return read_recordings(there, columns)

    sound = (written(name, motion()), written(name, motion(40)))
    return Kind(f"table-{name}", f"logs of any system: {name}", sound, read, _WAYS, slowest_s=4.0)


def _columns_kind() -> Kind:
    text = columns_of("csv") + (
        '[resample]\nrate_hz = 50.0\nmethod = "low-pass"\ncutoff_hz = 10.0\n'
        '[split]\ngap_s = 0.5\n[csv]\ndelimiter = ","\n[training]\nwindow_s = 0.1\n'
    )
    sound = ({"columns.toml": text.encode(), "log.csv": csv_text(motion())},)

    def read(folder: Path) -> Reading:
        columns = read_columns(folder / "columns.toml")
        return read_recordings([folder / "log.csv"], columns)

    ways = {"*.toml": toml_file, "*.csv": csv_file}
    return Kind("table-columns", "what columns mean", sound, read, ways, slowest_s=4.0)
