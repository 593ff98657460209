"""Fish recordings: held causally, split by time, and refused by file, key and reason."""

from pathlib import Path

import needs
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from wakedeploy.cli import main
from wakedeploy.core.episodes import read_episode_set
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.fish import import_set

SECONDS = 20.0


def recording(seed: int = 0, seconds: float = SECONDS) -> dict[str, dict[str, np.ndarray]]:
    """The variables of one recording's three files, in the shapes of the public ones."""
    rng = np.random.default_rng(seed)
    frames = int(seconds * 60)
    time_s = np.arange(frames)[None, :] / 60.0
    ldv_s = np.sort(rng.uniform(0.0, seconds, int(seconds * 27)))[:, None]
    ldv_s[0] = 0.0
    column = (frames, 1)
    return {
        "Foil": {"foilang": rng.normal(0, 10, column), "time": time_s},
        "Flag2": {
            "flagfrontY": rng.normal(0, 2e-4, column),
            "flagtipY": rng.normal(0, 7e-3, column),
            "time": time_s,
        },
        "LDV": {"tLDV": ldv_s, "uLDV": rng.normal(0.36, 0.05, ldv_s.shape)},
    }


def saved(folder: Path, files: dict[str, dict[str, np.ndarray]], name: str = "rec") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for kind, variables in files.items():
        savemat(folder / f"{name}_{kind}.mat", variables)
    return folder


def test_progress_is_told_recording_by_recording(tmp_path: Path) -> None:
    for name in ("a", "b"):
        saved(tmp_path, recording(), name)
    told: list[tuple[int, int]] = []
    import_set(tmp_path, lambda done, total: told.append((done, total)))
    assert told == [(1, 2), (2, 2)]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_each_sample_is_the_newest_measurement_at_its_time(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    files = recording(seed)
    made = import_set(saved(tmp_path_factory.mktemp("fish"), files))
    observation = np.concatenate([e.observation for e in made.episodes])
    force = np.concatenate([e.force for e in made.episodes])
    ldv_s, flow = files["LDV"]["tLDV"].ravel(), files["LDV"]["uLDV"].ravel()
    assert len(observation) == SECONDS * 30
    for k in range(0, len(observation), 7):
        now_s = files["Foil"]["time"][0, 2 * k]
        expected = [
            np.pi / 180 * files["Foil"]["foilang"][2 * k, 0],
            [u for t, u in zip(ldv_s, flow, strict=True) if t <= now_s][-1],
            files["Flag2"]["flagfrontY"][2 * k, 0],
        ]
        np.testing.assert_allclose(observation[k], expected, rtol=1e-6)
        np.testing.assert_allclose(force[k], files["Flag2"]["flagtipY"][2 * k], rtol=1e-6)


def test_what_comes_later_changes_nothing_before(tmp_path: Path) -> None:
    files = recording()
    before = import_set(saved(tmp_path / "a", files))
    later = files["LDV"]["tLDV"] > 10.0
    files["LDV"]["uLDV"] = np.where(later, 9.9, files["LDV"]["uLDV"])
    after = import_set(saved(tmp_path / "b", files))
    flows = [np.concatenate([e.observation[:, 1] for e in s.episodes]) for s in (before, after)]
    differs = np.flatnonzero(flows[0] != flows[1])
    assert differs[0] / 30.0 >= 10.0


def test_the_split_is_by_contiguous_time_blocks_in_order(tmp_path: Path) -> None:
    made = import_set(saved(tmp_path, recording()))
    assert [made.split[e.name] for e in made.episodes] == ["train", "validation", "test"]
    assert [len(e) for e in made.episodes] == [420, 90, 90]
    assert (made.rate_hz, made.window_s, made.domain) == (30.0, 0.5, "fish")


def test_every_recording_below_the_folder_is_imported(tmp_path: Path) -> None:
    saved(tmp_path / "clone" / "data", recording(0), "00_19hz_ct_s1")
    saved(tmp_path / "clone" / "data", recording(1), "03 new")
    saved(tmp_path / "clone" / "data", {"Foil_SA": {"x": np.ones(3)}}, "03 new")
    made = import_set(tmp_path)
    assert {e.name.rsplit("-", 1)[0] for e in made.episodes} == {"00_19hz_ct_s1", "03-new"}
    assert len(made.part("test")) == 2


def test_frames_without_a_flow_measurement_yet_are_left_out(tmp_path: Path) -> None:
    files = recording()
    late = files["LDV"]["tLDV"].ravel() >= 2.0
    files["LDV"] = {key: value[late] for key, value in files["LDV"].items()}
    made = import_set(saved(tmp_path, files))
    first_s = files["LDV"]["tLDV"][0, 0]
    assert sum(map(len, made.episodes)) == SECONDS * 30 - np.ceil(first_s * 30)


def put(kind: str, key: str, value: object) -> dict:
    files = recording()
    files[kind][key] = value
    return files


def without(kind: str, key: str) -> dict:
    files = recording()
    del files[kind][key]
    return files


def with_value(kind: str, key: str, index: int, value: float) -> dict:
    files = recording()
    files[kind][key] = files[kind][key].copy()
    files[kind][key].flat[index] = value
    return files


FRAMES = int(SECONDS * 60)
REFUSED = {
    "missing key": (without("Foil", "foilang"), r"rec_Foil\.mat: foilang: is missing"),
    "missing time": (without("Flag2", "time"), r"rec_Flag2\.mat: time: is missing"),
    "NaN": (with_value("Flag2", "flagtipY", 7, np.nan), r"Flag2\.mat: flagtipY: .*sample 7"),
    "infinite": (
        with_value("LDV", "uLDV", 3, np.inf),
        r"LDV\.mat: uLDV: is not finite at sample 3",
    ),
    "complex": (put("Foil", "foilang", 1j * np.ones((FRAMES, 1))), "foilang: .*real numbers"),
    "text": (put("Foil", "foilang", "angles"), "foilang: does not hold real numbers"),
    "matrix": (put("Foil", "foilang", np.ones((FRAMES // 2, 2))), r"foilang: has shape \(600, 2\)"),
    "empty": (put("Foil", "foilang", np.ones((0, 1))), "foilang: has shape"),
    "short": (
        put("Foil", "foilang", np.ones((FRAMES - 1, 1))),
        "foilang: has 1199 samples for 1200",
    ),
    "LDV lengths": (put("LDV", "uLDV", np.ones((3, 1))), "uLDV: has 3 samples for 540"),
    "30 Hz": (put("Foil", "time", np.arange(FRAMES) / 30.0), r"Foil\.mat: time: runs at 30 Hz"),
    "100 Hz": (
        put("Flag2", "time", np.arange(FRAMES) / 100.0),
        r"Flag2\.mat: time: runs at 100 Hz",
    ),
    "time falls": (
        with_value("Foil", "time", 50, 0.5),
        r"Foil\.mat: time: does not rise at sample 50",
    ),
    "time stands": (with_value("Foil", "time", 50, 49 / 60), "time: does not rise at sample 50"),
    "frames lost": (
        put("Foil", "time", (np.arange(FRAMES) + 5 * (np.arange(FRAMES) > 99)) / 60.0),
        "time: steps by 0.1 s after sample 99: frames lost",
    ),
    "other frames": (
        put("Flag2", "time", 1.0 + np.arange(FRAMES) / 60.0),
        r"differs from rec_Foil\.mat",
    ),
    "LDV falls": (with_value("LDV", "tLDV", 100, 0.0), r"LDV\.mat: tLDV: falls at sample 100"),
    "LDV silent": (
        put(
            "LDV", "tLDV", recording()["LDV"]["tLDV"] * 1.0 + 3.0 * (np.arange(540)[:, None] > 200)
        ),
        "tLDV: is silent for .* s after sample 200",
    ),
    "LDV elsewhere": (put("LDV", "tLDV", 1000.0 + recording()["LDV"]["tLDV"]), "shares 0 s with"),
    "too short": (recording(seconds=5.0), "shares 5 s with the camera, less than 10 s"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_recording_is_refused_by_file_key_and_reason(case: str, tmp_path: Path) -> None:
    files, told = REFUSED[case]
    out = tmp_path / "out"
    command = ["data", "import", "fish", str(saved(tmp_path / "in", files)), "--out", str(out)]
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 2
    with pytest.raises(UnusableInput, match=told):
        import_set(tmp_path / "in")
    assert len(result.stderr.strip().splitlines()) == 1
    assert not out.exists()


def test_a_missing_companion_an_empty_folder_and_a_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"no …_Foil\.mat in it or below"):
        import_set(tmp_path)
    saved(tmp_path, recording())
    (tmp_path / "rec_LDV.mat").unlink()
    with pytest.raises(UnusableInput, match=r"rec_LDV\.mat: not found"):
        import_set(tmp_path)
    with pytest.raises(UnusableInput, match="is not a folder"):
        import_set(tmp_path / "rec_Foil.mat")


def test_the_same_recording_twice_is_refused(tmp_path: Path) -> None:
    saved(tmp_path / "a", recording())
    saved(tmp_path / "b", recording())
    with pytest.raises(UnusableInput, match="holds recording rec twice"):
        import_set(tmp_path)


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_a_damaged_file_is_refused_or_read_but_never_a_surprise(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = saved(tmp_path_factory.mktemp("fish"), recording(seconds=12.0))
    path = folder / f"rec_{data.draw(st.sampled_from(['Foil', 'Flag2', 'LDV']))}.mat"
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    else:
        content[data.draw(st.integers(0, 250))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    try:
        assert import_set(folder).rate_hz == 30.0
    except UnusableInput as refused:
        assert "rec_" in str(refused)  # noqa: PT017


@needs.recordings("fish")
def test_the_real_recordings_come_through_the_command_line(tmp_path: Path) -> None:
    out = tmp_path / "fish"
    result = CliRunner().invoke(
        main, ["data", "import", "fish", str(needs.DATA / "fish"), "--out", str(out)]
    )
    assert result.exit_code == 0, result.output
    read = read_episode_set(out)
    assert {"train", "validation", "test"} == set(read.split.values())
    assert sum(map(len, read.episodes)) / read.rate_hz > 240.0
    angles = np.concatenate([e.observation[:, 0] for e in read.episodes])
    assert 0.3 < np.abs(angles).max() < 0.8  # radians: the foil pitches by some twenty degrees
