"""The shipped runner steps a package as its memory says, one series or many."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from runtime.predictor import PackagePredictor, inference_session
from wakedeploy.core.errors import UnusableInput

KINDS = ("none", "window", "state")


def by_hand(kind: str, series: np.ndarray) -> np.ndarray:
    """What the tiny packages compute for a series (T, 2), written out with loops."""
    if kind == "none":
        return series.sum(axis=1, keepdims=True)
    if kind == "window":
        picked = [[series[max(0, t - back)] for back in (4, 2, 0)] for t in range(len(series))]
        return np.array([[w[2][0] - w[0][0], w[0][1] + w[1][1] + w[2][1]] for w in picked])
    kept, forces = np.array([1.0, -1.0]), []
    for observation in series:
        kept = 0.5 * kept + observation
        forces.append(kept)
    return np.array(forces)


def stepped(predictor: PackagePredictor, series: np.ndarray) -> np.ndarray:
    return np.array([predictor.step(observation) for observation in series])


@pytest.mark.parametrize("kind", KINDS)
def test_a_series_gives_what_the_memory_says(tiny_package, kind):
    predictor = PackagePredictor(tiny_package(kind))
    values = hnp.arrays(np.float32, st.tuples(st.integers(1, 14), st.just(2)),
                        elements=st.floats(-4, 4, width=32))  # fmt: skip

    @settings(max_examples=50, deadline=None)
    @given(series=values)
    def agrees(series):
        predictor.reset()
        assert np.allclose(stepped(predictor, series), by_hand(kind, series), atol=1e-5)

    agrees()


@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_steps_its_series_independently(tiny_package, kind):
    rng = np.random.default_rng(1)
    series = rng.normal(size=(20, 3, 2)).astype(np.float32)
    forces = stepped(PackagePredictor(tiny_package(kind), batch=3), series)
    for b in range(3):
        assert np.allclose(forces[:, b], by_hand(kind, series[:, b]), atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_the_memory_is_full_after_warm_up_and_empty_after_reset(tiny_package, kind):
    predictor = PackagePredictor(tiny_package(kind))
    for _ in range(2):
        for _ in range(predictor.warm_up_steps):
            assert not predictor.ready
            predictor.step(np.zeros(2, np.float32))
        assert predictor.ready
        predictor.reset()


def test_a_returned_force_is_not_overwritten_by_the_next_step(tiny_package):
    predictor = PackagePredictor(tiny_package("none"))
    first = predictor.step([1.0, 2.0])
    predictor.step([5.0, 6.0])
    assert first == pytest.approx([3.0])


def test_nan_passes_through_and_a_reset_forgets_it(tiny_package):
    for kind in KINDS:
        predictor = PackagePredictor(tiny_package(kind))
        assert np.isnan(predictor.step([np.nan, np.nan])).all()
        predictor.reset()
        assert np.isfinite(predictor.step([0.0, 0.0])).all()


def test_another_shape_is_refused_with_the_channels_named(tiny_package):
    predictor = PackagePredictor(tiny_package("state"))
    with pytest.raises(UnusableInput, match=r"shape \(3,\)\); give shape \(2,\): dx_m, dz_m"):
        predictor.step([1.0, 2.0, 3.0])
    with pytest.raises(UnusableInput, match=r"give shape \(4, 2\)"):
        PackagePredictor(tiny_package("state"), batch=4).step([1.0, 2.0])
    for unusable in (["1", "2"], [None, 2.0], [1.0, [2.0, 3.0]]):
        with pytest.raises(UnusableInput, match=r"give shape \(2,\): dx_m, dz_m"):
            predictor.step(unusable)
    assert predictor.step([[1.0, 2.0]]).shape == (1, 2)


def test_a_model_that_onnxruntime_refuses_is_told_in_one_line():
    with pytest.raises(UnusableInput, match="cannot load the model") as refusal:
        inference_session(b"no model at all")
    assert "\n" not in str(refusal.value)


def test_the_lead_is_the_manifests(tiny_package):
    assert PackagePredictor(tiny_package("none")).lead_s == 0.09


def test_a_step_leaves_nothing_for_the_makers_of_onnxruntime(tiny_package, tmp_path):
    """Left alone, it stores reports in the home of whoever predicts, and sends them."""
    model = tmp_path / "model.onnx"
    model.write_bytes(tiny_package("none").model_bytes)
    home = tmp_path / "home"
    home.mkdir()
    own = {"HOME": str(home), "XDG_CACHE_HOME": str(home)}
    script = (
        "import sys, runtime.predictor as p; p.inference_session(open(sys.argv[1], 'rb').read())"
    )
    environment = {n: v for n, v in os.environ.items() if n != "ORT_DISABLE_TELEMETRY"}
    command = [sys.executable, "-c", script, str(model)]
    subprocess.run(command, env=environment | own, check=True, capture_output=True)
    assert list(home.iterdir()) == []
