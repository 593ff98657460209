"""Package to force, one observation at a time: the runner that ships; parity is measured with it.

Tensors live in buffers that are bound once; a step copies the observation in, runs the graph and
copies the force out. State tensors alternate between two sets of buffers and are never copied.
"""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from runtime.stepped import SteppedPredictor
from wakedeploy.core.errors import CheckFailed, UnusableInput, installs, one_line
from wakedeploy.core.manifest import FloatArray, Manifest, Memory
from wakedeploy.core.package import Package

if TYPE_CHECKING:
    import onnxruntime as ort

_LONGEST = 300  # letters of what onnxruntime says, which may quote the model


def inference_session(model_bytes: bytes) -> "ort.InferenceSession":
    """The one place where onnxruntime sessions are built: one thread, sequential, no spinning.

    With the defaults, idle threads spin between the ticks of a 32 Hz loop. Raises UnusableInput
    where onnxruntime does not accept the model, or is not installed.
    """
    ort = _onnxruntime()
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 4  # what it logs at lower levels is in the exception too
    for pool in ("intra_op", "inter_op"):
        options.add_session_config_entry(f"session.{pool}.allow_spinning", "0")
    try:
        session = ort.InferenceSession(model_bytes, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions have no common base of their own
        raise UnusableInput(
            f"onnxruntime {ort.__version__} cannot load the model ({one_line(error)[:_LONGEST]});"
            " upgrade onnxruntime, or make the package again with `wakedeploy export`"
        ) from error
    session._model_bytes = None  # kept for a change of provider, which never comes; megabytes
    return session


def _onnxruntime() -> Any:
    """Loaded with the first session: C does without it, and a base install has none."""
    try:
        import onnxruntime
    except ImportError as error:
        raise UnusableInput(
            f"onnxruntime, which packages need, cannot be loaded here ({one_line(error)}):"
            f" {installs('onnx')}; or fly the package as C: run-gantry --backend c."
        ) from error
    return onnxruntime


class PackagePredictor(SteppedPredictor):
    """A package, stepped by onnxruntime."""

    def __init__(self, package: Package, *, batch: int = 1) -> None:
        super().__init__(package.manifest, batch)
        self._source = _source(self.manifest, batch)
        self._states = tuple(_states(self.manifest.memory, batch) for _ in range(2))
        self._initial = _states(self.manifest.memory, batch)
        self._session = inference_session(package.model_bytes)
        self._bindings = tuple(self._binding(turn) for turn in range(2))
        self.reset()

    def _forget(self) -> None:
        for name, initial in self._initial.items():
            np.copyto(self._states[0][name], initial)

    def _compute(self, newest: npt.NDArray[np.generic]) -> None:
        self._source.push(newest, first=self._seen == 0)
        try:
            self._session.run_with_iobinding(self._bindings[self._seen % 2])
        except Exception as error:  # onnxruntime's exceptions have no common base of their own
            raise CheckFailed(
                f"onnxruntime {version('onnxruntime')} cannot compute a step of the model"
                f" ({one_line(error)[:_LONGEST]}); make the package again with `wakedeploy export`."
            ) from error

    def _binding(self, turn: int) -> "ort.IOBinding":
        """Buffers for even (0) or odd (1) steps: states read from one set, left in the other."""
        binding = self._session.io_binding()
        then, now = self._states[turn], self._states[1 - turn]
        inputs = {self._source.name: self._source.tensor}
        outputs = {"force": self._force}
        inputs |= {f"state_{name}": array for name, array in then.items()}
        outputs |= {f"next_state_{name}": array for name, array in now.items()}
        for name, array in inputs.items():
            binding.bind_input(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        for name, array in outputs.items():
            binding.bind_output(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        return binding


class _Source(Protocol):
    """What turns observations into the graph's first input."""

    name: str
    tensor: FloatArray

    def push(self, observation: npt.NDArray[np.generic], *, first: bool) -> None: ...


class _Newest:
    """The newest observation alone, (B, d)."""

    name = "observation"

    def __init__(self, batch: int, d: int) -> None:
        self.tensor: FloatArray = np.zeros((batch, d), np.float32)

    def push(self, observation: npt.NDArray[np.generic], *, first: bool) -> None:
        self.tensor[:] = observation


class _Window:
    """`k` snapshots, `stride` samples apart, oldest first (B, K, d).

    Each sample is written twice into a ring of twice the span, so that the newest `span` samples
    are always one slice. The first sample stands in for those before it.
    """

    name = "window"

    def __init__(self, batch: int, d: int, k: int, stride: int) -> None:
        self.tensor: FloatArray = np.zeros((batch, k, d), np.float32)
        self._stride, self._span, self._index = stride, (k - 1) * stride + 1, 0
        self._ring: FloatArray = np.zeros((batch, 2 * self._span, d), np.float32)

    def push(self, observation: npt.NDArray[np.generic], *, first: bool) -> None:
        if first:
            self._ring[:] = observation[..., None, :]
        self._index = (self._index + 1) % self._span
        newest = self._index + self._span
        self._ring[:, self._index] = observation
        self._ring[:, newest] = observation
        np.copyto(self.tensor, self._ring[:, self._index + 1 : newest + 1 : self._stride])


def _source(manifest: Manifest, batch: int) -> _Source:
    memory, d = manifest.memory, len(manifest.observation)
    if memory.kind == "window":
        return _Window(batch, d, memory.k, memory.stride)
    return _Newest(batch, d)


def _states(memory: Memory, batch: int) -> dict[str, FloatArray]:
    return {name: state.initial_array(batch) for name, state in memory.states.items()}
