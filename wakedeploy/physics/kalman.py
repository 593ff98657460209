"""An extended Kalman filter for many lanes at once, compiled: the algebra between user's functions.

A lane is one piece of a log under one set of parameters. Arrays have the lanes last. The user's
functions are evaluated outside, at a point and at points beside it, from which Jacobians follow;
the state is then stepped by local linearisation (Ozaki, Statistica Sinica 2, 1992), which is exact
for linear systems and stable for stiff ones.
"""

import math

import numpy as np

from wakedeploy.physics.series import FloatArray, IntArray, compiled

_TAYLOR = 8
_FINE_ENOUGH = 1e-8  # of the last term of the series, by norm
_COARSEST = 0.5  # norm of a matrix whose exponential is summed; larger ones are halved first
_LEAST_VARIANCE = 1e-300


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
    told: FloatArray,
) -> None:
    """Take in a sample: changes states `x` (n, L) and covariances `p` (n, n, L) in place.

    `shown` (m, k + 1, L) are the readings at the state and beside it, by `aside` (k, L), in each of
    the k states; `measured` (m, L), NaN where nothing was measured; `noise` (m, L) variances.
    `told` (4, m, L) becomes innovation, variance, log density and inlier probability. Channels come
    one after another, which is exact for independent noise. States after the first k, which no
    reading shows, follow by their covariance.
    """
    n, lanes = x.shape
    channels, points = shown.shape[0], shown.shape[1]
    slope, pull, before = np.empty(n), np.empty(n), np.empty(n)
    for lane in range(lanes):
        for i in range(n):
            before[i] = x[i, lane]
        for c in range(channels):
            told[0, c, lane], told[1, c, lane] = 0.0, 1.0
            told[2, c, lane], told[3, c, lane] = 0.0, 0.0
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
                outlier = math.log(outliers / spread) - 0.5 * z2 / (spread * spread)
                top = max(inlier, outlier)
                both = top + math.log(math.exp(inlier - top) + math.exp(outlier - top))
                weight = math.exp(inlier - both)
            told[0, c, lane], told[1, c, lane] = e, variance
            told[2, c, lane] = both - 0.5 * math.log(2.0 * math.pi * variance)
            told[3, c, lane] = weight
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
) -> None:
    """One sample later: changes `x` (n + s, L) and `p` (n + s, n + s, L) in place.

    `rates` (n, n + 1, L) are derivatives at the state and beside it (or the next states, if
    `discrete`). White noise acts on the derivatives of the states `driven` (d); `sd` (d, L) is that
    of its mean over a sample. The last s states, none or d of them, are pushes that last: each is
    added to its driven derivative, keeps the share `keep` (s, L) of itself, and gets fresh noise of
    sd `fresh` (s, L); it is held over a sample.
    """
    n, lanes = rates.shape[0], rates.shape[2]
    pushes = x.shape[0] - n
    every = n + pushes
    a, f, phi, half = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    work, power = np.empty((n, n)), np.empty((n, n))
    whole, cov = np.zeros((every, every)), np.empty((every, every))
    before = np.empty((every, every))
    carried, moved, slope = np.empty((every, every)), np.empty(n), np.empty(n)
    for lane in range(lanes):
        for i in range(n):
            slope[i] = rates[i, 0, lane]
            for j in range(n):
                a[i, j] = (rates[i, j + 1, lane] - rates[i, 0, lane]) / aside[j, lane]
        for d in range(pushes):
            slope[driven[d]] += x[n + d, lane] * (dt_s if discrete else 1.0)
        if discrete:
            for i in range(n):
                moved[i] = slope[i]
                for j in range(n):
                    f[i, j] = a[i, j]
                for d in range(pushes):
                    whole[i, n + d] = dt_s if driven[d] == i else 0.0
        else:
            _exponential(a, dt_s, f, phi, half, work, power)
            for i in range(n):
                moved[i] = x[i, lane]
                for j in range(n):
                    moved[i] += phi[i, j] * slope[j] * dt_s
                for d in range(pushes):
                    whole[i, n + d] = phi[i, driven[d]] * dt_s
        for i in range(n):
            for j in range(n):
                whole[i, j] = f[i, j]
        for d in range(pushes):
            whole[n + d, n + d] = keep[d, lane]
        for i in range(every):
            for j in range(every):
                before[i, j] = p[i, j, lane]
        _sandwich(whole, before, carried, cov, n)
        if discrete:
            for d in range(len(driven)):
                cov[driven[d], driven[d]] += (sd[d, lane] * dt_s) ** 2
        else:
            for d in range(len(driven)):
                c = driven[d]
                density = (sd[d, lane] * dt_s) ** 2 / 6.0
                for i in range(n):
                    for j in range(i, n):
                        cov[i, j] += density * (4.0 * half[i, c] * half[j, c] + f[i, c] * f[j, c])
                cov[c, c] += density
        for d in range(pushes):
            cov[n + d, n + d] += fresh[d, lane] ** 2
            x[n + d, lane] *= keep[d, lane]
        for i in range(n):
            x[i, lane] = moved[i]
        for i in range(every):
            for j in range(i, every):
                p[i, j, lane] = p[j, i, lane] = cov[i, j]


@compiled
def _sandwich(f: FloatArray, p: FloatArray, work: FloatArray, cov: FloatArray, n: int) -> None:
    """The upper half of `cov` becomes f p fᵀ; f is diagonal from row `n` on."""
    every = f.shape[0]
    for i in range(every):
        for j in range(every):
            work[i, j] = 0.0
    for i in range(n):
        for m in range(every):
            if f[i, m] != 0.0:
                for j in range(every):
                    work[i, j] += f[i, m] * p[m, j]
    for i in range(n, every):
        for j in range(every):
            work[i, j] = f[i, i] * p[i, j]
    for i in range(every):
        for j in range(i, every):
            if j >= n:
                cov[i, j] = work[i, j] * f[j, j]
                continue
            total = 0.0
            for m in range(every):
                total += work[i, m] * f[j, m]
            cov[i, j] = total


@compiled
def _exponential(
    a: FloatArray,
    dt_s: float,
    f: FloatArray,
    phi: FloatArray,
    half: FloatArray,
    work: FloatArray,
    power: FloatArray,
) -> None:
    """`f` = exp(a dt), `half` = exp(a dt/2), `phi` = (a dt)⁻¹ (f − 1), by halving and doubling."""
    n = a.shape[0]
    norm = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(a[i, j])
        norm = max(norm, row * dt_s)
    halvings = 1
    while norm * 0.5**halvings > _COARSEST and halvings < 60:
        halvings += 1
    scale = dt_s * 0.5**halvings
    for i in range(n):
        for j in range(n):
            phi[i, j] = power[i, j] = 1.0 if i == j else 0.0
    factor, left = 1.0, 1.0
    for order in range(1, _TAYLOR + 1):
        _times(power, a, work)
        for i in range(n):
            for j in range(n):
                power[i, j] = work[i, j] * scale
        factor /= order + 1
        for i in range(n):
            for j in range(n):
                phi[i, j] += factor * power[i, j]
        left *= norm * 0.5**halvings
        if left * factor < _FINE_ENOUGH:
            break
    _times(phi, a, work)
    for i in range(n):
        for j in range(n):
            f[i, j] = work[i, j] * scale + (1.0 if i == j else 0.0)
    for _ in range(halvings):
        for i in range(n):
            for j in range(n):
                half[i, j] = f[i, j]
                power[i, j] = 0.5 * (f[i, j] + (1.0 if i == j else 0.0))
        _times(power, phi, work)
        for i in range(n):
            for j in range(n):
                phi[i, j] = work[i, j]
        _times(half, half, f)


@compiled
def _times(one: FloatArray, other: FloatArray, product: FloatArray) -> None:
    n = one.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for m in range(n):
                total += one[i, m] * other[m, j]
            product[i, j] = total


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

    One exponential tells the first bump, one how much larger each next one is. Beyond `farthest`
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
