"""What messages call the elements of their lists: joints, models and frames, by their names."""

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.formats.messages import Message, MessageLog
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.guess_asked import Asked
from wakedeploy.domains.tables.reading import read_recordings

STEP_NS, START_NS = 10_000_000, 1_700_000_000 * 10**9


def joints(name: Sequence[str], position: Sequence[float]) -> dict[str, Any]:
    """A message as sensor_msgs/JointState."""
    return {"name": list(name), "position": list(position)}


def transforms(**ahead_m: float) -> dict[str, Any]:
    """A message as tf2_msgs/TFMessage."""
    return {
        "transforms": [
            {"child_frame_id": frame, "transform": {"translation": {"x": x}}}
            for frame, x in ahead_m.items()
        ]
    }


ONE = [joints("ab", [k, -k]) for k in range(100)]
TURNED = ONE[:50] + [joints("ba", [-k, k]) for k in range(50, 100)]
TWO = [joints("ab", [k, -k]) if k % 2 == 0 else joints(["grip/l.0"], [0.5]) for k in range(100)]
FRAMES = [transforms(base=k) if k % 2 == 0 else transforms(arm=-1.0, hand=k) for k in range(100)]


def log(folder: Path, messages: Sequence[dict[str, Any]]) -> Path:
    """An MCAP file with these messages on /m, at 100 Hz."""
    from mcap.writer import Writer

    path = folder / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/m", "json", 0)
        for k, message in enumerate(messages):
            at_ns = START_NS + k * STEP_NS
            writer.add_message(channel, at_ns, json.dumps(message).encode(), at_ns)
        writer.finish()
    return path


def read(path: Path, address: str, more: str = "") -> Recording:
    """The only recording of one column, `x`."""
    text = f'version = 1\n[columns.x]\ncolumn = "{address}"\nrole = "output"\nunit = "1"\n{more}'
    (recording,) = read_recordings([path], parse_columns(text)).recordings
    return recording


def test_a_joint_is_found_by_its_name_in_whatever_order(tmp_path: Path) -> None:
    path = log(tmp_path, TURNED)
    assert read(path, "/m.position[a]").columns["x"].tolist() == list(range(100))
    assert read(path, "/m.position[b]").columns["x"].tolist() == [-k for k in range(100)]


def test_an_index_that_is_one_joint_now_and_another_later_is_refused(tmp_path: Path) -> None:
    said = (
        r"'/m.position\[0\]' is that of 'a', and in message {} that of '{}'; "
        r"ask for it by its name, as '/m.position\[a\]'"
    )
    for messages, at, other in ((TURNED, 50, "b"), (TWO, 1, "grip/l.0")):
        with pytest.raises(UnusableInput, match=said.format(at, other)):
            read(log(tmp_path, messages), "/m.position[0]")
    numbered = [joints("12" if k % 2 else "21", [0.0, 1.0]) for k in range(20)]
    with pytest.raises(UnusableInput, match="record what several send on topics of their own"):
        read(log(tmp_path, numbered), "/m.position[0]")


def test_an_index_that_is_one_joint_all_along_is_read(tmp_path: Path) -> None:
    assert read(log(tmp_path, ONE), "/m.position[1]").columns["x"].tolist() == [
        -k for k in range(100)
    ]
    unnamed = [joints([], [k]) if k < 10 else joints("a", [k]) for k in range(100)]
    assert read(log(tmp_path, unnamed), "/m.position[0]").columns["x"].tolist() == list(range(100))


@pytest.mark.parametrize("address", ["/m.position[b]", "/m.position[1]"])
def test_a_message_that_lacks_a_joint_is_a_sample_without_a_number(
    tmp_path: Path, address: str
) -> None:
    path = log(tmp_path, TWO)
    with pytest.raises(UnusableInput, match='has no number in message 1; give missing = "nan"'):
        read(path, address)
    (numbers,) = read(path, address, 'missing = "nan"\n').columns.values()
    assert numbers[::2].tolist() == [-k for k in range(0, 100, 2)]
    assert np.isnan(numbers[1::2]).all()


def test_a_name_that_no_message_has_is_refused_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"\[wrist\]' is not in message 0; that has 'a', 'b'"):
        read(log(tmp_path, TWO), "/m.position[wrist]")
    with pytest.raises(UnusableInput, match=r"position\[2\]' is not there; it has"):
        read(log(tmp_path, TWO), "/m.position[2]")


def test_a_frame_is_found_by_its_own_name(tmp_path: Path) -> None:
    path, way = log(tmp_path, FRAMES), "transform.translation.x"
    (numbers,) = read(path, f"/m.transforms[hand].{way}", 'missing = "nan"\n').columns.values()
    assert numbers[1::2].tolist() == list(range(1, 100, 2))
    with pytest.raises(UnusableInput, match="is that of 'base', and in message 1 that of 'arm'"):
        read(path, f"/m.transforms[0].{way}")


def test_guess_lists_by_name_what_an_index_does_not_tell(tmp_path: Path) -> None:
    text = guess_columns(log(tmp_path, TWO))
    assert 'column = "/m.position[grip/l.0]"' in text
    assert 'column = "/m.position[a]"\nrole = "unused"\nunit = "1"' in text
    assert "[0]" not in text
    assert text.count('missing = "hold"') == 3
    text = guess_columns(log(tmp_path, ONE))
    assert '[columns.m_position_1]  # -99 to 0, of b\ncolumn = "/m.position[1]"' in text


def test_guess_looks_beyond_a_message_that_is_empty(tmp_path: Path) -> None:
    text = guess_columns(log(tmp_path, [joints([], []), *ONE[1:]]))
    assert 'column = "/m.position[1]"' in text


@pytest.mark.parametrize("then", [ONE, TURNED[40:]])
def test_guess_lists_what_has_no_name_at_first_once(
    tmp_path: Path, then: list[dict[str, Any]]
) -> None:
    path = log(tmp_path, [joints([], [k, -k]) for k in range(5)] + then)
    addresses = re.findall(r'column = "(/m.position.*)"', guess_columns(path))
    is_one = then is ONE
    index = ["/m.position[0]", "/m.position[1]"]
    assert addresses == (index if is_one else ["/m.position[a]", "/m.position[b]"])


@pytest.mark.parametrize(
    ("topics", "most"), [(("/m", "/once"), 5_001), (("/m", "/once", "/never"), 200_001)]
)
def test_fields_are_listed_without_a_look_at_every_message(
    tmp_path: Path, topics: tuple[str, ...], most: int
) -> None:
    """A topic with one message, as /tf_static, had all others read to their end."""
    taken: list[int] = []

    def stream() -> Iterator[Message]:
        for k in range(10**6):
            taken.append(k)
            yield Message("/once" if k == 1 else "/m", k, b'{"x": 1.0}', json.loads)

    bag = MessageLog(tmp_path, topics, stream)
    assert [field.name for field in bag.fields()] == ["/m.x", "/once.x"]
    assert len(taken) == most
    said = f"{tmp_path}: no message of /never is among the first 200000; no field of it is listed"
    assert bag.notes == ([said] if "/never" in topics else [])


def test_guess_finds_what_a_system_asks_for_by_the_joints_names(tmp_path: Path) -> None:
    """The shoulder stands behind the elbow, as in the order of letters."""
    asked = [Asked("shoulder_rad", "output", "rad"), Asked("elbow_rad", "output", "rad")]
    arm = [joints(["elbow", "shoulder"], [k, -k]) for k in range(100)]
    text = guess_columns(log(tmp_path, arm), asked)
    assert '[columns.shoulder_rad]  # -99 to 0, of shoulder\ncolumn = "/m.position[1]"' in text
    assert '[columns.elbow_rad]  # 0 to 99, of elbow\ncolumn = "/m.position[0]"' in text
    some = [message if k % 2 else joints(["grip"], [0.1 * k]) for k, message in enumerate(arm)]
    text = guess_columns(log(tmp_path, some), asked)
    assert '[columns.shoulder_rad]  # -99 to -1\ncolumn = "/m.position[shoulder]"' in text


def states(**interfaces: Sequence[float]) -> dict[str, Any]:
    """A message as control_msgs/DynamicJointState: position and velocity of each joint."""
    values = [
        {"interface_names": ["position", "velocity"], "values": list(each)}
        for each in interfaces.values()
    ]
    return {"joint_names": list(interfaces), "interface_values": values}


def test_what_a_joint_has_is_called_by_its_interface_and_not_by_another_joint(
    tmp_path: Path,
) -> None:
    """The velocity of the shoulder was that of the elbow, as there are two of both."""
    path = log(tmp_path, [states(shoulder=[k, 2 * k], elbow=[-k, -2 * k]) for k in range(100)])
    text = guess_columns(path)
    assert 'of shoulder velocity\ncolumn = "/m.interface_values[0].values[1]"' in text
    address = "/m.interface_values[shoulder].values[velocity]"
    assert read(path, address).columns["x"].tolist() == list(range(0, 200, 2))
    orders = [("shoulder", "elbow"), ("elbow", "shoulder")]
    both = [states(**{joint: [k, 2 * k] for joint in orders[k % 2]}) for k in range(100)]
    by_name = guess_columns(log(tmp_path, both))
    assert f'column = "{address}"' in by_name
    assert ", of " not in by_name
    with pytest.raises(UnusableInput, match="that has 'position', 'velocity'"):
        read(path, "/m.interface_values[shoulder].values[elbow]")


def test_the_points_of_a_trajectory_are_no_joints(tmp_path: Path) -> None:
    """There are as many of them as of joints, and the names are of the positions of each."""
    points = [[{"positions": [k, -k]}, {"positions": [k + 1, -k - 1]}] for k in range(100)]
    path = log(tmp_path, [{"joint_names": ["a", "b"], "points": each} for each in points])
    assert read(path, "/m.points[1].positions[b]").columns["x"].tolist() == [
        -k - 1 for k in range(100)
    ]
    with pytest.raises(UnusableInput, match=r"points\[a\].positions\[b\]' is not there"):
        read(path, "/m.points[a].positions[b]")


def test_only_lists_that_joints_have_are_of_the_joints(tmp_path: Path) -> None:
    """A vector of three numbers is not that of three joints, nor data that of a state's word."""
    three = [joints("abc" if k % 2 else "cba", [0, 0, 0]) for k in range(100)]
    down = log(tmp_path, [{**m, "gravity": [0.0, k, -9.81]} for k, m in enumerate(three)])
    assert read(down, "/m.gravity[1]").columns["x"].tolist() == list(range(100))
    told = [{"names": ["ok" if k < 50 else "warn"], "data": [k]} for k in range(100)]
    path = log(tmp_path, told)
    assert read(path, "/m.data[0]").columns["x"].tolist() == list(range(100))


def test_names_are_of_the_outermost_list_alone(tmp_path: Path) -> None:
    """Two efforts of one joint are not those of both joints."""
    path = log(
        tmp_path,
        [{"name": ["a", "b"], "pose": [{"effort": [k, 0]}, {"effort": [0, k]}]} for k in range(99)],
    )
    assert read(path, "/m.pose[b].effort[1]").columns["x"].tolist() == list(range(99))
    with pytest.raises(UnusableInput, match="is not there"):
        read(path, "/m.pose[b].effort[a]")


LISTED = """version = 1
[time]
column = "t"
[columns.knee_rad]
column = "{address}"
role = "output"
unit = "rad"
"""
HIP, KNEE = np.linspace(0.0, 1.0, 9), np.linspace(3.0, 2.0, 9)


@pytest.mark.parametrize(
    "form", ["[{}, {}]", "({}, {})", "array('d', [{}, {}])", "array([{}, {}])", "[{} {}]"]
)
@pytest.mark.parametrize("head", ["", "/joint_states.", "/joint_states/"])
def test_joints_in_the_cells_of_a_table_are_read_by_their_names(
    form: str, head: str, tmp_path: Path
) -> None:
    """Exports of ROS write lists as their language does; two senders have orders of their own."""
    path = tmp_path / "log.csv"
    with path.open("w") as file:
        file.write(f"t,{head}name,{head}position\n")
        for k, (hip, knee) in enumerate(zip(HIP, KNEE, strict=True)):
            called, numbers = "['hip', 'knee']", form.format(hip, knee)
            if k % 3 == 1:
                called, numbers = "['knee', 'hip']", form.format(knee, hip)
            file.write(f'{k / 10},"{called}","{numbers}"\n')
    guessed = guess_columns(path, [Asked("knee_rad", "output", "rad")])
    assert f'column = "{head}position[knee]"' in guessed
    (read,) = read_recordings([path], parse_columns(guessed)).recordings
    np.testing.assert_allclose(read.columns["knee_rad"], KNEE)
    by_index = parse_columns(LISTED.format(address=f"{head}position[1]"))
    told = r"is that of 'hip' in line 3, and above of 'knee'; .*: \"\S*position\[knee\]\"\.$"
    with pytest.raises(UnusableInput, match=told):
        read_recordings([path], by_index)


def test_a_row_without_the_joint_has_no_number_and_a_list_without_names_is_read_by_index(
    tmp_path: Path,
) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k / 10},\"['{'gripper' if k == 4 else 'knee'}']\",[{k}]\n" for k in range(9)]
    path.write_text("t,name,position\n" + "".join(rows))
    text = LISTED.format(address="position[knee]")
    with pytest.raises(UnusableInput, match="has no number in line 6"):
        read_recordings([path], parse_columns(text))
    (read,) = read_recordings([path], parse_columns(text + 'missing = "nan"\n')).recordings
    assert np.flatnonzero(np.isnan(read.columns["knee_rad"])).tolist() == [4]
    path.write_text("t,position\n" + "".join(f'{k / 10},"({k}, {2 * k})"\n' for k in range(9)))
    (read,) = read_recordings(
        [path], parse_columns(LISTED.format(address="position[1]"))
    ).recordings
    assert read.columns["knee_rad"].tolist() == [2.0 * k for k in range(9)]
    with pytest.raises(UnusableInput, match=r"'position\[knee\]' is not there"):
        read_recordings([path], parse_columns(text))
