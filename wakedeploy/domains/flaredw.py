"""Two quadrotors in a co-simulation with the air: FlareDW recordings in their public layout.

In: a folder with `.npz` files of CDP-CFD, `agile_manuevers` (200 Hz, `uav_1_states` the wake's
source and `uav_2_states` the sufferer). Out: flights, cut where positions jump, crashes left out,
with the authors' force label recomputed for all three axes.
"""

import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from wakedeploy.errors import UnusableInput, one_line

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

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Flight:
    """One flight: states of source and sufferer (n, 26) and the label (n, 3) [N] in world axes.

    `file` is the recording that it was cut from, `stated_n` the file's own label of the z axis
    (n,), where it has one.
    """

    name: str
    file: Path
    source: Vector
    sufferer: Vector
    label: Vector
    stated_n: Vector | None = None

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


def differentiated(states: Vector) -> Vector:
    """Acceleration (n, 3) [m/s²] from the logged velocity, smoothed as the label is."""
    return smoothed(np.gradient(states[:, 3:6], 1.0 / RATE_HZ, axis=0))


def _flights(file: Path) -> list[Flight]:
    try:
        with np.load(file, allow_pickle=False) as archive:
            source, sufferer = (_states(file, archive, k) for k in (1, 2))
            stated = archive.get("dw_forces")
    except (OSError, ValueError, EOFError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise UnusableInput(
            f"{file}: cannot be read ({one_line(error)}); copy it again."
        ) from error
    if len(source) != len(sufferer):
        raise UnusableInput(f"{file}: {len(source)} states of the source, {len(sufferer)} of the "
                            "sufferer; the samples do not correspond.")  # fmt: skip
    name = "/".join(file.parts[-2:]).removesuffix(".npz")
    found = []
    for start, end in _cuts((source, sufferer)):
        one, two = source[start:end], sufferer[start:end]
        crashed = max(np.abs(s[:, 10:12]).max() for s in (one, two)) > _CRASH_RAD
        if end - start >= _SHORTEST and not crashed:
            given = None if stated is None else np.asarray(stated[start:end, 2], float)
            label = force_label(two)
            found.append(Flight(f"{name}@{start}", file, one, two, label, given))
    return found


def _states(file: Path, archive: "np.lib.npyio.NpzFile", vehicle: int) -> Vector:
    key = f"uav_{vehicle}_states"
    if key not in archive:
        raise UnusableInput(f"{file}: {key} is missing; give FlareDW's own files.")
    states = np.asarray(archive[key], dtype=np.float64)
    if states.ndim != 2 or states.shape[1] != COLUMNS or not np.isfinite(states).all():
        raise UnusableInput(f"{file}: {key} has shape {states.shape} or holds NaN, not (n, 26).")
    if (np.abs(np.linalg.norm(states[:, 18:22], axis=1) - 1.0) > _UNIT).any():
        raise UnusableInput(f"{file}: {key}: columns 18 to 21 are no unit quaternions w, x, y, z.")
    return states


def _cuts(vehicles: Sequence[Vector]) -> list[tuple[int, int]]:
    """First and last index of every stretch without a jump of either vehicle."""
    jumps = [np.linalg.norm(np.diff(s[:, 0:3], axis=0), axis=1) > _JUMP_M for s in vehicles]
    at = np.flatnonzero(np.logical_or(*jumps)) + 1
    return list(zip([0, *at.tolist()], [*at.tolist(), len(vehicles[0])], strict=True))
