"""What FlareDW files are refused for: by file, key and reason, before anything is written."""

from pathlib import Path

import needs
import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.quadrotor_files import read_flights

N = 600
TIME_S = 5.0 + np.arange(N) / 200.0


def states(place_m: float = 0.0) -> np.ndarray:
    """A vehicle that speeds up along y, upright; positions and velocities consistent."""
    s = np.zeros((N, 26))
    time_s = np.arange(N) / 200.0
    s[:, 0], s[:, 1], s[:, 4] = place_m, 0.5 * time_s + 0.2 * time_s**2, 0.5 + 0.4 * time_s
    s[:, 18] = 1.0
    s[:, 22:26] = 379.0 * np.array([1, 1, -1, -1])
    return s


def changed(at: tuple, value: float, kind: type = float) -> np.ndarray:
    s = states().astype(kind)
    s[at] = value
    return s


def read(folder: Path, **overrides):
    keys = {"uav_1_states": states(), "uav_2_states": states(1.0)} | overrides
    np.savez(folder / "bad.npz", **{k: v for k, v in keys.items() if v is not None})
    return read_flights(folder)


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        ({"uav_2_states": None}, "uav_2_states: is missing"),
        ({"uav_2_states": np.zeros((N, 20))}, "uav_2_states: has shape (600, 20), not (600, 26)"),
        ({"uav_1_states": states()[:400]}, "uav_2_states: has shape (600, 26), not (400, 26)"),
        ({"uav_1_states": changed((12, 3), np.nan)},
         "uav_1_states: is not finite at sample 12, column 3"),
        ({"uav_2_states": changed((7, 22), 1e30)},
         "uav_2_states: is too large for a measurement at sample 7, column 22"),
        ({"uav_2_states": states().astype(complex)}, "uav_2_states: does not hold real numbers"),
        ({"uav_2_states": changed((3, 18), 0.5)},
         "uav_2_states: columns 18 to 21 are no unit quaternions w, x, y, z, first at sample 3"),
        ({"dw_forces": np.zeros(N)}, "dw_forces: has shape (600,), not (600, 3)"),
        ({"dw_forces": np.zeros((10, 3))}, "dw_forces: has shape (10, 3), not (600, 3)"),
        ({"dw_forces": np.full((N, 3), np.nan)}, "dw_forces: is not finite at sample 0, column 0"),
        ({"time": TIME_S[::-1]}, "time: does not rise at sample 1"),
        ({"time": np.r_[TIME_S[:300], TIME_S[200:500]]}, "time: does not rise at sample 300"),
        ({"time": 2.0 * TIME_S}, "time: steps by 0.01 s after sample 0, not by 0.005 s"),
        ({"time": 1.05 * TIME_S}, "time: runs at 190.5 Hz, not at 200 Hz"),
        ({"time": TIME_S[:10]}, "time: has shape (10,), not (600,)"),
        ({"time": np.where(np.arange(N) == 9, np.nan, TIME_S)}, "time: is not finite at sample 9"),
        ({"uav_1_planned_pos": np.zeros((N, 10))}, "uav_2_planned_pos: is missing"),
        ({"uav_1_states": states()[::2], "uav_2_states": states(1.0)[::2]},
         "uav_1_states: positions move 2 times as far as the velocities say at 200 Hz"),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("error")
def test_refusals_say_file_key_and_reason(tmp_path: Path, overrides, told: str) -> None:
    with pytest.raises(UnusableInput) as refused:
        read(tmp_path, **overrides)
    assert f"{tmp_path / 'bad.npz'}: {told};" in str(refused.value)


def test_a_flight_starts_where_time_does_again(tmp_path: Path) -> None:
    """Also where no vehicle jumps: here they hover, and time alone tells of the new iteration."""
    still = states()
    still[:, 1], still[:, 4] = 0.0, 0.0
    time_s = np.r_[TIME_S[:250], TIME_S[:350]]
    told = read(tmp_path, uav_1_states=still, uav_2_states=still, time=time_s)
    assert [len(f.label) for f in told] == [250, 350]


def test_an_empty_file_has_no_flight(tmp_path: Path) -> None:
    none = np.zeros((0, 26))
    with pytest.raises(UnusableInput, match="no flight of a second"):
        read(tmp_path, uav_1_states=none, uav_2_states=none)


@needs.recordings("quadrotor")
def test_every_public_recording_is_accepted() -> None:
    told = read_flights(needs.DATA / "quadrotor")
    assert len({f.file for f in told}) == len(list((needs.DATA / "quadrotor").rglob("*.npz")))
