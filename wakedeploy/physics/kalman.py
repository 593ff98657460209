"""An extended Kalman filter for many lanes at once, compiled: the algebra between user's functions.

A lane is one piece of a log under one set of parameters. Arrays have the lanes last. The user's
functions are evaluated outside, at a point and at points beside it, from which Jacobians follow;
the state is then stepped by local linearisation (Ozaki, Statistica Sinica 2, 1992), which is exact
for linear systems and stable for stiff ones.
"""

import math

import numpy as np

from wakedeploy.physics.friction import borne
from wakedeploy.physics.series import FloatArray, IntArray, compiled

_TAYLOR = 8
_FINE_ENOUGH = 1e-8  # of the last term of the series, by norm
_COARSEST = 0.5  # norm of a matrix whose exponential is summed; larger ones are halved first
_LEAST_VARIANCE = 1e-300
_CAUCHY = (2.0 / math.pi) ** 0.5  # his density over the normal one's, in the middle
_LOST_NORM = 1e9  # of a matrix times a sample: such a lane has left its model
_SWEEPS, _AGREED = 40, 1e-6  # over frictions that change each other's speeds; shares of strengths
# Lanes that are computed side by side. A loop over eight is written out in full by the compiler,
# and takes twice as long as one over many. More than these gain nothing further.
_WIDE = 96


@compiled
def corrected(
    x: FloatArray,
    p: FloatArray,
    shown: FloatArray,
    aside: FloatArray,
    measured: FloatArray,
    noise: FloatArray,
    outliers: float,
    spread: float,
    statistics: FloatArray,
) -> None:
    """Take in a sample: changes states `x` (n, L) and covariances `p` (n, n, L) in place.

    `shown` (m, k + 1, L) are the readings at the state and beside it, by `aside` (k, L), in each of
    the k states; `measured` (m, L), NaN where nothing was measured; `noise` (m, L) variances.
    `statistics` (4, m, L) becomes innovation, variance, log density and inlier probability.
    Channels come one after another, which is exact for independent noise. States after the first k,
    which no reading shows, follow by their covariance.
    """
    n, lanes = x.shape
    channels, points = shown.shape[0], shown.shape[1]
    slope, pull, before = np.empty(n), np.empty(n), np.empty(n)
    for lane in range(lanes):
        for i in range(n):
            before[i] = x[i, lane]
        for c in range(channels):
            statistics[0, c, lane], statistics[1, c, lane] = 0.0, 1.0
            statistics[2, c, lane], statistics[3, c, lane] = 0.0, 0.0
            value = measured[c, lane]
            if math.isnan(value):
                continue
            expected = shown[c, 0, lane]
            for i in range(n):
                slope[i] = 0.0
            for i in range(points - 1):
                slope[i] = (shown[c, i + 1, lane] - shown[c, 0, lane]) / aside[i, lane]
                expected += slope[i] * (x[i, lane] - before[i])
            variance = noise[c, lane]
            for i in range(n):
                pull[i] = 0.0
                for j in range(points - 1):
                    pull[i] += p[i, j, lane] * slope[j]
            for j in range(points - 1):
                variance += slope[j] * pull[j]
            variance = max(variance, _LEAST_VARIANCE)
            e = value - expected
            z2 = e * e / variance
            inlier = math.log(1.0 - outliers) - 0.5 * z2
            both, weight = inlier, 1.0
            if outliers > 0.0:
                # Of Cauchy's tails: however far off, a stray pulls the others' noise by half a nat
                # at most. Gradients leave that out.
                outlier = math.log(_CAUCHY * outliers / spread) - math.log1p(z2 / (spread * spread))
                top = max(inlier, outlier)
                both = top + math.log(math.exp(inlier - top) + math.exp(outlier - top))
                weight = math.exp(inlier - both)
            statistics[0, c, lane], statistics[1, c, lane] = e, variance
            statistics[2, c, lane] = both - 0.5 * math.log(2.0 * math.pi * variance)
            statistics[3, c, lane] = weight
            for i in range(n):
                x[i, lane] += weight * pull[i] * e / variance
            for i in range(n):
                for j in range(n):
                    p[i, j, lane] -= weight * pull[i] * pull[j] / variance


@compiled
def stepped(
    x: FloatArray,
    p: FloatArray,
    rates: FloatArray,
    aside: FloatArray,
    driven: IntArray,
    sd: FloatArray,
    keep: FloatArray,
    fresh: FloatArray,
    dt_s: float,
    discrete: bool,
    dry: IntArray,
    strengths: FloatArray,
    turnings: FloatArray,
    answers: FloatArray,
) -> None:
    """One sample later: changes `x` (n + s, L) and `p` (n + s, n + s, L) in place.

    `rates` (n, n + 1, L) are derivatives at the state and beside it (or the next states, if
    `discrete`). With one more, (n, n + 2, L), the last are at the state, under inputs to which the
    integral of (1/2 - s) u over the share s of the sample was added: what acts early in a sample
    moves what follows it farther. White noise acts on the derivatives of the states `driven` (d);
    `sd` (d, L) is that of its mean over a sample. The last s states, none or d of them, are pushes
    that last: each is added to its driven derivative, keeps the share `keep` (s, L) of itself, and
    gets fresh noise of sd `fresh` (s, L); it is held over a sample. Dry friction, which the rates
    leave out, acts on the speeds `dry` (q) with up to `strengths` (q, L), and turns over the speeds
    `turnings` (q, L); `answers` (q, n, L) are what a unit of it adds to every derivative (or next
    state).
    """
    n, lanes = rates.shape[0], rates.shape[2]
    pushes = x.shape[0] - n
    every = n + pushes
    groups = max((lanes + _WIDE - 1) // _WIDE, 1)
    wide = max((lanes + groups - 1) // groups, 1)
    a, f, phi = np.empty((n, n, wide)), np.empty((n, n, wide)), np.empty((n, n, wide))
    half, work, power = np.empty((n, n, wide)), np.empty((n, n, wide)), np.empty((n, n, wide))
    whole, cov = np.zeros((n, every, wide)), np.empty((every, every, wide))
    carried, kept = np.empty((every, every, wide)), np.empty((pushes, wide))
    moved, slope = np.empty((n, wide)), np.empty((n, wide))
    total, of = np.empty(wide), np.empty(wide, np.int64)
    for first in range(0, lanes, wide):
        for w in range(wide):
            of[w] = min(first + w, lanes - 1)  # the last lane fills up what is left
        _linearised(rates, aside, of, slope, a)
        for d in range(pushes):
            for w in range(wide):
                kept[d, w] = keep[d, of[w]]
                slope[driven[d], w] += x[n + d, of[w]] * (dt_s if discrete else 1.0)
        for i in range(every):
            for j in range(every):
                for w in range(wide):
                    cov[i, j, w] = p[i, j, of[w]]
        if discrete:
            for i in range(n):
                for w in range(wide):
                    moved[i, w] = slope[i, w]
                for j in range(n):
                    for w in range(wide):
                        f[i, j, w] = a[i, j, w]
                        phi[i, j, w] = 1.0 if i == j else 0.0
        else:
            _exponential(a, dt_s, f, phi, half, work, power, total)
            for i in range(n):
                for w in range(wide):
                    moved[i, w] = x[i, of[w]]
                for j in range(n):
                    for w in range(wide):
                        moved[i, w] += phi[i, j, w] * slope[j, w] * dt_s
            if rates.shape[1] > n + 1:
                _early(rates, of, a, half, dt_s, moved)
        for i in range(n):
            for j in range(n):
                for w in range(wide):
                    whole[i, j, w] = f[i, j, w]
            for d in range(pushes):
                for w in range(wide):
                    whole[i, n + d, w] = phi[i, driven[d], w] * dt_s
        if len(dry) > 0:
            _rubbed(moved, whole, x, of, dry, strengths, turnings, answers, phi, dt_s, discrete)
        _sandwich(whole, kept, cov, carried, total)
        _disturbed(cov, f, half, driven, sd, of, dt_s, discrete, total)
        for w in range(min(wide, lanes - first)):
            lane = first + w
            for d in range(pushes):
                cov[n + d, n + d, w] += fresh[d, lane] ** 2
                x[n + d, lane] *= keep[d, lane]
            for i in range(n):
                x[i, lane] = moved[i, w]
            for i in range(every):
                for j in range(i, every):
                    p[i, j, lane] = p[j, i, lane] = cov[i, j, w]


@compiled
def _early(
    rates: FloatArray,
    of: IntArray,
    a: FloatArray,
    half: FloatArray,
    dt_s: float,
    moved: FloatArray,
) -> None:
    """Add to states `moved` (n, W) what inputs do by coming early: dt² exp(a dt/2) a (change).

    Inputs that are replaced by their mean over a step act, to second order, in its middle.
    """
    n = a.shape[0]
    turned = np.empty(n)
    for w in range(a.shape[2]):
        lane = of[w]
        for i in range(n):
            turned[i] = 0.0
            for j in range(n):
                turned[i] += a[i, j, w] * (rates[j, n + 1, lane] - rates[j, 0, lane])
        for i in range(n):
            for j in range(n):
                moved[i, w] += dt_s * dt_s * half[i, j, w] * turned[j]


@compiled
def _rubbed(
    moved: FloatArray,
    whole: FloatArray,
    x: FloatArray,
    of: IntArray,
    dry: IntArray,
    strengths: FloatArray,
    turnings: FloatArray,
    answers: FloatArray,
    phi: FloatArray,
    dt_s: float,
    discrete: bool,
) -> None:
    """Dry friction on some speeds: changes states `moved` (n, W) and slopes `whole` in place.

    Over a sample each acts on all states as a force that is held, of the mean that it has. Where
    one changes the speed of another, each is asked again until all agree (Gauss and Seidel).
    """
    n, every, count = moved.shape[0], whole.shape[1], len(dry)
    change, share, slopes = np.empty((count, n)), np.empty(count), np.empty((count, every))
    for w in range(moved.shape[1]):
        lane = of[w]
        for q in range(count):
            share[q] = 0.0
            for j in range(every):
                slopes[q, j] = 0.0
            for i in range(n):
                change[q, i] = answers[q, i, lane]
                if not discrete:
                    change[q, i] = 0.0
                    for j in range(n):
                        change[q, i] += phi[i, j, w] * answers[q, j, lane] * dt_s
                change[q, i] *= strengths[q, lane]
        for _ in range(_SWEEPS):
            farthest = 0.0
            for q in range(count):
                speed, most = dry[q], change[q, dry[q]]
                if not most > 0.0:
                    continue
                after = moved[speed, w] - most * share[q]
                bears, by_before, by_after = borne(x[speed, lane], after, most, turnings[q, lane])
                for j in range(every):
                    slope = by_after * (whole[speed, j, w] - most * slopes[q, j])
                    if j == speed:
                        slope += by_before
                    more = slope - slopes[q, j]
                    slopes[q, j] = slope
                    for i in range(n):
                        whole[i, j, w] += change[q, i] * more
                for i in range(n):
                    moved[i, w] += change[q, i] * (bears - share[q])
                farthest = max(farthest, abs(bears - share[q]))
                share[q] = bears
            if count == 1 or farthest < _AGREED:
                break


@compiled
def _linearised(
    rates: FloatArray, aside: FloatArray, of: IntArray, slope: FloatArray, a: FloatArray
) -> None:
    """Rates (n, W) and their Jacobians (n, n, W) in the lanes `of`."""
    n = rates.shape[0]
    for i in range(n):
        for w in range(slope.shape[1]):
            slope[i, w] = rates[i, 0, of[w]]
        for j in range(n):
            for w in range(slope.shape[1]):
                a[i, j, w] = (rates[i, j + 1, of[w]] - rates[i, 0, of[w]]) / aside[j, of[w]]


@compiled
def _disturbed(
    cov: FloatArray,
    f: FloatArray,
    half: FloatArray,
    driven: IntArray,
    sd: FloatArray,
    of: IntArray,
    dt_s: float,
    discrete: bool,
    density: FloatArray,
) -> None:
    """Add to the upper half of `cov` what white noise on the driven derivatives brings.

    Of continuous noise that is an integral over the sample, by Simpson's rule.
    """
    n = f.shape[0]
    for d in range(len(driven)):
        c = driven[d]
        for w in range(cov.shape[2]):
            density[w] = (sd[d, of[w]] * dt_s) ** 2 / (1.0 if discrete else 6.0)
        if not discrete:
            for i in range(n):
                for j in range(i, n):
                    for w in range(cov.shape[2]):
                        ends = 4.0 * half[i, c, w] * half[j, c, w] + f[i, c, w] * f[j, c, w]
                        cov[i, j, w] += density[w] * ends
        for w in range(cov.shape[2]):
            cov[c, c, w] += density[w]


@compiled
def _sandwich(
    f: FloatArray, kept: FloatArray, cov: FloatArray, work: FloatArray, total: FloatArray
) -> None:
    """The upper half of `cov` (n + s, n + s, W) becomes g cov gᵀ.

    The first n rows of g are `f` (n, n + s, W); the others are diagonal, `kept` (s, W).
    """
    n, every = f.shape[0], f.shape[1]
    _times(f, cov, work, total)
    for i in range(n, every):
        for j in range(every):
            for w in range(f.shape[2]):
                work[i, j, w] = kept[i - n, w] * cov[i, j, w]
    for i in range(every):
        for j in range(i, every):
            if j >= n:
                for w in range(f.shape[2]):
                    cov[i, j, w] = work[i, j, w] * kept[j - n, w]
                continue
            for w in range(f.shape[2]):
                total[w] = work[i, 0, w] * f[j, 0, w]
            for m in range(1, every):
                for w in range(f.shape[2]):
                    total[w] += work[i, m, w] * f[j, m, w]
            for w in range(f.shape[2]):
                cov[i, j, w] = total[w]


@compiled
def _exponential(
    a: FloatArray,
    dt_s: float,
    f: FloatArray,
    phi: FloatArray,
    half: FloatArray,
    work: FloatArray,
    power: FloatArray,
    total: FloatArray,
) -> None:
    """`f` = exp(a dt), `half` = exp(a dt/2), `phi` = (a dt)⁻¹ (f − 1), by halving and doubling.

    Matrices are (n, n, W), one in each lane; the largest norm decides for all. A lane far beyond
    is lost, and must not take its neighbours along.
    """
    n = a.shape[0]
    norm = 0.0
    for i in range(n):
        for w in range(a.shape[2]):
            total[w] = 0.0
        for j in range(n):
            for w in range(a.shape[2]):
                total[w] += abs(a[i, j, w])
        for w in range(a.shape[2]):
            if total[w] * dt_s < _LOST_NORM:
                norm = max(norm, total[w] * dt_s)
    halvings = 1
    while norm * 0.5**halvings > _COARSEST and halvings < 60:
        halvings += 1
    scale = dt_s * 0.5**halvings
    for i in range(n):
        for j in range(n):
            for w in range(a.shape[2]):
                phi[i, j, w] = power[i, j, w] = 1.0 if i == j else 0.0
    factor, power_norm = 1.0, 1.0
    for order in range(1, _TAYLOR + 1):
        _times(power, a, work, total)
        factor /= order + 1
        for i in range(n):
            for j in range(n):
                for w in range(a.shape[2]):
                    power[i, j, w] = work[i, j, w] * scale
                    phi[i, j, w] += factor * power[i, j, w]
        power_norm *= norm * 0.5**halvings
        if power_norm * factor < _FINE_ENOUGH:
            break
    _times(phi, a, work, total)
    for i in range(n):
        for j in range(n):
            for w in range(a.shape[2]):
                f[i, j, w] = work[i, j, w] * scale + (1.0 if i == j else 0.0)
    for _ in range(halvings):
        for i in range(n):
            for j in range(n):
                for w in range(a.shape[2]):
                    half[i, j, w] = f[i, j, w]
                    power[i, j, w] = 0.5 * (f[i, j, w] + (1.0 if i == j else 0.0))
        _times(power, phi, work, total)
        for i in range(n):
            for j in range(n):
                for w in range(a.shape[2]):
                    phi[i, j, w] = work[i, j, w]
        _times(half, half, f, total)


@compiled
def _times(first: FloatArray, other: FloatArray, product: FloatArray, total: FloatArray) -> None:
    """Products of matrices (n, m, W) and (m, k, W), lane by lane."""
    for i in range(first.shape[0]):
        for j in range(other.shape[1]):
            for w in range(first.shape[2]):
                total[w] = first[i, 0, w] * other[0, j, w]
            for m in range(1, other.shape[0]):
                for w in range(first.shape[2]):
                    total[w] += first[i, m, w] * other[m, j, w]
            for w in range(first.shape[2]):
                product[i, j, w] = total[w]


@compiled
def limited_rate(column: FloatArray, most: float) -> FloatArray:
    """A column (n,) followed by no more than `most` a sample."""
    result = np.empty_like(column)
    value = column[0]
    for k in range(len(column)):
        value += min(max(column[k] - value, -most), most)
        result[k] = value
    return result


@compiled
def slack(column: FloatArray, half: float) -> FloatArray:
    """A column (n,) that takes up a play of ± `half` when it turns."""
    result = np.empty_like(column)
    value = column[0]
    for k in range(len(column)):
        value = min(max(value, column[k] - half), column[k] + half)
        result[k] = value
    return result


@compiled
def bumped(
    at: FloatArray, sizes: FloatArray, centres: FloatArray, width: float, farthest: float
) -> FloatArray:
    """A sum of Gaussian bumps over `at` (P, L), each of its size (B, L), at evenly spaced centres.

    One exponential gives the first bump, one how much larger each next one is. Beyond `farthest`
    there is nothing. A row of `at` that repeats the one before it is not computed again.
    """
    points, lanes = at.shape
    total = np.zeros((points, lanes))
    apart = (centres[1] - centres[0]) / width if len(centres) > 1 else 0.0
    shrink = math.exp(-apart * apart)
    for lane in range(lanes):
        for k in range(points):
            z = at[k, lane]
            if k > 0 and z == at[k - 1, lane]:
                total[k, lane] = total[k - 1, lane]
            elif abs(z) < farthest:
                off = (z - centres[0]) / width
                bump = math.exp(-0.5 * off * off)
                ratio = math.exp(apart * (off - 0.5 * apart))
                for b in range(len(centres)):
                    total[k, lane] += sizes[b, lane] * bump
                    bump *= ratio
                    ratio *= shrink
    return total
