"""Every line and every branch of the firmware's decisions is run by the tests beside this one."""

import gzip
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import needs
import pytest

from runtime.virtual.firmware_build import DECISIONS, ROOT, host_library

pytestmark = needs.coverage

HERE = Path(__file__).parent
DRIVERS = ("test_frames.py", "test_decisions.py", "test_noise.py")
# The longest, left out: the others reach every line and branch without them.
LONGEST = ("over_any_conversation", "planner_for_a_minute", "missed_commands_stays_at_its_end")


def counted(folder: Path) -> dict[str, list[dict]]:
    """Runs the driving tests on the counting build; gcov's lines of each file of the sketch."""
    library = host_library(HERE / "decisions.cpp", coverage=True)
    environment = os.environ | {
        "WAKEDEPLOY_COUNT_LINES": "1",
        "GCOV_PREFIX": str(folder),
        "GCOV_PREFIX_STRIP": "99",  # every folder of the path compiled in
        "PYTHONPATH": str(ROOT),
    }
    tests = [str(HERE / name) for name in DRIVERS]
    pytest_alone = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "--hypothesis-seed=0",
        "-k",
        " and ".join(f"not {name}" for name in LONGEST),
    ]
    ended = subprocess.run(
        [*pytest_alone, *tests], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stdout
    for notes in library.parent.glob("*.gcno"):
        shutil.copy(notes, folder)
    data = [str(path) for path in folder.glob("*.gcda")]
    subprocess.run(
        ["gcov", "--json-format", "--branch-probabilities", *data],
        cwd=folder, check=True, capture_output=True,
    )  # fmt: skip
    lines: dict[str, list[dict]] = {}
    for report in folder.glob("*.gcov.json.gz"):
        for file in json.loads(gzip.decompress(report.read_bytes()))["files"]:
            path = Path(file["file"])
            if path.parent.name == "arduino_sketch":
                lines.setdefault(path.name, []).extend(file["lines"])
    return lines


def unreached(lines: list[dict]) -> list[str]:
    """Lines and branches that nothing ran; a header's line counts when any file ran it."""
    runs: dict[int, int] = {}
    branches: dict[tuple[int, int], int] = {}
    for line in lines:
        number = line["line_number"]
        runs[number] = runs.get(number, 0) + line["count"]
        for index, branch in enumerate(line["branches"]):
            key = number, index
            branches[key] = branches.get(key, 0) + branch["count"]
    return [f"line {number}" for number, count in sorted(runs.items()) if not count] + [
        f"branch {index} of line {number}"
        for (number, index), count in sorted(branches.items())
        if not count
    ]


@pytest.mark.whole
def test_every_line_and_branch_of_the_decisions_is_tested(tmp_path):
    lines = counted(tmp_path)
    assert {f"{name}.cpp" for name in DECISIONS} <= set(lines)
    assert {name: left for name in sorted(lines) if (left := unreached(lines[name]))} == {}
    assert sum(len(line["branches"]) for file in lines.values() for line in file) > 100
