"""The loop's filter steps against filterpy's, which are general and slow."""

import filterpy.kalman as general
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from runtime.loop import kalman


@given(st.integers(1, 4), st.integers(0, 1 << 30), st.floats(1e-9, 1e3))
def test_both_steps_are_filterpys_to_rounding(n, seed, variance):
    draw = np.random.default_rng(seed)
    root, row = draw.normal(size=(n, n)), draw.normal(size=(1, n))
    cov, x, measured = root @ root.T, draw.normal(size=n), draw.normal(size=1)
    noise = np.array([[variance]])
    for ours, theirs in zip(
        kalman.update(x, cov, measured, noise, row),
        general.update(x, cov, measured, noise, row),
        strict=True,
    ):
        assert np.allclose(ours, theirs, rtol=0.0, atol=1e-11 * (1.0 + np.abs(cov).max()))
    transition, control = draw.normal(size=(n, n)), draw.normal(size=1)
    matrix = draw.normal(size=(n, 1))
    for ours, theirs in zip(
        kalman.predict(x, cov, transition, np.eye(n), control, matrix),
        general.predict(x, cov, transition, np.eye(n), control, matrix),
        strict=True,
    ):
        assert np.array_equal(ours, theirs)
    plain = kalman.predict(x, cov, transition, np.eye(n))
    assert np.array_equal(plain[0], general.predict(x, cov, transition, np.eye(n))[0])


def test_a_flight_loads_neither_filterpy_nor_onnxruntime_for_c():
    import subprocess
    import sys

    heavy = ("filterpy", "scipy", "onnxruntime", "matplotlib", "torch")
    asked = f"import runtime.run, sys; print([m for m in {heavy} if m in sys.modules])"
    told = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
