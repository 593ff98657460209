"""Which stretches of a log are held out."""

from pathlib import Path

import numpy as np
import pytest

import wakedeploy as wd
from wakedeploy.core.episodes import SPLITS

COLUMNS = """
version = 1
[time]
column = "t"
unit = "s"
[training]
window_s = 0.2
[columns.speed_mps]
column = "v"
role = "observation"
unit = "m/s"
missing = "split"
[columns.drag_n]
column = "f"
role = "force"
unit = "N"
"""


def imported(folder: Path, gaps: list[int]) -> wd.EpisodeSet:
    """A log of 12 s whose force is the time, and in which some samples have no speed."""
    t = np.arange(600) / 50
    v = np.sin(t)
    v[gaps] = np.nan
    np.savetxt(folder / "run.csv", np.column_stack([t, v, t]), "%.6g", ",", "\n", "t,v,f", "", "")
    (folder / "columns.toml").write_text(COLUMNS)
    return wd.import_table(folder / "run.csv", folder / "columns.toml")


def test_the_end_of_a_log_is_held_out_where_readings_are_missing_often(tmp_path: Path) -> None:
    """Its recordings are short, the first one of three samples: none can be cut by itself."""
    made = imported(tmp_path, [3, *range(25, 600, 25)])
    times = {s: np.concatenate([e.force[:, 0] for e in made.part(s)]) for s in SPLITS}
    assert [times[s].min() for s in SPLITS] == pytest.approx([0.08, 8.4, 10.2], abs=0.25)
    assert [times[s].max() for s in SPLITS] == pytest.approx([8.4, 10.2, 12.0], abs=0.25)


def test_a_log_of_a_few_samples_is_not_cut(tmp_path: Path) -> None:
    with pytest.raises(wd.UnusableInput, match=r"^run: has 7 samples, too few to cut into splits"):
        imported(tmp_path, list(range(7, 600)))


def test_a_log_of_which_nothing_is_left_for_a_split_is_not_cut(tmp_path: Path) -> None:
    """Of 15 rows validation has two, and a missing reading stands between them."""
    with pytest.raises(wd.UnusableInput, match=r"^run: has 14 samples, too few to cut into splits"):
        imported(tmp_path, [11, *range(15, 600)])


FALLING = COLUMNS.replace('unit = "s"', 'unit = "s"\nfalling = "split"', 1)
SILENT = COLUMNS + "[split]\ngap_s = 0.5\n"


def of_trials(folder: Path, columns: str, trials: list[tuple[float, int]]) -> wd.EpisodeSet:
    """A log of trials, each from a time on and so many samples long; the force is its number."""
    t = np.concatenate([begin + np.arange(samples) / 50 for begin, samples in trials])
    number = np.repeat(np.arange(len(trials)), [samples for _, samples in trials])
    np.savetxt(
        folder / "run.csv", np.column_stack([t, np.sin(t), number]), "%.6g", ",", "\n", "t,v,f",
        comments="",
    )  # fmt: skip
    (folder / "columns.toml").write_text(columns)
    return wd.import_table(folder / "run.csv", folder / "columns.toml")


def samples_of(made: wd.EpisodeSet) -> dict[str, list[int]]:
    """How many samples of each trial are in each split."""
    forces = {s: np.concatenate([e.force[:, 0] for e in made.part(s)]) for s in SPLITS}
    return {s: [int((forces[s] == number).sum()) for number in range(3)] for s in SPLITS}


@pytest.mark.parametrize(
    ("columns", "begins"), [(FALLING, (0.0, 0.0, 0.0)), (SILENT, (0.0, 10.0, 20.0))]
)
def test_of_each_trial_in_a_log_the_end_is_held_out(
    columns: str, begins: tuple[float, ...], tmp_path: Path
) -> None:
    made = of_trials(tmp_path, columns, [(begin, 200) for begin in begins])
    assert samples_of(made) == {"train": [140] * 3, "validation": [30] * 3, "test": [30] * 3}


def test_trials_that_are_too_short_to_be_cut_are_held_out_as_a_whole(tmp_path: Path) -> None:
    made = of_trials(tmp_path, FALLING, [(0.0, 40)] * 3)
    assert samples_of(made) == {"train": [40, 40, 0], "validation": [0, 0, 18], "test": [0, 0, 18]}
