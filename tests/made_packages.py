"""Packages small enough to compute by hand, and what is changed in them."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from runtime.loop.pilot import OBSERVATION
from runtime.predictor import PackagePredictor
from wakedeploy.core import onnx_wire
from wakedeploy.core.manifest import Manifest
from wakedeploy.core.package import (
    EXAMPLE_STEPS,
    MANIFEST_KEY,
    Example,
    Package,
    make_package,
    sealed,
)

HEADER = '<ir_version: 10, opset_import: ["" : 20]>'
BODIES = {
    # the force is the sum of the observation's two channels
    "none": "t (float[B, 2] observation) => (float[B, 1] force)"
    "{ force = ReduceSum <keepdims: int = 1> (observation, axes) }",
    # first channel: newest less oldest; second channel: all snapshots
    "window": "t (float[B, 3, 2] window) => (float[B, 2] force)"
    "{ flat = Reshape (window, flatly) force = MatMul (flat, weights) }",
    # a leaky sum of the observation's channels, which is also the force
    "state": "t (float[B, 2] observation, float[B, 2] state_leaky)"
    " => (float[B, 2] force, float[B, 2] next_state_leaky)"
    "{ kept = Mul (state_leaky, half) next_state_leaky = Add (kept, observation)"
    "  force = Add (kept, observation) }",
}
CONSTANTS: dict[str, dict[str, Any]] = {
    "none": {"axes": np.array([1])},
    "window": {
        "flatly": np.array([-1, 6]),
        "weights": np.array([[-1, 0], [0, 1], [0, 0], [0, 1], [1, 0], [0, 1]], np.float32),
    },
    "state": {"half": np.float32(0.5)},
}
MEMORIES: dict[str, dict] = {
    "none": {"kind": "none"},
    "window": {"kind": "window", "k": 3, "stride": 2},
    "state": {"kind": "state", "states": {"leaky": {"shape": [2], "initial": [1.0, -1.0]}}},
}


def parsed(body: str, constants: Mapping[str, Any], header: str = HEADER):
    """An onnx.ModelProto from ONNX's text, with constants as exporters write them."""
    onnx = pytest.importorskip("onnx")
    model = onnx.parser.parse_model(f"{header} {body}")
    for name, array in constants.items():
        model.graph.initializer.append(onnx.numpy_helper.from_array(np.asarray(array), name))
    return model


def tiny_model(kind: str, ballast: int = 0) -> bytes:
    """The graph of one of the tiny packages, with so many weights that nothing uses."""
    heavy = {"ballast": np.ones(ballast, np.float32)} if ballast else {}
    model = parsed(BODIES[kind], CONSTANTS[kind] | heavy)
    pytest.importorskip("onnx").checker.check_model(model, full_check=True)
    return model.SerializeToString()


def tiny_manifest(kind: str, **changes: object) -> Manifest:
    """What a tiny package says about itself; `changes` are other fields than the usual ones."""
    channels = [{"name": n, "unit": "m", "min": -1.0, "max": 1.0} for n in ("dx_m", "dz_m")]
    forces = [{"name": n, "unit": "N", "min": -3.0, "max": 3.0} for n in ("fx_n", "fz_n")]
    fields = {
        "arch": "gru", "hyper": {"hidden": 2}, "domain": "gantry", "rate_hz": 32.0,
        "lead_s": 0.09, "observation": channels, "force": forces[: 1 if kind == "none" else 2],
        "memory": MEMORIES[kind], "warm_up_steps": {"none": 1, "window": 5, "state": 8}[kind],
        "trainable": 12, "frozen": 0, "data_sha256": "0" * 64, "seed": 0, "test": None,
        "parity": {"max_abs": 0.0, "max_rel": 0.0, "steps": 3200, "limit": 1e-5},
        "versions": {"torch": "2.13.0"}, "graph_sha256": "0" * 64,
    }  # fmt: skip
    return Manifest.model_validate(fields | changes)


def package_of(model: bytes, manifest: Manifest) -> Package:
    """A package whose record says that every force is zero, for inputs from end to end."""
    ranges = [(channel.min, channel.max) for channel in manifest.observation]
    share = np.linspace(0.0, 1.0, EXAMPLE_STEPS)[:, None]
    observation = np.concatenate([low + share * (high - low) for low, high in ranges], axis=1)
    forces = np.zeros((EXAMPLE_STEPS, len(manifest.force)), np.float32)
    return make_package(model, manifest, Example(0, observation.astype(np.float32), forces))


def sound(package: Package) -> Package:
    """The package with a record of what its graph computes here."""
    predictor, observation = PackagePredictor(package), package.example.observation
    force = np.stack([predictor.step(o) for o in observation])
    return make_package(package.model_bytes, package.manifest, Example(0, observation, force))


def gantry_package(lead_s: float, *, gain: float = 0.0, **changes: object) -> Package:
    """A sound package with the gantry's channels, whose force is `gain` times their sum."""
    body = (
        f"t (float[B, {len(OBSERVATION)}] observation) => (float[B, 1] force)"
        "{ sum = ReduceSum <keepdims: int = 1> (observation, axes) force = Mul (sum, gain) }"
    )
    model = parsed(body, {"axes": np.array([1]), "gain": np.float32(gain)})
    channels = [{"name": n, "unit": u, "min": -9.0, "max": 9.0} for n, u in OBSERVATION]
    force = [{"name": "force_z_n", "unit": "N", "min": -2.0, "max": 1.0}]
    fields = {"lead_s": lead_s, "observation": channels, "force": force}
    manifest = tiny_manifest("none", **(fields | changes))
    return sound(package_of(model.SerializeToString(), manifest))


def with_manifest(model: bytes, **changes: object) -> bytes:
    """The model with other fields in its manifest; "absent" leaves one out."""
    entries = onnx_wire.metadata(model)
    manifest = json.loads(entries[MANIFEST_KEY]) | changes
    manifest = {key: value for key, value in manifest.items() if value != "absent"}
    return sealed(model, entries | {MANIFEST_KEY: json.dumps(manifest)})
