"""What a study's folder says, and keeps of an earlier one and of whoever else put files there."""

import json
import subprocess
from pathlib import Path

import numpy as np

from trainers.training.runs import TRAINING
from wakedeploy.cli.study_options import Asked
from wakedeploy.core import figures
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.study.folder import Part, write_study


def part(name: str) -> Part:
    figure, axes = figures.figure(size=(2.0, 2.0))
    axes.plot([0.0, 1.0])
    return Part(name, f"{name}.", ["a"], [[1]], figure)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_only_what_the_earlier_study_wrote_is_removed(tmp_path: Path) -> None:
    own = {"notes.csv", "talk.pdf", "photo.png", "mine.json", "page.html"}
    for name in own:
        (tmp_path / name).write_text("mine")
    write_study(tmp_path, "First", [part("one"), part("two")], {"seeds": 3}, [])
    assert names(tmp_path) == own | {
        *("one.png", "one.pdf", "one.csv", "two.png", "two.pdf", "two.csv"),
        *("study.json", "study.html"),
    }
    write_study(tmp_path, "Again", [part("two")], {"seeds": 3}, [])
    assert names(tmp_path) == own | {"two.png", "two.pdf", "two.csv", "study.json", "study.html"}
    assert all((tmp_path / name).read_text() == "mine" for name in own)


def test_a_result_that_names_files_elsewhere_removes_none(tmp_path: Path) -> None:
    outside = tmp_path / "outside.csv"
    outside.write_text("mine")
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "study.json").write_text('{"files": ["../outside.csv", "..", "", 3]}')
    write_study(folder, "Study", [part("one")], {}, [])
    assert outside.read_text() == "mine"
    (folder / "study.json").write_text("[")
    write_study(folder, "Study", [part("one")], {}, [])


def test_a_result_says_which_code_and_which_sets_it_is_of(tmp_path: Path) -> None:
    signal = np.zeros((8, 1), np.float32)
    channels = (Channel("drive", "N"),), (Channel("force_z_n", "N"),)
    made = EpisodeSet("gantry", 20.0, *channels, 0.5, (1.0,), {"a": "train"},
                      (Episode("a", signal, signal),))  # fmt: skip
    write_study(tmp_path, "Study", [part("one")], {"seeds": 3}, [made])
    told = json.loads((tmp_path / "study.json").read_text())
    assert told["sets"] == [{"domain": "gantry", "sha256": made.sha256}]
    assert (told["training"], told["seeds"]) == (TRAINING, 3)
    git = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=Path(__file__).parent, capture_output=True
    )
    assert git.stdout.decode().startswith(told["commit"].removesuffix("-dirty"))
    assert bool(told["commit"]) == (git.returncode == 0)


def test_quick_looks_and_chosen_domains_lie_apart() -> None:
    whole, quick = (Asked(3, Path("out"), quick) for quick in (False, True))
    assert whole.results("domains") == Path("out/domains")
    assert quick.results("domains") == Path("out/domains-quick")
    assert whole.results("domains", ("gantry", "fish")) == Path("out/domains-gantry-fish")
    assert quick.results("domains", ("gantry",)) == Path("out/domains-gantry-quick")
