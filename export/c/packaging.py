"""A package becomes C: written, compiled, held against the reference, and only then given a name.

Float32 is held against the training-time forward: on real episodes where the trained run is at
hand, and on inputs that the self-test makes in any case. Rounded weights are held against the same
graph with the same rounded weights, computed in float64; what the rounding itself changes is
measured apart and has a tolerance of its own.
"""

import contextlib
import importlib.util
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from export.c.identifiers import require_name
from export.c.interpreter import Interpreter, Wide
from export.c.lowering import lowered
from export.c.program import Program
from export.c.readme import page
from export.c.real import Real
from export.c.rounding import rounded_together
from export.c.selftest import self_test
from export.c.source import Model, header, source
from export.c.weights import Kind
from export.c.writer import NotInC
from runtime.compiled.compiler import PLAIN, BuildFailed, host_compiler, native_flags, version_of
from runtime.compiled.driven import driven
from runtime.compiled.folder import CFolder, Document, Proof, Rounding, read_c_folder, sealed
from runtime.compiled.predictor import CompiledPredictor
from runtime.compiled.proof import Proved, proved
from runtime.replay import compare, rolled_out
from wakedeploy.core.errors import CheckFailed, UnusableInput, why
from wakedeploy.core.files import sha256_of
from wakedeploy.core.manifest import FloatArray
from wakedeploy.core.onnx_graph import Graph, read_graph
from wakedeploy.core.package import Package

TOLERANCE = 0.02  # by which share rounded weights may make the error grow
_FORWARD = "the training-time forward"
_GRAPH = "the package's graph in onnxruntime"
_WIDE = "the package's graph in float64"
_ROUNDED = "the package's graph with the same rounded weights, in float64,"

Forward = Callable[[FloatArray], FloatArray]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Wish:
    """How C shall be: weights, functions' name, further flags to prove it with, tolerance."""

    kind: Kind = "float32"
    name: str | None = None
    flags: tuple[str, ...] = ()
    tolerance: float = TOLERANCE


def require_free(folder: Path) -> None:
    """UnusableInput where a file or a folder is in the way."""
    if folder.exists() or folder.is_symlink():
        raise UnusableInput(
            f"{folder}: is there already; name another folder for the C, or remove that one."
        )


def export_c(
    package: Package,
    folder: Path,
    wish: Wish,
    *,
    forward: Forward | None = None,
    real: Real | None = None,
    progress: Progress = lambda done, total: None,
) -> CFolder:
    """Write a package as C into a new folder, once every build of it has passed the gate.

    `forward` is the training-time forward (T, d) -> (T, o), limited as the package is. Without it
    the reference is the package itself, which passed the same gate: in onnxruntime, or in float64
    where that is not installed, and the rollout that the training-time forward left in it.

    Raises UnusableInput for a name, a folder or a graph that cannot be used and where there is no
    compiler, CheckFailed where a build differs or rounding exceeds its tolerance; no files then.
    """
    name = require_name(wish.name or package.manifest.arch.replace("-", "_"))
    require_free(folder)
    host_compiler()
    graph = read_graph(package.model_bytes)
    model = Model(name, _program(graph, package, wish.kind), package.manifest, wish.kind,
                  package.sha256)  # fmt: skip
    reference = _Reference(package, graph, model, forward)
    progress(1, 4)
    try:
        with (
            _parents_of(folder),
            tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as place,
        ):
            draft = Path(place) / folder.name
            draft.mkdir()
            document = _written(draft, model, reference)
            progress(2, 4)
            document = _measured(read_c_folder(draft), document, reference, wish, real)
            progress(3, 4)
            _write(draft, model, document, reference)
            shutil.copytree(draft, Path(place) / "whole")
            (Path(place) / "whole").rename(folder)
    except OSError as error:
        raise UnusableInput(
            f"{folder}: cannot be written ({why(error)}); name another place for --c."
        ) from error
    progress(4, 4)
    return read_c_folder(folder)


@contextlib.contextmanager
def _parents_of(folder: Path) -> Iterator[None]:
    """The folders above, made where they are missing; those are removed again after a failure."""
    missing = [parent for parent in folder.parents if not parent.exists()]  # the deepest first
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for parent in missing:
            with contextlib.suppress(OSError):  # not made, or no longer empty
                parent.rmdir()
        raise


def _program(graph: Graph, package: Package, kind: Kind) -> Program:
    try:
        program = lowered(graph, package.manifest, kind)
    except NotInC as error:
        raise UnusableInput(
            f"This {package.manifest.arch} cannot become C: its graph {error}; export its run with"
            " this release."
        ) from error
    return rounded_together(program, graph, package.manifest) if kind == "int8" else program


class _Reference:
    """What the C is held against, on any inputs."""

    def __init__(
        self, package: Package, graph: Graph, model: Model, forward: Forward | None
    ) -> None:
        self.trained, self.name = (forward, _FORWARD) if forward else _graph(package, graph)
        self.record = None if forward else package.example
        self.limit = package.manifest.parity.limit
        self.rounded: Forward | None = None
        if model.kind != "float32":
            self.name = _ROUNDED
            self.rounded = _rounded(graph, package, model)
        self.inputs = driven(package.manifest)
        self.expected = self(self.inputs)

    def __call__(self, observations: FloatArray) -> FloatArray:
        """The forces (T, o) that C must give."""
        return (self.rounded or self.trained)(observations)


def _graph(package: Package, graph: Graph) -> tuple[Forward, str]:
    """The package's own graph, and what it is called."""
    if importlib.util.find_spec("onnxruntime") is None:
        exact = Interpreter(graph, package.manifest)
        return lambda observations: exact.rollout(observations).astype(np.float32), _WIDE
    from runtime.predictor import PackagePredictor
    from runtime.replay import rolled_out

    return lambda observations: rolled_out(PackagePredictor(package), observations), _GRAPH


def _rounded(graph: Graph, package: Package, model: Model) -> Forward:
    weights = {}
    for matrix in model.program.matrices:
        kept = matrix.rounded(model.kind)
        shape = graph.constants[matrix.tensor].shape
        weights[matrix.tensor] = (kept if matrix.is_by_outputs else kept.T).reshape(shape)
    exact = Interpreter(graph, package.manifest, weights)
    return lambda observations: exact.rollout(observations).astype(np.float32)


def _written(folder: Path, model: Model, reference: _Reference) -> Document:
    """The files as a first draft, whose document has no proof yet."""
    program = model.program
    text = self_test(model, reference.expected, reference.limit, reference.name)
    document = Document(
        name=model.name,
        weights=model.kind,
        package_sha256=model.package_sha256,
        header_sha256=sha256_of(header(model).encode()),
        test_sha256=sha256_of(text.encode()),
        state_bytes=program.state_bytes,
        stack_bytes=program.room_bytes,
        weight_bytes=program.weight_bytes(model.kind),
        steps=len(reference.expected),
        limit=reference.limit,
        reference=reference.name,
        proofs=(),
        rounding=None,
        manifest=model.manifest,
    )
    _write(folder, model, document, reference)
    return document


def _write(folder: Path, model: Model, document: Document, reference: _Reference) -> None:
    """All four files."""
    whole = sealed(source(model, document.model_dump_json(by_alias=True)))
    files = {
        f"{model.name}.c": whole,
        f"{model.name}.h": header(model),
        f"{model.name}_test.c": self_test(
            model, reference.expected, document.limit, document.reference
        ),
        "README.md": page(model, document),
    }
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8")


def _measured(
    folder: CFolder, document: Document, reference: _Reference, wish: Wish, real: Real | None
) -> Document:
    """The document with what was measured; CheckFailed where something is beyond its limit."""
    tested = _proved(folder, document, wish)
    # A build of the user's own flags is not loaded: with -ffast-math a library changes how the
    # whole process rounds. Its self-test has run in a process of its own.
    stepped = [_stepped(folder, flags, reference, real) for flags in _own_builds()]
    stepped += [0.0] * (len(tested.proofs) - len(stepped))
    proofs = tuple(
        proof.model_copy(update={"max_rel": max(proof.max_rel, worst)})
        for proof, worst in zip(tested.proofs, stepped, strict=True)
    )
    _require_parity(proofs, document)
    rounding = None if wish.kind == "float32" else _rounding(folder, reference, real)
    _require_tolerance(rounding, wish)
    update = {"proofs": proofs, "rounding": rounding}
    return document.model_copy(update=update)


def _proved(folder: CFolder, document: Document, wish: Wish) -> Proved:
    """`proved` of a draft, in words that do not name it: it is gone when they are read."""
    try:
        return proved(folder, wish.flags)
    except BuildFailed as error:
        is_ours = error.flags in _own_builds()
        advice = _report_this() if is_ours else "Give other --cflags."
        raise CheckFailed(
            f"The C of this {document.manifest.arch}: {error.what}; nothing was written. {advice}"
        ) from error


def _report_this() -> str:
    return f"Report this with the compiler's version: {version_of(host_compiler())}."


def _own_builds() -> list[tuple[str, ...]]:
    """The flags of the builds that `proved` makes first, in its order."""
    return list(dict.fromkeys((PLAIN, native_flags(host_compiler()))))


def _stepped(
    folder: CFolder, flags: Sequence[str], reference: _Reference, real: Real | None
) -> float:
    """The worst difference of the library that the loop would load, on real samples if any."""
    inputs = reference.inputs if real is None else real.observation
    expected = reference.expected if real is None else reference(inputs)
    predictor = CompiledPredictor(folder, flags=flags)
    worst = compare(rolled_out(predictor, inputs), expected).max_rel
    if reference.record is None or reference.rounded is not None:
        return worst
    recorded = compare(
        rolled_out(predictor, reference.record.observation), reference.record.force
    ).max_rel
    if worst <= reference.limit and not recorded <= reference.limit:
        raise CheckFailed(
            "The C gives what the package's graph gives, but not the forces recorded in the "
            f"package: relative {recorded:.1e}, limit {reference.limit:.1e}; nothing was written. "
            "Record and graph do not belong together; export the run anew."
        )
    return max(worst, recorded)


def _require_parity(proofs: Sequence[Proof], document: Document) -> None:
    worst = max(proofs, key=lambda proof: proof.max_rel)
    if not worst.max_rel <= document.limit:
        raise CheckFailed(
            f"The C of this {document.manifest.arch} differs from {document.reference.rstrip(',')}:"
            f" relative {worst.max_rel:.1e} with {worst.flags}, limit {document.limit:.1e}; nothing"
            f" was written. {_report_this()}"
        )


def _rounding(folder: CFolder, reference: _Reference, real: Real | None) -> Rounding:
    """What rounded weights change, on real episodes from a cold start where there are any."""
    predictor = CompiledPredictor(folder)
    series = [reference.inputs] if real is None else [given for given, _ in real.episodes]
    exact = [reference.trained(inputs).astype(np.float64) for inputs in series]  # (T, o) each
    given = [rolled_out(predictor, inputs).astype(np.float64) for inputs in series]  # (T, o) each
    every, all_given = np.concatenate(exact), np.concatenate(given)
    spread = np.where(every.std(axis=0) > 0.0, every.std(axis=0), 1.0)
    changed = float(np.max(np.sqrt(np.mean((all_given - every) ** 2, axis=0)) / spread))
    if real is None:
        return Rounding(on="made inputs over the ranges seen in training", rel_rms=changed)
    names = [channel.name for channel in folder.manifest.force]
    return Rounding(
        on=real.name,
        rel_rms=changed,
        rmse=dict(zip(names, _rmse(given, real), strict=True)),
        float_rmse=dict(zip(names, _rmse(exact, real), strict=True)),
    )


def _rmse(forces: Sequence[Wide], real: Real) -> list[float]:
    """The error per channel after the warm-up, of all episodes together."""
    apart = [
        (force[: len(true)] - true)[real.warm_up - 1 :]
        for force, (_, true) in zip(forces, real.episodes, strict=True)
    ]
    return [float(v) for v in np.sqrt(np.mean(np.concatenate(apart) ** 2, axis=0))]


def _require_tolerance(rounding: Rounding | None, wish: Wish) -> None:
    if rounding is None:
        return
    is_real = rounding.worse is not None
    measured = rounding.rel_rms if rounding.worse is None else rounding.worse
    if measured > wish.tolerance:
        what = "the error grows" if is_real else "the force changes"
        raise CheckFailed(
            f"With {wish.kind} weights {what} by {100.0 * measured:.2g} % on {rounding.on}, and"
            f" {100.0 * wish.tolerance:g} % are tolerated; nothing was written. Keep more bits with"
            " --weights, or allow more with --tolerance."
        )
