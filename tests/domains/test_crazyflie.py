"""Two Crazyflies: the measured force, either sufferer, and refusals by file, key and reason."""

from pathlib import Path

import needs
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from wakedeploy.cli import main
from wakedeploy.core.episodes import read_episode_set
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.crazyflie import MASS_KG, OBSERVATION, import_set

PUSH_N = {"a": np.array([0.01, -0.02, -0.07]), "b": np.array([0.0, 0.005, 0.03])}
N = 300


def flight(kinds: str = "sl", seed: int = 0) -> dict[str, np.ndarray]:
    """A flight in which a known force pushes each vehicle, whatever its attitude and thrust."""
    rng = np.random.default_rng(seed)
    arrays = {"t": np.arange(N) / 100.0}
    masses = {"sl": "ls", "ss": "ss", "ll": "ll"}[kinds]
    for letter, size in zip("ab", masses, strict=True):
        mass_kg = MASS_KG[size]
        turned = Rotation.from_euler("ZYX", rng.normal(0, 0.2, (N, 3)))
        motors_n = rng.uniform(0.7, 1.3, (N, 4)) * mass_kg * 9.81 / 4
        thrust_n = turned.apply(np.array([0.0, 0.0, 1.0])) * motors_n.sum(1)[:, None]
        arrays |= {
            f"{letter}_pos": rng.normal(0, 1, (N, 3)),
            f"{letter}_vel": rng.normal(0, 1, (N, 3)),
            f"{letter}_acc": (thrust_n + PUSH_N[letter]) / mass_kg,
            f"{letter}_quat_xyzw": turned.as_quat(),
            f"{letter}_motor_thrust": motors_n,
            f"{letter}_pwm": rng.uniform(0.4, 0.9, (N, 4)),
            f"{letter}_vbat": np.full((N, 1), 3.8),
            f"{letter}_rate": np.zeros((N, 3)),
        }
    return arrays


def saved(folder: Path, name: str = "swap_sl_00", **overrides) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / f"{name}.npz", **(flight(name[5:7]) | overrides))
    return folder


def test_the_force_is_what_thrust_and_weight_leave(tmp_path: Path) -> None:
    made = import_set(saved(tmp_path))
    forces = {episode.name[-1]: episode.force for episode in made.episodes}
    for letter, push in PUSH_N.items():
        assert forces[letter] == pytest.approx(np.tile(push, (N, 1)), abs=1e-6)


def test_each_vehicle_is_the_others_source_once(tmp_path: Path) -> None:
    made = import_set(saved(tmp_path))
    columns = [c.name for c in OBSERVATION]
    a, b = (e.observation for e in made.episodes)
    for name in ("dx_m", "dvz_mps"):
        assert a[:, columns.index(name)] == pytest.approx(-b[:, columns.index(name)])
    for one, other in (("source", "sufferer"), ("sufferer", "source")):
        for part in ("command", "battery_v", "mass_kg"):
            left, right = columns.index(f"{one}_{part}"), columns.index(f"{other}_{part}")
            assert np.array_equal(a[:, left], b[:, right])
    assert a[0, columns.index("sufferer_mass_kg")] == pytest.approx(MASS_KG["l"])


def test_both_episodes_of_a_flight_are_in_the_same_split(tmp_path: Path) -> None:
    for kinds in ("ss", "ll"):
        for number in range(5):
            saved(tmp_path, f"swap_{kinds}_{number:02d}")
    made = import_set(tmp_path)
    for kinds in ("ss", "ll"):
        splits = {}
        for name, split in made.split.items():
            if kinds in name:
                splits.setdefault(name[:-2], set()).add(split)
        assert all(len(own) == 1 for own in splits.values())
        assert set.union(*splits.values()) == {"train", "validation", "test"}


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        ({"a_pos": np.zeros((N, 2))}, "a_pos: has shape (300, 2), not (300, 3)"),
        ({"b_acc": np.full((N, 3), np.nan)}, "b_acc: is not finite at sample 0"),
        ({"t": np.zeros(N)}, "t: does not rise at sample 1"),
        ({"t": np.arange(N) / 50.0}, "t: steps by 0.02 s after sample 0, not by 0.01 s"),
        ({"t": np.arange(N) * 0.0117}, "t: runs at 85.47 Hz, not at 100 Hz"),
        ({"a_quat_xyzw": np.zeros((N, 4))}, "a_quat_xyzw: is no unit quaternion at sample 0"),
        ({"t": np.arange(20) / 100.0}, "t: has 20 samples"),
        ({"a_vbat": np.array(["full"] * N)[:, None]}, "a_vbat: does not hold real numbers"),
    ],
)
def test_bad_flights_are_refused_by_file_key_and_reason(tmp_path, overrides, told) -> None:
    with pytest.raises(UnusableInput) as refused:
        import_set(saved(tmp_path, **overrides))
    assert "swap_sl_00.npz" in str(refused.value)
    assert told in str(refused.value)


def test_a_missing_key_and_an_unknown_name_are_told(tmp_path: Path) -> None:
    arrays = flight()
    del arrays["b_pwm"]
    np.savez(tmp_path / "swap_sl_00.npz", **arrays)
    with pytest.raises(UnusableInput, match="b_pwm: is missing"):
        import_set(tmp_path)
    np.savez(tmp_path / "swap_xy_00.npz", **flight())
    (tmp_path / "swap_sl_00.npz").unlink()
    with pytest.raises(UnusableInput, match="swap_ss_"):
        import_set(tmp_path)


@pytest.mark.parametrize("damage", ["short", "flipped", "other"])
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path: Path, damage: str) -> None:
    path = saved(tmp_path) / "swap_sl_00.npz"
    whole = bytearray(path.read_bytes())
    if damage == "short":
        path.write_bytes(whole[: len(whole) // 2])
    elif damage == "flipped":
        whole[len(whole) // 2] ^= 0xFF
        path.write_bytes(whole)
    else:
        np.save(tmp_path / "array.npy", np.zeros(4))
        path.write_bytes((tmp_path / "array.npy").read_bytes())
    with pytest.raises(UnusableInput, match=r"swap_sl_00\.npz"):
        import_set(tmp_path)


def test_the_command_writes_a_set(tmp_path: Path) -> None:
    out = tmp_path / "set"
    told = CliRunner().invoke(main, ["data", "import", "crazyflie", str(saved(tmp_path / "in")),
                                     "--out", str(out)])  # fmt: skip
    assert told.exit_code == 0, told.output
    made = read_episode_set(out)
    assert made.domain == "crazyflie"
    assert made.provenance["groups"] == dict.fromkeys(made.split, "swap_sl_00")


@needs.recordings("crazyflie")
@pytest.mark.parametrize(("kinds", "grams"), [("ss", -7.5), ("ll", -15.6)])
def test_directly_below_the_recordings_show_the_known_downwash(kinds: str, grams: float) -> None:
    made = import_set(needs.DATA / "crazyflie")
    below = []
    for episode in made.episodes:
        dx, dy, dz = episode.observation[:, :3].T
        at = (np.hypot(dx, dy) < 0.1) & (dz > 0)
        if kinds in episode.name and at.any():
            below.append(float(episode.force[at, 2].mean()) / 9.81e-3)
    assert np.mean(below) == pytest.approx(grams, rel=0.15)
