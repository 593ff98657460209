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
