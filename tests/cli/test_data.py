"""`data make` and `data show`: a set is made, described in words and numbers, and told as JSON."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet, read_episode_set


@pytest.mark.whole
def test_a_gantry_set_is_made_and_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wakedeploy.domains.gantry.EPISODE_S", 8.0)
    out, told = tmp_path / "gantry", tmp_path / "made.json"
    make = ["data", "make", "gantry", "--out", str(out), "--minutes", "0.4", "--seed", "3"]
    assert CliRunner().invoke(main, [*make, "--json", str(told)]).exit_code == 0
    made = read_episode_set(out)
    assert made.domain == "gantry"
    assert set(made.split.values()) == {"train", "validation", "test"}
    shown = CliRunner().invoke(main, ["data", "show", str(out), "--json", str(tmp_path / "s.json")])
    assert shown.exit_code == 0
    assert "force_z_n" in shown.output
    described = json.loads((tmp_path / "s.json").read_text())
    assert described == json.loads(told.read_text())
    assert described["sha256"] == made.sha256
    assert sum(part["episodes"] for part in described["splits"]) == len(made.episodes)


def recorded(count: int) -> EpisodeSet:
    """Short recordings in turn for each split, with what was noticed of them."""
    names = [f"boat-{i:02d}" for i in range(count)]
    values = np.zeros((30, 1), np.float32)
    return EpisodeSet(
        domain="boats",
        rate_hz=10.0,
        observation=(Channel("speed_mps", "m/s"),),
        force=(Channel("force_n", "N"),),
        window_s=0.5,
        loss_weights=(1.0,),
        split={name: ("train", "validation", "test")[i % 3] for i, name in enumerate(names)},
        episodes=tuple(Episode(name, values, values) for name in names),
        provenance={
            "generator": "wakedeploy 0.2 table",
            "files": dict.fromkeys(names, "00"),
            "notes": [f"{name}: 3 stamps fell" for name in names],
        },
    )


def test_a_set_lists_its_recordings_with_split_notes_and_provenance(tmp_path: Path) -> None:
    recorded(4).write(tmp_path / "boats")
    done = CliRunner().invoke(main, ["data", "show", str(tmp_path / "boats")])
    assert done.exit_code == 0, done.output
    cells = [line.replace("│", " ").split() for line in done.output.splitlines()]
    for name, split in recorded(4).split.items():
        assert [name, split, "3.0"] in cells
    assert ["files", "4", "entries", "(--json)"] in cells
    assert "wakedeploy 0.2 table" in done.output
    assert "Note: boat-03: 3 stamps fell." in done.output
    assert "more" not in done.output


def test_of_many_recordings_the_first_are_shown_and_all_written(tmp_path: Path) -> None:
    recorded(25).write(tmp_path / "boats")
    told = tmp_path / "told.json"
    asked = ["data", "show", str(tmp_path / "boats"), "--json", str(told)]
    done = CliRunner().invoke(main, asked)
    assert "boat-19" in done.output
    assert "boat-20" not in done.output
    assert "… and 5 more episodes; --json FILE has all." in done.output
    assert "… and 5 more notes; --json FILE has all." in done.output
    found = {e["name"]: e["split"] for e in json.loads(told.read_text())["episodes"]}
    assert found == recorded(25).split


def test_what_is_no_set_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "dataset.json").write_text("[]")
    result = CliRunner().invoke(main, ["data", "show", str(tmp_path)])
    assert result.exit_code == 2
    assert "dataset.json: is not the description of an episode set" in result.stderr


def test_an_unusable_rig_leaves_nothing(tmp_path: Path) -> None:
    rig, out = tmp_path / "rig.toml", tmp_path / "out"
    rig.write_text("schema = 99\n")
    make = ["data", "make", "gantry", "--out", str(out), "--minutes", "1"]
    result = CliRunner().invoke(main, [*make, "--rig", str(rig)])
    assert result.exit_code == 2
    assert "schema 99 is newer" in result.stderr
    assert not out.exists()


@pytest.mark.parametrize("domain", ["gantry", "downwash", "ship"])
def test_a_folder_that_cannot_be_written_to_is_told_before_anything_is_simulated(
    domain: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        f"wakedeploy.domains.{domain}.make_set", lambda *_, **__: pytest.fail("flew")
    )
    (tmp_path / "file").write_text("mine")
    make = ["data", "make", domain, "--minutes", "1", "--out"]
    for out, words in (("file", "is a file"), ("file/below", "cannot be written to")):
        result = CliRunner().invoke(main, [*make, str(tmp_path / out)])
        assert result.exit_code == 2, result.output
        assert words in " ".join(result.stderr.split())
    assert (tmp_path / "file").read_text() == "mine"
