"""How likely the flights of a gantry are under a hypothesis: a rig file plus effects.

In: a rig, flights, the names of effects. Out: innovations of the range sensor, one per sample, from
a Kalman filter whose known forces come from the logged commands: under feedback a missing force
hides in the command, and so shows in the prediction. Noise (white acceleration, turbulence that
scales with the wake's force, range noise that may grow with height) and calibration (the rig file's
spreads as priors) are free in every hypothesis, the base included.

Everything but the filter is a sum along the flight, linear around the smoothed motion.
"""

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.fits import NO_SLOPES, Fit, Free, Hypothesis, Score, neutral
from wakedeploy.gap.systems.gantry.flight import DT_S, OUTLIER, Flight, FloatArray
from wakedeploy.gap.systems.gantry.forces import Forces, Physics
from wakedeploy.gap.systems.gantry.parameters import HOLD, NOISE, Layout, own_effects
from wakedeploy.gap.systems.gantry.repeated_readings import Held, chance_of_equals, likely_periods_s
from wakedeploy.gap.systems.gantry.servo_frames import period_s
from wakedeploy.gap.systems.gantry.varying import (
    freed,
    own_amounts,
    shifted,
    varying,
)
from wakedeploy.physics.constants import Constants
from wakedeploy.physics.effects import LIBRARY, Effect, replacing
from wakedeploy.physics.effects.chain import Chain
from wakedeploy.physics.series import filtered, smoothed

_FAINTEST = 1e-3  # [m/s²] of coloured acceleration, so that its state is always observable
_NO_HORIZON = np.zeros(0, np.int64)
_SHARE = 0.5  # of the way to a new motion, per turn
_STILL_MPS = 2e-4  # root mean square; the speed itself is known to about 20 times this
_MOST_MOTIONS = 20
_STANDING_TURNS = 3
_OWN_STEP = 0.05  # of what varies, for its slope: with more, samples become outliers on the way


@dataclass(frozen=True, eq=False)
class Forecasts:
    """Heights forecast from each counted sample, arrays (h, n); NaN if the flight ends before.

    Forecasts are for the grid's steps at `then_s`. `measured_m` is the reading then, `forecast_m`
    its expectation, and `variance_m2` the variance of that, with the reading's noise.
    """

    horizon_s: FloatArray  # (h,) from the step in which the sample was taken
    at_s: FloatArray  # (n,) time of the sample it was forecast from
    then_s: FloatArray
    measured_m: FloatArray
    forecast_m: FloatArray
    variance_m2: FloatArray


class GantryModel:
    """The likelihood of flights under effects on top of a rig file; a `Model` of `inference`.

    `extra` are further effects by name, which a search for a symbolic expression tries. `relations`
    say which effects are confused with which, for `evidence.ranking`.
    """

    relations: ClassVar[Mapping[str, Effect]] = LIBRARY

    def __init__(
        self, rig: Rig, flights: Sequence[Flight], extra: Mapping[str, Effect] | None = None
    ) -> None:
        self.rig, self.flights = rig, tuple(flights)
        self.extra: Mapping[str, Effect] = extra if extra is not None else {}
        self._physics = [Physics(rig, flight) for flight in self.flights]
        self._layouts: dict[Hypothesis, Layout] = {}
        self._own_effects = own_effects(rig)
        self._varying = varying(rig)
        self._directions: dict[int, FloatArray] = {}
        self._stand: dict[int, FloatArray] = {}  # each flight's own deviations, to begin with
        self._noise: FloatArray | None = None  # under which their directions are looked at

    @property
    def episodes(self) -> int:
        """How many flights there are."""
        return len(self.flights)

    def effect(self, name: str) -> Effect:
        """An effect of the library or of the extra ones; KeyError for neither."""
        return self.extra[name] if name in self.extra else LIBRARY[name]

    def free(self, hypothesis: Hypothesis) -> tuple[Free, ...]:
        """Noise, calibration, then the parameters of the rig's own effects and of named ones."""
        return self._layout(hypothesis).free

    def start(self, hypothesis: Hypothesis) -> FloatArray:
        """Where a first fit starts: neutral, but with loud noise, so that nothing is an outlier."""
        return np.array([f.neutral if f.first is None else f.first for f in self.free(hypothesis)])

    def score(self, hypothesis: Hypothesis, theta: FloatArray, episode: int) -> Score:
        """One flight: a score per airborne sample and one per rest on the stop.

        What the rig file says varies from flight to flight is this flight's own.
        """
        constants, effects = self._layout(hypothesis).read(theta)
        if not self._varying:
            return self._scored(episode, constants, effects, theta)
        score = self._scored(episode, *self._of_flight(constants, effects, episode), theta)
        return freed(score, self._own_directions(episode), self._stood(episode))

    def own_deviations(self, fitted: Fit, episode: int) -> dict[str, tuple[float, float]]:
        """A flight's own deviations under a fit: value and standard error, by quantity.

        Its samples alone determine them, without the prior that it is like the others.
        """
        amounts, precision = self._amounts(fitted, episode)
        alone = np.linalg.inv(precision - np.eye(len(amounts)))
        values = alone @ precision @ amounts
        errors = np.sqrt(np.diag(alone))
        return {
            quantity.name: (float(v) * quantity.sd, float(e) * quantity.sd)
            for quantity, v, e in zip(self._varying, values, errors, strict=True)
        }

    def _own_directions(self, episode: int) -> FloatArray:
        """What one deviation of each varying quantity does to a flight's innovations, (n, K)."""
        if episode not in self._directions:
            layout = self._layout(())
            theta = neutral(layout.free)
            if self._noise is not None:
                theta[: len(NOISE)] = self._noise
            at = self._of_flight(*layout.read(theta), episode)
            here = self._scored(episode, *at, theta).innovation
            beside = [
                self._scored(
                    episode, *quantity.moved(*at, _OWN_STEP * quantity.sd), theta
                ).innovation
                for quantity in self._varying
            ]
            columns = [(there - here) / _OWN_STEP for there in beside]
            self._directions[episode] = np.stack(columns, axis=1)
        return self._directions[episode]

    def _stood(self, episode: int) -> FloatArray:
        return self._stand.get(episode, np.zeros(len(self._varying)))

    def _of_flight(
        self, constants: Constants, effects: Chain, episode: int
    ) -> tuple[Constants, Chain]:
        """Constants and effects with the deviations that a flight stands at."""
        return shifted(constants, effects, self._varying, self._stood(episode))

    def _amounts(self, fitted: Fit, episode: int) -> tuple[FloatArray, FloatArray]:
        """A flight's own deviations under a fit, and their precision; see `own_amounts`."""
        constants, effects = self._layout(fitted.hypothesis).read(fitted.theta)
        at = self._of_flight(constants, effects, episode)
        score = self._scored(episode, *at, fitted.theta)
        return own_amounts(score, self._own_directions(episode), self._stood(episode))

    def _read(self, fitted: Fit, episode: int) -> tuple[Constants, Chain]:
        """Constants and effects under a fit, a flight's own deviations included."""
        constants, effects = self._layout(fitted.hypothesis).read(fitted.theta)
        if not self._varying:
            return constants, effects
        amounts, _ = self._amounts(fitted, episode)
        return shifted(constants, effects, self._varying, amounts)

    def _scored(
        self, episode: int, constants: Constants, effects: Chain, theta: FloatArray
    ) -> Score:
        """One flight with these constants and effects; only the noise is taken from `theta`."""
        flight = self.flights[episode]
        forces = self._physics[episode].forces(constants, effects)
        samples = self._filter(flight, forces, theta, _NO_HORIZON, False)[0]
        e, v, density, weight = samples[:, flight.counted]
        density, weight = _with_repeats(density, weight, flight, forces.held)
        rest_e = flight.rest[:, 0] - self._physics[episode].at_rest(constants, effects)
        # If only a ceiling of the mean is known, an expected mean below it is no error.
        rest_e = np.where(flight.rest[:, 3] > 0.0, np.minimum(rest_e, 0.0), rest_e)
        rest_v = flight.rest[:, 1]
        rest_density = -0.5 * (rest_e**2 / rest_v + np.log(2.0 * math.pi * rest_v))
        repeat_e, repeat_v = _repeats(flight, forces.held, _chance(self.rig))
        return Score(
            np.concatenate([density, rest_density, [0.0]]),
            np.concatenate([e, rest_e, repeat_e]),
            np.concatenate([np.maximum(v, 1e-12), rest_v, repeat_v]),
            np.concatenate([weight, np.ones(len(rest_e) + 1)]),
            (slice(0, len(density)),),
        )

    def forces(self, fitted: Fit, episode: int) -> Forces:
        """Every force along one flight under a fit."""
        constants, effects = self._read(fitted, episode)
        return self._physics[episode].forces(constants, effects)

    def forecasts(self, fitted: Fit, episode: int, horizons_s: Sequence[float]) -> Forecasts:
        """Open-loop replay: from each filtered state, the commands predict what comes.

        Forces are linear around the flight's motion, which all its readings smoothed. So forces
        with a corner in the motion, such as friction's sign, are forecast a little too well.
        """
        flight = self.flights[episode]
        constants, effects = self._read(fitted, episode)
        forces = self._physics[episode].forces(constants, effects)
        steps = np.array([round(h / DT_S) for h in horizons_s], np.int64)
        _, ahead, _, _ = self._filter(flight, forces, fitted.theta, steps, False)
        noise = _reading_noise(flight, fitted.theta, self.rig)
        return _compared(flight, forces, steps, ahead, noise)

    def around_own_motion(self, fitted: Fit) -> "GantryModel":
        """The same flights around the motion on which a fit's forces and all samples agree.

        The forces depend on the motion, friction on its very sign. So forces and motion take turns,
        flight by flight, until the speed stays where it is. Each turn goes half-way, or friction's
        corners would throw the motion to and fro. Nothing is fitted.
        """
        flights = []
        begun = self.standing(fitted)
        for episode, (flight, known) in enumerate(zip(self.flights, self._physics, strict=True)):
            constants, effects = begun._read(fitted, episode)
            physics, airborne = known, _airborne(flight)
            for _ in range(_MOST_MOTIONS):
                forces = physics.forces(constants, effects)
                change = self._smooth(flight, forces, fitted.theta) - flight.nominal
                flight = replace(flight, nominal=flight.nominal + _SHARE * change)
                if float(np.sqrt(np.mean(change[1, airborne] ** 2))) < _STILL_MPS:
                    break
                physics = Physics(self.rig, flight)
            flights.append(flight)
        moved = GantryModel(self.rig, flights, self.extra)
        moved._noise, moved._stand = begun._noise, begun._stand
        return moved

    def standing(self, fitted: Fit) -> "GantryModel":
        """The same flights, each with its own deviations under a fit.

        Scores are linear around these deviations: from far away, it takes a few turns to reach
        them.
        """
        model = self
        for _ in range(_STANDING_TURNS if self._varying else 0):
            known, model = model, copy.copy(model)
            model._noise, model._directions = fitted.theta[: len(NOISE)], {}
            every = range(self.episodes)
            model._stand = {episode: known._amounts(fitted, episode)[0] for episode in every}
        return model

    def neutral(self) -> Fit:
        """The rig file as it is, with nothing fitted: all parameters at their priors' centres."""
        free = self.free(())
        return Fit((), free, tuple(range(self.episodes)), neutral(free), NO_SLOPES, np.zeros(0))

    def only(self, episodes: Sequence[int]) -> "GantryModel":
        """The model of some of the flights."""
        return GantryModel(self.rig, [self.flights[i] for i in episodes], self.extra)

    def _layout(self, hypothesis: Hypothesis) -> "Layout":
        if hypothesis not in self._layouts:
            named = [self.effect(name) for name in hypothesis]
            is_held = any(name.partition(".")[0] in hypothesis for name in replacing(HOLD))
            held_s = self._likely_holds_s() if is_held else ()
            frames_s = self._reported_frames_s()
            self._layouts[hypothesis] = Layout(self.rig, self._own_effects, named, held_s, frames_s)
        return self._layouts[hypothesis]

    def _reported_frames_s(self) -> tuple[float, ...]:
        """The servo frame that logs show, if not the rig file's: the middle one of several."""
        reported = [f.reported_frame_s for f in self.flights]
        periods_s = [period_s(frames_s) for frames_s in reported if frames_s is not None]
        return (float(np.median(periods_s)),) if periods_s else ()

    def _likely_holds_s(self) -> tuple[float, ...]:
        """Where a fit of a hold starts: its likelihood is too jagged to climb from anywhere."""
        flown = [(f.sample_s[f.counted], f.repeated[f.counted]) for f in self.flights]
        return likely_periods_s(flown, _chance(self.rig))

    def _filter(
        self,
        flight: Flight,
        forces: Forces,
        theta: FloatArray,
        horizons: np.typing.NDArray[np.int64],
        remember: bool,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        gain, keep, white = _disturbance(forces, theta)
        return filtered(  # type: ignore[no-any-return]
            DT_S,
            flight.start,
            flight.stop,
            flight.nominal,
            forces.acceleration,
            gain,
            keep,
            white,
            forces.step_of,
            forces.into_s,
            flight.reading_m,
            forces.expected,
            _reading_noise(flight, theta, self.rig, forces),
            OUTLIER,
            horizons,
            remember,
        )

    def _smooth(self, flight: Flight, forces: Forces, theta: FloatArray) -> FloatArray:
        _, _, states, covariances = self._filter(flight, forces, theta, _NO_HORIZON, True)
        gain, keep, white = _disturbance(forces, theta)
        path = smoothed(
            DT_S,
            flight.start,
            flight.stop,
            states,
            covariances,
            flight.nominal,
            forces.acceleration,
            gain,
            keep,
            white,
        )
        motion = flight.nominal.copy()
        for a, b in zip(flight.start, flight.stop, strict=True):
            motion[:, a:b] = path[:2, a:b]
        return motion


def _airborne(flight: Flight) -> np.typing.NDArray[np.bool_]:
    """The grid's steps at which the flight is in the air, (n,)."""
    inside = np.zeros(flight.nominal.shape[1], bool)
    for a, b in zip(flight.start, flight.stop, strict=True):
        inside[a:b] = True
    return inside


def _disturbance(forces: Forces, theta: FloatArray) -> tuple[FloatArray, float, float]:
    """Acceleration per unit of the coloured disturbance (N,), its persistence, white intensity."""
    turbulence = math.exp(theta[1]) * np.abs(forces.wake_n) / forces.inertia_kg
    gain = np.sqrt(turbulence * turbulence + _FAINTEST * _FAINTEST)  # hypot takes ten times as long
    return gain, math.exp(-DT_S / math.exp(theta[2])), math.exp(2.0 * theta[0])


def _reading_noise(
    flight: Flight, theta: FloatArray, rig: Rig, forces: Forces | None = None
) -> FloatArray:
    """Variance [m²] of each reading (n,): the sensor's, and from the unknown age of held readings.

    A repeated reading says little if readings are held. Without `forces`, it is the sensor's alone.
    """
    deviation = np.maximum(math.exp(theta[3]) + theta[4] * flight.reading_m, 2e-4)
    variance = deviation**2 + rig.range_sensor.resolution_m**2 / 12.0
    if forces is None or not forces.held.is_held:
        return np.asarray(variance)
    speed = np.interp(forces.taken_s, flight.grid_s, flight.nominal[1])
    variance = variance + forces.held.age_variance_s2 * speed**2
    share = forces.held.probability
    fresh = (1.0 - share) * _chance(rig)
    return np.asarray(np.where(flight.repeated, variance * (share + fresh) / fresh, variance))


def _chance(rig: Rig) -> float:
    return chance_of_equals(rig.range_sensor.resolution_m, rig.range_sensor.noise_m)


def _with_repeats(
    density: FloatArray, weight: FloatArray, flight: Flight, held: Held
) -> tuple[FloatArray, FloatArray]:
    """Log densities if a reading may be a held repeat of the one before: a mixture of the two.

    Weights are the probability that a reading is fresh and no outlier.
    """
    if not held.is_held:
        return density, weight
    share = held.probability[flight.counted]
    repeated = flight.repeated[flight.counted]
    fresh = np.log1p(-share) + density
    stale = np.log(np.maximum(share, 1e-300) / flight.resolution_m)
    mixed = np.where(repeated, np.logaddexp(fresh, stale), fresh)
    return mixed, weight * np.where(repeated, np.exp(fresh - mixed), 1.0)


def _repeats(flight: Flight, held: Held, chance: float) -> tuple[FloatArray, FloatArray]:
    """The number of repeats beyond expectation, and its variance.

    The repeats' likelihood is in the samples' densities; this carries its slope to the fit.
    """
    expected = chance
    if held.is_held:
        share = held.probability[flight.counted]
        expected = float(np.mean(share + (1.0 - share) * chance))
    excess = flight.repeated_share - expected
    return np.array([excess]), np.array([expected * (1.0 - expected) / flight.counted.sum()])


def _nearest(times_s: FloatArray, wanted_s: FloatArray) -> np.typing.NDArray[np.int64]:
    """Indices of the times nearest to the wanted ones (m,); times of held readings are unsorted."""
    order = np.argsort(times_s, kind="stable")
    ordered = times_s[order]
    after = np.clip(np.searchsorted(ordered, wanted_s), 1, max(len(ordered) - 1, 1))
    after = np.minimum(after, len(ordered) - 1)
    before = np.maximum(after - 1, 0)
    earlier = wanted_s - ordered[before] <= ordered[after] - wanted_s
    return np.asarray(order[np.where(earlier, before, after)])


def _compared(
    flight: Flight,
    forces: Forces,
    steps: np.typing.NDArray[np.int64],
    ahead: FloatArray,
    noise: FloatArray,
) -> Forecasts:
    """Forecast heights and the readings that came then, interpolated between samples."""
    counted = flight.counted
    # The reading is expected at the nominal height at the sample's own time, not at its step's.
    nominal_m = np.interp(forces.taken_s, flight.grid_s, flight.nominal[0])
    slope = forces.expected[1]
    offset = forces.expected[0] - slope * nominal_m
    times, measured, forecast, variance = [], [], [], []
    for h, count in enumerate(steps):
        then = np.minimum(forces.step_of + count, len(flight.grid_s) - 1)
        then_s = flight.grid_s[then]
        nearest = _nearest(forces.taken_s, then_s)
        moved_m = flight.nominal[1, then] * (forces.taken_s[nearest] - then_s)
        times.append(then_s[counted])
        measured.append((flight.reading_m[nearest] - slope * moved_m)[counted])
        forecast.append((slope * ahead[2 * h] + offset)[counted])
        variance.append((slope**2 * ahead[2 * h + 1] + noise)[counted])
    return Forecasts(
        np.asarray(steps * DT_S, float),
        flight.sample_s[counted],
        np.array(times),
        np.array(measured),
        np.array(forecast),
        np.array(variance),
    )
