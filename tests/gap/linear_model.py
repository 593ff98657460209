"""A linear-Gaussian model whose posterior, held-out densities and losses have closed forms."""

from collections.abc import Mapping

import numpy as np
from scipy.optimize import minimize
from scipy.stats import norm

from wakedeploy.gap.evidence.fits import Free, Score
from wakedeploy.gap.search.comparison import ComparisonDefaults

EPISODES, SAMPLES = 5, 60
CALIBRATED = {"gain": (0.4, 0.3), "offset": (-0.2, 0.5)}  # centre and deviation of the priors
EFFECTS = ("a", "b", "c")
EFFECT_SD = 3.0


class Linear(ComparisonDefaults):
    """Readings y = sum of columns times parameters + noise of known, uneven variance.

    Two calibrated constants with priors, and three effects of which two look alike.
    """

    def __init__(
        self,
        truth: Mapping[str, float],
        *,
        seed: int = 0,
        priors: Mapping[str, tuple[float, float]] = CALIBRATED,
        bounds: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        design = np.random.default_rng(1)
        shape = EPISODES, SAMPLES
        gain, offset, a, near, c = design.standard_normal((5, *shape))
        self.columns = {"gain": gain, "offset": offset, "a": a}
        self.columns |= {"b": a + 0.4 * near, "c": c + 0.5 * gain}
        self.variance = 0.5 + design.random(shape)
        noise = np.random.default_rng([seed, 2]).standard_normal(shape)
        self.y = noise * np.sqrt(self.variance)
        for name, size in truth.items():
            self.y = self.y + size * self.columns[name]
        self.priors, self.bounds = priors, bounds or {}
        self.scored: list[np.ndarray] = []

    @property
    def episodes(self) -> int:
        return EPISODES

    def free(self, hypothesis):
        calibrated = [
            Free(n, "1", *self.priors[n], *self._bounds(n), 0.05, quantity=n) for n in self.priors
        ]
        effects = [
            Free(f"{n}.size", "1", 0.0, EFFECT_SD, *self._bounds(n), 0.05, (0.5,))
            for n in hypothesis
        ]
        return (*calibrated, *effects)

    def score(self, hypothesis, theta, episode):
        self.scored.append(np.array(theta))
        names = (*self.priors, *hypothesis)
        rest = self.y[episode] - sum(
            size * self.columns[name][episode] for name, size in zip(names, theta, strict=True)
        )
        variance = self.variance[episode]
        density = norm.logpdf(rest, scale=np.sqrt(variance))
        return Score(density, rest, variance.copy(), np.ones(SAMPLES))

    def posterior(self, hypothesis, left_out=None):
        """Mean (p,) and covariance (p, p) by the normal equations; one episode may be left out."""
        kept = [e for e in range(EPISODES) if e != left_out]
        x, y, weight = self.stacked(hypothesis, kept)
        centre, precision = self._prior(hypothesis)
        information = x.T @ (weight[:, None] * x) + np.diag(precision)
        mean = np.linalg.solve(information, x.T @ (weight * y) + precision * centre)
        return mean, np.linalg.inv(information)

    def unseen_density(self, hypothesis, own):
        """Log density (E,) of each episode at the effects `own` that the other episodes prefer.

        By numerical search over the effects' sizes; everything else is at its best for all episodes
        together, given those sizes.
        """
        names = (*self.priors, *hypothesis)
        mine = [names.index(n) for n in own]
        rest = [i for i in range(len(names)) if i not in mine]
        x, y, weight = self.stacked(hypothesis, range(EPISODES))
        centre, precision = self._prior(hypothesis)
        a = x[:, rest]
        information = a.T @ (weight[:, None] * a) + np.diag(precision[rest])

        def whole(sizes):
            theta = np.empty(len(names))
            theta[mine] = sizes
            left = y - x[:, mine] @ sizes
            pull = a.T @ (weight * left) + (precision * centre)[rest]
            theta[rest] = np.linalg.solve(information, pull)
            return theta

        def densities(sizes):
            lost = norm.logpdf(y, loc=x @ whole(sizes), scale=weight**-0.5)
            return lost.reshape(EPISODES, -1).sum(axis=1)

        def against(sizes, left_out):
            prior = -0.5 * precision @ (whole(sizes) - centre) ** 2
            return -(np.delete(densities(sizes), left_out).sum() + prior)

        start = self.posterior(hypothesis)[0][mine]
        best = [minimize(against, start, (e,), tol=1e-12).x for e in range(EPISODES)]
        return np.array([densities(sizes)[e] for e, sizes in enumerate(best)])

    def seen_density(self, hypothesis):
        """Log density (E,) of each episode at the posterior mean of all."""
        x, y, weight = self.stacked(hypothesis, range(EPISODES))
        density = norm.logpdf(y, loc=x @ self.posterior(hypothesis)[0], scale=weight**-0.5)
        return density.reshape(EPISODES, -1).sum(axis=1)

    def prior_nats(self, hypothesis):
        """How far the posterior mean is from the priors' centres, at most 0."""
        centre, precision = self._prior(hypothesis)
        return -0.5 * float(precision @ (self.posterior(hypothesis)[0] - centre) ** 2)

    def stacked(self, hypothesis, episodes):
        """Columns (n, p), readings (n,) and one over their variance (n,)."""
        names = (*self.priors, *hypothesis)
        x = np.stack([self.columns[n][episodes].ravel() for n in names], axis=1)
        return x, self.y[episodes].ravel(), 1.0 / self.variance[episodes].ravel()

    def _prior(self, hypothesis):
        free = self.free(hypothesis)
        return np.array([f.neutral for f in free]), np.array([f.prior_sd**-2.0 for f in free])

    def _bounds(self, name):
        return self.bounds.get(name, (-50.0, 50.0))
