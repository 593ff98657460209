"""The sweep over leads finds what the rig's delays say."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

SWEEP = ("bench", "lead", "--flights", "1", "--seconds", "10", "--step")


@pytest.mark.slow
def test_the_best_lead_lies_near_the_default_and_beats_none(tmp_path: Path) -> None:
    path = tmp_path / "lead.json"
    result = CliRunner().invoke(main, [*SWEEP, "0.03", "--json", str(path)])
    assert result.exit_code == 0, result.output
    told = json.loads(path.read_text())
    errors = {row["lead_s"]: row["rmse_mm"] for row in told["rows"]}
    assert told["best_s"] == pytest.approx(default_lead_s(default_rig()), abs=0.045)
    assert errors[told["best_s"]] < 0.6 * errors[0.0]


@pytest.mark.whole
def test_motors_that_follow_at_once_need_little_lead(tmp_path: Path) -> None:
    rig, path = tmp_path / "rig.toml", tmp_path / "lead.json"
    default_rig().without("spool").write(rig)
    asked = [*SWEEP, "0.06", "--rig", str(rig), "--json", str(path)]
    CliRunner().invoke(main, asked, catch_exceptions=False)
    assert json.loads(path.read_text())["best_s"] <= 0.06
