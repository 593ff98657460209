"""Predictors as folders of C: written from a run or a package, proved before they have a name."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypedDict, get_args

from wakedeploy.api.arguments import words
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from export.c.packaging import Forward, Wish
    from runtime.compiled.folder import CFolder
    from trainers.trained_run import TrainedRun
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.core.package import Package

Weights = Literal["float32", "float16", "int8"]
Steps = Callable[[int, int], None]


class AsC(TypedDict, total=False):
    """How C shall be.

    `weights` is how it keeps those of matrices, `name` what its functions are called (default: the
    architecture), `tolerance` the share by which rounded weights may make the error grow (default:
    0.02), `flags` are the compiler's with which it is proved besides.
    """

    weights: Weights
    name: str | None
    tolerance: float
    flags: Sequence[str]


def wish_of(folder: Path, as_c: AsC) -> "Wish":
    """What is asked for, judged before minutes are spent on it.

    Raises UnusableInput for a name or a folder that cannot be used, unknown weights, a tolerance
    that is no share, and where there is no compiler.
    """
    from export.c.identifiers import require_name
    from export.c.packaging import TOLERANCE, Wish, require_free
    from runtime.compiled.compiler import host_compiler

    weights, tolerance = as_c.get("weights", "float32"), as_c.get("tolerance", TOLERANCE)
    if weights not in get_args(Weights):
        raise UnusableInput(f"weights {weights!r}: C keeps {', '.join(get_args(Weights))}.")
    if not isinstance(tolerance, int | float) or not 0.0 <= tolerance <= 1.0:
        raise UnusableInput(f"tolerance {tolerance!r}: a share from 0 to 1, such as 0.02.")
    if (name := as_c.get("name")) is not None:
        require_name(name)
    require_free(folder)
    host_compiler()
    return Wish(weights, name, words("flags", as_c.get("flags", ())), tolerance)


def c_of_package(
    package: "Package", folder: Path, wish: "Wish", data: "EpisodeSet | None", steps: Steps
) -> "CFolder":
    """C of a package, held against its graph in onnxruntime; with its set on real episodes.

    Raises what `export.c.packaging.export_c` does.
    """
    return _written(package, folder, wish, None, data, steps)


def c_of_run(
    package: "Package",
    run: "TrainedRun",
    folder: Path,
    wish: "Wish",
    data: "EpisodeSet",
    steps: Steps,
) -> "CFolder":
    """C of a run that became this package, held against the training-time forward.

    Raises what `export.c.packaging.export_c` does.
    """
    from export.example import rollout
    from export.limits import limited

    force, predictor = package.manifest.force, run.predictor.eval()
    return _written(
        package, folder, wish, lambda given: limited(rollout(predictor, given), force), data, steps
    )


def _written(
    package: "Package",
    folder: Path,
    wish: "Wish",
    forward: "Forward | None",
    data: "EpisodeSet | None",
    steps: Steps,
) -> "CFolder":
    from export.c.packaging import export_c
    from export.c.real import real_samples

    real = None if data is None else real_samples(data, package.manifest)
    return export_c(package, folder, wish, forward=forward, real=real, progress=steps)
