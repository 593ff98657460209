"""Presets in sweeps: what they change, for which architecture, and how rows and table name them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from trainers.training.trainer import configure, settings_for
from wakedeploy.core.episodes import read_episode_set
from wakedeploy.core.errors import UnusableInput
from wakedeploy.sweep.plan import read_plan

TUNED = """format = 1
arch = "gru"
[hyper]
hidden = 5
head = 6
[settings]
learning_rate = 0.004
"""


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tuned preset of the GRU ships for the small set's domain."""
    (tmp_path / "presets/toy").mkdir(parents=True)
    (tmp_path / "presets/toy/gru.toml").write_text(TUNED)
    monkeypatch.setattr("trainers.preset.SHIPPED", tmp_path / "presets")


def test_the_tuned_are_trained_beside_the_reference(
    small: Path, tmp_path: Path, shipped: None, wakedeploy: Callable, lines: Callable
) -> None:
    out = tmp_path / "out"
    asked = ("--data", small, "--arch", "gru", "--epochs", 1, "--preset", "reference,tuned")
    told = wakedeploy("sweep", *asked, "--hyper", "gru.head=4,6", "--workers", 1, "--out", out)
    assert told.exit_code == 0, told.output
    data = read_episode_set(small)
    rows = lines(out)
    assert [(row["preset"], row["hyper"]["hidden"], row["hyper"]["head"]) for row in rows] == [
        ("reference", configure(data, "gru", seed=0, lead_s=0.0).hyper["hidden"], 4),
        ("reference", configure(data, "gru", seed=0, lead_s=0.0).hyper["hidden"], 6),
        ("tuned", 5, 4),
        ("tuned", 5, 6),
    ]
    rates = [row["settings"]["learning_rate"] for row in rows]
    assert rates == [settings_for("gru").learning_rate] * 2 + [0.004] * 2
    assert {row["settings"]["epochs"] for row in rows} == {1}
    for preset in ("reference", "tuned"):
        for head in (4, 6):
            assert f"preset {preset}, head {head}" in " ".join(told.output.split())


def test_a_tuned_preset_of_the_papers_shape_is_trained_once_and_named_beside_it(
    small: Path, tmp_path: Path, shipped: None, wakedeploy: Callable, lines: Callable
) -> None:
    (tmp_path / "presets/toy/gru.toml").write_text(
        TUNED.split("[hyper]")[0] + "[hyper]\n[settings]"
    )
    asked = ("--data", small, "--arch", "gru", "--epochs", 1, "--preset", "reference,tuned")
    told = wakedeploy("sweep", *asked, "--workers", 1, "--out", tmp_path / "out")
    assert told.exit_code == 0, told.output
    assert [row["preset"] for row in lines(tmp_path / "out")] == ["reference, tuned"]


def test_seeds_that_were_added_with_another_preset_of_the_same_shape_are_one_line(
    small: Path, tmp_path: Path, shipped: None, wakedeploy: Callable, lines: Callable
) -> None:
    (tmp_path / "presets/toy/gru.toml").write_text(
        TUNED.split("[hyper]")[0] + "[hyper]\n[settings]"
    )
    asked = ("--data", small, "--arch", "gru", "--epochs", 1, "--workers", 1)
    into = ("--out", tmp_path / "out", "--json", tmp_path / "t.json")
    assert wakedeploy("sweep", *asked, *into, "--hyper", "gru.hidden=4,4,5").exit_code == 0
    both = ("--preset", "reference,tuned", "--hyper", "gru.hidden=4,5", "--seeds", 2)
    told = wakedeploy("sweep", *asked, *both, *into)
    assert told.exit_code == 0, told.output
    presets = [row["preset"] for row in lines(tmp_path / "out")]
    assert presets == ["reference"] * 2 + ["reference, tuned"] * 2
    table = [line for line in told.output.splitlines() if " gru " in f" {line} "]
    assert len(table) == 2  # one line for each width


def test_a_preset_that_does_not_ship_is_refused_before_anything_is_trained(
    small: Path, tmp_path: Path, shipped: None, wakedeploy: Callable
) -> None:
    asked = ("--data", small, "--arch", "gru,tcn", "--epochs", 1, "--preset", "tuned")
    told = wakedeploy("sweep", *asked, "--workers", 1, "--out", tmp_path / "out")
    assert told.exit_code == 2
    assert "No tuned preset of tcn ships for toy sets" in told.output
    assert not (tmp_path / "out/runs").exists()


def test_a_file_is_for_its_architecture_and_lies_beside_the_plan(
    small: Path, tmp_path: Path
) -> None:
    (tmp_path / "best.toml").write_text(TUNED)
    plan = tmp_path / "plan.toml"
    head = f'data = "{small.name}"\narch = ["gru", "tcn"]\n'
    plan.write_text(head + 'preset = ["reference", "best.toml"]\n')
    assert [(c.arch, c.preset) for c in read_plan(plan).choices] == [
        ("gru", "reference"),
        ("gru", str(tmp_path / "best.toml")),
        ("tcn", "reference"),
    ]
    plan.write_text(head + 'preset = "best.toml"\n')
    with pytest.raises(UnusableInput, match="line 3: none of these is a preset of tcn"):
        read_plan(plan)
    plan.write_text(head.replace('"gru", ', "") + 'preset = ["reference", "best.toml"]\n')
    with pytest.raises(UnusableInput, match=r"'best.toml' is a preset of gru, which is not among"):
        read_plan(plan)
    with pytest.raises(UnusableInput, match=r"--preset: gone.toml does not exist"):
        read_plan(plan, {"preset": ["gone.toml"]})
