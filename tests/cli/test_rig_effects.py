"""`rig show` on rig files with effects: shown with their values, refused where unknown."""

from pathlib import Path

from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.rig.file import default_rig_text


def test_effects_are_shown_with_their_values_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    entry = (
        '\n[[effect]]\nname = "{}"\n'
        'parameters = {{ sag_per_s = {{ value = 0.012, unit = "1/s" }} }}\n'
    )
    path.write_text(default_rig_text() + entry.format("battery-sag"), encoding="utf-8")
    shown = CliRunner().invoke(main, ["rig", "show", str(path)])
    assert shown.exit_code == 0
    line = next(line for line in shown.output.splitlines() if "battery-sag.sag_per_s" in line)
    assert "0.012" in line
    assert "1/s" in line
    path.write_text(default_rig_text() + entry.format("ghost"), encoding="utf-8")
    refused = CliRunner().invoke(main, ["rig", "show", str(path)])
    assert refused.exit_code == 2
    assert "'ghost'" in refused.stderr


def test_constants_have_units_and_no_effect_is_said() -> None:
    shown = CliRunner().invoke(main, ["rig", "show"]).output
    words = [line.replace("│", " ").split() for line in shown.splitlines()]
    assert ["effect", "none"] in words
    mass = next(line for line in words if line[:1] == ["sufferer.mass_kg"])
    assert mass[2] == "kg"
