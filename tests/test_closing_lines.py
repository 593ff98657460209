"""What a run of the tests says at its end: what a machine lacks, and why a test ran again."""

import subprocess
import sys
from pathlib import Path

import needs
import pytest

ROOT = Path(__file__).parents[1]


def printed_of(*what: str, **variables: str) -> list[str]:
    """What pytest prints of these tests on a machine that has no program at all."""
    found = {"PATH": "", "PYTHONPATH": f"{ROOT}:{ROOT}/tests", "HOME": str(Path.home())}
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *what],
        cwd=ROOT,
        env=found | variables, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout
    return ended.stdout.splitlines()


@pytest.mark.whole
def test_without_the_firmware_s_tools_one_line_says_what_to_install():
    printed = printed_of("tests/firmware/test_size.py", "tests/firmware/test_simulated_uno.py")
    (line,) = [line for line in printed if "SKIPPED" in line]
    (progress,) = [line for line in printed if line.endswith("[100%]")]
    count = progress.partition(" ")[0].count("s")
    assert count > 10
    assert line == f"SKIPPED [{count}] to run them: sudo apt install {' '.join(needs.SIMULATOR)}"


@pytest.mark.whole
def test_without_recordings_one_line_says_where_they_are_looked_for(tmp_path):
    found = "tests/domains/test_crazyflie.py", "-k", "directly_below"
    printed = printed_of(*found, WAKEDEPLOY_DATA=str(tmp_path))
    assert [line for line in printed if "SKIPPED" in line] == [
        f"SKIPPED [2] {needs.no_recordings('crazyflie')}"
    ]


@pytest.mark.parametrize("package", [*needs.SIMULATOR, "g++", "postgresql", "systemd"])
def test_what_a_line_says_to_install_is_what_ci_installs(package):
    assert package in (ROOT / ".ci" / "run").read_text().replace("(", " ").replace(")", " ").split()


def test_other_reasons_are_told_once_each():
    reasons = [
        "Skipped: no CUDA",
        "not installed: g++ gcc",
        "Skipped: no CUDA",
        "not installed: g++",
    ]
    assert needs.skipped_lines(reasons) == [
        "SKIPPED [2] no CUDA",
        "SKIPPED [2] to run them: sudo apt install g++ gcc",
    ]
    assert needs.skipped_lines([]) == []


@pytest.mark.whole
def test_a_test_that_ran_again_is_told_with_what_went_wrong(tmp_path):
    (tmp_path / "test_late.py").write_text(
        "tries = []\n"
        "def test_in_real_time():\n"
        "    tries.append(1)\n"
        "    assert len(tries) > 1, 'a tick came late'\n"
    )
    printed = printed_of(str(tmp_path), "-p", "conftest", "--reruns", "2")
    (line,) = [line for line in printed if line.startswith("RETRIED")]
    assert line.endswith("test_late.py::test_in_real_time: AssertionError: a tick came late")
    assert "1 passed, 1 rerun" in printed[-1]
