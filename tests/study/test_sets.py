"""Sets that lie in a study's folder are used again only where they would be made the same now."""

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wakedeploy.core.episodes import Channel, Episode, EpisodeSet, read_episode_set
from wakedeploy.core.errors import UnusableInput
from wakedeploy.rig.file import default_rig
from wakedeploy.study import code, sets, shift
from wakedeploy.study.sets import DOMAINS, Domain, obtain


def quiet(done: int, total: int) -> None:
    """No progress to show."""


def small_set(minutes: float = 1.0, **provenance) -> EpisodeSet:
    rng = np.random.default_rng(0)
    episodes = tuple(
        Episode(name, *(rng.normal(size=(50, 1)).astype(np.float32) for _ in range(2)))
        for name in "abc"
    )
    split = dict(zip("abc", ("train", "validation", "test"), strict=True))
    told = {"generator": "toy", "minutes": minutes} | provenance
    return EpisodeSet("toy", 50.0, (Channel("x", "m"),), (Channel("f", "N"),), 0.2, (1.0,), split,
                      episodes, told)  # fmt: skip


@pytest.fixture
def toy(tmp_path: Path) -> tuple[Domain, Callable[[Domain], EpisodeSet]]:
    """A domain whose set lies in the folder already, and how it is obtained again."""

    def make(minutes: float, progress: object) -> EpisodeSet:
        return small_set(minutes, rig_sha256="of some rig")

    domain = Domain("toy", "f", 1.0, 1.0, make=make, module="wakedeploy.domains.split")
    again = functools.partial(obtain, folder=tmp_path, recordings=None, quick=False, progress=quiet)
    again(domain)
    return domain, again


def test_a_set_of_the_same_code_and_constants_is_used_again(toy, monkeypatch) -> None:
    domain, again = toy

    def never(minutes: float, progress: object) -> EpisodeSet:
        raise AssertionError("made twice")

    assert again(replace(domain, make=never)).sha256 == small_set().sha256


def test_a_set_of_other_code_is_refused(toy, monkeypatch) -> None:
    domain, again = toy
    monkeypatch.setattr(sets, "code_sha256", lambda module: "edited")
    with pytest.raises(UnusableInput, match=r"made by other code .*; delete .*toy, or"):
        again(domain)


def test_a_set_of_another_rig_or_other_settings_is_refused(toy, monkeypatch) -> None:
    domain, again = toy
    with pytest.raises(UnusableInput, match="other constants"):
        again(replace(domain, settings="farther apart"))
    other = default_rig().changed(latency={"round_trip_s": 0.03})
    monkeypatch.setattr(sets, "default_rig", lambda: other)
    with pytest.raises(UnusableInput, match="other constants"):
        again(domain)


def test_a_set_from_before_its_code_was_noted_is_refused(toy, tmp_path) -> None:
    domain, again = toy
    small_set().write(tmp_path / "toy")
    with pytest.raises(UnusableInput, match="made by other code"):
        again(domain)


def test_a_set_put_there_by_hand_is_taken_as_it_is(toy, tmp_path) -> None:
    domain, again = toy
    replace(small_set(), provenance={}).write(tmp_path / "toy")
    assert again(domain) is not None


def test_recordings_that_came_later_are_noticed(tmp_path: Path) -> None:
    flights = tmp_path / "data" / "crazyflie"
    flights.mkdir(parents=True)
    (flights / "swap_ss_00.npz").write_bytes(b"one")
    files = {"swap_ss_00.npz": sets.sha256_of(b"one")}
    domain = replace(DOMAINS["crazyflie"], read=lambda path, progress: small_set(files=files))
    for _ in range(2):
        obtain(domain, tmp_path, tmp_path / "data", quick=False, progress=quiet)
    (flights / "notes.npz").write_bytes(b"not a flight")
    obtain(domain, tmp_path, tmp_path / "data", quick=False, progress=quiet)
    (flights / "swap_ss_01.npz").write_bytes(b"two")
    with pytest.raises(UnusableInput, match=r"was imported without swap_ss_01\.npz; delete"):
        obtain(domain, tmp_path, tmp_path / "data", quick=False, progress=quiet)


def test_flights_in_varied_physics_are_checked_as_well(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(shift, "make_set", lambda **asked: small_set(asked["minutes"]))
    shift.spread_set(tmp_path, quick=True, progress=quiet)
    (place,) = tmp_path.iterdir()
    assert place.name == "downwash-10-per-cent-quick"
    assert read_episode_set(place).provenance["minutes"] == DOMAINS["downwash"].quick_minutes
    shift.spread_set(tmp_path, quick=True, progress=quiet)
    monkeypatch.setattr(sets, "code_sha256", lambda module: "edited")
    with pytest.raises(UnusableInput, match="made by other code"):
        shift.spread_set(tmp_path, quick=True, progress=quiet)


def test_the_hash_follows_imports_and_nothing_else(tmp_path, monkeypatch) -> None:
    sources = {
        "wakedeploy/__init__.py": "",
        "wakedeploy/made.py": "import numpy\ndef f():\n    from wakedeploy.deep import used\n",
        "wakedeploy/deep/__init__.py": "",
        "wakedeploy/deep/used.py": "import runtime.loop.loop\n",
        "runtime/loop/loop.py": "X = 1\n",
        "wakedeploy/other.py": "Y = 1\n",
    }
    for name, text in sources.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(code, "_ROOT", tmp_path)

    def told() -> str:
        return code.code_sha256.__wrapped__("wakedeploy.made")

    first = told()
    (tmp_path / "wakedeploy/other.py").write_text("Y = 2\n")
    assert told() == first
    (tmp_path / "runtime/loop/loop.py").write_text("X = 2\n")
    assert told() != first
    with pytest.raises(ValueError, match="no module"):
        code.code_sha256("wakedeploy.moon")
