"""Two Crazyflies that swap places: real downwash, as an episode set.

In: a folder with `swap_<kinds>_<number>.npz` at 100 Hz, `<kinds>` being `ss`, `sl` or `ll`: which
of small and large the vehicles a and b are (in `sl`, a is the large one). Out: an episode set in
which each flight is two episodes, one for either sufferer: relative state, thrust commands,
batteries and masses predict the measured force in world axes. Split by flight.

The force is mass times measured acceleration (which includes gravity) less the thrust that the
motors are estimated to give; nothing is smoothed.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import sha256_of
from wakedeploy.core.version import VERSION
from wakedeploy.domains.domain import Recorded
from wakedeploy.domains.npz import Arrays, Vector, clock, column, read_arrays, refused, require_even

RATE_HZ = 100.0
WINDOW_S = 0.5
MASS_KG = {"s": 0.032, "l": 0.067}
OBSERVATION = (
    *(Channel(f"d{axis}_m", "m") for axis in "xyz"),
    *(Channel(f"dv{axis}_mps", "m/s") for axis in "xyz"),
    Channel("source_command", "1"),
    Channel("sufferer_command", "1"),
    Channel("source_battery_v", "V"),
    Channel("sufferer_battery_v", "V"),
    Channel("source_mass_kg", "kg"),
    Channel("sufferer_mass_kg", "kg"),
)
# Channels into which the sufferer's own motion goes: their past shows its acceleration. Its battery
# sags with its own thrust.
OWN_MOTION = tuple(c.name for c in OBSERVATION if not c.name.startswith("source_"))
FORCE = tuple(Channel(f"force_{axis}_n", "N") for axis in "xyz")

_SIZE = {MASS_KG["s"]: "small", MASS_KG["l"]: "large"}
_COLUMNS = {"pos": 3, "vel": 3, "acc": 3, "quat_xyzw": 4, "motor_thrust": 4, "pwm": 4, "vbat": 1}
_NAME = re.compile(r"swap_(ss|sl|ll)_.+")
_SHORTEST = 200  # samples
_UNIT = 0.01  # by which a quaternion's length may be off
_ROUND = ("train", "train", "test", "validation", "train")


@dataclass(frozen=True, eq=False)
class _Vehicle:
    """One vehicle's recorded columns, (n, ·) each, and its mass."""

    columns: dict[str, Vector]
    mass_kg: float

    def force_n(self) -> Vector:
        """What neither thrust nor gravity explains (n, 3), world axes."""
        x, y, z, w = self.columns["quat_xyzw"].T
        up = np.stack([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)], axis=1)
        thrust_n = self.columns["motor_thrust"].sum(1)
        return np.asarray(self.mass_kg * self.columns["acc"] - up * thrust_n[:, None])

    def command(self) -> Vector:
        """Mean pulse width of the four motors (n,), 0…1."""
        return np.asarray(self.columns["pwm"].mean(1))


def import_set(path: Path, progress: Callable[[int, int], None] | None = None) -> EpisodeSet:
    """Read every flight below `path`; UnusableInput names the file, the key and the reason.

    `progress(done, total)` is called after each flight. The provenance has who flew by whom in each
    episode, which flight it is of (`groups`: both sufferers of one flight share its air), and which
    channels show the sufferer's own motion.
    """
    files = _find(path)
    episodes, split, splits = list[Episode](), dict[str, str](), _split(files)
    pairs, flights = dict[str, JsonValue](), dict[str, JsonValue]()
    for done, file in enumerate(files, 1):
        a, b = _read(file)
        for sufferer, source, letter in ((a, b, "a"), (b, a, "b")):
            plain = re.sub(r"[^A-Za-z0-9._-]+", "-", file.stem)[:90]
            episode = _episode(f"{plain}-{letter}", source, sufferer)
            episodes.append(episode)
            split[episode.name] = splits[file]
            flights[episode.name] = file.stem
            pairs[episode.name] = f"{_SIZE[sufferer.mass_kg]} by {_SIZE[source.mass_kg]}"
        if progress is not None:
            progress(done, len(files))
    return EpisodeSet(
        domain="crazyflie",
        rate_hz=RATE_HZ,
        observation=OBSERVATION,
        force=FORCE,
        window_s=WINDOW_S,
        loss_weights=(1.0, 1.0, 1.0),
        split=split,
        episodes=tuple(episodes),
        provenance={
            "generator": f"wakedeploy {VERSION} crazyflie",
            "files": {file.name: sha256_of(file.read_bytes()) for file in files},
            "manoeuvre": pairs,
            "groups": flights,
            "own_motion": [*OWN_MOTION],
        },
    )


def _episode(name: str, source: _Vehicle, sufferer: _Vehicle) -> Episode:
    n = len(sufferer.columns["pos"])
    observed = [
        source.columns["pos"] - sufferer.columns["pos"],
        source.columns["vel"] - sufferer.columns["vel"],
        source.command(),
        sufferer.command(),
        source.columns["vbat"],
        sufferer.columns["vbat"],
        np.full(n, source.mass_kg),
        np.full(n, sufferer.mass_kg),
    ]
    return Episode(
        name,
        np.column_stack(observed).astype(np.float32),
        sufferer.force_n().astype(np.float32),
    )


def _split(files: list[Path]) -> dict[Path, str]:
    """A split for each flight, the kinds of pairs shared out alike."""
    kinds = {_kind(file): [f for f in files if _kind(f) == _kind(file)] for file in files}
    return {
        file: _ROUND[place % len(_ROUND)]
        for same in kinds.values()
        for place, file in enumerate(same)
    }


def _kind(file: Path) -> str:
    found = _NAME.fullmatch(file.stem)
    if found is None:
        raise UnusableInput(
            f"{file}: the name does not say which vehicles fly; it has to begin with swap_ss_, "
            "swap_sl_ or swap_ll_."
        )
    return found[1]


def _find(path: Path) -> list[Path]:
    if not path.is_dir():
        raise UnusableInput(f"{path}: is not a folder; give one that holds swap_….npz files.")
    files = sorted(p for p in path.rglob("swap_*.npz") if not p.name.startswith("."))
    if not files:
        raise UnusableInput(f"{path}: no swap_….npz in it or below; give the folder of flights.")
    names = [file.name for file in files]
    for name in names:
        if names.count(name) > 1:
            raise UnusableInput(f"{path}: holds {name} twice; give a folder with one.")
    return files


def _read(file: Path) -> tuple[_Vehicle, _Vehicle]:
    """Vehicles a and b."""
    kind = _kind(file)
    masses = (MASS_KG["l"], MASS_KG["s"]) if kind == "sl" else (MASS_KG[kind[0]],) * 2
    arrays = read_arrays(file)
    n = len(_time(file, arrays))
    for letter in "ab":
        length = np.linalg.norm(column(file, arrays, f"{letter}_quat_xyzw", (n, 4)), axis=1)
        if (np.abs(length - 1.0) > _UNIT).any():
            at = int(np.argmax(np.abs(length - 1.0) > _UNIT))
            raise refused(file, f"{letter}_quat_xyzw", f"is no unit quaternion at sample {at}")
    a, b = (
        _Vehicle({k: column(file, arrays, f"{letter}_{k}", (n, w)) for k, w in _COLUMNS.items()}, m)
        for letter, m in zip("ab", masses, strict=True)
    )
    return a, b


def _time(file: Path, arrays: Arrays) -> Vector:
    """`t` [s], rising evenly at 100 Hz."""
    time_s = clock(file, arrays, "t")
    if len(time_s) < _SHORTEST:
        raise refused(file, "t", f"has {len(time_s)} samples, less than {_SHORTEST}")
    require_even(file, "t", time_s, RATE_HZ)
    return time_s


DOMAIN = Recorded(
    main="force_z_n",
    help_text="""Import flights of two Crazyflies that swap places (.npz, 100 Hz, real downwash).

PATH is any folder with swap_ss_*, swap_sl_* or swap_ll_* (small, large; in sl a is the
large one), a flight each, which becomes two episodes, one for either sufferer. Keys: t [s]; a_
and b_ each with pos [m], vel [m/s], acc [m/s², gravity included], quat_xyzw, motor_thrust [N],
pwm [0…1], vbat [V].""",
    examples=("swaps --out sets/crazyflie",),
    read=import_set,
    pattern="swap_*.npz",
)
