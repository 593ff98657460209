"""A first columns.toml of a rosbag: units that ROS fixes, and no covariances."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.reading import read_recordings

pytest.importorskip("rosbags")


@pytest.fixture(scope="module")
def guessed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    path = rover_bag(tmp_path_factory.mktemp("ros") / "bag")
    return path, guess_columns(path)


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("/imu.angular_velocity.z", "rad/s"),
        ("/imu.linear_acceleration.x", "m/s^2"),
        ("/imu.orientation.w", "1"),
        ("/odom.pose.pose.position.x", "m"),
        ("/odom.twist.twist.linear.x", "m/s"),
        ("/odom.twist.twist.angular.z", "rad/s"),
        ("/cmd_vel.linear.x", "m/s"),
    ],
)
def test_units_are_those_that_ros_fixes(guessed, column: str, unit: str) -> None:
    entry = f'column = "{column}"\nrole = "unused"\nunit = "{unit}"\n'
    assert entry in guessed[1] + "\n"


def test_of_joints_it_is_said_that_ros_leaves_it_open(guessed) -> None:
    assert 'unit = "1"  # ? rad of a joint that turns, m of one that slides' in guessed[1]
    assert 'unit = "1"  # ? rad/s of a joint that turns, m/s of one that slides' in guessed[1]


def test_covariances_and_stamps_are_left_out_and_it_is_said_once(guessed) -> None:
    _, text = guessed
    columns = re.findall(r'^column = "(.*)"', text, re.M)
    assert not [name for name in columns if "covariance" in name or "stamp" in name]
    assert text.count("covariance") == 1
    assert "# Not listed: covariances, which are no measurements." in text
    assert 'time = "/imu.header.stamp"' in text


def test_what_never_changes_stands_in_one_list(guessed) -> None:
    _, text = guessed
    assert "always 0" not in text
    same = next(line for line in text.splitlines() if "/cmd_vel.linear.z 0" in line)
    assert same.startswith("#")
    assert '"/cmd_vel.linear.z"' not in text


def test_what_is_left_out_is_read_all_the_same(guessed) -> None:
    path, _ = guessed
    text = "version = 1\n" + "".join(
        f'[columns.{n}]\ncolumn = "{a}"\nrole = "output"\nunit = "1"\n'
        for n, a in (("c", "/imu.orientation_covariance[0]"), ("z", "/imu.angular_velocity.x"))
    )
    (recording,) = read_recordings([path], parse_columns(text)).recordings
    assert not np.any(recording.columns["c"])


@pytest.mark.parametrize(
    ("column", "unit", "doubt"),
    [
        ("/cmd_vel.linear.x", "rad/s", "read as rad/s, and the log says m/s; check `unit`"),
        ("/odom.twist.twist.angular.z", "deg/s", "read as deg/s, and the log says rad/s; check"),
        ("/odom.pose.pose.position.x", "mm", "read as mm, and the log says m; check `unit`"),
        ("/odom.twist.twist.linear.x", "m/s", ""),
        ("/imu.orientation.z", "1", ""),
        ("/joints.position[0]", "deg", ""),
    ],
)
def test_a_unit_that_ros_fixes_is_not_contradicted_in_silence(
    guessed, column: str, unit: str, doubt: str
) -> None:
    text = f'version = 1\n[columns.it]\ncolumn = "{column}"\nrole = "output"\nunit = "{unit}"\n'
    notes = read_recordings([guessed[0]], parse_columns(text)).notes
    doubts = [note for note in notes if "check `unit`" in note]
    assert len(doubts) == bool(doubt)
    assert not doubt or f"column '{column}': {doubt}" in doubts[0]


def rover_bag(path: Path) -> Path:
    """Ten seconds of a rover that turns."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds: dict[str, Any] = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    vector, none9, none36 = kinds["Vector3"], np.zeros(9), np.zeros(36)
    with Writer(path, version=8) as bag:
        topics = {
            name: bag.add_connection(name, kind, typestore=store)
            for name, kind in (
                ("/imu", "sensor_msgs/msg/Imu"),
                ("/odom", "nav_msgs/msg/Odometry"),
                ("/cmd_vel", "geometry_msgs/msg/Twist"),
                ("/joints", "sensor_msgs/msg/JointState"),
            )
        }
        for k in range(200):
            ns, x = 1_700_000_000 * 10**9 + 50_000_000 * k, 0.1 * k
            stamp = kinds["Time"](sec=ns // 10**9, nanosec=ns % 10**9)
            header = kinds["Header"](stamp=stamp, frame_id="base")
            turned = kinds["Quaternion"](0.0, 0.0, float(np.sin(x)), float(np.cos(x)))
            twist = kinds["Twist"](vector(x, 0.0, 0.0), vector(0.0, 0.0, x))
            pose = kinds["Pose"](kinds["Point"](x, 0.0, 0.0), turned)
            messages = {
                "/imu": kinds["Imu"](
                    header, turned, none9, vector(0.0, 0.0, x), none9, vector(x, 0.0, 9.81), none9
                ),
                "/odom": kinds["Odometry"](
                    header,
                    "base",
                    kinds["PoseWithCovariance"](pose, none36),
                    kinds["TwistWithCovariance"](twist, none36),
                ),
                "/cmd_vel": twist,
                "/joints": kinds["JointState"](
                    header, ["left"], np.array([x]), np.array([x + 1.0]), np.array([0.0])
                ),
            }
            for topic, message in messages.items():
                connection = topics[topic]
                bag.write(connection, ns, store.serialize_cdr(message, connection.msgtype))
    return path
