"""Ships that meet or overtake each other in a shallow channel, simulated, as an episode set.

In: how many minutes, a seed, and how the forces are computed. Out: an episode set at 2 Hz: what
both ships do predicts the sway force and yaw moment on the sufferer. It steers to targets across
the channel that change with time and are not observed. Ranges are those in which such passages
happen; forces come from `wakedeploy.physics.ships`.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.processes import processes
from wakedeploy.core.version import VERSION
from wakedeploy.domains.domain import Setting, Simulated
from wakedeploy.domains.split import split_in_order
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.physics.ships.hull import Hull
from wakedeploy.physics.ships.manoeuvring import Ship, State
from wakedeploy.physics.ships.shallow import VortexShips, Waterway
from wakedeploy.physics.ships.slender import Passing

RATE_HZ = 2.0
WINDOW_S = 30.0  # in which a ship moves on by about its length
OBSERVATION = (
    Channel("dx_m", "m"),
    Channel("dy_m", "m"),
    Channel("dvx_mps", "m/s"),
    Channel("dvy_mps", "m/s"),
    Channel("sufferer_speed_mps", "m/s"),
    Channel("sufferer_heading_rad", "rad"),
    Channel("sufferer_aside_m", "m"),
    Channel("depth_over_draught", "1"),
)
# Channels into which the sufferer's own motion under these forces goes: differentiated, their past
# shows the force without any knowledge of wakes. Along the channel a ship does not answer to them:
# the way along it, and both speeds ahead, may be remembered.
OWN_MOTION = ("dy_m", "dvy_mps", "sufferer_heading_rad", "sufferer_aside_m")
FORCE = (Channel("sway_n", "N"), Channel("yaw_nm", "N m"))
Level = Literal["slender", "vortex"]

# Estimates all. The nearest pass, 25 m between ships that are 15 m wide, leaves room for swerves.
DEPTH_OVER_DRAUGHT = (1.2, 2.0)
APART_LENGTHS = (0.25, 0.5)
SPEED_RATIO = (0.5, 2.0)
SPEED_MPS = (3.0, 5.0)
WALL_LENGTHS = (0.9, 1.4)
_FROM_LENGTHS = 2.0  # apart along the channel when a pass begins and ends
# Before, wakes form. It is recorded, too: memories warm up meanwhile, and the whole pass is scored.
_SETTLING_S = WINDOW_S
# Both models take the water's surface for rigid: no ship may be near the speed of its own waves.
_FASTEST_FROUDE = 0.6  # speed over √(g · depth)
_SLOWEST_PASS = 0.15  # a pass whose speeds differ less, relative to the faster, would never end
_NEAREST_BEAMS = 1.15
_SWERVE_LENGTHS = 0.06
_SWERVE_S = (60.0, 240.0)


@dataclass(frozen=True)
class _Job:
    level: Level
    seed: int
    name: str


@dataclass(frozen=True)
class _Pass:
    """One passage: who comes how, and where the sufferer wants to be."""

    depth_m: float
    wall_m: float
    sufferer_mps: float
    source_mps: float  # signed: negative for a ship that comes towards one
    sufferer_m: float
    source_m: float
    swerves: tuple[tuple[float, float, float], ...]  # amplitude [m], rate [rad/s], phase

    def target_m(self, t_s: float) -> float:
        """Where across the channel the sufferer steers to."""
        return self.sufferer_m + sum(a * math.sin(w * t_s + p) for a, w, p in self.swerves)


def make_set(
    *,
    minutes: float,
    seed: int,
    level: Level = "vortex",
    progress: Callable[[int, int], None] | None = None,
    workers: int = 2,
) -> EpisodeSet:
    """Simulate passages until there are `minutes` of them, at least three; split by passage.

    `level` "vortex" has wakes and with them a memory, "slender" has none, and smaller forces where
    the keel is near the ground, because its added mass is that of deep water. `progress(done,
    total)` counts seconds.
    """
    wanted_s, done_s = 60.0 * minutes, 0.0
    jobs = (_Job(level, 1_000_000 * (seed + 1) + i, f"pass{i:04d}") for i in itertools.count())
    episodes: list[Episode] = []
    with processes(workers) as each:
        while done_s < wanted_s or len(episodes) < 3:
            for episode in each(_sail, itertools.islice(jobs, 4 * workers)):
                if done_s < wanted_s or len(episodes) < 3:
                    episodes.append(episode)
                    done_s += len(episode.force) / RATE_HZ
            if progress is not None:
                progress(min(round(done_s), round(wanted_s)), round(wanted_s))
    split = split_in_order([e.name for e in episodes])
    learned = np.concatenate([e.force for e in episodes if split[e.name] == "train"]).astype(float)
    return EpisodeSet(
        domain="ship",
        rate_hz=RATE_HZ,
        observation=OBSERVATION,
        force=FORCE,
        window_s=WINDOW_S,
        # A force and a moment have no common unit: each counts by its own spread.
        loss_weights=tuple(float(v) for v in learned.var(axis=0)[0] / learned.var(axis=0)),
        split=split,
        episodes=tuple(episodes),
        provenance={
            "generator": f"wakedeploy {VERSION} ship",
            "seed": seed,
            "minutes": minutes,
            "level": level,
            "own_motion": [*OWN_MOTION],
            "groups": {e.name: e.name for e in episodes},  # a pass is one sample, however long
        },
    )


def _sail(job: _Job) -> Episode:
    """A passage in which the hulls keep clear of each other and of the walls."""
    for attempt in range(20):
        rows = list(_steps(_drawn(np.random.default_rng([job.seed, attempt])), job.level))
        if rows and all(row is not None for row in rows):
            observed = np.array([row[0] for row in rows if row is not None])
            forces = np.array([row[1] for row in rows if row is not None])
            return Episode(job.name, observed.astype(np.float32), forces.astype(np.float32))
    raise UnusableInput(f"{job.name}: 20 passages in a row ended in a collision; change the seed.")


def _drawn(rng: np.random.Generator) -> _Pass:
    hull = Hull()
    depth_m = hull.draught_m * float(rng.uniform(*DEPTH_OVER_DRAUGHT))
    fastest_mps = _FASTEST_FROUDE * math.sqrt(GRAVITY_MPS2 * depth_m)
    while True:
        sufferer = float(rng.uniform(*SPEED_MPS))
        ratio = float(np.exp(rng.uniform(*np.log(SPEED_RATIO))))
        differs = abs(ratio - 1.0) > _SLOWEST_PASS * max(ratio, 1.0)
        if differs and sufferer * max(ratio, 1.0) < fastest_mps:
            break
    way = -1.0 if rng.random() < 0.5 else 1.0
    apart = float(rng.uniform(*APART_LENGTHS)) * hull.length_m * float(rng.choice([-1.0, 1.0]))
    swerves = tuple(
        (
            _SWERVE_LENGTHS * hull.length_m * float(rng.uniform(0.3, 1.0)),
            2.0 * math.pi / float(rng.uniform(*_SWERVE_S)),
            float(rng.uniform(0.0, 2.0 * math.pi)),
        )
        for _ in range(2)
    )
    return _Pass(
        depth_m=depth_m,
        wall_m=hull.length_m * float(rng.uniform(*WALL_LENGTHS)),
        sufferer_mps=sufferer,
        source_mps=way * ratio * sufferer,
        sufferer_m=0.5 * apart,
        source_m=-0.5 * apart,
        swerves=swerves,
    )


def _steps(
    encounter: _Pass, level: Level
) -> Iterator[tuple[tuple[float, ...], tuple[float, float]] | None]:
    """Observation and force of each sample; None where hulls touch."""
    hull, dt_s = Hull(), 1.0 / RATE_HZ
    closing = encounter.source_mps - encounter.sufferer_mps
    lead_m = _FROM_LENGTHS * hull.length_m
    began_m = -math.copysign(lead_m + _SETTLING_S * abs(closing), closing)
    course = 1 if encounter.source_mps > 0.0 else -1
    sufferer = Ship(
        hull, State(0.0, encounter.target_m(0.0), encounter.sufferer_mps), encounter.sufferer_mps
    )
    speed = abs(encounter.source_mps)
    source = Ship(hull, State(began_m, encounter.source_m, speed, course), speed)
    forces = _Vortices(encounter) if level == "vortex" else _Slender(encounter)
    for k in itertools.count():
        a, b = sufferer.state, source.state
        ahead_m, apart_m = b.x_m - a.x_m, b.aside_m - a.aside_m
        if math.copysign(1.0, closing) * ahead_m > lead_m:
            return
        near = abs(apart_m) < _NEAREST_BEAMS * hull.beam_m and abs(ahead_m) < 1.1 * hull.length_m
        if near or max(abs(a.aside_m), abs(b.aside_m)) > encounter.wall_m - hull.beam_m:
            yield None
            return
        loads = forces.step(a, b, dt_s)
        observed = (
            ahead_m,
            apart_m,
            b.course * b.speed_mps - a.speed_mps,
            b.aside_mps - a.aside_mps,
            a.speed_mps,
            a.heading_rad,
            a.aside_m,
            encounter.depth_m / hull.draught_m,
        )
        yield observed, (float(loads[0][0]), float(loads[1][0]))
        sufferer.step(encounter.target_m(k * dt_s), float(loads[0][0]), float(loads[1][0]), dt_s)
        source.step(encounter.source_m, float(loads[0][1]), float(loads[1][1]), dt_s)


class _Vortices:
    """Level B."""

    def __init__(self, encounter: _Pass) -> None:
        self._ships = VortexShips(Waterway(depth_m=encounter.depth_m, wall_m=encounter.wall_m))

    def step(
        self, a: State, b: State, dt_s: float
    ) -> tuple[np.typing.NDArray[np.float64], np.typing.NDArray[np.float64]]:
        """Forces [N] and moments [N·m] on sufferer and source, (2,) each, earth axes."""
        loads = self._ships.step(
            np.array([a.x_m, b.x_m]),
            np.array([a.aside_m, b.aside_m]),
            np.array([a.speed_mps, b.course * b.speed_mps]),
            dt_s,
        )
        return loads.sway_n, loads.yaw_nm


class _Slender:
    """Level A; each ship in turn is the one that suffers."""

    def __init__(self, encounter: _Pass) -> None:
        self._passing = Passing(depth_m=encounter.depth_m, wall_m=encounter.wall_m)

    def step(
        self, a: State, b: State, dt_s: float
    ) -> tuple[np.typing.NDArray[np.float64], np.typing.NDArray[np.float64]]:
        """As level B's, from the present alone."""
        loads = []
        for ship, other in ((a, b), (b, a)):
            # Seen from a ship that comes the other way, all is turned by half a circle.
            sway, yaw = self._passing.forces(
                np.array([ship.course * (other.x_m - ship.x_m)]),
                ship.course * ship.aside_m,
                ship.course * other.aside_m,
                ship.speed_mps,
                ship.course * other.course * other.speed_mps,
            )
            loads.append((ship.course * sway[0], yaw[0]))
        both = np.array(loads)
        return both[:, 0], both[:, 1]


DOMAIN = Simulated(
    main="sway_n",
    help_text="Sail two ships past each other in a shallow channel: encounters and overtaking.",
    examples=("--out sets/ship --minutes 120 --seed 0",),
    make=make_set,
    minutes=120.0,
    study_minutes=600.0,
    quick_minutes=20.0,
    settings=(
        Setting(
            "level",
            "choice",
            "Slender bodies (no memory, added mass of deep water), or vortices with wakes.",
            default="vortex",
            choices=("slender", "vortex"),
        ),
    ),
)
