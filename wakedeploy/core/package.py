"""The contract between export and runtime: one .onnx file and what it declares about itself.

Three metadata entries travel in the file: the manifest, an example rollout that a machine without
torch can replay, and a hash over these two. Reading and writing them needs no onnx package.
"""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import ValidationError

from wakedeploy.core import onnx_wire
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import sha256_of, write_bytes_whole
from wakedeploy.core.manifest import PARAMETER_BUDGET, SCHEMA, FloatArray, Manifest
from wakedeploy.core.onnx_graph import (
    FLOAT32,
    ForbiddenGraph,
    Graph,
    Shape,
    Tensor,
    quoted,
    read_graph,
)
from wakedeploy.core.onnx_shapes import cost_of
from wakedeploy.core.validation import first_problem

MANIFEST_KEY = "wakedeploy_manifest"
EXAMPLE_KEY = "wakedeploy_example"
SHA256_KEY = "wakedeploy_sha256"  # of the two others; the manifest has the graph's
EXAMPLE_STEPS = 512
MOST_BYTES = 1 << 26  # of a file: 64 MiB, a reservoir of 4,000 neurons
_ROUNDING = 1e-6  # of a bound, in float32
BATCHES = (1, 2)  # series in lockstep that a graph has to serve: one in flight, two in the check


@dataclass(frozen=True, eq=False)
class Example:
    """A rollout from the initial state: seeded inputs and what the training-time forward gave.

    `observation` is float32 (T, d), `force` float32 (T, o), both SI.
    """

    seed: int
    observation: FloatArray
    force: FloatArray

    def to_json(self) -> str:
        """The metadata entry: little-endian float32 in base64, with their shapes."""
        arrays = {"observation": self.observation, "force": self.force}
        return json.dumps({"seed": self.seed} | {k: _encoded(v) for k, v in arrays.items()})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The inverse of `to_json`; raises ValueError, KeyError, TypeError or OverflowError."""
        entry = json.loads(text)
        return cls(int(entry["seed"]), _decoded(entry["observation"]), _decoded(entry["force"]))

    def problem(self, manifest: Manifest) -> str | None:
        """The first value that the manifest does not allow, in a clause; None where all are.

        Inputs lie within the ranges seen in training, forces within their limits.
        """
        seen = [(c.name, c.min, c.max) for c in manifest.observation]
        possible = [(c.name, c.low, c.high) for c in manifest.force]
        columns = [*self.observation.T, *self.force.T]
        for (name, low, high), column in zip(seen + possible, columns, strict=True):
            slack = _ROUNDING * max(abs(low), abs(high))
            outside = column[~((column >= low - slack) & (column <= high + slack))]
            if len(outside):
                return f"{name} is {outside[0]:g} where {low:g} to {high:g} is possible"
        return None


@dataclass(frozen=True, eq=False)
class Package:
    """A package in memory: the manifest, the bytes of the whole file, and the example rollout."""

    manifest: Manifest
    model_bytes: bytes
    example: Example

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the whole file, which run logs record."""
        return sha256_of(self.model_bytes)


def graph_sha256(model: bytes) -> str:
    """SHA-256 of a model without its metadata entries."""
    return sha256_of(onnx_wire.without_metadata(model))


def make_package(model: bytes, manifest: Manifest, example: Example) -> Package:
    """Put manifest and example rollout into a model; the manifest's graph hash is filled in."""
    manifest = manifest.model_copy(update={"graph_sha256": graph_sha256(model)})
    entries = {
        MANIFEST_KEY: manifest.model_dump_json(by_alias=True),
        EXAMPLE_KEY: example.to_json(),
    }
    return Package(manifest, sealed(model, entries), example)


def sealed(model: bytes, entries: Mapping[str, str]) -> bytes:
    """The model with these metadata entries, and with the hash over manifest and example."""
    entries = {**entries, SHA256_KEY: _metadata_sha256(entries)}
    return onnx_wire.with_metadata(model, entries)


def _metadata_sha256(entries: Mapping[str, str]) -> str:
    texts = (entries.get(key, "") for key in (MANIFEST_KEY, EXAMPLE_KEY))
    return sha256_of("\0".join(texts).encode())


def write_package(package: Package, path: Path) -> None:
    """Write a package as one file, whole or not at all."""
    write_bytes_whole(path, package.model_bytes)


def read_package(path: Path | str) -> Package:
    """Read and validate a package.

    Raises UnusableInput where the file is absent, foreign, truncated, altered, or made by another
    release; where manifest, example and graph do not belong together; and where any of them asks
    for what no package may: see docs/reference/package.md.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            model = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise UnusableInput(
            f"{path}: cannot be read ({error.strerror}); give the path of a package made by"
            " `wakedeploy export`"
        ) from error
    return package_from_bytes(model, str(path))


def package_from_bytes(model: bytes, name: str) -> Package:
    """`read_package` for bytes already in memory; `name` is what errors call them."""
    if len(model) > MOST_BYTES:
        raise UnusableInput(
            f"{name}: larger than {MOST_BYTES >> 20} MiB, which no package is; give one made by"
            " `wakedeploy export`"
        )
    try:
        entries, graph_hash = onnx_wire.metadata(model), graph_sha256(model)
        manifest = _manifest(entries, name)
        _require_whole(manifest, graph_hash, name)
        graph = read_graph(model)
        _require_own_graph(manifest, graph, name)
        for batch in BATCHES:
            _require_bounded(manifest, graph, batch, name)
    except onnx_wire.MalformedModel as error:
        raise UnusableInput(
            f"{name}: not an ONNX model, or a truncated one ({error}); copy it again or make it"
            " again with `wakedeploy export`"
        ) from error
    except ForbiddenGraph as error:
        raise UnusableInput(f"{name}: its graph {error}; {_REMAKE}") from error
    return Package(manifest, model, _example(entries, manifest, name))


def _manifest(entries: dict[str, str], name: str) -> Manifest:
    if MANIFEST_KEY not in entries:
        raise UnusableInput(
            f"{name}: an ONNX model without a wakedeploy manifest; make packages with"
            " `wakedeploy export`"
        )
    _require_known_schema(entries[MANIFEST_KEY], name)
    _require_own_metadata(entries, name)
    try:
        return Manifest.model_validate_json(entries[MANIFEST_KEY])
    except ValidationError as error:
        raise UnusableInput(f"{name}: manifest: {first_problem(error)}; {_REMAKE}") from error


_REMAKE = "make the package again with `wakedeploy export`"


def _require_known_schema(text: str, name: str) -> None:
    try:
        schema = json.loads(text)["schema"]
        newer, older = schema > SCHEMA, schema < SCHEMA
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UnusableInput(f"{name}: its manifest states no schema version; {_REMAKE}") from error
    if newer:
        raise UnusableInput(
            f"{name}: made by a newer release (manifest schema {quoted(str(schema))}, this one"
            f" reads {SCHEMA}); upgrade wakedeploy on this machine"
        )
    if older:
        raise UnusableInput(
            f"{name}: made by an older release (manifest schema {quoted(str(schema))}, this one"
            f" reads {SCHEMA}); export its run again with `wakedeploy export`"
        )


def _require_own_metadata(entries: Mapping[str, str], name: str) -> None:
    """Refuse a manifest or an example that somebody or something changed after the export."""
    if entries.get(SHA256_KEY) != _metadata_sha256(entries):
        raise UnusableInput(
            f"{name}: the sha256 of its manifest and example rollout differs from the stated one,"
            " so they were damaged or altered; copy it again or make it again with `wakedeploy"
            " export`"
        )


def _require_whole(manifest: Manifest, graph_hash: str, name: str) -> None:
    if graph_hash != manifest.graph_sha256:
        raise UnusableInput(
            f"{name}: the graph's sha256 differs from the manifest's, so the file was damaged or"
            " altered; copy it again or make it again with `wakedeploy export`"
        )


def _require_own_graph(manifest: Manifest, graph: Graph, name: str) -> None:
    """Refuse a graph that takes or gives other tensors than the manifest says, or more weights."""
    for word, found, declared in (
        ("takes", graph.inputs, manifest.inputs()),
        ("gives", graph.outputs, manifest.outputs()),
    ):
        expected = [(key, FLOAT32, shape) for key, shape in declared.items()]
        if expected != [(t.name, t.element, t.shape[1:]) for t in found]:
            raise UnusableInput(
                f"{name}: its graph {word} {_tensors_text(found)} but its manifest declares"
                f" {_declared(declared)} as float32; {_REMAKE}"
            )
    if any(isinstance(tensor.shape[0], int) for tensor in graph.inputs):
        raise UnusableInput(f"{name}: the batch axis of its graph is fixed; {_REMAKE}")
    stated = manifest.trainable + manifest.frozen
    weights = sum(c.size for c in graph.constants.values() if c.element == FLOAT32)
    if weights > 2 * stated + PARAMETER_BUDGET:  # some are kept twice, and tables of positions
        raise UnusableInput(
            f"{name}: its graph holds {weights:,} weights and its manifest declares {stated:,};"
            f" {_REMAKE}"
        )


def _require_bounded(manifest: Manifest, graph: Graph, batch: int, name: str) -> None:
    """Refuse a graph whose step takes too much, or gives other shapes than it says."""
    shapes, _ = cost_of(graph, batch)
    for tensor, shape in manifest.outputs().items():
        if shapes.get(tensor) != (batch, *shape):
            raise UnusableInput(
                f"{name}: {tensor} comes out of its graph as {shapes.get(tensor)} where"
                f" {(batch, *shape)} is declared; {_REMAKE}"
            )


def _tensors_text(tensors: tuple[Tensor, ...]) -> str:
    texts = [f"{quoted(t.name)} ({', '.join(map(str, t.shape))})"[:100] for t in tensors[:8]]
    return ", ".join(texts) or "nothing"


def _declared(shapes: dict[str, Shape]) -> str:
    texts = [f"{k} ({', '.join(map(str, ('batch', *s)))})" for k, s in list(shapes.items())[:8]]
    return ", ".join(texts)


def _example(entries: dict[str, str], manifest: Manifest, name: str) -> Example:
    try:
        example = Example.from_json(entries[EXAMPLE_KEY])
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise UnusableInput(f"{name}: its example rollout is unreadable; {_REMAKE}") from error
    expected = tuple((EXAMPLE_STEPS, len(part)) for part in (manifest.observation, manifest.force))
    if (example.observation.shape, example.force.shape) != expected:
        raise UnusableInput(
            f"{name}: its example rollout has the shapes {example.observation.shape} and"
            f" {example.force.shape}, which do not fit its channels and {EXAMPLE_STEPS} steps;"
            f" {_REMAKE}"
        )
    problem = example.problem(manifest)
    if problem:
        raise UnusableInput(f"{name}: in its example rollout {problem}; {_REMAKE}")
    return example


def _encoded(array: FloatArray) -> dict[str, Any]:
    data = np.ascontiguousarray(array, "<f4").tobytes()
    return {"shape": list(array.shape), "float32": base64.b64encode(data).decode()}


def _decoded(entry: dict[str, Any]) -> FloatArray:
    flat = np.frombuffer(base64.b64decode(entry["float32"], validate=True), "<f4")
    return flat.reshape(tuple(int(n) for n in entry["shape"])).astype(np.float32)
