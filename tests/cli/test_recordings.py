"""One rule for where recordings are looked for: as told, then the variable, then nowhere."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.cli.recordings import VARIABLE, recordings_folder
from wakedeploy.core.errors import UnusableInput


def test_what_is_told_comes_first_then_the_variable(tmp_path, monkeypatch) -> None:
    told, set_ = tmp_path / "told", tmp_path / "set"
    told.mkdir()
    set_.mkdir()
    monkeypatch.delenv(VARIABLE, raising=False)
    assert recordings_folder(None) is None
    assert recordings_folder(told) == told
    monkeypatch.setenv(VARIABLE, "")
    assert recordings_folder(None) is None
    monkeypatch.setenv(VARIABLE, str(set_))
    assert recordings_folder(None) == set_
    assert recordings_folder(told) == told
    monkeypatch.setenv(VARIABLE, str(tmp_path / "gone"))
    with pytest.raises(UnusableInput, match=rf"gone is no folder; give {VARIABLE} one"):
        recordings_folder(None)


@pytest.mark.parametrize(
    "asked",
    [["study", "domains", "--domains", "fish"], ["gap", "domain", "fish"]],
)
def test_studies_and_the_gap_look_in_the_same_place(tmp_path: Path, asked) -> None:
    """A recording that cannot be used is found, and told by its name."""
    (tmp_path / "data" / "fish").mkdir(parents=True)
    (tmp_path / "data" / "fish" / "here_Foil.mat").write_bytes(b"")
    out = ["--out", str(tmp_path / "out")]
    told = CliRunner().invoke(main, [*asked, *out], env={VARIABLE: str(tmp_path / "data")})
    assert told.exit_code == 2
    assert "here_Flag2.mat: not found" in told.output.replace("\n", "")
    told = CliRunner().invoke(main, [*asked, *out], env={VARIABLE: None})
    assert told.exit_code == 2
    assert "here_Flag2.mat" not in told.output
