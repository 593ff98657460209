"""Study: how far ahead a force should be predicted, and what that costs and gains.

In: the gantry's and the 2D downwash simulator's sets. Out: for each lead and model the error of the
force that far ahead on the test samples that have such a target, and how well the sufferer keeps to
its reference on unseen flights when it compensates what is predicted.

The limits are no compensation and the true force at each lead. On the gantry the truth is the air
that is already on its way (`record(lead_oracle_s=…)`). In the 2D simulator nobody can say what the
force will be before the sufferer has flown there; but it flies there nearly the same way again: the
oracle with a lead is told the forces that the same flight met when it was flown before, three times
over, each with what the one before met. It knows nothing before recording begins, so that all
flights there are scored from `SETTLED_S` on.
"""

import itertools
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.domains.downwash import RATE_HZ, Flights, World, fly
from wakedeploy.episodes import EpisodeSet
from wakedeploy.study.closed_loop import FIRST_SEED
from wakedeploy.study.runs import Wanted, obtained
from wakedeploy.study.side_by_side import side_by_side
from wakedeploy.study.uncertainty import FloatArray

LEADS_S = (0.0, 0.03, 0.06, 0.1, 0.15, 0.25, 0.4)
QUICK_LEADS_S = (0.0, 0.1, 0.25)
EPOCHS = 30  # half the usual: there are many runs, and what is compared is the leads
DOMAINS = ("gantry", "downwash")
NOTHING, TRUTH = "no compensation", "true force"
SETTLED_S = 2.0
_PASSES = 3
_DRAWS = 2000


@dataclass(frozen=True)
class Point:
    """One line: a model of one seed at one lead, or a limit.

    `rmse` and `sd` are those of the domain's main force [N] `lead_s` ahead over `scored` samples,
    None for limits. `tracking_m` has the root mean square distance from the reference of each
    flight, as far as it was flown: `failsafes` counts those that ended early. `seed` is None for
    limits, `lead_s` for no compensation.
    """

    domain: str
    predictor: str
    lead_s: float | None
    seed: int | None
    tracking_m: tuple[float, ...]
    failsafes: int = 0
    rmse: float | None = None
    sd: float | None = None
    scored: int | None = None


@dataclass(frozen=True, eq=False)
class Flight:
    """What to fly, all that a process needs: nothing, the truth at a lead, or a trained run."""

    domain: str
    flights: int
    seconds: float
    lead_s: float | None = None
    data: EpisodeSet | None = None
    wanted: Wanted | None = None
    runs: Path = field(default_factory=Path)


@dataclass(frozen=True)
class Best:
    """The lead with the least tracking error, and what it gains over lead 0 [m].

    The 90 % interval is over the flights, which are drawn in pairs. `longest` says that no longer
    lead was flown, so that the best may lie beyond.
    """

    lead_s: float
    longest: bool
    tracking_m: float
    at_zero_m: float
    low_m: float
    high_m: float


def planned(
    data: EpisodeSet,
    architectures: Sequence[str],
    leads_s: Sequence[float],
    seeds: int,
    epochs: int | None = None,
) -> list[tuple[EpisodeSet, Wanted]]:
    """The runs of one domain: every architecture at every lead."""
    asked = itertools.product(architectures, leads_s, range(seeds))
    return [(data, Wanted(a, s, epochs or EPOCHS, lead_s=lead_s)) for a, lead_s, s in asked]


def measure(
    data: EpisodeSet,
    main: str,
    jobs: Sequence[tuple[EpisodeSet, Wanted]],
    leads_s: Sequence[float],
    runs: Path,
    *,
    flights: int,
    seconds: float,
    workers: int | None = None,
    on_flown: Callable[[], None] = lambda: None,
) -> list[Point]:
    """Fly the limits and the planned runs of one domain, and score the runs' force `main`.

    Trains what is not trained yet. `on_flown` is called for every line.
    """
    nothing = Flight(data.domain, flights, seconds)
    flown = [nothing, *(replace(nothing, lead_s=lead_s) for lead_s in leads_s)]
    flown += [replace(nothing, data=data, wanted=wanted, runs=runs) for _, wanted in jobs]
    tracked = side_by_side(track, flown, workers=workers, on_done=on_flown)
    points = []
    for flight, kept in zip(flown, tracked, strict=True):
        wanted = flight.wanted
        if wanted is None:
            name = NOTHING if flight.lead_s is None else TRUTH
            points.append(Point(data.domain, name, flight.lead_s, None, *kept))
            continue
        rmse, sd, scored = force_error(data, main, obtained(data, wanted, runs), wanted.lead_s)
        point = Point(data.domain, wanted.arch, wanted.lead_s, wanted.seed, *kept)
        points.append(replace(point, rmse=rmse, sd=sd, scored=scored))
    return points


def force_error(
    data: EpisodeSet, main: str, predictor: Any, lead_s: float
) -> tuple[float, float, int]:
    """RMSE and standard deviation of the channel `main` `lead_s` ahead, and how many samples."""
    from trainers.predict import predict
    from trainers.tape import lay_tape

    tape = lay_tape(data, "test", lead_s, data.warm_up_steps)
    channel = [c.name for c in data.force].index(main)
    truth = tape.force[tape.scored].double().numpy()[:, channel]
    error = predict(predictor, tape)[tape.scored].double().numpy()[:, channel] - truth
    return float(np.sqrt(np.mean(error**2))), float(truth.std()), len(truth)


def track(flight: Flight) -> tuple[tuple[float, ...], int]:
    """Root mean square distance from the reference [m] of each flight, and how many ended early."""
    return _gantry(flight) if flight.domain == "gantry" else _downwash(flight)


def _gantry(flight: Flight) -> tuple[tuple[float, ...], int]:
    """The rig's own loop on the default rig, with the run exported as it would be deployed."""
    from wakedeploy.domains.gantry import record

    with tempfile.TemporaryDirectory() as folder:
        package = (
            None if flight.wanted is None else _exported(flight, Path(folder) / "package.onnx")
        )
        logs = [
            record(
                None,
                seconds=flight.seconds,
                seed=FIRST_SEED + number,
                package=package,
                lead_oracle_s=flight.lead_s,
            )
            for number in range(flight.flights)
        ]
    ended = sum(bool((log["mode"] == "FAILSAFE").any()) for log in logs)
    return tuple(log.tracking_rmse_m("true_z_m") for log in logs), ended


def _exported(flight: Flight, path: Path) -> Any:
    from export.packaging import export_run
    from trainers.runs import load_run

    data, wanted = flight.data, flight.wanted
    if data is None or wanted is None:
        raise ValueError("there is no run to export")
    obtained(data, wanted, flight.runs)
    folder = wanted.folder(data, flight.runs) / data.domain / wanted.arch / f"s{wanted.seed}"
    return export_run(load_run(folder), data, path)


def _downwash(flight: Flight) -> tuple[tuple[float, ...], int]:
    from trainers.lockstep import Lockstep

    seconds = flight.seconds + SETTLED_S
    seeds = [FIRST_SEED + i for i in range(flight.flights)]
    if flight.wanted is not None and flight.data is not None:
        predictor = obtained(flight.data, flight.wanted, flight.runs)
        flown = fly(seeds, seconds=seconds, expect=Lockstep(predictor))
    elif flight.lead_s is not None:
        flown = flown_before(seeds, seconds, flight.lead_s)
    else:
        flown = fly(seeds, seconds=seconds)
    settled = flown.error_m[round(SETTLED_S * RATE_HZ) :]
    return tuple(np.sqrt((settled**2).sum(-1).mean(0)).tolist()), 0


def flown_before(
    seeds: Sequence[int], seconds: float, lead_s: float, *, world: World | None = None
) -> Flights:
    """Flights that expect the force which the same flights met before, `lead_s` later."""
    from trainers.targets import shift_ahead

    longer_s = seconds + lead_s + 1.0 / RATE_HZ
    told = _Told(np.zeros((0, len(seeds), 2)), 0)
    flown = fly(seeds, world=world, seconds=longer_s, expect=told)
    for _ in range(_PASSES):
        settling = told.calls - len(flown.force_n)
        told = _Told(shift_ahead(flown.force_n, lead_s, RATE_HZ), settling)
        flown = fly(seeds, world=world, seconds=longer_s, expect=told)
    kept = round(seconds * RATE_HZ)
    return Flights(*(getattr(flown, name)[:kept] for name in vars(flown)))


class _Told:
    """Expects forces (T, E, 2) one after the other from call `first` on, and nothing else."""

    def __init__(self, force_n: FloatArray, first: int) -> None:
        self._force_n, self._first = force_n, first
        self.calls = 0

    def __call__(self, observation: FloatArray) -> FloatArray:
        at = self.calls - self._first
        self.calls += 1
        if 0 <= at < len(self._force_n):
            return np.asarray(self._force_n[at])
        return np.zeros((len(observation), 2))


def best(points: Sequence[Point], predictor: str) -> Best:
    """The lead at which a predictor tracks best, over the flights and seeds of one domain."""
    own = [p for p in points if p.predictor == predictor and p.lead_s is not None]
    squares = {
        lead_s: np.mean([np.square(p.tracking_m) for p in own if p.lead_s == lead_s], axis=0)
        for lead_s in sorted({p.lead_s for p in own if p.lead_s is not None})
    }  # (flights,) each
    chosen = min(squares, key=lambda lead_s: float(squares[lead_s].mean()))
    zero = squares[min(squares)]
    drawn = np.random.default_rng(0).integers(0, len(zero), (_DRAWS, len(zero)))
    gains = np.sqrt(zero[drawn].mean(-1)) - np.sqrt(squares[chosen][drawn].mean(-1))
    low_m, high_m = np.quantile(gains, [0.05, 0.95])
    return Best(
        chosen,
        chosen == max(squares),
        float(np.sqrt(squares[chosen].mean())),
        float(np.sqrt(zero.mean())),
        float(low_m),
        float(high_m),
    )


def tracking(points: Sequence[Point]) -> float:
    """Root mean square over the flights of some points [m]."""
    return float(np.sqrt(np.mean([np.square(p.tracking_m) for p in points])))


def shares(points: Sequence[Point], predictor: str) -> Mapping[float, list[float]]:
    """A model's force error over its standard deviation, by lead: one number per seed."""
    told: dict[float, list[float]] = {}
    for p in points:
        if p.predictor == predictor and p.lead_s is not None and p.rmse is not None and p.sd:
            told.setdefault(p.lead_s, []).append(p.rmse / p.sd)
    return dict(sorted(told.items()))


def models(points: Sequence[Point]) -> list[str]:
    """Those that were trained, in the order in which they came."""
    return list(dict.fromkeys(p.predictor for p in points if p.seed is not None))


def sentence(domain: str, points: Sequence[Point]) -> str:
    """What one domain's points say: the best lead, what it is worth, what it costs in error."""
    names = models(points)
    told = [_worth(best(points, name), name) for name in names]
    nothing_m = tracking([p for p in points if p.predictor == NOTHING])
    limits = (
        f"{_worth(best(points, TRUTH), f'the {TRUTH}')}; no compensation leaves "
        f"{1e3 * nothing_m:.1f} mm"
    )
    return f"On {domain}, {'; '.join([*told, limits])}. {_costs(points, names)}"


def _worth(found: Best, name: str) -> str:
    if found.lead_s == 0.0:
        return f"{name} tracks best without a lead, {1e3 * found.tracking_m:.1f} mm"
    gain_m = found.at_zero_m - found.tracking_m
    return (
        f"{name} tracks best with {'the longest' if found.longest else 'a'} lead of "
        f"{1e3 * found.lead_s:.0f} ms, "
        f"{1e3 * found.tracking_m:.1f} mm, {1e3 * gain_m:.1f} mm "
        f"[{1e3 * found.low_m:.1f}, {1e3 * found.high_m:.1f}] less than without"
    )


def _costs(points: Sequence[Point], names: Sequence[str]) -> str:
    """What becomes of the force errors between the least and the longest lead."""
    gone = []
    longest_s = 0.0
    for name in names:
        mean = {lead_s: float(np.mean(own)) for lead_s, own in shares(points, name).items()}
        longest_s = max(mean)
        gone.append(f"{name} from {mean[min(mean)]:.2f} to {mean[longest_s]:.2f}")
    if not gone:
        return "No model was trained."
    return (
        f"Up to a lead of {longest_s:g} s the force error goes, in standard deviations, for "
        f"{', '.join(gone)}."
    )
