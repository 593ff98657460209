"""The import rules cover every module: a new one is ground, or stands above it, by decision."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
ABOVE_THE_GROUND = {"cli", "domains", "gap", "study", "__init__", "__main__", "__pycache__"}


def test_every_module_of_the_ground_is_named_in_its_rule() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    ground, *_ = settings["tool"]["importlinter"]["contracts"]
    folder = ROOT / "wakedeploy"
    modules = {p.stem for p in folder.iterdir() if p.suffix == ".py" or p.is_dir()}
    named = {name.removeprefix("wakedeploy.") for name in ground["source_modules"]}
    assert named == modules - ABOVE_THE_GROUND
