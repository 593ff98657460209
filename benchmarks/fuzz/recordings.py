"""Kinds of recordings that are imported: MATLAB, NumPy and ESC logs in their public layouts."""

import datetime
import functools
import gzip
import io
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fuzz.archives import npz_file, packed
from benchmarks.fuzz.binary import gzipped_csv, mat_file
from benchmarks.fuzz.kind import Files, Kind
from benchmarks.fuzz.tables import csv_file
from wakedeploy.domains import crazyflie, fish, quadrotor
from wakedeploy.domains.motor import read_steps

Vector = NDArray[np.float64]

_FISH_S, _QUADROTOR_SAMPLES, _SWAP_SAMPLES = 11.0, 205, 205
_DUTIES = (20, 30, 40, 50, 20)


def kinds() -> dict[str, Callable[[], Kind]]:
    """What makes each kind, by its name."""
    return {"fish": _fish, "quadrotor": _quadrotor, "crazyflie": _crazyflie, "motor": _motor}


def _fish() -> Kind:
    sound = tuple(_fish_files(is_compressed) for is_compressed in (False, True))
    return Kind("fish", "flag recordings", sound, fish.import_set, {"*.mat": mat_file})


def _fish_files(is_compressed: bool) -> Files:
    from scipy.io import savemat

    rng = np.random.default_rng(0)
    frames = round(_FISH_S * 60)
    time_s = np.arange(frames)[None, :] / 60.0
    flow_s = np.sort(rng.uniform(0.0, _FISH_S, round(_FISH_S * 27)))[:, None]
    flow_s[0] = 0.0
    held: dict[str, dict[str, Vector]] = {
        "Foil": {"foilang": rng.normal(0, 10, (frames, 1)), "time": time_s},
        "Flag2": {
            "flagfrontY": rng.normal(0, 2e-4, (frames, 1)),
            "flagtipY": rng.normal(0, 7e-3, (frames, 1)),
            "time": time_s,
        },
        "LDV": {"tLDV": flow_s, "uLDV": rng.normal(0.36, 0.05, flow_s.shape)},
    }
    files = {}
    for name, variables in held.items():
        file = io.BytesIO()
        savemat(file, variables, do_compression=is_compressed)
        files[f"rec_{name}.mat"] = file.getvalue()
    return files


def _quadrotor() -> Kind:
    names = ("1_flybelow/a.npz", "1_flybelow/b.npz", "3_swapping/c.npz", "3_swapping/d.npz")
    sound = ({name: _quadrotor_file(seed) for seed, name in enumerate(names)},)
    return Kind(
        "quadrotor", "quadrotor recordings", sound, quadrotor.import_set, {"*.npz": npz_file}
    )


def _quadrotor_file(seed: int) -> bytes:
    n = _QUADROTOR_SAMPLES
    time_s = np.arange(n) / 200.0
    arrays: dict[str, NDArray[Any]] = {"time": time_s}
    for number in (1, 2):
        arrays[f"uav_{number}_states"] = _states(10 * seed + number, time_s)
        planned = np.random.default_rng(seed).normal(size=(n, 10))
        arrays[f"uav_{number}_planned_pos"] = planned
    arrays["dw_forces"] = np.zeros((n, 3))
    return packed({name: array.astype(np.float32) for name, array in arrays.items()})


def _states(seed: int, time_s: Vector) -> Vector:
    """A vehicle that drifts about level."""
    rng = np.random.default_rng(seed)
    s = np.zeros((len(time_s), 26))
    s[:, 3:6] = np.cumsum(rng.normal(0, 0.01, (len(time_s), 3)), axis=0)
    s[:, 0:3] = rng.uniform(-1, 1, 3) + np.cumsum(s[:, 3:6], axis=0) / 200
    s[:, 18] = 1.0
    s[:, 22:26] = 379.0 * np.array([1, 1, -1, -1])
    return s


def _crazyflie() -> Kind:
    sound = ({f"swap_{kinds}_00.npz": _swap(kinds) for kinds in ("sl", "ss")},)
    return Kind(
        "crazyflie", "Crazyflie recordings", sound, crazyflie.import_set, {"*.npz": npz_file}
    )


def _swap(kinds: str) -> bytes:
    rng, n = np.random.default_rng(0), _SWAP_SAMPLES
    arrays: dict[str, NDArray[Any]] = {"t": np.arange(n) / 100.0}
    for letter, size in zip("ab", {"sl": "ls", "ss": "ss"}[kinds], strict=True):
        mass_kg = crazyflie.MASS_KG[size]
        level = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        arrays |= {
            f"{letter}_pos": rng.normal(0, 1, (n, 3)),
            f"{letter}_vel": rng.normal(0, 1, (n, 3)),
            f"{letter}_acc": rng.normal(0, 1, (n, 3)),
            f"{letter}_quat_xyzw": level,
            f"{letter}_motor_thrust": rng.uniform(0.7, 1.3, (n, 4)) * mass_kg * 9.81 / 4,
            f"{letter}_pwm": rng.uniform(0.4, 0.9, (n, 4)),
            f"{letter}_vbat": np.full((n, 1), 3.8),
        }
    return packed(arrays)


def _motor() -> Kind:
    text = _esc_log()
    sound: tuple[Files, ...] = (
        {"made.csv": text},
        {"made.csv.gz": gzip.compress(text, mtime=0)},
    )
    ways = {"*.gz": gzipped_csv, "*.csv": csv_file}
    return Kind("motor", "ESC logs", sound, read_steps, ways)


@functools.cache
def _esc_log() -> bytes:
    """Bursts 60 times a second, a step of the duty every two seconds."""
    begin = datetime.datetime(2020, 1, 1)
    lines = ["Timestamp,Batt. Volts,RPM,Duty"]
    for tick in range(120 * len(_DUTIES)):
        at = begin + datetime.timedelta(seconds=tick / 60)
        stamp = f"{at:%Y-%m-%d %H:%M:%S}:{at.microsecond // 1000:03d}"
        duty = _DUTIES[tick // 120]
        lines.append(f"{stamp},16,{150 * duty + tick % 7},{duty}")
    return "\n".join(lines).encode() + b"\n"
