"""Two quadrotors in a co-simulation with the air: FlareDW recordings in their public layout.

In: a folder with `.npz` files of CDP-CFD, `agile_manuevers` (200 Hz, `uav_1_states` the wake's
source and `uav_2_states` the sufferer). Out: flights, cut where positions jump, crashes left out,
with the authors' force label recomputed for all three axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.npz import (
    Arrays,
    Vector,
    clock,
    column,
    read_arrays,
    refused,
    require_even,
)

RATE_HZ = 200.0
MASS_KG = 3.035
LABEL_GRAVITY_MPS2 = 9.85  # the authors' number
THRUST_FIT = (1.9339212e-4, 1.897496901e-2, -4.52623347271)  # N of rad/s, squared to constant
THRUST_VALID_RADPS = (340.0, 430.0)
COLUMNS = 26

_JUMP_M = 0.1
_CRASH_RAD = 0.8
_SMOOTHED = 21  # samples of the authors' filter, 50 ms to either side
_SHORTEST = 200  # samples
_UNIT = 0.05  # by which a quaternion's length may be off
_OFF = 0.05  # of the way that velocities give; the public files agree within 0.001
_STILL_MPS = 0.02  # slower than this, noise would decide
_STATES = ("uav_1_states", "uav_2_states")
_PLANNED = ("uav_1_planned_pos", "uav_2_planned_pos")


@dataclass(frozen=True, eq=False)
class Flight:
    """One flight: states of source and sufferer (n, 26) and the label (n, 3) [N] in world axes.

    `file` is the recording that it was cut from, `stated_n` the file's own label of the z axis
    (n,), where it has one. `planned_m` is where the whole file's flight plan has source and
    sufferer (·, 6), if the file says.
    """

    name: str
    file: Path
    source: Vector
    sufferer: Vector
    label: Vector
    stated_n: Vector | None = None
    planned_m: Vector | None = None

    @property
    def offset_m(self) -> Vector:
        """From source to sufferer (n, 3)."""
        return np.asarray(self.sufferer[:, 0:3] - self.source[:, 0:3])

    @property
    def distance_m(self) -> Vector:
        """Horizontal distance (n,)."""
        return np.asarray(np.linalg.norm(self.offset_m[:, :2], axis=1))


def read_flights(path: Path) -> tuple[Flight, ...]:
    """Every flight below `path`; UnusableInput names the file, the key and the reason."""
    if not path.is_dir():
        raise UnusableInput(f"{path}: is not a folder; give one that holds FlareDW's .npz files.")
    files = sorted(p for p in path.rglob("*.npz") if not p.name.startswith("."))
    if not files:
        raise UnusableInput(f"{path}: no .npz in it or below; give the folder of recordings.")
    flights: list[Flight] = []
    for file in files:
        flights += _flights(file)
    if not flights:
        raise UnusableInput(f"{path}: no flight of a second or more that does not end in a crash.")
    return tuple(flights)


def thrust_n(states: Vector) -> Vector:
    """The authors' thrust (n,) [N] of the mean absolute rotor speed."""
    return np.asarray(np.polyval(THRUST_FIT, np.abs(states[:, 22:26]).mean(1)))


def attitude(states: Vector) -> Vector:
    """Rotation matrices (n, 3, 3) from body to world of the quaternion w, x, y, z."""
    w, x, y, z = states[:, 18:22].T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.asarray(np.stack([np.stack(row, axis=-1) for row in rows], axis=-2))


def smoothed(series: Vector) -> Vector:
    """The authors' smoother over the first axis: centred, so it knows 50 ms of the future."""
    return np.asarray(savgol_filter(series, _SMOOTHED, 1, axis=0))


def force_label(states: Vector) -> Vector:
    """The authors' label (n, 3) [N]: F = smooth(m a) − R [0, 0, T] + [0, 0, m · 9.85]."""
    force = smoothed(MASS_KG * states[:, 6:9])
    force -= attitude(states)[:, :, 2] * thrust_n(states)[:, None]
    force[:, 2] += MASS_KG * LABEL_GRAVITY_MPS2
    return force


def transport_term(states: Vector) -> Vector:
    """ω × v (n, 3) [m/s²] in world axes, smoothed as the label is: what a turning frame adds."""
    rate = np.einsum("nij,nj->ni", attitude(states), states[:, 12:15])
    return smoothed(np.cross(rate, states[:, 3:6]))


def corrected_label(flight: Flight) -> Vector:
    """The label (n, 3) [N] with m ω × v, which turning axes keep back, given back to it."""
    return np.asarray(flight.label + MASS_KG * transport_term(flight.sufferer))


def differentiated(states: Vector) -> Vector:
    """Acceleration (n, 3) [m/s²] from the logged velocity, smoothed as the label is."""
    return smoothed(np.gradient(states[:, 3:6], 1.0 / RATE_HZ, axis=0))


def _flights(file: Path) -> list[Flight]:
    arrays = read_arrays(file, {*_STATES, *_PLANNED, "dw_forces", "time"})
    source = _states(file, arrays, _STATES[0], None)
    sufferer = _states(file, arrays, _STATES[1], len(source))
    given = None
    if "dw_forces" in arrays:
        given = column(file, arrays, "dw_forces", (len(source), 3))[:, 2]
    planned = _planned(file, arrays, len(source))
    name = "/".join(file.parts[-2:]).removesuffix(".npz")
    found = []
    for start, end in _pieces(file, arrays, (source, sufferer)):
        upper, lower = source[start:end], sufferer[start:end]
        if end - start < _SHORTEST:
            continue
        if max(np.abs(s[:, 10:12]).max() for s in (upper, lower)) > _CRASH_RAD:
            continue
        label = force_label(lower)
        stated = None if given is None else given[start:end]
        found.append(Flight(f"{name}@{start}", file, upper, lower, label, stated, planned))
    return found


def _states(file: Path, arrays: Arrays, key: str, length: int | None) -> Vector:
    states = column(file, arrays, key, (length, COLUMNS))
    off = np.abs(np.linalg.norm(states[:, 18:22], axis=1) - 1.0) > _UNIT
    if off.any():
        reason = "columns 18 to 21 are no unit quaternions w, x, y, z"
        raise refused(file, key, f"{reason}, first at sample {np.argmax(off)}")
    return states


def _planned(file: Path, arrays: Arrays, length: int) -> Vector | None:
    """Planned positions (n, 6) of source and sufferer, None where the file has none."""
    if not any(key in arrays for key in _PLANNED):
        return None
    both = [column(file, arrays, key, (length, 10))[:, :3] for key in _PLANNED]
    return np.hstack(both)


def _pieces(file: Path, arrays: Arrays, vehicles: Sequence[Vector]) -> list[tuple[int, int]]:
    """First and last index of every stretch in which no vehicle jumps and time does not restart.

    Within each, samples have to follow each other at the rate that everything here is made for.
    """
    jumps = [np.linalg.norm(np.diff(s[:, 0:3], axis=0), axis=1) > _JUMP_M for s in vehicles]
    cut = np.logical_or(*jumps)
    time_s = clock(file, arrays, "time", len(vehicles[0])) if "time" in arrays else None
    if time_s is not None:
        # A new iteration counts from where the first one did; any other step back is an error.
        cut |= (np.diff(time_s) < 0.0) & (np.abs(time_s[1:] - time_s[0]) < 0.5 / RATE_HZ)
    at = (np.flatnonzero(cut) + 1).tolist()
    pieces = list(zip([0, *at], [*at, len(vehicles[0])], strict=True))
    for start, end in pieces:
        if time_s is not None:
            require_even(file, "time", time_s[start:end], RATE_HZ, start)
    for key, states in zip(_STATES, vehicles, strict=True):
        _require_rate(file, key, states, ~cut)
    return pieces


def _require_rate(file: Path, key: str, states: Vector, within: NDArray[np.bool_]) -> None:
    """Refuse states whose positions move otherwise than their velocities say at `RATE_HZ`.

    `within` (n − 1,) says between which samples nothing was cut.
    """
    moved_m = np.linalg.norm(np.diff(states[:, 0:3], axis=0), axis=1)[within]
    speed_mps = np.linalg.norm(0.5 * (states[1:, 3:6] + states[:-1, 3:6]), axis=1)[within]
    if not len(moved_m) or max(moved_m.mean() * RATE_HZ, speed_mps.mean()) < _STILL_MPS:
        return
    ratio = moved_m.sum() * RATE_HZ / max(float(speed_mps.sum()), 1e-9)
    if abs(ratio - 1.0) > _OFF:
        raise refused(
            file,
            key,
            f"positions move {ratio:.3g} times as far as the velocities say at {RATE_HZ:g} Hz",
        )
