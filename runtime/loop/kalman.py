"""A Kalman filter's two steps for one measured number, with nothing but products of small arrays.

The same equations in the same order as filterpy's `predict` and `update` (Labbe), which the tests
compare them with: the covariance after a measurement is Joseph's form. What a general filter does
besides, mostly an inverse by LAPACK, takes the loop longer than the equations, and its libraries
take a process 60 MB.
"""

import functools

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def predict(
    x: FloatArray,
    cov: FloatArray,
    transition: FloatArray,
    noise: FloatArray,
    control: FloatArray | None = None,
    control_matrix: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """State (n,) and covariance (n, n) after a step: F x + B u, F P Fᵀ + Q."""
    moved = transition.dot(x)
    if control is not None and control_matrix is not None:
        moved = moved + control_matrix.dot(control)
    return moved, transition.dot(cov).dot(transition.T) + noise


def update(
    x: FloatArray, cov: FloatArray, measured: FloatArray, variance: FloatArray, row: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """State and covariance after a measurement (1,) of variance (1, 1), which is `row` (1, n) x."""
    innovation = measured - row.dot(x)
    along = cov.dot(row.T)  # (n, 1)
    gain = along * (1.0 / (row.dot(along) + variance))  # (n, 1)
    kept = _eye(len(x)) - gain.dot(row)
    after = kept.dot(cov).dot(kept.T) + gain.dot(variance).dot(gain.T)
    return x + gain.dot(innovation), after


@functools.cache
def _eye(n: int) -> FloatArray:
    return np.eye(n)
