"""A run log as the gap workflow sees it: what was commanded, and what was read, on one clock.

In: run logs (MCAP or CSV) and the rig. Out: `Flight`s: the MCU's outputs as lines over time, the
servo frames, the carriage's path, the range samples with their own times, and which stretches are
airborne. Columns `true_*` are dropped on reading.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr, ndtri

from runtime.simulated import COMPUTE_S
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import sha256_of
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog, read_run_log
from wakedeploy.core.runlog_columns import FLYING
from wakedeploy.gap.systems.gantry.artefacts import Unflown
from wakedeploy.gap.systems.gantry.plausibility import require_plausible, told_of_columns
from wakedeploy.gap.systems.gantry.servo_frames import Frames, frames_of
from wakedeploy.gap.wording import counted
from wakedeploy.physics.effects.acting import TAKEN_OFF
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.physics.series import filtered, smoothed, spooled_thrust

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

GRID_HZ = 128.0
DT_S = 1.0 / GRID_HZ
AIRBORNE_M = 0.06  # height above the stop; more than range noise
BELOW_TOP_M = 0.02
SETTLING_S = 0.3  # of each stretch, in which the filter finds its speed
SHORTEST_S = 4.0  # of airborne time; a shorter flight says nothing
_SHORTEST_STRETCH_S = 1.5
_FEWEST_TICKS = 32  # of a log that may hold a flight
_LONGEST_GAP_S = 0.5
_GAP_S = 0.1  # between samples
_TOLD_GAP_S = 0.125  # between ticks: bridged, and reported
_FREE_WHITE = 2.0  # [(m/s²)²·s] for a first look at the motion without knowing any force
_CUT_OFF_SHARE = 0.9  # of readings at rest that are one value: their mean cannot be known
_ZERO_M = 0.0005  # a smaller reading is zero
_NOISE_KNOWN = 0.3  # the share to which a rig file knows the noise at rest
_REST_SD_M = 0.0015  # quantisation and the sensor's own zero at the stop
_CARRIAGE_MOVED_M = 0.02
_TAKE_OFF_LIMIT_S, _FINE_S = 2.0, 0.002
_IDLE_US = 20.0  # above the idle pulse, from which a motor turns
_AT_REST = ("ARMED", "DISARMED")
OUTLIER = np.array([0.01, 0.1**2])  # probability, and variance [m²], of a stray reading


@dataclass(frozen=True, eq=False)
class Line:
    """A quantity that is linear between points: the MCU's output for one motor."""

    t_s: FloatArray
    value: FloatArray

    def at(self, t_s: FloatArray) -> FloatArray:
        """The value at these times; the ends are held."""
        return np.asarray(np.interp(t_s, self.t_s, self.value))


@dataclass(frozen=True, eq=False)
class Flight:
    """One flight on a grid of N steps of `DT_S`, with n range samples.

    `grid_s` (N,) are the steps' starts. `frame_s` (F,) are the times at which the ESCs take a new
    pulse by the rig file, `reported_frame_s` (G,) by the log if it says otherwise. `start`, `stop`
    (S,) bound the airborne stretches, in steps. `nominal` (2, N) is the height [m] and speed [m/s]
    smoothed from the readings. `rest` (r, 4) are the readings at rest on the stop: each period's
    mean, variance, time, and 1 if the mean is only known to be at most that.
    """

    name: str
    grid_s: FloatArray
    source: Line
    sufferer: Line
    frame_s: FloatArray
    x_m: FloatArray
    vx_mps: FloatArray
    sample_s: FloatArray
    reading_m: FloatArray
    start: IntArray
    stop: IntArray
    nominal: FloatArray
    rest: FloatArray
    take_off_s: float
    resolution_m: float
    sha256: str = ""
    notes: tuple[str, ...] = ()
    references: FloatArray | None = None  # (3, n) height, carriage, source command, at the samples
    reported_frame_s: FloatArray | None = None
    seed: int | None = None  # of the plan that it flew, if the log says it
    simulated: bool = False

    @functools.cached_property
    def counted(self) -> npt.NDArray[np.bool_]:
        """Which samples (n,) are airborne and past the filter's settling."""
        after = self.sample_s[:, None] - self.grid_s[self.start][None, :]
        before = self.grid_s[self.stop - 1][None, :] - self.sample_s[:, None]
        return np.asarray(((after > SETTLING_S) & (before > 0.05)).any(axis=1))

    @functools.cached_property
    def repeated(self) -> npt.NDArray[np.bool_]:
        """Which readings (n,) equal the one before them."""
        return np.append(False, np.diff(self.reading_m) == 0.0)

    @functools.cached_property
    def repeated_share(self) -> float:
        """How many of the counted readings equal the one before them."""
        return float(self.repeated[self.counted].mean())

    @functools.cached_property
    def spacing_s(self) -> float:
        """Mean time between fresh samples [s], without the gaps."""
        between = np.diff(self.sample_s)
        return float(between[between < _GAP_S].mean())

    @property
    def airborne_s(self) -> float:
        """Total time in the air [s]."""
        return float((self.stop - self.start).sum() * DT_S)


class NotFlown(UnusableInput):
    """A log of the rig that holds no flight, or too short a one.

    `why` says it without the log's name; `seed` is that of a simulated flight.
    """

    def __init__(self, sentence: str, why: str = "", seed: int | None = None) -> None:
        super().__init__(sentence)
        self.why, self.seed = why, seed


def usable_flights(paths: Sequence[Path], rig: Rig) -> tuple[list[Flight], list[Unflown]]:
    """The flights in the given order, and the logs that hold none, each with the reason.

    A motor test or a start that failed says nothing of the wake, and should not cost the flights
    beside it. UnusableInput if no log holds a flight, or one cannot be used for another reason.
    """
    flights: list[Flight] = []
    unflown: list[Unflown] = []
    for path in _given(paths):
        try:
            flights.append(_read_flight(path, rig))
        except NotFlown as error:
            unflown.append(Unflown(path=str(path), why=error.why, seed=error.seed))
    if not flights:
        first = f"{unflown[0].path}: {unflown[0].why}"
        others = len(unflown) - 1
        more = f", and {counted(others, 'other log')} no flight either" if others else ""
        raise UnusableInput(f"{first}{more}.")
    _require_each_once(flights)
    return flights, unflown


def read_flights(paths: Sequence[Path], rig: Rig) -> list[Flight]:
    """Read logs in the given order; UnusableInput for one that cannot be used, saying why."""
    flights = [_read_flight(path, rig) for path in _given(paths)]
    _require_each_once(flights)
    return flights


def _given(paths: Sequence[Path]) -> Sequence[Path]:
    if not paths:
        raise UnusableInput("No logs given: --measured needs at least one run log.")
    return paths


def _read_flight(path: Path, rig: Rig) -> Flight:
    log = read_run_log(path).without_truth()
    _require_same_rig(log, rig, str(path))
    return flight_from_log(log, rig, str(path), sha256_of(Path(path).read_bytes()))


def _require_each_once(flights: Sequence[Flight]) -> None:
    twice = {f.sha256 for f in flights if sum(g.sha256 == f.sha256 for g in flights) > 1}
    if twice:
        names = ", ".join(f.name for f in flights if f.sha256 in twice)
        raise UnusableInput(f"{names}: the same recording more than once; give each flight once.")


def flight_from_log(log: RunLog, rig: Rig, name: str, sha256: str = "") -> Flight:
    """One log on the grid.

    Raises NotFlown for one that is too short, UnusableInput for one still or broken in time.
    """
    t_s = np.asarray(log["t_s"], float)
    if len(t_s) <= _FEWEST_TICKS:
        ticks = counted(len(t_s), "tick")
        raise _not_flown(name, log, f"it has only {ticks}, where a flight has a thousand")
    notes = _checked_clock(t_s, name)
    flying = np.isin(log["mode"], FLYING)
    if flying.sum() < 2:
        raise _not_flown(name, log, "it never flew (no tick is RUNNING or DEGRADED)")
    for column in ("steps", "source_cmd_us", "sufferer_cmd_us"):
        if not np.isfinite(log[column][flying]).any():
            raise UnusableInput(f"{name}: {column} is empty; nothing can be simulated without it.")
    require_plausible(log, rig, name, flying)
    begin_s, end_s = t_s[0], t_s[-1]
    grid_s = begin_s + DT_S * np.arange(int((end_s - begin_s) * GRID_HZ))
    sample_s, reading_m, fresh = _samples(log, name)
    nominal = _free_motion(grid_s, sample_s, reading_m)
    start, stop = _stretches(rig, grid_s, nominal, t_s[flying])
    arrivals_s = t_s + COMPUTE_S + 0.5 * rig.latency.round_trip_s
    x_m, vx_mps = _carriage(log, rig, t_s, arrivals_s, grid_s)
    frames = frames_of(log, rig, grid_s)
    sufferer = _mcu_output(arrivals_s, log["sufferer_cmd_us"], rig)
    flight = Flight(
        name=name,
        grid_s=grid_s,
        source=_mcu_output(arrivals_s, log["source_cmd_us"], rig),
        sufferer=sufferer,
        frame_s=frames.stated_s,
        x_m=x_m,
        vx_mps=vx_mps,
        sample_s=sample_s,
        reading_m=reading_m,
        start=start,
        stop=stop,
        nominal=nominal,
        rest=_rests(log, t_s, flying, sample_s, reading_m, rig.range_sensor.noise_m),
        take_off_s=_take_off_s(sufferer, frames.stated_s, rig, float(t_s[flying][0])),
        resolution_m=max(rig.range_sensor.resolution_m, 1e-4),
        sha256=sha256,
        notes=(*notes, *_doubts(log, rig, frames, x_m, flying)),
        references=_references(log, fresh),
        reported_frame_s=frames.reported_s,
        seed=_seed(log.metadata),
        simulated=log.metadata.get("simulated") == "true",
    )
    _require_content(flight, log, flying)
    return flight


def _take_off_s(sufferer: Line, frame_s: FloatArray, rig: Rig, begins_s: float) -> float:
    """When the thrust reaches half the weight, as in the plant: `Motion.time_s` counts from then.

    The first tick in flight is a tenth of a second earlier: a third of a fast sine's period.
    """
    fine_s = np.arange(begins_s, begins_s + _TAKE_OFF_LIMIT_S, _FINE_S)
    taken = np.maximum(np.searchsorted(frame_s, fine_s, side="right") - 1, 0)
    curve, lag = rig.thrust.sufferer, rig.spool.sufferer
    target = np.sqrt(curve.thrusts(sufferer.at(frame_s[taken])))
    thrust_n = spooled_thrust(target, lag.up_s, lag.down_s, _FINE_S)
    lifts = thrust_n >= TAKEN_OFF * rig.sufferer.mass_kg * GRAVITY_MPS2
    return float(fine_s[np.argmax(lifts)])


def _seed(metadata: Mapping[str, str]) -> int | None:
    stated = metadata.get("seed", "")
    return int(stated) if stated.isdecimal() else None


def _require_same_rig(log: RunLog, rig: Rig, name: str) -> None:
    """Refuse a log of another rig; what only the model knows, such as effects, may differ."""
    stated = log.metadata.get("rig_sha256")
    if stated is None or stated == rig.sha256:
        return
    from wakedeploy.rig.file import parse_rig  # the text is in the log; compare what cannot differ

    text = log.metadata.get("rig_toml")
    if text is None:
        raise UnusableInput(
            f"{name}: flown with another rig file ({stated[:12]}… instead of {rig.sha256[:12]}…)."
        )
    flown = parse_rig(text, f"{name} (the rig in its metadata)")
    for section in ("source", "sufferer", "thrust", "stepper", "range_sensor", "latency", "limits"):
        if getattr(flown, section) != getattr(rig, section):
            raise UnusableInput(
                f"{name}: flown with another rig: [{section}] in its metadata differs from the "
                "rig file given; use the rig file of that flight, or a corrected copy of it."
            )


def _checked_clock(t_s: FloatArray, name: str) -> tuple[str, ...]:
    steps = np.diff(t_s)
    worst = float(steps.max())
    if worst > _LONGEST_GAP_S:
        at = t_s[int(steps.argmax())]
        raise UnusableInput(
            f"{name}: the clock jumps by {worst:.2f} s after t_s = {at:.2f} s; cut the log there "
            "or leave it out."
        )
    if worst > _TOLD_GAP_S:
        return (f"a gap of {1e3 * worst:.0f} ms between ticks was bridged",)
    return ()


def _samples(log: RunLog, name: str) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Times and readings of the fresh samples, in order of time, and which ticks they came with."""
    range_m, age_s = log["range_m"], log["range_age_s"]
    fresh = np.isfinite(range_m) & np.isfinite(age_s) & ~(log["range_repeats"] > 0)
    taken_s = np.asarray(log["t_s"] - age_s, float)
    rising = np.zeros(len(fresh), bool)
    latest = -np.inf
    for i in np.flatnonzero(fresh):
        rising[i] = taken_s[i] > latest + 1e-4
        latest = max(latest, taken_s[i])
    fresh = fresh & rising
    if fresh.sum() < 100:
        raise UnusableInput(
            f"{name}: only {int(fresh.sum())} fresh range samples; too few to compare with."
        )
    return taken_s[fresh], np.asarray(range_m[fresh], float), fresh


def _free_motion(grid_s: FloatArray, sample_s: FloatArray, reading_m: FloatArray) -> FloatArray:
    """Height and speed (2, N) from the readings alone, whatever the forces were."""
    count = len(grid_s)
    step_of, into_s = placed(grid_s, sample_s)
    whole = np.array([0]), np.array([count])
    nominal = np.zeros((2, count))
    nominal[0, 0] = float(np.median(reading_m[:5]))
    still, none = np.zeros((3, count)), np.zeros(count)
    # It is linear, so any nominal path will do; the expected reading is the nominal height itself.
    expected = np.stack([nominal[0, step_of], np.ones(len(step_of))])
    noise = np.full(len(step_of), 0.005**2)
    _, _, states, covariances = filtered(
        DT_S,
        *whole,
        nominal,
        still,
        none,
        0.9,
        _FREE_WHITE,
        step_of,
        into_s,
        reading_m,
        expected,
        noise,
        OUTLIER,
        np.zeros(0, np.int64),
        True,
    )
    path = smoothed(DT_S, *whole, states, covariances, nominal, still, none, 0.9, _FREE_WHITE)
    return np.asarray(path[:2])


def placed(grid_s: FloatArray, sample_s: FloatArray) -> tuple[IntArray, FloatArray]:
    """The step in which each sample was taken, and how far into it [s]."""
    step = np.clip(np.floor((sample_s - grid_s[0]) * GRID_HZ + 1e-9), 0, len(grid_s) - 1)
    step = step.astype(np.int64)
    return step, np.asarray(sample_s - grid_s[step])


def _stretches(
    rig: Rig, grid_s: FloatArray, nominal: FloatArray, flying_s: FloatArray
) -> tuple[IntArray, IntArray]:
    """First step, and one past the last, of each stretch in the air, away from both stops."""
    top = rig.sufferer.travel_m - BELOW_TOP_M
    free = (nominal[0] > AIRBORNE_M) & (nominal[0] < top)
    free &= (grid_s > flying_s[0]) & (grid_s < flying_s[-1])
    edges = np.diff(np.concatenate([[0], free.astype(np.int8), [0]]))
    start, stop = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    long = (stop - start) * DT_S >= _SHORTEST_STRETCH_S
    return start[long].astype(np.int64), stop[long].astype(np.int64)


def _mcu_output(arrivals_s: FloatArray, command_us: FloatArray, rig: Rig) -> Line:
    """What the MCU puts out: it moves to each command at the slew limit."""
    low, high = rig.limits.pulse_us
    slew = rig.limits.slew_us_per_s
    times, values = [arrivals_s[0] - 1.0], [low]
    now = low
    for i, (t, target) in enumerate(zip(arrivals_s, command_us, strict=True)):
        wanted = now if np.isnan(target) else min(max(float(target), low), high)
        reach_s = abs(wanted - now) / slew
        until_s = arrivals_s[i + 1] - t if i + 1 < len(arrivals_s) else 1.0
        share = min(1.0, until_s / reach_s) if reach_s > 0.0 else 1.0
        times += [t, t + share * max(reach_s, 1e-6)]
        after = now + share * (wanted - now)
        values += [now, after]
        now = after
    return Line(np.array(times), np.array(values))


def _doubts(
    log: RunLog, rig: Rig, frames: Frames, x_m: FloatArray, flying: npt.NDArray[np.bool_]
) -> tuple[str, ...]:
    """What a flight leaves open, or what had to be assumed of it, in words."""
    doubts = told_of_columns(log, rig, flying)
    if frames.doubt:
        doubts.append(frames.doubt)
    if log.metadata.get("rig_sha256") is None:
        doubts.append(
            "the log does not say with which rig file it was flown; the given one is assumed"
        )
    if float(np.ptp(x_m)) < _CARRIAGE_MOVED_M:
        doubts.append("the carriage stands still: it cannot tell where the wake is, nor how wide")
    idle_us = rig.limits.pulse_us[0] + _IDLE_US
    if float(np.nanmax(log["source_cmd_us"][flying])) < idle_us:
        doubts.append("the source is off: nothing is learned of the wake")
    return tuple(doubts)


def _carriage(
    log: RunLog, rig: Rig, t_s: FloatArray, arrivals_s: FloatArray, grid_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Position and speed on the grid; a count was taken when the command before arrived."""
    steps = np.asarray(log["steps"], float)
    known = np.isfinite(steps)
    taken_s = np.concatenate([[t_s[0]], arrivals_s[:-1]])[known]
    x_m = np.interp(grid_s + 0.5 * DT_S, taken_s, (steps[known] + 0.5) / rig.stepper.steps_per_m)
    smooth = np.convolve(np.pad(x_m, 4, mode="edge"), np.ones(9) / 9.0, mode="valid")
    return np.asarray(x_m), np.asarray(np.gradient(smooth, DT_S))


def _rests(
    log: RunLog,
    t_s: FloatArray,
    flying: npt.NDArray[np.bool_],
    sample_s: FloatArray,
    reading_m: FloatArray,
    noise_m: float,
) -> FloatArray:
    """Mean, variance, mean time and "is a ceiling" (r, 4) of readings at rest, before and after."""
    first, last = t_s[flying][0], t_s[flying | (log["mode"] == "LANDING")][-1]
    rests = []
    # A failsafe may end in the air: only rests that the board confirms count.
    landed = np.isin(log["mode"][t_s > last], _AT_REST).all()
    after = sample_s > (last + 0.5 if landed else np.inf)
    for chosen in (sample_s < first - 0.05, after):
        if chosen.sum() >= 20:
            read = _censored_mean(reading_m[chosen], noise_m)
            if read is not None:
                mean_m, variance_m2, ceiling = read
                rests.append((mean_m, variance_m2, float(sample_s[chosen].mean()), ceiling))
    return np.array(rests, float).reshape(-1, 4)


def _censored_mean(reading_m: FloatArray, noise_m: float) -> tuple[float, float, bool] | None:
    """Mean, its variance, and whether it is only a ceiling, of readings cut off below (a tobit).

    A time-of-flight sensor gives no negative ranges, so at rest on the stop half of the noise may
    be cut off. If nearly all readings are zero they do not show their own spread: with the rig
    file's noise, the mean is low enough for no more than these to stand out. A sensor that always
    reads another value may be stuck: None.
    """
    kept = reading_m[np.abs(reading_m - np.median(reading_m)) < 0.03]
    floor = float(kept.min())
    at_floor = kept <= floor + 1e-9
    if len(kept) < 10:
        return None
    if at_floor.mean() > _CUT_OFF_SHARE:
        if floor > _ZERO_M:
            return None
        below_m = noise_m * float(ndtri(min(at_floor.mean(), 1.0 - 0.5 / len(kept))))
        return _ZERO_M - below_m, (_NOISE_KNOWN * below_m) ** 2 + _REST_SD_M**2, True
    if at_floor.mean() < 0.15:
        return float(kept.mean()), float(kept.var() / len(kept)) + _REST_SD_M**2, False
    above = kept[~at_floor]
    means = np.linspace(floor - 0.01, floor + 0.01, 201)[:, None]
    spreads = np.linspace(0.001, 0.012, 45)[None, :]
    density = at_floor.sum() * log_ndtr((floor + 0.0005 - means) / spreads)
    square = ((above[None, None, :] - means[..., None]) ** 2).sum(-1)
    density = density - len(above) * np.log(spreads) - 0.5 * square / spreads**2
    weight = np.exp(density - density.max())
    mean = float((weight * means).sum() / weight.sum())
    variance = float((weight * (means - mean) ** 2).sum() / weight.sum())
    return mean, variance + _REST_SD_M**2, False


def _not_flown(name: str, log: RunLog, why: str) -> NotFlown:
    return NotFlown(f"{name}: {why}.", why, _seed(log.metadata))


def _references(log: RunLog, fresh: npt.NDArray[np.bool_]) -> FloatArray:
    return np.stack([log[name][fresh] for name in ("z_ref_m", "x_ref_m", "source_cmd_us")])


def _require_content(flight: Flight, log: RunLog, flying: npt.NDArray[np.bool_]) -> None:
    if flight.airborne_s < SHORTEST_S:
        raise _not_flown(
            flight.name,
            log,
            f"only {flight.airborne_s:.1f} s in the air; at least {SHORTEST_S:g} s are needed, "
            "20 s are good",
        )
    commands = log["sufferer_cmd_us"][flying]
    if np.ptp(flight.reading_m) == 0.0:
        raise UnusableInput(f"{flight.name}: range_m is constant; the sensor was not working.")
    if np.nanstd(commands) == 0.0:
        raise UnusableInput(f"{flight.name}: sufferer_cmd_us is constant; nothing was controlled.")
