"""A flag behind a flapping foil in a water channel: real recordings in their public layout.

In: a folder with `<name>_Foil.mat`, `<name>_Flag2.mat` (camera, 60 Hz) and `<name>_LDV.mat` (flow
velocity at irregular times), anywhere below. Out: an episode set at 30 Hz: foil angle, flow
velocity and flag front predict the flag's tip. Each recording is split by time block.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import sha256_of
from wakedeploy.core.version import VERSION
from wakedeploy.domains.domain import Recorded
from wakedeploy.domains.matfile import Unread, Variable, read_mat

RATE_HZ = 30.0
WINDOW_S = 0.5
OBSERVATION = (
    Channel("foil_angle_rad", "rad"),
    Channel("flow_mps", "m/s"),
    Channel("flag_front_m", "m"),
)
FORCE = (Channel("flag_tip_m", "m"),)
BLOCKS = (("train", 0.0, 0.70), ("validation", 0.70, 0.85), ("test", 0.85, 1.0))

_CAMERA_HZ = 60.0
_FRAMES_PER_SAMPLE = round(_CAMERA_HZ / RATE_HZ)
_LONGEST_HOLD_S = 1.0  # the LDV's longest silence in a sound recording is a third of this
_SHORTEST_S = 10.0  # 15 % of it is three windows

Vector = NDArray[np.float64]


def import_set(path: Path, progress: Callable[[int, int], None] | None = None) -> EpisodeSet:
    """Read every recording below `path`; UnusableInput names the file, the key and the reason.

    `progress(done, total)` is called after each recording.
    """
    foils = _find(path)
    pieces = []
    for done, foil in enumerate(foils, 1):
        pieces += _blocks(_name(foil), *_samples(foil))
        if progress is not None:
            progress(done, len(foils))
    return EpisodeSet(
        domain="fish",
        rate_hz=RATE_HZ,
        observation=OBSERVATION,
        force=FORCE,
        window_s=WINDOW_S,
        loss_weights=(1.0,),
        split={episode.name: split for split, episode in pieces},
        episodes=tuple(episode for _, episode in pieces),
        provenance={
            "generator": f"wakedeploy {VERSION} fish",
            "files": {p.name: sha256_of(p.read_bytes()) for f in foils for p in _files(f)},
        },
    )


def _find(path: Path) -> list[Path]:
    """The `…_Foil.mat` of every recording, each with its companions beside it."""
    if not path.is_dir():
        raise UnusableInput(f"{path}: is not a folder; give one that holds …_Foil.mat files.")
    foils = sorted(p for p in path.rglob("*_Foil.mat") if not p.name.startswith("."))
    if not foils:
        raise UnusableInput(f"{path}: no …_Foil.mat in it or below; give the folder of recordings.")
    for foil in foils:
        for companion in _files(foil):
            if not companion.is_file():
                raise UnusableInput(f"{companion}: not found; {foil.name} needs it beside it.")
    names = [_name(foil) for foil in foils]
    for name in names:
        if names.count(name) > 1:
            raise UnusableInput(f"{path}: holds recording {name} twice; give a folder with one.")
    return foils


def _files(foil: Path) -> tuple[Path, Path, Path]:
    stem = foil.name.removesuffix("_Foil.mat")
    return foil, foil.with_name(f"{stem}_Flag2.mat"), foil.with_name(f"{stem}_LDV.mat")


def _name(foil: Path) -> str:
    """The recording's name, as far as an episode's name allows it."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", foil.name.removesuffix("_Foil.mat"))
    return plain.strip("._-")[:80] or "recording"


def _samples(foil_path: Path) -> tuple[Vector, Vector]:
    """One recording at 30 Hz: observations (T, 3) and flag tip (T, 1), every second frame."""
    foil, flag, ldv = (_MatFile.read(path) for path in _files(foil_path))
    time_s, flag_time_s = foil.camera_time(), flag.camera_time()
    foil.check_length("foilang", time_s)
    if len(flag_time_s) != len(time_s) or np.abs(flag_time_s - time_s).max() > 0.25 / _CAMERA_HZ:
        raise flag.refused("time", f"differs from {foil.path.name}'s; the frames do not correspond")
    angle_rad = np.deg2rad(foil.vector("foilang"))
    front_m, tip_m = flag.vector("flagfrontY"), flag.vector("flagtipY")
    flag.check_length("flagfrontY", time_s)
    flag.check_length("flagtipY", time_s)
    frames = np.arange(0, len(time_s), _FRAMES_PER_SAMPLE)
    frames, flow_mps = ldv.held_at(time_s, frames)
    columns = (angle_rad[frames], flow_mps, front_m[frames])
    return np.column_stack(columns), tip_m[frames, None]


def _blocks(name: str, observation: Vector, force: Vector) -> list[tuple[str, Episode]]:
    """The recording's time blocks as (split, episode)."""
    pieces = []
    for split, start, end in BLOCKS:
        part = slice(round(start * len(force)), round(end * len(force)))
        arrays = observation[part].astype(np.float32), force[part].astype(np.float32)
        pieces.append((split, Episode(f"{name}-{split}", *arrays)))
    return pieces


@dataclass(frozen=True)
class _MatFile:
    """One MATLAB file's variables, checked as they are asked for."""

    path: Path
    variables: Mapping[str, Variable]

    @classmethod
    def read(cls, path: Path) -> "_MatFile":
        """Read a file; UnusableInput for anything that is not a MATLAB file up to version 7.2."""
        try:
            return cls(path, read_mat(path))
        except (OSError, ValueError) as error:
            raise UnusableInput(
                f"{path}: cannot be read as a MATLAB file ({one_line(error)}); fetch it again."
            ) from error

    def refused(self, key: str, reason: str) -> UnusableInput:
        """The error that names this file, a variable and what is wrong with it."""
        return UnusableInput(f"{self.path}: {key}: {reason}; fetch the file again or leave it out.")

    def vector(self, key: str) -> Vector:
        """A variable as a vector (n,) of finite real numbers."""
        if key not in self.variables:
            raise self.refused(key, "is missing")
        if isinstance(value := self.variables[key], Unread):
            raise self.refused(key, "does not hold real numbers")
        if value.size < 2 or value.size != max(value.shape):
            raise self.refused(key, f"has shape {value.shape}, not one row or column")
        vector = value.ravel()
        # Sets hold float32: what overflows there is as little a measurement as a NaN.
        finite = np.abs(vector) < np.finfo(np.float32).max
        if not finite.all():
            raise self.refused(key, f"is not finite at sample {np.flatnonzero(~finite)[0]}")
        return vector

    def check_length(self, key: str, time_s: Vector) -> None:
        """One value for each frame."""
        if (given := len(self.vector(key))) != len(time_s):
            raise self.refused(key, f"has {given} samples for {len(time_s)} times")

    def camera_time(self) -> Vector:
        """`time` [s], rising by one frame of the 60 Hz camera from sample to sample."""
        time_s = self.vector("time")
        steps_s = np.diff(time_s)
        if (steps_s <= 0).any():
            raise self.refused("time", f"does not rise at sample {np.argmax(steps_s <= 0) + 1}")
        rate_hz = 1.0 / float(np.median(steps_s))
        if abs(rate_hz - _CAMERA_HZ) > 0.01 * _CAMERA_HZ:
            raise self.refused("time", f"runs at {rate_hz:.4g} Hz, not {_CAMERA_HZ:g} Hz")
        uneven = np.abs(steps_s * _CAMERA_HZ - 1.0) > 0.2
        if uneven.any():
            at = int(np.argmax(uneven))
            raise self.refused(
                "time", f"steps by {steps_s[at]:.4g} s after sample {at}: frames lost"
            )
        return time_s

    def held_at(self, time_s: Vector, frames: NDArray[np.intp]) -> tuple[NDArray[np.intp], Vector]:
        """The flow's newest sample at or before each frame, and the frames that have one.

        Frames before the first sample and more than a second after the last are left out.
        """
        ldv_s, flow_mps = self.vector("tLDV"), self.vector("uLDV")
        self.check_length("uLDV", ldv_s)
        gaps_s = np.diff(ldv_s)
        if (gaps_s < 0).any():
            raise self.refused("tLDV", f"falls at sample {np.argmax(gaps_s < 0) + 1}")
        if gaps_s.max() > _LONGEST_HOLD_S:
            at = int(np.argmax(gaps_s))
            bound = f"more than {_LONGEST_HOLD_S:g} s"
            raise self.refused(
                "tLDV", f"is silent for {gaps_s[at]:.3g} s after sample {at}, {bound}"
            )
        inside = (time_s[frames] >= ldv_s[0]) & (time_s[frames] <= ldv_s[-1] + _LONGEST_HOLD_S)
        kept = frames[inside]
        if len(kept) < _SHORTEST_S * RATE_HZ:
            overlap_s = len(kept) / RATE_HZ
            reason = f"shares {overlap_s:.3g} s with the camera, less than {_SHORTEST_S:g} s"
            raise self.refused("tLDV", reason)
        return kept, flow_mps[np.searchsorted(ldv_s, time_s[kept], side="right") - 1]


DOMAIN = Recorded(
    main="flag_tip_m",
    help_text="""Import recordings of a flag behind a flapping foil (…_Foil, …_Flag2 and …_LDV.mat).

PATH is the repository, its data folder, or any folder with such files.""",
    examples=("TE-analysis-for-multi-pathway-interaction --out sets/fish",),
    read=import_set,
    pattern="*_Foil.mat",
)
