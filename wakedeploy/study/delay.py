"""Study of delays: do models look back to when the wake was made?

In: simulated sets whose wake takes a known time to arrive. Out: Cross-Attention's weights over the
age of what it sees, and the delays that Delay Embedding chooses, beside the transport delay.

Delay Embedding's usual start, half the window, is where the downwash's nominal delay lies. Here it
is trained from near both ends of the window instead, the same for every setting: an agreement that
is found was learned. Of each seed's two runs the one counts that does better on validation.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.episodes import EpisodeSet, window_shape
from wakedeploy.domains.domain import OnStep
from wakedeploy.study.domains import predicted
from wakedeploy.study.runs import Wanted, obtained, obtained_run
from wakedeploy.study.sets import SEED, Domain
from wakedeploy.study.uncertainty import FloatArray, r2_with_interval, units_of

ATTENDING, DELAYING = "cross-attention", "delay-embedding"
TRENDS = ("delay_s", "mean_age_s")  # the quantities whose trends are reported
MINUTES, QUICK_MINUTES = 6.0, 1.5  # of each set with another delay
SEPARATIONS_M = (1.1, 1.7, 2.3, 2.9, 3.5)
WAKE_SPEEDS_MPS = (5.0, 6.0, 7.0, 9.0, 12.0)  # slower, and delays would leave the window
_DEEPER_M = 1.2  # by which the field's grid goes on below, for the farthest sufferer
START = "initial_delay_s"
START_SHARES = (2 / 15, 13 / 15)  # of the window, where training begins: beside every delay
ALIKE_S = 0.05  # ends of two starts that lie no farther apart are one
DISTANCE = "dz_m"  # the observation that says how far the wake has to sink


@dataclass(frozen=True)
class Case:
    """A set to be made, and what its delays follow from: the wake's speed, the source's lag.

    `source_lag_s` is how long the observed source takes to make the wake that its command asks for:
    0 where its thrust is observed, and not its command.
    """

    domain: Domain
    setting: str
    speed_mps: float
    source_lag_s: float = 0.0


@dataclass(frozen=True)
class Transport:
    """How long the wake is on its way over the scored test samples [s]: mean, 5 % and 95 %."""

    mean_s: float
    low_s: float
    high_s: float


@dataclass(frozen=True, eq=False)
class Attended:
    """Where Cross-Attention looks on one domain: `weights` (S, K), one row per training seed.

    `ages_s` (K,) falls to 0, the present. A row is the mean over heads and test samples and sums
    to 1.
    """

    domain: str
    ages_s: FloatArray
    weights: FloatArray
    transport: Transport
    source_lag_s: float

    @property
    def mean_weights(self) -> FloatArray:
        """Over the seeds, (K,)."""
        return np.asarray(self.weights.mean(0))

    @property
    def peak_s(self) -> float:
        """The age of the snapshot of most weight, the present one left out."""
        return float(self.ages_s[np.argmax(self.mean_weights[:-1])])

    @property
    def peaks_s(self) -> tuple[float, ...]:
        """The same of each seed, ascending."""
        return tuple(sorted(self.ages_s[self.weights[:, :-1].argmax(1)].tolist()))

    @property
    def mean_age_s(self) -> float:
        """The mean age of what is looked at, the present included."""
        return float(self.mean_weights @ self.ages_s)

    @property
    def present(self) -> float:
        """The weight of the present snapshot."""
        return float(self.mean_weights[-1])

    def as_json(self) -> dict[str, Any]:
        """The numbers about the weights; the weights are in the study's CSV file."""
        numbers: dict[str, Any] = {"domain": self.domain, "transport": asdict(self.transport)}
        numbers |= {"source_lag_s": self.source_lag_s, "present": self.present}
        numbers |= {"peak_s": self.peak_s, "peaks_s": [*self.peaks_s]}
        return numbers | {"mean_age_s": self.mean_age_s}


@dataclass(frozen=True)
class Learned:
    """The delays of one trained Delay Embedding over the test samples, seconds.

    `start_s` is μ₀, where training began, `validation` the least loss on validation. `delay_s` and
    `spread_s` are mean and standard deviation of the kernel's centre μ, `width_s` is its mean σ,
    `mean_age_s` the mean age of what it weighs. `outside` is the share of samples whose μ lies
    outside the window: there the kernel weighs the window's end. `r2` is that of the domain's main
    channel; `r2_low` and `r2_high` bound its 90 % interval.
    """

    domain: str
    setting: str
    seed: int
    start_s: float
    validation: float
    transport: Transport
    source_lag_s: float
    delay_s: float
    spread_s: float
    width_s: float
    mean_age_s: float
    outside: float
    r2: float
    r2_low: float | None
    r2_high: float | None


@dataclass(frozen=True)
class Trend:
    """The slope of learned over physical delays, and by how much they are longer on average."""

    slope: float
    off_s: float


def nominal(name: str, domain: Domain) -> Case:
    """A simulated domain as the other studies have it."""
    from wakedeploy.domains.downwash import World
    from wakedeploy.rig.file import default_rig

    if name == "gantry":
        rig = default_rig()
        return Case(domain, "as it is", rig.wake.speed_mps, source_lag_s(rig))
    return Case(domain, "as it is", float(np.asarray(World().speed_mps)))


def cases(*, quick: bool) -> list[Case]:
    """The sets with other delays: separations of the downwash, wake speeds of the gantry."""
    from wakedeploy.domains.downwash import World
    from wakedeploy.rig.file import default_rig

    speed_mps, lag_s = float(np.asarray(World().speed_mps)), source_lag_s(default_rig())
    found = []
    for separation_m in _chosen(SEPARATIONS_M, quick):
        domain = _domain("downwash", f"{separation_m:g}m", _Downwash(separation_m))
        found.append(Case(domain, f"{separation_m:g} m apart", speed_mps))
    for speed in _chosen(WAKE_SPEEDS_MPS, quick):
        domain = _domain("gantry", f"{speed:g}mps", _Gantry(speed))
        found.append(Case(domain, f"wake at {speed:g} m/s", speed, lag_s))
    return found


def source_lag_s(rig: Any) -> float:
    """How long a command of the source takes to become thrust on average: way, frame, spool [s]."""
    lag = rig.spool.source
    way_s = 0.5 * (rig.latency.round_trip_s + rig.disturbance.esc_frame_s)
    return float(way_s + 0.5 * (lag.up_s + lag.down_s))


def transport(data: EpisodeSet, speed_mps: float) -> Transport:
    """What the heights flown in the test episodes and the wake's speed make of the delay."""
    column = [channel.name for channel in data.observation].index(DISTANCE)
    warm = data.warm_up_steps
    flown = [e.observation[warm:, column] for e in data.part("test") if len(e) > warm]
    delays_s = np.concatenate(flown).astype(float) / speed_mps
    low_s, high_s = np.quantile(delays_s, [0.05, 0.95])
    return Transport(float(delays_s.mean()), float(low_s), float(high_s))


def attended(
    case: Case, data: EpisodeSet, seeds: int, runs: Path, epochs: int | None = None
) -> Attended:
    """Cross-Attention's weights on a set, each seed's; trains what is not trained yet."""
    from trainers.inspection.lookback import attention
    from trainers.training.tape import lay_tape

    tape = lay_tape(data, "test", 0.0, data.warm_up_steps)
    k, stride = window_shape(data.window_s, data.rate_hz)
    weights = [
        attention(obtained(data, wanted, runs), tape).mean(1)
        for wanted in planned(ATTENDING, seeds, epochs)
    ]
    return Attended(
        data.domain,
        np.arange(k - 1, -1, -1, dtype=float) * (stride / data.rate_hz),
        np.array(weights),
        transport(data, case.speed_mps),
        case.source_lag_s,
    )


def learned(
    case: Case, data: EpisodeSet, seeds: int, runs: Path, epochs: int | None = None
) -> list[Learned]:
    """Delay Embedding's delays on a set, by seed and start; trains what is not trained yet."""
    from trainers.inspection.lookback import kernels
    from trainers.training.tape import lay_tape

    tape = lay_tape(data, "test", 0.0, data.warm_up_steps)
    channel = [c.name for c in data.force].index(case.domain.main)
    lines = []
    for wanted in planned_delays(data, seeds, epochs):
        run = obtained_run(data, wanted, runs)
        predictor = run.predictor
        chosen = kernels(predictor, tape)
        outside = (chosen.delay_s < 0.0) | (chosen.delay_s > data.window_s)
        truth, forces, episode = predicted(predictor, data)
        error = (forces - truth)[:, channel]
        r2 = r2_with_interval(truth[:, channel], error, units_of(data, episode))
        lines.append(
            Learned(
                data.domain,
                case.setting,
                wanted.seed,
                float(wanted.hyper[START]),
                min(run.metrics.history),
                transport(data, case.speed_mps),
                case.source_lag_s,
                float(chosen.delay_s.mean()),
                float(chosen.delay_s.std()),
                float(chosen.width_s.mean()),
                float(chosen.mean_age_s.mean()),
                float(outside.mean()),
                *(r2.value, r2.low, r2.high),
            )
        )
    return lines


def planned(arch: str, seeds: int, epochs: int | None) -> list[Wanted]:
    """The runs of one architecture on one set."""
    return [Wanted(arch, seed, epochs) for seed in range(seeds)]


def planned_delays(data: EpisodeSet, seeds: int, epochs: int | None) -> list[Wanted]:
    """The runs of Delay Embedding on one set: every seed from every start."""
    return [
        Wanted(DELAYING, seed, epochs, hyper={START: round(share * data.window_s, 3)})
        for seed in range(seeds)
        for share in START_SHARES
    ]


def by_run(lines: Sequence[Learned]) -> list[list[Learned]]:
    """Lines of the same domain, setting and seed together, which differ in their start."""
    found: dict[tuple[str, str, int], list[Learned]] = {}
    for line in lines:
        found.setdefault((line.domain, line.setting, line.seed), []).append(line)
    return list(found.values())


def best(lines: Sequence[Learned]) -> list[Learned]:
    """The start of each setting and seed that does best on validation."""
    return [min(starts, key=lambda line: line.validation) for starts in by_run(lines)]


def trend(lines: Sequence[Learned], of: str = "delay_s") -> Trend:
    """Least squares of `delay_s` or `mean_age_s` over the transport delay.

    The slope is NaN where all transport delays are alike.
    """
    physical = np.array([line.transport.mean_s for line in lines])
    learned = np.array([getattr(line, of) for line in lines])
    centred = physical - physical.mean()
    spread = float(centred @ centred)
    slope = float(centred @ learned) / spread if spread > 0.0 else float("nan")
    return Trend(slope, float(np.mean(learned - physical)))


@dataclass(frozen=True)
class _Downwash:
    """Makes the downwash's set with another separation."""

    separation_m: float

    def __call__(self, minutes: float, progress: OnStep) -> EpisodeSet:
        from wakedeploy.domains.downwash import World, make_set

        world = World(separation_m=self.separation_m)
        rows = round(_DEEPER_M / world.grid.cell_z_m)
        bottom_m = world.grid.bottom_m - rows * world.grid.cell_z_m
        grid = replace(world.grid, bottom_m=bottom_m, rows=world.grid.rows + rows)
        world = replace(world, grid=grid)
        return make_set(minutes=minutes, seed=SEED, world=world, progress=progress)


@dataclass(frozen=True)
class _Gantry:
    """Makes the gantry's set with another wake speed.

    Injection goes with the speed: the air, and with it the force, stays as fast as it was.
    """

    speed_mps: float

    def __call__(self, minutes: float, progress: OnStep) -> EpisodeSet:
        from wakedeploy.domains.gantry import make_set
        from wakedeploy.rig.file import default_rig

        rig = default_rig()
        strength = rig.wake.strength * self.speed_mps / rig.wake.speed_mps
        rig = rig.changed(wake={"speed_mps": self.speed_mps, "strength": strength})
        return make_set(rig, minutes=minutes, seed=SEED, progress=progress)


def _chosen(values: tuple[float, ...], quick: bool) -> tuple[float, ...]:
    """For a quick look the second and the fourth of five."""
    return values[1::2] if quick else values


def _domain(of: str, setting: str, make: Any) -> Domain:
    return Domain(
        f"{of}-{setting}",
        "force_z_n",
        MINUTES,
        QUICK_MINUTES,
        make=make,
        module=f"wakedeploy.domains.{of}",
        settings=f"{make} {_DEEPER_M}",
    )
