"""A package runs in ONNX Runtime without any of this project, as its page says."""

import re
from pathlib import Path

import numpy as np
import pytest

from runtime.predictor import PackagePredictor
from runtime.replay import rolled_out
from trainers.build import ARCHITECTURES
from wakedeploy.core.package import write_package

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "package.md"


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_the_page_s_few_lines_give_the_runner_s_forces(
    arch: str, exported_arch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = exported_arch(arch).package
    write_package(package, tmp_path / "package.onnx")
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text("utf-8"), re.M | re.S)
    names: dict[str, object] = {}
    exec(compile(code, str(PAGE), "exec"), names)
    low, high = np.transpose([(c.min, c.max) for c in package.manifest.observation])
    series = np.random.default_rng(0).uniform(low, high, (200, len(low))).astype(np.float32)
    given = np.array([names["step"](row) for row in series])
    expected = rolled_out(PackagePredictor(package), series)
    np.testing.assert_allclose(given, expected, rtol=1e-6, atol=1e-7)
