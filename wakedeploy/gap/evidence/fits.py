"""What a hypothesis leaves free, how it scores an episode, and what a fit of it says.

The log density is Gaussian in innovations with outliers weighted down, so that first derivatives
of innovation and variance give gradient and Fisher information (Gauss–Newton).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student_t

FloatArray = npt.NDArray[np.float64]
LOST_NATS = -1e6  # log density of a sample whose state has left the model
Hypothesis = tuple[str, ...]

FLAT = 1e-10  # a scaled curvature or step below this is rounding


@dataclass(frozen=True)
class Free:
    """A parameter that a fit may move: prior N(neutral, prior_sd²) within [low, high].

    `step` is how far a finite difference reaches; an infinite `prior_sd` is a flat prior. Two
    parameters with the same `quantity` are one thing under two names, as a calibrated constant and
    the effect that replaces it; a larger hypothesis then starts from the smaller one's value.
    `scanned` are sizes to look at before a climb, where a likelihood is jagged; `finest` and
    `finest_share` (of the size) are the least standard error that may be stated. `adds_to` is
    the calibrated constant that a parameter moves without replacing it. `first` is where a first
    fit begins, if not at neutral: loud noise turns nothing into an outlier. `is_form` marks a
    parameter of the model's own shape: if it is bent, the calibration need not be wrong.
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
    probability that the sample is no outlier. `channels` are the places of each channel's samples,
    in order of time; a sample in no channel is auxiliary, as a mean at rest.
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


def own_places(free: Sequence[Free], effect: str) -> list[int]:
    """Where an effect's own parameters stand."""
    return [i for i, f in enumerate(free) if f.name.startswith(f"{effect}.")]


def own_parameters(free: Sequence[Free], effect: str) -> list[Free]:
    """An effect's own parameters."""
    return [free[i] for i in own_places(free, effect)]


def densities(scores: Sequence[Score]) -> FloatArray:
    """The log likelihood of each episode, (E,) nats."""
    return np.array([s.log_density.sum() for s in scores])


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
    """Episodes under parameter sets (K, p): for each set, a score of each episode.

    A model with a method `scores` of the same arguments scores all sets in about the time of one.
    """
    together = getattr(model, "scores", None)
    if together is not None:
        found: list[tuple[Score, ...]] = together(hypothesis, thetas, episodes)
        return found
    # Set after set of one episode: a model keeps what of an episode many sets share.
    of_each = [[model.score(hypothesis, theta, e) for theta in thetas] for e in episodes]
    return [tuple(of_episode[k] for of_episode in of_each) for k in range(len(thetas))]


def sets_at_once(model: Model, episodes: Sequence[int]) -> int:
    """How many parameter sets a model scores in at most twice the time of one."""
    counted = getattr(model, "sets_at_once", None)
    return 1 if counted is None else int(counted(episodes))


@dataclass(frozen=True, eq=False)
class Slopes:
    """Scores of several episodes and their derivatives by every parameter."""

    scores: tuple[Score, ...]
    innovation: tuple[FloatArray, ...]  # (n, p) each
    variance: tuple[FloatArray, ...]  # (n, p) each

    def gradient(self) -> FloatArray:
        """The gradient of each episode's log likelihood, (E, p)."""
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


NO_SLOPES = Slopes((), (), ())  # of a point that is yet to be scored, or whose slopes none asks


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis at its maximum a posteriori; everything per episode (E, …).

    `summits` are fits of the same hypothesis elsewhere that these episodes cannot tell from it.
    `converged` says that its climb ended where no step promised anything. `profiled` are, by
    parameter, ends that no interval exceeds, where the likelihood is no parabola.
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
        """The log likelihood of all episodes, without the priors [nats]."""
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
        """The same for calibrated constants alone, without noise and the model's form [nats]."""
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
        """The larger of two: from the curvature, and from the spread between episodes.

        The curvature does not show what the model lacks, and the spread of a few episodes may be
        small by chance. The spread is the jackknife's, clustered by episode, plus the priors' own.
        """
        free = self.free[self._index(name)]
        finest = max(free.finest, free.finest_share * abs(self.value(name)))
        return max(float(np.sqrt(max(self._variances(name)))), finest)

    def interval(self, name: str, level: float = 0.9) -> tuple[float, float]:
        """Where the parameter lies with this probability, clipped to its bounds.

        It reaches from the lowest to the highest end that any of the summits has. The quantile is
        Student's: with one degree of freedom less than there are episodes where their spread
        decides, with twice as many where the curvature bears it out.
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
        """An estimate's variance by curvature, and by the spread between episodes (0 for one)."""
        gradient, fisher = self.slopes.gradient(), self.slopes.fisher()
        at = self._index(name)
        low, high = bounds_of(self.free)
        free = (self.theta > low) & (self.theta < high)  # at its bound a parameter follows nothing
        free[at] = True
        gradient, fisher = gradient[:, free], fisher[:, free][:, :, free]
        prior = np.diag(prior_precision(self.free)[free])
        unit = np.eye(len(prior))[np.count_nonzero(free[:at])]
        total, count = fisher.sum(0) + prior, len(gradient)
        inverse = solved(total, unit)
        curvature = float(inverse @ unit)
        if count < 2:
            return curvature, 0.0
        # An episode's pull on the estimate is weighed without its own information: many parameters
        # bend to each of a few episodes, so that its gradient shows too little of the pull. The
        # others' are summed: a difference of large numbers would leave rounding.
        pulls = [
            solved(np.delete(fisher, e, axis=0).sum(0) + prior, unit) @ g
            for e, g in enumerate(gradient)
        ]
        spread = float(np.var(pulls, ddof=1)) * (count - 1) ** 2 / count
        return curvature, spread + float(inverse @ prior @ inverse)

    def _index(self, name: str) -> int:
        try:
            return self.names.index(name)
        except ValueError as error:
            raise KeyError(f"{name!r} is not free under {self.hypothesis}") from error


def told_by_data(fitted: Fit, effect: str) -> Fit:
    """The fit without the priors on an effect's size, to second order.

    A prior keeps a search where effects may be, but would draw the size that data show towards 0. A
    parameter keeps its prior if that says more of it than the data do, so that a shape the data
    leave open stays where it is plausible.
    """
    total = fitted.slopes.fisher().sum(0) + np.diag(prior_precision(fitted.free))
    places = [
        i
        for i, f in enumerate(fitted.free)
        if f.name.startswith(f"{effect}.") and np.isfinite(f.prior_sd) and _is_within(f, fitted, i)
    ]
    while places and not _is_told(total, places, [fitted.free[i].prior_sd for i in places]):
        places.pop(_least_told(total, places, [fitted.free[i].prior_sd for i in places]))
    if not places:
        return fitted
    precision = np.array([1.0 / fitted.free[i].prior_sd ** 2 for i in places])
    alone, pull = total.copy(), np.zeros(len(total))
    alone[places, places] -= precision
    pull[places] = [
        (fitted.theta[i] - fitted.free[i].neutral) * p
        for i, p in zip(places, precision, strict=True)
    ]
    theta = np.clip(fitted.theta + solved(alone, pull), *bounds_of(fitted.free))
    free = tuple(
        replace(f, prior_sd=np.inf) if i in places else f for i, f in enumerate(fitted.free)
    )
    summits = tuple(told_by_data(summit, effect) for summit in fitted.summits)
    return replace(fitted, theta=theta, free=free, summits=summits)


def _information(total: FloatArray, asked: Sequence[int], prior_sd: Sequence[float]) -> FloatArray:
    """The data's information on parameters (k, k), all else following, in units of the priors'."""
    rest = [i for i in range(len(total)) if i not in asked]
    follow = np.array([solved(total[np.ix_(rest, rest)], total[rest, i]) for i in asked])
    remaining = total[np.ix_(asked, asked)] - total[np.ix_(asked, rest)] @ follow.T
    sd = np.asarray(prior_sd)
    return np.asarray(remaining * sd[:, None] * sd[None, :] - np.eye(len(asked)))


def _is_told(total: FloatArray, asked: Sequence[int], prior_sd: Sequence[float]) -> bool:
    """Whether the data say more than the priors of every combination of some parameters."""
    return bool(np.linalg.eigvalsh(_information(total, asked, prior_sd)).min() > 1.0)


def _least_told(total: FloatArray, asked: Sequence[int], prior_sd: Sequence[float]) -> int:
    """The place of the parameter with the largest part in what the data say least of."""
    _, vectors = np.linalg.eigh(_information(total, asked, prior_sd))
    return int(np.argmax(np.abs(vectors[:, 0])))


def _is_within(free: Free, fitted: Fit, place: int) -> bool:
    """Whether a parameter is off its bounds; at a bound it follows nothing."""
    return bool(free.low < fitted.theta[place] < free.high)


def extended(base: Fit, free: Sequence[Free]) -> FloatArray:
    """Parameters (p,) of a larger hypothesis: the base's where shared, else neutral."""
    known = dict(zip(base.names, base.theta, strict=True))
    same = {f.quantity: v for f, v in zip(base.free, base.theta, strict=True) if f.quantity}
    return np.array([known.get(f.name, same.get(f.quantity, f.neutral)) for f in free])


def neutral(free: Sequence[Free]) -> FloatArray:
    """The prior's centre, (p,)."""
    return np.array([f.neutral for f in free])


def _gradient(score: Score, de: FloatArray, dv: FloatArray) -> FloatArray:
    e, v, w = score.innovation, score.variance, score.weight
    return np.asarray(-(w * e / v) @ de + 0.5 * (w * (e * e / v - 1.0) / v) @ dv)


def _fisher(score: Score, de: FloatArray, dv: FloatArray) -> FloatArray:
    v, w = score.variance, score.weight
    return np.asarray(de.T @ (de * (w / v)[:, None]) + 0.5 * dv.T @ (dv * (w / (v * v))[:, None]))


def bounds_of(free: Sequence[Free]) -> tuple[FloatArray, FloatArray]:
    """The least and the largest values, (p,) each."""
    return np.array([f.low for f in free]), np.array([f.high for f in free])


def prior_precision(free: Sequence[Free]) -> FloatArray:
    """One over the prior's variance, (p,)."""
    return np.array([1.0 / f.prior_sd**2 for f in free])


def log_prior(free: Sequence[Free], theta: FloatArray) -> float:
    """How far parameters (p,) are from their priors' centres, as nats; 0 at best."""
    return -0.5 * float(prior_precision(free) @ (theta - neutral(free)) ** 2)


def solved(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Solve a symmetric system whose parameters may differ by many orders of magnitude."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-12))
    scaled = matrix * scale[:, None] * scale[None, :]
    return np.asarray(scale * np.linalg.lstsq(scaled, scale * vector, rcond=FLAT)[0])
