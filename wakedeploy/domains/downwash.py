"""The paper's 2D downwash simulator: two multicopters under LQR, one above the other.

In: seeds, and what the sufferer expects of the wake: nothing, the truth, or a predictor. Out: how
it flew, or an episode set at 100 Hz. All episodes of a call fly in lockstep, so that one batched
prediction serves them all. The transport delay is nowhere put in: it comes out of the field.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from pydantic import JsonValue

from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.version import VERSION
from wakedeploy.domains.domain import Setting, Simulated
from wakedeploy.domains.split import split_in_order
from wakedeploy.physics.body import PlanarBody, thrust_vector_n
from wakedeploy.physics.field import FieldGrid, FieldPhysics, WakeField
from wakedeploy.physics.field_grid import drag_force_n
from wakedeploy.physics.planar_flight import Lqr, lqr
from wakedeploy.physics.rail import GRAVITY_MPS2

FloatArray = npt.NDArray[np.float64]
Predict = Callable[[FloatArray], FloatArray]

RATE_HZ = 100.0
DT_S = 1.0 / RATE_HZ
NOMINAL_DELAY_S = 2.3 / 6.0
WINDOW_S = 0.75  # twice that; a set with another delay keeps it
EPISODE_S = 20.0
_SETTLING_DELAYS = 3.0  # before recording, and a second: the wake has to arrive in its full width
OBSERVATION = (
    Channel("dx_m", "m"),
    Channel("dz_m", "m"),
    Channel("dvx_mps", "m/s"),
    Channel("dvz_mps", "m/s"),
    Channel("source_thrust_x_n", "N"),
    Channel("source_thrust_z_n", "N"),
    Channel("sufferer_thrust_x_n", "N"),
    Channel("sufferer_thrust_z_n", "N"),
)
# Channels into which the sufferer's own motion goes. Nothing here is noisy: their differences from
# step to step show most of the force.
OWN_MOTION = tuple(c.name for c in OBSERVATION if not c.name.startswith("source_"))
FORCE = (Channel("force_x_n", "N"), Channel("force_z_n", "N"))
_LOCKSTEP = 16  # episodes; their fields still fit into a core's cache one by one


@dataclass(frozen=True)
class World:
    """The simulator's constants, one number each or one per episode (E,) where arrays are allowed.

    The paper gives `speed_mps`, `diffusivity_m2ps` and `separation_m`. The others are estimates:
    a small multicopter of 1 kg; a jet whose Gaussian is as wide as its rotors; strength and drag
    area for a hovering source to push a tenth of the sufferer's weight 2.3 m below; a decay that
    takes 11 % on the way there. At the grid's top and sides the air is at rest; at its bottom it
    flows out, 1.3 m below the sufferer. Both wander sideways by some `sway_m`, as wide as the
    wake is where it arrives, so that the sufferer is now in it and now beside it; the source also
    up and down by `heave_m`, which moves its thrust by a tenth; neither at more than
    `turning_rad_ps`. `spread` is how far speed and separation may be from the paper's, as a
    share; see `shifted`.
    """

    speed_mps: float | FloatArray = 6.0
    diffusivity_m2ps: float | FloatArray = 0.3
    separation_m: float | FloatArray = 2.3
    decay_per_s: float = 0.3
    strength: float = 126.0
    width_m: float = 0.25
    drag_area_m2: float = 0.06
    mass_kg: float = 1.0
    inertia_kgm2: float = 0.02
    sway_m: float = 0.4
    heave_m: float = 0.1
    turning_rad_ps: float = 3.5
    spread: float = 0.0
    grid: FieldGrid = field(default_factory=FieldGrid)

    @property
    def slowest_s(self) -> float:
        """The longest transport delay that its spread allows."""
        return NOMINAL_DELAY_S * (1.0 + self.spread) / (1.0 - self.spread)

    @property
    def settling_s(self) -> float:
        """Until the wake is there in its full width, at the nominal delay and largest spread."""
        return 1.0 + _SETTLING_DELAYS * self.slowest_s

    def field(self, episodes: int) -> WakeField:
        """The air at rest."""
        physics = FieldPhysics(
            speed_mps=self.speed_mps,
            diffusivity_m2ps=self.diffusivity_m2ps,
            decay_per_s=self.decay_per_s,
            strength=self.strength,
            width_m=self.width_m,
            reference_thrust_n=self.mass_kg * GRAVITY_MPS2,
        )
        return WakeField(self.grid, physics, dt_s=DT_S, episodes=episodes)

    def regulator(self) -> Lqr:
        """The controller of either multicopter: 5 cm of error are worth 1 N or 0.15 N·m."""
        weight_n = self.mass_kg * GRAVITY_MPS2
        return lqr(
            self.mass_kg,
            self.inertia_kgm2,
            dt_s=DT_S,
            state_scale=np.array([0.05, 0.05, 0.3, 0.3, 0.3, 3.0]),
            thrust_scale_n=1.0,
            torque_scale_nm=0.15,
            thrust_n=(0.1 * weight_n, 2.0 * weight_n),
            torque_nm=1.0,
        )


@dataclass(frozen=True, eq=False)
class Flights:
    """What E episodes of T samples were: observations (T, E, 8), forces and expectations (T, E, 2).

    `error_m` (T, E, 2) is how far the sufferer was from its reference in x and z.
    """

    observation: FloatArray
    force_n: FloatArray
    expected_n: FloatArray
    error_m: FloatArray

    @property
    def tracking_m(self) -> FloatArray:
        """Root mean square distance from the reference, per episode (E,)."""
        return np.asarray(np.sqrt((self.error_m**2).sum(-1).mean(0)))


def fly(
    seeds: Sequence[int],
    *,
    world: World | None = None,
    seconds: float = EPISODE_S,
    expect: Predict | str = "nothing",
    settling_s: float | None = None,
) -> Flights:
    """Fly one episode per seed in lockstep; an episode does not depend on its companions.

    `expect` is what the sufferer compensates. It is "nothing", or "truth": the oracle knows the
    force of this very step. With "roughly" it is the truth times a factor and with an error, as of
    a predictor that is not trained yet. Or it is a function from observations (E, 8) to forces
    (E, 2), called once a step from the first step of the flight on. Nothing is recorded for
    `settling_s`, by default until the slowest wake has arrived.
    """
    world = world if world is not None else World()
    settling = round((world.settling_s if settling_s is None else settling_s) * RATE_HZ)
    episodes = len(seeds)
    steps = settling + round(seconds * RATE_HZ)
    ways = np.concatenate(_ways(seeds, world, steps), axis=1)  # (T, 2 E, 6), sources first
    # What turns the bodies along their references is planned with them.
    planned_nm = world.inertia_kgm2 * np.gradient(ways[..., 5], DT_S, axis=0)
    factor, error_n = _mistakes(seeds, steps)
    body, regulator = PlanarBody(world.mass_kg, world.inertia_kgm2), world.regulator()
    air = world.field(episodes)
    states = ways[0].copy()
    nothing = np.zeros((episodes, 2))
    flown = Flights(*(np.empty((steps, episodes, n)) for n in (8, 2, 2, 2)))
    thrusts = np.full(2 * episodes, world.mass_kg * GRAVITY_MPS2)
    for k in range(steps):
        source, sufferer = states[:episodes], states[episodes:]
        air_mps = air.velocity(sufferer[:, 0], sufferer[:, 1])
        force = drag_force_n(air_mps, world.drag_area_m2)
        observed = _observed(source, sufferer, thrusts.reshape(2, episodes))
        about = factor * force + error_n[k]
        expected = _expected(
            expect, observed, {"nothing": nothing, "truth": force, "roughly": about}
        )
        flown.observation[k], flown.force_n[k], flown.expected_n[k] = observed, force, expected
        flown.error_m[k] = (sufferer - ways[k, episodes:])[:, :2]
        thrusts, turns = regulator.control(states, ways[k], np.concatenate([nothing, expected]))
        _push_air(air, world, source, thrusts[:episodes])
        pushed = np.concatenate([nothing, force])
        states = body.step(states, thrusts, turns + planned_nm[k], pushed, DT_S)
    return Flights(*(getattr(flown, name)[settling:] for name in vars(flown)))


def make_set(
    *,
    minutes: float,
    seed: int,
    spread: float = 0.0,
    world: World | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> EpisodeSet:
    """Record `minutes` of flight in episodes of 20 s, at least three; split by episode.

    Half of them fly with roughly the true force as feedforward, so that a predictor meets the
    motion that its own will cause. It has to be wrong: after an exact one the sufferer's own thrust
    shows the force, and a predictor that has learned so believes itself in flight. With `spread`,
    wake speed, diffusivity and separation are drawn anew for each episode, uniformly within that
    share of their nominal values, which are those of `world`. `progress(done, total)`.
    """
    count = max(3, round(60.0 * minutes / EPISODE_S))
    episodes: list[Episode] = []
    for first in range(0, count, _LOCKSTEP):
        numbers = range(first, min(first + _LOCKSTEP, count))
        for half, expect in enumerate(("nothing", "roughly")):
            chosen = [n for n in numbers if n % 2 == half]
            seeds = [1_000_000 * (seed + 1) + n for n in chosen]
            flown = (
                fly(seeds, world=shifted(seeds, spread, world), expect=expect) if chosen else None
            )
            episodes += [_episode(flown, e, n) for e, n in enumerate(chosen) if flown is not None]
        if progress is not None:
            progress(numbers.stop, count)
    episodes.sort(key=lambda e: e.name)
    return EpisodeSet(
        domain="downwash",
        rate_hz=RATE_HZ,
        observation=OBSERVATION,
        force=FORCE,
        window_s=WINDOW_S,
        loss_weights=(1.0, 1.0),
        split=split_in_order([e.name for e in episodes]),
        episodes=tuple(episodes),
        provenance={
            "generator": f"wakedeploy {VERSION} downwash",
            "seed": seed,
            "minutes": minutes,
            "spread": spread,
            "own_motion": [*OWN_MOTION],
            **({} if world is None else {"world": _world_json(world)}),
        },
    )


def shifted(seeds: Sequence[int], spread: float, world: World | None = None) -> World:
    """A world whose wake speed, diffusivity and separation differ from episode to episode.

    Each is drawn uniformly within ±`spread` of its nominal value by the episode's own seed. The
    grid grows with what a slow or diffusive wake, or a far sufferer, needs.
    """
    world = world if world is not None else World()
    if spread == 0.0:
        return world
    draws = np.array([np.random.default_rng([s, 77]).uniform(-1.0, 1.0, 3) for s in seeds])
    speed, diffusivity, separation = (1.0 + spread * draws).T
    deepest_m = 3.57 * (1.0 + spread)
    widest = 1.0 + spread
    rows = math.ceil((deepest_m + 1.2 / (1.0 - spread)) / world.grid.cell_z_m)
    columns = 2 * math.ceil(0.5 * world.grid.columns * widest)
    grid = replace(
        world.grid,
        bottom_m=-deepest_m,
        rows=rows,
        columns=columns,
        left_m=-0.5 * (columns - 1) * world.grid.cell_x_m,
    )
    return replace(
        world,
        speed_mps=world.speed_mps * speed,
        diffusivity_m2ps=world.diffusivity_m2ps * diffusivity,
        separation_m=world.separation_m * separation,
        spread=spread,
        grid=grid,
    )


def _world_json(world: World) -> dict[str, JsonValue]:
    """A world as JSON."""
    plain = {name: value for name, value in vars(world).items() if name != "grid"}
    numbers = {name: np.asarray(value, float).tolist() for name, value in plain.items()}
    return numbers | {"grid": dict(vars(world.grid))}


def _episode(flown: Flights, e: int, number: int) -> Episode:
    return Episode(
        f"flight{number:04d}",
        flown.observation[:, e].astype(np.float32),
        flown.force_n[:, e].astype(np.float32),
    )


def _push_air(air: WakeField, world: World, source: FloatArray, thrust_n: FloatArray) -> None:
    """Inject a step's puff: one for the middle of the step, that sinks for all of it."""
    above_m = 0.5 * DT_S * np.asarray(world.speed_mps, float)
    air.step(source[:, 0], source[:, 1] + above_m, source[:, 2], thrust_n)


def _observed(source: FloatArray, sufferer: FloatArray, thrusts: FloatArray) -> FloatArray:
    """Observations (E, 8) of states (E, 6) and the thrusts (2, E) that are acting."""
    return np.column_stack(
        [
            (source - sufferer)[:, [0, 1, 3, 4]],
            thrust_vector_n(thrusts[0], source[:, 2]),
            thrust_vector_n(thrusts[1], sufferer[:, 2]),
        ]
    )


def _expected(
    expect: Predict | str, observed: FloatArray, known: Mapping[str, FloatArray]
) -> FloatArray:
    if callable(expect):
        return np.asarray(expect(observed), dtype=float)
    if expect not in known:
        raise ValueError(f"expect={expect!r}: must be {', '.join(known)} or a function")
    return known[expect]


def _mistakes(seeds: Sequence[int], steps: int) -> tuple[FloatArray, FloatArray]:
    """By how much "roughly" is wrong: factors (E, 1), and errors [N] (T, E, 2).

    Slow sines, and white noise: without it nothing in a set says that a thrust which changes fast
    is not the force, and a linear readout's gain from one to the other may exceed one in flight.
    """
    time_s = np.arange(steps)[:, None, None] * DT_S
    factor, error = np.empty((len(seeds), 1)), np.zeros((steps, len(seeds), 2))
    for e, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, 78])
        factor[e] = rng.uniform(0.3, 1.5)
        size_n = rng.uniform(0.0, 0.3, 2) * np.sqrt(2.0 / 3.0)
        rate, phase = rng.uniform(0.5, 8.0, (3, 2)), rng.uniform(0.0, 2.0 * np.pi, (3, 2))
        error[:, e] = (size_n * np.sin(rate * time_s + phase)).sum(1)
        error[:, e] += rng.uniform(0.0, 0.15) * rng.standard_normal((steps, 2))
    return factor, error


def _ways(seeds: Sequence[int], world: World, steps: int) -> tuple[FloatArray, FloatArray]:
    """References (T, E, 6) of source and sufferer: random, smooth, planned before the flight.

    Each is a sum of three sines between the fastest rate and 2/7 of it. At 3.5 rad/s the source
    goes as far as the wake is wide while the wake sinks to the sufferer; the slower it goes, the
    more the present says of the force.
    """
    time_s = np.arange(steps) * DT_S
    source, sufferer = (np.zeros((steps, len(seeds), 6)) for _ in range(2))
    separation = np.broadcast_to(np.asarray(world.separation_m, float), (len(seeds),))
    for e, seed in enumerate(seeds):
        rng = np.random.default_rng(seed)
        sizes = (source, 0, world.sway_m), (sufferer, 0, world.sway_m), (source, 1, world.heave_m)
        for way, axis, size_m in sizes:
            rate = rng.uniform(world.turning_rad_ps / 3.5, world.turning_rad_ps, 3)
            phase = rng.uniform(0.0, 2.0 * np.pi, 3)
            share = size_m * rng.dirichlet(np.ones(3)) * math.sqrt(2.0)
            angle = rate * time_s[:, None] + phase
            way[:, e, axis] = np.sin(angle) @ share
            way[:, e, axis + 3] = np.cos(angle) @ (share * rate)
            if axis == 0:  # the pitch at which the thrust gives that acceleration
                way[:, e, 2] = np.arctan2(np.sin(angle) @ (share * rate**2), GRAVITY_MPS2)
        sufferer[:, e, 1] -= separation[e]
    for way in (source, sufferer):
        way[..., 5] = np.gradient(way[..., 2], DT_S, axis=0)
    return source, sufferer


DOMAIN = Simulated(
    main="force_z_n",
    help_text="Fly two planar multicopters one above the other in the paper's 2D wake field.",
    examples=("--out sets/downwash --minutes 30 --seed 0",),
    make=make_set,
    study_minutes=20.0,
    settings=(
        Setting(
            "spread",
            "number",
            "Draw wake speed, diffusivity and separation within this share of the paper's.",
            default=0.0,
            low=0.0,
            high=0.75,
        ),
    ),
)
