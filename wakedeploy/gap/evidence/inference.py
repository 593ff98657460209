"""Hypotheses fitted by maximum likelihood, and judged on episodes that they were not fitted to.

In: a `Model`, which scores one episode under a hypothesis, sample by sample. Out: fits with
intervals, and held-out gains.

The log density is Gaussian in innovations with outliers weighted down, so that first derivatives
of innovation and variance give gradient and Fisher information (Gauss–Newton); leaving an episode
out is then one more Newton step from the common optimum.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.optimize import lsq_linear
from scipy.stats import t as student_t

FloatArray = npt.NDArray[np.float64]
LOST_NATS = -1e6  # log density of a sample whose state has left the model
Hypothesis = tuple[str, ...]

_ITERATIONS = 24  # most climbs take under ten; from far away, with loud noise, twelve do not do
_FARTHEST = 16.0  # square of a leave-one-out step in standard deviations, all directions together
_ENOUGH_NATS = 0.05  # a step that promises less ends a fit
# Steps keep slopes until they have gained so much together; those of the form, nearly linear, for
# longer, and in any case while the climb is far away.
_SETTLED_NATS, _FORM_SETTLED_NATS, _FAR_NATS = 2.0, 20.0, 200.0
# A climb that slows to steps of so many nats is given up where it promises, times the optimism,
# less than what it has to reach. Faster ones come from far away, where promises are too small.
_SLOW_NATS, _OPTIMISM = 30.0, 3.0
_FLAT = 1e-10  # of a scaled curvature or step, what is nothing but rounding
_RISEN_NATS, _MOST_REFITS = 0.1, 4  # what a repeated fit may rise by, and how often it is repeated
_AT_REST_SD = 0.1  # a size that a repeated fit moves by less has come to rest


@dataclass(frozen=True)
class Free:
    """A parameter that a fit may move: prior N(neutral, prior_sd²) within [low, high].

    `step` is how far a finite difference reaches; an infinite `prior_sd` is a flat prior. Two
    parameters with the same `quantity` are the same thing under two names, as a calibrated constant
    and the effect that replaces it; a larger hypothesis then starts from the smaller one's value.
    `scanned` are sizes to look at before a climb, where a likelihood is jagged; `finest` and
    `finest_share` (of the size) are the least standard error that may be told of it. `adds_to` is
    the calibrated constant that a parameter moves without replacing it. `first` is where a first
    fit begins, if not at neutral: loud noise makes outliers of nothing. `is_form` says that it is
    of the model's own shape: bent, it tells of no calibration.
    """

    name: str
    unit: str
    neutral: float
    prior_sd: float
    low: float
    high: float
    step: float
    starts: tuple[float, ...] = (0.0,)
    quantity: str = ""
    adds_to: str = ""
    first: float | None = None
    scanned: tuple[float, ...] = ()
    finest: float = 0.0
    finest_share: float = 0.0
    is_form: bool = False


@dataclass(frozen=True)
class Score:
    """One episode under one hypothesis, sample by sample in order of time, arrays (n,).

    `log_density` in nats; `innovation` and its `variance` in the channel's unit; `weight` is the
    probability that the sample is no outlier. `channels` are where each channel's samples lie, in
    order of time; what lies in none is auxiliary, as a mean at rest.
    """

    log_density: FloatArray
    innovation: FloatArray
    variance: FloatArray
    weight: FloatArray
    channels: tuple[slice, ...] = (slice(None),)

    @property
    def white(self) -> FloatArray:
        """Innovations over their standard deviation, outliers weighted down, (n,)."""
        return np.asarray(self.innovation / np.sqrt(self.variance) * np.sqrt(self.weight))


class Model(Protocol):
    """What a domain provides: parameters of a hypothesis, and how likely an episode is."""

    @property
    def episodes(self) -> int:
        """How many episodes there are."""
        ...

    def free(self, hypothesis: Hypothesis) -> tuple[Free, ...]:
        """Noise, nuisances and the effects' parameters; these are named `<effect>.<parameter>`."""
        ...

    def score(self, hypothesis: Hypothesis, theta: FloatArray, episode: int) -> Score:
        """One episode under parameters (p,), ordered as `free` says."""
        ...


def scores_of(
    model: Model, hypothesis: Hypothesis, thetas: FloatArray, episodes: Sequence[int]
) -> list[tuple[Score, ...]]:
    """Episodes under parameter sets (K, p): for each set a score of each episode.

    A model that has a `scores` of the same arguments scores them all in about the time of one.
    """
    together = getattr(model, "scores", None)
    if together is not None:
        found: list[tuple[Score, ...]] = together(hypothesis, thetas, episodes)
        return found
    return [tuple(model.score(hypothesis, theta, e) for e in episodes) for theta in thetas]


@dataclass(frozen=True, eq=False)
class Slopes:
    """Scores of several episodes and their derivatives by every parameter."""

    scores: tuple[Score, ...]
    innovation: tuple[FloatArray, ...]  # (n, p) each
    variance: tuple[FloatArray, ...]  # (n, p) each

    def gradient(self) -> FloatArray:
        """Of the log likelihood, per episode, (E, p)."""
        return np.array(
            [
                _gradient(*each)
                for each in zip(self.scores, self.innovation, self.variance, strict=True)
            ]
        )

    def fisher(self) -> FloatArray:
        """Expected information per episode, (E, p, p)."""
        return np.array(
            [
                _fisher(*each)
                for each in zip(self.scores, self.innovation, self.variance, strict=True)
            ]
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis at its maximum a posteriori; everything per episode (E, …).

    `summits` are fits of the same hypothesis elsewhere that these episodes do not tell from it.
    `converged` says that its climb ended where no step promised anything. `profiled` are ends
    beyond which no interval reaches, by parameter, where the likelihood is no parabola.
    """

    hypothesis: Hypothesis
    free: tuple[Free, ...]
    episodes: tuple[int, ...]
    theta: FloatArray  # (p,)
    slopes: Slopes = field(repr=False)
    per_episode: FloatArray  # (E,) log likelihood in nats
    summits: tuple["Fit", ...] = field(default=(), repr=False)
    converged: bool = True
    profiled: Mapping[str, tuple[float, float]] = field(default_factory=dict, repr=False)

    @property
    def log_likelihood(self) -> float:
        """Over all episodes, without the priors [nats]."""
        return float(self.per_episode.sum())

    @property
    def objective(self) -> float:
        """Log likelihood and priors together [nats]."""
        return self.log_likelihood + self.log_prior

    @property
    def log_prior(self) -> float:
        """How well the parameters agree with their priors, 0 at best [nats]."""
        return log_prior(self.free, self.theta)

    @property
    def calibration_log_prior(self) -> float:
        """The same of calibrated constants alone, without noise and the model's form [nats]."""
        kept = [i for i, f in enumerate(self.free) if f.quantity]
        return log_prior([self.free[i] for i in kept], self.theta[kept])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(f.name for f in self.free)

    def value(self, name: str) -> float:
        """A parameter's estimate; KeyError for one that is not free."""
        return float(self.theta[self._index(name)])

    def standard_error(self, name: str) -> float:
        """The larger of two: from the curvature and from the spread between episodes.

        The curvature knows nothing of what the model lacks, and the spread of a few episodes may be
        small by chance; clustered by episode, it is the jackknife's, and the priors' own.
        """
        free = self.free[self._index(name)]
        finest = max(free.finest, free.finest_share * abs(self.value(name)))
        return max(float(np.sqrt(max(self._variances(name)))), finest)

    def interval(self, name: str, level: float = 0.9) -> tuple[float, float]:
        """Where the parameter lies with this probability, clipped to its bounds.

        From the lowest to the highest end that any of the summits has. The quantile is Student's:
        with one degree of freedom less than there are episodes where their spread decides, with
        twice as many where the curvature bears it out.
        """
        free = self.free[self._index(name)]
        ends = [summit._ends(name, level) for summit in (self, *self.summits)]
        lowest, highest = self.profiled.get(name, (-np.inf, np.inf))
        low = max(min(low for low, _ in ends), free.low, lowest)
        return low, min(max(high for _, high in ends), free.high, highest)

    def _ends(self, name: str, level: float) -> tuple[float, float]:
        """The interval around this summit alone, not clipped."""
        curvature, spread = self._variances(name)
        freedom = max(len(self.episodes) - 1, 1) * (1 if spread > curvature else 2)
        reach = float(student_t.ppf(0.5 + 0.5 * level, freedom)) * self.standard_error(name)
        value = self.value(name)
        return value - reach, value + reach

    def _variances(self, name: str) -> tuple[float, float]:
        """Of an estimate, from the curvature and from the spread between episodes (0 for one)."""
        gradient, fisher = self.slopes.gradient(), self.slopes.fisher()
        at = self._index(name)
        low, high = _bounds(self.free)
        free = (self.theta > low) & (self.theta < high)  # at its bound a parameter follows nothing
        free[at] = True
        gradient, fisher = gradient[:, free], fisher[:, free][:, :, free]
        prior = np.diag(prior_precision(self.free)[free])
        unit = np.eye(len(prior))[np.count_nonzero(free[:at])]
        total, count = fisher.sum(0) + prior, len(gradient)
        inverse = _solve(total, unit)
        curvature = float(inverse @ unit)
        if count < 2:
            return curvature, 0.0
        # An episode's pull on the estimate is weighed without its own information: so many
        # parameters bend to each of so few episodes that its gradient tells too little of it.
        pulls = [
            _solve(total - information, unit) @ g
            for g, information in zip(gradient, fisher, strict=True)
        ]
        spread = float(np.var(pulls, ddof=1)) * (count - 1) ** 2 / count
        return curvature, spread + float(inverse @ prior @ inverse)

    def _index(self, name: str) -> int:
        try:
            return self.names.index(name)
        except ValueError as error:
            raise KeyError(f"{name!r} is not free under {self.hypothesis}") from error


def fit(
    model: Model,
    hypothesis: Hypothesis,
    episodes: Sequence[int],
    start: FloatArray | None = None,
    slopes: Slopes | None = None,
    moving: Sequence[int] | None = None,
    least: float = -np.inf,
    enough_nats: float | None = None,
) -> Fit:
    """Maximise log likelihood plus log priors over the hypothesis's parameters.

    `start` (p,) is where to begin (the neutral values if None). `slopes`, if they are known there,
    save a round; with `moving`, only those parameters' slopes are renewed on the way, which is
    enough to tell a contender from the rest. A climb that will not come to an objective of `least`
    is given up, not converged. With `enough_nats` all slopes are renewed at every step, and a climb
    that converges is within about as much of a summit.
    """
    free = model.free(hypothesis)
    theta = neutral(free) if start is None else np.clip(start, *_bounds(free))
    chosen = tuple(episodes)
    ascent = _Ascent(model, hypothesis, free, chosen, moving, least, enough_nats)
    return ascent.run(theta, slopes)


def settled(model: Model, fitted: Fit) -> tuple[Fit, bool]:
    """A fit repeated from where it ended, and whether its effects' sizes have come to rest.

    They have where it no longer rises, or rises by what moves no size against its standard error:
    noise may creep on for long, and how far it comes depends on how a processor rounds.
    """
    moved = np.inf
    for _ in range(_MOST_REFITS):
        again = fit(
            model, fitted.hypothesis, fitted.episodes, fitted.theta, enough_nats=_ENOUGH_NATS
        )
        rise, moved, fitted = again.objective - fitted.objective, _moved_sd(fitted, again), again
        if rise < _RISEN_NATS:
            return fitted, True
    return fitted, moved < _AT_REST_SD


def _moved_sd(before: Fit, after: Fit) -> float:
    """How far the effects' parameters went, in standard errors: the one that went farthest."""
    sizes = [n for n in after.names if n.startswith(tuple(f"{e}." for e in after.hypothesis))]
    moved = (
        abs(after.value(n) - before.value(n)) / max(after.standard_error(n), 1e-300) for n in sizes
    )
    return max(moved, default=0.0)


def applied(model: Model, fitted: Fit, episodes: Sequence[int] | None = None) -> Fit:
    """A fit's hypothesis and parameters on episodes of `model` (default: all), fitted to none."""
    episodes = tuple(range(model.episodes) if episodes is None else episodes)
    scores = tuple(model.score(fitted.hypothesis, fitted.theta, e) for e in episodes)
    density = np.array([s.log_density.sum() for s in scores])
    slopes = Slopes(scores, (), ())
    return Fit(fitted.hypothesis, fitted.free, episodes, fitted.theta, slopes, density)


def held_out(base: Fit, larger: Fit) -> FloatArray:
    """What a larger hypothesis adds to each episode's log density, not having seen it, (E,) nats.

    Only the larger one's own parameters are left out: they are those that the other episodes
    prefer, noise and calibration following them as all episodes together say. Both hypotheses have
    these fitted, so that leaving them out as well would add to the difference little but scatter. A
    calibrated constant that an effect takes over counts as the effect's own. A Newton step from the
    common optimum tells it, in which a quadratic log density is exact (as in the efficient score:
    Neyman 1959).

    With one episode nothing can be left out; each parameter then costs one nat (Akaike 1974).
    Raises ValueError where the fits are of different episodes.
    """
    if base.episodes != larger.episodes:
        raise ValueError(f"fitted to {base.episodes} and to {larger.episodes}: not comparable")
    places = [i for i, n in enumerate(larger.names) if n not in set(base.names)]
    seen = larger.per_episode - base.per_episode
    if len(larger.episodes) < 2:
        return seen - len(places)
    return seen - _flattery(larger, places)


def _flattery(fitted: Fit, places: Sequence[int]) -> FloatArray:
    """How much too well parameters fit each episode for having been fitted to it, (E,) nats."""
    gradient, fisher = fitted.slopes.gradient(), fitted.slopes.fisher()
    total = fisher.sum(0) + np.diag(prior_precision(fitted.free))
    low, high = _bounds(fitted.free)
    fixed = (fitted.theta <= low) | (fitted.theta >= high)
    places = [i for i in places if not fixed[i]]  # at its bound a parameter follows no episode
    if not places:
        return np.zeros(len(gradient))
    shared = [i for i in range(len(total)) if i not in set(places) and not fixed[i]]
    follow = np.column_stack(
        [_solve(total[np.ix_(shared, shared)], total[shared, i]) for i in places]
    )  # (s, k): how far the shared parameters go with the own ones
    along = np.zeros((len(total), len(places)))
    along[places, range(len(places))] = 1.0
    along[shared] = -follow
    pull = gradient @ along  # (E, k)
    curvature = along.T @ fisher @ along  # (E, k, k)
    everything = along.T @ total @ along
    lost = []
    for u, j in zip(pull, curvature, strict=True):
        rest = everything - j
        step = _solve(rest, -u)
        step *= min(1.0, (_FARTHEST / max(float(step @ rest @ step), 1e-12)) ** 0.5)
        lost.append(0.5 * float(step @ j @ step) - float(u @ step))
    return np.array(lost)


def slopes_at(
    model: Model,
    hypothesis: Hypothesis,
    episodes: Sequence[int],
    theta: FloatArray,
    known: tuple[Slopes, Sequence[int]] | None = None,
) -> Slopes:
    """Scores and derivatives at some parameters; of `known` ones only some columns are renewed."""
    free = model.free(hypothesis)
    return _Ascent(model, hypothesis, free, tuple(episodes), None, -np.inf).slopes(theta, known)


def extended(base: Fit, free: Sequence[Free]) -> FloatArray:
    """Parameters (p,) for a larger hypothesis: the base's where they are shared, else neutral."""
    known = dict(zip(base.names, base.theta, strict=True))
    same = {f.quantity: v for f, v in zip(base.free, base.theta, strict=True) if f.quantity}
    return np.array([known.get(f.name, same.get(f.quantity, f.neutral)) for f in free])


def neutral(free: Sequence[Free]) -> FloatArray:
    """The prior's centre, (p,)."""
    return np.array([f.neutral for f in free])


class _Ascent:
    """Levenberg–Marquardt on the log posterior.

    The expected information is too little curvature where the noise is not what the model thinks.
    A climb with fresh slopes learns from its steps what is lacking (Dennis, Gay and Welsch 1981):
    it ends at the top, where others stop on the way along a ridge.
    """

    def __init__(
        self,
        model: Model,
        hypothesis: Hypothesis,
        free: tuple[Free, ...],
        episodes: tuple[int, ...],
        moving: Sequence[int] | None,
        least: float,
        enough_nats: float | None = None,
    ) -> None:
        self._model, self._hypothesis, self._free = model, hypothesis, free
        self._episodes, self._moving, self._least = episodes, moving, least
        self._is_fresh = enough_nats is not None
        self._enough_nats = _ENOUGH_NATS if enough_nats is None else enough_nats
        self._lacking = np.zeros((len(free), len(free)))  # curvature beside the information
        self._gained = np.zeros(len(free))  # nats since each parameter's slopes were renewed
        self._precision = prior_precision(free)
        self._centre = neutral(free)

    def run(self, theta: FloatArray, slopes: Slopes | None) -> Fit:
        slopes = slopes if slopes is not None else self.slopes(theta, None)
        value = self._objective(slopes.scores, theta)
        damping, converged, gained = 1e-3, False, np.inf
        for _ in range(_ITERATIONS):
            tried, promised = self._tried(slopes, theta, damping)
            if promised < self._enough_nats:
                converged = True
                break
            if gained < _SLOW_NATS and value + _OPTIMISM * promised < self._least:
                break
            scores = self._scores(tried)
            reached = self._objective(scores, tried)
            if not reached > value:
                damping = max(10.0 * damping, 1e-2)
                if damping > 1e4:
                    break
                continue
            gained, value, before = reached - value, reached, (slopes, theta)
            damping = max(0.2 * damping, 1e-6)
            slopes, theta = self._renewed(slopes, tried, scores, gained), tried
            if self._is_fresh:
                self._learn(*before, slopes, theta)
        per_episode = np.array([s.log_density.sum() for s in slopes.scores])
        return Fit(
            self._hypothesis,
            self._free,
            self._episodes,
            theta,
            slopes,
            per_episode,
            converged=converged,
        )

    def _renewed(
        self, slopes: Slopes, theta: FloatArray, scores: tuple[Score, ...], gained: float
    ) -> Slopes:
        """Slopes of what has moved far enough to bend; all scores are new.

        Of the form, which is nearly linear, only once the climb is no longer far away.
        """
        if self._is_fresh:
            return self.slopes(theta, None, scores)
        if self._moving is not None:
            return self.slopes(theta, (slopes, self._moving), scores)
        self._gained += gained
        is_form = np.array([f.is_form for f in self._free])
        due = self._gained > np.where(is_form, _FORM_SETTLED_NATS, _SETTLED_NATS)
        due &= ~(is_form & (gained > _FAR_NATS))
        self._gained[due] = 0.0
        return self.slopes(theta, (slopes, np.flatnonzero(due).tolist()), scores)

    def _tried(self, slopes: Slopes, theta: FloatArray, damping: float) -> tuple[FloatArray, float]:
        """Where a step leads, (p,), and the nats that it promises."""
        gradient, information = self._gradient(slopes, theta), self._information(slopes)
        low, high = _bounds(self._free)
        extra = np.diag(damping * np.diag(information))
        curvature = information
        if self._is_fresh and _is_convex(information + self._lacking + extra):
            curvature = information + self._lacking
        tried = top_within(theta, gradient, curvature + extra, low, high)
        step = tried - theta
        return tried, float(gradient @ step - 0.5 * step @ curvature @ step)

    def _learn(
        self, slopes: Slopes, theta: FloatArray, slopes_there: Slopes, there: FloatArray
    ) -> None:
        """How the gradient changed along a step says what the information there lacks."""
        step = there - theta
        bend = self._gradient(slopes, theta) - self._gradient(slopes_there, there)
        missing = bend - self._information(slopes_there) @ step
        known = abs(float(step @ self._lacking @ step))
        if known > 0.0:
            self._lacking *= min(1.0, abs(float(step @ missing)) / known)
        along = float(bend @ step)
        if along > 0.0:
            rest = missing - self._lacking @ step
            both = np.outer(rest, bend) / along
            self._lacking += both + both.T - (rest @ step) * np.outer(bend, bend) / along**2

    def _gradient(self, slopes: Slopes, theta: FloatArray) -> FloatArray:
        """Of the log posterior, (p,)."""
        gradient = slopes.gradient().sum(0) - self._precision * (theta - self._centre)
        return np.asarray(gradient)

    def _information(self, slopes: Slopes) -> FloatArray:
        """Of all episodes and the prior, (p, p)."""
        return np.asarray(slopes.fisher().sum(0) + np.diag(self._precision))

    def _objective(self, scores: Sequence[Score], theta: FloatArray) -> float:
        return sum(float(s.log_density.sum()) for s in scores) + log_prior(self._free, theta)

    def _scores(self, theta: FloatArray) -> tuple[Score, ...]:
        return self._many(theta[None])[0]

    def _many(self, thetas: FloatArray) -> list[tuple[Score, ...]]:
        """All episodes under several parameter sets, at once where the model can."""
        return scores_of(self._model, self._hypothesis, thetas, self._episodes)

    def slopes(
        self,
        theta: FloatArray,
        known: tuple[Slopes, Sequence[int]] | None,
        scores: tuple[Score, ...] | None = None,
    ) -> Slopes:
        """Fresh, or `known` ones with some columns renewed."""
        here = scores if scores is not None else self._scores(theta)
        columns = range(len(theta)) if known is None else known[1]
        innovation = _columns(here, len(theta), None if known is None else known[0].innovation)
        variance = _columns(here, len(theta), None if known is None else known[0].variance)
        moved = [_moved(theta, column, self._free[column]) for column in columns]
        beside = self._many(np.array([m for m, _ in moved])) if moved else []
        for column, (_, size), aside in zip(columns, moved, beside, strict=True):
            for i, (s, there) in enumerate(zip(here, aside, strict=True)):
                innovation[i][:, column] = (there.innovation - s.innovation) / size
                variance[i][:, column] = (there.variance - s.variance) / size
        return Slopes(here, tuple(innovation), tuple(variance))


def _gradient(score: Score, de: FloatArray, dv: FloatArray) -> FloatArray:
    e, v, w = score.innovation, score.variance, score.weight
    return np.asarray(-(w * e / v) @ de + 0.5 * (w * (e * e / v - 1.0) / v) @ dv)


def _fisher(score: Score, de: FloatArray, dv: FloatArray) -> FloatArray:
    v, w = score.variance, score.weight
    return np.asarray(de.T @ (de * (w / v)[:, None]) + 0.5 * dv.T @ (dv * (w / (v * v))[:, None]))


def _columns(
    scores: Sequence[Score], count: int, known: Sequence[FloatArray] | None
) -> list[FloatArray]:
    if known is not None:
        return [k.copy() for k in known]
    return [np.zeros((len(s.innovation), count)) for s in scores]


def _moved(theta: FloatArray, column: int, free: Free) -> tuple[FloatArray, float]:
    """The parameters with one of them a difference step away, on the side that has room."""
    size = free.step if theta[column] + free.step <= free.high else -free.step
    moved = theta.copy()
    moved[column] += size
    return moved, size


def _bounds(free: Sequence[Free]) -> tuple[FloatArray, FloatArray]:
    return np.array([f.low for f in free]), np.array([f.high for f in free])


def prior_precision(free: Sequence[Free]) -> FloatArray:
    """One over the prior's variance, (p,)."""
    return np.array([1.0 / f.prior_sd**2 for f in free])


def log_prior(free: Sequence[Free], theta: FloatArray) -> float:
    """How far parameters (p,) are from their priors' centres, as nats; 0 at best."""
    return -0.5 * float(prior_precision(free) @ (theta - neutral(free)) ** 2)


def top_within(
    theta: FloatArray,
    gradient: FloatArray,
    curvature: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """The top (p,) of a parabola around `theta` (p,) between bounds, arrays (p,).

    Where a bound stops one parameter the others go as far as that leaves them: cut off by itself, a
    step along a ridge ends beside it. By active sets (Stark and Parker 1995). What a bound stops is
    at it to the last digit. What has no room stays, and everything where slopes are not finite.
    """
    top, free = theta.copy(), np.flatnonzero(low < high)
    theta, gradient, curvature = theta[free], gradient[free], curvature[np.ix_(free, free)]
    if not (len(free) and np.isfinite(gradient).all() and np.isfinite(curvature).all()):
        return top
    low, high = low[free], high[free]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    values, vectors = np.linalg.eigh(curvature * scale[:, None] * scale[None, :])
    told = values > _FLAT * values[-1]
    root, axes = np.sqrt(values[told]), vectors[:, told].T
    aim = axes @ (scale * gradient) / root
    step = axes.T @ (aim / root)
    lowest = np.minimum(low - theta, 0.0) / scale
    highest = np.maximum(high - theta, 0.0) / scale
    if (step < lowest).any() or (step > highest).any():
        step = lsq_linear(root[:, None] * axes, aim, (lowest, highest), method="bvls").x
    moved = np.clip(theta + scale * step, low, high)
    is_low, is_high = step < lowest + _FLAT, step > highest - _FLAT
    top[free] = np.where(is_low, low, np.where(is_high, high, moved))
    return top


def _is_convex(matrix: FloatArray) -> bool:
    """Whether a parabola of this symmetric curvature has a top."""
    scale = np.diag(matrix)
    if not (scale > 0.0).all():
        return False
    return bool(np.linalg.eigvalsh(matrix / np.sqrt(np.outer(scale, scale)))[0] > _FLAT)


def _solve(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Solve a symmetric system whose parameters may differ by many orders of magnitude."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-12))
    scaled = matrix * scale[:, None] * scale[None, :]
    return np.asarray(scale * np.linalg.lstsq(scaled, scale * vector, rcond=_FLAT)[0])
