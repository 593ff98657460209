"""What a package says about itself: every field has bounds, and they fit each other.

A package may come from anyone. Whatever a manifest asks for is therefore limited before anything is
made of it: numbers by their bounds here, names and texts by length and letters, states and windows
by the memory that they take. docs/reference/package.md lists the bounds.
"""

import math
from typing import Annotated, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

SCHEMA = 3
PARAMETER_BUDGET = 100_000  # trainable weights must stay below this (paper, § Model Architectures)
PARITY_STEPS = 3200
PARITY_LIMIT = 1e-5
WORST_FLOAT32_ERROR = 1e-3  # of a reservoir against float64; ten times the worst that was seen
FORCE_MARGIN = 0.5  # beyond each end of a force's range, in widths of that range

MOST_CHANNELS = 100
MOST_SNAPSHOTS = 1000
MOST_STEPS = 100_000  # that a window spans, or that a memory takes to fill
MOST_STATES = 64
MOST_STATE_VALUES = 1_000_000  # of all states together
MOST_FROZEN = 1 << 24  # 64 MiB of float32, which no file exceeds
_LARGEST = 1e12  # squares of it are still float32

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=100)]
# Without control characters: these go to terminals. A count in the pattern costs 10 MB of memory.
Text = Annotated[str, Field(pattern=r"^\P{C}*$", max_length=100)]
Unit = Annotated[str, Field(pattern=r"^\P{C}*$", max_length=32)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Size = Annotated[int, Field(ge=1, le=MOST_STATE_VALUES)]
Steps = Annotated[int, Field(ge=1, le=MOST_STEPS)]
Real = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
Error = Annotated[float, Field(ge=0, le=_LARGEST)]
FloatArray = npt.NDArray[np.float32]


def parity_limit(float64_rel: float | None) -> float:
    """The largest relative difference allowed: thrice the float32 error where that is measured.

    Two computations in float32, each off by that much, were seen to differ by 2.3 times as much.
    """
    return max(PARITY_LIMIT, 3 * (float64_rel or 0.0))


def _plain(value: JsonValue) -> JsonValue:
    """A hyper-parameter is a number, a short text, true, false or null."""
    if isinstance(value, list | dict):
        raise ValueError("neither a number nor a text")
    if isinstance(value, str) and not (value.isprintable() and len(value) <= 100):
        raise ValueError("more than 100 letters, or one that cannot be printed")
    if isinstance(value, int | float) and not abs(value) <= _LARGEST:
        raise ValueError(f"beyond {_LARGEST:g}")
    return value


Hyper = Annotated[JsonValue, AfterValidator(_plain)]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Quantity(_Record):
    """Something measured or predicted: its name and its unit."""

    name: Name
    unit: Unit


class _Ranged(Quantity):
    min: Real
    max: Real

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min > self.max:
            raise ValueError(f"{self.name}: min {self.min} lies above max {self.max}")
        return self


class ObservationChannel(_Ranged):
    """One input of the predictor, with the range that it took in the training episodes.

    `filtered` says how it was filtered before it was learnt from; who steps the predictor has to
    filter likewise. Empty where it was not.
    """

    filtered: Text = ""

    @model_serializer(mode="wrap")
    def _told_where_filtered(self, rest: SerializerFunctionWrapHandler) -> dict[str, JsonValue]:
        """Left out where it is empty: most packages then read as they always did."""
        entries: dict[str, JsonValue] = rest(self)
        return {name: value for name, value in entries.items() if name != "filtered" or value}


class ForceChannel(_Ranged):
    """One output of the predictor, with the range that it took in the training episodes.

    `min` and `max` are in `unit`, as recorded. A prediction between `low` and `high` is possible:
    these lie FORCE_MARGIN widths of the range beyond it, and the exported graph limits its force to
    them. A force at a limit is therefore one that the predictor does not know.
    """

    @property
    def width(self) -> float:
        """The width of the range; 1 where the force never moved, as in its normalisation."""
        return self.max - self.min or 1.0

    @property
    def low(self) -> float:
        """The smallest prediction that is possible, in `unit`."""
        return _as_float32(self.min - FORCE_MARGIN * self.width)

    @property
    def high(self) -> float:
        """The largest prediction that is possible, in `unit`."""
        return _as_float32(self.max + FORCE_MARGIN * self.width)

    def is_possible(self, force: float) -> bool:
        """Whether a prediction in `unit` is one: within the limits and at none of them."""
        return self.low < force < self.high


def _as_float32(value: float) -> float:
    """As the graph holds it, so that a force at a limit is equal to it."""
    return float(np.float32(value))


class State(_Record):
    """A tensor carried from step to step; `shape` leaves out the batch axis, which comes first.

    `initial` is one value for all elements, or one for each in row-major order.
    """

    shape: Annotated[tuple[Size, ...], Field(max_length=4)]
    initial: Real | tuple[Real, ...] = 0.0

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if not isinstance(self.initial, float) and len(self.initial) != self.size:
            raise ValueError(f"{len(self.initial)} initial values for a shape of {self.size}")
        return self

    @property
    def size(self) -> int:
        """How many values it has."""
        return math.prod(self.shape)

    def initial_array(self, batch: int) -> FloatArray:
        """The state before the first step, float32 (batch, *shape)."""
        state = np.asarray(self.initial, np.float32)
        state = np.full(self.shape, state) if state.ndim == 0 else state.reshape(self.shape)
        return np.repeat(state[None], batch, axis=0)


class Memory(_Record):
    """What a predictor remembers: nothing, `k` snapshots `stride` samples apart, or states."""

    kind: Literal["none", "window", "state"]
    k: Annotated[int, Field(ge=1, le=MOST_SNAPSHOTS)] = 1
    stride: Steps = 1
    states: Annotated[dict[Name, State], Field(max_length=MOST_STATES)] = {}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.kind == "state") != bool(self.states):
            raise ValueError(f"memory {self.kind!r} with {len(self.states)} states")
        if self.kind != "window" and (self.k, self.stride) != (1, 1):
            raise ValueError(f"memory {self.kind!r} with a window of {self.k} snapshots")
        if self.span > MOST_STEPS:
            raise ValueError(f"a window of {self.span} samples, where {MOST_STEPS} may be")
        values = sum(state.size for state in self.states.values())
        if values > MOST_STATE_VALUES:
            raise ValueError(f"states of {values} values, where {MOST_STATE_VALUES} may be")
        return self

    @property
    def span(self) -> int:
        """How many samples the window reaches over, the newest among them."""
        return (self.k - 1) * self.stride + 1


class Parity(_Record):
    """Worst difference between exported graph and training-time forward over a long rollout.

    `max_abs` is in the unit of the channel where it occurred; `max_rel` is max|Δ| over the range of
    the reference, as `runtime.replay.compare` has it, of the worst channel, and must not exceed
    `limit`. `float64_rel` is the same measure between the
    training-time forward in float32 and in float64, for the architecture whose limit rests on it.
    """

    max_abs: Error
    max_rel: Error
    steps: Annotated[int, Field(ge=0, le=1_000_000_000)]
    limit: Annotated[float, Field(gt=0, le=3 * WORST_FLOAT32_ERROR)]
    float64_rel: Annotated[float, Field(ge=0, le=WORST_FLOAT32_ERROR)] | None = None

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

    rmse: Annotated[dict[Text, Error], Field(max_length=MOST_CHANNELS)]
    r2: Annotated[dict[Text, float | None], Field(max_length=MOST_CHANNELS)]


class Manifest(_Record):
    """Everything that a package says about itself; `graph_sha256` covers all but the metadata."""

    schema_version: Annotated[int, Field(alias="schema", ge=SCHEMA, le=SCHEMA)] = SCHEMA
    arch: Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]{0,39}$")]
    hyper: Annotated[dict[Name, Hyper], Field(max_length=64)]
    domain: Text
    rate_hz: Annotated[float, Field(ge=0.001, le=100_000)]
    lead_s: Annotated[float, Field(ge=0, le=3600)]
    observation: Annotated[
        tuple[ObservationChannel, ...], Field(min_length=1, max_length=MOST_CHANNELS)
    ]
    force: Annotated[tuple[ForceChannel, ...], Field(min_length=1, max_length=MOST_CHANNELS)]
    memory: Memory
    warm_up_steps: Steps
    trainable: Annotated[int, Field(ge=0, lt=PARAMETER_BUDGET)]
    frozen: Annotated[int, Field(ge=0, le=MOST_FROZEN)]
    data_sha256: Sha256
    seed: Annotated[int, Field(ge=0, lt=1 << 63)]
    test: Scores | None
    parity: Parity
    versions: Annotated[dict[Text, Text], Field(max_length=32)]
    graph_sha256: Sha256

    @model_validator(mode="after")
    def _warm_up_follows(self) -> Self:
        if self.memory.kind != "state" and self.warm_up_steps != self.memory.span:
            raise ValueError(f"warm_up_steps {self.warm_up_steps} where {self.memory.span} follows")
        return self

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
