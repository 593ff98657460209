"""What a package does off its example: it stays within what is possible, or is not to fly."""

import numpy as np
import pytest
from hostile_models import HEAD
from made_packages import package_of, parsed, sound, tiny_manifest

from runtime.replay import compare, replay, require_bounded
from wakedeploy.core.errors import CheckFailed, UnusableInput

STATES = {"memory": {"kind": "state", "states": {"count": {"shape": [1]}}}, "warm_up_steps": 8}
PLAIN = {"memory": {"kind": "none"}, "warm_up_steps": 1}
SIDE = np.float32([[1.0, 1.0], [-1.0, -1.0]])  # dx less dz, which the example's inputs keep at 0


def made(body: str, manifest: dict, head: str = HEAD, **constants: object):
    """A package of ONNX's text, its record as its graph computes it."""
    model = parsed(f"{head} {body}", constants)
    return sound(package_of(model.SerializeToString(), tiny_manifest("window", **manifest)))


def test_a_force_that_follows_its_inputs_is_never_limited():
    package = made("{ force = Mul (observation, gain) }", PLAIN, gain=np.float32(2.0))
    assert replay(package).limited == 0.0


def test_a_force_that_its_graph_limits_counts_as_limited():
    body = (
        "{ wide = Mul (observation, gain) over = Greater (wide, top) a = Where (over, top, wide)"
        " under = Greater (low, a) force = Where (under, low, a) }"
    )
    limits = {"top": np.float32(6.0), "low": np.float32(-6.0)}  # of a range from -3 to 3
    package = made(body, PLAIN, gain=np.float32(30.0), **limits)
    assert 0.5 < require_bounded(package) < 1.0


@pytest.mark.parametrize(
    ("body", "constants", "told"),
    [
        ("{ s = MatMul (observation, turn) force = Mul (s, k) }", {"k": np.float32(25)}, "fx_n of"),
        ("{ s = MatMul (observation, turn) force = Sqrt (s) }", {}, "fx_n of nan N"),
        (
            "{ s = MatMul (observation, turn) force = Mul (s, k) }",
            {"k": np.float32(1e30)},
            "e+30 N",
        ),
    ],
)
def test_a_force_beyond_its_limits_off_the_example_is_noticed(body, constants, told):
    """The example's inputs are alike in both channels; corners of their ranges are not."""
    with pytest.raises(CheckFailed, match="Driven over its observed ranges") as failed:
        replay(made(body, PLAIN, turn=SIDE, **constants))
    assert told in str(failed.value)
    assert "where -6 to 6 is possible" in str(failed.value)


def test_a_force_that_leaves_its_limits_after_six_hundred_steps_is_noticed():
    head = (
        "t (float[B, 2] observation, float[B, 1] state_count)"
        " => (float[B, 2] force, float[B, 1] next_state_count)"
    )
    body = (
        "{ next_state_count = Add (state_count, one) late = Sub (state_count, fuse)"
        " blow = Relu (late) big = Mul (blow, much) force = Add (observation, big) }"
    )
    late = {"one": np.float32(1), "fuse": np.float32(600), "much": np.float32(50)}
    with pytest.raises(CheckFailed, match=r"at step 60\d, where -6 to 6 is possible"):
        replay(made(body, STATES, head, **late))


def test_a_model_that_onnxruntime_gives_up_on_fails_in_a_sentence():
    body = "{ row = Gather <axis: int = 0> (table, place) force = Add (observation, row) }"
    constants = {"table": np.zeros((3, 2), np.float32), "place": np.array(7)}
    model = parsed(f"{HEAD} {body}", constants)
    package = package_of(model.SerializeToString(), tiny_manifest("window", **PLAIN))
    with pytest.raises((CheckFailed, UnusableInput), match="onnxruntime") as failed:
        replay(package)
    assert "\n" not in str(failed.value)


@pytest.mark.parametrize("offset", [0.0, 10.0, 1e4, -1e4])
def test_a_force_far_from_zero_is_compared_with_its_range(offset: float) -> None:
    """A constant in the place of a force of 0.15 N about 10 kN is 1.5e-5 of its largest value."""
    swing = 0.15 * np.sin(np.arange(400) / 7.0)[:, None]
    exact = (offset + swing).astype(np.float32)
    assert compare(np.full_like(exact, offset), exact).max_rel > 1e-4
    rounded = np.nextafter(exact, np.float32(np.inf))
    assert compare(rounded, exact).max_rel <= 1e-5


def test_a_force_that_stays_is_compared_with_its_size() -> None:
    still = np.full((10, 1), 2.0, np.float32)
    assert compare(still * np.float32(1.001), still).max_rel == pytest.approx(0.02, rel=0.01)
    nothing = np.zeros((10, 1), np.float32)
    assert compare(nothing + np.float32(0.5), nothing).max_rel == 0.5
