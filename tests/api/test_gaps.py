"""The gap workflow from Python: what the command writes, as an object that shows itself."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

import wakedeploy as wd
from wakedeploy.gap.systems.gantry.artefacts import Result
from wakedeploy.gap.systems.gantry.folder import write
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds
from wakedeploy.gap.systems.gantry.search.threshold import _cache_path


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> wd.Gap:
    """Of one flight, for which nothing is concluded; the rig's thresholds are known."""
    folder = tmp_path_factory.mktemp("closed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        cached = _cache_path(wd.default_rig())
        cached.parent.mkdir(parents=True)
        cached.write_text(json.dumps(asdict(Thresholds(6.0, 8.0, 8.0, 60.0, 0.03, 0.03, 0.003))))
        wd.default_rig().write(folder / "rig.toml")
        flight = wd.fly(seconds=12, seed=7, log=folder / "flight.mcap")
        return wd.close_gap(folder / "rig.toml", [flight], folder / "gap", report=False)


@pytest.mark.slow
def test_of_one_flight_it_concludes_nothing_and_says_so(closed: wd.Gap) -> None:
    assert closed.effects == closed.classes == ()
    assert closed.rig is closed.corrected is None
    assert closed.plot().axes
    assert "flight" in closed.account
    assert closed.result.as_json() == json.loads((closed.folder / "result.json").read_text())
    assert wd.Gap.read(closed.folder).account == closed.account
    assert closed.account.splitlines()[0] in closed._repr_html_()


@pytest.fixture
def named(tmp_path: Path) -> wd.Gap:
    """What a folder tells that names an effect."""
    gain = {"value": 0.31, "low": 0.25, "high": 0.36, "unit": "1"}
    effect = {"name": "ground-effect", "confidence": 1.0, "parameters": {"gain": gain}}
    write(tmp_path, Result.model_validate({"verdict": "named", "effects": [effect]}))
    return wd.Gap.read(tmp_path)


def test_what_was_named_is_at_hand(named: wd.Gap) -> None:
    assert (named.verdict, named.effects) == ("named", ("ground-effect",))
    assert repr(named) == f"<Gap in {named.folder}: named: ground-effect>"


def test_its_parameters_are_a_table(named: wd.Gap) -> None:
    pytest.importorskip("pandas", reason="the extra notebook is not installed")
    (row,) = named.to_pandas().to_dict("records")
    assert row == {"effect": "ground-effect", "parameter": "gain", "value": 0.31,
                   "low": 0.25, "high": 0.36, "unit": "1"}  # fmt: skip


def test_what_was_not_shown_is_not_drawn_and_what_was_not_kept_is_no_ranking(named: wd.Gap) -> None:
    assert named.corrected is None
    with pytest.raises(wd.UnusableInput, match="nothing is shown yet"):
        named.plot()
    with pytest.raises(wd.UnusableInput, match=r"there is no name\.json"):
        named.to_pandas("ranking")


def test_a_folder_without_a_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(wd.UnusableInput, match=r"there is no result\.json"):
        wd.Gap.read(tmp_path)


def test_a_flight_that_lies_in_no_file_is_refused(tmp_path: Path) -> None:
    wd.default_rig().write(tmp_path / "rig.toml")
    with pytest.raises(wd.UnusableInput, match="was not recorded in a file; fly it with log="):
        wd.close_gap(tmp_path / "rig.toml", [wd.fly(seconds=6)], tmp_path / "gap")
