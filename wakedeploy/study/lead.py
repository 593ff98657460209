"""Study: how far ahead a force should be predicted, and what that costs and gains.

In: the gantry's and the 2D downwash simulator's sets. Out: for each lead and model the error of the
force that far ahead, on the test samples that have such a target. Also how well the sufferer keeps
to its reference on unseen flights when it compensates what is predicted.

The limits are no compensation and the true force at each lead. On the gantry the truth is the air
that is already on its way (`record(lead_oracle_s=…)`). In the 2D simulator nobody can say what the
force will be before the sufferer has flown there. But it flies there nearly the same way again, so
the oracle with a lead gets the forces that the same flight met when it was flown before. That is
repeated three times, each time with the forces of the flight before. It knows nothing before
recording begins, so that all flights there are scored from `SETTLED_S` on.
"""

import itertools
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.parallel import parallel_map
from wakedeploy.domains.downwash import RATE_HZ, Flights, fly
from wakedeploy.study.closed_loop import FIRST_SEED
from wakedeploy.study.runs import Wanted, best_run, candidates, obtained, obtained_run
from wakedeploy.study.uncertainty import FloatArray, r2_of, rmse_interval, sums, units_of

LEADS_S = (0.0, 0.03, 0.06, 0.1, 0.15, 0.25, 0.4)
QUICK_LEADS_S = (0.0, 0.1, 0.25)
EPOCHS = 30  # half the usual: there are many runs, and what is compared is the leads
DOMAINS = ("gantry", "downwash")
NOTHING, TRUTH = "no compensation", "true force"
SETTLED_S = 2.0
_PASSES = 3
_DRAWS = 2000

Tracked = tuple[float | None, ...]


@dataclass(frozen=True)
class Point:
    """One line: a model of one seed at one lead, or a limit.

    `rmse` and `sd` are those of the domain's main force [N] `lead_s` ahead over `scored` samples,
    `r2` its R², each with the bounds of a 90 % interval, None for limits. `tracking_m` has the root
    mean square distance from the reference of each flight as far as it was flown, None where it
    never was: `failsafes` counts those that ended early or never began. `seed` is None for limits,
    `lead_s` for no compensation. `hyper` says what differs from the usual hyper-parameters.
    """

    domain: str
    predictor: str
    lead_s: float | None
    seed: int | None
    tracking_m: Tracked
    failsafes: int = 0
    rmse: float | None = None
    sd: float | None = None
    scored: int | None = None
    rmse_low: float | None = None
    rmse_high: float | None = None
    r2: float | None = None
    r2_low: float | None = None
    r2_high: float | None = None
    hyper: str = ""

    @property
    def whole(self) -> bool:
        """Whether every flight was flown to its end, so that it compares with others."""
        return self.failsafes == 0 and None not in self.tracking_m


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

    The 90 % interval includes the choice: in each bootstrap draw of flights and seeds the lead is
    chosen anew, and its gain is that on the flights which were not drawn. Chosen and measured on
    the same flights, the best of many equal leads would gain on every draw. `longest` says that no
    longer lead was flown, so that the best may lie beyond. `at_zero_m` is None where flights
    without a lead ended early, and the interval as well; it alone where there is but one flight.
    """

    lead_s: float
    longest: bool
    tracking_m: float
    at_zero_m: float | None
    low_m: float | None
    high_m: float | None


def asked(
    architectures: Sequence[str], leads_s: Sequence[float], seeds: int, epochs: int | None = None
) -> list[Wanted]:
    """The lines of one domain: every architecture at every lead."""
    every = itertools.product(architectures, leads_s, range(seeds))
    return [Wanted(a, s, epochs or EPOCHS, lead_s=lead_s) for a, lead_s, s in every]


def planned(data: EpisodeSet, lines: Sequence[Wanted]) -> list[tuple[EpisodeSet, Wanted]]:
    """The runs that these lines need."""
    return [(data, candidate) for wanted in lines for candidate in candidates(wanted)]


def measure(
    data: EpisodeSet,
    main: str,
    lines: Sequence[Wanted],
    leads_s: Sequence[float],
    runs: Path,
    *,
    flights: int,
    seconds: float,
    workers: int | None = None,
    on_flown: Callable[[], None] = lambda: None,
) -> list[Point]:
    """Fly the limits and the lines of one domain, and score the lines' force `main`.

    Trains what is not trained yet. `on_flown` is called for every line.
    """
    nothing = Flight(data.domain, flights, seconds)
    flown = [nothing, *(replace(nothing, lead_s=lead_s) for lead_s in leads_s)]
    best = [best_run(data, wanted, runs) for wanted in lines]
    flown += [replace(nothing, data=data, wanted=wanted, runs=runs) for _, wanted in best]
    tracked = parallel_map(
        track, flown, workers=workers, fresh=True, on_done=lambda job, tracked: on_flown()
    )
    points = []
    for flight, kept in zip(flown, tracked, strict=True):
        wanted = flight.wanted
        if wanted is None:
            name = NOTHING if flight.lead_s is None else TRUTH
            points.append(Point(data.domain, name, flight.lead_s, None, *kept))
            continue
        point = Point(data.domain, wanted.arch, wanted.lead_s, wanted.seed, *kept)
        error = force_error(data, main, obtained(data, wanted, runs), wanted.lead_s)
        points.append(replace(point, hyper=wanted.hyper_text, **error))
    return points


def force_error(data: EpisodeSet, main: str, predictor: Any, lead_s: float) -> dict[str, Any]:
    """How the channel `main` is predicted `lead_s` ahead, by the names that `Point` has for it."""
    from trainers.training.predict import predict
    from trainers.training.tape import lay_tape

    tape = lay_tape(data, "test", lead_s, data.warm_up_steps)
    channel = [c.name for c in data.force].index(main)
    truth = tape.force[tape.scored].double().numpy()[:, channel]
    error = predict(predictor, tape)[tape.scored].double().numpy()[:, channel] - truth
    unit = units_of(data, tape.first[tape.scored].numpy(), lead_s=lead_s)
    by_unit = sums(truth, error, unit)[None]
    r2, low_high = r2_of(by_unit), rmse_interval(by_unit)
    scores: dict[str, Any] = {"rmse": float(np.sqrt(np.mean(error**2))), "sd": float(truth.std())}
    scores |= dict(zip(("rmse_low", "rmse_high"), low_high or (None, None), strict=True))
    scores |= {"r2": r2.value, "r2_low": r2.low, "r2_high": r2.high}
    return scores | {"scored": len(truth)}


def track(flight: Flight) -> tuple[Tracked, int]:
    """Root mean square distance from the reference [m] of each flight, and how many ended early.

    None for a flight that never began, which is one of those.
    """
    return _gantry(flight) if flight.domain == "gantry" else _downwash(flight)


def _gantry(flight: Flight) -> tuple[Tracked, int]:
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
    flown = [log.tracking_rmse_m("true_z_m") for log in logs]  # NaN where it never flew
    errors_m = tuple(value if math.isfinite(value) else None for value in flown)
    failed = [bool((log["mode"] == "FAILSAFE").any()) for log in logs]
    return errors_m, sum(f or value is None for f, value in zip(failed, errors_m, strict=True))


def _exported(flight: Flight, path: Path) -> Any:
    from export.packaging import export_run

    data, wanted = flight.data, flight.wanted
    if data is None or wanted is None:
        raise ValueError("there is no run to export")
    return export_run(obtained_run(data, wanted, flight.runs), data, path)


def _downwash(flight: Flight) -> tuple[Tracked, int]:
    from trainers.inspection.lockstep import Lockstep

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


def flown_before(seeds: Sequence[int], seconds: float, lead_s: float) -> Flights:
    """Flights that expect the force which the same flights met before, `lead_s` later."""
    from trainers.training.targets import shift_ahead

    longer_s = seconds + lead_s + 1.0 / RATE_HZ
    known = _Foreknown(np.zeros((0, len(seeds), 2)), 0)
    flown = fly(seeds, seconds=longer_s, expect=known)
    for _ in range(_PASSES):
        settling = known.calls - len(flown.force_n)
        known = _Foreknown(shift_ahead(flown.force_n, lead_s, RATE_HZ), settling)
        flown = fly(seeds, seconds=longer_s, expect=known)
    kept = round(seconds * RATE_HZ)
    return Flights(*(getattr(flown, name)[:kept] for name in vars(flown)))


class _Foreknown:
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


def best(points: Sequence[Point], predictor: str) -> Best | None:
    """The lead at which a predictor tracks best, over the flights and seeds of one domain.

    None where each lead has a flight that ended early: what was flown of it may be its easy part.
    """
    with_lead = [p for p in points if p.predictor == predictor and p.lead_s is not None]
    leads = sorted({p.lead_s for p in with_lead if p.lead_s is not None})
    whole = [at for at in leads if all(p.whole for p in with_lead if p.lead_s == at)]
    if not whole:
        return None
    squares = np.array([[_squares(p) for p in with_lead if p.lead_s == at] for at in whole])
    mean_m = np.sqrt(squares.mean((1, 2)))  # of (leads, seeds, flights)
    chosen = int(np.argmin(mean_m))
    found = whole[chosen], whole[chosen] == leads[-1], float(mean_m[chosen])
    if whole[0] != leads[0]:
        return Best(*found, None, None, None)
    return Best(*found, float(mean_m[0]), *_gain(squares))


def _gain(squares: FloatArray) -> tuple[float, float] | tuple[None, None]:
    """90 % interval of what the best of the leads (leads, seeds, flights) gains over the first [m].

    Seeds are drawn lead by lead: each lead's runs were trained by themselves.
    """
    leads, seeds, flights = squares.shape
    rng = np.random.default_rng(0)
    times = rng.multinomial(flights, np.full(flights, 1.0 / flights), _DRAWS)  # each is drawn
    times = times[(times == 0).any(1)]
    if len(times) == 0:
        return None, None
    drawn = rng.multinomial(seeds, np.full(seeds, 1.0 / seeds), (len(times), leads)) / seeds
    mean = np.einsum("lsf,dls->dlf", squares, drawn)  # (draws, leads, flights)
    chosen = np.argmin((mean * times[:, None]).sum(-1), axis=1)
    out = (times == 0).astype(float)
    left_m = np.sqrt((mean * out[:, None]).sum(-1) / out.sum(1, keepdims=True))  # (draws, leads)
    low_m, high_m = np.quantile(left_m[:, 0] - left_m[np.arange(len(out)), chosen], [0.05, 0.95])
    return float(low_m), float(high_m)


def _squares(point: Point) -> FloatArray:
    """Per flight, NaN for one that never began."""
    return np.asarray(np.square(np.array(point.tracking_m, dtype=float)))


def tracking(points: Sequence[Point]) -> float | None:
    """Root mean square over the flights of some points [m], those that never began left out."""
    squares = np.concatenate([_squares(p) for p in points])
    flown = squares[np.isfinite(squares)]
    return float(np.sqrt(flown.mean())) if len(flown) else None


def shares(points: Sequence[Point], predictor: str) -> Mapping[float, list[float]]:
    """A model's force error over its standard deviation, by lead: one number per seed."""
    by_lead: dict[float, list[float]] = {}
    for p in points:
        if p.predictor == predictor and p.lead_s is not None and p.rmse is not None and p.sd:
            by_lead.setdefault(p.lead_s, []).append(p.rmse / p.sd)
    return dict(sorted(by_lead.items()))


def models(points: Sequence[Point]) -> list[str]:
    """Those that were trained, in the order in which they came."""
    return list(dict.fromkeys(p.predictor for p in points if p.seed is not None))


def sentence(domain: str, points: Sequence[Point]) -> str:
    """What one domain's points say: the best lead, what it is worth, what it costs in error."""
    names = models(points)
    sentences = [_worth(best(points, name), name) for name in names]
    nothing_m = tracking([p for p in points if p.predictor == NOTHING])
    without = "was never flown" if nothing_m is None else f"leaves {1e3 * nothing_m:.1f} mm"
    limits = f"{_worth(best(points, TRUTH), f'the {TRUTH}')}; no compensation {without}"
    said = f"On {domain}, {'; '.join([*sentences, limits])}. {_costs(points, names)}"
    return f"{said} {_early(points)}".rstrip()


def _worth(found: Best | None, name: str) -> str:
    if found is None:
        return f"{name} has no lead at which every flight was flown to its end"
    if found.lead_s == 0.0:
        return f"{name} tracks best without a lead, {1e3 * found.tracking_m:.1f} mm"
    text = (
        f"{name} tracks best with {'the longest' if found.longest else 'a'} lead of "
        f"{1e3 * found.lead_s:.0f} ms, {1e3 * found.tracking_m:.1f} mm"
    )
    if found.at_zero_m is None:
        return f"{text} (without one, flights ended early)"
    text += f", {1e3 * (found.at_zero_m - found.tracking_m):.1f} mm"
    if found.low_m is not None and found.high_m is not None:
        text += f" [{1e3 * found.low_m:.1f}, {1e3 * found.high_m:.1f}]"
    return f"{text} less than without"


def _early(points: Sequence[Point]) -> str:
    """How many flights of what ended early; nothing where none did."""
    endings = []
    for name, lead_s in dict.fromkeys((p.predictor, p.lead_s) for p in points):
        alike = [p for p in points if (p.predictor, p.lead_s) == (name, lead_s)]
        ended, flown = sum(p.failsafes for p in alike), sum(len(p.tracking_m) for p in alike)
        if ended:
            at = "" if lead_s is None else f" at {1e3 * lead_s:.0f} ms"
            endings.append(f"{ended} of {flown} with {name}{at}")
    if not endings:
        return ""
    return (
        f"Flights ended early: {', '.join(endings)}; a lead with such flights is never called best."
    )


def _costs(points: Sequence[Point], names: Sequence[str]) -> str:
    """What becomes of the force errors between the least and the longest lead."""
    gone = []
    longest_s = 0.0
    for name in names:
        mean = {lead_s: float(np.mean(errors)) for lead_s, errors in shares(points, name).items()}
        longest_s = max(mean)
        gone.append(f"{name} from {mean[min(mean)]:.2f} to {mean[longest_s]:.2f}")
    if not gone:
        return "No model was trained."
    return (
        f"Up to a lead of {longest_s:g} s the force error goes, in standard deviations, for "
        f"{', '.join(gone)}."
    )
