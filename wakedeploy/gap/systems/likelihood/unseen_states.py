"""States that no output shows, as the model has them along a log: a first guess, nothing fitted.

In: a filter over logs, and the states that are shown along them. Out: all states at every sample.
If a piece of a log starts an actuator at 0, that looks like a lag; started where its command had
brought it, it does not.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.filter import Driving, Filter, Stepping, points_around
from wakedeploy.physics.series import IntArray

_LANE, _BEFORE = 5000, 2000  # samples of a long log that a lane follows, and those before them
_NEWTON = 20  # steps to where states are at rest
_AT_REST = 1e-6  # of how far away rest is
_SINGULAR = 1e-9  # of the fastest rate of a state: a slower one never comes to rest
_GROWS = 10.0  # times what a state was off by: beyond, it is lost without readings


def followed(
    alone: Filter,
    acting: Acting,
    shown: Mapping[str, FloatArray],
    anywhere: Sequence[str],
    constants: Mapping[str, float],
) -> FloatArray:
    """States (n, N) along every log: those `shown` (N,) by name, the others by the model.

    States that begin `anywhere` begin where the first sample, held, would have brought them to
    rest. If there is no rest, they begin as the filter's starts say, and so do all others. A long
    log is followed in parts side by side. If the model would lose itself without readings, as an
    unstable one does, the starts are kept. `constants` replace the stated ones.
    """
    follower = _Follower(alone, acting, shown, anywhere, constants)
    try:
        with np.errstate(all="ignore"):
            return follower.run()
    except UnusableInput:  # a state far away, where nobody else asks the user's functions
        return alone.guesses


def _kept(acting: Acting, shown: Mapping[str, FloatArray]) -> list[str]:
    """States that are not followed: those shown, and those that drive these and are driven by them.

    The speed of a measured position goes wherever the model's forces err, as nothing holds it.
    """
    system = acting.system
    driven_by = {n: system.drivers(n) for n in system.states}
    looped = [
        n
        for n in system.states
        if n not in shown and driven_by[n] & set(shown) and any(n in driven_by[t] for t in shown)
    ]
    return [*shown, *looped]


class _Follower:
    def __init__(
        self,
        alone: Filter,
        acting: Acting,
        shown: Mapping[str, FloatArray],
        anywhere: Sequence[str],
        constants: Mapping[str, float],
    ) -> None:
        self._alone, self._acting = alone, acting
        self._values = {n: np.array([[v]]) for n, v in {"nothing": 0.0, **constants}.items()}
        self._inputs = alone.arriving(acting, {n: v[0] for n, v in self._values.items()})
        kept = _kept(acting, shown)
        self._shown = [acting.states.index(n) for n in kept]
        rows = [shown.get(n, alone.guesses[i]) for n, i in zip(kept, self._shown, strict=True)]
        self._rows = np.array(rows).reshape(len(kept), alone.guesses.shape[1])
        self._anywhere = [acting.states.index(n) for n in anywhere if n not in kept]
        self._hidden = [i for i in range(len(acting.states)) if i not in self._shown]
        now_s = np.zeros((1, 1))
        self._given = (acting.constants(self._values, now_s), self._values, now_s)

    def run(self) -> FloatArray:
        """States (n, N)."""
        states = self._alone.guesses.copy()
        firsts, begins, ends = self._lanes()
        at_first = self._rested(states[:, firsts], firsts)
        beside = at_first.copy()
        beside[self._hidden] += self._sizes()[self._hidden, None]
        x = np.concatenate([at_first, beside], axis=1)
        count, is_lost = len(firsts), np.zeros(len(firsts), dtype=bool)
        reach = np.abs(beside - at_first)[self._hidden]
        stepping = Stepping(self._acting, self._alone.aside(self._acting, 2 * count))
        p = np.zeros((len(x), *x.shape))
        for t in range(int((ends - firsts).max())):
            at = np.minimum(firsts + t, ends - 1)
            x[self._shown] = np.tile(self._rows[:, at], 2)
            apart = np.abs(x[:, count:] - x[:, :count])[self._hidden]
            is_lost |= ~(apart <= _GROWS * reach).all(0)
            goes_on = (firsts + t >= begins) & (firsts + t < ends) & ~is_lost
            states[:, at[goes_on]] = x[:, :count][:, goes_on]
            self._on(stepping, x, p, np.tile(at, 2))
        for log in range(len(self._alone.logs)):
            where = slice(*self._alone.ends(log))
            if is_lost[(begins >= where.start) & (begins < where.stop)].any():
                states[:, where] = self._alone.guesses[:, where]
        return states

    def _lanes(self) -> tuple[IntArray, IntArray, IntArray]:
        """Where lanes begin, where they start to count, and where they end."""
        lanes = []
        for log in range(len(self._alone.logs)):
            first, end = self._alone.ends(log)
            for begin in range(first, end, _LANE):
                lanes.append((max(begin - _BEFORE, first), begin, min(begin + _LANE, end)))
        firsts, begins, ends = np.array(lanes).T
        return firsts, begins, ends

    def _sizes(self) -> FloatArray:
        """How far beside a state (n,) another begins, to see whether both come together."""
        return np.array([self._acting.sizes[n] for n in self._acting.states])

    def _on(self, stepping: Stepping, x: FloatArray, p: FloatArray, at: IntArray) -> None:
        """The states a sample later; what is shown keeps its value in all steps of one sample."""
        steps = self._acting.system.steps
        for j in range(steps):
            stepping.on(x, p, self._inputs.at(0, steps * at + j), *self._given)
            x[:, ~np.isfinite(x).all(0)] = np.inf

    def _rested(self, x: FloatArray, at: IntArray) -> FloatArray:
        """States (n, L); those that begin anywhere rest under the inputs at `at`, if they can.

        A state that never rests, as a distance, stays where it is; the others rest beside it.
        """
        x = x.copy()
        x[self._shown] = self._rows[:, at]
        u = self._inputs.at(0, self._acting.system.steps * at)
        for lane in range(len(at)):
            driving = Driving({n: v[:, lane : lane + 1] for n, v in u.mean.items()}, {}, {})
            x[:, lane] = self._rest(x[:, lane : lane + 1], driving)[:, 0]
        return x

    def _rest(self, x: FloatArray, u: Driving) -> FloatArray:
        """The same for one lane, (n, 1): Newton's method on the states that can rest."""
        _, slopes = self._slopes(x, u)
        free = list(self._anywhere)
        fastest = max(float(np.abs(slopes).max()), 1e-300)
        free = [i for i in free if np.abs(slopes[i, free]).max(initial=0.0) > _SINGULAR * fastest]
        tried = x.copy()
        for _ in range(_NEWTON if free else 0):
            rates, slopes = self._slopes(tried, u)
            if not (np.isfinite(rates).all() and np.isfinite(slopes).all()):
                return x
            step = np.linalg.lstsq(slopes[np.ix_(free, free)], -rates[free], rcond=None)[0]
            tried[free, 0] += step
            if np.abs(step).max() <= _AT_REST * np.abs(tried - x).max():
                is_stable = bool((np.linalg.eigvals(slopes[np.ix_(free, free)]).real < 0.0).all())
                return tried if is_stable else x
        return x

    def _slopes(self, x: FloatArray, u: Driving) -> tuple[FloatArray, FloatArray]:
        """Rates (n,) at states (n, 1), and their Jacobian (n, n)."""
        aside = self._alone.aside(self._acting, 1)
        points = points_around(x, aside)
        rates = self._acting.rates(points, u.mean, *self._given)[..., 0]
        if self._acting.system.has_step:
            rates = rates - points[..., 0]
        return rates[:, 0], (rates[:, 1:] - rates[:, :1]) / aside.T
