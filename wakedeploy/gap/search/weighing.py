"""What an effect does to forecasts: the share of their squared error that it removes.

In: a `Comparison`, fits without and with an effect. Out: the share with its interval. Each stretch
of the fit's blocks is forecast with parameters that other blocks prefer (cross-fitting), so that
these blocks can decide; sealed blocks take no part in that, and report. A size that was scanned
for stays as all blocks have it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.ascent import top_within
from wakedeploy.gap.evidence.fits import Fit, FloatArray, bounds_of, prior_precision
from wakedeploy.gap.evidence.inference import applied
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.comparison import Comparison, errors

_FOLDS = 4
_ROUNDING = 1e-12  # of the largest channel's error
_FARTHEST = 16.0  # square of the largest step [sd] that leaving blocks out may take


@dataclass(frozen=True)
class Weight:
    """The share of squared forecast error that an effect removes."""

    share: float
    low: float
    high: float

    @property
    def matters(self) -> bool:
        """Whether it makes the forecast better, by four chances to one.

        This asks whether the effect is worth anything; that it is there, evidence has said.
        """
        return self.share >= RULES.least_share and self.share + self.low > 0.0


def weighed(model: Comparison, before: Fit, after: Fit, episodes: Sequence[int]) -> Weight:
    """The weight on blocks that neither fit has seen."""
    was, now = (stretches(model, model.disagreements(f, episodes)) for f in (before, after))
    return weight_of(was, now)


def helps(model: Comparison, before: Fit, after: Fit, episodes: Sequence[int]) -> bool:
    """Whether blocks that neither fit has seen bear an effect out.

    They do if forecasts get better on average, also with none of them cut short. If forecasts are
    as good with the effect as without, the likelihood of all their samples decides.
    """
    weight, worse = weighed(model, before, after, episodes), _worse(model, before, after, episodes)
    if weight.share > 0.0 and worse < 0.0:
        return True
    if weight.high <= 0.0 or worse > RULES.least_share:
        return False
    gained = [applied(model, fitted, episodes).log_likelihood for fitted in (before, after)]
    return gained[1] - gained[0] > RULES.speaks_nats


def _worse(model: Comparison, before: Fit, after: Fit, episodes: Sequence[int]) -> float:
    """The mean share by which a channel's squared error grows; negative where it falls."""
    was, now = (np.square(errors(model, fitted, episodes)) for fitted in (before, after))
    # Without channels that nothing forecasts, or that are right but for rounding.
    erring = was > _ROUNDING**2 * np.nanmax(was, initial=0.0)
    if not erring.any():
        return -1.0
    worse = float(np.mean(now[erring] / was[erring])) - 1.0
    return worse if np.isfinite(worse) else np.inf


def crossed(model: Comparison, fitted: Fit) -> FloatArray:
    """Squared errors (stretches, channels), each with parameters that the other blocks prefer."""
    return stretches(model, _crossed_errors(model, fitted))


def removes_most(model: Comparison, before: Fit, after: Fit) -> bool:
    """Whether an effect surely removes most of the error, each block of logs counting as one.

    Stretches of one block would lend each other weight, and one loud block decide for all.
    """
    was, now = (
        np.array([np.nansum(np.square(block), axis=1) for block in _crossed_errors(model, fitted)])
        for fitted in (before, after)
    )
    if not np.all(np.isfinite(now)):
        return False
    was, now = _summed(was, now)
    cap = RULES.far_stretch * float(np.median(was)) or np.inf
    return _removed(was, now, cap).low > RULES.surely_share


def _crossed_errors(model: Comparison, fitted: Fit) -> Sequence[FloatArray]:
    """Errors of each block (channels, n), with parameters that the other blocks prefer."""
    count = len(fitted.episodes)
    folds = np.array_split(np.arange(count), min(_FOLDS, count))
    thetas = np.array([without(fitted, fold.tolist()) for fold in folds])
    sets = np.repeat(np.arange(len(folds)), [len(f) for f in folds]).tolist()
    return model.crossed_disagreements(fitted, thetas, sets)


def unseen(model: Comparison, fitted: Fit) -> FloatArray:
    """Squared errors of sealed stretches, (stretches, channels)."""
    return stretches(model, model.disagreements(fitted, model.sealed()))


def unfitted(model: Comparison, fitted: Fit) -> FloatArray:
    """Squared errors of all stretches, (stretches, channels), with parameters of other blocks."""
    return np.concatenate([crossed(model, fitted), unseen(model, fitted)])


def without(fitted: Fit, places: Sequence[int]) -> FloatArray:
    """The parameters (p,) that a fit's episodes prefer without those at `places`."""
    if len(places) == len(fitted.episodes):
        return fitted.theta
    gradient = fitted.slopes.gradient()[places].sum(0)
    fisher = fitted.slopes.fisher()
    rest = fisher.sum(0) - fisher[places].sum(0) + np.diag(prior_precision(fitted.free))
    low, high = bounds_of(fitted.free)
    stuck = (fitted.theta <= low) | (fitted.theta >= high)  # at its bound one follows no episode
    # Where a likelihood is jagged, its slope does not show where other blocks would have a size.
    stuck |= np.array([bool(f.scanned) for f in fitted.free])
    low, high = (np.where(stuck, fitted.theta, end) for end in (low, high))
    top = top_within(fitted.theta, -gradient, rest, low, high)
    step = top - fitted.theta
    share = (_FARTHEST / max(float(step @ rest @ step), 1e-12)) ** 0.5
    return top if share >= 1.0 else np.asarray(fitted.theta + share * step)


def is_outdone(model: Comparison, fitted: Fit) -> bool:
    """Whether forecasts of all blocks are no better than those without a model.

    What acts on a model that explains this little is no effect on the system.
    """
    held = model.held([*fitted.episodes, *model.sealed()])
    if not held:
        return False
    modelled, asked_all = unfitted(model, fitted), np.array([stretches(model, h) for h in held])
    best = np.argmin(asked_all.sum(1), axis=0)  # of each channel
    simple = np.take_along_axis(asked_all, best[None, None], axis=0)[0]
    return weight_of(simple, modelled).share <= 0.0


def stretches(model: Comparison, errors: Sequence[FloatArray]) -> FloatArray:
    """Sums of squares over stretches of a few horizons, (stretches, channels)."""
    sums = []
    for block in errors:
        for part in np.array_split(block, max(block.shape[1] // (2 * model.horizon), 1), axis=1):
            sums.append(np.nansum(part**2, axis=1))
    return np.array(sums)


def weight_of(was: FloatArray, now: FloatArray) -> Weight:
    """The share that an effect removes; `was` and `now` are squared errors (stretches, channels).

    A stretch that runs away counts for `_cap` at most.
    """
    if not np.all(np.isfinite(now)):
        return Weight(-1.0, -1.0, -1.0)
    was, now = _summed(was, now)
    return _removed(was, now, _cap(was, now))


def share_of_gap(begun: FloatArray, before: FloatArray, after: FloatArray) -> float:
    """The share of the first squared errors by which they fall from `before` to `after`.

    The cap is the same for all three: that from first to last.
    """
    was, last = _summed(begun, after)
    cap = _cap(was, last)
    return _removed(was, last, cap).share - _removed(was, _summed(begun, before)[1], cap).share


def _summed(was: FloatArray, now: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Errors of stretches: channels summed, each in shares of its error without the effect."""
    usual = was.sum(0)
    weights = 1.0 / np.where(usual > 0.0, usual, 1.0)
    return np.asarray(was @ weights), np.asarray(now @ weights)


def _cap(was: FloatArray, now: FloatArray) -> float:
    """The most that a stretch counts: from an unstable state all models run away.

    There is no limit if some stretches err by far and all of these fall by half, while the others
    lose little: a system that meets a floor now and then errs like this.
    """
    cap = RULES.far_stretch * float(np.median(was)) or np.inf
    far = was > cap
    if far.sum() < RULES.fewest_far or np.any(now[far] > 0.5 * was[far]):
        return cap
    gained, lost = (was[far] - now[far]).sum(), (now[~far] - was[~far]).sum()
    return np.inf if lost < RULES.far_lost_share * gained else cap


def _removed(was: FloatArray, now: FloatArray, cap: float) -> Weight:
    """The share of errors (stretches,) that is removed; none counts for more than `cap`."""
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing could be forecast
        return _removed_within(np.minimum(was, cap), np.minimum(now, cap))


def _removed_within(was: FloatArray, now: FloatArray) -> Weight:
    """The share of errors (stretches,), NaN where there are none."""
    share = 1.0 - float(now.sum() / was.sum())
    count = len(was)
    if count < 3:
        return Weight(share, -1.0, 1.0)
    left_out = 1.0 - (now.sum() - now) / (was.sum() - was)
    reach = float(student_t.ppf(0.95, count - 1))
    reach *= float(np.sqrt((count - 1) ** 2 / count * np.var(left_out, ddof=1)))
    return Weight(share, share - reach, min(share + reach, 1.0))
