"""All eight, trained for a moment on real recordings, keep their force through export."""

import json
from pathlib import Path

import needs
import pytest
from click.testing import CliRunner

from trainers.build import ARCHITECTURES
from wakedeploy.cli import main
from wakedeploy.core.package import read_package

pytestmark = [pytest.mark.slow, needs.recordings("fish")]


def wakedeploy(*arguments: object) -> None:
    done = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fish")
    wakedeploy("data", "import", "fish", needs.DATA / "fish", "--out", folder / "set")
    wakedeploy(
        "train", "--data", folder / "set", "--arch", "all", "--seeds", 1, "--epochs", 2,
        "--out", folder / "runs",
    )  # fmt: skip
    return folder


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_a_run_on_real_recordings_is_exported_and_checked(arch: str, session: Path) -> None:
    package, verdict = session / f"{arch}.onnx", session / f"{arch}.json"
    wakedeploy(
        "export", "--arch", arch, "--runs", session / "runs", "--data", session / "set",
        "--out", package,
    )  # fmt: skip
    wakedeploy("check", package, "--json", verdict)
    result = json.loads(verdict.read_text())
    assert result["ok"]
    assert result["parity"]["steps"] >= 3200
    assert result["parity"]["max_rel"] <= read_package(package).manifest.parity.limit
