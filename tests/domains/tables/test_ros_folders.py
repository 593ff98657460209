"""Folders of ROS: what holds bags is no log, and a bag is read whatever its metadata.yaml holds."""

from pathlib import Path

import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.reading import read_recordings

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
    sentence = f"{tmp_path}: is a folder that holds bags ({named}); give these, {tmp_path}/*."
    assert told(tmp_path) == [sentence] * 2


def test_a_bag_without_its_description_is_one_in_a_folder_of_bags(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run_0.db3").touch()
    assert all("holds bags (run); give these" in sentence for sentence in told(tmp_path))


def test_of_a_folder_with_a_bag_of_ros_1_it_is_said_how_to_convert_that(tmp_path: Path) -> None:
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n\x45\x00\x00\x00")
    bare = f"rosbags-convert --src {tmp_path}/old.bag --dst FOLDER makes one of rosbag2."
    assert [sentence.partition("; ")[2] for sentence in told(tmp_path)] == [bare] * 2
