"""An episode set comes back as it was written, or is refused with the place and the reason."""

import json
import multiprocessing
import os
import re
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from wakedeploy.core import episodes, files
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet, read_episode_set, window_shape
from wakedeploy.core.errors import UnusableInput, WakedeployError
from wakedeploy.core.files import sha256_of

FINITE = st.floats(width=32, allow_nan=False, allow_infinity=False)
NAMES = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,20}", fullmatch=True)
TEXT = st.text(min_size=1, max_size=10)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)


def small_set(
    *, seed: int = 0, count: int = 3, length: int = 40, domain: str = "gantry"
) -> EpisodeSet:
    rng = np.random.default_rng(seed)
    made = tuple(
        Episode(
            f"flight{i:04d}",
            rng.normal(size=(length, 2)).astype(np.float32),
            rng.normal(size=(length, 1)).astype(np.float32),
            {"force_sd_n": np.full((length, 1), 0.1, np.float32)},
        )
        for i in range(count)
    )
    return EpisodeSet(
        domain=domain,
        rate_hz=32.0,
        observation=(Channel("dx_m", "m"), Channel("vx_mps", "m/s")),
        force=(Channel("force_z_n", "N"),),
        window_s=0.5,
        loss_weights=(1.0,),
        split={e.name: episodes.SPLITS[i % 3] for i, e in enumerate(made)},
        episodes=made,
        provenance={"seed": seed, "generator": "test"},
    )


@st.composite
def episode_sets(draw: st.DrawFn) -> EpisodeSet:
    d, o = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    made = []
    for name in draw(st.lists(NAMES, min_size=1, max_size=3, unique=True)):
        length = draw(st.integers(1, 5))
        widths = [d, o, draw(st.integers(1, 2))]
        data = [draw(arrays_of.arrays(np.float32, (length, w), elements=FINITE)) for w in widths]
        made.append(Episode(name, data[0], data[1], {"sd": data[2]} if draw(st.booleans()) else {}))

    def channels(n: int) -> tuple[Channel, ...]:
        names = draw(st.lists(TEXT, min_size=n, max_size=n, unique=True))
        return tuple(Channel(name, draw(st.text(max_size=4))) for name in names)

    rate_hz = draw(st.floats(0.1, 1000.0))
    return EpisodeSet(
        domain=draw(TEXT),
        rate_hz=rate_hz,
        observation=channels(d),
        force=channels(o),
        window_s=draw(st.floats(max(0.01, 1.0 / rate_hz), 20.0)),
        loss_weights=tuple(draw(st.lists(st.floats(1e-3, 1e3), min_size=o, max_size=o))),
        split={e.name: draw(st.sampled_from(episodes.SPLITS)) for e in made},
        episodes=tuple(made),
        provenance=draw(st.dictionaries(st.text(), JSON, max_size=3)),
    )


def assert_same(one: EpisodeSet, other: EpisodeSet) -> None:
    for label in ("domain", "rate_hz", "observation", "force", "window_s", "loss_weights"):
        assert getattr(one, label) == getattr(other, label)
    assert dict(one.split) == dict(other.split)
    assert dict(one.provenance) == dict(other.provenance)
    assert [e.name for e in one.episodes] == [e.name for e in other.episodes]
    for mine, theirs in zip(one.episodes, other.episodes, strict=True):
        assert list(mine.arrays) == list(theirs.arrays)
        for name, array in mine.arrays.items():
            assert array.tobytes() == theirs.arrays[name].tobytes()
            assert theirs.arrays[name].dtype == np.float32


@pytest.mark.whole
@settings(max_examples=60, deadline=None)
@given(written=episode_sets())
def test_what_is_written_is_read(
    written: EpisodeSet, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("set")
    written.write(folder)
    read = read_episode_set(folder)
    assert_same(written, read)
    assert read.sha256 == written.sha256


@pytest.fixture(scope="module")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("pristine")
    small_set(length=5).write(folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_any_changed_byte_is_noticed_and_the_file_named(
    data: st.DataObject, pristine: dict[str, bytes], tmp_path: Path
) -> None:
    name = data.draw(st.sampled_from(sorted(pristine)))
    position = data.draw(st.integers(0, len(pristine[name]) - 1))
    mask = data.draw(st.integers(1, 255))
    damaged = bytearray(pristine[name])
    damaged[position] ^= mask
    folder = unpack(pristine | {name: bytes(damaged)}, tmp_path)
    told, read = None, None
    try:
        read = read_episode_set(folder)
    except UnusableInput as error:
        told = str(error)
    if read is None:
        assert told is not None
        assert str(folder / name) in told or name == "dataset.json"
    else:  # white space for other white space in the JSON says the same
        assert name == "dataset.json"
        assert_same(read, small_set(length=5))


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_any_cut_off_file_is_refused(
    data: st.DataObject, pristine: dict[str, bytes], tmp_path: Path
) -> None:
    name = data.draw(st.sampled_from(sorted(pristine)))
    end = data.draw(st.integers(0, len(pristine[name]) - 2))
    folder = unpack(pristine | {name: pristine[name][:end]}, tmp_path)
    with pytest.raises(UnusableInput, match=name):
        read_episode_set(folder)


def unpack(files: dict[str, bytes], folder: Path) -> Path:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"schema": 2}, r"schema 2 is newer than this wakedeploy reads \(1\)"),
        ({"schema": 0}, "schema = 0"),
        ({"rate_hz": -32.0}, "rate_hz = -32.0: must lie above 0"),
        ({"rate_hz": "32"}, "rate_hz = '32'"),
        ({"window_s": 0.0}, "window_s = 0.0: must lie above 0"),
        ({"window_s": 0.001}, "window_s = 0.001: is shorter than the"),
        ({"loss_weights": [1.0, 2.0]}, "loss_weights"),
        ({"force": []}, "force channels"),
        ({"observation": [{"name": "dx_m"}]}, "observation.0.unit is missing"),
        ({"split": {"flight0000": "train"}}, "split: 'flight0001'"),
        (
            {"split": {"flight0000": "train", "flight0001": "exam", "flight0002": "test"}},
            "split of 'flight0001' = 'exam': must be one of train, validation, test",
        ),
        ({"colour": "red"}, "colour is not known"),
        ({"domain": "ship"}, "sha256"),
        ({"sha256": "0" * 64}, "sha256"),
        ({"episodes": []}, "0 episodes"),
    ],
)
def test_a_wrong_field_is_named_with_its_bound(
    change: dict, told: str, pristine: dict[str, bytes], tmp_path: Path
) -> None:
    document = json.loads(pristine["dataset.json"]) | change
    document["checksum"] = episodes._checksum(document)  # a foreign writer, not a damaged file
    folder = unpack(pristine | {"dataset.json": json.dumps(document).encode()}, tmp_path)
    with pytest.raises(UnusableInput, match=rf"dataset\.json: .*{told}"):
        read_episode_set(folder)


def test_a_description_changed_by_hand_is_noticed(
    pristine: dict[str, bytes], tmp_path: Path
) -> None:
    document = json.loads(pristine["dataset.json"])
    document["provenance"]["seed"] = 12
    folder = unpack(pristine | {"dataset.json": json.dumps(document).encode()}, tmp_path)
    with pytest.raises(UnusableInput, match="checksum: changed after it was written"):
        read_episode_set(folder)


@pytest.mark.parametrize("file", ["../outside.npz", "/etc/passwd", ".hidden", "a/b.npz"])
def test_a_set_cannot_point_outside_its_folder(
    file: str, pristine: dict[str, bytes], tmp_path: Path
) -> None:
    document = json.loads(pristine["dataset.json"])
    document["episodes"][0]["file"] = file
    folder = unpack(pristine | {"dataset.json": json.dumps(document).encode()}, tmp_path)
    with pytest.raises(UnusableInput, match=r"episodes\.0\.file"):
        read_episode_set(folder)


def foreign_npz(tmp_path: Path, pristine: dict[str, bytes], **arrays: np.ndarray) -> Path:
    """The set with its first file replaced, hashes and all, by other arrays."""
    document = json.loads(pristine["dataset.json"])
    entry = document["episodes"][0]
    np.savez(tmp_path / "foreign.npz", **arrays)
    content = (tmp_path / "foreign.npz").read_bytes()
    entry["sha256"] = sha256_of(content)
    document["checksum"] = episodes._checksum(document)
    changed = {entry["file"]: content, "dataset.json": json.dumps(document).encode()}
    return unpack(pristine | changed, tmp_path)


GOOD = np.zeros((5, 2), np.float32)


@pytest.mark.parametrize(
    ("arrays", "told"),
    [
        ({"observation": GOOD}, "force"),
        (
            {"observation": GOOD.astype(float), "force": GOOD[:, :1]},
            r"episode '\S+': observation is float64, not float32; give it as \.astype\(np\.float32",
        ),
        ({"observation": GOOD, "force": GOOD[:3, :1]}, "force has 3 samples"),
        (
            {"observation": GOOD, "force": GOOD[:, 0]},
            r"force has shape \(5,\), not \(T, channels\); give it as \[:, np\.newaxis\]",
        ),
        (
            {"observation": GOOD + np.float32("nan"), "force": GOOD[:, :1]},
            "not finite at sample 0; end the episode before it, and begin another",
        ),
        ({"observation": GOOD[:, :1], "force": GOOD[:, :1]}, "1 columns, 2 channels"),
        ({"observation": GOOD[:4], "force": GOOD[:4, :1]}, "has 4 samples, dataset.json says 5"),
        ({"observation": np.array([{}] * 5, object), "force": GOOD[:, :1]}, "pickle"),
    ],
)
def test_a_foreign_episode_is_refused_with_the_reason(
    arrays: dict, told: str, pristine: dict[str, bytes], tmp_path: Path
) -> None:
    with pytest.raises(UnusableInput, match=told):
        read_episode_set(foreign_npz(tmp_path, pristine, **arrays))


def test_a_missing_set_a_missing_episode_and_a_file_in_place_of_the_folder(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"dataset\.json: not found"):
        read_episode_set(tmp_path / "nothing")
    small_set().write(tmp_path / "set")
    gone = next((tmp_path / "set").glob("flight0001*.npz"))
    gone.unlink()
    with pytest.raises(UnusableInput, match=gone.name):
        read_episode_set(tmp_path / "set")
    (tmp_path / "file").write_text("")
    with pytest.raises(UnusableInput, match="is a file"):
        small_set().write(tmp_path / "file")


def test_writing_again_replaces_the_set_and_leaves_nothing_of_the_old_one(tmp_path: Path) -> None:
    small_set(seed=1, count=5).write(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "other.npz").write_bytes(b"mine")
    small_set(seed=2, count=2).write(tmp_path)
    assert_same(read_episode_set(tmp_path), small_set(seed=2, count=2))
    assert sorted(p.name.split("-")[0] for p in tmp_path.iterdir()) == [
        "dataset.json", "flight0000", "flight0001", "notes.txt", "other.npz",
    ]  # fmt: skip


def test_writing_removes_what_a_killed_writer_left_half_done(tmp_path: Path) -> None:
    left = (".dataset.json.x1y2z3w4.json", ".flight0000-0123456789ab.npz.x1y2z3w4.npz")
    for name in left:
        (tmp_path / name).write_bytes(b"half")
    small_set(count=3).write(tmp_path)
    assert not any((tmp_path / name).exists() for name in left)


def _write_for_ever(folder: str) -> None:
    for seed in range(1, 10_000):
        small_set(seed=seed, count=4, length=200).write(Path(folder))


@pytest.fixture
def endless_writer(tmp_path: Path) -> Iterator[multiprocessing.process.BaseProcess]:
    process = multiprocessing.get_context("spawn").Process(
        target=_write_for_ever, args=(str(tmp_path),)
    )
    process.start()
    yield process
    process.kill()
    process.join()


@pytest.mark.whole
def test_a_killed_writer_leaves_a_whole_set(
    endless_writer: multiprocessing.process.BaseProcess, tmp_path: Path
) -> None:
    while not (tmp_path / "dataset.json").exists():
        assert endless_writer.is_alive()
        time.sleep(0.01)
    time.sleep(0.3)
    os.kill(endless_writer.pid or 0, signal.SIGKILL)
    endless_writer.join()
    left = read_episode_set(tmp_path)
    assert_same(left, small_set(seed=int(str(left.provenance["seed"])), count=4, length=200))
    small_set().write(tmp_path)
    assert len(list(tmp_path.iterdir())) == 4  # what the killed one left is gone, too


@pytest.mark.parametrize("files_written", [0, 1, 2, 3])
def test_a_writer_that_fails_midway_leaves_the_former_set(
    files_written: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small_set(seed=1).write(tmp_path)
    written = []

    def failing(path: Path, data: bytes) -> None:
        if len(written) == files_written:
            path.write_bytes(data[: len(data) // 2])
            raise OSError(28, "No space left on device")
        written.append(path)
        path.write_bytes(data)

    monkeypatch.setattr(files, "_write_bytes", failing)
    monkeypatch.setattr(files, "_write_text", lambda path, text: failing(path, text.encode()))
    with pytest.raises(WakedeployError) as told:
        small_set(seed=2).write(tmp_path)
    place, helps = re.escape(str(tmp_path)), "free some space there, then give the same command"
    assert re.match(rf"{place}/\S+: No space left on device; {helps}", str(told.value))
    assert_same(read_episode_set(tmp_path), small_set(seed=1))


def test_the_content_hash_sees_arrays_channels_and_split_but_not_provenance() -> None:
    base = small_set()
    assert small_set().sha256 == base.sha256
    assert small_set(seed=1).sha256 != base.sha256
    assert small_set(domain="ship").sha256 != base.sha256
    other = small_set()
    object.__setattr__(other, "provenance", {"made": "elsewhere"})
    assert other.sha256 == base.sha256
    object.__setattr__(other, "split", dict.fromkeys(other.split, "test"))
    del other.__dict__["sha256"]
    assert other.sha256 != base.sha256


def test_parts_are_the_episodes_of_a_split() -> None:
    made = small_set(count=6)
    assert [e.name for e in made.part("test")] == ["flight0002", "flight0005"]
    assert made.part("all") == made.episodes
    with pytest.raises(UnusableInput, match="split 'exam' is not known; use train"):
        made.part("exam")


@pytest.mark.parametrize(
    ("window_s", "rate_hz", "shape"),
    [(0.5, 32.0, (17, 1)), (0.5, 30.0, (16, 1)), (1.0, 200.0, (29, 7)), (0.29, 100.0, (30, 1)),
     (0.01, 10.0, (1, 1)), (1.2, 25.0, (31, 1))],
)  # fmt: skip
def test_windows_have_the_documented_shape(
    window_s: float, rate_hz: float, shape: tuple[int, int]
) -> None:
    assert window_shape(window_s, rate_hz) == shape


@given(window_s=st.floats(0.01, 10.0), rate_hz=st.floats(1.0, 1000.0))
def test_a_window_spans_its_time_and_no_more(window_s: float, rate_hz: float) -> None:
    k, stride = window_shape(window_s, rate_hz)
    steps = window_s * rate_hz / stride  # a thousandth short of a whole one counts as one
    assert k - 1 <= steps + 1e-3 + 1e-9
    assert steps < k
    assert k <= 46  # 30 strides, and what rounding the stride down by a third adds


def test_no_architecture_is_scored_before_the_window_is_full() -> None:
    assert small_set().warm_up_steps == 16


@pytest.mark.parametrize("name", ["", "a/b", "..", "-x", "ä", "x" * 101])
def test_an_episode_needs_a_name_that_any_disk_takes(name: str) -> None:
    with pytest.raises(ValueError, match="episode name"):
        Episode(name, GOOD, GOOD)


@pytest.mark.parametrize(
    ("part", "value", "told"),
    [
        ("domain", 3, r"^domain = 3: give text$"),
        ("domain", "", r"^domain is empty"),
        ("rate_hz", "50", r"^rate_hz = '50': give a number$"),
        ("window_s", None, r"^window_s = None: give a number$"),
        (
            "observation",
            Channel("u", "m"),
            r"^observation = Channel.*: give a tuple of wd\.Channel$",
        ),
        ("force", ("f",), r"^force = \('f',\): give a tuple of wd\.Channel$"),
        ("force", (Channel("f", 3),), r"unit=3\): name and unit have to be text$"),
        ("loss_weights", 1.0, r"^loss_weights = 1\.0: give a tuple of numbers$"),
        ("split", "train", r"^split = 'train': give a dictionary"),
        ("episodes", 3, r"^episodes = 3: give a tuple of wd\.Episode$"),
        ("provenance", 3, r"^provenance = 3: give a dictionary$"),
        ("provenance", {"by": object()}, r"^provenance holds what JSON does not"),
    ],
)
def test_a_part_of_another_kind_is_named_before_it_is_written(
    part: str, value: object, told: str
) -> None:
    with pytest.raises(ValueError, match=told):
        replace(small_set(), **{part: value})


def test_an_episode_has_a_name_and_a_sample() -> None:
    some, none = np.zeros((3, 1), np.float32), np.zeros((0, 1), np.float32)
    with pytest.raises(ValueError, match=r"^episode name 3: use letters"):
        Episode(3, some, some)
    with pytest.raises(ValueError, match=r"^episode .a.: observation has 0 samples; leave such"):
        Episode("a", none, none)
    for no_array, kind in (([[0.0]] * 3, "list"), (memoryview(some), "memoryview")):
        with pytest.raises(ValueError, match=rf"force is a {kind}, not an array; give np\.asarray"):
            Episode("a", some, no_array)
    hidden = np.ma.masked_array(some, [[0], [0], [1]])
    with pytest.raises(ValueError, match=r"^episode .a.: force is masked at sample 2; end"):
        Episode("a", some, hidden)


def test_numbers_that_numpy_holds_are_numbers(tmp_path: Path) -> None:
    of_arrays = {"rate_hz": np.array(50.0), "window_s": np.float32(0.5)}
    for weights in (np.array([2.0]), np.array([2]), (np.array(2.0),), [np.float32(2.0)]):
        made = replace(small_set(), **of_arrays, loss_weights=weights)
        made.write(tmp_path)
        assert EpisodeSet.read(tmp_path).loss_weights == (2.0,)
        assert "at 50 Hz" in repr(made)
    for strange in (np.array(2.0), np.array(["2.0"]), np.array([[2.0]])):
        with pytest.raises(ValueError, match=r"loss_weights = .*: give a tuple of numbers"):
            replace(small_set(), loss_weights=strange)
