"""Which effect a system lacks: all candidates looked at around the base, the best ones climbed.

In: a `Comparison` and a fit of what is known. Out: candidates ranked by what they gain on episodes
that they were not fitted to, the gain that chance alone would bring, and what sealed ones say.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.inference import (
    LOST_NATS,
    Fit,
    FloatArray,
    Free,
    Hypothesis,
    Score,
    Slopes,
    extended,
    fit,
    prior_precision,
    scores_of,
)
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.evidence.separation import whitened
from wakedeploy.gap.progress import Steps, uncounted
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.comparison import Comparison

CLIMBED = 5  # candidates that are fitted to the end
DRAWS = 200  # of what chance would bring
_PARTS = (1.0, 0.3, 0.1)  # of a step, as far as the likelihood rises
_SIMPLER_KINDS = {
    "pre-sliding-friction": ("coulomb-friction",),
    "stribeck-friction": ("coulomb-friction",),
    "hysteresis": ("coulomb-friction", "pre-sliding-friction"),
    "second-order-lag": ("lag", "dead-time"),
    "periodic-force": ("offset", "gravity"),
}


@dataclass(frozen=True, eq=False)
class Look:
    """A candidate around the base: the best point that one step reaches, and slopes there."""

    name: str
    fit: Fit
    columns: tuple[FloatArray, ...]  # whitened slopes of its own at each start, (2n, k)


@dataclass(frozen=True)
class Weight:
    """What an effect does on sealed blocks: the share of squared forecast error that it removes."""

    share: float
    low: float
    high: float

    @property
    def matters(self) -> bool:
        """Whether the forecast gets better by it."""
        return self.share >= RULES.least_share and self.low > 0.0


def ranked(
    model: Comparison, base: Fit, names: Sequence[str], steps: Steps = uncounted
) -> tuple[list[Candidate], float]:
    """Candidates on top of `base`, best first, and the gain that chance brings [nats]."""
    looks = []
    for i, name in enumerate(names):
        looks.append(look(model, base, name))
        steps(i + 1, len(names) + CLIMBED)
    order = sorted(looks, key=lambda one: -one.fit.objective)
    found = []
    for i, seen in enumerate(order):
        fitted = seen.fit
        if i < CLIMBED and fitted.objective > base.objective + RULES.least_nats:
            fitted = fit(model, fitted.hypothesis, base.episodes, fitted.theta)
            steps(len(names) + i + 1, len(names) + CLIMBED)
        found.append(candidate(base, seen.name, fitted))
    best_first = sorted(found, key=lambda c: -c.gain_nats)
    return best_first, chance_nats(base, looks)


def chance_nats(base: Fit, looks: Sequence[Look], seed: int = 0) -> float:
    """The best gain of any candidate that innovations of noise alone would bring, in 19 of 20.

    Noise is drawn anew around the base, with form and constants wrong by what their priors allow;
    signs of whole blocks of the innovations are turned as well, which keeps what colours them.
    """
    rng = np.random.default_rng(seed)
    known = np.concatenate(whitened(base.slopes))
    prior = np.sqrt(prior_precision(base.free))
    q, _ = np.linalg.qr(np.vstack([known, np.diag(prior)]))
    draws = np.hstack([_noise(base, known, rng), _turned(base, rng)])
    padded = np.vstack([draws, np.zeros((len(prior), draws.shape[1]))])
    rest = padded - q @ (q.T @ padded)
    best = np.zeros(draws.shape[1])
    for seen in looks:
        for own in seen.columns:
            gains = _projected(own, len(prior), q, rest)
            best = np.maximum(best, gains - own.shape[1])
    half = draws.shape[1] // 2
    each = [
        float(np.quantile(part, 1.0 - RULES.false_alarms)) for part in (best[:half], best[half:])
    ]
    return max(*each, RULES.least_nats)


def weighed(model: Comparison, before: Fit, after: Fit, sealed: Sequence[int]) -> Weight:
    """What the larger fit removes of the forecast error of the smaller, on sealed blocks."""
    pair = [model.disagreements(f, sealed) for f in (before, after)]
    errors = [_parts(one, model.horizon) for one in pair]
    was, now = errors
    if not np.all(np.isfinite(now)):
        return Weight(-1.0, -1.0, -1.0)
    usual = was.sum(0)
    was, now = (e @ (1.0 / np.where(usual > 0.0, usual, 1.0)) for e in (was, now))
    share = 1.0 - float(now.sum() / was.sum())
    count = len(was)
    if count < 3:
        return Weight(share, -1.0, 1.0)
    left_out = 1.0 - (now.sum() - now) / (was.sum() - was)
    reach = float(student_t.ppf(0.95, count - 1))
    reach *= float(np.sqrt((count - 1) ** 2 / count * np.var(left_out, ddof=1)))
    return Weight(share, share - reach, min(share + reach, 1.0))


def _parts(errors: Sequence[FloatArray], horizon: int) -> FloatArray:
    """Sums of squares over stretches of a few horizons, (stretches, channels)."""
    sums = []
    for block in errors:
        for part in np.array_split(block, max(block.shape[1] // (2 * horizon), 1), axis=1):
            sums.append(np.nansum(part**2, axis=1))
    return np.array(sums)


def look(model: Comparison, base: Fit, name: str) -> Look:
    """All starts of a candidate at once: its own slopes there, and a step of everything."""
    hypothesis = (*base.hypothesis, name)
    free = model.free(hypothesis)
    own = [i for i, f in enumerate(free) if f.name.startswith(f"{name}.")]
    origin = extended(base, free)
    starts = _starts(origin, free, own)
    moved = [_aside(start, free, i) for start in starts for i in own]
    thetas = np.array([*starts, *(m for m, _ in moved)])
    scores = scores_of(model, hypothesis, thetas, base.episodes)
    reached, columns, slopes_of = [], [], []
    for k, start in enumerate(starts):
        places = range(k * len(own), (k + 1) * len(own))
        here = scores[k]
        slopes = _slopes(base, free, here, own, [
            (scores[len(starts) + p], moved[p][1]) for p in places
        ])  # fmt: skip
        columns.append(np.concatenate(whitened(slopes))[:, own])
        for part in _PARTS:
            reached.append(_newton(base, free, start, slopes, part))
            slopes_of.append(slopes)
    again = scores_of(model, hypothesis, np.array(reached), base.episodes)
    tried = [*zip(reached, again, slopes_of, strict=True)]
    tried += [*zip(starts, scores[: len(starts)], slopes_of[:: len(_PARTS)], strict=True)]
    fits = [_fit(hypothesis, free, base.episodes, *one) for one in tried]
    best = max(fits, key=lambda f: f.objective)
    return Look(name, best, tuple(columns))


def _starts(origin: FloatArray, free: Sequence[Free], own: Sequence[int]) -> list[FloatArray]:
    """Nearly nothing of the effect, and each of its starts."""
    count = max(len(free[i].starts) for i in own)
    starts = []
    for k in range(count):
        start = origin.copy()
        for i in own:
            of = free[i].starts or (free[i].neutral,)
            start[i] = np.clip(of[min(k, len(of) - 1)], free[i].low, free[i].high)
        starts.append(start)
    return starts


def _aside(theta: FloatArray, free: Sequence[Free], i: int) -> tuple[FloatArray, float]:
    size = free[i].step if theta[i] + free[i].step <= free[i].high else -free[i].step
    moved = theta.copy()
    moved[i] += size
    return moved, size


def _slopes(
    base: Fit,
    free: Sequence[Free],
    here: tuple[Score, ...],
    own: Sequence[int],
    beside: Sequence[tuple[tuple[Score, ...], float]],
) -> Slopes:
    """The base's slopes for what is shared, fresh ones for the effect's own."""
    place = {name: i for i, name in enumerate(base.names)}
    innovation, variance = [], []
    for e, score in enumerate(here):
        de, dv = (np.zeros((len(score.innovation), len(free))) for _ in range(2))
        for i, f in enumerate(free):
            if f.name in place:
                de[:, i] = base.slopes.innovation[e][:, place[f.name]]
                dv[:, i] = base.slopes.variance[e][:, place[f.name]]
        for i, (there, size) in zip(own, beside, strict=True):
            seen = (there[e].log_density > LOST_NATS) & (score.log_density > LOST_NATS)
            de[:, i] = np.where(seen, there[e].innovation - score.innovation, 0.0) / size
            dv[:, i] = np.where(seen, there[e].variance - score.variance, 0.0) / size
        innovation.append(de)
        variance.append(dv)
    return Slopes(here, tuple(innovation), tuple(variance))


def _newton(
    base: Fit, free: Sequence[Free], start: FloatArray, slopes: Slopes, part: float
) -> FloatArray:
    """A part of one step of all parameters from a start, within their bounds."""
    precision = prior_precision(free)
    centre = np.array([f.neutral for f in free])
    gradient = slopes.gradient().sum(0) - precision * (start - centre)
    curvature = slopes.fisher().sum(0) + np.diag(precision)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    scaled = curvature * scale[:, None] * scale[None, :] + 1e-6 * np.eye(len(scale))
    step = scale * np.linalg.lstsq(scaled, scale * gradient, rcond=1e-10)[0]
    low, high = np.array([f.low for f in free]), np.array([f.high for f in free])
    return np.asarray(np.clip(start + part * np.nan_to_num(step), low, high))


def _fit(
    hypothesis: Hypothesis,
    free: tuple[Free, ...],
    episodes: tuple[int, ...],
    theta: FloatArray,
    scores: tuple[Score, ...],
    slopes: Slopes,
) -> Fit:
    """Slopes of a start stand for those of the point that was reached from it."""
    density = np.array([s.log_density.sum() for s in scores])
    slopes = Slopes(scores, slopes.innovation, slopes.variance)
    return Fit(hypothesis, free, episodes, theta, slopes, density)


def _noise(base: Fit, known: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Noise in the units of whitened slopes, and nuisances as far off as their priors say."""
    told = np.concatenate([
        np.concatenate([np.sqrt(s.weight) * (s.log_density != 0.0)] * 2) for s in base.slopes.scores
    ])  # fmt: skip
    noise = rng.standard_normal((len(told), DRAWS)) * told[:, None]
    formal = [i for i, f in enumerate(base.free) if f.name.startswith("form.")]
    sd = np.array([base.free[i].prior_sd for i in formal])
    return np.asarray(
        noise + known[:, formal] @ (sd[:, None] * rng.standard_normal((len(sd), DRAWS)))
    )


def _turned(base: Fit, rng: np.random.Generator) -> FloatArray:
    """The base's own whitened innovations, blocks of them with signs turned, (2n, DRAWS)."""
    parts = []
    for score in base.slopes.scores:
        white = score.white
        count = max(len(white) // 50, 4)
        signs = rng.choice((-1.0, 1.0), (count, DRAWS))
        of = np.minimum(np.arange(len(white)) * count // len(white), count - 1)
        spread = np.sqrt(score.weight) * (white**2 - 1.0) / 2.0**0.5 * (score.log_density != 0.0)
        parts += [white[:, None] * signs[of], spread[:, None] * signs[of]]
    return np.concatenate(parts)


def _projected(own: FloatArray, padding: int, q: FloatArray, rest: FloatArray) -> FloatArray:
    """Half the square of what directions explain of draws, known directions removed, (draws,)."""
    padded = np.vstack([own, np.zeros((padding, own.shape[1]))])
    left = padded - q @ (q.T @ padded)
    norm = np.linalg.norm(left, axis=0)
    there = norm > 1e-8 * np.maximum(np.linalg.norm(padded, axis=0), 1e-300)
    if not there.any():
        return np.zeros(rest.shape[1])
    basis, _ = np.linalg.qr(left[:, there] / norm[there])
    return np.asarray(0.5 * ((basis.T @ rest) ** 2).sum(0))


def elaborates(name: str, other: str) -> bool:
    """Whether an effect is the same as another with more to it, at the same port."""
    kind, _, port = name.partition("@")
    plainer, _, there = other.partition("@")
    return port == there and plainer in _SIMPLER_KINDS.get(kind, ())


def simpler(model: Comparison, base: Fit, best: Candidate) -> Candidate:
    """A simpler kind at the same port, from the best one's point, if it gains nearly as much."""
    kind, _, port = best.name.partition("@")
    for plainer in _SIMPLER_KINDS.get(kind, ()):
        name = f"{plainer}@{port}"
        if name not in model.effects or name in base.hypothesis:
            continue
        values = {n.replace(f"{best.name}.", f"{name}."): best.fit.value(n) for n in best.fit.names}
        hypothesis = (*base.hypothesis, name)
        start = np.array([values.get(f.name, f.neutral) for f in model.free(hypothesis)])
        one = candidate(base, name, fit(model, hypothesis, base.episodes, start))
        if one.gain_nats >= RULES.simpler_share * best.gain_nats:
            return one
    return best
