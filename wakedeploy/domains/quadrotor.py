"""Two quadrotors: an episode set from FlareDW recordings in their public layout.

In: a folder with the recordings (see `quadrotor_files`). Out: an episode set at 200 Hz: the
authors' 14 features of source and sufferer predict a force label in world axes, the authors' or
the corrected one. Courses, not samples and not files, are split (see `courses`).
"""

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from wakedeploy.core.episodes import OBSERVER, SPLITS, Channel, Episode, EpisodeSet
from wakedeploy.core.files import sha256_of
from wakedeploy.core.version import VERSION
from wakedeploy.domains.courses import courses_of, split_courses
from wakedeploy.domains.domain import Recorded, Setting
from wakedeploy.domains.quadrotor_files import (
    LABEL_GRAVITY_MPS2,
    MASS_KG,
    RATE_HZ,
    THRUST_VALID_RADPS,
    Flight,
    attitude,
    corrected_label,
    read_flights,
    thrust_n,
)

WINDOW_S = 0.5
FORCE = tuple(Channel(f"force_{axis}_n", "N") for axis in "xyz")
_ANGLES = ("source_thrust", "sufferer_thrust", "source_velocity", "sufferer_velocity")
OBSERVATION = (
    Channel("distance_m", "m"),
    Channel("dz_m", "m"),
    Channel("source_thrust_z_n", "N"),
    Channel("sufferer_thrust_z_n", "N"),
    Channel("source_vz_mps", "m/s"),
    Channel("sufferer_vz_mps", "m/s"),
    *(Channel(f"{part}_{name}", "1") for name in _ANGLES for part in ("cos", "sin")),
)
# Channels into which the sufferer's own motion goes: their past shows its acceleration.
OWN_MOTION = tuple(c.name for c in OBSERVATION if not c.name.startswith("source_"))
OBSERVER_S = 0.025  # over which the no-learning observer takes the sufferer's change of speed
LABEL = Setting(
    "label", "choice", default="authors", choices=("authors", "corrected"),
    help="The authors' force, or with m ω × v that their turning axes leave out; compare models "
    "on the corrected one.",
)  # fmt: skip
_MANOEUVRE = re.compile(r"\d_[A-Za-z_]+")  # 1_flybelow, 3_swapping

Vector = NDArray[np.float64]


def import_set(
    path: Path, progress: Callable[[int, int], None] | None = None, label: str = "authors"
) -> EpisodeSet:
    """Read every recording below `path`; UnusableInput names the file, the key and the reason.

    `label` is "authors" or "corrected": the acceleration on which the authors' rests is that of
    turning axes, and the corrected one has m ω × v given back.

    Each episode carries, beside the features, what a force observer that learns nothing would say
    (`observer_n`, (T, 3) [N], causal) and whether the thrust curve holds (`thrust_valid`, (T,)).
    `progress(done, total)` is called after each flight. The provenance has each episode's
    manoeuvre and course (`groups`), how many files and courses each split has, and which channels
    show the sufferer's own motion.
    """
    flights = read_flights(path)
    courses = courses_of(flights)
    manoeuvre = {file: _manoeuvre(file) for file in courses}
    split = split_courses(flights, courses, manoeuvre)
    episodes, splits = list[Episode](), dict[str, str]()
    manoeuvres, groups = dict[str, JsonValue](), dict[str, JsonValue]()
    for done, (name, flight) in enumerate(zip(_names(flights), flights, strict=True), 1):
        episodes.append(_episode(name, flight, label))
        course = courses[flight.file]
        splits[name] = split[course]
        manoeuvres[name] = manoeuvre[flight.file]
        groups[name] = str(course.relative_to(path))
        if progress is not None:
            progress(done, len(flights))
    files = sorted(p for p in path.rglob("*.npz") if not p.name.startswith("."))
    return EpisodeSet(
        domain="quadrotor",
        rate_hz=RATE_HZ,
        observation=OBSERVATION,
        force=FORCE,
        window_s=WINDOW_S,
        loss_weights=(1.0, 1.0, 1.0),
        split=splits,
        episodes=tuple(episodes),
        provenance={
            "generator": f"wakedeploy {VERSION} quadrotor",
            "files": {str(p.relative_to(path)): sha256_of(p.read_bytes()) for p in files},
            "manoeuvre": manoeuvres,
            "groups": groups,
            "recordings": _recordings(courses, split),
            "own_motion": [*OWN_MOTION],
            "label": label,
        },
    )


def features(source: Vector, sufferer: Vector) -> Vector:
    """The authors' agile features (n, 14) of two vehicles' states (n, 26).

    Distances along and across the vertical, vertical thrusts and speeds, then the cosine and sine
    of the angle, seen from above, between the line from source to sufferer and each vehicle's
    thrust and velocity. Turning the world about the vertical changes none of them.
    """
    offset = sufferer[:, 0:3] - source[:, 0:3]
    thrusts = [attitude(s)[:, :, 2] * thrust_n(s)[:, None] for s in (source, sufferer)]
    velocities = [s[:, 3:6] for s in (source, sufferer)]
    columns = [np.linalg.norm(offset[:, :2], axis=1), offset[:, 2]]
    columns += [vector[:, 2] for vector in (*thrusts, *velocities)]
    for vector in (*thrusts, *velocities):
        columns += _angle(offset, vector)
    return np.column_stack(columns)


def observed_force(states: Vector) -> Vector:
    """What the sufferer's own motion says of the force on it (n, 3) [N], without learning.

    m·Δv/25 ms − T + m·g: mass times the change of velocity over the last 25 ms, less thrust and
    weight, with the label's g. Causal; before the first 25 ms it repeats the first value.
    """
    steps = round(OBSERVER_S * RATE_HZ)
    velocity = states[:, 3:6]
    change = (velocity[steps:] - velocity[:-steps]) / OBSERVER_S
    change = np.concatenate([np.repeat(change[:1], steps, axis=0), change])
    force = MASS_KG * change - attitude(states)[:, :, 2] * thrust_n(states)[:, None]
    force[:, 2] += MASS_KG * LABEL_GRAVITY_MPS2
    return np.asarray(force)


def _angle(offset: Vector, vector: Vector) -> list[Vector]:
    """Cosine and sine of the angle between two vectors seen from above, 0 where one vanishes."""
    size = np.linalg.norm(offset[:, :2], axis=1) * np.linalg.norm(vector[:, :2], axis=1)
    along = (offset[:, :2] * vector[:, :2]).sum(1)
    across = offset[:, 0] * vector[:, 1] - offset[:, 1] * vector[:, 0]
    size = np.maximum(size, 1e-9)
    return [along / size, across / size]


def _names(flights: Sequence[Flight]) -> list[str]:
    """A name for each flight: manoeuvre, file, first sample; numbered where files share a name."""
    names = list[str]()
    for flight in flights:
        plain = re.sub(r"[^A-Za-z0-9._-]+", "-", f"{_manoeuvre(flight.file)}-{flight.file.stem}")
        start = flight.name.rpartition("@")[2]
        same = (f"{plain[:80]}-{start}{f'-{i}' if i else ''}" for i in itertools.count())
        names.append(next(name for name in same if name not in names))
    return names


def _episode(name: str, flight: Flight, label: str) -> Episode:
    force = corrected_label(flight) if label == "corrected" else flight.label
    speed = np.abs(flight.sufferer[:, 22:26]).mean(1)
    valid = (speed >= THRUST_VALID_RADPS[0]) & (speed <= THRUST_VALID_RADPS[1])
    return Episode(
        name,
        features(flight.source, flight.sufferer).astype(np.float32),
        force.astype(np.float32),
        {
            OBSERVER: observed_force(flight.sufferer).astype(np.float32),
            "thrust_valid": valid.astype(np.float32),
        },
    )


def _manoeuvre(file: Path) -> str:
    """The numbered folder that a recording lies in, "other" if there is none."""
    named = [part for part in file.resolve().parent.parts if _MANOEUVRE.fullmatch(part)]
    return named[-1] if named else "other"


def _recordings(courses: Mapping[Path, Path], split: Mapping[Path, str]) -> dict[str, JsonValue]:
    """How many files each split has, and how many of them are independent of each other."""
    return {
        name: {
            "files": sum(split[course] == name for course in courses.values()),
            "independent": sum(part == name for part in split.values()),
        }
        for name in SPLITS
    }


DOMAIN = Recorded(
    main="force_z_n",
    help_text="""Import co-simulations of two quadrotors (FlareDW's .npz files, 200 Hz).

PATH is the repository's folder agile_manuevers, or any folder with such files.""",
    examples=(
        "CDP-CFD/agile_manuevers --out sets/quadrotor",
        "CDP-CFD/agile_manuevers --label corrected --out sets/quadrotor",
    ),
    read=import_set,
    pattern="*.npz",
    settings=(LABEL,),
)
