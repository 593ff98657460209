"""Folders of ROS: what holds bags is no log, and a bag is read whatever its metadata.yaml holds."""

import contextlib
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.log_kinds import of_bags
from wakedeploy.domains.tables.reading import read_recordings

START_NS, STEP_NS = 1_700_000_000 * 10**9, 50_000_000
COLUMNS = """version = 1
[columns.x_m]
column = "/odom.pose.pose.position.x"
role = "output"
unit = "m"
"""


def told(folder: Path) -> list[str]:
    """What reading and guessing say of a folder."""
    sentences = []
    with pytest.raises(UnusableInput) as refused:
        read_recordings([folder], parse_columns(COLUMNS))
    sentences.append(str(refused.value))
    with pytest.raises(UnusableInput) as refused:
        guess_columns(folder)
    return [*sentences, str(refused.value)]


@pytest.mark.parametrize(
    ("bags", "named"),
    [
        (["run_1"], "run_1"),
        (["run_1", "run_2", "run_3"], "run_1, run_2, run_3"),
        (["e", "d", "c", "b", "a"], "a, b, c and 2 more"),
    ],
)
def test_of_a_folder_of_bags_the_bags_are_to_be_given(tmp_path: Path, bags, named: str) -> None:
    for name in bags:
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").touch()
    (tmp_path / "readme.txt").write_text("Bags of a rover.\nSee the lab book.\n")
    sentence = f"{tmp_path}: is a folder that holds bags ({named}); give these, {tmp_path}/*/."
    assert told(tmp_path) == [sentence] * 2


def test_a_bag_without_its_description_is_one_in_a_folder_of_bags(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run_0.db3").touch()
    assert all("holds bags (run/run_0.db3); give these." in said for said in told(tmp_path))


def test_a_compressed_bag_whose_description_is_lost_is_to_be_unpacked(tmp_path: Path) -> None:
    bag = tmp_path / "bags" / "run"
    bag.mkdir(parents=True)
    (bag / "run_0.db3.zstd").write_bytes(b"\x28\xb5\x2f\xfd")
    assert all("run_0.db3.zstd: is compressed; unpack it by zstd -d" in said for said in told(bag))
    assert all("holds bags (run/run_0.db3.zstd)" in said for said in told(bag.parent))


@pytest.mark.parametrize("description", ["", "compression_mode: FILE\n"])
def test_a_compressed_bag_is_to_be_unpacked_whatever_its_description(
    tmp_path: Path, description: str
) -> None:
    (tmp_path / "metadata.yaml").write_text(description)
    (tmp_path / "run_0.db3.zstd").write_bytes(b"\x28\xb5\x2f\xfd")
    assert all("is a compressed rosbag2; unpack it" in said for said in told(tmp_path))
    file = tmp_path / "run_0.db3.zstd"
    assert all(f"is compressed; unpack it by zstd -d {file}" in said for said in told(file))


def test_who_keeps_tables_beside_bags_means_these(tmp_path: Path) -> None:
    (tmp_path / "raw.bag").write_bytes(b"#ROSBAG V2.0\n\x45\x00\x00\x00")
    (tmp_path / "imu.csv").write_text("t,q\n0.0,1.0\n0.1,2.0\n0.2,2.5\n")
    assert of_bags(tmp_path) is None


def test_of_a_folder_with_a_bag_of_ros_1_it_is_said_how_to_convert_that(tmp_path: Path) -> None:
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n\x45\x00\x00\x00")
    bare = f"rosbags-convert --src {tmp_path}/old.bag --dst FOLDER makes one of rosbag2."
    assert [sentence.partition("; ")[2] for sentence in told(tmp_path)] == [bare] * 2


LOST = {
    "": "is empty",
    "\0\0\0\0": "is cut off or not of rosbag2",
    "rosbag2_bagfile_information:\n  version: 8\n  storage_ident": "is cut off or not of rosbag2",
    "rosbag2_bagfile_information:\n  version: 8\n": "is cut off or not of rosbag2",
    "runs: 3\n": "is cut off or not of rosbag2",
    "\udcff\udcfe": "cannot be read",
}


@pytest.mark.parametrize("kind", ["db3", "mcap"])
@pytest.mark.parametrize(("left", "said"), LOST.items())
def test_a_bag_whose_description_is_lost_is_read_without_it(
    tmp_path: Path, kind: str, left: str, said: str
) -> None:
    bag = rover_bag(tmp_path / "bag", kind)
    columns = parse_columns(COLUMNS)
    whole = read_recordings([bag], columns)
    (bag / "metadata.yaml").write_bytes(left.encode("utf-8", "surrogateescape"))
    read = read_recordings([bag], columns)
    np.testing.assert_equal(read.recordings[0].columns, whole.recordings[0].columns)
    assert not whole.notes
    note = f"{bag}: its metadata.yaml {said}; all of its .{kind} files are read without it"
    assert read.notes == (note,)
    assert '"/odom.pose.pose.position.x"' in guess_columns(bag)


def test_all_files_of_a_bag_are_read_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    bag = rover_bag(tmp_path / "bag", "db3")
    (first,) = bag.glob("*.db3")
    whole = read_recordings([bag], parse_columns(COLUMNS)).recordings[0].columns["x_m"]
    half = whole[len(whole) // 2]
    for number, later in ((9, "<"), (10, ">=")):
        part = first.with_name(f"bag_{number}.db3")
        part.write_bytes(first.read_bytes())
        with contextlib.closing(sqlite3.connect(part)) as database:
            middle_ns = START_NS + round(half / 0.1) * STEP_NS
            database.execute(f"DELETE FROM messages WHERE NOT timestamp {later} {middle_ns}")
            database.commit()
    first.unlink()
    (bag / "metadata.yaml").write_text("")
    read = read_recordings([bag], parse_columns(COLUMNS))
    assert read.recordings[0].columns["x_m"].tolist() == whole.tolist()
    assert len(read.notes) == 1  # and none on stamps that fall


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_bag_of_a_recorder_that_was_killed_is_read_by_the_names_of_its_files(
    tmp_path: Path, kind: str
) -> None:
    """It wrote no metadata.yaml, and guessing took each part for a recording of its own."""
    bag = rover_bag(tmp_path / "bag", kind)
    whole = read_recordings([bag], parse_columns(COLUMNS)).recordings[0].columns["x_m"]
    (first,) = bag.glob(f"*.{kind}")
    later = rover_bag(tmp_path / "later", kind, START_NS + 40 * STEP_NS)
    first.rename(bag / f"bag_0.{kind}")
    next(later.glob(f"*.{kind}")).rename(bag / f"bag_1.{kind}")
    (bag / "metadata.yaml").unlink()
    read = read_recordings([bag], parse_columns(COLUMNS))
    assert read.recordings[0].columns["x_m"].tolist() == [*whole, *whole]
    assert read.notes == (
        f"{bag}: it has no metadata.yaml; all of its .{kind} files are read without it",
    )
    assert "file = " not in guess_columns(bag)
    (tmp_path / "bags").mkdir()
    bag.rename(tmp_path / "bags" / "bag")
    assert all("holds bags (bag); give these" in said for said in told(tmp_path / "bags"))


@pytest.mark.parametrize(
    "names",
    [
        ("a_0.db3", "b_0.db3"),
        ("run_1.db3", "run_2.db3"),
        ("run_0.db3", "run_2.db3"),
        ("run_0.mcap", "run_1.mcap"),
        ("logs_1.mcap", "logs_2.mcap"),
    ],
)
def test_recordings_beside_each_other_are_no_bag(tmp_path: Path, names: tuple[str, str]) -> None:
    for name in names:
        bag = rover_bag(tmp_path / Path(name).stem, name.rpartition(".")[2])
        (tmp_path / "logs").mkdir(exist_ok=True)
        next(bag.glob(f"*{Path(name).suffix}")).rename(tmp_path / "logs" / name)
    with pytest.raises(UnusableInput, match="is a folder; say in which of its files"):
        read_recordings([tmp_path / "logs"], parse_columns(COLUMNS))


def test_of_a_bag_without_its_description_one_file_may_be_read(tmp_path: Path) -> None:
    """The sentence was that the folder is a file; with a description all files are one bag."""
    bag = rover_bag(tmp_path / "bag", "db3")
    (file,) = bag.glob("*.db3")
    columns = parse_columns(COLUMNS.replace("role =", f'file = "{file.name}"\nrole ='))
    with pytest.raises(UnusableInput, match="is one bag, of which all files are read; leave file"):
        read_recordings([bag], columns)
    (bag / "metadata.yaml").unlink()
    (one,) = read_recordings([bag], columns).recordings
    assert len(one.time_s) == 40


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_messages_that_are_compressed_one_by_one_are_said(tmp_path: Path, kind: str) -> None:
    bag = rover_bag(tmp_path / "bag", kind, is_packed=True)
    (file,) = bag.glob(f"*.{kind}")
    said = f"{file}: its messages are compressed; `ros2 bag convert` writes them without"
    assert all(said in sentence for sentence in told(file))


def test_a_bag_of_which_files_or_all_are_missing_is_refused(tmp_path: Path) -> None:
    bag = rover_bag(tmp_path / "bag", "db3")
    for file in bag.glob("*.db3"):
        file.unlink()
    with pytest.raises(UnusableInput, match="files are missing"):
        read_recordings([bag], parse_columns(COLUMNS))
    (bag / "metadata.yaml").write_text("")
    with pytest.raises(UnusableInput, match=r"is empty, and there is no \.db3 or \.mcap file"):
        read_recordings([bag], parse_columns(COLUMNS))


def rover_bag(path: Path, kind: str, start_ns: int = START_NS, *, is_packed: bool = False) -> Path:
    """Two seconds of a rover that drives ahead, as SQLite or as MCAP."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds: dict[str, Any] = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
    vector, none36 = kinds["Vector3"], np.zeros(36)
    writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    if is_packed:
        writer.set_compression(rosbag2.CompressionMode.MESSAGE, rosbag2.CompressionFormat.ZSTD)
    with writer as bag:
        topic = bag.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        for k in range(40):
            ns = start_ns + STEP_NS * k
            stamp = kinds["Time"](sec=ns // 10**9, nanosec=ns % 10**9)
            twist = kinds["Twist"](vector(2.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
            ahead = kinds["Quaternion"](0.0, 0.0, 0.0, 1.0)
            pose = kinds["Pose"](kinds["Point"](0.1 * k, 0.0, 0.0), ahead)
            message = kinds["Odometry"](
                kinds["Header"](stamp=stamp, frame_id="odom"),
                "base",
                kinds["PoseWithCovariance"](pose, none36),
                kinds["TwistWithCovariance"](twist, none36),
            )
            bag.write(topic, ns, store.serialize_cdr(message, topic.msgtype))
    return path
