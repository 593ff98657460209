"""One angle that is read from the four columns of a quaternion."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.reading import Reading, read_recordings

STAMPS_S = np.arange(400) / 20.0
TRUE = np.column_stack(  # yaw, pitch, roll [rad]; the yaw turns nearly five times
    [1.5 * STAMPS_S, 0.9 * np.sin(STAMPS_S), 0.6 * np.cos(2 * STAMPS_S)]
)
PARTS = "quaternion = ['q.x', 'q.y', 'q.z', 'q.w']\n"


def quaternions(true: np.ndarray = TRUE) -> np.ndarray:
    return Rotation.from_euler("ZYX", true).as_quat()


def log(folder: Path, parts: np.ndarray, names: str = "q.x,q.y,q.z,q.w") -> Path:
    path = folder / "log.csv"
    rows = np.column_stack([STAMPS_S, parts])
    np.savetxt(path, rows, "%.9f", ",", header=f"t,{names}", comments="")
    return path


def reading(path: Path, entry: str, role: str = '"output"') -> Reading:
    head = 'version = 1\n[time]\ncolumn = "t"\n[columns.angle]\n'
    return read_recordings([path], parse_columns(f"{head}role = {role}\n{entry}"))


@pytest.mark.parametrize(("at", "angle"), [(0, "yaw"), (1, "pitch"), (2, "roll")])
def test_an_angle_is_that_of_scipy_and_goes_on(at: int, angle: str, tmp_path: Path) -> None:
    read = reading(log(tmp_path, quaternions()), f'{PARTS}angle = "{angle}"\n')
    assert read.units == {"angle": "rad"}
    np.testing.assert_allclose(read.recordings[0].columns["angle"], TRUE[:, at], atol=1e-6)
    unwrapped = [n.endswith("column 'yaw of q': unwrapped at 5 places") for n in read.notes]
    assert unwrapped == ([True] if angle == "yaw" else [])


def test_it_is_converted_scaled_and_wrapped_as_any_other(tmp_path: Path) -> None:
    path = log(tmp_path, quaternions())
    read = reading(path, f'{PARTS}angle = "yaw"\nto = "deg"\nscale = -1.0\nwraps = false\n')
    assert read.units == {"angle": "deg"}
    yaw = np.rad2deg(np.mod(TRUE[:, 0] + np.pi, 2 * np.pi) - np.pi)
    np.testing.assert_allclose(read.recordings[0].columns["angle"], -yaw, atol=1e-4)


def test_a_sign_that_flips_and_a_scale_change_nothing_and_the_scale_is_said(
    tmp_path: Path,
) -> None:
    """A quaternion and its negative are one orientation; some sensors send integers."""
    parts = 16384.0 * quaternions() * np.where(np.arange(400) % 3, 1.0, -1.0)[:, np.newaxis]
    read = reading(log(tmp_path, np.round(parts)), f'{PARTS}angle = "yaw"\n')
    np.testing.assert_allclose(read.recordings[0].columns["angle"], TRUE[:, 0], atol=1e-3)
    assert any("its length is 1.638e+04 and not 1; it is divided by it" in n for n in read.notes)


def test_a_row_of_zeros_has_no_orientation(tmp_path: Path) -> None:
    parts = quaternions()
    parts[7] = 0.0
    path = log(tmp_path, parts)
    with pytest.raises(UnusableInput, match=r"'yaw of q' has no number in line 9"):
        reading(path, f'{PARTS}angle = "yaw"\n')
    read = reading(path, f'{PARTS}angle = "yaw"\nmissing = "nan"\n')
    assert np.flatnonzero(np.isnan(read.recordings[0].columns["angle"])).tolist() == [7]
    with pytest.raises(UnusableInput, match=r"0 in every row.*measures no orientation"):
        reading(log(tmp_path, 0.0 * parts), f'{PARTS}angle = "yaw"\nmissing = "nan"\n')


def test_four_columns_that_are_no_quaternion_are_refused(tmp_path: Path) -> None:
    parts = np.random.default_rng(1).normal(size=(400, 4))
    with pytest.raises(UnusableInput, match=r"'yaw of q' is no orientation in line \d+: .*length"):
        reading(log(tmp_path, parts), f'{PARTS}angle = "yaw"\n')


def test_an_orientation_that_stands_upright_has_no_yaw_and_it_is_said(tmp_path: Path) -> None:
    true = TRUE.copy()
    true[100:110, 1] = np.pi / 2
    path = log(tmp_path, quaternions(true))
    read = reading(path, f'{PARTS}angle = "yaw"\nwraps = false\n')
    assert any("nose up or down in 10 samples, where yaw and roll are one" in n for n in read.notes)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ('angle = "yaw"\ncolumn = "q.x"\nunit = "1"\n', "columns.angle: angle is of a quaternion"),
        (PARTS, "columns.angle: give the angle of the quaternion"),
        (f'{PARTS}angle = "yaw"\ncolumn = "q.x"\n', "either column or quaternion, not both"),
        (f'{PARTS}angle = "yaw"\nunit = "deg"\n', 'is in rad; give to = "deg"'),
        ("quaternion = ['q.x', 'q.y']\nangle = 'yaw'\n", "columns.angle.quaternion"),
        (f'{PARTS}angle = "tilt"\n', "columns.angle.angle = 'tilt'"),
        ("unit = 'rad'\n", "columns.angle: column is missing"),
        (
            "quaternion = ['q.w', 'q.x', 'q.y', 'q.z']\nangle = 'yaw'\n",
            "in the order x, y, z, w",
        ),
    ],
)
def test_an_entry_that_says_too_little_or_too_much_is_refused(entry: str, said: str) -> None:
    head = "version = 1\n[columns.angle]\nrole = 'output'\n"
    with pytest.raises(UnusableInput, match=said):
        parse_columns(head + entry)


@pytest.mark.parametrize(
    "names", ["q.x,q.y,q.z,q.w", "qx,qy,qz,qw", "pose_qw,pose_qx,pose_qy,pose_qz"]
)
def test_a_guess_proposes_the_yaw_and_is_read_as_it_is(names: str, tmp_path: Path) -> None:
    parts = quaternions() if names.endswith("w") else np.roll(quaternions(), 1, axis=1)
    path = log(tmp_path, parts, names)
    guessed = guess_columns(path)
    assert 'angle = "yaw"  # or "pitch", "roll"' in guessed
    head, entry, rest = guessed.partition("quaternion = [")
    read = read_recordings(
        [path], parse_columns(head + entry + rest.replace('"unused"', '"output"', 1))
    )
    (values,) = read.recordings[0].columns.values()
    np.testing.assert_allclose(values, TRUE[:, 0], atol=1e-6)


def test_no_guess_where_four_columns_are_no_quaternion(tmp_path: Path) -> None:
    parts = np.random.default_rng(1).normal(size=(400, 4))
    for some in (parts, 0.0 * parts):
        assert "quaternion" not in guess_columns(log(tmp_path, some, "fx,fy,fz,fw"))


def test_the_parts_of_an_array_are_proposed_with_w_first_and_it_is_marked(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, t=STAMPS_S, quat=np.roll(quaternions(), 1, axis=1))
    guessed = guess_columns(path)
    said = 'quaternion = ["quat[1]", "quat[2]", "quat[3]", "quat[0]"]  # ? x, y, z, w: taken as if'
    assert said in guessed


def test_the_pose_of_a_rosbag_gives_the_yaw(tmp_path: Path) -> None:
    guessed = guess_columns(pose_bag(tmp_path / "bag"))
    head, entry, rest = guessed.partition("[columns.pose_pose_orientation_yaw_rad]")
    columns = parse_columns(head + entry + rest.replace('"unused"', '"output"', 1))
    read = read_recordings([tmp_path / "bag"], columns)
    (values,) = read.recordings[0].columns.values()
    np.testing.assert_allclose(values, TRUE[:, 0], atol=1e-6)
    assert "column 'yaw of /pose.pose.orientation': unwrapped at 5 places" in read.notes[0]


def pose_bag(path: Path) -> Path:
    """A rosbag2 with the poses of a tracker."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    with Writer(path, version=8) as bag:
        pose = bag.add_connection("/pose", "geometry_msgs/msg/PoseStamped", typestore=store)
        for stamp_s, parts in zip(STAMPS_S, quaternions(), strict=True):
            ns = 1_700_000_000 * 10**9 + int(1e9 * stamp_s)
            stamp = kinds["Time"](sec=ns // 10**9, nanosec=ns % 10**9)
            message = kinds["PoseStamped"](
                kinds["Header"](stamp=stamp, frame_id="map"),
                kinds["Pose"](kinds["Point"](0.0, 0.0, 0.0), kinds["Quaternion"](*parts.tolist())),
            )
            bag.write(pose, ns, store.serialize_cdr(message, pose.msgtype))
    return path


def test_the_last_part_of_a_quaternion_is_no_watt(tmp_path: Path) -> None:
    guessed = guess_columns(log(tmp_path, quaternions(), "base_x,base_y,base_z,base_w"))
    assert 'column = "base_w"\nrole = "unused"\nunit = "1"\n' in guessed
    assert '"W"' not in guessed
