"""The contract between export and runtime: one .onnx file and what it declares about itself.

Two metadata entries travel in the file: the manifest, and an example rollout that a machine
without torch can replay. Neither reading nor writing them needs the onnx package.
"""

import base64
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from wakedeploy import onnx_wire
from wakedeploy.errors import UnusableInput
from wakedeploy.files import sha256_of, write_whole
from wakedeploy.validation import first_problem

SCHEMA = 1
MANIFEST_KEY = "wakedeploy_manifest"
EXAMPLE_KEY = "wakedeploy_example"
PARITY_STEPS = 3200
PARITY_LIMIT = 1e-5

FloatArray = npt.NDArray[np.float32]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Size = Annotated[int, Field(ge=1)]


def parity_limit(float64_rel: float | None) -> float:
    """The largest relative difference allowed: twice the float32 error where that is measured."""
    return max(PARITY_LIMIT, 2 * (float64_rel or 0.0))


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ObservationChannel(_Record):
    """One input of the predictor, with the range that it took in the training episodes."""

    name: Name
    unit: str
    min: float
    max: float

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min > self.max:
            raise ValueError(f"{self.name}: min {self.min} lies above max {self.max}")
        return self


class ForceChannel(_Record):
    """One output of the predictor."""

    name: Name
    unit: str


class State(_Record):
    """A tensor carried from step to step; `shape` leaves out the batch axis, which comes first.

    `initial` is one value for all elements, or one for each in row-major order.
    """

    shape: tuple[Size, ...]
    initial: float | tuple[float, ...] = 0.0

    @model_validator(mode="after")
    def _complete(self) -> Self:
        size = int(np.prod(self.shape))
        if not isinstance(self.initial, float) and len(self.initial) != size:
            raise ValueError(f"{len(self.initial)} initial values for a shape of {size}")
        return self

    def initial_array(self, batch: int) -> FloatArray:
        """The state before the first step, float32 (batch, *shape)."""
        one = np.asarray(self.initial, np.float32)
        one = np.full(self.shape, one) if one.ndim == 0 else one.reshape(self.shape)
        return np.repeat(one[None], batch, axis=0)


class Memory(_Record):
    """What a predictor remembers: nothing, `k` snapshots `stride` samples apart, or states."""

    kind: Literal["none", "window", "state"]
    k: Size = 1
    stride: Size = 1
    states: dict[Name, State] = {}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.kind == "state") != bool(self.states):
            raise ValueError(f"memory {self.kind!r} with {len(self.states)} states")
        if self.kind != "window" and (self.k, self.stride) != (1, 1):
            raise ValueError(f"memory {self.kind!r} with a window of {self.k} snapshots")
        return self


class Parity(_Record):
    """Worst difference between exported graph and training-time forward over a long rollout.

    `max_abs` is in the unit of the channel where it occurred; `max_rel` is max|Δ| / max|reference|
    of the worst channel and must not exceed `limit`. `float64_rel` is the same measure between the
    training-time forward in float32 and in float64, for the architecture whose limit rests on it.
    """

    max_abs: Annotated[float, Field(ge=0)]
    max_rel: Annotated[float, Field(ge=0)]
    steps: Annotated[int, Field(ge=0)]
    limit: Annotated[float, Field(gt=0)]
    float64_rel: Annotated[float, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _limit_follows(self) -> Self:
        if self.limit != parity_limit(self.float64_rel):
            raise ValueError(f"limit {self.limit} where {parity_limit(self.float64_rel)} follows")
        return self

    @property
    def passed(self) -> bool:
        """Whether enough steps were compared and no channel differed by more than the limit."""
        return self.steps >= PARITY_STEPS and self.max_rel <= self.limit


class Scores(_Record):
    """Errors on the test episodes, per force channel; R² is null where the force never changes."""

    rmse: dict[str, float]
    r2: dict[str, float | None]


class Manifest(_Record):
    """Everything that a package says about itself; `graph_sha256` covers all but the metadata."""

    schema_version: Annotated[int, Field(alias="schema", ge=1)] = SCHEMA
    arch: Annotated[str, Field(min_length=1)]
    hyper: dict[str, Any]
    domain: str
    rate_hz: Annotated[float, Field(gt=0)]
    lead_s: Annotated[float, Field(ge=0)]
    observation: Annotated[tuple[ObservationChannel, ...], Field(min_length=1)]
    force: Annotated[tuple[ForceChannel, ...], Field(min_length=1)]
    memory: Memory
    warm_up_steps: Size
    trainable: Annotated[int, Field(ge=0)]
    frozen: Annotated[int, Field(ge=0)]
    data_sha256: Sha256
    seed: int
    test: Scores | None
    parity: Parity
    versions: dict[str, str]
    graph_sha256: Sha256

    def inputs(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes, without the batch axis, of what the graph must take."""
        d = len(self.observation)
        if self.memory.kind == "window":
            return {"window": (self.memory.k, d)}
        states = {f"state_{name}": state.shape for name, state in self.memory.states.items()}
        return {"observation": (d,)} | states

    def outputs(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes, without the batch axis, of what the graph must give."""
        states = {f"next_state_{name}": state.shape for name, state in self.memory.states.items()}
        return {"force": (len(self.force),)} | states


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
    return Package(manifest, onnx_wire.with_metadata(model, entries), example)


def write_package(package: Package, path: Path) -> None:
    """Write a package as one file, whole or not at all."""
    write_whole(path, lambda temporary: _write_bytes(temporary, package.model_bytes))


def read_package(path: Path | str) -> Package:
    """Read and validate a package.

    Raises UnusableInput where the file is absent, foreign, truncated, altered, or made by a newer
    release, and where manifest, example and graph do not belong together.
    """
    path = Path(path)
    try:
        return package_from_bytes(path.read_bytes(), path.name)
    except OSError as error:
        raise UnusableInput(
            f"{path}: cannot be read ({error.strerror}); give the path of a package made by"
            " `wakedeploy export`"
        ) from error


def package_from_bytes(model: bytes, name: str) -> Package:
    """`read_package` for bytes already in memory; `name` is what errors call them."""
    try:
        entries, signature = onnx_wire.metadata(model), onnx_wire.signature(model)
    except onnx_wire.MalformedModel as error:
        raise UnusableInput(
            f"{name}: not an ONNX model, or a truncated one ({error}); copy it again or make it"
            " again with `wakedeploy export`"
        ) from error
    manifest = _manifest(entries, name)
    _require_own_graph(manifest, signature, model, name)
    return Package(manifest, model, _example(entries, manifest, name))


def _manifest(entries: dict[str, str], name: str) -> Manifest:
    if MANIFEST_KEY not in entries:
        raise UnusableInput(
            f"{name}: an ONNX model without a wakedeploy manifest; make packages with"
            " `wakedeploy export`"
        )
    _require_known_schema(entries[MANIFEST_KEY], name)
    try:
        return Manifest.model_validate_json(entries[MANIFEST_KEY])
    except ValidationError as error:
        raise UnusableInput(f"{name}: manifest: {first_problem(error)}; {_REMAKE}") from error


_REMAKE = "make the package again with `wakedeploy export`"


def _require_known_schema(text: str, name: str) -> None:
    try:
        schema = json.loads(text)["schema"]
        newer = schema > SCHEMA
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UnusableInput(f"{name}: its manifest states no schema version; {_REMAKE}") from error
    if newer:
        raise UnusableInput(
            f"{name}: made by a newer release (manifest schema {schema}, this one reads {SCHEMA});"
            " upgrade wakedeploy on this machine"
        )


def _require_own_graph(
    manifest: Manifest, signature: onnx_wire.Signature, model: bytes, name: str
) -> None:
    """Refuse a graph that takes or gives other tensors than the manifest says, or other bytes."""
    for word, found, declared in (
        ("takes", signature.inputs, manifest.inputs()),
        ("gives", signature.outputs, manifest.outputs()),
    ):
        expected = [(key, onnx_wire.FLOAT32, shape) for key, shape in declared.items()]
        if expected != [(t.name, t.element, t.shape[1:]) for t in found]:
            raise UnusableInput(
                f"{name}: its graph {word} {_told(found)} but its manifest declares"
                f" {_declared(declared)} as float32; {_REMAKE}"
            )
    if any(tensor.shape[:1] and isinstance(tensor.shape[0], int) for tensor in signature.inputs):
        raise UnusableInput(f"{name}: the batch axis of its graph is fixed; {_REMAKE}")
    if signature.external_data:
        raise UnusableInput(f"{name}: its weights lie in another file; {_REMAKE}")
    if graph_sha256(model) != manifest.graph_sha256:
        raise UnusableInput(
            f"{name}: the graph's sha256 differs from the manifest's, so the file was damaged or"
            " altered; copy it again or make it again with `wakedeploy export`"
        )


def _told(tensors: tuple[onnx_wire.Tensor, ...]) -> str:
    return ", ".join(f"{t.name} ({', '.join(map(str, t.shape))})" for t in tensors) or "nothing"


def _declared(shapes: dict[str, tuple[int, ...]]) -> str:
    return ", ".join(f"{key} ({', '.join(map(str, ('batch', *s)))})" for key, s in shapes.items())


def _example(entries: dict[str, str], manifest: Manifest, name: str) -> Example:
    try:
        example = Example.from_json(entries[EXAMPLE_KEY])
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise UnusableInput(f"{name}: its example rollout is unreadable; {_REMAKE}") from error
    steps = len(example.observation)
    expected = ((steps, len(manifest.observation)), (steps, len(manifest.force)))
    if steps == 0 or (example.observation.shape, example.force.shape) != expected:
        raise UnusableInput(
            f"{name}: its example rollout has the shapes {example.observation.shape} and"
            f" {example.force.shape}, which do not fit its channels; {_REMAKE}"
        )
    return example


def _encoded(array: FloatArray) -> dict[str, Any]:
    data = np.ascontiguousarray(array, "<f4").tobytes()
    return {"shape": list(array.shape), "float32": base64.b64encode(data).decode()}


def _decoded(entry: dict[str, Any]) -> FloatArray:
    flat = np.frombuffer(base64.b64decode(entry["float32"], validate=True), "<f4")
    return flat.reshape(tuple(int(n) for n in entry["shape"])).astype(np.float32)


def _write_bytes(path: Path, data: bytes) -> None:
    path.write_bytes(data)
