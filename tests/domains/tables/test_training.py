"""Logs as a set: the splits, the channels, the command, and what training takes of it."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import wakedeploy as wd
from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel
from wakedeploy.core.errors import UnusableInput

COLUMNS = """
version = 1
[time]
column = "t"
[training]
name = "axis"
window_s = 0.2
[columns.speed]
column = "v"
role = "observation"
unit = "mm/s"
[columns.drag]
column = "f"
role = "force"
unit = "gf"
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("columns.toml").write_text(COLUMNS, "utf-8")
    for k in range(4):
        t = np.arange(400) / 100
        v, f = 100 * np.sin(t + k), 10 * np.cos(2 * t + k)
        np.savetxt(f"run{k}.csv", np.column_stack([t, v, f]), delimiter=",", header="t,v,f",
                   comments="")  # fmt: skip
    return tmp_path


def wakedeploy(*words: str, status: int = 0) -> str:
    told = CliRunner().invoke(main, list(words))
    assert told.exit_code == status, told.output
    return told.output


@pytest.mark.parametrize(("unit", "to", "scale"), [("m", "m", 1.0), ("km", "m", 1e-3)])
def test_a_position_far_from_its_origin_is_not_rounded_to_a_few_steps(
    unit: str, to: str, scale: float, here: Path
) -> None:
    """Of UTM coordinates single precision keeps half metres; the offset that is advised helps."""
    t = np.arange(400) / 100
    for k, path in enumerate(sorted(here.glob("run*.csv"))):
        north = scale * (5_612_345.0 + np.sin(t + k))
        table = np.column_stack([t, north, 10 * np.cos(2 * t + k)])
        np.savetxt(path, table, "%.12g", ",", header="t,v,f", comments="")
    text = COLUMNS.replace('unit = "mm/s"', f'unit = "{unit}"\nto = "{to}"')
    Path("columns.toml").write_text(text.replace("columns.speed", "columns.north_m"), "utf-8")
    files = sorted(here.glob("run*.csv"))
    said = r"stays near 5\.6.*e\+06 m and changes by 0\.6.* in steps of 0\.5 there; give offset = "
    with pytest.raises(UnusableInput, match=said) as refused:
        wd.import_table(files, "columns.toml")
    (advised,) = re.findall(r"give (offset = \S+),", str(refused.value))
    text = (
        Path("columns.toml").read_text("utf-8").replace(f'to = "{to}"', f'to = "{to}"\n{advised}')
    )
    Path("columns.toml").write_text(text, "utf-8")
    seen = wd.import_table(files, "columns.toml").episodes[0].observation[:, 0]
    moved = seen - seen[0]
    np.testing.assert_allclose(moved, np.sin(t) - np.sin(t[0]), atol=2e-3)


def test_a_copy_with_a_row_left_out_is_no_other_recording(here: Path) -> None:
    lines = Path("run0.csv").read_text().splitlines(keepends=True)
    Path("run3.csv").write_text("".join(lines[:200] + lines[201:]))
    text = COLUMNS.replace("window_s = 0.2", 'window_s = 0.2\ntest = ["run3"]')
    text += "[resample]\nrate_hz = 100\n[split]\ngap_s = 0.015\n"
    Path("columns.toml").write_text(text, "utf-8")
    with pytest.raises(UnusableInput, match=r"run3: 100% of it is in run0, too, row after row"):
        wd.import_table(sorted(here.glob("run*.csv")), "columns.toml")


def test_recordings_that_are_alike_here_and_there_are_no_copies(here: Path) -> None:
    """A switched command at other moments, answered without noise, in three decimals."""
    rng = np.random.default_rng(0)
    for path in sorted(here.glob("run*.csv")):
        on, shown = rng.random(20) < 0.5, [0.0]
        for k in range(3999):
            shown.append(shown[-1] + 0.05 * (float(on[k // 200]) - shown[-1]))
        v = np.round(shown, 3)
        table = np.column_stack([np.arange(4000) / 100, v, np.round(2 * v * v, 3)])
        np.savetxt(path, table, "%.3f", ",", header="t,v,f", comments="")
    assert len(wd.import_table(sorted(here.glob("run*.csv")), "columns.toml").episodes) == 4
    assert len(wd.import_table(["run0.csv"], "columns.toml").episodes) == 3


def test_whole_files_are_held_out_where_there_are_enough(here: Path) -> None:
    files = sorted(here.glob("run*.csv"))
    made = wd.import_table(files, "columns.toml")
    assert (made.domain, made.rate_hz, made.window_s) == ("axis", 100.0, 0.2)
    assert made.observation == (Channel("speed", "m/s"),)
    assert made.force == (Channel("drag", "N"),)
    assert dict(made.split) == {
        "run0": "train", "run1": "train", "run2": "validation", "run3": "test",
    }  # fmt: skip
    t = np.arange(400) / 100
    np.testing.assert_allclose(made.episodes[1].observation[:, 0], 0.1 * np.sin(t + 1), atol=1e-7)
    np.testing.assert_allclose(
        made.episodes[1].force[:, 0], 0.0980665 * np.cos(2 * t + 1), atol=1e-7
    )
    assert list(made.provenance["files"]) == [f"run{k}.csv" for k in range(4)]


def test_logs_whose_clocks_jitter_are_at_the_rate_that_was_meant(here: Path) -> None:
    """Each log of 100 Hz tells another rate in the sixth digit; sets of them have one."""
    rng = np.random.default_rng(5)
    for file in FOUR:
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        rows[:, 0] += rng.uniform(-0.0015, 0.0015, len(rows))
        np.savetxt(file, rows, delimiter=",", header="t,v,f", comments="")
    told = {wd.read_log(file, "columns.toml")[0].rate_hz for file in FOUR}
    assert len(told | {100.0}) == 5
    made = [wd.import_table([*pair], "columns.toml") for pair in (FOUR[:2], FOUR[2:])]
    assert [each.rate_hz for each in made] == [100.0, 100.0]
    asked = COLUMNS + "[resample]\nrate_hz = 99.999\n"
    Path("columns.toml").write_text(asked, "utf-8")
    assert wd.import_table(FOUR, "columns.toml").rate_hz == 99.999


def test_one_file_is_cut_by_time_and_names_decide_where_they_are_given(here: Path) -> None:
    made = wd.import_table("run0.csv", "columns.toml")
    assert {e.name: len(e) for e in made.episodes} == {
        "run0-train": 280, "run0-validation": 60, "run0-test": 60,
    }  # fmt: skip
    named = COLUMNS.replace("[training]", '[training]\nvalidation = ["run0*"]\ntest = ["run[12]*"]')
    Path("named.toml").write_text(named, "utf-8")
    made = wd.import_table(sorted(here.glob("run*.csv")), "named.toml")
    assert list(made.split.values()) == ["validation", "test", "test", "train"]


def split_by(here: Path, lists: str, *files: str) -> dict[str, str]:
    Path("named.toml").write_text(COLUMNS.replace("[training]", f"[training]\n{lists}"), "utf-8")
    return dict(wd.import_table(list(files), "named.toml").split)


FOUR = tuple(f"run{k}.csv" for k in range(4))


@pytest.mark.parametrize(
    ("lists", "files", "splits"),
    [
        ('test = ["run0*"]', FOUR, {"run0": "test", "run1": "train", "run2": "train",
                                    "run3": "validation"}),
        ('validation = ["run0"]', FOUR, {"run0": "validation", "run1": "train", "run2": "train",
                                         "run3": "test"}),
        ('test = ["run0.csv"]', FOUR[:2], {"run0": "test", "run1-train": "train",
                                           "run1-validation": "validation"}),
        ('held_out = "time"\ntest = ["run0"]', FOUR[:3], {
            "run0": "test", "run1-train": "train", "run1-validation": "validation",
            "run2-train": "train", "run2-validation": "validation"}),
    ],
)  # fmt: skip
def test_one_list_alone_names_a_split_and_the_other_is_drawn_from_the_rest(
    here: Path, lists: str, files: tuple[str, ...], splits: dict[str, str]
) -> None:
    assert split_by(here, lists, *files) == splits


def test_a_copy_under_another_name_is_refused(here: Path) -> None:
    """It could be learned from and tested on."""
    Path("again.csv").write_bytes(Path("run1.csv").read_bytes())
    with pytest.raises(wd.UnusableInput, match=r"^again\.csv: is a copy of run1\.csv, and what a"):
        wd.import_table([*FOUR, "again.csv"], "columns.toml")
    for folder, file in (("one", "run1.csv"), ("other", "run1.csv"), ("third", "run2.csv")):
        Path(folder).mkdir()
        (Path(folder) / "state.csv").write_bytes(Path(file).read_bytes())
    Path("columns.toml").write_text(COLUMNS.replace('unit = "', 'file = "state.csv"\nunit = "'))
    with pytest.raises(wd.UnusableInput, match=r"^other: is a copy of one, "):
        wd.import_table(["one", "other", "third"], "columns.toml")


@pytest.mark.parametrize(
    ("column", "address", "factor"), [(1, "v", 1000.0), (1, "v", 0.001), (2, "f", 1000.0)]
)
def test_a_log_in_another_unit_than_the_others_is_told(
    here: Path, column: int, address: str, factor: float
) -> None:
    rows = np.loadtxt("run1.csv", delimiter=",", skiprows=1)
    rows[:, column] *= factor
    np.savetxt("run1.csv", rows, delimiter=",", header="t,v,f", comments="")
    notes = wd.import_table(FOUR, "columns.toml").provenance["notes"]
    (note,) = [note for note in notes if "another unit" in note]
    assert note.startswith(f"run1.csv, column '{address}': it goes up to ")


def rewritten(file: str, column: int, values: np.ndarray) -> None:
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    rows[:, column] = values
    np.savetxt(file, rows, delimiter=",", header="t,v,f", comments="")


def test_logs_without_a_neighbour_are_in_no_other_unit(here: Path) -> None:
    """Forces of one log are a hundredth of the others', of another all 0; one has an encounter."""
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 0.1, (4, 400))
    for k, scale in enumerate((3.0, 0.0, 0.01, 1.0)):
        wave = np.sin(np.arange(400) / 9)
        rewritten(f"run{k}.csv", 2, scale * (wave + noise[k]))
    notes = wd.import_table(FOUR, "columns.toml").provenance["notes"]
    assert not [note for note in notes if "another unit" in note]
    for k in range(4):
        encounter = 20.0 * (np.arange(400) > 370) * (k == 2)
        rewritten(f"run{k}.csv", 2, noise[k] + encounter)
    notes = wd.import_table(FOUR, "columns.toml").provenance["notes"]
    assert not [note for note in notes if "another unit" in note]


def test_a_log_of_zeros_hides_no_other_unit(here: Path) -> None:
    rewritten("run2.csv", 2, np.zeros(400))
    rewritten("run1.csv", 2, 1e3 * np.loadtxt("run1.csv", delimiter=",", skiprows=1)[:, 2])
    notes = wd.import_table(FOUR, "columns.toml").provenance["notes"]
    assert [note[:8] for note in notes if "another unit" in note] == ["run1.csv"]


def test_what_is_said_of_several_columns_is_said_once_and_names_each(here: Path) -> None:
    rows = np.loadtxt("run0.csv", delimiter=",", skiprows=1)
    more = np.column_stack([rows, *(rows[:, 1] * k for k in (2, 3, 4, 5))])
    text = "t,v,f,m1,m2,m3,m4\n" + "\n".join(",".join(f"{x:.6f}" for x in row) for row in more)
    lines = text.splitlines()
    lines[30] = ",".join([*lines[30].split(",")[:3], "", "", "", ""])
    Path("run0.csv").write_text("\n".join(lines) + "\n")
    entries = "".join(
        f'[columns.m{k}_mps]\ncolumn = "m{k}"\nrole = "observation"\nunit = "m/s"\n'
        'missing = "hold"\n'
        for k in range(1, 5)
    )
    Path("columns.toml").write_text(COLUMNS + entries)
    told = wakedeploy(
        "data", "import", "table", "run0.csv", "--columns", "columns.toml", "--out", "s"
    )
    flat = " ".join(told.split())
    assert flat.count("columns 'm1', 'm2', 'm3', 'm4': 1 sample has no number") == 1


def test_what_many_logs_share_is_printed_once(here: Path) -> None:
    for k, file in enumerate(FOUR):
        lines = Path(file).read_text().splitlines(keepends=True)
        for row in range(20, 22 + k):
            t, v, _ = lines[row].split(",")
            lines[row] = f"{t},{v},\n"
        Path(file).write_text("".join(lines))
    Path("columns.toml").write_text(COLUMNS + 'missing = "hold"\n')
    told = wakedeploy("data", "import", "table", *FOUR, "--columns", "columns.toml", "--out", "set")
    assert told.count("as a label that nobody measured") == 1
    assert "3 more logs are alike" in " ".join(told.split())
    assert len(wd.EpisodeSet.read("set").provenance["notes"]) == 4


def test_a_window_within_one_sample_is_refused(here: Path) -> None:
    """As where stamps in ms were read as seconds: everything would be without memory."""
    Path("columns.toml").write_text(COLUMNS.replace("window_s = 0.2", "window_s = 0.005"))
    with pytest.raises(wd.UnusableInput, match=r"window_s = 0\.005 is less than the 0\.01 s from"):
        wd.import_table(FOUR, "columns.toml")
    for file in FOUR:  # a clock of 99.98 Hz
        rewritten(file, 0, np.arange(400) / 99.98)
    Path("columns.toml").write_text(COLUMNS.replace("window_s = 0.2", "window_s = 0.01"))
    assert wd.import_table(FOUR, "columns.toml").window_s == 0.01


def test_stamps_whose_name_says_another_unit_are_told(here: Path) -> None:
    for file in FOUR:
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        np.savetxt(file, rows, delimiter=",", header="t_ms,v,f", comments="")
    Path("columns.toml").write_text(COLUMNS.replace('column = "t"', 'column = "t_ms"'))
    notes = wd.import_table(FOUR, "columns.toml").provenance["notes"]
    assert notes[0] == (
        "run0.csv, column 't_ms': read as stamps in s, and its name says ms; check the unit in"
        " [time], or time_unit"
    )


def test_a_day_is_held_out_by_its_folder(here: Path) -> None:
    for day, k in (("d1", 0), ("d1", 1), ("d2", 2), ("d2", 3), ("d3", 0)):
        (here / day).mkdir(exist_ok=True)
        rows = Path(f"run{k}.csv").read_text().splitlines(keepends=True)
        if day == "d3":  # another flight than that of the first day: the same, backward
            rows = [rows[0], *(f"{a.partition(',')[0]},{b.partition(',')[2]}"
                               for a, b in zip(rows[1:], rows[:0:-1], strict=True))]  # fmt: skip
        (here / day / f"run{k}-{day}.csv").write_text("".join(rows))
    given = ("d1/run0-d1.csv", "d1/run1-d1.csv", "d2/run2-d2.csv", "d2/run3-d2.csv",
             "d3/run0-d3.csv")  # fmt: skip
    days = {"run0-d1": "train", "run1-d1": "train", "run2-d2": "test", "run3-d2": "test",
            "run0-d3": "validation"}  # fmt: skip
    lists = 'validation = ["d3/*"]\ntest = ["d2/run?-d2"]'
    assert split_by(here, lists, *given) == days
    assert split_by(here, lists, *(str(here / file) for file in given)) == days
    assert "test" in split_by(here, 'test = ["run?-d2"]', *given).values()


@pytest.mark.parametrize(
    ("lists", "sentence"),
    [
        ('test = ["run3", "d1/*"]',
         r"^named\.toml: training\.test: 'd1/\*' matches no log; there are run0\.csv, run1\.csv,"
         r" run2\.csv, run3\.csv\.$"),
        ('validation = ["RUN0*"]', r"training\.validation: 'RUN0\*' matches no log"),
        ('validation = ["run*3"]\ntest = ["run3*"]', r"run3\.csv is in validation and in test"),
        ('test = ["run*"]', r"match all 4 logs, and none is left for training"),
        ('held_out = "files"\ntest = ["run[012]"]',
         r'^run3\.csv: held_out = "files" needs at least 2 logs that training\.test does not name,'
         r" and there is 1; give more, or held_out"),
        ('held_out = "files"\ntest = ["run[123]"]\nvalidation = ["run0"]',
         r"match all 4 logs, and none is left for training"),
    ],
)  # fmt: skip
def test_a_pattern_that_cannot_be_meant_is_refused(here: Path, lists: str, sentence: str) -> None:
    with pytest.raises(wd.UnusableInput, match=sentence):
        split_by(here, lists, *FOUR)


def test_the_only_log_is_not_held_out(here: Path) -> None:
    with pytest.raises(wd.UnusableInput, match=r"test match the only log, and none is left for"):
        split_by(here, 'test = ["run0"]', "run0.csv")
    with pytest.raises(wd.UnusableInput, match=r'^run0\.csv: held_out = "files" needs at least 3'
                       r" logs, and there is 1; give more"):  # fmt: skip
        split_by(here, 'held_out = "files"', "run0.csv")


@pytest.mark.parametrize("pattern", ["run[1].csv", "run[1]", "./d/run[1].csv", "d/run[1]", "./d/*"])
def test_a_name_with_brackets_and_a_path_from_here_name_their_log(here: Path, pattern: str) -> None:
    """As a pattern alone, `run[1]` is run1 and no other."""
    Path("d").mkdir()
    Path("run0.csv").rename("d/run[1].csv")
    found = split_by(here, f'test = ["{pattern}"]', "d/run[1].csv", "run1.csv", "run2.csv")
    assert [name for name, split in found.items() if split == "test"] == ["run-1"]


def test_the_recording_that_is_shorter_than_the_window_is_named(here: Path) -> None:
    lines = Path("run2.csv").read_text().splitlines()
    Path("short.csv").write_text("\n".join(lines[:12]))
    with pytest.raises(
        wd.UnusableInput, match=r"^short: lasts 0\.11 s and is the longest of the te"
    ):
        split_by(here, 'test = ["short"]', "run0.csv", "run1.csv", "short.csv")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"force"', '"output"', "no column has the role 'force'"),
        ('unit = "gf"', 'unit = "gf"\nmissing = "nan"', 'missing = "nan" is nothing to learn from'),
        ("window_s = 0.2", "window_s = 3.0", "no recording that is longer than the window"),
        ("window_s = 0.2", "loss_weights = { x = 1.0 }", "training.loss_weights.x is no force"),
    ],
)
def test_a_set_that_could_not_be_learnt_from_is_refused(
    here: Path, old: str, new: str, sentence: str
) -> None:
    Path("columns.toml").write_text(COLUMNS.replace(old, new), "utf-8")
    with pytest.raises(wd.UnusableInput) as told:
        wd.import_table("run0.csv", "columns.toml")
    assert sentence in str(told.value)


def test_a_set_has_every_number_of_an_observation_that_is_slower_than_its_rate(here: Path) -> None:
    t, slow_t = np.arange(1000) / 100, np.arange(200) / 20
    np.savez("slow.npz", t=t, f=np.cos(t), v=np.sin(slow_t), slow_t=slow_t)
    text = COLUMNS.replace('"v"', '"v"\ntime = "slow_t"') + "[resample]\nrate_hz = 100\n"
    for role in ('"observation"', '["output", "observation"]'):
        Path("columns.toml").write_text(text.replace('"observation"', role), "utf-8")
        made = wd.import_table("slow.npz", "columns.toml")
        seen = np.concatenate([episode.observation[:, 0] for episode in made.episodes])
        held = 1e-3 * np.repeat(np.sin(slow_t), 5)[: len(seen)]
        np.testing.assert_allclose(seen, held, atol=1e-9)


def slow_force(*, jitter_s: float = 0.0) -> None:
    """Observations at 20 Hz and a force of 0.3 Hz, seen at 4 Hz, for 100 s."""
    t, slow_t = np.arange(2000) / 20, np.arange(400) / 4
    t = t + np.random.default_rng(0).uniform(-jitter_s, jitter_s, 2000)
    np.savez("slow.npz", t=t, v=np.sin(t), f=np.sin(0.6 * np.pi * slow_t), slow_t=slow_t)


SLOW = COLUMNS.replace('"f"', '"f"\ntime = "slow_t"').replace('"gf"', '"N"')
SLOW += "%s\n[resample]\nrate_hz = 20\n"


def errors_n(made: wd.EpisodeSet) -> np.ndarray:
    found = np.concatenate([episode.force[:, 0] for episode in made.episodes])
    return np.asarray(found - np.sin(0.6 * np.pi * np.arange(len(found)) / 20))


def test_a_force_that_is_slower_than_the_rate_is_said_and_may_look_ahead(here: Path) -> None:
    slow_force()
    Path("columns.toml").write_text(SLOW % "", "utf-8")
    staircase = wd.import_table("slow.npz", "columns.toml")
    (note,) = staircase.provenance["notes"]
    assert "column 'f': 80 % of the ticks repeat a sample, which is 0.13 s old on average" in note
    assert 'resample = "interpolate" in [columns.drag]' in note
    Path("columns.toml").write_text(SLOW % 'resample = "interpolate"', "utf-8")
    ahead = wd.import_table("slow.npz", "columns.toml")
    assert ahead.provenance["notes"] == []
    rms = [np.sqrt(np.mean(errors_n(made) ** 2)) for made in (staircase, ahead)]
    assert rms[1] < 0.15 * rms[0]


def test_where_samples_repeat_in_holes_their_age_and_a_gap_are_said(here: Path) -> None:
    """A force at the rate with a hole of 0.64 s: a line across it would be no force."""
    t = np.arange(2000) / 25
    seen = np.delete(np.arange(2000), np.arange(1000, 1015))
    np.savez("slow.npz", t=t, v=np.sin(t), f=np.cos(t)[seen], slow_t=t[seen])
    text = (SLOW % "").replace("rate_hz = 20", "rate_hz = 25")
    Path("columns.toml").write_text(text, "utf-8")
    (note,) = wd.import_table("slow.npz", "columns.toml").provenance["notes"]
    age_s = np.mean(np.arange(1, 16) / 25)
    assert f"of the ticks repeat a sample, which is {age_s:.2g} s old on average" in note
    assert "[split] gap_s = 0.34 ends a recording at such holes" in note
    assert "interpolate" not in note
    Path("columns.toml").write_text(f"{text}[split]\ngap_s = 0.34\n", "utf-8")
    notes = wd.import_table("slow.npz", "columns.toml").provenance["notes"]
    assert not any("repeat" in note for note in notes)


def test_no_gap_is_advised_that_a_slower_column_has_between_all_samples(here: Path) -> None:
    t = np.arange(2000) / 25
    seen = np.delete(np.arange(2000), np.arange(1000, 1015))
    np.savez("slow.npz", t=t, v=np.sin(t)[::25], f=np.cos(t)[seen], slow_t=t[seen], v_t=t[::25])
    text = (SLOW % "").replace("rate_hz = 20", "rate_hz = 25")
    text = text.replace('column = "v"', 'column = "v"\ntime = "v_t"')
    Path("columns.toml").write_text(text, "utf-8")
    (note,) = [
        note for note in wd.import_table("slow.npz", "columns.toml").provenance["notes"]
        if "column 'f'" in note
    ]  # fmt: skip
    assert "in holes of the log" in note
    assert "gap_s" not in note
    assert "interpolate" not in note


def test_a_force_in_few_rows_of_a_table_lies_on_lines_between_them(here: Path) -> None:
    t = np.arange(2000) / 20
    cells = [repr(float(np.sin(0.6 * np.pi * s))) if k % 5 == 0 else "" for k, s in enumerate(t)]
    rows = [f"{a!r},{float(np.sin(a))!r},{b}" for a, b in zip(t.tolist(), cells, strict=True)]
    Path("table.csv").write_text("\n".join(["t,v,f", *rows]))
    text = (SLOW % 'missing = "hold"\nresample = "interpolate"').replace('time = "slow_t"', "")
    Path("columns.toml").write_text(text, "utf-8")
    made = wd.import_table("table.csv", "columns.toml")
    (note,) = made.provenance["notes"]
    assert note.endswith("column 'f': 1600 samples have no number; the others alone are taken")
    assert np.sqrt(np.mean(errors_n(made) ** 2)) < 0.03


@pytest.mark.parametrize("way", ["interpolate", "average"])
def test_no_force_is_drawn_beyond_its_last_number(here: Path, way: str) -> None:
    """Numbers at 4 Hz from 10 s to 50 s of 100 s: no line leads on from the last one."""
    t = np.arange(2000) / 20
    has_number = (np.arange(2000) % 5 == 0) & (t >= 10.0) & (t <= 50.0)
    f = np.where(has_number, np.sin(0.6 * np.pi * t), np.nan)
    np.savez("table.npz", t=t, v=np.sin(t), f=f)
    text = (SLOW % f'missing = "hold"\nresample = "{way}"').replace('time = "slow_t"', "")
    Path("columns.toml").write_text(text, "utf-8")
    made = wd.import_table("table.npz", "columns.toml")
    found = np.concatenate([episode.force[:, 0] for episode in made.episodes])
    assert abs(len(found) / 20 - 40.0) < 0.2
    assert np.abs(found - np.sin(0.6 * np.pi * (10.0 + np.arange(len(found)) / 20))).max() < 0.2
    assert np.abs(np.diff(found)).max() < 0.15
    (note,) = made.provenance["notes"]
    assert note.endswith("1839 samples have no number; the others alone are taken, and 60 s before"
                         " the first and after the last are left out")  # fmt: skip


@pytest.mark.parametrize(
    ("way", "sentence"),
    [
        ('resample = "interpolate"', "a straight line is drawn over it"),
        ('resample = "average"', "a straight line is drawn over it"),
        ("", "the last sample is held"),
    ],
)
@pytest.mark.parametrize("one_table", [True, False])
def test_what_fills_a_silence_is_said(here: Path, way: str, sentence: str, one_table: bool) -> None:
    """No number after 20 s and before 25 s, in rows of its own and between the rows of others."""
    t = np.arange(2000) / 20
    is_there = (np.arange(2000) % 5 == 0) & ((t <= 20.0) | (t >= 25.0))
    f = np.sin(0.6 * np.pi * t)
    text = SLOW % way + "[split]\ngap_s = 10\n"
    if one_table:
        np.savez("slow.npz", t=t, v=np.sin(t), f=np.where(is_there, f, np.nan))
        text = text.replace('time = "slow_t"', 'missing = "hold"')
    else:
        np.savez("slow.npz", t=t, v=np.sin(t), f=f[is_there], slow_t=t[is_there])
    Path("columns.toml").write_text(text, "utf-8")
    (note,) = [n for n in wd.import_table("slow.npz", "columns.toml").provenance["notes"]
               if "silent" in str(n)]  # fmt: skip
    assert f"silent for 5 s and less; {sentence}" in str(note)


def test_a_force_that_is_faster_than_the_rate_is_its_mean_over_each_tick(here: Path) -> None:
    t, fast_t = np.arange(2000) / 20, np.arange(100_000) / 1000
    f = np.sin(fast_t) + np.sin(2 * np.pi * 90.7 * fast_t)  # the hum folds to 9.3 Hz
    np.savez("slow.npz", t=t, v=np.sin(t), f=f, slow_t=fast_t)
    Path("columns.toml").write_text(SLOW % "", "utf-8")
    folded = wd.import_table("slow.npz", "columns.toml")
    assert any("98 % of the samples are the newest at no tick, and are lost" in str(note)
               and 'resample = "average"' in str(note)
               for note in folded.provenance["notes"])  # fmt: skip
    Path("columns.toml").write_text(SLOW % 'resample = "average"', "utf-8")
    made = wd.import_table("slow.npz", "columns.toml")
    assert made.provenance["notes"] == []
    found = np.concatenate([episode.force[:, 0] for episode in made.episodes])
    by_hand = [f[max(at - 25, 0) : at + 26] for at in 50 * np.arange(len(found))]
    wanted = [np.trapezoid(part) / (len(part) - 1) for part in by_hand]
    np.testing.assert_allclose(found, wanted, atol=1e-5)


def test_samples_that_no_tick_took_are_said(here: Path) -> None:
    slow_force(jitter_s=0.02)
    Path("columns.toml").write_text(SLOW % 'resample = "interpolate"', "utf-8")
    made = wd.import_table("slow.npz", "columns.toml")
    stamps_s = np.load("slow.npz")["t"]
    (note,) = made.provenance["notes"]
    repeats, lost = note.split("a sample, ")
    ticks_s = np.arange(sum(map(len, made.episodes))) / 20 + stamps_s[0]
    seen = np.concatenate([episode.observation[:, 0] for episode in made.episodes])
    taken = len(np.unique(seen)) / len(stamps_s)
    assert abs(float(lost.split("; ")[1].split(" %")[0]) / 100 - (1 - taken)) < 0.01
    assert "a higher [resample] rate_hz takes more of them" in lost
    assert "column 'v'" in repeats
    assert len(ticks_s) == len(seen)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('role = "observation"', 'role = "observation"\nresample = "interpolate"',
         'columns.speed: resample = "interpolate" knows later samples, which only a force may'),
        ('role = "force"', 'role = ["force", "output"]\nresample = "average"',
         "which only a force may"),
        ('role = "force"', 'role = "force"\nresample = "interpolate"',
         "columns.drag.resample needs a rate: give [resample] rate_hz"),
        ('role = "force"', 'role = "force"\nresample = "cubic"', "'interpolate' or 'average'"),
        ('role = "force"', 'role = "force"\nevent = true\nresample = "average"', "delete event"),
    ],
)  # fmt: skip
def test_only_a_force_may_know_later_samples(here: Path, old: str, new: str, sentence: str) -> None:
    Path("columns.toml").write_text(COLUMNS.replace(old, new), "utf-8")
    with pytest.raises(wd.UnusableInput) as told:
        wd.import_table("run0.csv", "columns.toml")
    assert sentence in str(told.value)


COPIES = [
    COLUMNS.replace('role = "force"', 'role = ["force", "observation"]'),
    COLUMNS + '[columns.seen]\ncolumn = "f"\nrole = "observation"\nunit = "gf"\n',
]


@pytest.mark.parametrize("text", COPIES)
def test_a_force_that_is_seen_needs_a_lead(here: Path, text: str) -> None:
    Path("columns.toml").write_text(text, "utf-8")
    with pytest.raises(wd.UnusableInput, match=r"columns\.toml: columns\.drag: 'f' is observation"
                       r" and force, and a predictor would copy it; delete .* lead_s"):  # fmt: skip
        wd.import_table("run0.csv", "columns.toml")
    Path("columns.toml").write_text(text.replace("[training]", "[training]\nlead_s = 0.1"), "utf-8")
    made = wd.import_table("run0.csv", "columns.toml")
    assert made.provenance["default_lead_s"] == 0.1
    assert sum("'f' is observation and force: only with a lead" in note
               for note in made.provenance["notes"]) == 1  # fmt: skip


def test_one_column_under_two_addresses_is_seen(here: Path) -> None:
    text = COLUMNS + '[columns.seen]\ncolumn = "#3"\nrole = "observation"\nunit = "mN"\n'
    Path("columns.toml").write_text(text, "utf-8")
    with pytest.raises(wd.UnusableInput, match=r"^columns\.toml: columns\.drag: '#3' and 'f' hold"
                       r" the same numbers, and a predictor would copy them; delete"):  # fmt: skip
        wd.import_table("run0.csv", "columns.toml")
    Path("columns.toml").write_text(text.replace("[training]", "[training]\nlead_s = 0.1"), "utf-8")
    (note,) = wd.import_table("run0.csv", "columns.toml").provenance["notes"]
    assert "columns '#3' and 'f' hold the same numbers: only with a lead" in str(note)


@pytest.mark.parametrize(("lead_s", "share"), [(0.05, 80), (0.1, 60), (0.075, 60), (0.25, 0)])
def test_how_many_labels_are_what_is_seen_is_said(here: Path, lead_s: float, share: int) -> None:
    """A column at 4 Hz, held at 20 Hz, is what it was a tick ago at four of five ticks."""
    slow_force()
    text = (SLOW % "").replace('role = "force"', 'role = ["force", "observation"]')
    text = text.replace("[training]", f"[training]\nlead_s = {lead_s}")
    Path("columns.toml").write_text(text, "utf-8")
    made = wd.import_table("slow.npz", "columns.toml")
    (note,) = [str(n) for n in made.provenance["notes"] if "only with a lead" in str(n)]
    told = f"with this one {share} % of the labels are what is seen"
    assert (told in note) if share else note.endswith("never train with a shorter one")


def test_the_lead_of_a_set_is_what_training_asks_for(here: Path) -> None:
    trainer = pytest.importorskip("trainers.training.trainer")
    without = wd.import_table("run0.csv", "columns.toml")
    assert trainer.chosen_lead_s(without, None) == 0.0
    text = COLUMNS.replace("[training]", "[training]\nlead_s = 0.25")
    Path("columns.toml").write_text(text, "utf-8")
    made = wd.import_table("run0.csv", "columns.toml")
    assert (trainer.chosen_lead_s(made, None), trainer.chosen_lead_s(made, 0.1)) == (0.25, 0.1)


def test_a_filter_is_part_of_what_training_is_told(here: Path) -> None:
    text = COLUMNS + '[resample]\nrate_hz = 50\nmethod = "low-pass"\ncutoff_hz = 5\n'
    Path("columns.toml").write_text(text, "utf-8")
    made = wd.import_table("run0.csv", "columns.toml")
    filtered = "second-order Butterworth low-pass, 5 Hz"
    assert made.provenance["filtered"] == {"speed": filtered}
    assert any("low-pass filter of 5 Hz; in flight filter them likewise" in note
               for note in made.provenance["notes"])  # fmt: skip
    trainer = pytest.importorskip("trainers.training.trainer")
    made.write("set")
    config = trainer.configure(wd.EpisodeSet.read("set"), "agile-mlp", seed=0, lead_s=0.0)
    assert [channel.filtered for channel in config.observation] == [filtered]


def with_constant(role: str) -> str:
    for k in range(3):
        v = np.sin(np.arange(400) / 9 + 1.3 * k)
        np.savetxt(f"run{k}.csv", np.column_stack([np.arange(400) / 100, v, v * v, v * 0 + 293.15]),
                   delimiter=",", header="t,v,f,temperature", comments="")  # fmt: skip
    return COLUMNS + f'[columns.air_k]\ncolumn = "temperature"\nrole = "{role}"\nunit = "K"\n'


def test_an_observation_that_never_changes_is_said(here: Path) -> None:
    Path("columns.toml").write_text(with_constant("observation"), "utf-8")
    (note,) = wd.import_table(["run0.csv", "run1.csv", "run2.csv"], "columns.toml").provenance[
        "notes"
    ]
    assert "the observation air_k is 293.15 in all recordings for training" in note
    assert note.endswith("leave it out")


def test_a_force_that_never_changes_is_refused(here: Path) -> None:
    Path("columns.toml").write_text(with_constant("force"), "utf-8")
    sentence = r"columns\.air_k: the force 'temperature' is 293\.15"
    with pytest.raises(wd.UnusableInput, match=sentence):
        wd.import_table("run0.csv", "columns.toml")


def test_a_force_that_never_changes_in_what_is_held_out_is_said(here: Path) -> None:
    lines = Path("run3.csv").read_text().splitlines()
    still = [f"{line.rpartition(',')[0]},2.5" for line in lines[1:]]
    Path("run3.csv").write_text("\n".join([lines[0], *still]))
    (note,) = wd.import_table(list(FOUR), "columns.toml").provenance["notes"]
    assert note.startswith("column 'f': the force drag is 0.0245166 in all recordings for test")
    assert note.endswith("give recordings in which it changes, or name others in training.test")


def test_what_missing_numbers_leave_out_is_said_in_seconds(here: Path) -> None:
    """Two rows at 1 s and two at 1.1 s: the piece between is no longer than the window."""
    lines = Path("run0.csv").read_text().splitlines()
    for row in (100, 101, 110, 111):
        lines[1 + row] = lines[1 + row].rpartition(",")[0] + ","
    Path("run0.csv").write_text("\n".join(lines))
    text = COLUMNS.replace('unit = "gf"', 'unit = "gf"\nmissing = "split"')
    Path("columns.toml").write_text(text.replace("[training]", '[training]\nheld_out = "files"'))
    made = wd.import_table(["run0.csv", "run1.csv", "run2.csv"], "columns.toml")
    blanks, holes, short = made.provenance["notes"]
    assert "4 of 400 samples have no number, and a recording ends there" in blanks
    left_out = "between the pieces of logs, at 2 places, 0.04 s, 0.33 % of 12 s, are left out"
    assert holes == left_out
    assert short.startswith("of 5 pieces, 1 last no longer than the window of 0.2 s, 0.08 s,")
    assert sum(map(len, made.episodes)) == 1200 - 4 - 8


def test_logs_of_two_rates_need_one(here: Path) -> None:
    lines = Path("run1.csv").read_text().splitlines()
    Path("half.csv").write_text("\n".join(lines[:1] + lines[1::2]))
    with pytest.raises(wd.UnusableInput, match=r"half.csv: runs at 50 Hz and the first log at 100"):
        wd.import_table(["run0.csv", "half.csv"], "columns.toml")


def test_the_command_guesses_imports_and_never_overwrites(here: Path) -> None:
    pytest.importorskip("torch")
    assert "Wrote first.toml" in wakedeploy(
        "data", "import", "table", "run0.csv", "--guess", "--columns", "first.toml"
    )
    guessed = Path("first.toml").read_text("utf-8")
    assert "[columns.v]  # -" in guessed
    told = wakedeploy(
        "data", "import", "table", "run0.csv", "--guess", "--columns", "first.toml", status=2
    )
    assert "is there already" in told
    first, second = guessed.split("[columns.f]")
    roles = first.replace('"unused"', '"observation"') + "[columns.f]"
    roles += second.replace('"unused"', '"force"')
    Path("first.toml").write_text(roles, "utf-8")
    shown = wakedeploy("data", "import", "table", "run0.csv", "run1.csv", "run2.csv", "run3.csv",
                       "--columns", "first.toml", "--out", "set")  # fmt: skip
    assert "table, 100 Hz" in shown
    shown = wakedeploy("train", "--data", "set", "--arch", "agile-mlp", "--epochs", "1",
                       "--out", "runs")  # fmt: skip
    assert "agile-mlp" in shown
    told = wakedeploy("data", "import", "table", "run0.csv", "--columns", "first.toml", status=2)
    assert "--out" in told


def test_a_set_that_is_replaced_is_told(here: Path) -> None:
    words = ("data", "import", "table", "--columns", "columns.toml", "--out", "set")
    assert "replaced" not in wakedeploy(*words, *FOUR)
    assert "replaced" not in wakedeploy(*words, *FOUR)  # the same again
    told = wakedeploy(*words, "run0.csv")
    assert ("set: 3 episodes, 0.1 min, replaced the set that was there: axis, 4 episodes, 0.3 min."
            in told)  # fmt: skip


def test_no_set_is_written_between_the_logs(here: Path) -> None:
    Path("day").mkdir()
    Path("run0.csv").rename("day/run0.csv")
    before = sorted(path.name for path in Path("day").iterdir())
    words = ("data", "import", "table", "--columns", "columns.toml")
    for out in ("day", str(here / "day"), "day/../day"):
        told = wakedeploy(*words, "day/run0.csv", "--out", out, status=2)
        assert f"{out}: holds the log day/run0.csv; give --out a folder of its own" in told
    for out in ("day/set", "day/deep/set"):
        told = wakedeploy(*words, "day", "--out", out, status=2)
        assert f"{out}: lies in the log day, which is a folder; give --out a folder" in told
    assert "day: is the log day itself; give --out" in wakedeploy(
        *words, "day", "--out", "day", status=2
    )
    assert sorted(path.name for path in Path("day").iterdir()) == before
    wakedeploy(*words, "day/run0.csv", "--out", "day/set")


def test_the_help_of_import_names_logs_of_ones_own() -> None:
    assert "logs of your own by `table`" in wakedeploy("data", "import", "--help")


def test_recordings_in_the_units_of_a_system(here: Path) -> None:
    (one,) = wd.read_log("run0.csv", "columns.toml", units={"speed": "m/s", "drag": "mN"})
    assert one.columns["speed"].max() == pytest.approx(0.1, abs=1e-4)
    assert one.columns["drag"].max() == pytest.approx(98.0665, abs=0.01)
